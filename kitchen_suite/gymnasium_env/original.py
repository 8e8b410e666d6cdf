"""Attributes of the original FrankaKitchen-v1 that programs read and write: `data`, `model`, `goal`, `robot_env`, ...

The compiled model has the original's joints in the original's order, so these are MuJoCo's own `MjModel` and `MjData`,
and everything that takes them works: `mujoco.mj_forward(env.unwrapped.model, env.unwrapped.data)`. An attribute acts as
in the original, or raises an error that names what to use instead; none is silently ignored.

`RobotEnv` is the original's `robot_env`, and holds the start that a program has changed. The other attributes are read
from it and from the task; `FrankaKitchenEnv` lists them.
"""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import functools
from collections.abc import Callable, Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NoReturn, Protocol, Self
from xml.etree import ElementTree

import mujoco
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.entities.assets import VISUAL_BODY, asset_dir
from kitchen_suite.gymnasium_env.base import STATE, SuiteEnv
from kitchen_suite.tasks.kitchen.observation import StateSlices
from kitchen_suite.tasks.kitchen.requests import START_STATE

if TYPE_CHECKING:
    from gymnasium.envs.mujoco.mujoco_rendering import MujocoRenderer

# The suite's own names of what the original calls otherwise, by kind and the original's name. Model and data find
# elements by either.
NAMES: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {
        "joint": {
            **{f"robot:panda0_joint{i}": f"franka/panda0_joint{i}" for i in range(1, 8)},
            **{f"robot:panda0_finger_joint{i}": f"franka/panda0_finger_joint{i}" for i in (1, 2)},
            **{f"knob_Joint_{i}": f"oven/knob_Joint_{i}" for i in range(1, 5)},
            "bottom_right_burner": "oven/bottom_right_burner",
            "bottom_left_burner": "oven/bottom_left_burner",
            "top_right_burner": "oven/top_right_burner",
            "top_left_burner": "oven/top_left_burner",
            "light_switch": "hood/light_switch",
            "light_joint": "hood/light_joint",
            "slide_cabinet": "slide_cabinet/slide_cabinet",
            "left_hinge_cabinet": "hinge_cabinet/left_hinge_cabinet",
            "right_hinge_cabinet": "hinge_cabinet/right_hinge_cabinet",
            "microwave": "microwave/microwave",
            "kettle": "kettle/",
        },
        "actuator": {
            **{f"panda0_joint{i}": f"franka/panda0_joint{i}" for i in range(1, 8)},
            "r_gripper_finger_joint": "franka/panda0_finger_joint1",
            "l_gripper_finger_joint": "franka/panda0_finger_joint2",
        },
        "body": {
            "world": "world",
            **{f"panda0_link{i}": f"franka/link{i}" for i in range(8)},
            "panda0_leftfinger": "franka/left_finger",
            "panda0_rightfinger": "franka/right_finger",
            "desk": "desk",
            "counters": "counter/counter",
            "oven": "oven/",
            "ovenroot": "oven/oven",
            **{f"knob {i}": f"oven/knob_{i}" for i in range(1, 5)},
            "Burner 1": "oven/bottom_right_burner",
            "Burner 2": "oven/bottom_left_burner",
            "Burner 3": "oven/top_right_burner",
            "Burner 4": "oven/top_left_burner",
            "hoodroot": "hood/hood",
            "lightswitchbaseroot": "hood/switch_base",
            "lightswitchroot": "hood/switch",
            "lightblock_hinge": "hood/lamp",
            "wallroot": "walls/back_wall",
            "wall2": "walls/left_wall",
            "slidecabinet": "slide_cabinet/",
            "slide": "slide_cabinet/cabinet",
            "slidelink": "slide_cabinet/door",
            "hingecabinet": "hinge_cabinet/",
            "hingecab": "hinge_cabinet/cabinet",
            "hingeleftdoor": "hinge_cabinet/left_door",
            "hingerightdoor": "hinge_cabinet/right_door",
            "microwave": "microwave/",
            "microroot": "microwave/case",
            "microdoorroot": "microwave/door",
            "kettle": "kettle/",
            "kettleroot": "kettle/kettle",
        },
        "site": {
            "end_effector": "franka/end_effector",
            **{f"knob{i}_site": f"oven/knob_{i}" for i in range(1, 5)},
            "light_site": "hood/switch",
            "slide_site": "slide_cabinet/handle",
            "hinge_site1": "hinge_cabinet/left_handle",
            "hinge_site2": "hinge_cabinet/right_handle",
            "microhandle_site": "microwave/handle",
            "kettle_site": "kettle/handle",
        },
    }
)

