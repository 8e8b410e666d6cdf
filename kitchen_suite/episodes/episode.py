"""Episodes as arrays by name.

The names, for an episode of `T` control steps:
  `observation`, or `observation/<key>` with any number of keys: `(T + 1, ...)`, from the reset to the last step.
  `info/<key>`: `(T + 1, ...)`, from the reset to the last step.
  `physics_state`: `(T + 1, nq + nv + na)` float64, from the reset to the last step: MuJoCo's `qpos`, `qvel` and `act`,
    as `physics.get_state()` of dm_control. Older recordings and those of other programs lack it.
  `action`: `(T, n)`, as it was applied.
  `reward`: `(T,)` float64; `termination`, `truncation`: `(T,)` bool.
  `label/<key>`: `(T, ...)`, what the policy says of its actions, such as `is_intervention`; with most policies, none.
"""

import collections
import dataclasses
import hashlib
import math
from collections.abc import Callable, Collection, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import dm_env
import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from kitchen_suite import checks, files
from kitchen_suite.environment import Environment
from kitchen_suite.gymnasium_env.base import SuiteEnv, suite_env
from kitchen_suite.tasks.metrics import Metrics
from kitchen_suite.tasks.terms import MAX_NAME_PARTS


class Step(NamedTuple):
    """A control step by the names above: values of one environment, or arrays `(n, ...)` of many."""

    action: NDArray
    reward: Any
    termination: Any
    truncation: Any


# Greatest magnitude of a recorded number, that from which MuJoCo takes the physics to have diverged (mjMAXVAL).
MAX_VALUE = 1e10

# Name of the array of physics states.
PHYSICS_STATE = "physics_state"

# Kinds of NumPy dtypes, rows beside one a control step, and dimensions (0: any) of the arrays above.
_LAYOUT = {
    "action": ("f", 0, 2),
    "reward": ("f", 0, 1),
    "termination": ("b", 0, 1),
    "truncation": ("b", 0, 1),
    "observation": ("uif", 1, 0),
    "info": ("biuf", 1, 0),
    PHYSICS_STATE: ("f", 1, 2),
    "label": ("biuf", 0, 0),
}


# Beginnings that names may lack where they are looked up.
_BEGINNINGS = ("", "observation/", "observation/pixels/", "pixels/")


class NamedArrays(dict[str, NDArray]):
    """Arrays by name, which are found by the names of cameras and without the beginning `observation/` as well.

    The picture `observation/pixels/franka_hand` of the camera `franka/hand` is also found as `franka/hand` and as
    `pixels/franka/hand`. Any other name is a KeyError that lists the names there are; `in` and `get` take exact ones.
    """

    def __missing__(self, name: str) -> NDArray:
        for beginning in _BEGINNINGS:
            wanted = _without_slashes(f"{beginning}{name}")
            found = [each for each in self if _without_slashes(each) == wanted]
            if len(found) == 1:
                return self[found[0]]
        raise KeyError(f"there is no array {checks.shown(name)}{checks.hint(name, self)}")


