"""The controller that all experts share: it follows a joint trajectory, and detects when the arm cannot follow."""

import abc
import dataclasses
import math
from collections.abc import Callable, Collection, Mapping
from typing import Any, ClassVar, Self

import dm_env
import mink
import numpy as np
from dm_control import composer
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks, suite
from kitchen_suite.policies.experts.encoders import ActionEncoder
from kitchen_suite.policies.experts.skills import Skill
from kitchen_suite.policies.experts.trajectories import JointTrajectory, plan, plan_retreat
from kitchen_suite.tasks.control_modes.action_mode import ActionMode
from kitchen_suite.types import Array

_MAX_HALTED_STEPS = 12  # A trajectory that the arm does not follow is halted, and fails after this many control steps.


@dataclasses.dataclass(frozen=True, kw_only=True)
class MotionStyle:
    """Variation of an expert's motions, for diverse demonstrations.

    Attributes:
      speed: fraction of the expert's greatest speed, above 0 and at most 1.
      action_noise: standard deviation of normal noise on the arm's elements of the action, in their unit.
      jitter: half width of the uniform displacement, along each axis, of the hand's poses in free space [m].
      random_actions: probability of a uniform action of the arm, in each control step, in place of its own.
    """

    speed: float = 1.0
    action_noise: float = 0.0
    jitter: float = 0.0
    random_actions: float = 0.0

    def __post_init__(self) -> None:
        checks.number(self.speed, "speed", positive=True, maximum=1.0)
        checks.number(self.action_noise, "action_noise")
        checks.number(self.jitter, "jitter")
        checks.number(self.random_actions, "random_actions", maximum=1.0)


class Expert(abc.ABC):
    """A policy on observations alone; one instance plays one episode at a time.

    Subclasses read the observation and plan the trajectories; an encoder turns these into actions of a control mode.
    Their constructors take `style`, the speed, noise and jitter of the motions; and, as the environment has them,
    `control_mode` and the arguments of that mode.

    Attributes:
      control_modes: classes of the control modes by name; the first is the default.
      observation_size: elements of an observation.
      encoder: turns the planned joint positions into actions.
    """

    control_modes: ClassVar[Mapping[str, Callable[..., ActionMode]]]
    observation_size: int

    # Share of the style's speed at which the trajectory is followed at present.
    _pace: float = 1.0
    _skill: Skill  # From which the hand retreats.
    _target: Array  # Of the arm's joints in the last control step; their positions where a trajectory begins [rad].

    def __init__(self, style: MotionStyle | None, encoder: ActionEncoder) -> None:
        """Prepares for episodes; the encoder has the arm's kinematics and speed limits."""
        if not isinstance(style, MotionStyle | None):
            raise TypeError(f"style must be a MotionStyle, got {checks.shown(style)}")
        self._style, self.encoder = style or MotionStyle(), encoder
        self._kinematics, self._limits = encoder.arm.kinematics, encoder.limits
        if self._style.random_actions and not np.isfinite(np.append(encoder.low, encoder.high)).all():
            raise ValueError("random_actions needs a control mode whose actions have bounds")
        self.reset(np.random.default_rng(0))

    @classmethod
    def for_task(cls, task: Any, **options: Any) -> Self:
        """Builds the expert for a task from the task's settings, with other options as `make`."""
        expert = cls.unchecked(task, **options)
        expert.check_observes(task.variations.layout)
        return expert

    @classmethod
    def unchecked(cls, task: Any, **options: Any) -> Self:
        """Builds the expert as `for_task`, also where it does not observe all objects that it would move."""
        mode = task.mdp.action_mode
        settings = mode.settings if options.get("control_mode", mode.name) == mode.name else {}
        expert = cls(**{"control_mode": mode.name, **settings, **cls._task_settings(task), **options})
        timestep = expert.encoder.arm.timestep
        if not math.isclose(task.control_timestep, timestep):
            found = f"not of {task.control_timestep:g} s"
            raise ValueError(f"the expert acts in control steps of {timestep:g} s, {found}: leave out control_timestep")
        return expert

    @classmethod
    def missing_in(cls, task: Any) -> list[str]:
        """Returns the names of the extra observables that the expert needs in a task and that the task lacks."""
        return cls(**cls._task_settings(task)).missing_observables(task.variations.layout)

    @classmethod
    def _task_settings(cls, task: Any) -> dict[str, Any]:
        """Returns the arguments of the class that a task sets, other than those of its control mode."""
        return {}

    def check_observes(self, varied: Collection[str]) -> None:
        """Raises a ValueError unless the expert observes the poses of all objects that it moves and that a task varies.

        Parameters that the task varies have names such as `microwave/offset`.
        """
        if missing := self.missing_observables(varied):
            raise ValueError(f"the expert needs extra_observables {missing} where the task varies {sorted(varied)}")

    def missing_observables(self, varied: Collection[str]) -> list[str]:
        """Returns the names of the extra observables that the expert lacks where parameters vary."""
        return []

    def reset(self, generator: np.random.Generator) -> None:
        """Begins an episode; the generator is the source of jitter and action noise, if the style has them."""
        self._generator = generator
        self._trajectory: JointTrajectory | None = None
        self._time, self._halted_steps = 0.0, 0

    def act(self, observation: ArrayLike) -> NDArray[np.float32]:
        """Returns the next action, within its bounds.

        The flat observation of the environment, without goals, is checked for its shape and finite numbers.
        """
        observation = checks.vector(observation, self.observation_size, "observation")
        positions = self.robot_positions(observation)
        joints, encoder, style = positions[self._kinematics.arm], self.encoder, self._style
        if self._trajectory is None:
            encoder.reset(joints)
        if (trajectory := self._next_trajectory(observation, joints)) is not None:
            self._trajectory, self._time, self._halted_steps, self._target = trajectory, 0.0, 0, joints
        if encoder.follows(joints, self._target):
            self._time, self._halted_steps = self._time + style.speed * self._pace, 0
        else:
            self._halted_steps += 1
        self._target, fingers = self._current_trajectory.at(self._time)
        action, size = encoder.encode(positions, self._target, fingers), encoder.arm_size
        if style.action_noise:
            action[:size] += style.action_noise * self._generator.standard_normal(size)
        if style.random_actions and self._generator.random() < style.random_actions:
            action[:size] = self._generator.uniform(encoder.low, encoder.high, action.shape)[:size]
        bounded = np.clip(action, encoder.low, encoder.high).astype(np.float32)
        encoder.applied(positions, bounded.astype(np.float64))
        return bounded

    def without_goals(self, flat: NDArray) -> NDArray:
        """Returns the observation that `act` takes, from the flat one with goals."""
        return flat[: self.observation_size]

    @property
    def _current_trajectory(self) -> JointTrajectory:
        assert self._trajectory is not None, "the first observation starts a trajectory"
        return self._trajectory

    @property
    def _current_fingers(self) -> float:
        """Opening of each finger that the trajectory has at present [m]."""
        return self._current_trajectory.at(self._time)[1]

    def _has_ended(self, settle_steps: float) -> bool:
        """Returns whether the trajectory ended that many control steps ago, or the arm cannot follow it."""
        return self._time >= self._current_trajectory.duration + settle_steps or self._halted_steps >= _MAX_HALTED_STEPS

    def _plan(
        self, skill: Skill, *, frame: mink.SE3 | None = None, object_position: Array | None = None
    ) -> JointTrajectory:
        """Plans a skill as `trajectories.plan`, with poses in free space displaced by the style's jitter."""
        jitter, count = self._style.jitter, sum(move.in_free_space for move in skill.lines)
        offsets = self._generator.uniform(-jitter, jitter, (count, 3)) if jitter else ()
        return plan(
            self._kinematics, self._limits, skill, frame=frame, object_position=object_position, offsets=offsets
        )

    def _plan_retreat(self, joints: Array) -> JointTrajectory:
        """Plans the retreat after the last skill, from joint positions `(7,)` [rad]."""
        fingers = self._current_fingers
        return plan_retreat(self._kinematics, self._limits, self._skill, joints=joints, fingers=fingers)

    @abc.abstractmethod
    def robot_positions(self, observation: Array) -> Array:
        """Returns the observed positions of the robot's joints, those of the arm first [rad, m]."""

    @abc.abstractmethod
    def _next_trajectory(self, observation: Array, joints: Array) -> JointTrajectory | None:
        """Returns a trajectory from the present joint positions `(7,)`, or None to continue the current one.

        The first call of an episode must return one.
        """


