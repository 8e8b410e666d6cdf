"""Markov decision processes of tasks, and how they read and control the physics of one episode or of many.

A task has an `MDP`, the mathematics of its episodes; `Sensors`, which read a `Simulation` of the physics; and an
`ActionMode`, which turns actions into targets of the actuators.
"""

import abc
import dataclasses
import functools
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, Generic, Literal, Protocol, TypeVar

import mujoco
import numpy as np
from dm_control import mjcf
from dm_env import specs
from mujoco.batch import Batch
from numpy.typing import NDArray

from kitchen_suite import checks, signatures
from kitchen_suite.entities.assets import Array
from kitchen_suite.entities.joints import addresses
from kitchen_suite.entities.robot import Robot
from kitchen_suite.entities.scenes import Scene
from kitchen_suite.tasks.goals import GoalSet


class Transition:
    """A control step of one episode, or of many; what terms of reward and termination are functions of.

    An MDP may have a class of its own, which adds quantities that several terms share.

    Attributes:
      before: the MDP's state before the step.
      action: `(..., k)`, the action.
      target: `(..., 9)`, targets of the robot's actuators that follow from it [rad, m].
      after: the MDP's state after the step; it has no terms of the reward yet.
      observations: the task's `extra_observations` after the step, `(..., m)` by name, without noise.
      previous_observations: the same before the step.
    """

    observations: Mapping[str, Array] = MappingProxyType({})
    previous_observations: Mapping[str, Array] = MappingProxyType({})

    def __init__(self, before: Any, action: Array, target: Array, after: Any) -> None:
        self.before = before
        self.action = action
        self.target = target
        self.after = after


RewardTerm = Callable[[Any], Array]
"""A term of a reward: a function of a `Transition` that returns `(...)`."""

Termination = Callable[[Any], NDArray[np.bool_]]
"""A reason to terminate an episode: a function of a `Transition` that returns bools `(...)`."""

Columns = NDArray[np.int64] | slice

Reading = TypeVar("Reading")
Reading_co = TypeVar("Reading_co", covariant=True)
State = TypeVar("State", bound=tuple)

MEDIAN = 0.5  # Draw of an action mode that draws nothing: the median of U(0, 1).


def total(terms: Mapping[str, Array]) -> Array:
    """Returns the reward `(...)`, the sum of its terms."""
    return functools.reduce(operator.add, terms.values())


class Simulation(Protocol):
    """Access to the fields of MuJoCo's data; arrays have a leading axis for each of many simulations."""

    def read(self, field: str, columns: Columns, order: Literal["C", "F"] = "C") -> Array:
        """Returns columns `(..., k)` of a field: a copy, except for a slice, which is a live view.

        Of a field of vectors, such as `xpos`, `(..., k, 3)`.

        Args:
          field: such as `qpos`.
          columns: indices along the field's first axis, that of joints, bodies or sites.
          order: memory order of a copy; `F` is faster where it is computed with column by column.
        """

    def write(self, field: str, columns: Columns, values: Array) -> None:
        """Sets columns `(..., k)` of a field."""

    def named(self, field: str, name: str) -> Array:
        """Returns the elements of a field that belong to a name, in a fresh array with any leading axes.

        As `physics.named.data.<field>[name]` of dm_control: `named("xpos", "mug/")` returns positions `(..., 3)` in the
        world [m], `named("qpos", "microwave/microwave")` angles `(..., 1)` [rad].

        Args:
          field: of MuJoCo's data, such as `xpos`, `qpos` or `sensordata`.
          name: of a body, geom, site, joint, sensor or what else the field is by.

        Raises:
          ValueError: there is no such field, or it has nothing of this name.
        """

    def evaluate(self) -> None:
        """Evaluates what the next physics step takes from positions and velocities, after these have been set."""


def as_columns(indices: NDArray[np.int64]) -> Columns:
    """Returns consecutive indices as a slice, which reads several times as fast, and others as they are."""
    start, stop = int(indices[0]), int(indices[-1]) + 1
    return slice(start, stop) if np.array_equal(indices, np.arange(start, stop)) else indices


