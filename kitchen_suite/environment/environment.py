"""A composer environment with faster stepping, a time limit in control steps, and states that can be saved."""

import collections
import hashlib
import math
import warnings
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import dm_env
import mujoco
import numpy as np
from dm_control import composer
from dm_control.composer.observation import observable
from dm_control.rl import control
from dm_env import specs
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from numpy.typing import ArrayLike

from kitchen_suite import checks
from kitchen_suite.environment.digests import DIGESTS, SCENE, TASK, check_same, digest, digests, scene_digest
from kitchen_suite.environment.mjcf_physics import Physics
from kitchen_suite.environment.named_model import Names
from kitchen_suite.environment.observation_updater import UnbufferedUpdater
from kitchen_suite.environment.physics_state import (
    ASLEEP,
    INTEGRATION_STATE,
    check_sleep,
    evaluate_sleepers,
    initial_state,
    shared_elements,
)
from kitchen_suite.environment.private_names import check_private_names
from kitchen_suite.environment.random_states import checked_random, first_seed, make_random_state
from kitchen_suite.environment.seeds import UNKNOWN, EpisodeSeeds
from kitchen_suite.environment.snapshots import MjcfSnapshot
from kitchen_suite.physics_names import EXACT
from kitchen_suite.tasks.task import SuiteTask

check_private_names()


# Ends the errors about environments that cannot be copied.
_BY_STATE = "build another one in the same way, and pass its set_state what get_state of this one returns"

# Key of states: the physics, where it is not the exact one.
_PHYSICS_NAME = "physics_name"


# Key of states, and of infos: length of a control step [s], where it is not the task's own.
CONTROL_TIMESTEP_KEY = "control_timestep"


def edits_mjcf(entity: composer.Entity) -> bool:
    """Whether an entity may edit its MJCF before an episode."""
    return type(entity).initialize_episode_mjcf is not composer.Entity.initialize_episode_mjcf


class Origin(NamedTuple):
    """The function and arguments that built an environment, and build its copies.

    Attributes:
      build: `Domain.load` of its domain.
      arguments: keyword arguments of that function.
    """

    build: Callable[..., "Environment"]
    arguments: Mapping[str, Any]


