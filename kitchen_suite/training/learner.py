"""One agent that learns from one vectorised environment, batch by batch."""

import collections
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray

from kitchen_suite.policies.trained import flat
from kitchen_suite.training import agent as agents
from kitchen_suite.training import behaviour_cloning
from kitchen_suite.training.hyperparameters import Hyperparameters
from kitchen_suite.training.metrics import episode_metrics, step_metrics
from kitchen_suite.vector_env.base import SuiteVectorEnv
from kitchen_suite.vector_env.open_cabinet import FrankaOpenCabinetVectorEnv


class DivergedError(Exception):
    """A network's parameters are no longer finite."""


class Learner:
    """An agent, its environments and what it has seen of them so far.

    Attributes:
      agent: skrl's.
      steps: control steps learned from so far, over all environments.
    """

    def __init__(self, environments: SuiteVectorEnv, config: Hyperparameters, seed: int) -> None:
        """Builds the agent.

        Args:
          environments: `num_envs` of them, with autoreset mode `SameStep`.
          config: what it is tuned by.
          seed: of the networks and of exploration.
        """
        torch.manual_seed(seed)
        self._environments, self._config = environments, config
        self._observations = torch.empty(0)
        size, action_space = _sizes(environments)
        self.agent = agents.build(size, action_space, config)
        self._scheduler = self.agent.scheduler
        self.steps = 0
        self._standardised, self._values_only = False, 0

    def imitate(
        self, observations: NDArray[np.float32], actions: NDArray[np.float32], watch: Callable[[float], None]
    ) -> None:
        """Learns to do what was done; from then on the policy changes once its values are known.

        Args:
          observations: `(m, n)`, as a trained policy takes them.
          actions: `(m, k)`.
          watch: called after each pass with its mean loss.
        """
        behaviour_cloning.clone(self.agent, observations, actions, self._config.clone_epochs, watch)
        self._standardised, self._values_only = True, self._config.value_batches

    def start(self, seed: int) -> None:
        """Starts episodes at evenly spread times, so that a batch shows all parts of an episode.

        What is seen meanwhile decides on how observations are standardised, where nothing has before.

        Args:
          seed: of the first environment; each further one has the next.
        """
        environments, count = self._environments, self._environments.num_envs
        if isinstance(environments, FrankaOpenCabinetVectorEnv):
            # The penalties' weights depend on it.
            environments.total_steps = np.full(count, self.steps // count)
        observations, _ = environments.reset(seed=seed)
        length = _episode_length(environments)
        turn = np.random.default_rng(seed).permutation(count) * length // count
        self._observations = _tensor(observations)
        scaler = self.agent.checkpoint_modules["observation_preprocessor"]
        for step in range(length):
            observations, *_ = environments.step(self._act())
            if (starting := turn == step).any():
                observations, _ = environments.reset(options={"reset_mask": starting})
            self._observations = _tensor(observations)
            if not self._standardised:
                scaler(self._observations, train=True)
        self._standardised = True

    def state(self) -> dict[str, Any]:
        """What `load_state` goes on from, but for the episodes that are being played."""
        modules = {name: module.state_dict() for name, module in self.agent.checkpoint_modules.items()}
        random = torch.get_rng_state()
        return {"modules": modules, "random": random, "steps": self.steps, "values_only": self._values_only}

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Goes on from a state."""
        for name, module in self.agent.checkpoint_modules.items():
            module.load_state_dict(state["modules"][name])
        torch.set_rng_state(state["random"])
        self.steps, self._values_only = state["steps"], state["values_only"]
        self._standardised = True

    def learn(self) -> dict[str, float]:
        """Plays and learns from one batch.

        Returns:
          Means by name: of each step's measures, of those of the episodes that ended, and of the agent's own.

        Raises:
          DivergedError: the learning rate is too high, or rewards too great.
        """
        # What is known of a good policy should not be lost to values that are not. The learning rate follows the
        # change of the policy, so it rests, too.
        changing = self._values_only == 0
        self.agent.models["policy"].requires_grad_(changing)
        self.agent.scheduler = self._scheduler if changing else None
        self._values_only = max(0, self._values_only - 1)
        # Within an update it follows the policy's divergence as the policy's does; the next starts from its own.
        agents.value_group(self.agent)["lr"] = self._config.value_learning_rate
        seen: dict[str, list[NDArray]] = collections.defaultdict(list)
        for _ in range(self._config.rollouts):
            for name, values in self._step().items():
                seen[name].append(values)
        self.steps += self._config.batch
        for name, model in self.agent.models.items():
            if not all(parameter.isfinite().all() for parameter in model.parameters()):
                raise DivergedError(f"after {self.steps} steps the {name} network is no longer finite: learn slower")
        return {**{name: float(np.concatenate(parts).mean()) for name, parts in seen.items()}, **self._own_measures()}

    def _act(self) -> NDArray[np.float32]:
        with torch.no_grad():
            actions, _ = self.agent.act(self._observations, None, timestep=0, timesteps=0)
        self._actions = actions
        return actions.numpy()

    def _step(self) -> dict[str, NDArray]:
        """Makes a control step in all environments, and learns when the batch is full."""
        observations, rewards, terminations, truncations, infos = self._environments.step(self._act())
        fresh, ended = _tensor(observations), terminations | truncations
        with torch.no_grad():
            self.agent.record_transition(
                observations=self._observations,
                states=None,
                actions=self._actions,
                rewards=_column(rewards, torch.float32),
                next_observations=_before_reset(fresh, infos),
                next_states=None,
                terminated=_column(terminations, torch.bool),
                truncated=_column(truncations, torch.bool),
                infos=infos,
                timestep=0,
                timesteps=0,
            )
        self.agent.post_interaction(timestep=0, timesteps=0)
        self._observations = fresh
        measures = {"step/reward": rewards, **step_metrics(infos)}
        if ended.any():
            measures |= {name: values[ended] for name, values in episode_metrics(infos["final_info"]).items()}
        return measures

    def _own_measures(self) -> dict[str, float]:
        """What the agent noted in its last update, by TensorBoard's usual kind of name."""
        noted = {
            name.replace(" / ", "/").lower(): float(np.mean(values))
            for name, values in self.agent.tracking_data.items()
        }
        self.agent.tracking_data.clear()
        return noted


def _sizes(environments: SuiteVectorEnv) -> tuple[int, spaces.Box]:
    space, actions = environments.single_observation_space, environments.single_action_space
    assert isinstance(actions, spaces.Box)
    return spaces.flatdim(space), actions


def _episode_length(environments: SuiteVectorEnv) -> int:
    assert environments.spec
    assert environments.spec.max_episode_steps
    return environments.spec.max_episode_steps


def _tensor(observations: Any) -> torch.Tensor:
    return torch.as_tensor(flat(observations), dtype=torch.float32)


def _column(values: NDArray, kind: torch.dtype) -> torch.Tensor:
    return torch.as_tensor(values, dtype=kind)[:, None]


def _before_reset(fresh: torch.Tensor, infos: Mapping[str, Any]) -> torch.Tensor:
    """What each step led to: the last observation where an episode ended, not the first of the next."""
    if "final_obs" not in infos:
        return fresh
    led_to = fresh.clone()
    for i in np.flatnonzero(infos["_final_obs"]):
        led_to[i] = _tensor(infos["final_obs"][i])
    return led_to
