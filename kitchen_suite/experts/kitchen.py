"""The kitchen's expert: skill after skill, from noisy observations to joint velocities."""

import functools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.entities import KITCHEN
from kitchen_suite.experts.arm import ARM, Arm
from kitchen_suite.experts.expert import Expert, Seen, Style
from kitchen_suite.experts.kitchen_skills import ORDER, SKILLS
from kitchen_suite.experts.planning import Path, Planner
from kitchen_suite.experts.skills import OPEN
from kitchen_suite.tasks import noise
from kitchen_suite.tasks.goals import GoalSet
from kitchen_suite.tasks.kitchen import CONTROL_TIMESTEP
from kitchen_suite.tasks.kitchen_start import INITIAL_QPOS

_SERVOS = [link.servo for link in KITCHEN.links]
_GAINS = np.array([servo.gain for servo in _SERVOS])
# Share of its error that a servo makes up in a control step: gain and damping of the joint make a first-order lag.
_RESPONSE = 1.0 - np.exp(-CONTROL_TIMESTEP * _GAINS / np.array([servo.damping for servo in _SERVOS]))
_UNIT = 2.0 * CONTROL_TIMESTEP
JOINT_SPEED = np.array([0.06] * 4 + [0.08] * 3)  # [rad / control step]


class KitchenExpert(Expert):
    def __init__(self, tasks: Sequence[str], *, threshold: float = 0.3, style: Style | None = None, debug=False) -> None:
        self._goals = GoalSet.build(tasks)
        self._threshold = threshold - 0.005
        self._arm = Arm("kitchen")
        self._planner = Planner(self._arm, joint_speed=JOINT_SPEED, timestep=CONTROL_TIMESTEP)
        self._low, self._high = -np.ones(9), np.ones(9)
        self._noise_scale = 1.0
        self.debug = debug
        super().__init__(style)

    def reset(self, generator):
        super().reset(generator)
        self._left = [task for task in ORDER if task in self._goals.tasks]
        self._task = self._previous = None
        self._n = 0; self.log = []

    def _see(self, observation):
        positions = observation[noise.PARTS[0]]
        return Seen(joints=positions[ARM], fingers=positions[7:])

    def _next_path(self, observation, seen):
        objects = observation[noise.PARTS[2]]
        d = self._goals.distances(objects[self._goals.elements])
        distances = dict(zip(self._goals.tasks, d))
        self._n += 1
        if self.debug and self._task:
            print(self._n, self._task, 't %.1f/%.1f' % (self._time, self._path.duration), 'lag', np.abs(self._reference-seen.joints).max().round(3), self._arm.pose(seen.joints).translation().round(3), seen.fingers.round(3), round(distances[self._task],4))
        if self._task is not None:
            if distances[self._task] < self._threshold:
                self._left.remove(self._task)
                self.log.append((self._task, self._n))
            elif self._time < self._path.duration + 6:
                return None
            else:
                self._left.append(self._left.pop(0))
        if not self._left:
            return None
        previous, self._task = self._task, self._left[0]
        skill = SKILLS[self._task]
        value = skill.thing.value(objects) if skill.thing else None
        path = self._planner.skill(skill, value)
        if previous is None:
            start = Path(times=np.zeros(1), knots=seen.joints[None], fingers=np.array([path.fingers[0]]))
        else:
            start = self._planner.retreat(seen.joints, SKILLS[previous], float(self._path.at(self._time)[1]))
        if self.debug:
            full = start.then(path, JOINT_SPEED)
            print('PLAN', self._task, 'retreat', start.duration, 'transit', full.duration - path.duration - start.duration, path.times.round(1))
        return start.then(path, JOINT_SPEED)

    def _command(self, seen, reference, fingers):
        arm = (reference - seen.joints) / _RESPONSE + self._arm.gravity(seen.joints) / _GAINS
        return np.concatenate([arm, fingers - seen.fingers]) / _UNIT