# What to use instead of names of D4RL's kitchen, of mujoco-py and of parts of the original that are not here.
_INSTEAD = {
    "sim": "`data` and `model` are MuJoCo's own",
    "viewer": "`mujoco_renderer` is Gymnasium's renderer",
    "robot": "`robot_env` is the robot's environment",
    "obs_dict": "`data.qpos` and `data.qvel` hold joint positions and velocities",
    "TASK_ELEMENTS": "`goal` holds the goals by task",
    "get_env_state": "`get_state()` returns the whole state",
    "set_env_state": "`set_state(state)` sets the whole state",
    "reset_model": "call `reset()` of the whole environment; it starts from `init_qpos`",
    "reset": "call `reset()` of the whole environment; it starts from `init_qpos`",
    "step": "call `step(action)` of the whole environment, or `do_simulation(ctrl, n_frames)`",
}

_SUITE = (
    "`env.unwrapped.environment` is the dm_env environment, `env.unwrapped.environment.physics` its physics, "
    "`env.unwrapped.composer_task` its task, and `get_state()` and `set_state(state)` of `env.unwrapped` save and "
    "restore all of them"
)


class Fixed:
    """An attribute that can be read, and assigned only the value it has: the AttributeError says what sets another."""

    def __init__(self, read: Callable[[Any], Any], way: str) -> None:
        self._read = read
        self._way = way
        self.__doc__ = read.__doc__

    @classmethod
    def by(cls, way: str) -> Callable[[Callable[[Any], Any]], Self]:
        """Returns the decorator of a function that reads the attribute; `way` is what sets its value."""
        return lambda read: cls(read, way)

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, instance: Any, owner: type) -> Any:
        return self if instance is None else self._read(instance)

    def __set__(self, instance: Any, value: object) -> None:
        present = self._read(instance)
        are_simple = all(isinstance(each, bool | float | int | str) for each in (value, present))
        if value is present or (are_simple and value == present):
            return
        raise AttributeError(f"{self._name} of {type(instance).__name__} cannot be assigned: {self._way}")


class Goals(dict[str, NDArray[np.float64]]):
    """Goals by task that cannot be written to; a copy is an ordinary dict."""

    def _refuse(self, *args: object, **kwargs: object) -> NoReturn:
        raise TypeError("goals of an environment are fixed: pass goals={task: positions} to gymnasium.make")

    __setitem__ = __delitem__ = __ior__ = _refuse
    clear = pop = popitem = setdefault = update = _refuse

    def __reduce__(self) -> tuple[Any, ...]:
        return dict, (dict(self),)


class Tasks(frozenset[str]):
    """A set of tasks, iterated in configured order."""

    _order: tuple[str, ...]

    def __new__(cls, tasks: Iterable[str]) -> Self:
        order = tuple(tasks)
        self = super().__new__(cls, order)
        self._order = order
        return self

    def __iter__(self) -> Iterator[str]:
        return iter(self._order)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self._order,)

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> NoReturn:
            hint = "; assign a new set: env.unwrapped.tasks_to_complete = {...}" if hasattr(set, name) else ""
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}{hint}")


class ModelNames:
    """Names of the original's joints, actuators, bodies and sites, with their ids in the model of an environment.

    Attributes, with `joint`, `actuator`, `body` and `site` in place of `joint`:
      joint_names: the names in the order of the ids.
      joint_name2id: ids by name.
      joint_id2name: names by id.
    """

    joint_names: tuple[str, ...]
    joint_name2id: dict[str, int]
    joint_id2name: dict[int, str]
    actuator_names: tuple[str, ...]
    actuator_name2id: dict[str, int]
    actuator_id2name: dict[int, str]
    body_names: tuple[str, ...]
    body_name2id: dict[str, int]
    body_id2name: dict[int, str]
    site_names: tuple[str, ...]
    site_name2id: dict[str, int]
    site_id2name: dict[int, str]

    def __init__(self, model: mujoco.MjModel) -> None:
        """Finds the elements; names of elements that another robot lacks are left out."""
        for kind, names in NAMES.items():
            object_type = getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}")
            ids = {original: mujoco.mj_name2id(model, object_type, own) for original, own in names.items()}
            found = {name: number for name, number in sorted(ids.items(), key=lambda item: item[1]) if number >= 0}
            setattr(self, f"{kind}_names", tuple(found))
            setattr(self, f"{kind}_name2id", found)
            setattr(self, f"{kind}_id2name", {number: name for name, number in found.items()})


