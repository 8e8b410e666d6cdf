"""The base of the suite's vectorised environments: many episodes in one call of MuJoCo's batched stepping."""

import abc
import contextlib
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, cast

import gymnasium
import mujoco
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from mujoco.batch import Batch
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.environment import PHYSICS_STATE, random_state
from kitchen_suite.gymnasium_env.base import SuiteEnv
from kitchen_suite.tasks.simulation import BatchSimulation
from kitchen_suite.vector_env import batching
from kitchen_suite.vector_env import checks as vector_checks
from kitchen_suite.vector_env.forks import leak_in_forks


class SuiteVectorEnv(gymnasium.vector.VectorEnv, abc.ABC):
    """A vector of environments, each equal to the single environment: the same numbers for the same seed and actions.

    One single environment, the template, starts every episode; its state is then copied to a batch of simulations. The
    batch steps them on several threads. Everything else is computed by the task's MDP, on arrays with a leading axis.

    Infos are arrays with a leading axis, and a mask `_key` for each `key`, as Gymnasium's are. If a simulation
    diverges, its episode ends with reward 0 and the next one starts in the same step; the infos then have a mask
    `physics_error`.
    """

    # Class of the single environment.
    env_class: type[SuiteEnv]

    def __init__(
        self,
        num_envs: int = 1,
        *,
        num_threads: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        **settings: Any,
    ) -> None:
        """Builds the environments.

        Args:
          num_envs: number of environments.
          num_threads: number of threads that step them, including the calling one; by default one per processor.
          autoreset_mode: when an environment whose episode has ended starts the next one: `NextStep`, `SameStep`, or
            `Disabled` for a call of `reset` with a `reset_mask`; see `step`.
          max_episode_steps: control steps after which an episode truncates; never when omitted or -1.
          **settings: arguments of the single environment.

        Raises:
          TypeError: an argument of the wrong type, or an unknown one.
          ValueError: an unknown name, or a number out of range.
        """
        self.num_envs = checks.integer(num_envs, "num_envs", minimum=1, maximum=checks.MAX_ENVS)
        threads = processors() if num_threads is None else num_threads
        checks.integer(threads, "num_threads", minimum=1, maximum=checks.MAX_THREADS)
        modes = [mode.value for mode in AutoresetMode]
        name = autoreset_mode.value if isinstance(autoreset_mode, AutoresetMode) else autoreset_mode
        self._autoreset = AutoresetMode(checks.choice(name, modes, "autoreset_mode"))
        if settings.get("render_mode") == "human":
            raise ValueError("render_mode 'human' shows one environment; use 'rgb_array' or 'depth_array'")
        # Gymnasium's `make` accepts -1 for no limit.
        limit = None if max_episode_steps == -1 else max_episode_steps
        self._step_limit = np.iinfo(np.int64).max if limit is None else limit
        self._template_env = self.env_class(max_episode_steps=limit, **settings)
        # The first reset compiles the model, which stays the same from then on.
        self._template_env.reset()
        self._copy_spaces()
        self._make_batch(threads)
        self._make_episodes()

    def _copy_spaces(self) -> None:
        """Takes spaces, metadata and render mode from the template."""
        template = self._template_env
        self.render_mode = template.render_mode
        self.metadata = {**template.metadata, "autoreset_mode": self._autoreset}
        self.single_action_space = template.action_space
        self.single_observation_space = template.observation_space
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

    def _make_batch(self, threads: int) -> None:
        """Builds the simulations, and the arrays over all of them."""
        environment = self._template_env.environment
        self._physics_steps = environment.task.physics_steps_per_control_step
        self._batch = Batch(environment.physics.model.ptr, self.num_envs, threads, persistent=True)
        leak_in_forks(self._batch)
        self._simulation = BatchSimulation(self._batch)
        self._model_fields = {name: self._batch.expand(name) for name in environment.task.randomizer.model_fields}
        self._process = os.getpid()

    def _make_episodes(self) -> None:
        """Builds the state of the episodes; `reset` starts them."""
        self._streams = [random_state.Stream(None) for _ in range(self.num_envs)]
        task = self._template_env.environment.task
        self._mdp = task.mdp
        self._state: Any = batching.repeat(task.state, self.num_envs)
        self._draws = np.zeros((self.num_envs, self._mdp.noise_draws))
        self._episode_steps = np.zeros(self.num_envs, np.int64)
        self._ended = np.zeros(self.num_envs, bool)
        self._needs_reset = True

    def __repr__(self) -> str:
        env_id = f"{self.spec.id}, " if self.spec else ""
        return f"{type(self).__name__}({env_id}{self._template_env.environment.task!r}, num_envs={self.num_envs})"

    @property
    def template_env(self) -> SuiteEnv:
        """The single environment that starts the episodes; not to be stepped."""
        return self._template_env

    def begin_run(self, mask: NDArray[np.bool_] | None = None, *, total_steps: int = 0) -> None:
        """Resets what environments keep from one episode to the next; see `SuiteTask.begin_run`.

        Args:
          mask: environments `(n,)` that begin a run; all when omitted.
          total_steps: control steps that each has made before, where a run continues.
        """
        for name in self._mdp.carried:
            getattr(self._state, name)[slice(None) if mask is None else mask] = total_steps

    def _get_obs(self) -> Any:
        """Returns the observations of all environments, in fresh arrays."""
        return self._template_env.layout(self._mdp.observation(self._simulation, self._state), self._state)

    def _get_info(self) -> dict[str, NDArray]:
        """Returns the infos of all environments, in fresh arrays with a leading axis."""
        return {**self._mdp.info(self._state), "episode_step": self._episode_steps.copy()}

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The environments' random generators."""
        return tuple(stream.generator for stream in self._streams)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seeds of the environments' random generators."""
        return tuple(stream.seed for stream in self._streams)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Starts an episode in every environment, or in some.

        Args:
          seed: environment `i` is seeded with `seed + i`, or with element `i` of a sequence.
          options: `{"reset_mask": mask}`, with a bool array `(n,)`, starts episodes only where the mask is True.

        Raises:
          TypeError: a seed is no integer, the options are no dict, or the mask is no array of bools.
          ValueError: a seed is negative, the number of seeds is not that of environments, an option is unknown, or the
            mask has the wrong shape or is False everywhere.
          gymnasium.error.ResetNeeded: the mask omits environments that have no episode yet.
          gymnasium.error.ClosedEnvironmentError: after `close`.
        """
        self._check_process()
        seeds, mask = vector_checks.seeds(seed, self.num_envs), vector_checks.reset_mask(options, self.num_envs)
        if self._needs_reset and not mask.all():
            raise gymnasium.error.ResetNeeded("some environments have no episode; call reset() for all of them first")
        with self._all_or_nothing():
            for i in np.flatnonzero(mask):
                if seeds[i] is not None:
                    self._streams[i] = random_state.Stream(seeds[i])
            self._start(mask)
            self._ended = self._ended & ~mask
            return self._get_obs(), batching.masked(self._get_info(), mask)

    def step(
        self, actions: ArrayLike
    ) -> tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
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
          ValueError: the actions have the wrong shape, or hold NaN or inf; nothing has changed then.
        """
        self._check_process()
        self._check_episodes()
        actions = vector_checks.actions(actions, self.action_space)
        with self._all_or_nothing():
            restarting = self._restarting()
            rewards, terminations, diverged = self._make_step(actions, ~restarting)
            truncations = (self._episode_steps >= self._step_limit) & ~restarting
            self._ended = terminations | truncations
            self._start(restarting | diverged)
            infos = batching.with_masks({"physics_error": diverged}, diverged) if diverged.any() else {}
            infos |= self._restart_in_same_step(diverged)
            infos |= batching.with_masks(self._get_info(), np.full(self.num_envs, True))
            return self._get_obs(), rewards, terminations, truncations, infos

    def _restarting(self) -> NDArray[np.bool_]:
        """Environments `(n,)` that start an episode instead of a control step: with `NextStep`, where one has ended."""
        return self._ended if self._autoreset == AutoresetMode.NEXT_STEP else np.zeros_like(self._ended)

    def _restart_in_same_step(self, diverged: NDArray[np.bool_]) -> dict[str, Any]:
        """With `SameStep`, starts an episode where one has ended, unless the divergence of a simulation has started it.

        Returns:
          Infos with the last observation and the last info of each episode that has ended.
        """
        if self._autoreset != AutoresetMode.SAME_STEP or not self._ended.any():
            return {}
        infos = self._final_infos(self._ended)
        self._start(self._ended & ~diverged)
        return infos

    def _check_episodes(self) -> None:
        """Checks that every environment has an episode; with `Disabled`, also that none has ended."""
        if self._needs_reset:
            raise gymnasium.error.ResetNeeded("call reset(): there is no episode yet, or its last step was interrupted")
        if self._autoreset == AutoresetMode.DISABLED and self._ended.any():
            ended = np.flatnonzero(self._ended).tolist()
            raise gymnasium.error.ResetNeeded(f"the episodes of environments {ended} have ended; reset them first")

    def _make_step(
        self, actions: NDArray[np.float64], stepping: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
        """Makes a control step where `stepping`; returns rewards, terminations, and which simulations diverged."""
        mdp, actions = self._mdp, self._template_env.clip_actions(actions)
        target = mdp.action_mode.control(self._simulation, self._state, actions, self._draw_actions(stepping))
        self._simulation.write("ctrl", mdp.sensors.ctrl, target)
        self._batch.step(None if stepping.all() else stepping, self._physics_steps, int(mdp.sensors.stage))
        diverged = np.logical_or.reduce(self._batch.warning[:, :, 1], axis=1)
        alive = stepping & ~diverged
        self._draw_noise(alive)
        reading = mdp.sensors.read(self._simulation)
        state = mdp.step(self._state, action=actions, target=target, reading=reading, draws=self._draws)
        self._state = self._carry(state, alive)
        self._episode_steps += stepping
        return np.where(alive, mdp.reward(state), 0.0), (mdp.terminates(state) & alive) | diverged, diverged

    def _draw_actions(self, stepping: NDArray[np.bool_]) -> NDArray[np.float64] | float:
        """Returns draws `(n,)` for the actions, as `MDP.draw_action`: only where `stepping`, the median elsewhere."""
        if not self._mdp.action_mode.draws:
            return 0.5
        each = zip(self._streams, stepping.tolist(), strict=True)
        return np.array([stream.sample() if draws else 0.5 for stream, draws in each])

    def _draw_noise(self, stepping: NDArray[np.bool_]) -> None:
        """Draws the numbers of the observation noise where `stepping`."""
        if self._draws.size:
            for i in stepping.nonzero()[0].tolist():
                self._draws[i] = self._mdp.draw_noise(self._streams[i].random_state)

    def _carry(self, state: Any, stepping: NDArray[np.bool_]) -> Any:
        """Returns a state after a step, with the fields that resets leave unchanged where not `stepping`."""
        if stepping.all():
            return state
        kept = {
            name: np.where(stepping, getattr(state, name), getattr(self._state, name)) for name in self._mdp.carried
        }
        return state._replace(**kept) if kept else state

    def _start(self, mask: NDArray[np.bool_]) -> None:
        """Starts episodes where the mask is True."""
        (indices,) = mask.nonzero()
        if not indices.size:
            return
        environment = self._template_env.environment
        self._batch.reset(indices, stage=int(mujoco.mjtStage.mjSTAGE_NONE))
        model, data = environment.physics.model.ptr, environment.physics.data.ptr
        carried = {name: getattr(self._state, name)[indices] for name in self._mdp.carried}
        for i in indices.tolist():
            environment.random_state = self._streams[i].random_state
            environment.start_episode()
            mujoco.mj_getState(model, data, self._batch.state[i], PHYSICS_STATE)
            for name, values in self._model_fields.items():
                values[i] = getattr(model, name)
            batching.put(self._state, i, environment.task.state)
        for name, values in carried.items():
            getattr(self._state, name)[indices] = values
        self._episode_steps[mask] = 0

    def _final_infos(self, ended: NDArray[np.bool_]) -> dict[str, Any]:
        """Returns the last observations and infos of episodes that end, as Gymnasium lays them out."""
        observations, last = self._get_obs(), np.full(self.num_envs, None, dtype=object)
        for i in np.flatnonzero(ended).tolist():
            last[i] = batching.row(observations, i)
        info = batching.masked(self._get_info(), ended)
        return {"final_obs": last, "_final_obs": ended.copy(), "final_info": info, "_final_info": ended.copy()}

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
        return tuple(self._render_one(range(self.num_envs)[i]) for i in indices)

    def _render_one(self, i: int) -> NDArray:
        """Renders environment `i` with the template, which holds its state until the next episode starts."""
        model, data = self._template_env.environment.physics.model.ptr, self._template_env.environment.physics.data.ptr
        for name, values in self._model_fields.items():
            getattr(model, name)[:] = values[i]
        mujoco.mj_setState(model, data, self._batch.state[i], PHYSICS_STATE)
        mujoco.mj_forward(model, data)
        return cast(NDArray, self._template_env.render())

    def close_extras(self, **kwargs: Any) -> None:
        self._template_env.close()
        # The batch's threads end with the last reference to it.
        del self._batch, self._simulation, self._model_fields

    @contextlib.contextmanager
    def _all_or_nothing(self) -> Iterator[None]:
        """Requires a reset after an interrupt or error, which may leave physics and tasks at different steps."""
        self._needs_reset = True
        yield
        self._needs_reset = False

    def _check_process(self) -> None:
        """Checks that the environments are open, and in the process in which their threads run."""
        if self.closed:
            raise gymnasium.error.ClosedEnvironmentError("the environments are closed")
        if os.getpid() != self._process:
            raise RuntimeError(
                "threads do not survive a fork: build the environments in the process that steps them, or start "
                "processes with the method 'spawn'"
            )


def processors() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
