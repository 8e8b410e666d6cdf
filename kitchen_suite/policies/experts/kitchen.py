"""The kitchen's expert: task after task, from noisy observations to joint velocities."""

import functools
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.entities import KITCHEN_FRANKA
from kitchen_suite.policies.experts.base import Expert, MotionStyle
from kitchen_suite.policies.experts.kinematics import ARM, ArmKinematics
from kitchen_suite.policies.experts.kitchen_skills import SKILLS
from kitchen_suite.policies.experts.skills import OPEN, Move, Skill
from kitchen_suite.policies.experts.trajectories import JointSpeedLimits, JointTrajectory, plan, retreat
from kitchen_suite.tasks.kitchen import noise
from kitchen_suite.tasks.kitchen.action import position_target
from kitchen_suite.tasks.kitchen.goals import THRESHOLD, GoalSet
from kitchen_suite.tasks.kitchen.initial_state import INITIAL_QPOS
from kitchen_suite.tasks.kitchen.mdp import CONTROL_TIMESTEP, FEEDBACKS

_SERVOS = tuple(link.actuator for link in KITCHEN_FRANKA.links)
_GAINS = np.array([servo.gain for servo in _SERVOS])
# Share of its error that a servo makes up in a control step: gain and damping of the joint make a lag of first order.
_RESPONSE = 1.0 - np.exp(-CONTROL_TIMESTEP * _GAINS / np.array([servo.damping for servo in _SERVOS]))

# Speeds that the servos keep up with [rad / control step]; the shoulder's torque limit, less gravity, allows 0.06.
_JOINT_SPEED = np.array([0.06] * 4 + [0.08] * 3)

# For which velocity of a unit of action [rad/s].
_SCALE = 2.0

# A task counts as done at this share of its threshold: noise may make it look nearer than it is.
_CAUTION = 0.98
# One that has been done is to be done again beyond so many times its threshold: doors spring back a little.
_SLACK = 1.2

# Control steps after the end of a path until a task is given up: what presses on something follows late.
_LINGER = 6

# Decimals to which positions of things decide whether a path can be used again [rad, m].
_ROUNDING = 2

_ROBOT, _, _THINGS, _ = noise.PARTS

# Where the arm goes after a failure, to begin again from free space.
_HOME = INITIAL_QPOS[ARM]


