"""The loops that play episodes, each from its own seed: one after the other, and many at once."""

import collections
import contextlib
import dataclasses
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

import dm_env
import gymnasium
import numpy as np
from numpy.typing import DTypeLike, NDArray

from kitchen_suite import checks
from kitchen_suite.episodes.cluster import Cluster
from kitchen_suite.episodes.episode import (
    PHYSICS_STATE,
    Episode,
    EpisodeBuffer,
    NamedArrays,
    Step,
    Waiting,
    Watch,
    flatten,
    ignore,
)
from kitchen_suite.episodes.spec import EnvironmentSpec, EpisodeSpec, even_count, policy_generator, reset_to_seed
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies import (
    BATCH,
    OBSERVATION,
    TIMESTEP,
    Policy,
    PolicyBuilder,
    PolicyError,
    PolicyRef,
    instruct,
    labels_of,
    takes_of,
)
from kitchen_suite.policies.memory import described, reset_rows
from kitchen_suite.tasks.task import SuiteTask
from kitchen_suite.vector_env.base import SuiteVectorEnv

REWIND_STEPS = 250  # Control steps that an episode can go back.


def episode_name(index: int, seed: int | None) -> str:
    """Returns the name of the episode of a number and a seed, if that is known."""
    return f"episode {index}" + ("" if seed is None else f", seed {seed}")


def act_within(policy: Policy, given: Any, space: gymnasium.Space) -> NDArray:
    """Calls a policy; returns its action within the bounds of the space, so that the recorded one is the applied one.

    Args:
      policy: the policy.
      given: what it is called with; see `policies.takes_of`.
      space: of the actions.
    """
    assert isinstance(space, gymnasium.spaces.Box)
    return checks.array_of(policy(given), "action").clip(space.low, space.high)


class SingleRollout:
    """Plays the episodes of a specification one by one; each depends on nothing but its seed.

    Of the episode in progress, `buffer` has the steps, `options` are those of its reset, and `policy` is its policy.
    """

    buffer: EpisodeBuffer
    options: Mapping[str, Any] | None
    policy: Policy

    def __init__(
        self, spec: EpisodeSpec, build_policy: PolicyBuilder, *, action_dtype: DTypeLike | None = None, **extra: Any
    ) -> None:
        """Makes the environment.

        Args:
          spec: of the episodes.
          build_policy: builds the policy of each episode.
          action_dtype: type that actions are rounded to, as `play` and recordings do to that of the action space; they
            are left as the policy returns them when None.
          **extra: additional arguments of the environment.
        """
        self._spec = spec
        self._action_dtype = action_dtype
        self._build_policy = build_policy
        self.environment = spec.make_environment(**extra)

    def start(self, seed: int, name: str = "", options: Mapping[str, Any] | None = None) -> None:
        """Starts the episode of a seed, with a name for readers; raises a PolicyError if the policy cannot be built."""
        self.options = options
        environment = suite_env(self.environment)
        observation, info = reset_to_seed(self.environment, seed, self._spec.seeding, options)
        self.buffer = EpisodeBuffer(observation, info, environment.physics_state, name)
        self.policy = self._build_policy(environment.environment, policy_generator(seed))
        if takes_of(self.policy) == BATCH:
            raise PolicyError("a policy of a batch acts in vectorised environments alone")

    def step(self) -> None:
        """Makes a control step with the policy's action.

        Raises a PhysicsError if the physics diverges, a PolicyError for an exception or a bad action of the policy.
        """
        environment = suite_env(self.environment)
        seen = self.buffer.observation if takes_of(self.policy) == OBSERVATION else self.buffer.timestep(environment)
        instruct(self.policy, lambda: environment.instruction)
        action = act_within(self.policy, seen, self.environment.action_space)
        if self._action_dtype is not None:
            action = action.astype(self._action_dtype)
        self.repeat(action, labels_of(self.policy))

    def repeat(self, action: NDArray, labels: Mapping[str, Any]) -> None:
        self.buffer.step(self.environment, action, labels)

    def play(self, index: int, seed: int, watch: Watch = ignore, options: Mapping[str, Any] | None = None) -> Episode:
        """Plays an episode; `watch` is called after the reset and after every step."""
        started = time.perf_counter()
        environment = suite_env(self.environment).environment
        self.start(seed, episode_name(index, seed), options)
        watch(self.buffer, environment)
        while not self.buffer.has_ended:
            self.step()
            watch(self.buffer, environment)
        return self.buffer.episode(self.environment, index, seed, time.perf_counter() - started)


