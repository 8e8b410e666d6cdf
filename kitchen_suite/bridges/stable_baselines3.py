"""The vectorised environments as a Stable-Baselines3 `VecEnv`; needs stable-baselines3."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv, VecMonitor

from kitchen_suite import checks
from kitchen_suite.vector_env import checks as vector_checks
from kitchen_suite.vector_env.base import SHARED_ATTRIBUTES, SuiteVectorEnv

Indices = int | Iterable[int] | None

# Methods whose results are the same in all environments.
_SHARED_METHODS = ("compute_reward", "compute_terminated", "compute_truncated")


class SuiteVecEnv(VecEnv):
    """The suite's vectorised environments with the interface of Stable-Baselines3.

    Numbers equal those of a `DummyVecEnv` of single environments. Infos have what Stable-Baselines3 reads, and those
    named on construction: `TimeLimit.truncated` always; `terminal_observation` and all others of the last step where an
    episode ends.
    """

    def __init__(self, environments: SuiteVectorEnv, *, info_keys: Sequence[str] = ()) -> None:
        """Adapts environments.

        Args:
          environments: with autoreset mode `SameStep`, and not nested observations: the kitchen's with
            `goal_format="flat"`.
          info_keys: infos that each step returns, such as the masks of tasks for hindsight relabelling.
        """
        vector_checks.autoreset_mode(environments.metadata["autoreset_mode"], AutoresetMode.SAME_STEP)
        space = environments.single_observation_space
        if isinstance(space, spaces.Dict) and any(isinstance(part, spaces.Dict) for part in space.values()):
            raise ValueError("Stable-Baselines3 does not support nested observations: pass goal_format='flat'")
        if not cast(spaces.Box, environments.single_action_space).is_bounded():
            raise ValueError("Stable-Baselines3 needs bounded actions: pass action_limit, such as action_limit=1.0")
        self.environments = environments
        self._info_keys = tuple(info_keys)
        self._actions: NDArray = np.empty(0)
        super().__init__(environments.num_envs, space, environments.single_action_space)
        self.metadata = environments.metadata

    def reset(self) -> Any:
        """Starts an episode in every environment, with the seeds given to `seed`; returns the observations."""
        observations, infos = self.environments.reset(seed=self._seeds)
        self.reset_infos = [_row(infos, i) for i in range(self.num_envs)]
        self._reset_seeds()
        return observations

    def step_async(self, actions: NDArray) -> None:
        """Takes the actions `(n, k)` of the next `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Makes a control step.

        Returns:
          Observations, of the next episode where one has ended; rewards `(n,)`; whether episodes ended `(n,)`; infos.
        """
        observations, rewards, terminations, truncations, infos = self.environments.step(self._actions)
        dones, timeouts = terminations | truncations, truncations & ~terminations
        names = ("TimeLimit.truncated", *self._info_keys)
        columns = (timeouts.tolist(), *(infos[name] for name in self._info_keys))
        result = [dict(zip(names, values, strict=True)) for values in zip(*columns, strict=True)]
        for i in np.flatnonzero(dones).tolist():
            result[i] = {
                **_row(infos["final_info"], i),
                "TimeLimit.truncated": result[i]["TimeLimit.truncated"],
                "terminal_observation": infos["final_obs"][i],
            }
            self.reset_infos[i] = _row(infos, i)
        return observations, rewards.astype(np.float32), dones, result

    def close(self) -> None:
        """Closes the environments."""
        self.environments.close()

    def get_images(self) -> Sequence[NDArray | None]:
        """Returns an image of each environment; none without the render mode `rgb_array`."""
        if self.render_mode != "rgb_array":
            return [None] * self.num_envs
        return cast(Sequence[NDArray], self.environments.render())

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """Returns an attribute of the environments, once for each index."""
        if attr_name in SHARED_ATTRIBUTES:
            values = self.environments.get_attr(attr_name)
            return [values[i] for i in self._get_indices(indices)]
        found = self.environments if hasattr(self.environments, attr_name) else self.environments.template_env
        return [getattr(found, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Raises an AttributeError: the environments share one model and their settings, which are fixed when built."""
        raise AttributeError(f"{attr_name} cannot be set: pass it to make_vec_env, which builds the environments")

    def env_method(
        self, method_name: str, *method_args: Any, indices: Indices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Calls one of `_SHARED_METHODS`, which do not depend on an episode, and returns the result for each index."""
        if method_name not in _SHARED_METHODS:
            raise AttributeError(
                f"{method_name} cannot be called: the environments are stepped together; only "
                f"{', '.join(_SHARED_METHODS)} can"
            )
        methods = self.get_attr(method_name, indices)
        return [methods[0](*method_args, **method_kwargs)] * len(methods)

    def set_options(self, options: list[dict] | dict | None = None) -> None:
        """Accepts that there are no options of the next reset, which the environments do not take one by one."""
        if options:
            got = checks.shown(options)
            raise ValueError(f"options of a reset are not supported, got {got}: pass them to make_vec_env")

    def env_is_wrapped(self, wrapper_class: type[gymnasium.Wrapper], indices: Indices = None) -> list[bool]:
        """Returns False for each index: there are no wrappers."""
        return [False for _ in self._get_indices(indices)]


def make_vec_env(
    env_id: str, num_envs: int, *, seed: int | None = None, info_keys: Sequence[str] = (), **settings: Any
) -> VecMonitor:
    """Makes vectorised environments for Stable-Baselines3, with its statistics of episodes.

    Args:
      env_id: such as `kitchen_suite.gymnasium_env:KitchenSuite/FrankaKitchen-v1`.
      num_envs: number of environments.
      seed: environment `i` is seeded with `seed + i`.
      info_keys: infos that each step returns; see `SuiteVecEnv`.
      **settings: arguments of the vectorised environment, such as `num_threads`.
    """
    environments = gymnasium.make_vec(
        env_id, num_envs, vectorization_mode="vector_entry_point", autoreset_mode=AutoresetMode.SAME_STEP, **settings
    )
    adapted = VecMonitor(SuiteVecEnv(cast(SuiteVectorEnv, environments), info_keys=info_keys))
    if seed is not None:
        adapted.seed(seed)
    return adapted


def _row(infos: Mapping[str, Any], i: int) -> dict[str, Any]:
    """Returns the infos of environment `i`."""
    return {key: value[i] for key, value in infos.items() if not key.startswith(("_", "final_"))}
