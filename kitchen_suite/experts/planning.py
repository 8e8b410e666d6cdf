"""From steps of a skill to a path of the arm's joints, timed by what its servos can do."""

import dataclasses
from collections.abc import Sequence
from typing import Self

import mink
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.experts.arm import Arm
from kitchen_suite.experts.skills import UNLIMITED, Hinge, Move, Skill, Swing

# Spacing of the poses on straight lines [m] and arcs [rad] for which joint positions are sought; between them the
# joints move evenly, and the site leaves the line by less than a millimetre.
_LINE_SPACING = 0.02
_ARC_SPACING = 0.06


@dataclasses.dataclass(frozen=True, kw_only=True)
class Path:
    """Joint positions over time.

    Attributes:
      times: `(n,)`, when each knot is reached [control steps].
      knots: `(n, 7)` joint positions [rad].
      fingers: `(n,)`, how far each finger is to be open on the way to the knot [m].
    """

    times: NDArray[np.float64]
    knots: NDArray[np.float64]
    fingers: NDArray[np.float64]

    @property
    def duration(self) -> float:
        """Time of the last knot [control steps]."""
        return float(self.times[-1])

    def at(self, time: float) -> tuple[NDArray[np.float64], float]:
        """Joint positions `(7,)` [rad] and opening of the fingers [m] at a time [control steps]."""
        if time >= self.times[-1]:
            return self.knots[-1], float(self.fingers[-1])
        right = int(np.searchsorted(self.times, time, side="right"))
        left = max(right - 1, 0)
        share = (time - self.times[left]) / (self.times[right] - self.times[left])
        return self.knots[left] + share * (self.knots[right] - self.knots[left]), float(self.fingers[right])

    def then(self, after: Self, joint_speed: NDArray[np.float64]) -> Self:
        """This path, the shortest way of the joints to the beginning of another, and the other one."""
        gap = float(np.max(np.abs(after.knots[0] - self.knots[-1]) / joint_speed))
        return dataclasses.replace(
            self,
            times=np.concatenate([self.times, self.times[-1] + gap + after.times]),
            knots=np.concatenate([self.knots, after.knots]),
            fingers=np.concatenate([self.fingers, after.fingers]),
        )


class Planner:
    """Lays knots, each at the time at which the arm can be there."""

    def __init__(self, arm: Arm, *, joint_speed: NDArray[np.float64], timestep: float) -> None:
        """Plans for an arm.

        Args:
          arm: finds the joint positions.
          joint_speed: `(7,)`, greatest speed of each joint [rad / control step].
          timestep: length of a control step [s].
        """
        self._arm, self._joint_speed, self._timestep = arm, joint_speed, timestep

    def skill(self, skill: Skill, value: NDArray[np.float64] | None, jitter: Sequence[NDArray[np.float64]] = ()) -> Path:
        """Plans all steps of a skill; the path begins at the end of the first one.

        Args:
          skill: what to do.
          value: by how much the skill's thing has moved already.
          jitter: displacements of the first places in free space [m].
        """
        moved = mink.SE3.identity() if skill.thing is None else skill.thing.displacement(value)
        trail = _Trail(self._arm, np.array(skill.posture), self._joint_speed, self._timestep)
        offsets = iter(jitter)
        for step in skill.steps:
            if isinstance(step, Swing):
                trail.swing(step, skill.thing, float(value[0]))
            else:
                offset = next(offsets, np.zeros(3)) if step.free else np.zeros(3)
                trail.move(mink.SE3.from_translation(offset) @ moved @ step.pose, step)
        return trail.path()

    def retreat(self, joints: NDArray[np.float64], skill: Skill, fingers: float) -> Path:
        """Plans to leave the place of a skill, from joint positions `(7,)` [rad] and with fingers as they are [m]."""
        trail = _Trail(self._arm, joints, self._joint_speed, self._timestep)
        here = self._arm.pose(joints)
        trail.move(here, Move(to=(0, 0, 0), fingers=fingers))
        if skill.release:
            fingers = skill.steps[0].fingers
            trail.move(here, Move(to=(0, 0, 0), fingers=fingers, settle=skill.release))
        trail.move(mink.SE3.from_translation(np.array(skill.retreat)) @ here, Move(to=(0, 0, 0), fingers=fingers))
        return trail.path()


class _Trail:
    """Knots laid so far."""

    def __init__(
        self, arm: Arm, start: NDArray[np.float64], joint_speed: NDArray[np.float64], timestep: float
    ) -> None:
        self._arm, self._joint_speed, self._timestep = arm, joint_speed, timestep
        self._joints, self._pose = start, arm.pose(start)
        self._times: list[float] = []
        self._knots: list[NDArray[np.float64]] = []
        self._fingers: list[float] = []

    def path(self) -> Path:
        return Path(times=np.array(self._times), knots=np.array(self._knots), fingers=np.array(self._fingers))

    def move(self, target: mink.SE3, step: Move) -> None:
        """Lays the way to a pose; its first one is where the path begins."""
        start = self._pose
        distance = np.linalg.norm(target.translation() - start.translation())
        count = max(1, int(np.ceil(distance / _LINE_SPACING))) if step.straight and self._knots else 1
        for share in np.linspace(0.0, 1.0, count + 1)[1:]:
            rotation = start.interpolate(target, alpha=share).rotation()
            place = (1.0 - share) * start.translation() + share * target.translation()
            least = distance / count / (step.speed * self._timestep)
            self._lay(mink.SE3.from_rotation_and_translation(rotation, place), step.fingers, least)
        if step.settle:
            self._append(step.settle, self._joints, step.fingers)

    def swing(self, step: Swing, hinge: Hinge, angle: float) -> None:
        """Lays the way round a hinge that is turned to an angle [rad]."""
        start, way = self._pose, step.to - angle
        count = max(1, int(np.ceil(abs(way) / _ARC_SPACING)))
        for share in np.linspace(0.0, 1.0, count + 1)[1:]:
            turned = hinge.displacement(np.array([share * way]))
            twisted = hinge.displacement(np.array([share * way * step.twist])).rotation() @ start.rotation()
            pose = mink.SE3.from_rotation_and_translation(twisted, turned.apply(start.translation()))
            self._lay(pose, step.fingers, abs(way) / count / (step.speed * self._timestep))

    def _lay(self, pose: mink.SE3, fingers: float, least: float) -> None:
        joints = self._arm.reach(pose, start=self._joints)
        needed = float(np.max(np.abs(joints - self._joints) / self._joint_speed))
        self._append(max(needed, least, 1e-3) if self._knots else 0.0, joints, fingers)
        self._pose = pose

    def _append(self, steps: float, joints: NDArray[np.float64], fingers: float) -> None:
        self._times.append((self._times[-1] if self._times else 0.0) + steps)
        self._knots.append(joints)
        self._fingers.append(fingers)
        self._joints = joints