class RewindableRollout(SingleRollout):
    """Also goes back to earlier control steps of an episode, and on from there in another way.

    What is left of the episode afterwards is to the bit what it would be if it had never gone otherwise.
    """

    def __init__(self, spec: EpisodeSpec, build_policy: PolicyBuilder, **extra: Any) -> None:
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
    """Chooses the actions of all environments.

    Attributes:
      is_batched: whether the actions of all environments are one answer of a policy, or each is one of its own.
    """

    @property
    def is_batched(self) -> bool: ...

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
    see `policies.takes_of`.
    """

    is_batched = False

    def __init__(self, environments: SuiteVectorEnv, build_policy: PolicyBuilder) -> None:
        self._environments = environments
        self._build_policy = build_policy
        assert isinstance(environments.single_action_space, gymnasium.spaces.Box)
        self._space = environments.single_action_space
        self._policies: dict[int, Policy] = {}
        self._label_names: set[str] | None = None
        self.labels: dict[str, NDArray] = {}

    def start(self, i: int, seed: int, options: Mapping[str, Any]) -> None:
        environment = self._environments.template_of(i).environment
        self._policies[i] = self._build_policy(environment, policy_generator(seed), row=i)

    def act(self, step: BatchStep) -> NDArray:
        actions = np.zeros((step.rewards.size, *self._space.shape), self._space.dtype)
        playing = np.flatnonzero(step.is_playing).tolist()
        if takes_of(self._policies[playing[0]]) == OBSERVATION:
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
        names = {*each[0]} if self._label_names is None else self._label_names
        self._label_names = names
        if odd := sorted({name for one in each for name in names ^ one.keys()}):
            raise PolicyError(f"a policy has labels {odd} of some actions alone")
        labels = {name: np.array([one[name] for one in each]) for name in each[0]}
        # Zeros where no episode is played.
        self.labels = {name: np.zeros((len(actions), *rows.shape[1:]), rows.dtype) for name, rows in labels.items()}
        for name, rows in labels.items():
            self.labels[name][playing] = rows
        return actions

    def _action(self, i: int, seen: Any) -> NDArray:
        instruct(self._policies[i], lambda: self._environments.instruction[i])
        action = act_within(self._policies[i], seen, self._space)
        if np.abs(action).max() > np.finfo(self._space.dtype).max:
            raise PolicyError(f"the policy's action does not fit into {self._space.dtype}: {action}")
        return action


def _row(observations: Any, i: int) -> Any:
    """Returns the observation of environment `i`: an array, or nested dicts of arrays."""
    if isinstance(observations, Mapping):
        return {key: _row(part, i) for key, part in observations.items()}
    return observations[i]


@dataclasses.dataclass(eq=False, kw_only=True)
class VectorEpisode:
    """An episode in environment `i` of many.

    Attributes:
      rows: observations, infos and physics states of all environments after its reset and after each of its `steps`.
      seconds: its share of the time that playing took [s].
      instruction: the task's sentence, once the episode has ended.
      diverged: whether the physics has diverged; the last step has no meaning then, and neither have the last infos.
    """

    i: int
    index: int
    seed: int
    rows: list[dict[str, Sequence[NDArray]]] = dataclasses.field(default_factory=list)
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

    @property
    def steps_to_success(self) -> int | None:
        """The control step at which the infos first call it a success, 0 for the reset; None if they never do."""
        successes = (bool(row["info/is_success"][self.i]) for row in self.rows)
        return next((step for step, success in enumerate(successes) if success), None)

    def collect(self, task: SuiteTask) -> Episode:
        """Returns the episode, with the metrics of its task."""
        arrays = {
            **{name: np.stack([row[name][self.i] for row in self.rows]) for name in self.rows[0]},
            **{name: np.stack([step[name][self.i] for step in self.steps]) for name in self.steps[0]},
        }
        return Episode(
            index=self.index,
            seed=self.seed,
            arrays=NamedArrays(arrays),
            seconds=self.seconds,
            instruction=self.instruction,
            metrics={} if self.diverged else task.records.metrics(self.last_info),
            diverged=self.diverged,
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
        row = self._row(infos)
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
        row = self._row(infos)
        for episode in playing:
            episode.steps.append(step)
            episode.rows.append(row)
            episode.diverged = bool(diverged[episode.i])
        return terminations | truncations

    def _row(self, infos: Mapping[str, NDArray]) -> dict[str, Sequence[NDArray]]:
        """Returns the present observations, infos and physics states of all environments by the names of episodes.

        There are no masks of infos, and no strings.
        """
        observations, numbers = flatten(self._observations, "observation"), flatten(_numbers(infos), "info")
        return {**observations, **numbers, PHYSICS_STATE: self._environments.physics_state}


def _numbers(infos: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: _numbers(part) if isinstance(part, Mapping) else part
        for name, part in infos.items()
        if not name.startswith("_") and getattr(part, "dtype", None) != np.dtype(object)
    }


class _BatchController:
    """Acts by a policy of the observations of all environments, whose actions are checked and clipped.

    A policy with a memory is told before each call which rows begin an episode.
    """

    is_batched = True
    labels: Mapping[str, NDArray] = MappingProxyType({})

    def __init__(self, policy: PolicyRef, environments: SuiteVectorEnv) -> None:
        """Takes a policy that takes a batch."""
        assert isinstance(environments.action_space, gymnasium.spaces.Box)
        self._text = policy.text
        self._policy = policy.batch_policy()
        self._beginning: list[int] = []  # Rows that begin an episode with the next action.
        self._space = environments.action_space
        self._mode = environments.composer_task.mdp.action_mode.name

    def start(self, i: int, seed: int, options: Mapping[str, Any]) -> None:
        self._beginning.append(i)

    def act(self, step: BatchStep) -> NDArray:
        if self._beginning:
            reset_rows(self._policy, np.array(self._beginning), f"policy {self._text}")
            self._beginning = []
        try:
            given = self._policy(step.observations)
        except (Exception, SystemExit) as error:
            raise PolicyError(f"policy {self._text} raised {described(error)}") from error
        try:
            actions = checks.array_of(given, "actions")
        except Exception as error:  # Of `__array__` as well, such as that of a tensor that requires a gradient.
            raise PolicyError(f"policy {self._text} returned bad actions: {error}") from error
        if actions.shape != self._space.shape or actions.dtype.kind not in "fiu":
            found = f"{actions.dtype} of shape {actions.shape}"
            wanted = f"numbers of shape {self._space.shape}, of control_mode {self._mode!r}"
            raise PolicyError(f"policy {self._text} returned {found}, not {wanted}")
        # Rows without an episode are not looked at.
        if not np.isfinite(actions[step.is_playing]).all():
            raise PolicyError(f"policy {self._text} returned actions that are not finite")
        return np.nan_to_num(actions).clip(self._space.low, self._space.high).astype(self._space.dtype)


def make_controller(spec: EpisodeSpec, policy: PolicyRef, environments: SuiteVectorEnv) -> Controller:
    """Returns what acts by a policy in vectorised environments of a specification."""
    if policy.takes == BATCH:
        return _BatchController(policy, environments)
    return PolicyController(environments, policy.builder(spec.policy_sha256))


def play_many(
    spec: EpisodeSpec, policy: PolicyRef, waiting: Waiting, num_envs: int, num_threads: int | None = None
) -> Generator[Episode, None, None]:
    """Yields each of the `waiting` episodes as it ends, of environments that are stepped together."""
    with contextlib.closing(spec.make_vector_env(num_envs, num_threads)) as environments:
        controller = make_controller(spec, policy, environments)
        for _, episode in VectorRollout(environments, controller).play(waiting):
            yield episode.collect(environments.composer_task)


def play(
    spec: EnvironmentSpec,
    policy: str | Path | PolicyRef | Callable[..., Any],
    seeds: Iterable[int],
    *,
    takes: str = TIMESTEP,
    num_envs: int = 1,
    num_threads: int | None = None,
    cluster: Cluster | None = None,
) -> Generator[Episode, None, None]:
    """Plays an episode for each seed, and yields it as it ends.

    An episode is that of `env.reset(seed=seed)` in a new Gymnasium environment, with actions of its action space's
    type. It depends neither on the other episodes nor on how many are played at once: the policy of each is built anew,
    with random numbers of its own. A custom policy with a memory is given by a factory or has a method `reset`, as
    `kitchen_suite.policies.memory` describes; another callable is the same object in every episode.

    Args:
      spec: of the environments, with the extra observables that the policy needs.
      policy: a name such as `expert(speed=0.8)`, the path of a trained policy, the address of a server, or a callable,
        a policy or a factory of policies; see `PolicyRef.of`.
      seeds: of the episodes.
      takes: what a policy that is a callable is called with: `timestep`, `observation` or `batch`.
      num_envs: greatest number of environments that are stepped together; fewer, where all can then play to the end.
      num_threads: number of threads that step them; when None one per processor, and one in the workers of a cluster.
      cluster: Ray workers that play the episodes, `num_envs` at a time in each; this process when None.

    Yields:
      The episodes in the order in which they end; `index` is the place of its seed. An episode in which the physics
      diverged is `diverged`.

    Raises:
      PolicyError: the policy cannot be built, raises an exception, or returns a bad action.
      ValueError: an argument is not valid.
    """
    reference = PolicyRef.of(policy, takes)
    numbers = [(index, checks.integer(seed, "seed", minimum=0)) for index, seed in enumerate(seeds)]
    if not numbers:
        return
    episodes = spec.episodes(reference, seed=numbers[0][1])
    yield from play_numbered(episodes, reference, numbers, num_envs=num_envs, num_threads=num_threads, cluster=cluster)


def play_numbered(
    spec: EpisodeSpec,
    policy: PolicyRef,
    numbers: Sequence[tuple[int, int]],
    *,
    num_envs: int,
    num_threads: int | None,
    cluster: Cluster | None,
) -> Generator[Episode, None, None]:
    """Plays the episodes of numbers and seeds as `play` does."""
    checks.integer(num_envs, "num_envs", minimum=1, maximum=checks.MAX_ENVS)
    if not numbers:
        return
    if cluster is None:
        yield from play_many(spec, policy, Waiting(numbers), even_count(len(numbers), num_envs), num_threads)
        return
    arguments = (spec, policy, num_envs, num_threads or 1)
    for episode in cluster.run(play_part, arguments, numbers, num_threads=num_threads or 1):
        yield dataclasses.replace(episode, seconds=episode.seconds / cluster.workers)


def play_part(
    numbers: Sequence[tuple[int, int]], spec: EpisodeSpec, policy: PolicyRef, num_envs: int, num_threads: int
) -> list[Episode]:
    """Plays some episodes in a process of a cluster."""
    return [*play_many(spec, policy, Waiting(numbers), even_count(len(numbers), num_envs), num_threads)]


def play_singly(numbers: Sequence[tuple[int, int]], spec: EpisodeSpec, policy: PolicyRef) -> list[Episode]:
    """Plays some episodes one after the other, with float64 actions, in a process of a cluster."""
    rollout = SingleRollout(spec, policy.sequential_builder(spec.policy_sha256))
    with contextlib.closing(rollout.environment):
        return [rollout.play(index, seed) for index, seed in numbers]