def explained(owner: Any, name: str) -> Any:
    """The `__getattr__` of classes whose errors about attributes that they lack name the suite's way."""
    if hasattr(type(owner), name):
        # A property has raised an AttributeError of its own, which Python drops: raise it again.
        return object.__getattribute__(owner, name)
    raise _missing(owner, name)


class RobotEnv:
    """The attributes and methods of the original's `robot_env`, over the physics of the suite's environment.

    Attributes:
      init_qpos: `(30,)`, positions of all joints at the next resets, in the order of `data.qpos` [rad, m, quaternion].
        May be written to, and assigned.
    """

    __slots__ = ("_env", "_home", "init_qpos")

    # Not for type checkers, which would believe that every attribute exists.
    if not TYPE_CHECKING:
        __getattr__ = explained

    _env: SuiteEnv
    _home: NDArray[np.float64]
    init_qpos: Any

    def __init__(self, env: SuiteEnv) -> None:
        self._env = env
        self._home = env.composer_task.mdp.initial_qpos
        self.init_qpos = self._home.copy()

    def __setattr__(self, name: str, value: Any) -> None:
        """Sets `init_qpos`; a TypeError or ValueError unless it is a vector of as many numbers."""
        if name == "init_qpos":
            value = checks.vector(value, self._home.size, name)
        super().__setattr__(name, value)

    @property
    def changed_init_qpos(self) -> NDArray[np.float64] | None:
        """The positions at the start if they are not those of the task; None otherwise."""
        return None if np.array_equal(self.init_qpos, self._home) else np.array(self.init_qpos)

    @Fixed.by("its fields can be written to")
    def model(self) -> mujoco.MjModel:
        """MuJoCo's model. What is written to it acts from the next step on; it is no part of states and copies."""
        return self._env.environment.physics.model.ptr

    @Fixed.by("its fields can be written to, such as data.qpos[:] = ...")
    def data(self) -> mujoco.MjData:
        """MuJoCo's data. What is written to it acts from the next step on."""
        return self._env.environment.physics.data.ptr

    @Fixed.by("call set_state(qpos, qvel) after a reset; episodes start at rest")
    def init_qvel(self) -> NDArray[np.float64]:
        """Velocities `(29,)`; as in the original, the present ones, which a reset sets to 0."""
        return self.data.qvel

    @Fixed.by("control steps have as many physics steps as the task says")
    def frame_skip(self) -> int:
        """Number of physics steps in a control step."""
        return self._env.composer_task.physics_steps_per_control_step

    @Fixed.by("it is the product of model.opt.timestep and frame_skip")
    def dt(self) -> float:
        """Length of a control step [s]."""
        return self.model.opt.timestep * self.frame_skip

    @Fixed.by("pass robot_noise_ratio to gymnasium.make")
    def robot_noise_ratio(self) -> float:
        """Scale of the noise of the robot's part of the observation."""
        return self._env.composer_task.noise_ratios["robot_noise_ratio"]

    @Fixed.by("the commanded positions are those of the control mode")
    def robot_pos_bound(self) -> NDArray[np.float64]:
        """Bounds `(29, 2)` of commanded joint positions [rad, m], of which the first nine are used."""
        return _config("pos_bound", self.model.nv)

    @Fixed.by("the commanded velocities are those of the control mode")
    def robot_vel_bound(self) -> NDArray[np.float64]:
        """Bounds `(29, 2)` of commanded joint velocities [rad/s, m/s], of which the first nine are used."""
        return _config("vel_bound", self.model.nv)

    @Fixed.by("pass robot_noise_ratio and object_noise_ratio to gymnasium.make")
    def robot_pos_noise_amp(self) -> NDArray[np.float64]:
        """Amplitudes `(29,)` of the noise of observed positions, before the noise ratios [rad, m]."""
        return _config("pos_noise_amp", self.model.nv)[:, 0]

    @Fixed.by("pass robot_noise_ratio and object_noise_ratio to gymnasium.make")
    def robot_vel_noise_amp(self) -> NDArray[np.float64]:
        """Amplitudes `(29,)` of the noise of observed velocities, before the noise ratios [rad/s, m/s]."""
        return _config("vel_noise_amp", self.model.nv)[:, 0]

    @Fixed.by("pass seed to reset")
    def np_random(self) -> np.random.Generator:
        """The generator that the noise is drawn from."""
        return self._env.np_random

    @Fixed.by("it follows from control_mode, an argument of gymnasium.make")
    def action_space(self) -> spaces.Space:
        return self._env.action_space

    @Fixed.by("pass render_mode to gymnasium.make")
    def render_mode(self) -> str | None:
        return self._env.render_mode

    @Fixed.by("pass camera arguments, such as default_camera_config, to gymnasium.make")
    def mujoco_renderer(self) -> "MujocoRenderer":
        """Gymnasium's own renderer, which makes its GL context for the first image.

        Raises an AttributeError where the scene was built without what images show.
        """
        model = self.model
        is_visible = any(model.body(i).name.endswith(VISUAL_BODY) for i in range(model.nbody))
        if self.render_mode is None and not is_visible:
            raise AttributeError(
                "mujoco_renderer needs a scene with visual geoms: pass render_mode='rgb_array' or visuals=True to "
                "gymnasium.make"
            )
        return self._env.renderer.mujoco_renderer(self._env.environment)

    @Fixed.by("names are those of the model")
    def model_names(self) -> ModelNames:
        """The original's names of joints, actuators, bodies and sites, with their ids in `model`."""
        return ModelNames(self.model)

    @property
    def unwrapped(self) -> Self:
        return self

    # Programs use these two private names for want of public ones.
    @property
    def _last_robot_qpos(self) -> NDArray[np.float64]:
        """Observed positions `(9,)` from which the next action starts [rad, m]; may be assigned."""
        state = self._env.composer_task.state
        return state.positions + state.noise[self._parts.robot_positions]

    @_last_robot_qpos.setter
    def _last_robot_qpos(self, value: ArrayLike) -> None:
        task = self._env.composer_task
        positions = checks.vector(value, task.state.positions.size, "_last_robot_qpos").copy()
        noise = task.state.noise.copy()
        noise[self._parts.robot_positions] = 0.0
        task.set_mdp_state(task.state._replace(positions=positions, noise=noise))

    def _get_obs(self) -> NDArray[np.float64]:
        """Returns the robot's positions and velocities, `(18,)`, with fresh noise; the next action starts from them."""
        mdp = self._env.composer_task.mdp
        positions = self.data.qpos[mdp.sensors.indices.robot_qpos] + self._draw_noise(self._parts.robot_positions)
        velocities = self.data.qvel[mdp.sensors.indices.robot_qvel] + self._draw_noise(self._parts.robot_velocities)
        self._last_robot_qpos = positions
        return np.concatenate([positions, velocities])

    def observation_with(self, robot: NDArray[np.float64]) -> dict[str, Any]:
        """Returns the original's observation of the present state, given the robot's part `(18,)` of it."""
        goals = self._env.composer_task.mdp.goals
        indices = self._env.composer_task.mdp.sensors.indices
        positions = self.data.qpos[indices.object_qpos] + self._draw_noise(self._parts.object_positions)
        velocities = self.data.qvel[indices.object_qvel] + self._draw_noise(self._parts.object_velocities)
        return {
            "observation": np.concatenate([robot, positions, velocities]),
            "achieved_goal": goals.split(self.data.qpos[indices.goal_qpos]),
            "desired_goal": goals.split(goals.desired.copy()),
        }

    @property
    def _parts(self) -> StateSlices:
        return self._env.composer_task.mdp.sensors.slices

    def _draw_noise(self, part: slice) -> NDArray[np.float64]:
        """Draws the noise of a part of the observation."""
        scale = self._env.composer_task.mdp.noise_scale[part]
        return scale * self._env.np_random.uniform(low=-1.0, high=1.0, size=scale.shape)

    def set_state(self, qpos: ArrayLike, qvel: ArrayLike) -> None:
        """Sets the positions `(30,)` and velocities `(29,)` of all joints, and computes what follows from them.

        Raises a TypeError or a ValueError, with nothing changed, for other shapes or numbers that are not finite.
        """
        model, data = self.model, self.data
        positions = checks.vector(qpos, model.nq, "qpos")
        velocities = checks.vector(qvel, model.nv, "qvel")
        data.qpos[:] = positions
        data.qvel[:] = velocities
        mujoco.mj_forward(model, data)

    def state_vector(self) -> NDArray[np.float64]:
        """Returns the positions and velocities of all joints, `(59,)`, without noise."""
        return np.concatenate([self.data.qpos, self.data.qvel])

    def get_body_com(self, body_name: str) -> NDArray[np.float64]:
        """Returns the position `(3,)` of a body's frame, by the original's name or the model's [m]."""
        return self.data.body(body_name).xpos

    def do_simulation(self, ctrl: ArrayLike, n_frames: int) -> None:
        """Makes physics steps with the actuators' targets `(9,)` [rad, m]; no control step, no observation."""
        model, data = self.model, self.data
        data.ctrl[:] = checks.vector(ctrl, model.nu, "ctrl")
        mujoco.mj_step(model, data, nstep=n_frames)
        mujoco.mj_rnePostConstraint(model, data)

    def render(self) -> NDArray | None:
        """Returns what `render` of the environment returns."""
        return self._env.render()

    def start_options(self, options: Mapping[str, Any] | None) -> Mapping[str, Any] | None:
        """Returns options of a reset, with the start from `init_qpos` added where a program has changed it."""
        start = self.changed_init_qpos
        if start is None or not (options is None or isinstance(options, Mapping)):
            return options
        given = options or {}
        own = {} if given.get(STATE) is not None else {START_STATE: start}
        return {**own, **given}

    def apply_writes(self) -> None:
        """Computes the forces at the positions that a program may have written.

        dm_control's step begins with those at the positions of the last step; what was written must act at once.
        """
        mujoco.mj_step1(self.model, self.data)

    def derive(self) -> None:
        """Computes what programs may read of the present state: dm_control's step leaves out forces and accelerations.

        The solver's warm start stays that of the last physics step, on which the next one depends.
        """
        warm_start = self.data.qacc_warmstart.copy()
        mujoco.mj_forward(self.model, self.data)
        mujoco.mj_rnePostConstraint(self.model, self.data)
        self.data.qacc_warmstart[:] = warm_start


