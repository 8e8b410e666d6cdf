"""Many cabinets at once, as one Gymnasium vector environment."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import mujoco
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.gymnasium_env.open_cabinet import FrankaOpenCabinetEnv, results_arrays
from kitchen_suite.tasks.open_cabinet import observation as drawer_observation
from kitchen_suite.tasks.open_cabinet import randomization as drawer_randomization
from kitchen_suite.tasks.open_cabinet.mdp import DrawerState
from kitchen_suite.vector_env.base import SuiteVectorEnv


# VectorEnv once more: some libraries tell by the direct bases what they have to do with.
class FrankaOpenCabinetVectorEnv(SuiteVectorEnv, gymnasium.vector.VectorEnv):
    """Many `FrankaOpenCabinetEnv`s; takes its arguments beside those of `SuiteVectorEnv`.

    Each environment counts the control steps of its own life, which decide on the weights of the penalties.
    """

    single = FrankaOpenCabinetEnv
    # The sensors are to show the state after the step.
    stage = mujoco.mjtStage.mjSTAGE_VEL
    _starter: FrankaOpenCabinetEnv
    _state: DrawerState

    def __init__(self, num_envs: int = 1, **settings: Any) -> None:
        """Builds the environments; see `SuiteVectorEnv` and `FrankaOpenCabinetEnv` for the arguments and errors."""
        super().__init__(num_envs, **settings)
        task = self._starter.environment.task
        self._rules, self._sensors = task.rules, task.sensors
        self._life_steps = np.zeros(self.num_envs, np.int64)

    @property
    def life_steps(self) -> NDArray[np.int64]:
        """Control steps `(n,)` that each environment has made; resets do not restart the count."""
        return self._life_steps.copy()

    @life_steps.setter
    def life_steps(self, value: NDArray[np.int64]) -> None:
        self._life_steps[:] = value

    def drawn_model_fields(self) -> Sequence[str]:
        return drawer_randomization.MODEL_FIELDS if self._starter.environment.task.is_randomized else ()

    def apply_actions(self, actions: NDArray[np.float64], stepping: NDArray[np.bool_]) -> None:
        closing: NDArray[np.float64] | float = 0.5
        if self._rules.samples_gripper:
            each = zip(self._streams, stepping.tolist(), strict=True)
            closing = np.array([stream.sample() if draws else 0.5 for stream, draws in each])
        self._actions = self._starter.limited(actions)
        positions = self._field("qpos")[:, self._sensors.joint_qpos]
        self._target = self._rules.command(positions, self._actions, closing)
        self._field("ctrl")[:, self._sensors.ctrl] = self._target

    def book_step(self, stepping: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        noise = self._state.noise
        if self._rules.is_noisy:
            noise = noise.copy()
            for i in np.flatnonzero(stepping):
                noise[i] = self._rules.draw_noise(self._streams[i].random_state)
        self._state = self._rules.advance(
            self._state,
            action=self._actions,
            target=self._target,
            life_steps=self._life_steps,
            # Transposed in memory: the rules compute with columns, which lie in one piece then.
            snapshot=self._field("sensordata").T.take(self._sensors.columns, axis=0).T,
            noise=noise,
        )
        self._life_steps += stepping
        return self._state.reward, self._state.terminates

    def observe(self) -> NDArray[np.float32]:
        values = self._state.observation
        return drawer_observation.shown(values + self._state.noise if self._rules.is_noisy else values)

    def info(self) -> dict[str, NDArray]:
        return {**results_arrays(self._state), "episode_step": self._episode_steps.copy()}
