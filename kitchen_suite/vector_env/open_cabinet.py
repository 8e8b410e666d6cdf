"""The vectorised cabinet: many cabinets stepped together as one Gymnasium vector environment."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import mujoco
import numpy as np
from numpy.typing import NDArray

from kitchen_suite.gymnasium_env.open_cabinet import FrankaOpenCabinetEnv
from kitchen_suite.tasks.open_cabinet import observation as drawer_observation
from kitchen_suite.tasks.open_cabinet import randomization as drawer_randomization
from kitchen_suite.tasks.open_cabinet.mdp import OpenCabinetState
from kitchen_suite.vector_env.base import SuiteVectorEnv


# VectorEnv is named again because some libraries recognise vectorised environments by their direct bases.
class FrankaOpenCabinetVectorEnv(SuiteVectorEnv, gymnasium.vector.VectorEnv):
    """A vector of `FrankaOpenCabinetEnv`s. Accepts the arguments of `SuiteVectorEnv` and of `FrankaOpenCabinetEnv`.

    Each environment counts its control steps over all its episodes. The weights of the penalties depend on the count.
    """

    env_class = FrankaOpenCabinetEnv
    # The sensors must be computed from the state after the step.
    stage = mujoco.mjtStage.mjSTAGE_VEL
    _template_env: FrankaOpenCabinetEnv
    _state: OpenCabinetState

    def __init__(self, num_envs: int = 1, **settings: Any) -> None:
        """Builds the environments; see `SuiteVectorEnv` and `FrankaOpenCabinetEnv` for arguments and errors."""
        super().__init__(num_envs, **settings)
        task = self._template_env.environment.task
        self._mdp, self._sensors = task.mdp, task.sensors
        self._total_steps = np.zeros(self.num_envs, np.int64)

    @property
    def total_steps(self) -> NDArray[np.int64]:
        """Control steps `(n,)` over all episodes of each environment, since it was built or `begin_run` was called."""
        return self._total_steps.copy()

    @total_steps.setter
    def total_steps(self, value: NDArray[np.int64]) -> None:
        self._total_steps[:] = value

    def begin_run(self, mask: NDArray[np.bool_] | None = None) -> None:
        self._total_steps[slice(None) if mask is None else mask] = 0

    def _randomized_fields(self) -> Sequence[str]:
        return drawer_randomization.MODEL_FIELDS if self._template_env.environment.task.is_randomized else ()

    def _apply_actions(self, actions: NDArray[np.float64], stepping: NDArray[np.bool_]) -> None:
        draw: NDArray[np.float64] | float = 0.5
        if self._mdp.samples_gripper:
            each = zip(self._streams, stepping.tolist(), strict=True)
            draw = np.array([stream.sample() if draws else 0.5 for stream, draws in each])
        self._actions = self._template_env.clip_actions(actions)
        positions = self._field("qpos")[:, self._sensors.joint_qpos]
        self._target = self._mdp.compute_control(positions, self._actions, draw)
        self._field("ctrl")[:, self._sensors.ctrl] = self._target

    def _post_step(self, stepping: NDArray[np.bool_]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        noise = self._state.noise
        if self._mdp.is_noisy:
            noise = noise.copy()
            for i in np.flatnonzero(stepping):
                noise[i] = self._mdp.draw_noise(self._streams[i].random_state)
        self._state = self._mdp.step(
            self._state,
            action=self._actions,
            target=self._target,
            total_steps=self._total_steps,
            # Transposed in memory: the MDP computes with columns, which are then contiguous.
            features=self._field("sensordata").T.take(self._sensors.columns, axis=0).T,
            noise=noise,
        )
        self._total_steps += stepping
        return self._state.reward, self._state.terminates

    def _get_obs(self) -> NDArray[np.float32]:
        values = self._state.observation
        return drawer_observation.clipped(values + self._state.noise if self._mdp.is_noisy else values)

    def _get_info(self) -> dict[str, NDArray]:
        return {**self._mdp.info(self._state), "episode_step": self._episode_steps.copy()}