# Attributes that the class of the environment has beside `robot_env`.


class HasRobotEnv(Protocol):
    """An environment with the original's environment of the robot."""

    @property
    def robot_env(self) -> RobotEnv: ...


@Fixed.by("its fields can be written to")
def model(env: HasRobotEnv) -> mujoco.MjModel:
    """MuJoCo's model; see `RobotEnv.model`."""
    return env.robot_env.model


@Fixed.by("its fields can be written to, such as data.qpos[:] = ...")
def data(env: HasRobotEnv) -> mujoco.MjData:
    """MuJoCo's data; see `RobotEnv.data`. Joints are in the original's order; docs/guide/migrating.md has names."""
    return env.robot_env.data


@Fixed.by("pass camera arguments, such as default_camera_config, to gymnasium.make")
def mujoco_renderer(env: HasRobotEnv) -> "MujocoRenderer":
    """Gymnasium's own renderer; see `RobotEnv.mujoco_renderer`."""
    return env.robot_env.mujoco_renderer


def _init_qpos(env: HasRobotEnv) -> NDArray[np.float64]:
    """Positions `(30,)` at the start of episodes; see `RobotEnv.init_qpos`."""
    return env.robot_env.init_qpos


def _set_init_qpos(env: HasRobotEnv, value: ArrayLike) -> None:
    env.robot_env.init_qpos = value


