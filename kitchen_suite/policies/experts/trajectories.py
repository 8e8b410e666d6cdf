"""Plans joint trajectories for skills, timed by the speeds that the arm's actuators can follow."""

import dataclasses
import itertools
from collections.abc import Iterable, Sequence
from typing import Self

import mink
import numpy as np

from kitchen_suite.policies.experts.kinematics import ArmKinematics
from kitchen_suite.policies.experts.skills import CLOSED, OPEN, UNLIMITED, ArcMove, Move, Revolute, Skill
from kitchen_suite.types import Array

# Spacing of the poses on straight lines [m] and arcs [rad] for which inverse kinematics is solved. Between them the
# joints are interpolated linearly, which keeps the site within a millimetre of the line.
_LINE_SPACING, _ARC_SPACING = 0.02, 0.06

OUT_OF_REACH = 0.01  # Distance of the hand from a planned pose beyond which the pose is out of reach [m].
_MIN_KNOT_INTERVAL = 1e-3  # Least time between two knots [control steps], so that no two have the same time.
_AVERAGED = np.linspace(-1.0, 1.0, 9)  # Shares of the half width of a moving average at which positions are taken.
_JOINT_SPACING = 0.1  # Spacing of the joint positions between which the hand's motion is measured [rad].


@dataclasses.dataclass(frozen=True, kw_only=True)
class JointSpeedLimits:
    """Greatest speeds of the arm's joints; hashable with a tuple of speeds, so that plans can be cached.

    Attributes:
      joint_speed: of each of the seven joints [rad / control step].
      timestep: length of a control step [s].
    """

    joint_speed: Sequence[float]
    timestep: float

    def steps_between(self, start: Array, end: Array) -> float:
        """Least time from one joint position `(7,)` to another [control steps]."""
        return float(np.max(np.abs(end - start) / self.joint_speed))

    def steps(self, distance: float, speed: float) -> float:
        """Time for a distance [m, rad] at a speed [m/s, rad/s] [control steps]."""
        return distance / (speed * self.timestep)


@dataclasses.dataclass(frozen=True, kw_only=True)
class HandSpeedLimits(JointSpeedLimits):
    """Greatest speeds of the arm's joints and of the hand.

    Attributes:
      kinematics: of the arm.
      linear_speed: of the hand's site [m/s].
      angular_speed: of the hand [rad/s].
    """

    kinematics: ArmKinematics
    linear_speed: float
    angular_speed: float

    def steps_between(self, start: Array, end: Array) -> float:
        count, slowest = max(1, int(np.ceil(np.max(np.abs(end - start)) / _JOINT_SPACING))), 0.0
        poses = [self.kinematics.forward(start + i / count * (end - start)) for i in range(count + 1)]
        for here, there in itertools.pairwise(poses):
            distance = float(np.linalg.norm(there.translation() - here.translation()))
            angle = float(np.linalg.norm((here.rotation().inverse() @ there.rotation()).log()))
            slowest = max(slowest, self.steps(distance, self.linear_speed), self.steps(angle, self.angular_speed))
        return max(super().steps_between(start, end), count * slowest)