class NamedFields:
    """The places of names in the fields of MuJoCo's data, for one compiled model."""

    def __init__(self, physics: mjcf.Physics) -> None:
        self._fields = physics.named.data
        self._places: dict[tuple[str, str], tuple[Columns, bool]] = {}

    def find(self, field: str, name: str) -> tuple[Columns, bool]:
        """Returns the columns of a name in a field, and whether the name has one row of several numbers there.

        Raises a ValueError as `Simulation.named`.
        """
        if (field, name) not in self._places:
            self._places[field, name] = self._find(field, name)
        return self._places[field, name]

    def _find(self, field: str, name: str) -> tuple[Columns, bool]:
        indexer = getattr(self._fields, field, None)
        if indexer is None:
            raise ValueError(f"MuJoCo's data has no field by name {field!r}; such fields are xpos, qpos, sensordata")
        try:
            place = indexer.axes.row.convert_key_item(name)
        except KeyError as error:
            raise ValueError(f"field {field!r} has nothing of the name {name!r}: {checks.shown(error)}") from error
        if isinstance(place, slice):
            return np.arange(place.start, place.stop), False
        return np.atleast_1d(place).astype(np.int64), len(indexer.shape) > 1


class PhysicsSimulation:
    """The physics of a composer environment, while its model stays compiled; no leading axis."""

    def __init__(self, physics: mjcf.Physics) -> None:
        self._model, self._data = physics.model.ptr, physics.data.ptr
        self._names = NamedFields(physics)

    def read(self, field: str, columns: Columns, order: Literal["C", "F"] = "C") -> Array:
        return getattr(self._data, field)[columns]

    def write(self, field: str, columns: Columns, values: Array) -> None:
        getattr(self._data, field)[columns] = values

    def named(self, field: str, name: str) -> Array:
        columns, is_row = self._names.find(field, name)
        values = self.read(field, columns)
        return values[0] if is_row else values

    def evaluate(self) -> None:
        mujoco.mj_step1(self._model, self._data)


class BatchSimulation:
    """The simulations of a batch; leading axis `(n,)`."""

    def __init__(self, batch: Batch, physics: mjcf.Physics) -> None:
        """Stores a batch, and a physics of the same model, which knows its names."""
        self._batch = batch
        self._fields: dict[str, Array] = {}
        self._names = NamedFields(physics)

    def read(self, field: str, columns: Columns, order: Literal["C", "F"] = "C") -> Array:
        values = self._field(field)
        if isinstance(columns, slice):
            return values[:, columns]
        return values.take(columns, axis=1) if order == "C" else values.T.take(columns, axis=0).T

    def write(self, field: str, columns: Columns, values: Array) -> None:
        self._field(field)[:, columns] = values

    def named(self, field: str, name: str) -> Array:
        columns, is_row = self._names.find(field, name)
        values = self.read(field, columns)
        return values[:, 0] if is_row else values

    def evaluate(self) -> None:
        """Does nothing: a batch evaluates everything in its step."""

    def _field(self, name: str) -> Array:
        """A field `(n, ...)` over all simulations; a live view."""
        if name not in self._fields:
            self._fields[name] = self._batch.bind(name)
        return self._fields[name]


class Sensors(Protocol[Reading_co]):
    """Values that a task reads from the physics, and columns to which the targets of the actuators are written.

    Attributes:
      ctrl: columns of the robot's actuators in ctrl.
      stage: stage of MuJoCo's pipeline up to which the state after a control step is evaluated before `read`.
    """

    stage: mujoco.mjtStage

    @property
    def ctrl(self) -> Columns: ...

    def bind(self, physics: mjcf.Physics) -> None:
        """Looks up all addresses in a compiled scene."""

    def refresh(self, physics: mjcf.Physics) -> None:
        """Evaluates a single physics up to `stage`."""

    def read(self, simulation: Simulation) -> Reading_co:
        """Returns the current values, in fresh arrays `(..., k)`."""


