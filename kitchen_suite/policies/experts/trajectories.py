"""From steps of a skill to a path of the arm's joints, timed by what its servos can do."""

import dataclasses
from collections.abc import Iterable
from typing import Self

import mink
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.policies.experts.kinematics import ArmKinematics
from kitchen_suite.policies.experts.skills import OPEN, UNLIMITED, ArcMove, Move, Revolute, Skill

# Spacing of the poses on straight lines [m] and arcs [rad] for which joint positions are sought; between them the
# joints move evenly, and the site leaves the line by less than a millimetre.
_LINE_SPACING = 0.02
_ARC_SPACING = 0.06

# Least time between two knots [control steps], so that no two have the same.
_LEAST_TIME = 1e-3


@dataclasses.dataclass(frozen=True, kw_only=True)
class JointSpeedLimits:
    """How fast an arm may move.

    Attributes:
      joint_speed: `(7,)`, greatest speed of each joint [rad / control step].
      timestep: length of a control step [s].
    """

    joint_speed: NDArray[np.float64]
    timestep: float

    def steps_between(self, start: NDArray[np.float64], end: NDArray[np.float64]) -> float:
        """Time that the joints need from one position `(7,)` to another [control steps]."""
        return float(np.max(np.abs(end - start) / self.joint_speed))

    def steps(self, distance: float, speed: float) -> float:
        """Time for a distance [m, rad] at a speed [m/s, rad/s] [control steps]."""
        return distance / (speed * self.timestep)


@dataclasses.dataclass(frozen=True, kw_only=True)
class JointTrajectory:
    """Joint positions over time.

    Attributes:
      times: `(n,)`, when each knot is reached, increasing [control steps].
      knots: `(n, 7)` joint positions [rad].
      fingers: `(n,)`, how far each finger is to be open on the way to the knot [m].
    """

    times: NDArray[np.float64]
    knots: NDArray[np.float64]
    fingers: NDArray[np.float64]

    @classmethod
    def still(cls, joints: NDArray[np.float64], fingers: float) -> Self:
        """Staying at joint positions `(7,)` [rad], with the fingers open so far [m]."""
        return cls(times=np.zeros(1), knots=joints[np.newaxis], fingers=np.array([fingers]))

    @property
    def duration(self) -> float:
        """Time of the last knot [control steps]."""
        return float(self.times[-1])

    def at(self, time: float) -> tuple[NDArray[np.float64], float]:
        """Joint positions `(7,)` [rad] and opening of the fingers [m] at a time [control steps]."""
        if time >= self.times[-1]:
            return self.knots[-1], float(self.fingers[-1])
        right = max(int(np.searchsorted(self.times, time, side="right")), 1)
        share = (time - self.times[right - 1]) / (self.times[right] - self.times[right - 1])
        joints = self.knots[right - 1] + share * (self.knots[right] - self.knots[right - 1])
        return joints, float(self.fingers[right])

    def then(self, after: Self, pace: JointSpeedLimits) -> Self:
        """This path, the shortest way of the joints to the beginning of another, and the other one."""
        gap = max(pace.steps_between(self.knots[-1], after.knots[0]), _LEAST_TIME)
        return dataclasses.replace(
            self,
            times=np.concatenate([self.times, self.duration + gap + after.times]),
            knots=np.concatenate([self.knots, after.knots]),
            fingers=np.concatenate([self.fingers, after.fingers]),
        )


def plan(
    arm: ArmKinematics,
    pace: JointSpeedLimits,
    skill: Skill,
    *,
    frame: mink.SE3 | None = None,
    values: NDArray[np.float64] | None = None,
    offsets: Iterable[NDArray[np.float64]] = (),
) -> JointTrajectory:
    """Plans all steps of a skill; the path begins where the first one ends.

    Args:
      arm: finds the joint positions.
      pace: how fast it may move.
      skill: what to do.
      frame: that of the skill, in the world; the world's own when omitted.
      values: positions of the skill's thing now [rad, m]; None if it has none.
      offsets: displacements of the places that are free, one after the other [m].
    """
    frame = frame or mink.SE3.identity()
    if skill.thing is not None and values is not None:
        frame = frame @ skill.thing.displacement(values)
    trail, offsets = _TrajectoryBuilder(arm, pace, np.array(skill.posture)), iter(offsets)
    for step in skill.steps:
        if isinstance(step, Move):
            offset = next(offsets, np.zeros(3)) if step.free else np.zeros(3)
            trail.move(mink.SE3.from_translation(offset) @ frame @ step.pose, step.fingers, step.speed)
            trail.wait(step.settle)
        elif isinstance(skill.thing, Revolute) and values is not None:
            trail.swing(step, skill.thing, float(values[0]))
    return trail.path