@dataclasses.dataclass(frozen=True, kw_only=True)
class JointTrajectory:
    """Joint positions over time, linear between knots.

    Attributes:
      times: `(n,)`, times of the knots, increasing [control steps].
      knots: `(n, 7)` joint positions [rad].
      fingers: `(n,)`, opening of each finger on the way to the knot [m].
      position_error: greatest distance of the hand's site from a pose of a straight line [m].
      arc_share: share of the arcs that the hand can follow.
    """

    times: Array
    knots: Array
    fingers: Array
    position_error: float = 0.0
    arc_share: float = 1.0

    @classmethod
    def stationary(cls, joints: Array, fingers: float) -> Self:
        """Trajectory that stays at joint positions `(7,)` [rad] and at an opening of each finger [m]."""
        return cls(times=np.zeros(1), knots=joints[np.newaxis], fingers=np.array([fingers]))

    @property
    def duration(self) -> float:
        """Time of the last knot [control steps]."""
        return float(self.times[-1])

    @property
    def is_reachable(self) -> bool:
        """Whether the hand can reach all poses of straight lines."""
        return self.position_error <= OUT_OF_REACH

    def at(self, time: float) -> tuple[Array, float]:
        """Joint positions `(7,)` [rad] and opening of each finger [m] at a time [control steps]."""
        if time >= self.times[-1]:
            return self.knots[-1], float(self.fingers[-1])
        right = max(int(np.searchsorted(self.times, time, side="right")), 1)
        fraction = (time - self.times[right - 1]) / (self.times[right] - self.times[right - 1])
        joints = self.knots[right - 1] + fraction * (self.knots[right] - self.knots[right - 1])
        return joints, float(self.fingers[right])

    def then(self, following: Self, limits: JointSpeedLimits) -> Self:
        """This trajectory, a linear joint motion to the first knot of another one, and the other one."""
        gap = max(limits.steps_between(self.knots[-1], following.knots[0]), _MIN_KNOT_INTERVAL)
        return dataclasses.replace(
            self,
            times=np.concatenate([self.times, self.duration + gap + following.times]),
            knots=np.concatenate([self.knots, following.knots]),
            fingers=np.concatenate([self.fingers, following.fingers]),
        )

    def smoothed(self, window: float) -> Self:
        """This trajectory, without sudden turns where the fingers are closed.

        There it is the moving average over a window of half this width [control steps], which is narrower next to the
        times at which the fingers open and close. Turns shake what is held out of the fingers.
        """
        times = np.append(np.arange(0.0, self.duration), self.duration)
        fingers = self.fingers[np.searchsorted(self.times, np.maximum(times - 0.5, 0.0)).clip(max=len(self.times) - 1)]
        steps = np.arange(len(times))
        is_free = fingers != CLOSED
        since = steps - np.maximum.accumulate(np.where(is_free, steps, 0))
        # Fingers are those on the way to a knot: from the last one with closed fingers on they open.
        until = np.minimum.accumulate(np.where(is_free, steps - 1, steps[-1])[::-1])[::-1] - steps
        widths = np.minimum(np.minimum(since, until.clip(min=0)), window)
        around = times[:, np.newaxis] + widths[:, np.newaxis] * _AVERAGED
        knots = [np.interp(around, self.times, joint).mean(axis=-1) for joint in self.knots.T]
        return dataclasses.replace(self, times=times, knots=np.stack(knots, axis=-1), fingers=fingers)


def plan(
    kinematics: ArmKinematics,
    limits: JointSpeedLimits,
    skill: Skill,
    *,
    frame: mink.SE3 | None = None,
    object_position: Array | None = None,
    offsets: Iterable[Array] = (),
) -> JointTrajectory:
    """Plans all motions of a skill; the trajectory begins where the first motion ends.

    Args:
      kinematics: of the arm.
      limits: speed limits of the joints.
      skill: the motions.
      frame: pose of the skill's frame in the world; the world frame if omitted.
      object_position: present position of the skill's object joint [rad, m]; None if it has none.
      offsets: displacements of the poses in free space, in order [m]; zero for those beyond the last.
    """
    moved, joint = frame or mink.SE3.identity(), skill.object_joint
    if joint is not None and object_position is not None:
        moved = moved @ joint.displacement(object_position)
    builder, offsets = _TrajectoryBuilder(kinematics, limits, np.array(skill.ik_seed)), iter(offsets)
    for move in skill.moves:
        if isinstance(move, Move):
            offset = next(offsets, np.zeros(3)) if move.in_free_space else np.zeros(3)
            builder.add_line(mink.SE3.from_translation(offset) @ moved @ move.pose, move.fingers, move.speed)
            builder.add_pause(move.settle_steps)
        elif isinstance(joint, Revolute) and object_position is not None:
            builder.add_arc(move, joint, float(object_position[0]), frame)
    return builder.trajectory


def plan_retreat(
    kinematics: ArmKinematics, limits: JointSpeedLimits, skill: Skill, *, joints: Array, fingers: float
) -> JointTrajectory:
    """Plans the hand's retreat after a skill, from joint positions `(7,)` [rad] and an opening of each finger [m]."""
    pose, retreat = kinematics.forward(joints), mink.SE3.from_translation(np.array(skill.retreat))
    opening = OPEN if skill.release_steps else fingers
    builder = _TrajectoryBuilder(kinematics, limits, joints)
    builder.add_line(pose, opening, UNLIMITED)
    builder.add_pause(skill.release_steps)
    builder.add_line(retreat @ pose, opening, UNLIMITED)
    return builder.trajectory