class Environment(composer.Environment):
    """`composer.Environment` with further features.

    - All physics steps of a control step are made in one call, unless a hook or a buffered observable needs the state
      between them; see `_plan_substeps`.
    - The time limit is counted in control steps. composer compares sums of physics times, which ends an episode of 280
      steps with the 281st.
    - After a `PhysicsError` the next `step` starts a new episode. After another error or an interrupt within a step it
      raises a `gymnasium.error.ResetNeeded` until `reset`.
    - The model is compiled when the environment is built, and again at a reset if the MJCF has been edited meanwhile,
      or always with `recompile_mjcf_every_episode=True`. Otherwise `physics` stays the same object, with what a user
      has changed in `physics.model`.
    - With `flat_observation` the observation is one array, as in dm_control's suite.
    - `get_state` and `set_state` save and restore the environment in the middle of an episode.
    - With `episode_seeds` each episode starts its own random stream.
    - `copy.deepcopy` and pickle build the environment again, from what `suite.load` was given, and set its state. They
      raise a TypeError for an environment that was built from a task, or edited since it was built.

    Attributes:
      origin: what copies are built from; None where the environment was built from a task, or from arguments that
        cannot be copied.
      changed_timestep: length of a control step [s] by its key in infos and states; empty where it is the task's own.
    """

    origin: Origin | None = None
    _scene_digest: str | None = None
    _own_digests: dict[str, str]
    _mjcf_never_compiled: bool
    # Whether the last step was interrupted, which may have left physics and task at different steps.
    _needs_reset: bool = False
    _random_state: np.random.RandomState

    def __init__(
        self,
        task: SuiteTask,
        time_limit: float = math.inf,
        random_state: int | np.random.RandomState | None = None,
        *,
        flat_observation: bool = False,
        episode_seeds: bool | int = False,
        further_names: Names | None = None,
        **kwargs: Any,
    ) -> None:
        """Builds the environment; a bad argument raises a TypeError or ValueError that names it.

        Args:
          task: the task.
          time_limit: length of an episode [s].
          random_state: seed, or random state to draw from.
          flat_observation: whether to concatenate all observations under the key `observations`.
          episode_seeds: whether each reset starts the random stream anew, from the next seed: episode `k` then depends
            on the seed `random_state + k` alone, not on the episodes before it, and is the one that `kitchen-rollout`
            plays as its `k`-th. A number is the distance between these seeds. Without it all episodes draw from one
            stream.
          further_names: names by which programs find joints, actuators, bodies and sites of the compiled model, beside
            their own; see `named_model`.
          **kwargs: further arguments of `composer.Environment`.
        """
        if not time_limit > 0:
            raise ValueError(f"time_limit must be positive, got {checks.shown(time_limit)}")
        self._further_names = further_names
        self._seeds = EpisodeSeeds(episode_seeds)
        if self._seeds:
            if kwargs.get("fixed_initial_state"):
                raise ValueError("fixed_initial_state and episode_seeds both set the random stream: leave out one")
            random_state = self._seeds.next = first_seed(random_state)
        with warnings.catch_warnings():
            # composer stores the legacy state of the random stream; numpy warns unless that is a Mersenne Twister.
            warnings.filterwarnings("ignore", "get_state and legacy", RuntimeWarning)
            super().__init__(task, random_state=make_random_state(random_state), **kwargs)
        entities = self._task.root_entity.iter_entities()
        # composer compiles at the first reset once more, since entities may edit their MJCF there.
        self._mjcf_never_compiled = any(map(edits_mjcf, entities))
        # The one set last by `episode_seeds`; Shimmy assigns others to the private attribute.
        self._seeded_state = self._random_state
        steps = time_limit / self.control_timestep()
        self._step_limit = math.ceil(steps - 1e-9) if math.isfinite(steps) else math.inf
        self._step_count = 0
        self._flat_observation = checks.boolean(flat_observation, "flat_observation")
        self._plan_substeps()
        self._extra_hooks: list[str] = []
        self._given_digests: dict[str, str] = {}
        self._scene_arguments: frozenset[str] = frozenset()
        self._built_observables = _settings_of(task.observables)
        self.changed_timestep: dict[str, float] = {}
        if task.control_timestep != task.default_control_timestep:
            self.changed_timestep[CONTROL_TIMESTEP_KEY] = task.control_timestep

    def __reduce__(self) -> tuple[Any, ...]:
        if self.origin is None:
            what = "an Environment that was built from a task, or from arguments that cannot be copied,"
            raise TypeError(f"{what} cannot be copied or pickled: {_BY_STATE}")
        if self._extra_hooks:
            raise TypeError(f"an environment with extra hooks, {self._extra_hooks}, cannot be copied: {_BY_STATE}")
        if _settings_of(self._task.observables) != self._built_observables:
            raise TypeError(
                f"an environment whose observables were edited cannot be copied: pass extra_observables, or {_BY_STATE}"
            )
        state = {
            # Without digests: that of the model below tells of edits as well.
            "state": {name: part for name, part in self.get_state().items() if name != DIGESTS},
            "visualize_reward": self._task.visualize_reward,
            # composer starts each episode from it with `fixed_initial_state`.
            "fixed_random_state": self._fixed_random_state,
            "model": self._model_digest(),
        }
        return _build_again, (self.origin, state["state"]["random"]["bit_generator"]), state

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        self._task.visualize_reward = state["visualize_reward"]
        self._fixed_random_state = state["fixed_random_state"]
        self.set_state(state["state"])
        if self._model_digest() != state["model"]:
            raise TypeError(f"an environment whose model was edited cannot be copied: {_BY_STATE}")

    def _model_digest(self) -> str:
        """Returns the SHA-256 of the MJCF model and of the compiled one."""
        model = self._physics.model.ptr
        compiled = np.empty(mujoco.mj_sizeModel(model), np.uint8)
        mujoco.mj_saveModel(model, None, compiled)
        digest = hashlib.sha256(self._task.root_entity.mjcf_model.to_xml_string().encode())
        digest.update(compiled.tobytes())
        return digest.hexdigest()

    def __repr__(self) -> str:
        timestep = self.control_timestep()
        return f"{type(self).__name__}({self._task!r}, control_timestep={timestep:g}, step_limit={self._step_limit})"

    @property
    def task(self) -> SuiteTask:
        task: SuiteTask = self._task
        return task

    @property
    def physics(self) -> Physics:
        """The compiled scene, through a weak reference, as composer has it."""
        self._check_open()
        physics: Physics = self._physics_proxy
        return physics

    @property
    def random_state(self) -> np.random.RandomState:
        """The random state that the environment draws from; can be replaced at any time.

        With `episode_seeds` by a seed alone, which the next episode has.
        """
        return self._random_state

    @random_state.setter
    def random_state(self, value: int | np.random.RandomState | None) -> None:
        if self._seeds:
            value = self._seeds.next = first_seed(value)
            self._random_state = self._seeded_state = make_random_state(value)
            return
        self._random_state = make_random_state(value)
        if self._fixed_initial_state:
            # composer starts every episode from this state.
            self._fixed_random_state = self._random_state.get_state(legacy=False)

    @property
    def step_limit(self) -> float:
        """Control steps in an episode; infinite without a time limit."""
        return self._step_limit

    def close(self) -> None:
        """Frees the physics; steps and resets then raise a `gymnasium.error.ClosedEnvironmentError`."""
        if self._physics is not None:
            super().close()
            # A step then begins with a reset, which raises.
            self._reset_next_step = True

    def _check_open(self) -> None:
        if self._physics is None:
            raise ClosedEnvironmentError("the environment is closed: build another one")

    def reset(self) -> dm_env.TimeStep:
        self._check_open()
        if self._seeds:
            self._start_stream()
        self._reset_next_step = True
        if self.mjcf_has_changed():
            self._mjcf_never_compiled = True
        timestep = super().reset()
        self._task.read_evaluated()
        self._step_count = 0
        self._needs_reset = False
        self._plan_substeps()
        return timestep._replace(observation=self._flatten(timestep.observation))

    def _start_stream(self) -> None:
        """Starts the random stream of the next episode, unless a stream was assigned to `_random_state` for it."""
        if self._random_state is not self._seeded_state:
            self._seeded_state = self._random_state
            self._seeds.next = UNKNOWN
            return
        seed = self._seeds.known()
        self._random_state = self._seeded_state = make_random_state(seed)
        self._seeds.next = self._seeds.after(seed)

    @property
    def resets_next_step(self) -> bool:
        """Whether the next `step` starts an episode."""
        return self._reset_next_step

    def step(self, action: ArrayLike) -> dm_env.TimeStep:
        if self._reset_next_step:
            return self.reset()
        if self._needs_reset:
            raise ResetNeeded("call reset(): the last step was interrupted")
        try:
            timestep = super().step(action)
        except control.PhysicsError:
            self._reset_next_step = True
            raise
        except BaseException:
            # An action that is refused changes nothing.
            self._needs_reset = self._task.has_begun_step
            raise
        self._step_count += 1
        if timestep.mid() and self._step_count >= self.step_limit:
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

    def mjcf_has_changed(self) -> bool:
        """Returns whether the MJCF has been edited since it was compiled."""
        return self._compiled_mjcf.is_outdated()

    @property
    def starts_with_own_code(self) -> bool:
        """Whether code that is not the suite's runs when an episode starts: a user's task, entity or extra hook."""
        hook = self._hooks._initialize_episode  # noqa: SLF001
        has_own_task = not type(self.task).__module__.startswith("kitchen_suite.")
        return has_own_task or bool(hook.entity_hooks or hook.extra_hooks)

    def start_episode(self) -> None:
        """Starts an episode as `reset` does once the model is compiled, but does not update the observation."""
        self._check_open()
        with self._physics.reset_context():
            self._hooks.initialize_episode(self._physics_proxy, self._random_state)
        self._task.read_evaluated()
        self._step_count = 0
        self._reset_next_step = self._needs_reset = False

    def continue_episode(self) -> None:
        """Makes the next `step` continue an episode that has ended."""
        self._reset_next_step = False

    def keep_arguments(self, *, scene: Mapping[str, Any], task: Mapping[str, Any]) -> None:
        """Keeps digests of the arguments that scene and task were built with, by which states are told apart."""
        self._given_digests = digests({**task, **scene})
        self._scene_arguments = frozenset(scene)

    def _digests(self) -> dict[str, str]:
        """Returns the digests of the scene as it is now compiled, of the task's class, and of their arguments."""
        if self._scene_digest is None:
            self._scene_digest = scene_digest(self._task.root_entity.mjcf_model)
            built = {"n_sub_steps": self._physics_steps, "legacy_step": self._legacy_step}
            own = digests({**built, **self._task.state_definition()})
            self._own_digests = {TASK: digest(type(self._task)), **self._given_digests, **own}
        return {SCENE: self._scene_digest, **self._own_digests}

    def get_state(self) -> dict[str, Any]:
        """Returns the state on which later steps depend: the same whether or not the scene has visuals.

        Its `digests` say of which environment it is.
        """
        self._check_open()
        scene, physics = self._task.scene, np.empty(self._is_shared.size)
        mujoco.mj_getState(self._physics.model.ptr, self._physics.data.ptr, physics, INTEGRATION_STATE)
        return {
            "physics": physics[self._is_shared],
            "task": self._task.get_state(),
            "step_count": self._step_count,
            "reset_next_step": self._reset_next_step or self._needs_reset,
            "random": self._random_state.get_state(legacy=False),
            **({} if scene.physics == EXACT else {_PHYSICS_NAME: scene.physics}),
            **({ASLEEP: self._physics.data.ptr.tree_asleep.copy()} if scene.sleeps else {}),
            **self.changed_timestep,
            **self._seeds.saved(),
            DIGESTS: self._digests(),
        }

    def set_state(self, state: Mapping[str, Any]) -> Mapping[str, np.ndarray]:
        """Sets a state returned by `get_state` of this environment, or of another one of the same task.

        One of the two may have visuals and the other none. Buffers of delayed or buffered observables are reset. A
        state without digests, as those of version 1.0, is checked by its shapes alone.

        Returns:
          The observation.

        Raises:
          TypeError: a part of the state has the wrong type.
          ValueError: the state is of an environment with another scene or other arguments; or a part of it is missing,
            has the wrong shape or is out of range; nothing has changed then.
        """
        if not isinstance(state, Mapping):
            raise TypeError(f"state must be a dict returned by get_state, got {checks.shown(state)}")
        found, own = state.get(_PHYSICS_NAME, EXACT), self._task.scene.physics
        if found != own:
            raise ValueError(f"the state is of physics {checks.shown(found)}, but the environment has {own!r}")
        random = checked_random(state.get("random"), self._random_state)
        task = self._task
        given = state.get(CONTROL_TIMESTEP_KEY, task.default_control_timestep)
        timestep = checks.number(given, f"state[{CONTROL_TIMESTEP_KEY!r}]", positive=True)
        if timestep != task.control_timestep:
            here = f"but those of the environment take {task.control_timestep:g} s"
            raise ValueError(f"control steps of the state take {timestep:g} s, {here}")
        if DIGESTS in state:
            check_same(state[DIGESTS], self._digests(), self._scene_arguments)
        next_seed = self._seeds.checked(state)
        # A seed may be larger than any of NumPy's integers.
        checked = {"random": {}, DIGESTS: {}, **dict.fromkeys(self._seeds.saved(), 0)}
        state = checks.matching({**state, **checked}, {**self.get_state(), **checked}, "state")
        step_count = checks.integer(state["step_count"].item(), "state['step_count']", minimum=0)
        if ASLEEP in state:
            check_sleep(state[ASLEEP])
        if np.abs(state["physics"]).max() > mujoco.mjMAXVAL:
            raise ValueError(f"state['physics'] must not exceed {mujoco.mjMAXVAL:g}, MuJoCo's limit for divergence")
        # The task goes first: it may change the model, from which mj_step1 then computes.
        self._task.set_state(state["task"])
        model, data = self._physics.model.ptr, self._physics.data.ptr
        whole = self._initial_physics.copy()
        whole[self._is_shared] = state["physics"]
        mujoco.mj_setState(model, data, whole, INTEGRATION_STATE)
        if self._task.scene.sleeps:
            evaluate_sleepers(model, data, state[ASLEEP])
        mujoco.mj_step1(model, data)
        self._task.read_evaluated()
        self._step_count = step_count
        self._reset_next_step = bool(state["reset_next_step"])
        self._needs_reset = False
        self._observation_updater.reset(self._physics_proxy, self._random_state)
        # The random state goes last: a user's corruptor may have drawn for the observation.
        self._random_state.set_state(random)
        if self._seeds:
            self._seeded_state = self._random_state
            self._seeds.next = next_seed
        return self._flatten(self._observation_updater.get_observation())

    def add_extra_hook(self, hook_name: str, hook_callable: Any) -> None:
        super().add_extra_hook(hook_name, hook_callable)
        if hook_name == "initialize_episode_mjcf":
            self._mjcf_never_compiled = True
        self._extra_hooks.append(hook_name)
        self._plan_substeps()

    def _flatten(self, observation: Mapping[str, np.ndarray]) -> Mapping[str, np.ndarray]:
        return control.flatten_observation(observation) if self._flat_observation else observation

    @property
    def _physics_steps(self) -> int:
        return self._overridden_n_sub_steps or self._task.physics_steps_per_control_step

    def _plan_substeps(self) -> None:
        """Chooses the number of physics steps that one call of `_substep` makes: all of a control step, or one.

        composer's `step` loops over substeps, and updates the observation after each:

            for i in range(self._n_sub_steps):
                self._substep(action)  # the before_substep hooks, physics.step(), the after_substep hooks
                if i < self._n_sub_steps - 1:
                    self._observation_updater.update()
            ...  # the after_step hooks
            self._observation_updater.update()

        Without substep hooks, of entities or user, and buffered observables only the last state matters. The loop then
        runs once. Tasks have no substep hooks; see `SuiteTask`.
        """
        hooks = (self._hooks._before_substep, self._hooks._after_substep)  # noqa: SLF001
        needs_each = self._observation_updater.needs_each_step or any(
            hook.entity_hooks or hook.extra_hooks for hook in hooks
        )
        self._steps_per_call = 1 if needs_each else self._physics_steps
        self._n_sub_steps = self._physics_steps // self._steps_per_call

    def _substep(self, action: ArrayLike) -> None:
        if self._steps_per_call == 1:
            super()._substep(action)
            return
        self._physics.step(self._steps_per_call)
        # composer's `step` updates the observation once more, which counts as the last physics step.
        self._observation_updater.skip(self._steps_per_call - 1)

    def _recompile_physics(self) -> None:
        if physics := getattr(self, "_physics", None):
            physics.free()
        self._scene_digest = None
        root = self._task.root_entity.mjcf_model
        self._physics = Physics.from_mjcf_model(root)
        if self._further_names is not None:
            self._physics.use_names(self._further_names)
        self._physics.legacy_step = self._legacy_step
        self._is_shared = shared_elements(self._physics.model.ptr)
        self._initial_physics = initial_state(self._physics.model.ptr)
        self._compiled_mjcf = MjcfSnapshot(root)

    def _make_observation_updater(self) -> UnbufferedUpdater:
        padding = self._delayed_observation_padding == composer.ObservationPadding.INITIAL_VALUE
        return UnbufferedUpdater(
            self._task.observables, self._physics_steps, self._strip_singleton_obs_buffer_dim, padding
        )


def _build_again(origin: Origin, bit_generator: str) -> Environment:
    """Returns an environment as an origin says, with a random stream of a kind, whose state is still to be set."""
    given = origin.arguments.get("environment_kwargs") or {}
    if origin.arguments.get("episode_seeds") or given.get("episode_seeds"):
        # The state has the next seed.
        return origin.build(**origin.arguments, random=0)
    random_state = np.random.RandomState(getattr(np.random, bit_generator)())
    return origin.build(**origin.arguments, random=random_state)


def _settings_of(observables: Mapping[str, observable.Observable]) -> dict[str, tuple[Any, ...]]:
    """Returns the settings of observables by name, which are compared by equality."""
    names = ("enabled", "update_interval", "buffer_size", "delay", "aggregator", "corruptor")
    return {key: tuple(getattr(part, name) for name in names) for key, part in observables.items()}
