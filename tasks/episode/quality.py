"""How well an episode is done: contact forces, objects that nobody asked to move, energy, and the path of the hand.

Forces and energy are those of every physics step, from the history that MuJoCo keeps of its sensors. Positions of the
hand are sampled once a control step, at the start of its last physics step. The functions compute with any leading axes
`(...)`: one environment has none, many have one.
"""

from typing import Any, NamedTuple, Self

import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.joints import joint_types
from kitchen_suite.entities.robot import Robot
from kitchen_suite.entities.scenes import Scene
from kitchen_suite.tasks.episode.draws import Draws
from kitchen_suite.tasks.episode.part import MeasuringPart
from kitchen_suite.tasks.episode.sampled_sensors import SampledSensors
from kitchen_suite.tasks.goals import JOINT_TOLERANCES, POSITION_TOLERANCE
from kitchen_suite.tasks.mdp import MDP
from kitchen_suite.tasks.rotations import squared_length
from kitchen_suite.tasks.simulation import Simulation
from kitchen_suite.tasks.terms import Transition
from kitchen_suite.types import Array

# Greatest number of contacts of the robot, and of the hand, whose forces are summed: those of the greatest forces.
# Chosen: the scripted experts have at most 13 at a time, random actions at most 24.
NUM_CONTACTS = 32

# Force from which on the arm touches something [N]; far above what differences of sums are rounded by.
_TOUCH = 1e-6

# Squared distances below which the hand rests [m^2]; the quotient of two such is 1.
_LEAST = 1e-300

# Positions of a joint that are compared, by its type: of a free joint those in space, of a ball its quaternion.
_WIDTHS = {"hinge": 1, "slide": 1, "ball": 4, "free": 3}
_MAX_WIDTH = 4

# Distance of each joint from its start from which on its object counts as moved [rad, m].
TOLERANCES = {
    **JOINT_TOLERANCES,
    "free": POSITION_TOLERANCE,
    # Distance between the quaternions of two orientations that are 0.05 rad apart.
    "ball": 2.0 * np.sin(JOINT_TOLERANCES["hinge"] / 4.0),
}


class QualityReading(NamedTuple):
    """Values that are read from the physics after a control step of `n` physics steps.

    Attributes:
      contacts: `(..., 4 n m)`, normal forces of `m` contacts in each physics step [N]: of the robot, of the hand, of
        the robot with itself, and of the hand with the robot.
      torques: `(..., n a)`, of the robot's `a` actuators [N m, N].
      displacements: `(..., n a)`, motion of these in each physics step [rad, m].
      hand: `(..., 3)`, position of the end effector [m].
      positions: `(..., 4 k)`, of the joints of `k` objects, in units of their `TOLERANCES`.
    """

    contacts: Array
    torques: Array
    displacements: Array
    hand: Array
    positions: Array


