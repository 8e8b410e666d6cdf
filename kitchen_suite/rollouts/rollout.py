"""The loops that play episodes, each from its own seed: one after the other, and many at once."""

import collections
import contextlib
import dataclasses
import itertools
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

import dm_env
import gymnasium
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies import Policy, PolicyBuilder, PolicyError, labels_of
from kitchen_suite.rollouts.episode import EpisodeArrays, EpisodeBuffer, Step, flatten
from kitchen_suite.rollouts.spec import EpisodePolicies, EpisodeSpec, SeededPolicies, clipped_action, reset_to_seed
from kitchen_suite.vector_env.base import SuiteVectorEnv

# Control steps that an episode can go back.
REWIND_STEPS = 250


def episode_name(index: int, seed: int | None) -> str:
    """Returns the name of the episode of a number and a seed, if that is known."""
    return f"episode {index}" + ("" if seed is None else f", seed {seed}")


class SingleRollout:
    """Plays the episodes of a specification one by one; each depends on nothing but its seed.

    Attributes:
      environment: in which they are played.
      buffer: the steps of the episode in progress.
      options: those of its reset.
      policy: that of this episode.
    """

    buffer: EpisodeBuffer
    options: Mapping[str, Any] | None
    policy: Policy

    def __init__(self, spec: EpisodeSpec, build_policy: PolicyBuilder | None = None, **extra: Any) -> None:
        """Makes the environment, with `extra` further arguments, and finds the policy, if no builder is given."""
        self._spec = spec
        self.environment = spec.make_environment(**extra)
        self._policies = SeededPolicies(build_policy) if build_policy else spec.episode_policies()

    def start(self, seed: int, name: str = "", options: Mapping[str, Any] | None = None) -> None:
        """Starts the episode of a seed, with a name for readers; raises a PolicyError if the policy cannot be built.

        `options` are those of the reset.
        """
        self.options = options
        self.buffer = EpisodeBuffer(*reset_to_seed(self.environment, seed, self._spec.seeding, options), name=name)
        self.policy = self._policies.start(suite_env(self.environment).environment, seed, options)

    def step(self) -> None:
        """Makes a control step with the policy's action.

        Raises:
          PhysicsError: the physics has diverged.
          PolicyError: the policy raised an exception, or returned a bad action.
        """
        timestep = self.buffer.timestep(suite_env(self.environment))
        action = clipped_action(self.policy, timestep, self.environment.action_space)
        self.repeat(action, labels_of(self.policy))

    def repeat(self, action: NDArray, labels: Mapping[str, Any]) -> None:
        """Makes a control step with an action, and the labels of the policy that has chosen it."""
        self.buffer.step(self.environment, action, labels)

    def play(
        self,
        index: int,
        seed: int,
        watch: Callable[[EpisodeBuffer], None] = lambda buffer: None,
        options: Mapping[str, Any] | None = None,
    ) -> EpisodeArrays:
        """Plays the episode of a number, a seed and the options of its reset.

        `watch` is called after the reset and after every step.
        """
        started = time.perf_counter()
        self.start(seed, episode_name(index, seed), options)
        watch(self.buffer)
        while not self.buffer.has_ended:
            self.step()
            watch(self.buffer)
        return EpisodeArrays(
            index=index,
            seed=seed,
            arrays=self.buffer.arrays(),
            seconds=time.perf_counter() - started,
            instruction=suite_env(self.environment).instruction,
        )


class RewindableRollout(SingleRollout):
    """Also goes back to earlier control steps of an episode, and on from there in another way.

    What is left of the episode afterwards is to the bit what it would be if it had never gone otherwise.
    """

    def __init__(self, spec: EpisodeSpec, build_policy: PolicyBuilder | None = None, **extra: Any) -> None:
        # Gymnasium's time limit could not go back.
        super().__init__(spec, build_policy, max_episode_steps=-1, **extra)

    def start(self, seed: int, name: str = "", options: Mapping[str, Any] | None = None) -> None:
        self._states: collections.deque[dict[str, Any]] = collections.deque(maxlen=REWIND_STEPS)
        super().start(seed, name, options)

    def repeat(self, action: NDArray, labels: Mapping[str, Any]) -> None:
        state = suite_env(self.environment).get_state()
        super().repeat(action, labels)
        self._states.append(state)
        if self.buffer.steps >= self._spec.max_episode_steps:
            self.buffer.truncate()

    def rewind(self, steps: int) -> int:
        """Goes back by a number of control steps, or as far as states are kept; returns by how many."""
        count = min(steps, len(self._states))
        if count <= 0:
            return 0
        state = [self._states.pop() for _ in range(count)][-1]
        observation = suite_env(self.environment).set_state(state)
        self.buffer.cut(self.buffer.steps - count, observation)
        return count