init_qpos = property(_init_qpos, _set_init_qpos)


@Fixed.by("call robot_env.set_state(qpos, qvel) after a reset; episodes start at rest")
def init_qvel(env: HasRobotEnv) -> NDArray[np.float64]:
    """Velocities `(29,)`; see `RobotEnv.init_qvel`."""
    return env.robot_env.init_qvel


@Fixed.by("it is the product of model.opt.timestep and robot_env.frame_skip")
def dt(env: HasRobotEnv) -> float:
    """Length of a control step [s]."""
    return env.robot_env.dt


@Fixed.by("pass goals={task: positions} to gymnasium.make")
def goal(env: SuiteEnv) -> Goals:
    """Goals by task; not to be written to."""
    goals = env.composer_task.goals
    for each in goals.values():
        each.flags.writeable = False
    return Goals(goals)


def _tasks_to_complete(env: SuiteEnv) -> Tasks:
    """Tasks still to be completed in the present episode. May be assigned; a reset starts with all of them."""
    return Tasks(env.composer_task.tasks_to_complete)


def _set_tasks_to_complete(env: SuiteEnv, value: Iterable[str]) -> None:
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise TypeError(f"tasks_to_complete must be a set or list of tasks, got {checks.shown(value)}")
    tasks = env.composer_task.mdp.goals.tasks
    remaining = {checks.choice(name, tasks, "task of tasks_to_complete") for name in value}
    state = env.composer_task.state
    mask = np.array([name in remaining for name in tasks])
    env.composer_task.set_mdp_state(state._replace(progress=state.progress._replace(remaining=mask)))


