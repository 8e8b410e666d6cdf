"""Open a drawer of the cabinet: reach for its handle, grasp it, pull."""

import collections
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from dm_control import mjcf
from dm_control.composer.observation import observable
from dm_env import specs
from numpy.typing import ArrayLike

from kitchen_suite import checks
from kitchen_suite.entities import CabinetArena, CabinetScene
from kitchen_suite.entities.cabinet import DRAWERS
from kitchen_suite.tasks.drawer_control import (
    GRIPPER_OPEN,
    JOINT_HIGH,
    JOINT_LOW,
    arm_target,
    gripper_target,
)
from kitchen_suite.tasks.drawer_observables import DrawerObservables
from kitchen_suite.tasks.drawer_randomization import Randomization, Randomizer, checked
from kitchen_suite.tasks.drawer_reward import TERMS, reward_terms, succeeds, terminates
from kitchen_suite.tasks.drawer_sensors import DrawerSensors
from kitchen_suite.tasks.drawer_snapshot import Snapshot
from kitchen_suite.tasks.suite_task import SuiteTask

PHYSICS_TIMESTEP = 0.005  # [s]
CONTROL_TIMESTEP = 0.01  # [s]
TIME_LIMIT = 7.0  # [s], 700 control steps
GRIPPER_MODES = ("sampled", "deterministic")

# How the robot starts [rad; fingers: m], before noise of at most as much on each joint [rad, m].
DEFAULT_POSE = np.array([*np.deg2rad([0.0, -30.0, 0.0, -156.0, 0.0, 186.0, -45.0]), GRIPPER_OPEN, GRIPPER_OPEN])
RESET_NOISE = 0.125

_ACTION_SIZE = JOINT_LOW.size
_OPEN_RGBA = (0.25, 0.75, 0.3, 1.0)


