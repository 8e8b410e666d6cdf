"""The loops that play episodes, each from its own seed: one after the other, and many at once."""

import collections
import contextlib
import dataclasses
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

import dm_env
import gymnasium
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.episodes.episode import EpisodeArrays, EpisodeBuffer, Step, Waiting, Watch, flatten
from kitchen_suite.episodes.spec import EpisodePolicies, EpisodeSpec, clipped_action, reset_to_seed, seeded_policies
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies import OBSERVATION, Policy, PolicyBuilder, PolicyError, instruct, labels_of, takes
from kitchen_suite.vector_env.base import SuiteVectorEnv

REWIND_STEPS = 250  # Control steps that an episode can go back.


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
        self._policies = seeded_policies(build_policy) if build_policy else spec.episode_policies()

    def start(self, seed: int, name: str = "", options: Mapping[str, Any] | None = None) -> None:
        """Starts the episode of a seed, with a name for readers; raises a PolicyError if the policy cannot be built."""
        self.options = options
        self.buffer = EpisodeBuffer(*reset_to_seed(self.environment, seed, self._spec.seeding, options), name=name)
        self.policy = self._policies(suite_env(self.environment).environment, seed, options)

    def step(self) -> None:
        """Makes a control step with the policy's action.

        Raises a PhysicsError if the physics diverges, a PolicyError for an exception or a bad action of the policy.
        """
        environment = suite_env(self.environment)
        seen = self.buffer.observation if takes(self.policy) == OBSERVATION else self.buffer.timestep(environment)
        instruct(self.policy, lambda: environment.instruction)
        action = clipped_action(self.policy, seen, self.environment.action_space)
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
    """Acts by a policy of its own in each environment.

    Policies take time steps as the suite's own environment returns them, or observations of the Gymnasium environment;
    see `policies.takes`.
    """

    def __init__(self, environments: SuiteVectorEnv, episode_policies: EpisodePolicies) -> None:
        self._environments, self._episode_policies = environments, episode_policies
        assert isinstance(environments.single_action_space, gymnasium.spaces.Box)
        self._space = environments.single_action_space
        self._policies: dict[int, Policy] = {}
        self.labels: dict[str, NDArray] = {}

    def start(self, i: int, seed: int, options: Mapping[str, Any]) -> None:
        environment = self._environments.template_of(i).environment
        self._policies[i] = self._episode_policies(environment, seed, options)

    def act(self, step: BatchStep) -> NDArray:
        actions = np.zeros((step.rewards.size, *self._space.shape), self._space.dtype)
        playing = np.flatnonzero(step.is_playing).tolist()
        if takes(self._policies[playing[0]]) == OBSERVATION:
            for i in playing:
                actions[i] = self._action(i, _row(step.observations, i))
        else:
            observations = self._environments.present_observation
            for i in playing:
                observation = _row(observations, i)
                first, reward = step.is_first[i], step.rewards[i]
                timestep = dm_env.restart(observation) if first else dm_env.transition(reward, observation)
                actions[i] = self._action(i, timestep)
        each = [labels_of(self._policies[i]) for i in playing]
        labels = {name: np.array([one[name] for one in each]) for name in each[0]}
        # Zeros where no episode is played.
        self.labels = {name: np.zeros((len(actions), *rows.shape[1:]), rows.dtype) for name, rows in labels.items()}
        for name, rows in labels.items():
            self.labels[name][playing] = rows
        return actions

    def _action(self, i: int, seen: Any) -> NDArray:
        instruct(self._policies[i], lambda: self._environments.instruction[i])
        action = clipped_action(self._policies[i], seen, self._space)
        if np.abs(action).max() > np.finfo(self._space.dtype).max:
            raise PolicyError(f"the policy's action does not fit into {self._space.dtype}: {action}")
        return action


def _row(observations: Any, i: int) -> Any:
    """Returns the observation of environment `i`: an array, or nested dicts of arrays."""
    if isinstance(observations, Mapping):
        return {key: _row(part, i) for key, part in observations.items()}
    return observations[i]


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