tasks_to_complete = property(_tasks_to_complete, _set_tasks_to_complete)


@Fixed.by("tasks are completed by steps")
def step_task_completions(env: SuiteEnv) -> list[str]:
    """Tasks completed in the last step, in a fresh list."""
    return env.composer_task.step_task_completions


@Fixed.by("tasks are completed by steps")
def episode_task_completions(env: SuiteEnv) -> list[str]:
    """Tasks completed in the present episode, in order of completion, in a fresh list."""
    return env.composer_task.episode_task_completions


@Fixed.by("pass terminate_on_tasks_completed to gymnasium.make")
def terminate_on_tasks_completed(env: SuiteEnv) -> bool:
    """Whether an episode terminates once every task has been completed."""
    return env.composer_task.mdp.terminate_on_tasks_completed


@Fixed.by("pass remove_task_when_completed to gymnasium.make")
def remove_task_when_completed(env: SuiteEnv) -> bool:
    """Whether a task is rewarded only once."""
    return env.composer_task.mdp.remove_task_when_completed


@Fixed.by("pass object_noise_ratio to gymnasium.make")
def object_noise_ratio(env: SuiteEnv) -> float:
    """Scale of the noise of the objects' part of the observation."""
    return env.composer_task.noise_ratios["object_noise_ratio"]


@Fixed.by("pass robot_noise_ratio to gymnasium.make")
def robot_noise_ratio(env: SuiteEnv) -> float:
    """Scale of the noise of the robot's part of the observation."""
    return env.composer_task.noise_ratios["robot_noise_ratio"]


def _missing(owner: Any, name: str) -> AttributeError:
    """Returns the error of an attribute that does not exist."""
    kind = type(owner)
    message = f"{kind.__name__!r} object has no attribute {name!r}"
    if name.startswith("__"):
        return AttributeError(message, name=name, obj=owner)
    public = [each for each in dir(kind) if not each.startswith("_")]
    near = checks.nearest(name, public)
    instead = _INSTEAD.get(name, f"did you mean {near!r}?" if near else "")
    return AttributeError(f"{message}; {instead and instead + '; '}{_SUITE}", name=name, obj=owner)


@functools.cache
def _config(attribute: str, count: int) -> NDArray[np.float64]:
    """Returns numbers `(count, k)` of the original's configuration of the robot, one row a joint; read-only."""
    root = ElementTree.parse(asset_dir() / "franka_assets" / "franka_config.xml").getroot()
    rows = [root.find(f"qpos{i}") for i in range(count)]
    values = np.array([[float(number) for number in row.attrib[attribute].split()] for row in rows if row is not None])
    values.flags.writeable = False
    return values