def retreat(
    arm: ArmKinematics, pace: JointSpeedLimits, skill: Skill, *, joints: NDArray[np.float64], fingers: float
) -> JointTrajectory:
    """Plans to leave the place of a skill, from joint positions `(7,)` [rad] and with fingers open so far [m]."""
    here, away = arm.forward(joints), mink.SE3.from_translation(np.array(skill.retreat))
    trail = _TrajectoryBuilder(arm, pace, joints)
    trail.move(here, OPEN if skill.release else fingers, UNLIMITED)
    trail.wait(skill.release)
    trail.move(away @ here, OPEN if skill.release else fingers, UNLIMITED)
    return trail.path


class _TrajectoryBuilder:
    """Knots laid so far, each at the time at which the arm can be there."""

    def __init__(self, arm: ArmKinematics, pace: JointSpeedLimits, start: NDArray[np.float64]) -> None:
        """Starts at joint positions `(7,)` [rad], which are no knot themselves."""
        self._arm, self._pace = arm, pace
        self._joints, self._pose = start, arm.forward(start)
        self._knots: list[tuple[float, NDArray[np.float64], float]] = []

    @property
    def path(self) -> JointTrajectory:
        times, knots, fingers = zip(*self._knots, strict=True)
        return JointTrajectory(times=np.array(times), knots=np.array(knots), fingers=np.array(fingers))

    def move(self, target: mink.SE3, fingers: float, speed: float) -> None:
        """Lays a straight line to a pose; if it is the first, only its end."""
        start, here, there = self._pose, self._pose.translation(), target.translation()
        distance = float(np.linalg.norm(there - here))
        count = max(1, int(np.ceil(distance / _LINE_SPACING))) if self._knots else 1
        for share in np.linspace(0.0, 1.0, count + 1)[1:]:
            # Interpolated together, position and orientation would make a screw.
            rotation = start.interpolate(target, alpha=share).rotation()
            pose = mink.SE3.from_rotation_and_translation(rotation, here + share * (there - here))
            self._reach(pose, fingers, self._pace.steps(distance / count, speed))

    def swing(self, step: ArcMove, hinge: Revolute, angle: float) -> None:
        """Lays the way round a hinge that is at an angle [rad]."""
        start, way = self._pose, step.to - angle
        count = max(1, int(np.ceil(abs(way) / _ARC_SPACING)))
        for share in np.linspace(0.0, 1.0, count + 1)[1:]:
            place = hinge.displacement(np.array([share * way])).apply(start.translation())
            turn = hinge.displacement(np.array([share * way * step.twist])).rotation()
            pose = mink.SE3.from_rotation_and_translation(turn @ start.rotation(), place)
            self._reach(pose, step.fingers, self._pace.steps(abs(way) / count, step.speed))

    def wait(self, steps: int) -> None:
        """Stays for some control steps."""
        if steps:
            _, joints, fingers = self._knots[-1]
            self._lay(steps, joints, fingers)

    def _reach(self, pose: mink.SE3, fingers: float, least: float) -> None:
        joints = self._arm.inverse(pose, start=self._joints)
        self._lay(max(self._pace.steps_between(self._joints, joints), least), joints, fingers)
        self._joints, self._pose = joints, pose

    def _lay(self, steps: float, joints: NDArray[np.float64], fingers: float) -> None:
        time = self._knots[-1][0] + max(steps, _LEAST_TIME) if self._knots else 0.0
        self._knots.append((time, joints, fingers))