@dataclasses.dataclass(eq=False, kw_only=True)
class VectorEpisode:
    """An episode in environment `i` of many.

    Attributes:
      rows: observations and infos of all environments after its reset and after each of its `steps`.
      seconds: its share of the time that playing took [s].
      instruction: the task's sentence, once the episode has ended.
      diverged: whether the physics has diverged; the last step has no meaning then, and neither have the last infos.
    """

    i: int
    index: int
    seed: int
    rows: list[dict[str, NDArray]] = dataclasses.field(default_factory=list)
    steps: list[dict[str, NDArray]] = dataclasses.field(default_factory=list)
    seconds: float = 0.0
    instruction: str = ""
    diverged: bool = False

    @property
    def rewards(self) -> NDArray[np.float64]:
        """Rewards `(T,)` of its control steps."""
        return np.array([step["reward"][self.i] for step in self.steps])

    @property
    def last_info(self) -> dict[str, NDArray]:
        last = self.rows[-1].items()
        return {name.removeprefix("info/"): rows[self.i] for name, rows in last if name.startswith("info/")}

    def collect(self) -> EpisodeArrays:
        arrays = {
            **{name: np.stack([row[name][self.i] for row in self.rows]) for name in self.rows[0]},
            **{name: np.stack([step[name][self.i] for step in self.steps]) for name in self.steps[0]},
        }
        shared = {name: getattr(self, name) for name in ("index", "seed", "seconds", "instruction")}
        return EpisodeArrays(arrays=arrays, **shared)


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
        self._running: list[VectorEpisode | None] = [None] * count
        self._observations: Any = None  # After the last step or reset.
        self._rewards, self._is_first = np.zeros(count), np.zeros(count, bool)

    def play(self, waiting: Waiting) -> Iterator[tuple[int, VectorEpisode]]:
        """Yields the number of each episode as it ends, and the episode; more may be `waiting` in the meantime."""
        needs_reset = np.full(len(self._running), True)
        while True:
            if waiting:
                needs_reset |= [episode is None for episode in self._running]
            for i in np.flatnonzero(needs_reset).tolist():
                self._running[i] = None
                if waiting:
                    index, seed = waiting.popleft()
                    self._controller.start(i, seed, self._resets[index] if self._resets else {})
                    self._running[i] = VectorEpisode(i=i, index=index, seed=seed)
            playing = [episode for episode in self._running if episode]
            if not playing:
                return
            started = time.perf_counter()
            is_playing = np.array([episode is not None for episode in self._running])
            # The first reset has to be of all environments; later, those without an episode to play are left out.
            self._reset(needs_reset if self._observations is None else needs_reset & is_playing)
            needs_reset = self._step(playing, is_playing)
            seconds = (time.perf_counter() - started) / len(playing)
            for episode in playing:
                episode.seconds += seconds
            for episode in playing:
                if needs_reset[episode.i]:
                    episode.instruction = self._environments.instruction[episode.i]
                    yield episode.index, episode

    def _reset(self, mask: NDArray[np.bool_]) -> None:
        """Starts the episodes in the environments of a mask."""
        self._is_first = mask
        if not mask.any():
            return
        starting = [episode if new else None for episode, new in zip(self._running, mask, strict=True)]
        self._environments.reset_statistics(mask)
        seeds = [episode.seed if episode else None for episode in starting]
        each = [self._resets[episode.index] if episode and self._resets else {} for episode in starting]
        names = {name for chosen in each for name in chosen}
        options = {"reset_mask": mask, **{name: [chosen.get(name) for chosen in each] for name in names}}
        self._observations, infos = self._environments.reset(seed=seeds, options=options)
        row = _named(self._observations, infos)
        for episode in filter(None, starting):
            episode.rows.append(row)

    def _step(self, playing: Sequence[VectorEpisode], is_playing: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Makes a control step; returns in which environments the episode has ended."""
        actions = self._controller.act(BatchStep(self._observations, self._rewards, self._is_first, is_playing))
        result = self._environments.step_some(actions, is_playing)
        self._observations, self._rewards, terminations, truncations, infos = result
        diverged = infos.pop("physics_error", np.zeros(is_playing.size, bool))
        named = Step(actions, self._rewards, terminations, truncations)._asdict()
        step = {**named, **flatten(self._controller.labels, "label")}
        row = _named(self._observations, infos)
        for episode in playing:
            episode.steps.append(step)
            episode.rows.append(row)
            episode.diverged = bool(diverged[episode.i])
        return terminations | truncations


def _named(observations: Any, infos: Mapping[str, NDArray]) -> dict[str, NDArray]:
    """Returns observations and infos `(n, ...)` by the names of `EpisodeArrays`: no masks of infos, and no strings."""
    return {**flatten(observations, "observation"), **flatten(_numbers(infos), "info")}


def _numbers(infos: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: _numbers(part) if isinstance(part, Mapping) else part
        for name, part in infos.items()
        if not name.startswith("_") and getattr(part, "dtype", None) != np.dtype(object)
    }


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
