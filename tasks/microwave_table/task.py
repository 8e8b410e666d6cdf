"""The task of the microwave_table domain: reach for the handle of the microwave, and pull its door open."""

import functools
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from dm_control import mjcf

from kitchen_suite import checks
from kitchen_suite.entities.scenes import Scene
from kitchen_suite.environment_classes import MICROWAVE_TABLE_ENVIRONMENT
from kitchen_suite.tasks.control_modes.action_mode import ActionMode
from kitchen_suite.tasks.control_modes.joints import DEFAULT_POSE, JointOffset
from kitchen_suite.tasks.control_modes.registry import OFFSET_MODES, make_mode, split_options
from kitchen_suite.tasks.goals import OPEN_MICROWAVE, Goal, GoalSet
from kitchen_suite.tasks.highlighting import Highlighting
from kitchen_suite.tasks.metrics import OpeningRecords
from kitchen_suite.tasks.microwave_table.mdp import (
    CONTROL_TIMESTEP,
    OPEN_ANGLE,
    REWARDS,
    MicrowaveTableMDP,
)
from kitchen_suite.tasks.microwave_table.variations import VARIED
from kitchen_suite.tasks.sensors import FeatureSensors, SceneIndices
from kitchen_suite.tasks.task import SuiteTask
from kitchen_suite.tasks.variations.randomizer import Values
from kitchen_suite.tasks.variations.variations import START_DISTANCE

GOAL = Goal(prop="microwave", value=(OPEN_ANGLE,), instructions=OPEN_MICROWAVE)

RESET_NOISE = 0.05  # Greatest noise on each joint of the arm at the start [rad].

# The cabinet's control modes, with a gripper that draws nothing.
CONTROL_MODES: Mapping[str, Callable[..., ActionMode]] = MappingProxyType(
    {**OFFSET_MODES, "joint_offset": functools.partial(JointOffset, gripper="deterministic")}
)


class MicrowaveTableTask(SuiteTask):
    """Open the door of a microwave on a table.

    Start: the robot in its initial pose before the microwave, with noise U(-0.05, 0.05) rad on the arm's joints; the
      door closed.
    Reward: at each step, the sum of two terms, those of `mdp.REWARDS`, in [0, 6].
    End: discount 1 at the time limit. Success, the door within 0.3 rad of -0.75 rad, does not end the episode.
    Observations: 23 numbers in five named parts, in single precision, without noise.
    """

    mdp: MicrowaveTableMDP

    default_control_timestep = CONTROL_TIMESTEP
    domain_name = "microwave_table"
    environment_classes = MICROWAVE_TABLE_ENVIRONMENT
    instructions = OPEN_MICROWAVE
    control_modes = CONTROL_MODES
    varied = VARIED

    def __init__(
        self, scene: Scene, *, threshold: float = 0.3, control_mode: str = "joint_offset", **options: Any
    ) -> None:
        """Sets the task up in a scene.

        Args:
          scene: robot and microwave in their arena; each task needs a scene of its own.
          threshold: distance from the goal below which the door counts as open [rad].
          control_mode: meaning of the action: a name in `control_modes`; see docs/guide/control_modes.md.
          **options: those of `SuiteTask`, and arguments of the control mode, as in `OpenCabinetTask`; `gripper` is
            `deterministic` by default.

        Raises:
          TypeError: an argument of the wrong type.
          ValueError: an unknown name, or a threshold that is negative or not finite.
        """
        control, observables = split_options(options, self.control_modes)
        self._goals = GoalSet.build({"microwave": GOAL}, ["microwave"])
        mdp = MicrowaveTableMDP(
            sensors=_sensors(scene),
            action_mode=make_mode(control_mode, self.control_modes, control),
            rewards=REWARDS,
            threshold=checks.number(threshold, "threshold"),
        )
        super().__init__(scene, mdp, **observables)
        self.vary(
            handles=[goal.handle_in(scene) for goal in self._goals.goals],
            home=DEFAULT_POSE,
            correct=self._away_from_goal,
        )

    def __repr__(self) -> str:
        return f"{type(self).__name__}(threshold={self.mdp.threshold:g})"

    def make_records(self) -> OpeningRecords:
        return OpeningRecords(self, "door")

    def bind(self, physics: mjcf.Physics) -> None:
        self._indices = SceneIndices(self.scene, self._goals, physics)
        self._highlighting = Highlighting(physics, [GOAL.geoms_in(self.scene)])

    def state_definition(self) -> dict[str, Any]:
        return {**super().state_definition(), "threshold": self.mdp.threshold}

    def _away_from_goal(self, values: Values) -> Values:
        """Returns values with which the door does not start nearly open."""
        door = self.simulation.read("qpos", self._indices.object_qpos)
        is_near = self._goals.distances(door) < START_DISTANCE * self.mdp.threshold
        if "microwave/door" not in values or not is_near.any():
            return values
        return {**values, "microwave/door": self.variations.randomizer.defaults["microwave/door"]}

    def reset_physics(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        data = physics.data
        pose = DEFAULT_POSE + np.append(random_state.uniform(-RESET_NOISE, RESET_NOISE, 7), (0.0, 0.0))
        data.qpos[self._indices.robot_qpos] = pose
        data.qpos[self._indices.object_qpos] = 0.0
        data.qvel[:] = 0.0
        data.ctrl[self._indices.ctrl] = pose

    def publish(self, physics: mjcf.Physics | None) -> None:
        """Updates the door's colour."""
        if self._visualize_reward:
            self._highlighting.update([bool(self.state.is_success)])


def _sensors(scene: Scene) -> FeatureSensors:
    """Adds the sensors of robot, fingertips, handle and door to a scene that is not yet compiled."""
    door = scene.joints("microwave")
    sensors = FeatureSensors(scene.arena.mjcf_model, scene.robot)
    sensors.add_joints("joint_positions", "jointpos", scene.robot.joints)
    sensors.add_joints("joint_velocities", "jointvel", scene.robot.joints)
    sensors.add_frame("tcp_position", "framepos", scene.robot.end_effector)
    sensors.add_frame("handle_position", "framepos", scene.props["microwave"].mjcf_model.find("site", "handle"))
    sensors.add_joints("door_position", "jointpos", door)
    sensors.add_joints("door_velocity", "jointvel", door)
    return sensors