def _without_slashes(name: str) -> str:
    return name.replace("/", "_")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Summary:
    """The length, return and metrics of an episode.

    Attributes:
      seed: of the environment's reset; None if unknown.
      steps: number of control steps.
      total_reward: undiscounted return.
      metrics: of its task by name, such as `success`.
      seconds: its share of the time that playing took [s].
    """

    seed: int | None
    steps: int
    total_reward: float
    metrics: Metrics
    seconds: float

    @property
    def success(self) -> bool:
        """Whether the episode succeeded; False where its metrics do not tell."""
        return bool(self.metrics.get("success"))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Episode:
    """An episode: its number in the recording, and its arrays by the names above.

    Attributes:
      seed: seed of the environment's reset; None if unknown.
      arrays: by the names above; similar names find them as well (see `NamedArrays`).
      seconds: its share of the time that playing took [s].
      instruction: the task's sentence; the empty string if it has none.
      metrics: of its task by name, such as `success`; none for an episode that another program recorded.
      diverged: whether the physics has diverged; the last step has no meaning then, and neither have the last infos.
    """

    index: int
    seed: int | None
    arrays: Mapping[str, NDArray]
    seconds: float = 0.0
    instruction: str = ""
    metrics: Metrics = dataclasses.field(default_factory=dict)
    diverged: bool = False

    @property
    def steps(self) -> int:
        """Number of control steps."""
        return len(self.arrays["reward"])

    @property
    def total_reward(self) -> float:
        """Undiscounted return."""
        return float(self.arrays["reward"].sum())

    @property
    def success(self) -> bool:
        """Whether the episode succeeded; False where its metrics do not tell."""
        return self.summary.success

    @property
    def summary(self) -> Summary:
        return Summary(
            seed=self.seed,
            steps=self.steps,
            total_reward=self.total_reward,
            metrics=self.metrics,
            seconds=self.seconds,
        )

    @property
    def digest(self) -> str:
        """SHA-256 of the names, types, shapes and contents of the arrays, and of the episode's number."""
        digest = hashlib.sha256()
        self.update_digest(digest)
        return digest.hexdigest()

    def update_digest(self, digest: "hashlib._Hash") -> None:
        """Adds the arrays to a digest of several episodes."""
        for name, array in sorted(self.arrays.items()):
            digest.update(f"{self.index} {name} {array.dtype.str} {array.shape} ".encode())
            digest.update(array.tobytes())

    @property
    def actions_sha256(self) -> str:
        """SHA-256 of type, shape and contents of the actions; a replay does not notice a change without effect."""
        actions = self.arrays["action"]
        return hashlib.sha256(f"{actions.dtype.str} {actions.shape} ".encode() + actions.tobytes()).hexdigest()

    def check(self, actions_sha256: str | None = None) -> None:
        """Raises a ValueError unless the arrays are those of an episode, with actions of this digest if it is given."""
        if missing := [name for name in Step._fields if name not in self.arrays]:
            raise ValueError(f"{', '.join(missing)} is missing")
        if not any(_part(name) == "observation" for name in self.arrays):
            raise ValueError("there are no observations")
        count = self.arrays["reward"].size
        _check_names(self.arrays)
        for name, array in self.arrays.items():
            kinds, extra, dimensions = _LAYOUT.get(_part(name), ("", 0, 0))
            if array.dtype.kind not in kinds or array.ndim != (dimensions or array.ndim):
                raise ValueError(f"{name} is an array of {array.dtype} with {array.ndim} dimensions")
            if array.ndim == 0 or len(array) != count + extra or not count:
                raise ValueError(f"{name} of shape {array.shape} does not fit {count} control steps")
            if _part(name) == "observation" and array.ndim < 2:
                raise ValueError(f"{name} of shape {array.shape} has no numbers for each control step")
        if actions_sha256 is not None and actions_sha256 != self.actions_sha256:
            raise ValueError("its actions are not those that were recorded: their SHA-256 does not match")

    def check_fits(self, environment: gymnasium.Env, *, is_partial: bool = False) -> None:
        """Raises a ValueError unless observations and actions are in the spaces of an environment, in its types.

        Args:
          environment: of the specification of the episode.
          is_partial: whether observed numbers may be NaN, as where another program has not recorded all of them.
        """
        wanted = flatten(environment.observation_space, "observation")
        given = {name: array for name, array in self.arrays.items() if _part(name) == "observation"}
        if odd := sorted(given.keys() ^ wanted.keys()):
            raise ValueError(f"the observations of episode {self.index} lack, or have beside their own, {odd}")
        spaces_of = {**{name: (given[name], space) for name, space in wanted.items()}}
        spaces_of["action"] = self.arrays["action"], environment.action_space
        for name, (array, space) in spaces_of.items():
            if array.shape[1:] != space.shape or array.dtype.kind != space.dtype.kind:
                found, own = (f"{each.dtype.kind}{list(each.shape[-len(space.shape) :])}" for each in (array, space))
                raise ValueError(f"{name} of episode {self.index} has {found} in a control step, not {own}")
            known = array[np.isfinite(array)] if is_partial and name != "action" else array
            if not np.isfinite(known).all() or float(np.abs(known).max(initial=0)) > MAX_VALUE:
                raise ValueError(
                    f"{name} of episode {self.index} has numbers that are not finite, or above {MAX_VALUE:g}"
                )

    @property
    def last_info(self) -> dict[str, NDArray]:
        return {name.removeprefix("info/"): rows[-1] for name, rows in self.arrays.items() if name.startswith("info/")}

    @property
    def labels(self) -> dict[str, NDArray]:
        """The arrays of the policy's labels, by the names above."""
        return {name: rows for name, rows in self.arrays.items() if _part(name) == "label"}


