"""Attributes of Gymnasium's own vectors that the suite's vectorised environments have otherwise, or not at all."""

from typing import Any, NoReturn

_PROCESSES = "the environments are stepped by threads of this process, of which num_threads is the number"
_AT_ONCE = "step and reset return when all environments are done"


class Absent:
    """An attribute that is not there: reading it raises an AttributeError that names the way to take instead."""

    def __init__(self, way: str) -> None:
        """Takes the way, a sentence without its period."""
        self._way = way
        self._name = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, instance: Any, owner: type | None = None) -> Any:
        if instance is None:
            return self
        raise AttributeError(f"{type(instance).__name__} has no attribute {self._name!r}: {self._way}")


class GymnasiumNames:
    """Public attributes of `gymnasium.vector.SyncVectorEnv` and `AsyncVectorEnv` beyond those of `VectorEnv`.

    Attributes:
      copy: whether observations are fresh arrays; they always are.
      observation_mode: `same`, since all environments have equal spaces.
    """

    copy = True
    observation_mode = "same"

    env_fns = Absent("template_env is the environment that starts the episodes, from which more can be copied")
    envs = Absent(
        "the environments are stepped together; get_attr and call read what each one is, template_env starts their "
        "episodes"
    )
    context = Absent(_PROCESSES)
    daemon = Absent(_PROCESSES)
    error_queue = Absent(_PROCESSES)
    max_concurrency = Absent(_PROCESSES)
    parent_pipes = Absent(_PROCESSES)
    processes = Absent(_PROCESSES)
    shared_memory = Absent(_PROCESSES)
    worker = Absent(_PROCESSES)
    observations = Absent("step and reset return the observations, in fresh arrays")
    call_async = Absent("call returns the results")
    call_wait = Absent("call returns the results")
    reset_async = Absent(_AT_ONCE)
    reset_wait = Absent(_AT_ONCE)
    step_async = Absent(_AT_ONCE)
    step_wait = Absent(_AT_ONCE)

    def set_attr(self, name: str, values: Any) -> NoReturn:
        """Raises an AttributeError: the environments share one model and their settings."""
        raise AttributeError(
            f"{name} cannot be set, as the environments share one model and their settings: pass it when they are "
            "built; what varies from episode to episode is chosen by variations and by the options of reset"
        )

    def __reduce__(self) -> NoReturn:
        raise TypeError(
            "vectorised environments cannot be copied or pickled, as threads of this process step them: build others "
            "by make_vec; single environments can be copied, such as template_env"
        )
