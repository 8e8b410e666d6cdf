"""A composer environment that steps faster, counts its time limit in control steps, and survives bad luck."""

import collections
import math
import warnings
from collections.abc import Mapping
from typing import Any

import dm_env
import mujoco
import numpy as np
from dm_control import composer
from dm_control.rl import control
from dm_env import specs
from numpy.typing import ArrayLike

from kitchen_suite import checks
from kitchen_suite.environment import random_state as random_states
from kitchen_suite.environment.observation_updater import UnbufferedUpdater, is_unbuffered
from kitchen_suite.tasks.base import SuiteTask

_SUBSTEP_HOOKS = ("before_substep", "after_substep")
# All that the future of the physics depends on, the solver's warm start included.
PHYSICS_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


class Environment(composer.Environment):
    """`composer.Environment` with four differences.

    - All physics steps of a control step are made in one call when nothing looks at them one by one: no hook of task,
      entity or user between them, and every enabled observable updated at each step, without delay or buffer.
    - The time limit is counted in control steps. composer sums physics times, and ends an episode of 280 steps with the
      281st.
    - After a `PhysicsError` the next `step` starts a new episode.
    - `flat_observation` gives one array, as dm_control's suite does.
    """

    def __init__(
        self,
        task: SuiteTask,
        time_limit: float = math.inf,
        random_state: int | np.random.RandomState | None = None,
        *,
        flat_observation: bool = False,
        **kwargs: Any,
    ) -> None:
        """Builds the environment.

        Args:
          task: what is asked.
          time_limit: length of an episode [s].
          random_state: seed, or state to draw from.
          flat_observation: whether to concatenate all observations under the key `observations`.
          **kwargs: further arguments of `composer.Environment`.

        Raises:
          TypeError: `flat_observation` is no bool.
          ValueError: `time_limit` is not positive.
        """
        if not time_limit > 0:
            raise ValueError(f"time_limit must be positive, got {time_limit!r}")
        with warnings.catch_warnings():
            # composer notes the state of the random stream, which numpy warns about where it is not a Mersenne twister.
            warnings.filterwarnings("ignore", "get_state and legacy", RuntimeWarning)
            super().__init__(task, random_state=random_states.make_random_state(random_state), **kwargs)
        steps = time_limit / self.control_timestep()
        self._step_limit = math.ceil(steps - 1e-9) if math.isfinite(steps) else math.inf
        self._step_count = 0
        self._flat_observation = checks.boolean(flat_observation, "flat_observation")
        self._plan_substeps()

    @property
    def random_state(self) -> np.random.RandomState:
        """What the environment draws from; a new one may be given at any time."""
        return self._random_state

    @random_state.setter
    def random_state(self, value: int | np.random.RandomState | None) -> None:
        self._random_state = random_states.make_random_state(value)

    @property
    def step_limit(self) -> float:
        """Control steps in an episode; infinite where there is no limit."""
        return self._step_limit

    def reset(self) -> dm_env.TimeStep:
        self._reset_next_step = True
        timestep = super().reset()
        self._step_count = 0
        self._plan_substeps()
        return timestep._replace(observation=self._flatten(timestep.observation))

    def step(self, action: ArrayLike) -> dm_env.TimeStep:
        if self._reset_next_step:
            return self.reset()
        try:
            timestep = super().step(action)
        except control.PhysicsError:
            self._reset_next_step = True
            raise
        self._step_count += 1
        if timestep.mid() and self._step_count >= self._step_limit:
            self._reset_next_step = True
            timestep = timestep._replace(step_type=dm_env.StepType.LAST)
        if not self._flat_observation:
            return timestep
        return timestep._replace(observation=self._flatten(timestep.observation))

    def observation_spec(self) -> collections.OrderedDict[str, specs.Array]:
        spec = super().observation_spec()
        if not self._flat_observation:
            return spec
        size = sum(math.prod(part.shape) for part in spec.values())
        dtype = np.result_type(*(part.dtype for part in spec.values()))
        key = control.FLAT_OBSERVATION_KEY
        return collections.OrderedDict({key: specs.Array((size,), dtype, name=key)})

    def start_episode(self) -> None:
        """Starts an episode as `reset` does after a first one, but observes nothing: for those who read the task."""
        with self._physics.reset_context():
            self._hooks.initialize_episode(self._physics_proxy, self._random_state)
        self._step_count, self._reset_next_step = 0, False

    def continue_episode(self) -> None:
        """Lets the next `step` go on in an episode that has ended."""
        self._reset_next_step = False

    def get_state(self) -> dict[str, Any]:
        """All that the future depends on: physics with the solver's warm start, task, random state, step count."""
        model, data = self._physics.model.ptr, self._physics.data.ptr
        physics = np.empty(mujoco.mj_stateSize(model, PHYSICS_STATE))
        mujoco.mj_getState(model, data, physics, PHYSICS_STATE)
        return {
            "physics": physics,
            "task": self._task.get_state(),
            "step_count": self._step_count,
            "reset_next_step": self._reset_next_step,
            "random": self._random_state.get_state(legacy=False),
        }

    def set_state(self, state: Mapping[str, Any]) -> Mapping[str, np.ndarray]:
        """Takes up what `get_state` gave, here or in another environment of the same task.

        Buffers of delayed or buffered observables start anew.

        Returns:
          The observation.

        Raises:
          TypeError: something in the state is of the wrong type.
          ValueError: something in it is missing, has the wrong shape or is out of range; nothing has changed then.
        """
        if not isinstance(state, Mapping):
            raise TypeError(f"state must be a dict that get_state gave, got {state!r}")
        random = random_states.check_stored(state.get("random"), self._random_state)
        state = checks.matching({**state, "random": {}}, {**self.get_state(), "random": {}}, "state")
        step_count = checks.integer(state["step_count"].item(), "state['step_count']", minimum=0)
        if np.abs(state["physics"]).max() > mujoco.mjMAXVAL:
            raise ValueError(f"state['physics'] must not exceed {mujoco.mjMAXVAL:g}, which MuJoCo takes for divergence")
        # The task comes first: it may change the model that the physics is then brought up to date with.
        self._task.set_state(state["task"])
        model, data = self._physics.model.ptr, self._physics.data.ptr
        mujoco.mj_setState(model, data, state["physics"], PHYSICS_STATE)
        mujoco.mj_step1(model, data)
        self._step_count, self._reset_next_step = step_count, bool(state["reset_next_step"])
        self._observation_updater.reset(self._physics_proxy, self._random_state)
        # Last: a corruptor of the user's may have drawn for the observation.
        self._random_state.set_state(random)
        return self._flatten(self._observation_updater.get_observation())

    def add_extra_hook(self, hook_name: str, hook_callable: Any) -> None:
        super().add_extra_hook(hook_name, hook_callable)
        self._plan_substeps()

    def _flatten(self, observation: Mapping[str, np.ndarray]) -> Mapping[str, np.ndarray]:
        return control.flatten_observation(observation) if self._flat_observation else observation

    def _plan_substeps(self) -> None:
        """Decides how many physics steps one of composer's substeps makes: all, or one."""
        total = self._overridden_n_sub_steps or self._task.physics_steps_per_control_step
        self._steps_per_call = total if self._may_collapse() else 1
        self._n_sub_steps = total // self._steps_per_call

    def _may_collapse(self) -> bool:
        hooked = any(
            getattr(type(self._task), name) is not getattr(composer.Task, name)
            or getattr(self._hooks, f"_{name}").entity_hooks
            or getattr(self._hooks, f"_{name}").extra_hooks
            for name in _SUBSTEP_HOOKS
        )
        return not hooked and all(is_unbuffered(shown) for shown in self._task.observables.values() if shown.enabled)

    def _substep(self, action: ArrayLike) -> None:
        if self._steps_per_call == 1:
            super()._substep(action)
            return
        self._physics.step(self._steps_per_call)
        self._observation_updater.skip(self._steps_per_call - 1)

    def _make_observation_updater(self) -> UnbufferedUpdater:
        padding = self._delayed_observation_padding == composer.ObservationPadding.INITIAL_VALUE
        steps = self._overridden_n_sub_steps or self._task.physics_steps_per_control_step
        return UnbufferedUpdater(self._task.observables, steps, self._strip_singleton_obs_buffer_dim, padding)
