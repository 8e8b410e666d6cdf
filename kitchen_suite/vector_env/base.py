"""What the suite's vectorised environments share: many episodes in one call of MuJoCo's batched stepping."""

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
from kitchen_suite.tasks import rows
from kitchen_suite.vector_env import base, batching
from kitchen_suite.vector_env import checks as vector_checks


class SuiteVectorEnv(gymnasium.vector.VectorEnv, abc.ABC):
    """Many environments of one kind, each exactly the single one: the same numbers for the same seed and actions.

    Every episode is started by one single environment, whose state then moves into a batch of simulations. The batch
    steps them on several threads; all else is the task's own rules, on arrays with one more axis.

    Infos hold arrays with a leading axis, and a mask `_key` for each `key`, as Gymnasium's do. A simulation that
    diverges ends its episode with reward 0 and is started anew at once; `physics_error` in the info tells which did.
    """

    # Class of the single environment.
    env_class: type[SuiteEnv]

    # What is to be computed after the last physics step of a control step.
    stage = mujoco.mjtStage.mjSTAGE_NONE

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
          num_envs: how many.
          num_threads: threads that step them, the caller's among them; as many as there are processors when omitted.
          autoreset_mode: when an episode that has ended makes room for the next: in the `NextStep`, in the `SameStep`,
            or, `Disabled`, when `reset` is called with a `reset_mask`.
          max_episode_steps: control steps after which an episode truncates; never when omitted or -1.
          **settings: of the single environment.

        Raises:
          TypeError: an argument of the wrong type, or an unknown one.
          ValueError: an unknown name, or a number out of range.
        """
        self.num_envs = checks.integer(num_envs, "num_envs", minimum=1)
        threads = base.processors() if num_threads is None else checks.integer(num_threads, "num_threads", minimum=1)
        modes = [mode.value for mode in AutoresetMode]
        name = autoreset_mode.value if isinstance(autoreset_mode, AutoresetMode) else autoreset_mode
        self._autoreset = AutoresetMode(checks.choice(name, modes, "autoreset_mode"))
        if settings.get("render_mode") == "human":
            raise ValueError("render_mode 'human' shows one environment; give 'rgb_array' or 'depth_array'")
        # Gymnasium's `make` takes -1 as no limit.
        limit = None if max_episode_steps == -1 else max_episode_steps

        self._template_env = self.env_class(max_episode_steps=limit, **settings)
        self._step_limit = np.iinfo(np.int64).max if limit is None else limit
        self.render_mode = self._template_env.render_mode
        self.metadata = {**self._template_env.metadata, "autoreset_mode": self._autoreset}
        self.single_action_space = self._template_env.action_space
        self.single_observation_space = self._template_env.observation_space
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)

        # Its first reset compiles the model, once and for all.
        self._template_env.reset()
        physics, task = self._template_env.environment.physics, self._template_env.environment.task
        self._physics_steps = task.physics_steps_per_control_step
        self._batch = Batch(physics.model.ptr, self.num_envs, threads, persistent=True)
        self._fields: dict[str, NDArray] = {}
        self._own_fields = {name: self._batch.expand(name) for name in self._randomized_fields()}
        self._streams = [random_state.Stream(None) for _ in range(self.num_envs)]
        self._state: Any = rows.repeated(task.state, self.num_envs)
        self._episode_steps = np.zeros(self.num_envs, np.int64)
        self._ended = np.zeros(self.num_envs, bool)
        self._needs_reset = True
        self._process = os.getpid()

    def _randomized_fields(self) -> Sequence[str]:
        """Fields of the model that a reset may change."""
        return ()

    @abc.abstractmethod
    def _apply_actions(self, actions: NDArray[np.float64], stepping: NDArray[np.bool_]) -> None:
        """Writes the simulations' controls for actions `(n, ...)`; draws only for environments that are `stepping`."""

    @abc.abstractmethod
    def _post_step(self, stepping: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Brings the episodes' states up to date after a step; draws only where `stepping`.

        Returns:
          Rewards `(n,)` and terminations `(n,)`; what they hold elsewhere is not used.
        """

    @abc.abstractmethod
    def _get_obs(self) -> Any:
        """The observations of all environments, in fresh arrays."""

    @abc.abstractmethod
    def _get_info(self) -> dict[str, NDArray]:
        """The infos of all environments, in fresh arrays with a leading axis."""

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The environments' random generators."""
        return tuple(stream.generator for stream in self._streams)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seeds that they were last started with."""
        return tuple(stream.seed for stream in self._streams)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Starts an episode in every environment, or in some.

        Args:
          seed: environment `i` is seeded with `seed + i`, or with element `i` of a sequence.
          options: `{"reset_mask": mask}`, with a bool `(n,)`, starts only where the mask is True.

        Raises:
          TypeError: a seed is no integer, the options are no dict, or the mask is no array of bools.
          ValueError: a seed is negative, there is not one for each environment, an option is unknown, or the mask has
            the wrong shape or chooses nothing.
          gymnasium.error.ResetNeeded: the mask leaves out environments that are of no episode.
          gymnasium.error.ClosedEnvironmentError: after `close`.
        """
        self._check_process()
        seeds, mask = vector_checks.seeds(seed, self.num_envs), vector_checks.reset_mask(options, self.num_envs)
        if self._needs_reset and not mask.all():
            raise gymnasium.error.ResetNeeded("some environments are of no episode; call reset() for all of them first")
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
        """Makes a control step in every environment, or starts an episode where the autoreset mode wants it.

        Args:
          actions: `(n, ...)`; those of environments that start an episode must be legal, too, but are not used.

        Returns:
          Observations, rewards `(n,)`, terminations `(n,)`, truncations `(n,)` and infos.

        Raises:
          gymnasium.error.ResetNeeded: before the first reset, after a step that was interrupted, or where an episode
            has ended and nothing is to reset it.
          gymnasium.error.ClosedEnvironmentError: after `close`.
          TypeError: the actions do not hold real numbers.
          ValueError: they have the wrong shape, or hold NaN or inf; nothing has changed then.
        """
        self._check_process()
        self._check_episodes()
        actions = vector_checks.actions(actions, self.action_space)
        starting = self._ended if self._autoreset == AutoresetMode.NEXT_STEP else np.zeros_like(self._ended)
        stepping = ~starting
        with self._all_or_nothing():
            rewards, terminations, diverged = self._make_step(actions, stepping)
            truncations = (self._episode_steps >= self._step_limit) & stepping
            self._start(starting | diverged)
            infos = {"physics_error": diverged, "_physics_error": diverged.copy()} if diverged.any() else {}
            self._ended = terminations | truncations
            if self._autoreset == AutoresetMode.SAME_STEP and self._ended.any():
                infos |= self._final(self._ended)
                self._start(self._ended & ~diverged)
            infos |= batching.complete(self._get_info(), self.num_envs)
            return self._get_obs(), rewards, terminations, truncations, infos

    def render(self) -> tuple[NDArray, ...] | None:
        """Gives a picture of every environment; see `render_some`."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() was called without a render_mode; give one to the constructor")
            return None
        return self.render_some(range(self.num_envs))

    def render_some(self, indices: Iterable[int]) -> tuple[NDArray, ...]:
        """Gives pictures `(height, width, 3)` uint8, or depth `(height, width)` float32, of chosen environments.

        Raises:
          IndexError: there is no such environment.
          ValueError: there is no `render_mode`.
          gymnasium.error.ResetNeeded: there is no episode to look at.
        """
        self._check_process()
        if self.render_mode is None:
            raise ValueError("there are no pictures without a render_mode; give one to the constructor")
        if self._needs_reset:
            raise gymnasium.error.ResetNeeded("call reset() first: there is no episode to look at")
        return tuple(self._picture(range(self.num_envs)[i]) for i in indices)

    def close_extras(self, **kwargs: Any) -> None:
        self._template_env.close()
        # With the last reference to the batch its threads end.
        del self._batch, self._fields, self._own_fields

    def _field(self, name: str) -> NDArray[np.float64]:
        """A field `(n, ...)` of MuJoCo's data over all simulations, live."""
        if name not in self._fields:
            self._fields[name] = self._batch.bind(name)
        return self._fields[name]

    def _read(self, name: str, columns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Columns `(n, k)` of a field of MuJoCo's data over all simulations; a copy."""
        return self._field(name).take(columns, axis=1)

    @contextlib.contextmanager
    def _all_or_nothing(self) -> Iterator[None]:
        """An interrupt or an error inside must not leave physics and tasks at different times: it calls for a reset."""
        self._needs_reset = True
        yield
        self._needs_reset = False

    def _check_process(self) -> None:
        if self.closed:
            raise gymnasium.error.ClosedEnvironmentError("the environments are closed")
        if os.getpid() != self._process:
            raise RuntimeError(
                "threads do not survive a fork: build the environments in the process that steps them, or start "
                "processes with the method 'spawn'"
            )

    def _check_episodes(self) -> None:
        if self._needs_reset:
            raise gymnasium.error.ResetNeeded("call reset(): there is no episode yet, or its last step was interrupted")
        if self._autoreset == AutoresetMode.DISABLED and self._ended.any():
            ended = np.flatnonzero(self._ended).tolist()
            raise gymnasium.error.ResetNeeded(f"the episodes of environments {ended} have ended; reset them first")

    def _make_step(
        self, actions: NDArray[np.float64], stepping: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
        """Makes a control step where `stepping`; returns rewards, terminations, and which simulations diverged."""
        self._apply_actions(actions, stepping)
        self._batch.step(None if stepping.all() else stepping, self._physics_steps, int(self.stage))
        diverged = np.logical_or.reduce(self._batch.warning[:, :, 1], axis=1)
        alive = stepping & ~diverged
        rewards, terminations = self._post_step(alive)
        self._episode_steps += stepping
        return np.where(alive, rewards, 0.0), (terminations & alive) | diverged, diverged

    def _start(self, mask: NDArray[np.bool_]) -> None:
        """Starts episodes where the mask is True."""
        (chosen,) = mask.nonzero()
        if not chosen.size:
            return
        environment = self._template_env.environment
        self._batch.reset(chosen, stage=int(mujoco.mjtStage.mjSTAGE_NONE))
        model, data = environment.physics.model.ptr, environment.physics.data.ptr
        for i in chosen.tolist():
            environment.random_state = self._streams[i].random_state
            environment.start_episode()
            mujoco.mj_getState(model, data, self._batch.state[i], PHYSICS_STATE)
            for name, own in self._own_fields.items():
                own[i] = getattr(model, name)
            rows.put(self._state, i, environment.task.state)
        self._episode_steps[mask] = 0

    def _final(self, ended: NDArray[np.bool_]) -> dict[str, Any]:
        """What the infos say of episodes that end and are followed by the next in the same step."""
        observations, last = self._get_obs(), np.full(self.num_envs, None, dtype=object)
        for i in np.flatnonzero(ended).tolist():
            last[i] = batching.row(observations, i)
        info = batching.masked(self._get_info(), ended)
        return {"final_obs": last, "_final_obs": ended.copy(), "final_info": info, "_final_info": ended.copy()}

    def _picture(self, i: int) -> NDArray:
        model, data = self._template_env.environment.physics.model.ptr, self._template_env.environment.physics.data.ptr
        for name, own in self._own_fields.items():
            getattr(model, name)[:] = own[i]
        mujoco.mj_setState(model, data, self._batch.state[i], PHYSICS_STATE)
        mujoco.mj_forward(model, data)
        return cast(NDArray, self._template_env.render())


def processors() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
