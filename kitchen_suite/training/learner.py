"""A PPO agent that learns from one vectorised environment, batch by batch."""

import collections
import contextlib
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray

from kitchen_suite.policies.trained import flat
from kitchen_suite.training import behaviour_cloning
from kitchen_suite.training.agent import build_agent, value_group
from kitchen_suite.training.checkpoints import Checkpoint
from kitchen_suite.training.hyperparameters import Hyperparameters
from kitchen_suite.training.metrics import episode_metrics, step_metrics
from kitchen_suite.training.state_dicts import check_modules
from kitchen_suite.vector_env.base import SuiteVectorEnv


class DivergedError(Exception):
    """A network's parameters are no longer finite."""


class Learner:
    """A PPO agent and the environments that it learns from.

    Attributes:
      agent: skrl's PPO agent.
      steps: control steps learned from so far, over all environments.
    """

    def __init__(self, environments: SuiteVectorEnv, config: Hyperparameters, seed: int) -> None:
        """Builds the agent.

        Args:
          environments: `num_envs` of them, with autoreset mode `SameStep`.
          config: the hyperparameters.
          seed: of the networks and of exploration.
        """
        torch.manual_seed(seed)
        self._environments, self._config = environments, config
        action_space = environments.single_action_space
        assert isinstance(action_space, spaces.Box)
        self.agent = build_agent(spaces.flatdim(environments.single_observation_space), action_space, config)
        self.steps = 0
        self._observations, self._actions = torch.empty(0), torch.empty(0)
        # Whether the standardisation of observations has been fitted, and batches that still train the values alone.
        self._standardised, self._warmup_batches = False, 0

    def imitate(
        self, observations: NDArray[np.float32], actions: NDArray[np.float32], report: Callable[[float], None]
    ) -> None:
        """Clones demonstrations; the next `value_batches` batches then train the value network alone.

        Args:
          observations: `(m, n)`, flat.
          actions: `(m, k)`.
          report: called after each pass over the demonstrations with its mean loss.
        """
        behaviour_cloning.clone(self.agent, observations, actions, self._config.clone_epochs, report)
        self._standardised, self._warmup_batches = True, self._config.value_batches

    def start(self, seed: int) -> None:
        """Starts episodes at evenly spread times, so that a batch has steps from all parts of an episode.

        The observations made meanwhile fit the standardisation, unless cloning or a checkpoint has set it.

        Args:
          seed: of the first environment; each further environment has the next seed.
        """
        environments, count = self._environments, self._environments.num_envs
        # Rewards may depend on the steps made before an interruption.
        environments.begin_run(total_steps=self.steps // count)
        observations, _ = environments.reset(seed=seed)
        self._observations = _tensor(observations)
        length = _episode_length(environments)
        start_steps = np.random.default_rng(seed).permutation(count) * length // count
        for step in range(length):
            self._explore(starting=start_steps == step)
        self._standardised = True

    def _explore(self, starting: NDArray[np.bool_]) -> None:
        """Makes a control step without learning, then resets the environments that are `starting`."""
        observations, *_ = self._environments.step(self._act())
        if starting.any():
            observations, _ = self._environments.reset(options={"reset_mask": starting})
        self._observations = _tensor(observations)
        if not self._standardised:
            self.agent.checkpoint_modules["observation_preprocessor"](self._observations, train=True)

    def state(self) -> dict[str, Any]:
        """Returns the state of learning, as in a `Checkpoint`; that of the episodes in progress is not part of it."""
        modules = {name: module.state_dict() for name, module in self.agent.checkpoint_modules.items()}
        random = torch.get_rng_state()
        return {"modules": modules, "random": random, "steps": self.steps, "warmup_batches": self._warmup_batches}

    def check_fits(self, checkpoint: Checkpoint) -> None:
        """Checks that `load_state` can restore a checkpoint.

        Raises:
          ValueError: it is one of other networks.
        """
        check_modules(checkpoint.modules, self.agent.checkpoint_modules)
        # A generator of its own, so that a random state that is refused changes nothing.
        torch.Generator().set_state(checkpoint.random)

    def load_state(self, checkpoint: Checkpoint) -> None:
        """Restores the state of learning; the checkpoint has to fit."""
        for name, module in self.agent.checkpoint_modules.items():
            module.load_state_dict(checkpoint.modules[name])
        torch.set_rng_state(checkpoint.random)
        self.steps, self._warmup_batches = checkpoint.steps, checkpoint.warmup_batches
        self._standardised = True

    def learn(self) -> dict[str, float]:
        """Collects a batch and updates the networks with it.

        Returns:
          Means by name: of the metrics of steps, of episodes that ended, and of the agent's own.

        Raises:
          DivergedError: the learning rate is too high, or rewards are too large.
        """
        # The KL scheduler adapts both learning rates during an update. The value network's restarts with each update.
        value_group(self.agent)["lr"] = self._config.value_learning_rate
        with self._value_warmup():
            means = self._collect()
        self.steps += self._config.batch_size
        self._check_finite()
        return {**means, **self._agent_metrics()}

    @contextlib.contextmanager
    def _value_warmup(self) -> Iterator[None]:
        """Value warm-up: freezes the policy and its KL scheduler until the critic has seen `value_batches` batches.

        An untrained critic would spoil a cloned policy. A frozen policy shows no divergence, at which the scheduler
        would raise the learning rate.
        """
        if not self._warmup_batches:
            yield
            return
        self._warmup_batches -= 1
        policy, scheduler = self.agent.models["policy"], self.agent.scheduler
        policy.requires_grad_(False)
        self.agent.scheduler = None
        try:
            yield
        finally:
            policy.requires_grad_(True)
            self.agent.scheduler = scheduler

    def _collect(self) -> dict[str, float]:
        """Makes the control steps of a batch, after the last of which skrl updates the networks.

        Returns:
          Means of the metrics of steps and of episodes that ended, by name.
        """
        collected: dict[str, list[NDArray]] = collections.defaultdict(list)
        for _ in range(self._config.rollouts):
            for name, values in self._step().items():
                collected[name].append(values)
        return {name: float(np.concatenate(parts).mean()) for name, parts in collected.items()}

    def _step(self) -> dict[str, NDArray]:
        """Makes a control step in all environments and records it; returns its metrics."""
        observations, rewards, terminations, truncations, infos = self._environments.step(self._act())
        next_observations, ended = _tensor(observations), terminations | truncations
        with torch.no_grad():
            self.agent.record_transition(
                observations=self._observations,
                states=None,
                actions=self._actions,
                rewards=_column(rewards, torch.float32),
                next_observations=_before_autoreset(next_observations, infos),
                next_states=None,
                terminated=_column(terminations, torch.bool),
                truncated=_column(truncations, torch.bool),
                infos=infos,
                timestep=0,
                timesteps=0,
            )
        self.agent.post_interaction(timestep=0, timesteps=0)
        self._observations = next_observations
        metrics = {"step/reward": rewards, **step_metrics(infos)}
        if ended.any():
            task = self._environments.template_env.environment.task
            of_episodes = episode_metrics(task, infos["final_info"])
            metrics |= {name: values[ended] for name, values in of_episodes.items()}
        return metrics

    def _act(self) -> NDArray[np.float32]:
        """Returns actions `(n, k)` with exploration for the present observations."""
        with torch.no_grad():
            self._actions, _ = self.agent.act(self._observations, None, timestep=0, timesteps=0)
        return self._actions.numpy()

    def _check_finite(self) -> None:
        for name, model in self.agent.models.items():
            if not all(parameter.isfinite().all() for parameter in model.parameters()):
                raise DivergedError(
                    f"after {self.steps} steps the {name} network is no longer finite: lower the learning rate"
                )

    def _agent_metrics(self) -> dict[str, float]:
        """Returns and clears the metrics that skrl tracked in the last update, named as in `loss/policy loss`."""
        metrics = {
            name.replace(" / ", "/").lower(): float(np.mean(values))
            for name, values in self.agent.tracking_data.items()
        }
        self.agent.tracking_data.clear()
        return metrics


def _episode_length(environments: SuiteVectorEnv) -> int:
    assert environments.spec
    assert environments.spec.max_episode_steps
    return environments.spec.max_episode_steps


def _tensor(observations: Any) -> torch.Tensor:
    return torch.as_tensor(flat(observations), dtype=torch.float32)


def _column(values: NDArray, kind: torch.dtype) -> torch.Tensor:
    return torch.as_tensor(values, dtype=kind)[:, None]


def _before_autoreset(observations: torch.Tensor, infos: Mapping[str, Any]) -> torch.Tensor:
    """Returns the observations `(n, m)` after a step; where it ended an episode, those before the automatic reset."""
    if "final_obs" not in infos:
        return observations
    observations = observations.clone()
    for i in np.flatnonzero(infos["_final_obs"]):
        observations[i] = _tensor(infos["final_obs"][i])
    return observations