class FeatureSensors:
    """Sensors that a task adds to its scene; each feature is read by one or more of them.

    Attributes:
      columns: `(k,)`, indices of the features in `sensordata`, end to end.
      indices: slice of each feature among the columns, in the order in which features were added.
      ctrl: columns of the robot's actuators in ctrl.
    """

    # Sensors are evaluated from the positions and velocities after the step.
    stage = mujoco.mjtStage.mjSTAGE_VEL

    def __init__(self, root: mjcf.RootElement, robot: Robot) -> None:
        """Prepares to add sensors to the model of an arena, which is not yet compiled, with the robot that acts."""
        self._sensors, self._robot = root.sensor, robot
        self._by_feature: dict[str, tuple[list[mjcf.Element], slice]] = {}

    def add_joints(self, feature: str, kind: str, joints: Iterable[mjcf.Element]) -> None:
        """Adds a feature of some joints, such as `jointpos` or `jointvel`."""
        self._by_feature[feature] = [self._add(kind, joint=joint) for joint in joints], slice(None)

    def add_frame(self, feature: str, kind: str, element: mjcf.Element, part: slice = slice(None)) -> None:
        """Adds a feature of a site, geom or body, such as `framepos` or `framequat`, or a part of its elements."""
        # MuJoCo's "body" is the frame of the body's inertia.
        frame = "xbody" if element.tag == "body" else element.tag
        self._by_feature[feature] = [self._add(kind, objtype=frame, objname=element)], part

    def bind(self, physics: mjcf.Physics) -> None:
        """Looks up all addresses in the compiled scene."""
        found: list[int] = []
        self.indices: dict[str, slice] = {}
        for feature, (sensors, part) in self._by_feature.items():
            bound, start = physics.bind(sensors), len(found)
            for address, size in zip(bound.adr, bound.dim, strict=True):
                found += range(address, address + size)[part]
            self.indices[feature] = slice(start, len(found))
        self.columns = np.array(found)
        self.ctrl = as_columns(physics.bind(self._robot.actuators).element_id)

    def refresh(self, physics: mjcf.Physics) -> None:
        """Updates kinematics and sensors from the joint positions and velocities."""
        model, data = physics.model.ptr, physics.data.ptr
        mujoco.mj_kinematics(model, data)
        mujoco.mj_sensorPos(model, data)
        mujoco.mj_sensorVel(model, data)

    def read(self, simulation: Simulation) -> Array:
        """Returns the present features' values `(..., k)`; the sensors must be up to date (see `refresh`)."""
        # MDPs compute with columns.
        return simulation.read("sensordata", self.columns, order="F")

    def _add(self, kind: str, **attributes: Any) -> mjcf.Element:
        return self._sensors.add(kind, name=f"feature_{len(self._sensors.all_children())}", **attributes)


