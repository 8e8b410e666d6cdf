"""Variation of the scale of the observation noise, and of the delay of targets: the group `sensing`."""

from typing import Any, NamedTuple

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.parameters import Parameter, task_parameter
from kitchen_suite.entities.robot import Robot
from kitchen_suite.tasks.episode.draws import Draws
from kitchen_suite.tasks.episode.part import EpisodePart
from kitchen_suite.tasks.mdp import MDP
from kitchen_suite.tasks.simulation import Simulation, as_columns
from kitchen_suite.tasks.variations.randomizer import Values
from kitchen_suite.types import Array

ACTION_DELAY = "sensing/action_delay"


class NoiseAndDelayState(NamedTuple):
    """Noise of the observation, and delay of the targets, in episodes.

    Attributes:
      noise: `(..., k)`, factors of the draws of the observation noise.
      delay: `(...)`, whether targets reach the actuators one control step late.
      target: `(..., 9)`, targets of the last control step; before the first, the positions at the reset [rad, m].
    """

    noise: Array
    delay: NDArray[np.bool_]
    target: Array


class NoiseAndDelay(EpisodePart):
    """Scales the parts of the observation noise, and delays the targets of the actuators by a control step."""

    # As saved states and the names of the parameters have it.
    name = "sensing"
    suits_any_model = True

    def __init__(self, mdp: MDP, robot: Robot) -> None:
        """Takes the MDP, which has the parts of the noise, and the robot that acts."""
        self._mdp = mdp
        self._robot = robot
        scales = (task_parameter(f"sensing/{part}", "1", default=1.0) for part in mdp.noise_parts)
        # Whether actions are delayed by a control step, 0 or 1.
        self.parameters: tuple[Parameter, ...] = (*scales, task_parameter(ACTION_DELAY, "control steps"))

    def bind(self, physics: mjcf.Physics) -> None:
        self._joints = as_columns(physics.bind(self._robot.joints).qposadr)

    def draw(self, values: Values, simulation: Simulation, draws: Draws) -> NoiseAndDelayState:
        noise = np.ones(self._mdp.noise_draws)
        for part, elements in self._mdp.noise_parts.items():
            noise[elements] = values.get(f"sensing/{part}", 1.0)
        positions = np.array(simulation.read("qpos", self._joints))
        delay = np.array(values.get(ACTION_DELAY, 0.0) > 0.5)
        return NoiseAndDelayState(noise, delay, self._robot.holding_targets(positions))

    def before(
        self, part: NoiseAndDelayState, simulation: Simulation, mdp_state: Any, ctrl: Array
    ) -> tuple[NoiseAndDelayState, Array]:
        late = np.where(part.delay[..., np.newaxis], part.target, ctrl)
        # A copy: the state of the MDP keeps the same array, and rows of both are set one by one.
        return part._replace(target=ctrl.copy()), late

    def scaled(self, part: NoiseAndDelayState, draws: Array) -> Array:
        return draws * part.noise