class _TrajectoryBuilder:
    """Collects knots, each at the earliest time at which the arm can reach it."""

    def __init__(self, kinematics: ArmKinematics, limits: JointSpeedLimits, start: Array) -> None:
        """Starts at joint positions `(7,)` [rad], which are not a knot themselves."""
        self._kinematics, self._limits = kinematics, limits
        self._joints, self._pose = start, kinematics.forward(start)
        self._knots: list[tuple[float, Array, float]] = []
        self._position_error, self._arc_share = 0.0, 1.0

    @property
    def trajectory(self) -> JointTrajectory:
        """Trajectory of the knots added so far."""
        times, knots, fingers = zip(*self._knots, strict=True)
        return JointTrajectory(
            times=np.array(times),
            knots=np.array(knots),
            fingers=np.array(fingers),
            position_error=self._position_error,
            arc_share=self._arc_share,
        )

    def add_line(self, target: mink.SE3, fingers: float, speed: float) -> None:
        """Adds a straight line to a pose; only its end if there is no knot yet."""
        start, here, there = self._pose, self._pose.translation(), target.translation()
        distance = float(np.linalg.norm(there - here))
        count = max(1, int(np.ceil(distance / _LINE_SPACING))) if self._knots else 1
        for fraction in np.linspace(0.0, 1.0, count + 1)[1:]:
            # Only the rotation: interpolating the whole pose would make a screw motion.
            rotation = start.interpolate(target, alpha=fraction).rotation()
            pose = mink.SE3.from_rotation_and_translation(rotation, here + fraction * (there - here))
            joints, error = self._solve(pose)
            self._position_error = max(self._position_error, error)
            self._add_solution(joints, pose, fingers, self._limits.steps(distance / count, speed))

    def add_arc(self, move: ArcMove, joint: Revolute, angle: float, frame: mink.SE3 | None) -> None:
        """Adds an arc around a revolute joint, from its present angle [rad] to the angle of the move.

        In a skill's frame of its own, whose pose in the world is `frame`, it ends where the hand cannot follow it: a
        door need not open all the way.
        """
        start, arc = self._pose, move.angle - angle
        count = max(1, int(np.ceil(abs(arc) / _ARC_SPACING)))
        for fraction in np.linspace(0.0, 1.0, count + 1)[1:]:
            moved = _in_frame(joint.displacement(np.array([fraction * arc])), frame)
            turned = _in_frame(joint.displacement(np.array([fraction * arc * move.hand_rotation_ratio])), frame)
            rotation = turned.rotation() @ start.rotation()
            pose = mink.SE3.from_rotation_and_translation(rotation, moved.apply(start.translation()))
            joints, error = self._solve(pose)
            if frame is not None and error > OUT_OF_REACH:
                self._arc_share = min(self._arc_share, float(fraction) - 1.0 / count)
                return
            self._add_solution(joints, pose, move.fingers, self._limits.steps(abs(arc) / count, move.speed))

    def add_pause(self, steps: int) -> None:
        """Adds a pause at the last knot [control steps]."""
        if steps:
            _, joints, fingers = self._knots[-1]
            self._add_knot(steps, joints, fingers)

    def _solve(self, pose: mink.SE3) -> tuple[Array, float]:
        """Returns joint positions `(7,)` for a pose [rad], and the distance of the site from it [m]."""
        joints = self._kinematics.inverse(pose, start=self._joints)
        error = self._kinematics.forward(joints).translation() - pose.translation()
        return joints, float(np.linalg.norm(error))

    def _add_solution(self, joints: Array, pose: mink.SE3, fingers: float, min_steps: float) -> None:
        self._add_knot(max(self._limits.steps_between(self._joints, joints), min_steps), joints, fingers)
        self._joints, self._pose = joints, pose

    def _add_knot(self, steps: float, joints: Array, fingers: float) -> None:
        time = self._knots[-1][0] + max(steps, _MIN_KNOT_INTERVAL) if self._knots else 0.0
        self._knots.append((time, joints, fingers))


def _in_frame(displacement: mink.SE3, frame: mink.SE3 | None) -> mink.SE3:
    """Returns the transform in the world that a transform is in a frame."""
    return displacement if frame is None else frame @ displacement @ frame.inverse()