def _part(name: str) -> str:
    return name.partition("/")[0]


def _check_names(names: Collection[str]) -> None:
    """Raises a ValueError for a name that is too deep or has empty parts, or that is a group of other names as well."""
    groups = checks.groups(names)
    for name in names:
        parts = name.split("/")
        if len(parts) > MAX_NAME_PARTS or not all(parts):
            raise ValueError(f"{checks.shown(name)} is no name of an array")
        if name in groups:
            raise ValueError(f"{checks.shown(name)} is the name of an array and the beginning of those of others")


def flatten(nested: Any, name: str) -> dict[str, Any]:
    """Returns the leaves of nested dicts by their path, which begins with `name`, in the order of the dicts."""
    # dm-tree would sort the keys, but goals by task are in the configured order.
    if not isinstance(nested, Mapping):
        return {name: nested}
    return {path: leaf for key, part in nested.items() for path, leaf in flatten(part, f"{name}/{key}").items()}


def unflatten(arrays: Mapping[str, NDArray], name: str) -> Any:
    """Returns the nested dicts of which `flatten` made `arrays`."""
    if name in arrays:
        return arrays[name]
    nested: dict[str, Any] = {}
    for path in arrays:
        if path.startswith(f"{name}/"):
            *keys, last = path.split("/")[1:]
            branch = nested
            for key in keys:
                branch = branch.setdefault(key, {})
            branch[last] = arrays[path]
    return nested


def check_file_size(observation_space: spaces.Space, steps: int) -> None:
    """Raises a ValueError if an episode's file of `steps` control steps would be too large to be read again."""
    parts = flatten(observation_space, "observation").values()
    size = (steps + 1) * sum(part.dtype.itemsize * math.prod(part.shape) for part in parts)
    if size > files.MAX_ARRAY_BYTES:
        raise ValueError(
            f"the observations of {steps} control steps take {size / 2**20:.0f} MiB, more than the "
            f"{files.MAX_ARRAY_BYTES / 2**20:.0f} MiB of an episode's file: choose a smaller image_size, fewer cameras "
            "or fewer control steps"
        )


