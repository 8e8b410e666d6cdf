"""The base of the suite's vectorised environments: many episodes in one call of MuJoCo's batched stepping."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import contextlib
import copy
import itertools
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, ClassVar, cast

import gymnasium
import numpy as np
import tree
from dm_control import composer
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.closing import closed_on_error
from kitchen_suite.environment.seeds import EpisodeSeeds
from kitchen_suite.gymnasium_env.base import INSTRUCTION, RESET_MASK, STATE, SuiteEnv
from kitchen_suite.gymnasium_env.observations import Present
from kitchen_suite.rendering.cameras import CameraParameters
from kitchen_suite.tasks.requests import VARIATION, VARIATION_VALUES
from kitchen_suite.vector_env import arguments as vector_arguments
from kitchen_suite.vector_env import infos as info_arrays
from kitchen_suite.vector_env.episodes import BatchEpisodes, BatchPictures
from kitchen_suite.vector_env.gymnasium_names import GymnasiumNames

# What a control step returns; see `SuiteVectorEnv.step`.
StepResult = tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]

# Attributes of the single environment that depend on what an episode asks for.
_WORDS = ("instruction", "instructions", "task", "task_description")

# Attributes of the single environment that are the same throughout an episode. LeRobot reads `_max_episode_steps`,
# `task` and `task_description`.
SHARED_ATTRIBUTES = (
    *_WORDS,
    "action_space",
    "max_episode_steps",
    "metadata",
    "observation_space",
    "render_mode",
    "_max_episode_steps",
    "variation_space",
    "variation_split",
)

# Attributes of the vector that stand for those of its single environments.
_OF_THE_VECTOR = ("np_random", "np_random_seed", "spec")

# Methods of the single environment that depend on no episode; only goal environments have them.
SHARED_METHODS = ("compute_reward", "compute_terminated", "compute_truncated")


class SuiteVectorEnv(GymnasiumNames, gymnasium.vector.VectorEnv):
    """A vector of environments, each equal to the single environment: the same numbers for the same seed and actions.

    A single environment, the template, starts every episode; its state is then copied to a batch of simulations. The
    batch steps them on several threads. Where environments differ, each starts from one of several templates, and there
    is a batch for each of these. Everything else is computed by the task's MDP, on arrays with a leading axis.

    Infos are arrays with a leading axis, and a mask `_key` for each `key`, as Gymnasium's are. If a simulation
    diverges, its episode terminates with reward 0: the step counts for nothing, so that the last observation and infos
    are those of the step before. The infos then have a mask `physics_error`.

    Attributes:
      autoreset_mode: when an environment whose episode has ended starts the next one; also in `metadata`.
    """

    # Class of the single environment.
    env_class: ClassVar[type[SuiteEnv]] = SuiteEnv

    # There is nothing to close before it is built: Gymnasium 1.2 closes what is deleted, also what could not be built.
    closed = True

    def __init__(
        self,
        num_envs: int = 1,
        *,
        num_threads: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        episode_seeds: bool | int = False,
        **settings: Any,
    ) -> None:
        """Builds the environments; a bad argument raises a TypeError or ValueError that names it.

        Args:
          num_envs: number of environments.
          num_threads: number of threads that step them, including the calling one; by default one per processor.
          autoreset_mode: when an environment whose episode has ended starts the next one: `NextStep`, `SameStep`, or
            `Disabled` for a call of `reset` with a `reset_mask`; see docs/guide/vector.md.
          max_episode_steps: control steps after which an episode truncates; never when omitted or -1.
          episode_seeds: whether each episode has a seed of its own, which `np_random_seed` names: the `k`-th one of
            environment `i`, after `reset(seed=s)`, has the seed `s + i + k * num_envs`, so that no two are equal. A
            number is the distance between the seeds of successive episodes, in place of `num_envs`.
          **settings: arguments of the single environment; docs/guide/arguments.md lists those of each domain.
        """
        self.num_envs = checks.integer(num_envs, "num_envs", minimum=1, maximum=checks.MAX_ENVS)
        seeds = EpisodeSeeds(episode_seeds, true=self.num_envs)
        threads = processors() if num_threads is None else num_threads
        checks.integer(threads, "num_threads", minimum=1, maximum=checks.MAX_THREADS)
        modes = [mode.value for mode in AutoresetMode]
        name = autoreset_mode.value if isinstance(autoreset_mode, AutoresetMode) else autoreset_mode
        self.autoreset_mode = AutoresetMode(checks.choice(name, modes, "autoreset_mode"))
        if settings.get("render_mode") == "human":
            raise ValueError("render_mode 'human' shows one environment; use 'rgb_array' or 'depth_array'")
        # Gymnasium's `make` accepts -1 for no limit.
        limit = None if max_episode_steps == -1 else max_episode_steps
        self._step_limit = np.iinfo(np.int64).max if limit is None else limit
        self._templates = self._make_templates(max_episode_steps=limit, **settings)
        with closed_on_error(dict.fromkeys(self._templates)):
            self._build(threads, seeds)
        self.closed = False

    def _build(self, threads: int, seeds: EpisodeSeeds) -> None:
        """Builds the environments of the single ones; for the arguments see `BatchEpisodes`."""
        for template in dict.fromkeys(self._templates):
            check_entities(template)
            template.reset()
        self._template_env = self._templates[0]
        self._task = self._template_env.composer_task
        self._mdp = self._task.mdp
        self._observations = self._template_env.observations
        self.render_mode = self._template_env.render_mode
        self.metadata = {**self._template_env.metadata, "autoreset_mode": self.autoreset_mode}
        self.single_action_space = self._template_env.action_space
        self.single_observation_space = self._template_env.observation_space
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        environments = [self.template_of(i).environment for i in range(self.num_envs)]
        self._tasks = [environment.task for environment in environments]
        self._episodes = BatchEpisodes(environments, threads, seeds)
        self._pictures = BatchPictures(environments, self._episodes)
        self._ended = np.zeros(self.num_envs, bool)
        self._everyone, self._no_one = np.full(self.num_envs, True), np.full(self.num_envs, False)
        self._needs_reset = True
        self._process = os.getpid()

    def _make_templates(self, **settings: Any) -> Sequence[SuiteEnv]:
        """Returns the single environments that start the episodes, in turn those of environments 0, 1, ..."""
        return (self.env_class(**settings),)

    def __repr__(self) -> str:
        env_id = f"{self.spec.id}, " if self.spec else ""
        return f"{type(self).__name__}({env_id}{self._task!r}, num_envs={self.num_envs})"

    @property
    def template_env(self) -> SuiteEnv:
        """The single environment that starts the episodes, or the first of several; not to be stepped."""
        return self._template_env

    def template_of(self, i: int) -> SuiteEnv:
        """Returns the single environment that starts the episodes of environment `i`; not to be stepped."""
        return self._templates[i % len(self._templates)]

    @property
    def composer_task(self) -> Any:
        """The task of that environment."""
        return self._task

    @property
    def instruction(self) -> tuple[str, ...]:
        """The sentence of each environment's task."""
        self._check_open()
        return self._each("instruction")

    @property
    def variation_space(self) -> spaces.Dict:
        """Ranges of the parameters that vary in a single environment, by name; empty if nothing varies."""
        return self._template_env.variation_space

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Returns an attribute of every single environment, as Gymnasium's own vectors do.

        Raises:
          AttributeError: the attribute is none of `SHARED_ATTRIBUTES`, `np_random`, `np_random_seed` and `spec`.
          TypeError: the name is no string.
        """
        try:
            checks.choice(name, (*SHARED_ATTRIBUTES, *_OF_THE_VECTOR), "attribute")
        except ValueError as error:
            # As Gymnasium's vectors do, so that callers can ask whether an attribute exists.
            raise AttributeError(
                f"{error}. The environments are simulated together, so that infos and `present_observation` hold what "
                "differs between them. Gymnasium's own vector has the attributes and methods of each single "
                "environment: gymnasium.make_vec(id, num_envs, vectorization_mode='sync')"
            ) from error
        if name == "spec":
            return (self._single_spec,) * self.num_envs
        return getattr(self, name) if name in _OF_THE_VECTOR else self._each(name)

    @property
    def _single_spec(self) -> EnvSpec | None:
        """Gymnasium's record of a single environment, with the limit of control steps that applies."""
        spec = copy.copy(self.spec)
        if spec is not None:
            # `make_vec` leaves there the limit of the id, whichever it is given.
            spec.max_episode_steps = self._template_env.max_episode_steps
        return spec

    def _each(self, name: str) -> tuple[Any, ...]:
        """Returns one of `SHARED_ATTRIBUTES` of every single environment."""
        if name in _WORDS and (each := self._instructions_of_episodes()) is not None:
            return tuple(each if name == "instructions" else (next(iter(sentences), "") for sentences in each))
        values = [getattr(template, name) for template in self._templates]
        return tuple(itertools.islice(itertools.cycle(values), self.num_envs))

    def _instructions_of_episodes(self) -> Sequence[tuple[str, ...]] | None:
        """Returns the instructions of each environment where they depend on the episode; None where they do not."""
        return None

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Returns the results of a method of every single environment, or an attribute, as Gymnasium's vectors do.

        Args:
          name: `render`, one of `SHARED_METHODS`, or an attribute as for `get_attr`, which LeRobot calls. Other methods
            would act in one environment, which no client can step alone.
          *args: arguments of the method, the same for all environments.
          **kwargs: its keyword arguments.

        Raises:
          AttributeError: there is no such attribute or method, or it cannot be called.
          TypeError: there are arguments for an attribute.
        """
        if name == "render":
            return self.render() or (None,) * self.num_envs
        if name in SHARED_METHODS:
            return (getattr(self._template_env, name)(*args, **kwargs),) * self.num_envs
        values = self.get_attr(name)
        if args or kwargs:
            raise TypeError(f"{name!r} is an attribute, which takes no arguments, got {checks.shown((args, kwargs))}")
        return values

    def reset_statistics(self, mask: NDArray[np.bool_] | None = None, *, total_steps: int = 0) -> None:
        """Resets what environments keep from one episode to the next; see `SuiteTask.reset_statistics`.

        Args:
          mask: environments `(n,)` that begin a run; all when omitted.
          total_steps: control steps that each has made before, where a run continues.
        """
        self._check_open()
        self._episodes.reset_statistics(mask, total_steps)

    def _get_obs(self) -> Any:
        """Returns the observations of all environments, in fresh arrays."""
        return self._observations(self._present(self._pictures.take()))

    @property
    def present_observation(self) -> dict[str, NDArray]:
        """The present observations as the suite's own, whatever the observation type, with a leading axis."""
        self._check_open()
        return self._observations.suite_observation(self._present(self._pictures.take()))

    @property
    def present_numbers(self) -> dict[str, NDArray]:
        """The present observations without pictures, which are not rendered; otherwise as `present_observation`."""
        self._check_open()
        return self._observations.suite_numbers(self._present({}))

    @property
    def present_success(self) -> NDArray[np.bool_]:
        """Whether all that each environment's episode asks for holds now `(n,)`, not only at some step before."""
        self._check_open()
        return self._episodes.succeeds()

    @property
    def physics_state(self) -> tuple[NDArray[np.float64], ...]:
        """The present physics state of each environment, as `SuiteEnv.physics_state`; sizes depend on the model."""
        self._check_open()
        return self._episodes.physics_state()

    def camera_parameters(self, camera: str, width: int, height: int) -> CameraParameters:
        """Returns the parameters of a camera in all environments, those of `SuiteEnv`, with a leading axis."""
        self._check_process()
        self._check_episodes(self._no_one)
        each = []
        for i in range(self.num_envs):
            self._episodes.show(i)
            each.append(self.template_of(i).camera_parameters(camera, width, height))
        return CameraParameters(*map(np.stack, zip(*each, strict=True)))

    def _present(self, pictures: Mapping[str, NDArray]) -> Present:
        """Returns the present step of all environments, with some pictures, in fresh arrays."""
        episodes = self._episodes
        flat = episodes.observation().astype(self._template_env.observation_dtype, copy=False)
        return Present(flat, episodes.simulation, episodes.state.mdp_state, pictures)

    def _get_info(self) -> dict[str, Any]:
        """Returns the infos of all environments but those on the variation, in fresh arrays with a leading axis."""
        infos = self._episodes.info()
        if self._template_env.has_instructions:
            infos[INSTRUCTION] = np.array(self.instruction, object)
        return infos

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The environments' random generators."""
        self._check_open()
        return tuple(stream.generator for stream in self._episodes.streams)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seeds of the environments' random generators."""
        self._check_open()
        return tuple(stream.seed for stream in self._episodes.streams)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Starts an episode in every environment, or in some.

        A bad argument raises a TypeError or ValueError that names it.

        Args:
          seed: environment `i` is seeded with `seed + i`, or with element `i` of a sequence. Without one, and for None
            in a sequence, its stream continues, or with `episode_seeds` that of its next seed starts.
          options: `{"reset_mask": mask}`, with a bool array `(n,)`, starts episodes only where the mask is True;
            `variation` and `variation_values` as for the single environment, values with a leading axis `(n,)`; options
            of the task, in sequences with an element for each environment; others are ignored, as by the single one.

        Raises:
          gymnasium.error.ResetNeeded: the mask omits environments that have no episode yet.
          gymnasium.error.ClosedEnvironmentError: after `close`.
        """
        self._check_process()
        task = self._task
        seeds = vector_arguments.seeds(seed, self.num_envs)
        names = (RESET_MASK, VARIATION, VARIATION_VALUES, *task.requests.options)
        chosen = checks.reset_options(options, names, elsewhere=(STATE,))
        mask = np.full(self.num_envs, True)
        if RESET_MASK in chosen:
            mask = vector_arguments.checked_mask(chosen[RESET_MASK], self.num_envs, RESET_MASK)
        if self._needs_reset and not mask.all():
            raise gymnasium.error.ResetNeeded("some environments have no episode; call reset() for all of them first")
        each = vector_arguments.options_of_each(chosen, task.requests.options, mask)
        resets = {i: self._tasks[i].checked_reset(own) for i, own in each.items()}
        for own in each.values():
            self._template_env.check_pictures(own)
        with self._all_or_nothing():
            self._episodes.follow_edits()
            self._episodes.follow(resets)
            self._episodes.seed({i: seed for i, seed in enumerate(seeds) if mask[i] and seed is not None})
            self._episodes.start(mask)
            self._ended = self._ended & ~mask
            return self._get_obs(), {**self._masked_infos(mask), **self._infos_of_reset(chosen, mask)}

    def _infos_of_reset(self, options: Mapping[str, Any], mask: NDArray[np.bool_]) -> dict[str, Any]:
        """Returns infos, with masks, that only a reset of the environments of a mask with some options has."""
        return {}

    def step(self, actions: ArrayLike) -> StepResult:
        """Makes a control step in every environment, or starts an episode, depending on the autoreset mode.

        | mode       | environments whose episode ended in the last step | whose episode ends in this step           |
        |------------|---------------------------------------------------|-------------------------------------------|
        | `NextStep` | start the next one, reward 0                      | return its last observation               |
        | `SameStep` | none                                              | start the next one; see `final_obs` and   |
        |            |                                                   | `final_info` in the infos for the last    |
        | `Disabled` | raise ResetNeeded                                 | return its last observation               |

        Args:
          actions: `(n, ...)`; those of environments that start an episode must be valid, but are not used.

        Returns:
          Observations, rewards `(n,)`, terminations `(n,)`, truncations `(n,)` and infos.

        Raises:
          gymnasium.error.ResetNeeded: before the first reset, after a step that was interrupted, or, with `Disabled`,
            while the episode of an environment has ended.
          gymnasium.error.ClosedEnvironmentError: after `close`.
          TypeError: the actions do not hold real numbers.
          ValueError: the actions have the wrong shape, hold NaN or inf, or have no meaning; nothing has changed then.
        """
        self._check_process()
        self._check_episodes(self._everyone)
        return self._step(vector_arguments.actions(actions, self.action_space), self._no_one)

    def step_some(self, actions: ArrayLike, mask: NDArray[np.bool_]) -> StepResult:
        """Makes a control step in some environments; the others are not simulated, and their episodes end.

        With fewer episodes left than environments, this takes less time than `step`.

        Args:
          actions: `(n, ...)`; those of the other environments must be finite, and are not used.
          mask: bools `(n,)`, True where a step is made.

        Returns:
          As `step`. Where the mask is False, rewards are 0, terminations and truncations False, and observations and
          infos without meaning.

        Raises:
          ValueError: the autoreset mode is not `Disabled`. Other errors are those of `step`, where the mask is True.
        """
        self._check_process()
        vector_arguments.autoreset_mode(self.autoreset_mode, AutoresetMode.DISABLED)
        mask = vector_arguments.checked_mask(mask, self.num_envs, "mask")
        self._check_episodes(mask)
        checked = vector_arguments.actions(actions, self.action_space)
        # Rows that are not used are still checked and converted, so they have to be meaningful.
        checked[~mask] = checked[mask.argmax()]
        return self._step(checked, ~mask)

    def _step(self, actions: NDArray[np.float64], waiting: NDArray[np.bool_]) -> StepResult:
        """Makes a control step, or starts an episode, except in environments `(n,)` that wait for a reset."""
        applied = self._template_env.clip_actions(actions) if self._template_env.clips_actions else actions
        self._mdp.action_mode.check(applied)
        with self._all_or_nothing():
            restarting = self._ended if self.autoreset_mode == AutoresetMode.NEXT_STEP else self._no_one
            stepping = ~(restarting | waiting)
            rewards, terminations, diverged = self._episodes.step(applied, stepping)
            truncates = self._mdp.truncates(self._episodes.state.mdp_state)
            truncations = ((self._episodes.steps >= self._step_limit) | truncates) & stepping & ~diverged
            # The episode of an environment that is left out ends.
            self._ended = terminations | truncations | waiting
            self._episodes.start(restarting)
            infos = info_arrays.with_masks({"physics_error": diverged}, diverged) if diverged.any() else {}
            infos |= self._restart_in_same_step()
            infos |= info_arrays.with_masks(self._get_info(), self._everyone)
            infos |= self._episodes.masked_variation_info()
            return self._get_obs(), rewards, terminations, truncations, infos

    def _restart_in_same_step(self) -> dict[str, Any]:
        """With `SameStep`, starts an episode where one has ended.

        Returns:
          Infos with the last observation and the last info of each episode that has ended, as Gymnasium formats them.
        """
        if self.autoreset_mode != AutoresetMode.SAME_STEP or not self._ended.any():
            return {}
        ended = self._ended
        observations = self._get_obs()
        last = np.full(self.num_envs, None, dtype=object)
        for i in np.flatnonzero(ended).tolist():
            last[i] = tree.map_structure(lambda array, i=i: array[i].copy(), observations)
        info = self._masked_infos(ended)
        self._episodes.start(ended)
        return {"final_obs": last, "_final_obs": ended.copy(), "final_info": info, "_final_info": ended.copy()}

    def _check_episodes(self, stepping: NDArray[np.bool_]) -> None:
        """Checks that every environment has an episode; with `Disabled`, also that those stepped need no reset."""
        if self._needs_reset:
            raise gymnasium.error.ResetNeeded("call reset(): there is no episode yet, or its last step was interrupted")
        if self.autoreset_mode == AutoresetMode.DISABLED and (self._ended & stepping).any():
            ended = np.flatnonzero(self._ended & stepping).tolist()
            raise gymnasium.error.ResetNeeded(f"the episodes of environments {ended} have ended; reset them first")

    def _masked_infos(self, mask: NDArray[np.bool_]) -> dict[str, Any]:
        """Returns all infos in fresh arrays, with masks; 0 or None where the mask `(n,)` is False."""
        return info_arrays.masked({**self._get_info(), **self._episodes.variation_info()}, mask)

    def render(self) -> tuple[NDArray, ...] | None:
        """Returns an image of every environment; see `render_some`."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() was called without a render_mode; pass one to the constructor")
            return None
        return self.render_some(range(self.num_envs))

    def render_some(self, indices: Iterable[int]) -> tuple[NDArray, ...]:
        """Returns images `(height, width, 3)` uint8, or depth `(height, width)` float32, of some environments.

        Raises:
          IndexError: there is no such environment.
          ValueError: there is no `render_mode`.
          gymnasium.error.ResetNeeded: there is no episode to render.
        """
        self._check_process()
        if self.render_mode is None:
            raise ValueError("there are no pictures without a render_mode; pass one to the constructor")
        if self._needs_reset:
            raise gymnasium.error.ResetNeeded("call reset() first: there is no episode to render")
        images = []
        for i in [range(self.num_envs)[index] for index in indices]:
            self._episodes.show(i)
            images.append(cast(NDArray, self.template_of(i).render()))
        return tuple(images)

    def close_extras(self, **kwargs: Any) -> None:
        for template in self._templates:
            template.close()
        # The batch's threads end with the last reference to it.
        del self._episodes, self._pictures

    @contextlib.contextmanager
    def _all_or_nothing(self) -> Iterator[None]:
        """Requires a reset after an interrupt or error, which may leave physics and tasks at different steps."""
        self._needs_reset = True
        yield
        self._needs_reset = False

    def _check_open(self) -> None:
        if self.closed:
            raise gymnasium.error.ClosedEnvironmentError("the environments are closed")

    def _check_process(self) -> None:
        """Checks that the environments are open, and in the process in which their threads run."""
        self._check_open()
        if os.getpid() != self._process:
            raise RuntimeError(
                "threads do not survive a fork: build the environments in the process that steps them, or start "
                "processes with the method 'spawn'"
            )


# Hooks of composer's entities in a control step, which a batch does not call, and that of MJCF before an episode.
_HOOKS = ("before_step", "before_substep", "after_substep", "after_step", "initialize_episode_mjcf")


def check_entities(environment: SuiteEnv) -> None:
    """Raises a ValueError if an entity in an environment's scene acts in a way that a batch does not."""
    for entity in environment.composer_task.root_entity.iter_entities():
        name = entity.mjcf_model.model
        hooks = [hook for hook in _HOOKS if getattr(type(entity), hook) is not getattr(composer.Entity, hook)]
        if hooks:
            raise ValueError(
                f"entity {name!r} overrides {hooks}, which vectorised environments do not call: write what it does as "
                "extra_observations, extra_rewards or reset_physics of the task; "
                "see docs/guide/your_task.md#hooks-of-composer"
            )


def processors() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