class Quality(NamedTuple):
    """The quality of an episode up to the last control step.

    Attributes:
      steps: `(...)`, control steps made.
      peak_forces: `(..., 2)`, greatest contact force on the arm without the hand, and on the hand [N].
      force_sums: `(..., 2)`, sums over control steps of the mean contact forces on these [N].
      stray_contacts: `(...)`, control steps in which the arm without the hand touched something.
      energy: `(...)` [J].
      hand: `(..., 3)`, position of the hand [m].
      stride: `(..., 3)`, difference of its last two positions [m].
      bend: `(..., 3)`, second difference of its last three positions [m].
      path_length: `(...)` [m].
      peak_stride: `(...)`, greatest squared length of a stride [m^2].
      squared_jerk: `(...)`, sum of the squared third differences of the positions [m^2].
      start: `(..., 4 k)`, positions of the objects at the reset, in units of their `TOLERANCES`.
      requested: `(..., k)`, which of the objects the episode asks to move.
      moved: `(..., k)`, which of them have been away from their start by more than their tolerance.
    """

    steps: NDArray[np.int64]
    peak_forces: Array
    force_sums: Array
    stray_contacts: NDArray[np.int64]
    energy: Array
    hand: Array
    stride: Array
    bend: Array
    path_length: Array
    peak_stride: Array
    squared_jerk: Array
    start: Array
    requested: NDArray[np.bool_]
    moved: NDArray[np.bool_]

    @classmethod
    def initial(cls, hand: Array, positions: Array, requested: NDArray[np.bool_]) -> Self:
        """Returns the quality of an episode before its first step; the robot stands still.

        Args:
          hand: `(3,)`, position of the end effector [m].
          positions: `(4 k,)`, of the objects, in units of their `TOLERANCES`.
          requested: `(k,)`, which of the objects the episode asks to move.
        """
        return cls(
            steps=np.array(0),
            peak_forces=np.zeros(2),
            force_sums=np.zeros(2),
            stray_contacts=np.array(0),
            energy=np.array(0.0),
            hand=hand,
            stride=np.zeros(3),
            bend=np.zeros(3),
            path_length=np.array(0.0),
            peak_stride=np.array(0.0),
            squared_jerk=np.array(0.0),
            start=positions,
            requested=requested,
            moved=np.zeros(requested.shape, bool),
        )

    def after(self, reading: QualityReading) -> Self:
        """Returns the quality after one more control step."""
        forces = contact_forces(reading.contacts)
        peaks = np.maximum.reduce(forces, axis=-1)
        means = np.add.reduce(forces, axis=-1) / forces.shape[-1]
        work = np.add.reduce(np.abs(reading.torques * reading.displacements), axis=-1)
        stride = reading.hand - self.hand
        bend = stride - self.stride
        squared_stride = squared_length(stride)
        offsets = (reading.positions - self.start).reshape(*self.moved.shape, _MAX_WIDTH)
        return type(self)(
            self.steps + 1,
            np.maximum(self.peak_forces, peaks),
            self.force_sums + means,
            self.stray_contacts + (peaks[..., 0] > _TOUCH),
            self.energy + work,
            reading.hand,
            stride,
            bend,
            self.path_length + np.sqrt(squared_stride),
            np.maximum(self.peak_stride, squared_stride),
            self.squared_jerk + squared_length(bend - self.bend),
            self.start,
            self.requested,
            self.moved | (squared_length(offsets) > 1.0),
        )

    @property
    def disturbed(self) -> NDArray[np.bool_]:
        """`(..., k)`, which of the objects have moved though the episode does not ask for it."""
        return self.moved & ~self.requested

    @property
    def log_dimensionless_jerk(self) -> Array:
        """`(...)`, `-ln(T^3 / v^2 * integral of |jerk|^2 dt)`, where v is the hand's peak speed; 0 at rest.

        See Balasubramanian et al., On the analysis of movement smoothness, 2015. A movement along a straight line from
        rest to rest has at most -ln(204.8) = -5.32.
        """
        # With control steps of one unit of time: their length cancels. At rest both are 0.
        return np.log(np.maximum(self.peak_stride, _LEAST) / np.maximum(self.steps**3 * self.squared_jerk, _LEAST))

    def info(self) -> dict[str, NDArray]:
        """Returns the infos on the quality: fresh arrays `(...)`."""
        mean_forces = self.force_sums / np.maximum(self.steps, 1)[..., np.newaxis]
        return {
            "peak_contact_force": np.array(self.peak_forces[..., 1]),
            "mean_contact_force": np.array(mean_forces[..., 1]),
            "peak_arm_contact_force": np.array(self.peak_forces[..., 0]),
            "mean_arm_contact_force": np.array(mean_forces[..., 0]),
            "stray_contacts": np.array(self.stray_contacts),
            "objects_disturbed": np.array(np.add.reduce(self.disturbed, axis=-1, dtype=np.int64)),
            "energy": np.array(self.energy),
            "path_length": np.array(self.path_length),
            "log_dimensionless_jerk": np.array(self.log_dimensionless_jerk),
        }


def contact_forces(contacts: Array) -> Array:
    """Returns the contact forces on the arm without the hand, and on the hand, in each physics step, `(..., 2, n)` [N].

    Each is a sum of normal forces. Contacts between two parts of the robot do not count.

    Args:
      contacts: `(..., 4 n m)`, see `QualityReading`.
    """
    sums = np.add.reduce(contacts.reshape(*contacts.shape[:-1], 2, 2, -1, NUM_CONTACTS), axis=-1)
    forces: Array = sums[..., 0, :, :] - sums[..., 1, :, :]
    # The robot's contacts without those of the hand.
    forces[..., 0, :] -= forces[..., 1, :]
    # Differences of sums are rounded, and may be just below 0.
    return np.maximum(forces, 0.0)