class BatchStep(NamedTuple):
    """Observations and rewards of all environments after a step or a reset.

    Attributes:
      observations: of the vectorised observation space.
      rewards: `(n,)`, of the last step.
      is_first: `(n,)`, whether the last call was a reset.
      is_playing: `(n,)`, whether an episode is in progress; elsewhere observations and actions mean nothing.
    """

    observations: Any
    rewards: NDArray[np.float64]
    is_first: NDArray[np.bool_]
    is_playing: NDArray[np.bool_]


class Controller(Protocol):
    """Chooses the actions of all environments."""

    @property
    def labels(self) -> Mapping[str, NDArray]:
        """Labels `(n, ...)` of the last actions by name; see `policies.labels_of`."""

    def start(self, i: int, seed: int, options: Mapping[str, Any]) -> None:
        """Prepares for an episode of a seed and the options of its reset, in environment `i`."""

    def act(self, step: BatchStep) -> NDArray:
        """Returns the actions `(n, ...)`."""


class PolicyController:
    """Acts by a policy of its own in each environment, on time steps as the suite's own environment returns them."""

    def __init__(self, environments: SuiteVectorEnv, episode_policies: EpisodePolicies) -> None:
        """Prepares to build the policies that act in some environments."""
        self._environments, self._episode_policies = environments, episode_policies
        assert isinstance(environments.single_action_space, gymnasium.spaces.Box)
        self._space = environments.single_action_space
        self._policies: dict[int, Policy] = {}
        self.labels: Mapping[str, NDArray] = {}

    def start(self, i: int, seed: int, options: Mapping[str, Any]) -> None:
        environment = self._environments.template_of(i).environment
        self._policies[i] = self._episode_policies.start(environment, seed, options)

    def act(self, step: BatchStep) -> NDArray:
        actions = np.zeros((step.rewards.size, *self._space.shape), self._space.dtype)
        # Policies act on the time steps of dm_env, in rollouts as in recordings.
        observations = self._environments.present_observation
        for i in np.flatnonzero(step.is_playing).tolist():
            actions[i] = self._action(i, step, {key: array[i] for key, array in observations.items()})
        self.labels = self._present_labels(step.is_playing)
        return actions

    def _present_labels(self, is_playing: NDArray[np.bool_]) -> dict[str, NDArray]:
        """Returns the labels `(n, ...)` of the last actions; zeros where no episode is in progress."""
        playing = np.flatnonzero(is_playing).tolist()
        each = [labels_of(self._policies[i]) for i in playing]
        labels = {name: np.array([one[name] for one in each]) for name in each[0]}
        return {name: _spread(values, playing, is_playing.size) for name, values in labels.items()}

    def _action(self, i: int, step: BatchStep, observation: dict[str, NDArray]) -> NDArray:
        timestep = dm_env.restart(observation) if step.is_first[i] else dm_env.transition(step.rewards[i], observation)
        action = clipped_action(self._policies[i], timestep, self._space)
        if np.abs(action).max() > np.finfo(self._space.dtype).max:
            raise PolicyError(f"the policy's action does not fit into {self._space.dtype}: {action}")
        return action


class NetworkController:
    """Acts by a function of the observations of all environments at once."""

    labels: Mapping[str, NDArray] = MappingProxyType({})

    def __init__(self, network: Callable[[Any], NDArray]) -> None:
        """Takes a function from vectorised observations to actions `(n, ...)`."""
        self._network = network

    def start(self, i: int, seed: int, options: Mapping[str, Any]) -> None:
        """Unused: a network has no state of an episode."""

    def act(self, step: BatchStep) -> NDArray:
        return self._network(step.observations)


@dataclasses.dataclass
class _Running:
    """An episode in progress in one of the environments.

    Attributes:
      index: its number.
      seed: of the episode.
      first: number of the time of its reset in the history.
      seconds: its share of the time that playing took [s].
    """

    index: int
    seed: int
    first: int
    seconds: float = 0.0


class EndedEpisode:
    """An episode that has just ended, to be read before the next one is taken from `VectorRollout.play`.

    Attributes:
      i: number of the environment in which it was played.
      diverged: whether its physics has diverged; its last step then has no meaning, and neither have the last infos.
    """

    def __init__(self, history: "_History", i: int, running: _Running, instruction: str, diverged: bool) -> None:
        self.i, self.diverged = i, diverged
        self._history, self._running, self._instruction = history, running, instruction

    @property
    def rewards(self) -> NDArray[np.float64]:
        """Rewards `(T,)` of its control steps."""
        return self._history.rewards(self.i, self._running.first)

    @property
    def last_info(self) -> dict[str, NDArray]:
        """Infos of the last step."""
        return self._history.last_info(self.i)

    def collect(self) -> EpisodeArrays:
        """Returns all arrays of the episode."""
        arrays = self._history.episode(self.i, self._running.first)
        return EpisodeArrays(
            index=self._running.index,
            seed=self._running.seed,
            arrays=arrays,
            seconds=self._running.seconds,
            instruction=self._instruction,
        )


