"""The task of the open_cabinet domain: reach for the handle of a drawer, grasp it, and pull the drawer open."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from dm_control import mjcf

from kitchen_suite import checks
from kitchen_suite.entities import OpenCabinetScene
from kitchen_suite.entities.cabinet import DRAWERS
from kitchen_suite.environment_classes import OPEN_CABINET_ENVIRONMENT
from kitchen_suite.tasks.control_modes.joints import DEFAULT_POSE
from kitchen_suite.tasks.control_modes.registry import OFFSET_MODES, make_mode, split_options
from kitchen_suite.tasks.highlighting import Highlighting
from kitchen_suite.tasks.metrics import OpeningRecords
from kitchen_suite.tasks.open_cabinet import observation
from kitchen_suite.tasks.open_cabinet.features import Features, OpenCabinetSensors
from kitchen_suite.tasks.open_cabinet.mdp import CONTROL_TIMESTEP, OpenCabinetMDP
from kitchen_suite.tasks.open_cabinet.rewards import REWARDS
from kitchen_suite.tasks.open_cabinet.variations import VARIED
from kitchen_suite.tasks.policy_inputs import PolicyInputs
from kitchen_suite.tasks.simulation import as_columns
from kitchen_suite.tasks.task import SuiteTask

# Instructions by drawer; see `tasks.goals`.
INSTRUCTIONS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        drawer: (
            f"open the {drawer} drawer of the cabinet",
            f"open the {synonym} drawer of the cabinet",
            f"pull the {drawer} drawer of the cabinet open",
            f"pull out the {drawer} drawer by its handle",
        )
        for drawer, synonym in (("top", "upper"), ("bottom", "lower"))
    }
)

RESET_NOISE = 0.125  # Greatest noise on each joint at the start [rad, m].


class OpenCabinetTask(SuiteTask):
    """Pull a drawer of the cabinet open.

    Start: the robot in its default pose in front of the cabinet, with noise U(-0.125, 0.125) on each joint within its
      limits; drawers and doors closed.
    Reward: at each step, the sum of seven terms, those of `rewards.REWARDS`.
    End: discount 0 when the gripper reaches behind the handle or a joint moves faster than 5 rad/s or m/s; discount 1
      at the time limit. Success, an opening of 0.3 m or more, does not end the episode.
    Observations: 25 numbers in six named parts, in single precision, clipped to [-5, 5].
    Source: franka-open-cabinet of MotrixLab; docs/domains/open_cabinet.md lists the differences and their reasons.

    Attributes:
      scene: robot and cabinet in their arena.
      drawer: the drawer to be opened: `top` or `bottom`.
      reward_name: key of the reward in `rewards.REWARDS`.
    """

    scene: OpenCabinetScene
    mdp: OpenCabinetMDP

    default_control_timestep = CONTROL_TIMESTEP
    domain_name = "open_cabinet"
    environment_classes = OPEN_CABINET_ENVIRONMENT
    control_modes = OFFSET_MODES
    varied = VARIED

    def __init__(
        self,
        scene: OpenCabinetScene,
        *,
        drawer: str = "top",
        reward: str = "original",
        observation_noise: Mapping[str, float] | None = None,
        control_mode: str = "joint_offset",
        **options: Any,
    ) -> None:
        """Sets the task up in a scene.

        Args:
          scene: robot and cabinet in their arena; each task needs a scene of its own.
          drawer: drawer to be opened, `top` or `bottom`.
          reward: `original`, or `grasp`, which pays for opening only while both pads hold the handle.
          observation_noise: half widths of the uniform noise by part of the observation, in the unit of the part; no
            noise when omitted.
          control_mode: meaning of the action: a name in `control_modes`; see docs/guide/control_modes.md.
          **options: those of `SuiteTask`, and arguments of the control mode. `joint_offset` has `gripper`, by default
            `sampled`, which closes with the probability of the gripper logit, the action's last element;
            `deterministic` closes where that probability is above one half, and draws nothing. The others have
            `linear_speed`, `angular_speed`, `joint_speed` and `frame`; see `tasks.control_modes`.

        Raises:
          TypeError: an argument of the wrong type.
          ValueError: an unknown name, or a width that is negative or not finite.
        """
        self.drawer = checks.choice(drawer, DRAWERS, "drawer")
        control, observables = split_options(options, self.control_modes)
        action_mode = make_mode(control_mode, self.control_modes, control)
        (action_size,) = action_mode.spec(scene.robot).shape
        mdp = OpenCabinetMDP(
            sensors=OpenCabinetSensors(scene, drawer),
            action_mode=action_mode,
            action_size=action_size,
            noise_scale=observation.noise_scale(observation_noise),
            handle_radius=scene.cabinet.config.handle_radius,
            rewards=REWARDS[checks.choice(reward, REWARDS, "reward")],
        )
        self.reward_name = reward
        super().__init__(scene, mdp, **observables)
        self.vary(handles=[scene.cabinet.handle_site(drawer)], home=DEFAULT_POSE)

    def __repr__(self) -> str:
        return f"{type(self).__name__}(drawer={self.drawer!r}, reward={self.reward_name!r})"

    def make_records(self) -> OpeningRecords:
        return OpeningRecords(self, "drawer")

    def make_policy_inputs(self, state_size: int) -> PolicyInputs:
        name = f"{self.drawer}_drawer" + ("" if self.reward_name == "original" else f"_{self.reward_name}")
        return PolicyInputs(names=(name,), state_size=state_size)

    @property
    def instructions(self) -> tuple[str, ...]:
        return INSTRUCTIONS[self.drawer]

    @property
    def drawer_opening(self) -> float:
        """Present opening of the drawer [m]."""
        return float(self.state.drawer_position)

    @property
    def is_success(self) -> bool:
        """Whether the present opening is 0.3 m or more; with `extra_successes`, whether the episode has succeeded."""
        return bool(self.runner.mdp_info(self.episode)["is_success"])

    @property
    def total_steps(self) -> int:
        """Control steps since the task was built or `reset_statistics` was called; resets do not restart the count."""
        return int(self.state.total_steps)

    @total_steps.setter
    def total_steps(self, value: int) -> None:
        count = checks.integer(value, "total_steps", minimum=0)
        self.episode = self.episode._replace(mdp_state=self.state._replace(total_steps=np.array(count)))

    def bind(self, physics: mjcf.Physics) -> None:
        self._highlighting = Highlighting(physics, [self.scene.cabinet.handle_geoms(self.drawer)])
        self._joint_qpos = as_columns(physics.bind(self.scene.robot.joints).qposadr)
        self._cabinet_qpos = as_columns(physics.bind(self.scene.cabinet.joints).qposadr)

    def reset_physics(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        offsets = random_state.uniform(-RESET_NOISE, RESET_NOISE, DEFAULT_POSE.size)
        low, high = self.robot.joint_limits
        data, pose = physics.data, np.minimum(np.maximum(DEFAULT_POSE + offsets, low), high)
        data.qpos[self._cabinet_qpos] = 0.0
        data.qpos[self._joint_qpos] = pose
        data.qvel[:] = 0.0
        data.ctrl[self.mdp.sensors.ctrl] = pose

    def state_definition(self) -> dict[str, Any]:
        own = {"drawer": self.drawer, "reward": self.reward_name, "observation_noise": self.mdp.noise_scale}
        return {**super().state_definition(), **own}

    def saved_state(self) -> dict[str, Any]:
        state = self.state
        return {
            "drawer": self.drawer,
            "total_steps": self.total_steps,
            "previous_action": state.previous_action.copy(),
            "terminates": bool(state.terminates),
            "succeeded": bool(state.succeeded),
            "terms": self.reward_terms,
            "noise": state.noise.copy(),
            "target": state.target.copy(),
            "features": Features(state.features).arrays(),
        }

    def restore_state(self, state: Mapping[str, Any]) -> None:
        total_steps = checks.integer(state["total_steps"].item(), "total_steps", minimum=0)
        features = Features.of(**state["features"])
        start = self.mdp.initial_state(features.values, np.zeros(self.mdp.noise_draws))
        clean, noisy = self.mdp.observed(features, state["noise"])
        arrays = {name: state[name] for name in ("target", "previous_action", "terms", "terminates", "succeeded")}
        observed = {"observation": clean, "noisy_observation": noisy, "noise": state["noise"]}
        self.set_mdp_state(start._replace(**observed, **arrays, total_steps=np.array(total_steps)))

    def publish(self, physics: mjcf.Physics | None) -> None:
        """Updates the handle's colour."""
        if self._visualize_reward:
            self._highlighting.update([bool(self.state.is_success)])
