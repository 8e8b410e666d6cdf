"""Whether fingers hold an object: a hand grasps it at its site, lifts it, holds it for ten seconds, and lets it go."""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import dataclasses
import math
from collections.abc import Iterator

import mujoco
import numpy as np
from dm_control import mjcf

from kitchen_suite.entities import Scene
from kitchen_suite.environment import Environment
from kitchen_suite.tasks import rotations
from kitchen_suite.tasks.control_modes.end_effector import REACH, EndEffectorPose
from kitchen_suite.types import Array

__all__ = ["CONTROL_MODE", "GRASP", "Grasp", "Held", "grasp_sites"]

GRASP = "grasp"
"""How the name of a site begins at which a hand grasps an object; see `grasp_sites`."""

CONTROL_MODE = EndEffectorPose.name
"""The control mode of the environments in which a `Grasp` is played."""

HOLDING_TIME = 10.0  # [s].
MAX_DRIFT = 0.005  # Greatest distance that an object which is held moves in the hand [m].

# Of the hand's path.
_SPEED = 0.125  # [m/s].
_APPROACH_SPEED = 0.3  # To the point before the object [m/s].
_ANGULAR_SPEED = 0.6  # [rad/s].
_DISTANCE = 0.12  # Of that point from the site of the grasp [m].
_LIFT = 0.15  # Height to which an object is lifted [m].
_SETTLING_TIME = 0.8  # After a part of the path [s].
_CLOSING_TIME = 1.0  # Of the fingers [s].

_TOUCH = 0.002  # Distance that an object moves in the hand when it is put down [m].

_MAX_MISS = 0.01  # Greatest distance of the hand from the site when the fingers close [m].
_MIN_LIFTED = 0.1  # Least height of an object that has been lifted [m].
_MAX_DISPLACEMENT = 0.03  # Greatest distance from its place of an object that has been put down there [m].
_MAX_TILT = math.radians(30)  # Greatest angle by which such an object has tipped over.

_UP = np.array([0.0, 0.0, 1.0])
_OPEN, _CLOSED = -1.0, 1.0  # Values of the action's last element.


def grasp_sites(scene: Scene) -> dict[str, mjcf.Element]:
    """Returns the first grasp site of each free object that has one, by name of the object.

    Its pose is that of the hand's end effector when the fingers close: z is the direction of approach, y that in which
    the fingers move, and the fingertips are 4 to 5 cm ahead.
    """
    entities = {**scene.props, **scene.attached}
    found = {}
    for name in scene.free_objects:
        sites = entities[name].mjcf_model.find_all("site") if name in entities else ()
        if named := [site for site in sites if (site.name or "").startswith(GRASP)]:
            found[name] = named[0]
    return found


@dataclasses.dataclass(frozen=True, kw_only=True)
class Held:
    """The result of a grasp.

    Attributes:
      miss: distance of the hand from the site of the grasp when the fingers closed [m].
      lifted: height to which the object was lifted [m].
      drift: greatest distance that it moved in the hand while it was held [m].
      displacement: distance from its place after it was put down and the hand was away [m].
      tilt: angle by which it has tipped over then [rad].
    """

    miss: float
    lifted: float
    drift: float
    displacement: float
    tilt: float

    @property
    def fault(self) -> str:
        """The first thing that went wrong, with what to change; empty if the object was held and let go."""
        if not self.miss < _MAX_MISS:
            return (
                f"the hand stays {_mm(self.miss)} away from the grasp site: place the object within reach, with "
                "nothing in between, and turn the site's z axis into the direction of approach"
            )
        if not self.lifted > _MIN_LIFTED:
            return (
                f"it is lifted by {_mm(self.lifted)} in place of {_mm(_LIFT)}: make it lighter or its friction "
                "greater, let it start free of other geoms, and let what the fingers close on be 1 to 7 cm wide"
            )
        if not self.drift < MAX_DRIFT:
            return (
                f"it moves by {_mm(self.drift)} in the hand within {HOLDING_TIME:g} s: make it lighter or its friction "
                "greater, or raise noslip_iterations in its scene's options"
            )
        if not (self.displacement < _MAX_DISPLACEMENT and self.tilt < _MAX_TILT):
            return (
                f"it is {_mm(self.displacement)} away from its place after it was let go: put the grasp site above its "
                "centre of mass, and give it a base that it stands on"
            )
        return ""

    def __str__(self) -> str:
        told = f"lifted by {_mm(self.lifted)}, moved by {_mm(self.drift)} in {HOLDING_TIME:g} s"
        return f"not held: {self.fault}" if self.fault else f"held: {told}, let go"


def _mm(length: float) -> str:
    return f"{1000 * length:.1f} mm"