class SceneIndices:
    """Indices of robot, objects and goals in MuJoCo's arrays; valid for one compiled model.

    Attributes:
      robot_qpos: `(9,)`, qpos of the robot's joints.
      robot_qvel: `(9,)`, qvel of the robot's joints.
      object_qpos: qpos of the objects' joints, in the order of observation; `(21,)` in the kitchen.
      object_qvel: qvel of the objects' joints, in the order of observation; `(20,)` in the kitchen.
      state_qpos: qpos of the robot's joints, then of the objects'; `(30,)` in the kitchen.
      goal_qpos: `(k,)`, qpos that the goals are set for, end to end.
      ctrl: `(9,)`, ctrl of the robot's actuators.
    """

    def __init__(self, scene: Scene, goals: GoalSet, physics: mjcf.Physics) -> None:
        """Looks up all indices; raises a ValueError if a goal has not as many values as its joints."""
        self.robot_qpos, self.robot_qvel = addresses(physics, scene.robot.joints)
        self.object_qpos, self.object_qvel = addresses(physics, scene.object_joints)
        self.state_qpos = np.concatenate([self.robot_qpos, self.object_qpos])
        goal_qpos = [addresses(physics, goal.joints_in(scene))[0] for goal in goals.goals]
        for task, goal, indices in zip(goals.tasks, goals.goals, goal_qpos, strict=True):
            if indices.size != len(goal.value):
                raise ValueError(f"goal of {task!r} must have {indices.size} values, got {goal.value}")
        self.goal_qpos = np.concatenate(goal_qpos)
        self.ctrl = physics.bind(scene.robot.actuators).element_id

    def write(self, physics: mjcf.Physics, observation: Array) -> None:
        """Sets qpos and qvel to those of an observation: positions and velocities of robot, then of objects."""
        qpos = physics.data.qpos
        qvel = physics.data.qvel
        start = 0
        parts = (qpos, self.robot_qpos), (qvel, self.robot_qvel), (qpos, self.object_qpos), (qvel, self.object_qvel)
        for field, indices in parts:
            field[indices] = observation[start : start + indices.size]
            start += indices.size


class ActionMode(abc.ABC):
    """Meaning of the action.

    A mode may remember a command from one control step to the next: a named tuple of arrays `(..., k)`; None otherwise.

    Attributes:
      name: of the mode, as the argument `control_mode` takes it.
      formula: how targets `ctrl` follow from the action, in words that other programs can follow.
      draws: whether a number is drawn from U(0, 1) for each action; `MEDIAN` stands for it otherwise.
      stage: stage of MuJoCo's pipeline up to which the state before a control step must be evaluated.
    """

    name: ClassVar[str]
    formula: ClassVar[str]
    draws: bool = False
    stage: ClassVar[mujoco.mjtStage] = mujoco.mjtStage.mjSTAGE_NONE

    @property
    def settings(self) -> dict[str, Any]:
        """Arguments of the class, which modes keep as attributes of the same names."""
        return {argument: getattr(self, argument) for argument in signatures.names(type(self))}

    @functools.cached_property
    def reads_derived(self) -> bool:
        """Whether control reads what MuJoCo derives from positions and velocities."""
        return self.stage != mujoco.mjtStage.mjSTAGE_NONE

    @abc.abstractmethod
    def spec(self, robot: Robot) -> specs.Array:
        """Returns the action's spec."""

    def bind(self, physics: mjcf.Physics, robot: Robot, timestep: float) -> None:  # noqa: B027
        """Looks up what control reads of a robot in a compiled scene; `timestep` is the control step's [s]."""

    def check(self, action: Array) -> None:  # noqa: B027
        """Raises a ValueError if one of finite actions `(..., k)` has no meaning; most modes accept all."""

    def conversion(self, mode: str) -> Callable[[NDArray, NDArray], Array] | None:
        """Returns how actions of another control mode, with its defaults, become actions of this one.

        A function of the observed state `(n,)` and the other mode's action, with the same targets of the robot's
        actuators; None if there is none.
        """
        return None

    def start(self, simulation: Simulation) -> Any:
        """Returns the command at the start of an episode, which is the present state; None if there is none."""
        return None

    @abc.abstractmethod
    def control(
        self, simulation: Simulation, state: Any, command: Any, action: Array, draw: Array | float
    ) -> tuple[Array, Any]:
        """Returns targets of the robot's actuators, and the command for the next control step.

        Args:
          simulation: the physics.
          state: state of the MDP.
          command: the command that the last control step, or `start`, returned.
          action: `(..., k)`.
          draw: `(...)`, from U(0, 1), or `MEDIAN`.

        Returns:
          Targets `(..., 9)` [rad, m], and the command.
        """


def unit_spec(names: Sequence[str]) -> specs.BoundedArray:
    """Returns the spec of an action with named elements in [-1, 1]."""
    ones = np.ones(len(names))
    return specs.BoundedArray(ones.shape, ones.dtype, minimum=-ones, maximum=ones, name="\t".join(names))