class QualityMeter(MeasuringPart):
    """Measures the quality of the episodes of a task, by sensors that it adds to the scene.

    Attributes:
      objects: names of the joints of the scene's objects: not of the robot, nor of joints that another one follows by
        an equality constraint, as a burner its knob. The first `MDP.object_slots` places are for joints of props.
    """

    name = "quality"

    def __init__(self, scene: Scene, mdp: MDP, physics_steps: int) -> None:
        """Adds the sensors to a scene that is not yet compiled.

        Args:
          scene: with robot and objects.
          mdp: of the task, which knows what episodes ask for.
          physics_steps: in a control step.
        """
        super().__init__()
        self._scene = scene
        self._mdp = mdp
        self._sensors = SampledSensors(scene, physics_steps)
        robot = mjcf.get_attachment_frame(scene.robot.mjcf_model)
        hand = scene.robot.joints[scene.robot.arm_size - 1].parent
        # While anything sleeps, MuJoCo does not evaluate a sensor of contacts between two subtrees whose own bodies are
        # fixed or asleep, whatever else moves in them. The base of a robot is fixed; what moves of it never sleeps.
        moving = _moving_root(scene.robot)
        of_contacts = {"data": "force", "num": NUM_CONTACTS, "reduce": "maxforce"}
        self._contacts = [
            self._sensors.add("contact", subtree1=robot, **of_contacts),
            self._sensors.add("contact", subtree1=hand, **of_contacts),
            self._sensors.add("contact", subtree1=moving, subtree2=robot, **of_contacts),
            self._sensors.add("contact", subtree1=hand, subtree2=robot, **of_contacts),
        ]
        self._torques = [self._sensors.add("actuatorfrc", actuator=each) for each in scene.robot.actuators]
        self._velocities = [self._sensors.add("actuatorvel", actuator=each) for each in scene.robot.actuators]
        self._hand = self._sensors.add("framepos", objtype="site", objname=scene.robot.end_effector)
        of_props, others = _object_joints(scene)
        free_slots = max(mdp.object_slots - len(of_props), 0)
        self._joints: list[mjcf.Element | None] = [*of_props, *[None] * free_slots, *others]
        self.objects = tuple("" if joint is None else joint.full_identifier for joint in self._joints)

    def bind(self, physics: mjcf.Physics) -> None:
        self._physics = physics
        self._timestep = physics.timestep()
        sampled = (self._contacts, self._torques, self._velocities)
        places = [self._sensors.places(physics, sensors) for sensors in sampled]
        # Forces are in the frame of the contact, whose normal comes first.
        places[0] = places[0][::3]
        # The latest sample comes last: a control step fills the whole history.
        places.append(self._sensors.places(physics, [self._hand])[-3:])
        self._history = np.concatenate(places)
        ends = np.cumsum([each.size for each in places]).tolist()
        self._parts = [slice(end - each.size, end) for end, each in zip(ends, places, strict=True)]
        self._site = physics.bind(self._scene.robot.end_effector).element_id
        columns = np.zeros((len(self._joints), _MAX_WIDTH), np.int64)
        scales = np.zeros((len(self._joints), _MAX_WIDTH))
        for place, joint in enumerate(self._joints):
            if joint is not None:
                (kind,) = joint_types([joint])
                width = _WIDTHS[kind]
                columns[place, :width] = int(physics.bind(joint).qposadr) + np.arange(width)
                scales[place, :width] = 1.0 / TOLERANCES[kind]
        self._columns = columns.ravel()
        self._scales = scales.ravel()

    def start(self, part: Any, simulation: Simulation, mdp_state: Any, draws: Draws) -> Quality:
        mujoco.mj_kinematics(self._physics.model.ptr, self._physics.data.ptr)
        hand = np.array(self._physics.data.ptr.site_xpos[self._site])
        asked = self._mdp.requested_joints(self._scene, mdp_state)
        requested = np.array([joint in asked for joint in self._joints], bool)
        return Quality.initial(hand, self._positions(simulation), requested)

    def after(self, part: Quality, simulation: Simulation, step: Transition, draws: Draws) -> Quality:
        return part.after(self.reader.read(simulation))

    def info(self, part: Quality) -> dict[str, NDArray]:
        return part.info()

    def read(self, simulation: Simulation) -> QualityReading:
        history = simulation.read("history", self._history)
        contacts, torques, velocities, hand = (history[..., part] for part in self._parts)
        return QualityReading(contacts, torques, velocities * self._timestep, hand, self._positions(simulation))

    def _positions(self, simulation: Simulation) -> Array:
        """Returns the positions `(..., 4 k)` of the objects, in units of their tolerances."""
        return simulation.read("qpos", self._columns) * self._scales


def _moving_root(robot: Robot) -> mjcf.Element:
    """Returns the body on which all moving parts of a robot hang: the outermost with a joint."""
    base = mjcf.get_attachment_frame(robot.mjcf_model)
    root = body = robot.joints[0].parent
    while body is not base:
        if body.joint:
            root = body
        is_outermost = body.parent.tag == "worldbody"
        body = mjcf.get_attachment_frame(body.root) if is_outermost else body.parent
    return root


def _object_joints(scene: Scene) -> tuple[list[mjcf.Element], list[mjcf.Element]]:
    """Returns the joints of the props of a scene, and those of all else but the robot; see `QualityMeter.objects`."""
    root = scene.arena.mjcf_model
    followed = {constraint.joint2 for constraint in root.find_all("equality") if constraint.tag == "joint"}
    of_robot = {*scene.robot.mjcf_model.find_all("joint")}
    of_props = [joint for joint in scene.object_joints if joint not in followed]
    others = [joint for joint in root.find_all("joint") if joint not in {*scene.object_joints, *followed, *of_robot}]
    return of_props, others