def make(task: composer.Task, *, kind: str = "expert", **options: Any) -> Expert:
    """Builds the expert for a task from the task's settings; it never reads the physics.

    Options are arguments of the expert's class, such as `style`, and replace those of the task; `kind` is as of
    `expert_class`.
    """
    return expert_class(task, kind).for_task(task, **options)


def expert_class(task: composer.Task, kind: str = "expert") -> type[Expert]:
    """Returns the class of the expert for a task: that of its domain; raises a ValueError if there is none.

    The attribute `kind` of the domain, `expert` or `undirected`, names the class.
    """
    domains = {domain.name: domain for domain in suite.DOMAINS.values() if getattr(domain, kind)}
    name = getattr(task, "domain_name", None)
    if name not in domains:
        names, what = ", ".join(domains), "expert" if kind == "expert" else f"{kind} expert"
        raise ValueError(f"there is no {what} for {name or type(task).__name__}; the domains with one are {names}")
    expert: type[Expert] = domains[name].resolve(kind)
    return expert


def make_policy(
    environment: composer.Environment, generator: np.random.Generator, **options: Any
) -> Callable[[dm_env.TimeStep], NDArray[np.float32]]:
    """Builds a policy that maps time steps to the expert's actions, and resets the expert at each first time step.

    `generator` is the source of jitter and action noise; options as in `make`.
    """
    expert, flatten = make(environment.task, **options), environment.task.policy_inputs.flatten

    def policy(timestep: dm_env.TimeStep) -> NDArray[np.float32]:
        if timestep.first():
            expert.reset(generator)
        return expert.act(expert.without_goals(flatten(timestep.observation).ravel()))

    return policy