class OpenCabinetTask(SuiteTask):
    """Pull a drawer of the cabinet open.

    Start: the robot bent before the cabinet, each joint off by U(-0.125, 0.125) within its limits; everything closed.
    Reward: of each step, the sum of the seven terms of `drawer_reward.reward_terms`.
    End: discount 0 when the gripper reaches through the handle or a joint moves faster than 5 rad/s or m/s; at the
      time limit discount 1. Success, an opening of 0.3 m or more, ends nothing.
    Observations: 25 numbers in six named parts, in single precision, clipped to [-5, 5].
    Source: franka-open-cabinet of MotrixLab; docs/open_cabinet.md lists where and why this task differs from it.
    """

    def __init__(
        self,
        scene: CabinetScene,
        *,
        drawer: str = "top",
        gripper: str = "sampled",
        observation_noise: Mapping[str, float] | None = None,
        randomization: Randomization | None = None,
    ) -> None:
        """Sets the task up in a scene.

        Args:
          scene: where it takes place; one scene serves one task.
          drawer: `top` or `bottom`.
          gripper: `sampled` closes with the probability that the action's last element stands for; `deterministic`
            closes where that is above one half, and draws nothing.
          observation_noise: half width of the uniform noise on parts of the observation, by their names, in the units
            of the part; none when omitted.
          randomization: what else a reset draws; nothing when omitted.

        Raises:
          TypeError: an argument of the wrong type.
          ValueError: an unknown name, or a width that is negative or not finite.
        """
        self._drawer = checks.choice(drawer, DRAWERS, "drawer")
        self._samples_gripper = checks.choice(gripper, GRIPPER_MODES, "gripper") == "sampled"
        self._observation = DrawerObservables(observation_noise)
        if not isinstance(randomization, Randomization | None):
            raise TypeError(f"randomization must be a Randomization, got {randomization!r}")
        self._randomization = randomization
        self._scene = scene
        self._life_steps = 0
        self._previous_action = np.zeros(_ACTION_SIZE)
        self._terminates = self._succeeded = False
        self.set_timesteps(control_timestep=CONTROL_TIMESTEP, physics_timestep=PHYSICS_TIMESTEP)

    @property
    def root_entity(self) -> CabinetArena:
        return self._scene.arena

    @property
    def scene(self) -> CabinetScene:
        """Where the task takes place."""
        return self._scene

    @property
    def drawer(self) -> str:
        """Which drawer is to be opened."""
        return self._drawer

    @property
    def task_observables(self) -> collections.OrderedDict[str, observable.Observable]:
        return self._observation.by_name.copy()

    @property
    def reward_terms(self) -> dict[str, float]:
        """The seven terms of the last step's reward by name; zeros before the first step of an episode."""
        return dict(self._terms)

    @property
    def drawer_opening(self) -> float:
        """How far the drawer is open now [m]."""
        return float(self._snapshot.drawer_position)

    @property
    def is_success(self) -> bool:
        """Whether the drawer is open by 0.3 m or more now."""
        return bool(succeeds(self._snapshot.drawer_position))

    @property
    def life_steps(self) -> int:
        """Control steps made since the task was set up; resets do not restart the count."""
        return self._life_steps

    @life_steps.setter
    def life_steps(self, value: int) -> None:
        self._life_steps = checks.whole_number(value, "life_steps", least=0)

    @property
    def episode_results(self) -> dict[str, bool | float | dict[str, int]]:
        """What came of the episode so far, for reports: open now, open at any time, how far now [m]."""
        return {
            "success": self.is_success,
            "success_at_any_time": self._succeeded,
            "drawer_opening": self.drawer_opening,
        }

    def action_spec(self, physics: mjcf.Physics) -> specs.BoundedArray:
        """Seven joint offsets [rad] and the wish to close the gripper (log odds); unbounded, but finite."""
        del physics
        # One number for both fingers: the last actuator follows the one before it.
        names = "\t".join(actuator.full_identifier for actuator in self._scene.robot.actuators[:_ACTION_SIZE])
        infinite = np.full(_ACTION_SIZE, np.inf)
        return specs.BoundedArray(infinite.shape, infinite.dtype, minimum=-infinite, maximum=infinite, name=names)

    def after_compile(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        self._random = random_state
        self._sensors = DrawerSensors(self._scene, self._drawer, physics)
        self._randomizer = self._randomization and Randomizer(self._scene, self._drawer, self._randomization, physics)
        self._ctrl = np.array(physics.bind(self._scene.robot.actuators).element_id)
        self._handle = self._scene.cabinet.handle_geoms(self._drawer)
        self._plain_rgba = np.array(physics.bind(self._handle).rgba)
        self._start(physics)

    def initialize_episode(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        # The right finger has the left one's limits.
        low, high = np.append(JOINT_LOW, JOINT_LOW[-1]), np.append(JOINT_HIGH, JOINT_HIGH[-1])
        noise = random_state.uniform(-RESET_NOISE, RESET_NOISE, DEFAULT_POSE.size)
        pose = np.clip(DEFAULT_POSE + noise, low, high)
        drawn = self._randomizer.draw(random_state) if self._randomizer else {}
        physics.data.qpos[:] = 0.0
        physics.data.qpos[self._sensors.joint_qpos] = pose
        physics.data.qvel[:] = 0.0
        physics.data.ctrl[self._ctrl] = pose
        if self._randomizer:
            self._randomizer.set(drawn)
        self._random = random_state
        self._observation.draw_noise(random_state)
        self._start(physics)

    def before_step(self, physics: mjcf.Physics, action: ArrayLike, random_state: np.random.RandomState) -> None:
        """Sets the servos' targets for the whole control step.

        Raises:
          TypeError: the action does not hold real numbers.
          ValueError: the action has another shape than (8,), or holds NaN or inf.
        """
        action = checks.vector(action, _ACTION_SIZE, "action")
        self._random = random_state
        draw = random_state.uniform() if self._samples_gripper else 0.5
        self._gripper = float(gripper_target(action[-1], draw))
        positions = physics.data.qpos[self._sensors.joint_qpos[:7]]
        physics.data.ctrl[self._ctrl[:7]] = arm_target(positions, action[:7])
        physics.data.ctrl[self._ctrl[7:]] = self._gripper
        # It may be infinite; the reward bounds it.
        with np.errstate(over="ignore"):
            self._action_change = action - self._previous_action
        self._previous_action = action.copy()

    def after_step(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        self._random = random_state
        self._observation.draw_noise(random_state)
        if not physics.legacy_step:
            # MuJoCo's own step leaves positions in space where they were before it.
            mujoco.mj_kinematics(physics.model.ptr, physics.data.ptr)
        self._show(self._sensors.read(physics))
        self._colour(physics)
        self._succeeded |= self.is_success
        self._terminates = bool(terminates(self._snapshot))
        terms = reward_terms(
            self._snapshot, gripper=self._gripper, action_change=self._action_change, life_steps=self._life_steps
        )
        self._terms = {name: float(term) for name, term in terms.items()}
        self._life_steps += 1

    def get_reward(self, physics: mjcf.Physics) -> float:
        del physics
        return sum(self._terms.values())

    def should_terminate_episode(self, physics: mjcf.Physics) -> bool:
        del physics
        return self._terminates

    def get_state(self) -> dict[str, Any]:
        return {
            "drawer": self._drawer,
            "life_steps": self._life_steps,
            "previous_action": self._previous_action.copy(),
            "terminates": self._terminates,
            "succeeded": self._succeeded,
            "terms": dict(self._terms),
            "noise": self._observation.noise.copy(),
            "snapshot": self._snapshot.arrays(),
            "randomization": dict(self._randomizer.values) if self._randomizer else {},
        }

    def set_state(self, state: Mapping[str, Any]) -> None:
        state = checks.like(state, self.get_state(), "task state")
        life_steps = checks.whole_number(state["life_steps"].item(), "life_steps", least=0)
        drawn = checked(state["randomization"])
        self._life_steps = life_steps
        self._previous_action, self._observation.noise[:] = state["previous_action"], state["noise"]
        self._terminates, self._succeeded = bool(state["terminates"]), bool(state["succeeded"])
        self._terms = {name: float(state["terms"][name]) for name in TERMS}
        if self._randomizer:
            self._randomizer.set(drawn)
        self._show(Snapshot(**state["snapshot"]))

    def _start(self, physics: mjcf.Physics) -> None:
        """Nothing has been done yet."""
        mujoco.mj_kinematics(physics.model.ptr, physics.data.ptr)
        self._previous_action = np.zeros(_ACTION_SIZE)
        self._terms = dict.fromkeys(TERMS, 0.0)
        self._terminates = self._succeeded = False
        self._show(self._sensors.read(physics))
        self._colour(physics)

    def _show(self, snapshot: Snapshot) -> None:
        self._snapshot = snapshot
        self._observation.show(snapshot)

    def _colour(self, physics: mjcf.Physics) -> None:
        if self._visualize_reward:
            physics.bind(self._handle).rgba = _OPEN_RGBA if self.is_success else self._plain_rgba