class EpisodeBuffer:
    """The steps of an episode in progress, from the observation, the info and the physics state of its reset on.

    `name` is one for readers. Without a physics state at the reset there is none after the steps either.
    """

    def __init__(
        self, observation: Any, info: Mapping[str, Any], physics_state: NDArray | None = None, name: str = ""
    ) -> None:
        self.name = name
        self.observation = observation
        self._rows = [_row(observation, info, physics_state)]
        self._steps: list[Step] = []
        self._labels: list[Mapping[str, Any]] = []

    def add(
        self,
        step: Step,
        observation: Any,
        info: Mapping[str, Any],
        physics_state: NDArray | None = None,
        labels: Mapping[str, Any] = MappingProxyType({}),
    ) -> None:
        self.observation = observation
        self._rows.append(_row(observation, info, physics_state))
        self._steps.append(step)
        self._labels.append(flatten(labels, "label"))

    def step(
        self, environment: gymnasium.Env, action: NDArray, labels: Mapping[str, Any] = MappingProxyType({})
    ) -> None:
        observation, reward, termination, truncation, info = environment.step(action)
        step = Step(action, float(reward), termination, truncation)
        self.add(step, observation, info, suite_env(environment).physics_state, labels)

    def truncate(self) -> None:
        self._steps[-1] = self._steps[-1]._replace(truncation=True)

    def cut(self, steps: int, observation: Any) -> None:
        """Goes back to a number of control steps, after which the observation was the given one."""
        self.observation = observation
        del self._rows[steps + 1 :], self._steps[steps:], self._labels[steps:]

    @property
    def steps(self) -> int:
        return len(self._steps)

    @property
    def has_ended(self) -> bool:
        """Whether the last step terminated or truncated the episode."""
        return bool(self._steps) and (self._steps[-1].termination or self._steps[-1].truncation)

    @property
    def reward(self) -> float:
        """Reward of the last step; 0 before the first one."""
        return self._steps[-1].reward if self._steps else 0.0

    @property
    def total_reward(self) -> float:
        """Undiscounted return up to now."""
        return math.fsum(step.reward for step in self._steps)

    def timestep(self, environment: SuiteEnv) -> dm_env.TimeStep:
        """Returns the present time step as the suite's own environment would."""
        observation = environment.present_observation
        if not self._steps:
            return dm_env.restart(observation)
        return dm_env.transition(self.reward, observation)

    def arrays(self) -> NamedArrays:
        """Returns the arrays of the episode so far."""
        columns = zip(*self._steps, strict=True)
        arrays = {
            **{name: np.stack([row[name] for row in self._rows]) for name in self._rows[0]},
            **{name: np.array(column) for name, column in zip(Step._fields, columns, strict=True)},
            **{name: np.array([labels[name] for labels in self._labels]) for name in self._labels[0]},
        }
        return NamedArrays(arrays)

    def episode(self, environment: gymnasium.Env, index: int, seed: int | None, seconds: float = 0.0) -> Episode:
        """Returns the episode so far, with the sentence and the metrics of the environment's present episode."""
        inner = suite_env(environment)
        episode = Episode(index=index, seed=seed, arrays=self.arrays(), seconds=seconds, instruction=inner.instruction)
        metrics = inner.composer_task.records.metrics(episode.last_info)
        return dataclasses.replace(episode, metrics=metrics)

    def differing(self, arrays: Mapping[str, NDArray]) -> str:
        """Returns the name of an array of an episode of which the present steps are not the first ones, or nothing.

        Of observations, infos and physics states only the last ones are compared.
        """
        rewards = np.array([step.reward for step in self._steps])
        if not np.array_equal(rewards, arrays["reward"][: self.steps]):
            return "reward"
        last = self._rows[-1]
        common = [name for name in last if name in arrays and arrays[name].shape[1:] == last[name].shape]
        equal = (np.array_equal(last[name], arrays[name][self.steps], equal_nan=True) for name in common)
        return next((name for name, is_equal in zip(common, equal, strict=True) if not is_equal), "")


# Numbers and seeds of episodes to play, taken from the left.
Waiting = collections.deque[tuple[int, int]]

Watch = Callable[[EpisodeBuffer, Environment], None]
"""Called with an episode in progress and its environment, after its reset and after every step."""


def ignore(buffer: EpisodeBuffer, environment: Environment) -> None:
    """Watches nothing."""


def _row(observation: Any, info: Mapping[str, Any], physics_state: NDArray | None) -> dict[str, NDArray]:
    arrays = {name: value for name, value in flatten(info, "info").items() if isinstance(value, np.ndarray)}
    state = {} if physics_state is None else {PHYSICS_STATE: physics_state}
    return {**flatten(observation, "observation"), **arrays, **state}