class KitchenExpert(Expert):
    """Completes tasks of the kitchen one after the other; goes back to one that failed after the others."""

    observation_size = noise.AMPLITUDES.size
    _low, _high = -1.0, 1.0

    def __init__(
        self,
        tasks: Sequence[str],
        *,
        threshold: float = THRESHOLD,
        goals: Mapping[str, ArrayLike] | None = None,
        in_order: bool = False,
        velocity_scale: float = _SCALE,
        feedback: str = "observed",
        style: MotionStyle | None = None,
    ) -> None:
        """Prepares for a set of tasks.

        Args:
          tasks: names of the tasks, spelt as in `tasks.GOALS`.
          threshold: distance from its goal at which a task counts as done [rad, m]; one below the environment's makes
            the expert go on for longer than needed.
          goals: goals that replace the usual ones, by task. The hand moves the same way; it stops elsewhere.
          in_order: whether to do the tasks in the order given; else in the one that makes the hand's way short.
          velocity_scale: the environment's.
          feedback: the environment's.
          style: how to move.

        Raises:
          TypeError: an argument of the wrong type.
          ValueError: a name that is unknown or repeated, or a number out of range.
        """
        self._goals = GoalSet.build(tasks, goals)
        self._threshold = checks.number(threshold, "threshold", positive=True)
        order = tuple(tasks) if checks.boolean(in_order, "in_order") else tuple(SKILLS)
        self._order = tuple(task for task in order if task in self._goals.tasks)
        self._velocity_scale = checks.number(velocity_scale, "velocity_scale", positive=True)
        self._feedback = checks.choice(feedback, FEEDBACKS, "feedback")
        self._pace = _pace(self._velocity_scale)
        self._arm = ArmKinematics("kitchen")
        super().__init__(style)

    def reset(self, generator: np.random.Generator) -> None:
        super().reset(generator)
        self._left = list(self._order)
        self._task: str | None = None
        # The last target, if the next one starts from there.
        self._commanded: NDArray[np.float64] | None = None

    def act(self, observation: ArrayLike) -> NDArray[np.float32]:
        action = super().act(observation)
        if self._feedback == "target":
            base = self._base(np.asarray(observation)[_ROBOT])
            unit = {"velocity_scale": self._velocity_scale, "timestep": CONTROL_TIMESTEP}
            self._commanded = position_target(base, action.astype(np.float64), **unit)
        return action

    def _joints(self, observation: NDArray[np.float64]) -> NDArray[np.float64]:
        return observation[_ROBOT][ARM]

    def _new_path(self, observation: NDArray[np.float64], joints: NDArray[np.float64]) -> JointTrajectory | None:
        things = observation[_THINGS]
        distances = self._goals.distances(things[self._goals.elements]) / self._threshold
        distance = dict(zip(self._goals.tasks, distances.tolist(), strict=True))
        failed = self._task is not None and distance[self._task] >= _CAUTION
        if self._path is not None and (failed or self._task is None) and not self._has_ended(_LINGER):
            return None
        if self._task is not None:
            self._left.remove(self._task)
            self._left += [self._task] if failed else []
        elif not self._left:
            # The arm rests; what has come undone meanwhile is to be done again.
            self._left = [task for task in self._order if distance[task] > _SLACK]
        before, self._task = self._task, self._left[0] if self._left else None
        if before is None and self._task is None:
            return None
        start = self._leave(before, joints, via_home=failed)
        return start if self._task is None else start.then(self._plan(SKILLS[self._task], things), self._pace)

    def _leave(self, task: str | None, joints: NDArray[np.float64], *, via_home: bool) -> JointTrajectory:
        """The way out of a task, if there is one."""
        if task is None:
            return JointTrajectory.still(joints, OPEN)
        _, fingers = self._current_path.at(self._time)
        path = retreat(self._arm, self._pace, SKILLS[task], joints=joints, fingers=fingers)
        return path.then(JointTrajectory.still(_HOME, OPEN), self._pace) if via_home else path

    def _plan(self, skill: Skill, things: NDArray[np.float64]) -> JointTrajectory:
        values = things[list(skill.thing.elements)] if skill.thing else None
        if self._style.jitter:
            offsets = self._offsets(sum(isinstance(step, Move) and step.free for step in skill.steps))
            return plan(self._arm, self._pace, skill, values=values, offsets=offsets)
        rounded = None if values is None else tuple(values.round(_ROUNDING).tolist())
        return _planned(skill, rounded, self._velocity_scale)

    def _action(
        self, observation: NDArray[np.float64], joints: NDArray[np.float64], target: NDArray[np.float64], fingers: float
    ) -> NDArray[np.float64]:
        positions = observation[_ROBOT]
        arm = joints + (target - joints) / _RESPONSE + self._arm.gravity(joints) / _GAINS
        wanted = np.append(arm, [fingers, fingers])
        return (wanted - self._base(positions)) / (self._velocity_scale * CONTROL_TIMESTEP)

    def _base(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """What the environment adds the action to, for robot positions `(9,)` as observed [rad, m]."""
        return positions if self._commanded is None else self._commanded


@functools.lru_cache(maxsize=1024)
def _planned(skill: Skill, values: tuple[float, ...] | None, velocity_scale: float) -> JointTrajectory:
    """The path of a skill without jitter; the same in nearly all episodes, hence kept."""
    return plan(
        ArmKinematics("kitchen"), _pace(velocity_scale), skill, values=None if values is None else np.array(values)
    )


def _pace(velocity_scale: float) -> JointSpeedLimits:
    """How fast the arm may move where a unit of action is so much [rad/s]."""
    return JointSpeedLimits(joint_speed=_JOINT_SPEED * min(1.0, velocity_scale / _SCALE), timestep=CONTROL_TIMESTEP)