@dataclasses.dataclass(frozen=True, kw_only=True)
class MDP(abc.ABC, Generic[Reading, State]):
    """Settings of a task, and the mathematics of its episodes: control, next state, reward, observation, infos.

    States are named tuples of arrays with any leading axes `(...)`: none for one episode, one for many. No method
    changes a state.

    Attributes:
      sensors: sensors of the scene, bound to its compiled model.
      action_mode: meaning of the action.
      rewards: the terms of the reward by name; their sum is the reward.
      persistent: fields of the state that a reset leaves as they are: numbers of control steps over all episodes.
    """

    sensors: Sensors[Reading]
    action_mode: ActionMode
    rewards: Mapping[str, RewardTerm]
    persistent: ClassVar[Sequence[str]] = ()

    @property
    def noise_draws(self) -> int:
        """Number of numbers drawn from U(-1, 1) at a reset and after each step; 0 without noise."""
        return 0

    @property
    def noise_parts(self) -> Mapping[str, slice]:
        """Parts of these numbers that variations can scale, by name."""
        return {"noise": slice(self.noise_draws)} if self.noise_draws else {}

    def draw_noise(self, random_state: np.random.RandomState) -> Array:
        """Returns draws `(noise_draws,)` from U(-1, 1)."""
        size = self.noise_draws
        return random_state.uniform(-1.0, 1.0, size) if size else np.zeros(0)

    @abc.abstractmethod
    def initial_state(self, reading: Reading, draws: Array) -> State:
        """Returns the state before the first step.

        Args:
          reading: present values of the sensors.
          draws: `(..., noise_draws)`, from U(-1, 1).
        """

    @abc.abstractmethod
    def transition(self, state: State, *, action: Array, target: Array, reading: Reading, draws: Array) -> Transition:
        """Returns one more control step, whose state has no terms of the reward yet.

        Args:
          state: the state before it.
          action: `(..., k)`, its action.
          target: `(..., 9)`, targets of the actuators during it [rad, m].
          reading: values of the sensors after it.
          draws: `(..., noise_draws)`, from U(-1, 1).
        """

    def step(self, state: State, **arguments: Any) -> Any:
        """Returns the state after one more control step without extra observations; arguments as of `transition`."""
        return self.rewarded(self.transition(state, **arguments))

    @abc.abstractmethod
    def observation(self, simulation: Simulation, state: State) -> NDArray:
        """Returns the flat observation `(..., m)` without goals, with its noise."""

    def rewarded(self, step: Transition) -> Any:
        """Returns the state after a step with the terms of its reward."""
        return step.after._replace(terms={name: term(step) for name, term in self.rewards.items()})

    def no_reward(self, axes: tuple[int, ...]) -> dict[str, Array]:
        """Returns the terms before the first step: zeros of the shape `axes`."""
        return {name: np.zeros(axes) for name in self.rewards}

    def reward(self, state: State) -> Array:
        """Returns the reward `(...)` of the last step: the sum of the terms that the state holds."""
        return total(state.terms)  # type: ignore[attr-defined]

    @abc.abstractmethod
    def terminates(self, state: State) -> NDArray[np.bool_]:
        """Returns whether `(...)` the last step terminated the episode."""

    def task_joints(self, scene: Scene) -> Sequence[Sequence[mjcf.Element]]:
        """Returns the joints that each of the `n` tasks moves, which can be undone; by default there are none."""
        return ()

    def complete(self, state: State) -> NDArray[np.bool_]:
        """Returns which tasks `(..., n)` have been completed and still are; `n` as of `task_joints`."""
        return np.zeros(0, bool)

    def truncates(self, state: State) -> NDArray[np.bool_] | bool:
        """Returns whether `(...)` the last step truncated the episode, whatever its time limit; by default never."""
        return False

    @abc.abstractmethod
    def info(self, state: State) -> dict[str, NDArray]:
        """Returns the infos on the task: fresh arrays `(...)` or `(..., n)`."""
