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
from kitchen_suite.policies import Policy, PolicyBuilder, PolicyError, instruct, labels_of
from kitchen_suite.rollouts.episode import EpisodeArrays, EpisodeBuffer, Step, Waiting, Watch, flatten
from kitchen_suite.rollouts.spec import EpisodePolicies, EpisodeSpec, SeededPolicies, clipped_action, reset_to_seed
from kitchen_suite.vector_env.base import SuiteVectorEnv

# Control steps that an episode can go back.
REWIND_STEPS = 250


def episode_name(index: int, seed: int | None) -> str:
    """Returns the name of the episode of a number and a seed, if that is known."""
    return f"episode {index}" + ("" if seed is None else f", seed {seed}")


class SingleRollout:
    """Plays the episodes of a specification one by one; each depends on nothing but its seed.

    Of the episode in progress, `buffer` has the steps, `options` are those of its reset, and `policy` is its policy.
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
        """Starts the episode of a seed, with a name for readers; raises a PolicyError if the policy cannot be built."""
        self.options = options
        self.buffer = EpisodeBuffer(*reset_to_seed(self.environment, seed, self._spec.seeding, options), name=name)
        self.policy = self._policies.start(suite_env(self.environment).environment, seed, options)

    def step(self) -> None:
        """Makes a control step with the policy's action.

        Raises a PhysicsError if the physics diverges, a PolicyError for an exception or a bad action of the policy.
        """
        environment = suite_env(self.environment)
        timestep = self.buffer.timestep(environment)
        instruct(self.policy, lambda: environment.instruction)
        action = clipped_action(self.policy, timestep, self.environment.action_space)
        self.repeat(action, labels_of(self.policy))

    def repeat(self, action: NDArray, labels: Mapping[str, Any]) -> None:
        self.buffer.step(self.environment, action, labels)

    def play(
        self, index: int, seed: int, watch: Watch = lambda buffer: None, options: Mapping[str, Any] | None = None
    ) -> EpisodeArrays:
        """Plays an episode; `watch` is called after the reset and after every step."""
        started = time.perf_counter()
        self.start(seed, episode_name(index, seed), options)
        watch(self.buffer)
        while not self.buffer.has_ended:
            self.step()
            watch(self.buffer)
        return self.buffer.episode(self.environment, index, seed, time.perf_counter() - started)


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
        playing = np.flatnonzero(step.is_playing).tolist()
        for i in playing:
            actions[i] = self._action(i, step, {key: array[i] for key, array in observations.items()})
        each = [labels_of(self._policies[i]) for i in playing]
        labels = {name: np.array([one[name] for one in each]) for name in each[0]}
        self.labels = {name: _spread(values, playing, step.is_playing.size) for name, values in labels.items()}
        return actions

    def _action(self, i: int, step: BatchStep, observation: dict[str, NDArray]) -> NDArray:
        timestep = dm_env.restart(observation) if step.is_first[i] else dm_env.transition(step.rewards[i], observation)
        instruct(self._policies[i], lambda: self._environments.instruction[i])
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

    `first` is the number of the time of its reset in the history, `seconds` its share of the time that playing took.
    """

    index: int
    seed: int
    first: int
    seconds: float = 0.0


class EndedEpisode:
    """An episode that has just ended in environment `i`, to be read before `VectorRollout.play` yields the next one.

    If its physics has `diverged`, its last step has no meaning, and neither have the last infos.
    """

    def __init__(self, history: "_History", i: int, running: _Running, instruction: str, diverged: bool) -> None:
        self.i, self.diverged = i, diverged
        self._rows, self._steps = history.since(running.first)
        self._running, self._instruction = running, instruction

    @property
    def rewards(self) -> NDArray[np.float64]:
        """Rewards `(T,)` of its control steps."""
        return np.array([step["reward"][self.i] for step in self._steps])

    @property
    def last_info(self) -> dict[str, NDArray]:
        last = self._rows[-1].items()
        return {name.removeprefix("info/"): rows[self.i] for name, rows in last if name.startswith("info/")}

    def collect(self) -> EpisodeArrays:
        i, running = self.i, self._running
        arrays = {
            **{name: np.stack([row[name][i] for row in self._rows]) for name in self._rows[0]},
            **{name: np.stack([step[name][i] for step in self._steps]) for name in self._steps[0]},
        }
        return EpisodeArrays(
            index=running.index,
            seed=running.seed,
            arrays=arrays,
            seconds=running.seconds,
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

    def play(self, waiting: Waiting) -> Iterator[tuple[int, EndedEpisode]]:
        """Yields the number of each episode as it ends, and the episode; more may be `waiting` in the meantime."""
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

    def _next(self, i: int, waiting: Waiting) -> _Running | None:
        if not waiting:
            return None
        index, seed = waiting.popleft()
        self._controller.start(i, seed, self._resets[index] if self._resets else {})
        return _Running(index, seed, self._history.present)

    def _reset(self, mask: NDArray[np.bool_]) -> None:
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
        return not self._rows

    @property
    def present(self) -> int:
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
        self._steps.append({**step._asdict(), **flatten(labels, "label")})
        self._rows.append(_named(observations, infos))

    def forget_before(self, first: int) -> None:
        while self._forgotten < first:
            self._rows.popleft()
            self._steps.popleft()
            self._forgotten += 1

    def since(self, first: int) -> tuple[list[dict[str, NDArray]], list[dict[str, NDArray]]]:
        skipped = first - self._forgotten
        return [*itertools.islice(self._rows, skipped, None)], [*itertools.islice(self._steps, skipped, None)]


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
    spec: EpisodeSpec, waiting: Waiting, num_envs: int, num_threads: int | None
) -> Generator[tuple[int, EpisodeArrays | None], None, None]:
    """Yields what `VectorRollout.play` does, with the arrays of an episode; None if its physics has diverged."""
    with contextlib.closing(spec.make_vector_env(num_envs, num_threads)) as environments:
        controller = PolicyController(environments, spec.episode_policies())
        for index, episode in VectorRollout(environments, controller).play(waiting):
            yield index, None if episode.diverged else episode.collect()


class SingleRunner:
    """Plays episodes one after the other; a `workers.pool.EpisodeRunner`."""

    def __init__(self, spec: EpisodeSpec) -> None:
        self._rollout, self._waiting = SingleRollout(spec), Waiting()

    def run(self, more: Sequence[tuple[int, int]]) -> tuple[int, EpisodeArrays]:
        self._waiting.extend(more)
        index, seed = self._waiting.popleft()
        return index, self._rollout.play(index, seed)


class VectorRunner:
    """Plays many episodes at once; a `workers.pool.EpisodeRunner`."""

    def __init__(self, spec: EpisodeSpec, num_envs: int, num_threads: int) -> None:
        self._waiting = Waiting()
        self._episodes = play_many(spec, self._waiting, num_envs, num_threads)

    def run(self, more: Sequence[tuple[int, int]]) -> tuple[int, EpisodeArrays | None]:
        self._waiting.extend(more)
        return next(self._episodes)