class VectorRollout:
    """Plays many episodes at once; each is the one that a new environment of its seed would play alone."""

    def __init__(
        self, environments: SuiteVectorEnv, controller: Controller, resets: Sequence[Mapping[str, Any]] = ()
    ) -> None:
        """Prepares to play in environments with autoreset mode `Disabled`, by the actions of a controller.

        `resets` has the options of the reset of each episode, by its number; none where it is empty.
        """
        self._environments, self._controller, self._resets = environments, controller, resets
        count = environments.num_envs
        self._running: list[_Running | None] = [None] * count
        self._observations: Any = None  # After the last step or reset.
        self._rewards, self._is_first = np.zeros(count), np.zeros(count, bool)
        self._history = _History()

    def play(self, waiting: collections.deque[tuple[int, int]]) -> Iterator[tuple[int, EndedEpisode]]:
        """Yields the number of each episode as it ends, and the episode.

        `waiting` has numbers and seeds, taken from the left; it may grow while they are played.
        """
        needs_reset = np.full(len(self._running), True)
        while True:
            if waiting:
                needs_reset |= [running is None for running in self._running]
            for i in np.flatnonzero(needs_reset).tolist():
                self._running[i] = self._next(i, waiting)
            is_playing = np.array([running is not None for running in self._running])
            if not is_playing.any():
                return
            started = time.perf_counter()
            # The first reset has to be of all environments; later, those without an episode to play are left out.
            self._reset(needs_reset if self._history.is_empty else needs_reset & is_playing)
            needs_reset, diverged = self._step(is_playing)
            self._share(time.perf_counter() - started)
            for i in np.flatnonzero(needs_reset).tolist():
                if running := self._running[i]:
                    instruction = self._environments.instruction[i]
                    yield running.index, EndedEpisode(self._history, i, running, instruction, bool(diverged[i]))

    def _next(self, i: int, waiting: collections.deque[tuple[int, int]]) -> _Running | None:
        if not waiting:
            return None
        index, seed = waiting.popleft()
        self._controller.start(i, seed, self._resets[index] if self._resets else {})
        return _Running(index, seed, self._history.present)

    def _reset(self, mask: NDArray[np.bool_]) -> None:
        """Starts episodes in the environments of the mask."""
        self._is_first = mask
        if not mask.any():
            return
        self._environments.reset_statistics(mask)
        seeds = [running.seed if running and new else None for running, new in zip(self._running, mask, strict=True)]
        options = {"reset_mask": mask, **self._options(mask)}
        self._observations, infos = self._environments.reset(seed=seeds, options=options)
        self._history.add_reset(self._observations, infos, mask)

    def _options(self, mask: NDArray[np.bool_]) -> dict[str, list[Any]]:
        """Returns the options with which episodes start in the environments of the mask, by name."""
        if not self._resets:
            return {}
        starting = zip(self._running, mask, strict=True)
        each = [self._resets[running.index] if running and new else {} for running, new in starting]
        return {name: [options.get(name) for options in each] for name in {key for options in each for key in options}}

    def _step(self, is_playing: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Makes a control step; returns in which environments the episode has ended, and the physics has diverged."""
        actions = self._controller.act(BatchStep(self._observations, self._rewards, self._is_first, is_playing))
        result = self._environments.step_some(actions, is_playing)
        self._observations, self._rewards, terminations, truncations, infos = result
        diverged = infos.pop("physics_error", np.zeros(len(self._running), bool))
        step = Step(actions, self._rewards, terminations, truncations)
        self._history.add_step(step, self._observations, infos, self._controller.labels)
        self._history.forget_before(min(running.first for running in self._running if running))
        return terminations | truncations, diverged

    def _share(self, seconds: float) -> None:
        """Adds its share of some time to each episode in progress."""
        playing = [running for running in self._running if running]
        for running in playing:
            running.seconds += seconds / len(playing)


class _History:
    """Observations, infos and steps of all environments over time, from the start of the oldest running episode."""

    def __init__(self) -> None:
        # `_rows[t]` holds observations and infos at time `t`; `_steps[t]` leads from there to `_rows[t + 1]`.
        self._rows: collections.deque[dict[str, NDArray]] = collections.deque()
        self._steps: collections.deque[dict[str, NDArray]] = collections.deque()
        self._forgotten = 0

    @property
    def is_empty(self) -> bool:
        """Whether nothing has been added yet."""
        return not self._rows

    @property
    def present(self) -> int:
        """Number of the present time."""
        return self._forgotten + max(len(self._rows) - 1, 0)

    def add_reset(self, observations: Any, infos: Mapping[str, NDArray], mask: NDArray[np.bool_]) -> None:
        """Replaces observations and infos of the present time in the environments of a mask."""
        row = _named(observations, infos)
        if self._rows:
            row = {name: _merged(mask, array, self._rows[-1][name]) for name, array in row.items()}
            self._rows.pop()
        self._rows.append(row)

    def add_step(
        self, step: Step, observations: Any, infos: Mapping[str, NDArray], labels: Mapping[str, NDArray]
    ) -> None:
        """Adds a step with the policies' labels, and the observations and infos after it."""
        self._steps.append({**step._asdict(), **flatten(labels, "label")})
        self._rows.append(_named(observations, infos))

    def forget_before(self, first: int) -> None:
        """Drops everything before time `first`."""
        while self._forgotten < first:
            self._rows.popleft()
            self._steps.popleft()
            self._forgotten += 1

    def rewards(self, i: int, first: int) -> NDArray[np.float64]:
        """Returns the rewards of environment `i` since time `first`."""
        return np.array([step["reward"][i] for step in self._since(first, self._steps)])

    def last_info(self, i: int) -> dict[str, NDArray]:
        """Returns the present infos of environment `i`."""
        return {name.removeprefix("info/"): a[i] for name, a in self._rows[-1].items() if name.startswith("info/")}

    def episode(self, i: int, first: int) -> dict[str, NDArray]:
        """Returns the arrays of environment `i` since time `first`."""
        rows, steps = self._since(first, self._rows), self._since(first, self._steps)
        return {
            **{name: np.stack([row[name][i] for row in rows]) for name in rows[0]},
            **{name: np.stack([step[name][i] for step in steps]) for name in steps[0]},
        }

    def _since(self, first: int, column: collections.deque) -> list:
        return list(itertools.islice(column, first - self._forgotten, None))


def _named(observations: Any, infos: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """Returns observations and infos `(n, ...)` by the names of `EpisodeArrays`: no masks of infos, and no strings."""
    return {**flatten(observations, "observation"), **flatten(_numbers(infos), "info")}


def _numbers(infos: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: _numbers(part) if isinstance(part, Mapping) else part
        for name, part in infos.items()
        if not name.startswith("_") and getattr(part, "dtype", None) != np.dtype(object)
    }


def _spread(values: NDArray, rows: list[int], count: int) -> NDArray:
    """Returns an array of `count` rows with values in some of them, and zeros in the others."""
    spread = np.zeros((count, *values.shape[1:]), values.dtype)
    spread[rows] = values
    return spread


def _merged(mask: NDArray[np.bool_], new: NDArray, old: NDArray) -> NDArray:
    """Returns `new` in the rows of a mask, `old` elsewhere."""
    merged = old.copy()
    merged[mask] = new[mask]
    return merged


def play_many(
    spec: EpisodeSpec, waiting: collections.deque[tuple[int, int]], num_envs: int, num_threads: int | None
) -> Generator[tuple[int, EpisodeArrays | None], None, None]:
    """Yields the number and the arrays of each episode as it ends, None for one whose physics has diverged.

    `waiting` is that of `VectorRollout.play`.
    """
    with contextlib.closing(spec.make_vector_env(num_envs, num_threads)) as environments:
        controller = PolicyController(environments, spec.episode_policies())
        for index, episode in VectorRollout(environments, controller).play(waiting):
            yield index, None if episode.diverged else episode.collect()


class SingleRunner:
    """Plays episodes one after the other; a `workers.worker.EpisodeRunner`."""

    def __init__(self, spec: EpisodeSpec) -> None:
        self._rollout = SingleRollout(spec)
        self._waiting: collections.deque[tuple[int, int]] = collections.deque()

    def run(self, more: Sequence[tuple[int, int]]) -> tuple[int, EpisodeArrays]:
        self._waiting.extend(more)
        index, seed = self._waiting.popleft()
        return index, self._rollout.play(index, seed)


class VectorRunner:
    """Plays many episodes at once; a `workers.worker.EpisodeRunner`."""

    def __init__(self, spec: EpisodeSpec, num_envs: int, num_threads: int) -> None:
        self._waiting: collections.deque[tuple[int, int]] = collections.deque()
        self._episodes = play_many(spec, self._waiting, num_envs, num_threads)

    def run(self, more: Sequence[tuple[int, int]]) -> tuple[int, EpisodeArrays | None]:
        """Returns the next episode to end, None if its physics has diverged."""
        self._waiting.extend(more)
        return next(self._episodes)
