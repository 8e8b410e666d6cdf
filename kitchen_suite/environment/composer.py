"""The private names of dm_control's composer on which the environment relies, and a check that they exist."""

import collections
import importlib.metadata
import pkgutil
from collections.abc import Collection, Mapping
from types import MappingProxyType

import numpy as np
from dm_control import mjcf
from dm_control.composer import observation
from dm_control.composer.observation import observable

REQUIREMENT = "dm-control >= 1.0.50, < 1.1"

# By class. Most are attributes of instances, some are methods.
PRIVATE_NAMES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "dm_control.composer.environment:Environment": (
            "_delayed_observation_padding",
            "_fixed_initial_state",
            "_fixed_random_state",
            "_hooks",
            "_legacy_step",
            "_make_observation_updater",
            "_n_sub_steps",
            "_observation_updater",
            "_overridden_n_sub_steps",
            "_physics",
            "_physics_proxy",
            "_random_state",
            "_recompile_physics",
            "_reset_next_step",
            "_strip_singleton_obs_buffer_dim",
            "_substep",
            "_task",
        ),
        "dm_control.mujoco.engine:Physics": (
            "_contexts",
            "_free_rendering_contexts",
            "_make_rendering_contexts",
            "_reload_from_data",
        ),
        "dm_control.composer.environment:_EnvironmentHooks": ("_after_substep", "_before_substep"),
        "dm_control.composer.environment:_Hook": ("entity_hooks", "extra_hooks"),
        "dm_control.composer.observation.updater:Updater": (
            "_enabled_structure",
            "_observables",
            "_physics_steps_per_control_step",
            "_step_counter",
            "_strip_singleton_buffer_dim",
        ),
        "dm_control.composer.observation.updater:_EnabledObservable": ("buffer", "observation_callable"),
    }
)


def check_private_names(required: Mapping[str, Collection[str]] = PRIVATE_NAMES) -> None:
    """Checks that the installed dm_control has the required names, by class.

    Raises:
      ImportError: some are missing; the message names them and the versions that have them.
    """
    missing = [f"{path}.{name}" for path, names in required.items() for name in sorted(set(names) - names_of(path))]
    if missing:
        installed = importlib.metadata.version("dm-control")
        raise ImportError(f"dm-control {installed} has no {', '.join(missing)}; kitchen_suite needs {REQUIREMENT}")


def names_of(path: str) -> set[str]:
    """Returns the names that a class defines or that its methods use; none where there is no such class."""
    try:
        cls = pkgutil.resolve_name(path)
    except (AttributeError, ImportError):
        return set()
    members = [member for base in cls.__mro__ for member in vars(base).items()]
    code = [member.__code__ for _, member in members if hasattr(member, "__code__")]
    return {name for name, _ in members}.union(*(block.co_names for block in code))


def is_unbuffered(part: observable.Observable) -> bool:
    """Whether an observable is updated at every physics step, without delay or buffer."""
    return (
        part.update_interval == observation.updater.DEFAULT_UPDATE_INTERVAL
        and not part.delay
        and part.buffer_size in (None, observation.updater.DEFAULT_BUFFER_SIZE)
    )


class UnbufferedUpdater(observation.Updater):
    """composer's updater, which bypasses the buffers if no enabled observable needs one.

    It then reads each observable once per control step. Observations and the draws of corruptors are the same.
    """

    def __init__(
        self,
        observables: Mapping[str, observable.Observable],
        physics_steps_per_control_step: int,
        strip_singleton_buffer_dim: bool,
        pad_with_initial_value: bool,
    ) -> None:
        """Builds the updater; arguments as of composer's, with the observables in a single dict."""
        super().__init__(
            observables, physics_steps_per_control_step, strip_singleton_buffer_dim, pad_with_initial_value
        )
        self._bypasses_buffers = False

    def reset(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        super().reset(physics, random_state)
        enabled = [part for part in self._observables.values() if part.enabled]
        self._bypasses_buffers = self._strip_singleton_buffer_dim and all(
            is_unbuffered(part) and not part.aggregator for part in enabled
        )
        self._readers = [
            (name, buffered.observation_callable, buffered.buffer.dtype)
            for name, buffered in self._enabled_structure.items()
        ]
        self._observation: collections.OrderedDict[str, np.ndarray] = super().get_observation()

    def skip(self, steps: int) -> None:
        """Counts physics steps of the present control step without updating the observables."""
        self._step_counter += steps

    def prepare_for_next_control_step(self) -> None:
        if not self._bypasses_buffers:
            super().prepare_for_next_control_step()

    def update(self) -> None:
        if not self._bypasses_buffers:
            super().update()
            return
        self._step_counter += 1
        if self._step_counter % self._physics_steps_per_control_step == 0:
            self._observation = collections.OrderedDict(
                (name, np.array(read(), dtype)) for name, read, dtype in self._readers
            )

    def get_observation(self) -> collections.OrderedDict[str, np.ndarray]:
        return self._observation.copy() if self._bypasses_buffers else super().get_observation()
