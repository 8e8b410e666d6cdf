"""Observation and reward of the open_cabinet domain, computed independently of the task from MuJoCo's named arrays."""

import numpy as np
from scipy.spatial.transform import Rotation

LOW = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973, 0.0])
HIGH = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973, 0.04])
TERMS = ["approach", "orientation", "grasp", "opening", "straddling", "effort", "termination"]
ROBOT_JOINTS = [*(f"franka/joint{i}" for i in range(1, 8)), "franka/finger_joint1", "franka/finger_joint2"]


def flat(timestep):
    return np.concatenate(list(timestep.observation.values()))


class Recomputed:
    def __init__(self, physics, drawer, change, total_steps):
        named = physics.named.data
        self.q, self.v = named.qpos[ROBOT_JOINTS], named.qvel[ROBOT_JOINTS]
        self.tcp = named.site_xpos["franka/gripper"].copy()
        self.handle = named.site_xpos[f"cabinet/drawer_{drawer}_handle"].copy()
        self.tcp_turn = Rotation.from_matrix(named.site_xmat["franka/gripper"].reshape(3, 3))
        self.handle_turn = Rotation.from_matrix(named.site_xmat[f"cabinet/drawer_{drawer}_handle"].reshape(3, 3))
        self.pad_positions = [named.geom_xpos[f"franka/{side}_finger_pad"].copy() for side in ("left", "right")]
        self.pads = [position[2] for position in self.pad_positions]
        self.open = named.qpos[f"cabinet/drawer_{drawer}_joint"].item()
        self.speed = named.qvel[f"cabinet/drawer_{drawer}_joint"].item()
        self.gripper = named.ctrl["franka/finger_joint1"].item()
        self.change, self.total_steps = change, total_steps
        self.distance = np.sqrt(((self.handle - self.tcp) ** 2).sum())

    @property
    def observation(self):
        handle, tcp = self.handle_turn.as_quat(canonical=True), self.tcp_turn.as_quat()
        tcp = tcp if handle @ tcp >= 0 else -tcp
        scaled = 2 * (self.q[:8] - LOW) / (HIGH - LOW) - 1
        parts = [scaled, self.v[:8] / 2, self.handle - self.tcp, handle - tcp, [self.open], [self.speed]]
        return np.clip(np.concatenate(parts), -5, 5)

    @property
    def terminates(self):
        return self.tcp[0] - self.handle[0] < -0.03 or abs(self.v).max() > 5

    @property
    def terms(self):
        opened = min(max(self.open, 0), 1)
        opening = 0 if opened > 0 and self.distance > 0.03 else 20 * (np.exp(opened) - 1)
        angle = (self.handle_turn * self.tcp_turn.inv()).magnitude()
        action, velocity = (1e-3, 0) if self.total_steps < 8000 else (2e-3, 2e-7)
        return {
            "approach": 10 * (1 - np.tanh(self.distance / 0.1)),
            "orientation": 1 if opening > 0 else np.cos(angle),
            "grasp": (100 if self.distance < 0.025 else -20) * (0.04 - self.gripper),
            "opening": opening,
            "straddling": min(self.pads[0] - self.handle[2], 0) + min(self.handle[2] - self.pads[1], 0),
            "effort": -action * (self.change**2).sum() - velocity * (self.v[:8] ** 2).sum(),
            "termination": -10 if self.terminates else 0,
        }


class RecomputedGrasp(Recomputed):
    """Recomputes the reward `grasp`."""

    @property
    def terms(self):
        return {
            **super().terms,
            "orientation": 4 * np.cos((self.handle_turn * self.tcp_turn.inv()).magnitude()),
            "grasp": 4 * self.enclosure * (1 - np.tanh(self.gap / 0.02))
            - 20 * (1 - self.enclosure) * (0.04 - self.gripper),
            "opening": 50 * self.holding * np.clip(self.open, 0, 1)
            + 10 * self.speed * (self.holding if self.speed > 0 else 1),
        }

    @property
    def holding(self):
        return self.enclosure * 0.001 / (0.001 + self.gap)

    @property
    def gap(self):
        return max(*self.spaces, 0)

    @property
    def enclosure(self):
        x, _, z = self.tcp_turn.inv().apply(self.nearest - self.tcp)
        along = np.linalg.norm(self.nearest - self.handle)
        shares = [3 - 3 * abs(x) / 0.0105, 3 - 3 * abs(z) / 0.0095, 3 - 3 * along / 0.03, 2 + min(self.spaces) / 0.003]
        return np.prod(np.clip(shares, 0, 1))

    @property
    def nearest(self):
        """Point of the bar's axis that is nearest to the gripper."""
        bar = self.handle_turn.as_matrix()[:, 0]
        return self.handle + bar * (bar @ (self.tcp - self.handle))

    @property
    def spaces(self):
        """Gaps between the inner faces of the pads and the bar, across the gripper."""
        inwards = [-self.tcp_turn.as_matrix()[:, 1], self.tcp_turn.as_matrix()[:, 1]]
        faces = [pad + 0.005 * inward for pad, inward in zip(self.pad_positions, inwards, strict=True)]
        return [inward @ (self.nearest - face) - 0.006 for face, inward in zip(faces, inwards, strict=True)]