class Grasp:
    """A hand that grasps an object, lifts it, holds it, puts it down where it was, and withdraws.

    Attributes:
      phase: what the hand does at present: `approach`, `close`, `lift`, `hold`, `lower` or `release`.
    """

    def __init__(self, environment: Environment, name: str) -> None:
        """Prepares the grasp of a free object in an environment that has been reset; see `grasp_sites`.

        The environment has the control mode `CONTROL_MODE`. Raises a ValueError if the object has no grasp site.
        """
        scene = environment.task.scene
        sites = grasp_sites(scene)
        if name not in sites:
            raise ValueError(f"there is no free object {name!r} with a grasp site, but {sorted(sites)}")
        physics, robot = environment.physics, scene.robot
        base = physics.bind(mjcf.get_attachment_frame(robot.mjcf_model))
        self._base, self._inverse = base.xpos.copy(), rotations.inverse(base.xquat.copy())
        self._timestep = environment.control_timestep()
        self._hand = physics.bind(robot.end_effector)
        self._site = physics.bind(sites[name])
        entity = {**scene.props, **scene.attached}[name]
        self._object = physics.bind(mjcf.get_attachment_frame(entity.mjcf_model))
        self.phase = "approach"

    def play(self, environment: Environment) -> Held:
        """Plays the grasp to its end."""
        for action in self.actions():
            environment.step(action)
        return self.result()

    def actions(self) -> Iterator[Array]:
        """Yields the actions of the grasp; the environment makes a step with each before the next is taken."""
        start = self._object.xpos.copy(), self._object.xmat.reshape(3, 3).copy()
        at = self._site.xpos.copy()
        hand = _quaternion(self._hand.xmat)
        turn = rotations.quaternion(self._turn(hand))
        approach = self._site.xmat.reshape(3, 3)[:, 2].copy()
        self._pose = self._hand.xpos.copy(), hand
        self._orientation = rotations.product(turn, hand)
        before = at - _DISTANCE * approach
        yield from self._move(before, _OPEN, speed=_APPROACH_SPEED)
        yield from self._wait(_SETTLING_TIME, _OPEN)
        yield from self._move(at, _OPEN)
        yield from self._wait(_SETTLING_TIME, _OPEN)
        self._miss = float(np.linalg.norm(self._hand.xpos - at))
        self.phase = "close"
        yield from self._wait(_CLOSING_TIME, _CLOSED)
        self.phase = "lift"
        yield from self._move(at + _LIFT * _UP, _CLOSED)
        yield from self._wait(_SETTLING_TIME, _CLOSED)
        self._lifted = float(self._object.xpos[2] - start[0][2])
        self.phase = "hold"
        held = self._in_hand()
        self._drift = 0.0
        for action in self._wait(HOLDING_TIME, _CLOSED):
            yield action
            self._drift = max(self._drift, float(np.linalg.norm(self._in_hand() - held)))
        self.phase = "lower"
        held = self._in_hand()
        for action in self._move(at, _CLOSED):
            yield action
            if np.linalg.norm(self._in_hand() - held) > _TOUCH:
                # It hangs lower than it was grasped, and stands already.
                break
        yield from self._wait(_SETTLING_TIME, _CLOSED)
        self.phase = "release"
        yield from self._wait(_CLOSING_TIME, _OPEN)
        yield from self._move(before, _OPEN)
        yield from self._wait(_SETTLING_TIME, _OPEN)
        upright, after = (matrix[:, 2] for matrix in (start[1], self._object.xmat.reshape(3, 3)))
        self._tilt = math.acos(np.clip(upright @ after, -1.0, 1.0))
        self._displacement = float(np.linalg.norm(self._object.xpos - start[0]))

    def result(self) -> Held:
        """Returns the result, once all actions have been taken."""
        return Held(
            miss=self._miss,
            lifted=self._lifted,
            drift=self._drift,
            displacement=self._displacement,
            tilt=self._tilt,
        )

    def _turn(self, hand: Array) -> Array:
        """Returns the rotation vector from the hand to the site, or to the site turned by half about its z axis.

        Two fingers grasp the same in both; the hand takes the nearer one.
        """
        site = _quaternion(self._site.xmat)
        half = np.array([0.0, 0.0, 0.0, 1.0])
        turns = [rotations.difference(each, hand) for each in (site, rotations.product(site, half))]
        return min(turns, key=np.linalg.norm)

    def _in_hand(self) -> Array:
        """Returns the position of the object in the frame of the hand [m]."""
        return self._hand.xmat.reshape(3, 3).T @ (self._object.xpos - self._hand.xpos)

    def _move(self, position: Array, gripper: float, speed: float = _SPEED) -> Iterator[Array]:
        """Yields actions that move the hand to a position along a line, and turn it to that of the grasp."""
        start, orientation = self._pose
        turn = rotations.difference(self._orientation, orientation)
        time = max(np.linalg.norm(position - start) / speed, np.linalg.norm(turn) / _ANGULAR_SPEED)
        steps = max(math.ceil(time / self._timestep), 1)
        for step in range(1, steps + 1):
            turned = rotations.product(rotations.quaternion(turn * step / steps), orientation)
            self._pose = start + (position - start) * step / steps, turned
            yield self._action(gripper)

    def _wait(self, time: float, gripper: float) -> Iterator[Array]:
        """Yields actions that keep the hand where it is."""
        for _ in range(math.ceil(time / self._timestep)):
            yield self._action(gripper)

    def _action(self, gripper: float) -> Array:
        position, orientation = self._pose
        offset = rotations.rotated(self._inverse, position - self._base) / REACH
        return np.concatenate([offset, rotations.product(self._inverse, orientation), [gripper]])


def _quaternion(matrix: Array) -> Array:
    """Returns the quaternion of a rotation matrix of nine elements."""
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.array(matrix, np.float64))
    return quaternion
