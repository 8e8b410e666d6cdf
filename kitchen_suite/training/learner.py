"""A PPO agent that learns from one vectorised environment, batch by batch."""

import abc
import collections
import time
from collections.abc import Callable, Mapping
from typing import Any, Self

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray

from kitchen_suite.policies.stored import StoredPolicy
from kitchen_suite.policies.trained import TrainedPolicy
from kitchen_suite.rollouts.rollout import Controller
from kitchen_suite.tasks.task import ResetRequests, SuiteTask
from kitchen_suite.training.checkpoints import Checkpoint, check_modules
from kitchen_suite.training.evaluation import episode_metrics, network_controller, step_metrics
from kitchen_suite.training.hyperparameters import Hyperparameters
from kitchen_suite.training.ppo import Agent, Batch, adopt_policy, export_policy
from kitchen_suite.vector_env.base import SuiteVectorEnv

# Weight of a task that always succeeds, relative to 1 more for one that never does.
_LEAST_WEIGHT = 0.05

# Number of episodes of a task over which its success is averaged.
_MEMORY = 50

# Bound of cloned actions, in units of the action scale. Beyond it, servos and gripper are saturated, and the
# squared error of a few large actions would dominate the loss.
_ACTION_LIMIT = 5.0

# Of cloning.
_BATCH_SIZE, _LEARNING_RATE, _WEIGHT_DECAY = 512, 1e-3, 1e-4


class TaskBalance:
    """Sets the weights with which tasks are drawn: 1.05 minus their recent success.

    Attributes:
      success: `(n,)`, recent success rates, in the order of the tasks.
    """

    def __init__(self, requests: ResetRequests) -> None:
        """Starts without success of the tasks that the requests of the task that starts the episodes draw from."""
        self._requests, self._names = requests, requests.drawn_tasks
        self.success = np.zeros(len(self._names))

    @classmethod
    def of(cls, task: SuiteTask) -> Self | None:
        """Returns the balance of a task; None if it does not draw tasks."""
        return cls(task.requests) if task.requests.drawn_tasks else None

    def add(self, infos: Mapping[str, Any], ended: NDArray[np.bool_]) -> dict[str, NDArray]:
        """Adds the episodes that have ended.

        Args:
          infos: last infos of episodes, with a leading axis.
          ended: `(n,)`, which of them have ended.

        Returns:
          Successes of the tasks asked for, by the names of their curves.
        """
        asked, completed = infos["requested_tasks_mask"], infos["episode_task_completions_mask"]
        # A task that is asked in turn counts only if it was attempted.
        asked = infos.get("attempted_tasks_mask", asked)
        for i in np.flatnonzero(ended).tolist():
            self.success += np.where(asked[i], completed[i] - self.success, 0.0) / _MEMORY
        self._requests.weights = 1.0 + _LEAST_WEIGHT - self.success
        each = {name: completed[ended & asked[:, column], column] for column, name in enumerate(self._names)}
        return {f"episode/success/{name}": done.astype(np.float64) for name, done in each.items() if done.size}


def clone(
    agent: Agent,
    observations: NDArray[np.float32],
    actions: NDArray[np.float32],
    epochs: int,
    report: Callable[[float], None] = lambda loss: None,
) -> None:
    """Fits the mean of an agent's policy to demonstrated actions, by least squares.

    The demonstrations also fix the standardisation of observations.

    Args:
      agent: new.
      observations: `(m, n)`.
      actions: `(m, k)`.
      epochs: number of passes over the demonstrations.
      report: called after each pass with its mean loss, in squared units of the action scale.
    """
    policy = agent.policy
    inputs = _fit_scaler(agent, torch.as_tensor(observations))
    targets = (torch.as_tensor(actions) / policy.scale).clamp(-_ACTION_LIMIT, _ACTION_LIMIT)
    optimizer = torch.optim.AdamW(policy.network.parameters(), lr=_LEARNING_RATE, weight_decay=_WEIGHT_DECAY)
    num_batches = -(-len(targets) // _BATCH_SIZE)
    scheduler = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, epochs * num_batches)
    for _ in range(epochs):
        losses = []
        for batch in torch.randperm(len(targets)).split(_BATCH_SIZE):
            loss = torch.nn.functional.mse_loss(policy.network(inputs[batch]), targets[batch])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            scheduler.step()
            losses.append(loss.item())
        report(float(np.mean(losses)))
    agent.restart_average()


def _fit_scaler(agent: Agent, observations: torch.Tensor) -> torch.Tensor:
    """Fixes the standardisation by observations `(m, n)`; returns them standardised."""
    scaler = agent.observation_scaler
    scaler.update(observations)
    # Every PPO update adds to the statistics, which would change what the cloned policy sees.
    scaler.freeze()
    return scaler(observations)


class DivergedError(Exception):
    """A network's parameters are no longer finite."""


class Learner(abc.ABC):
    """Learns step by step, and exports a policy.

    Attributes:
      steps: learned from so far: control steps over all environments, or steps of the optimiser.
      warmup_batches: batches that still train the value network alone.
    """

    steps = 0
    warmup_batches = 0

    @property
    @abc.abstractmethod
    def modules(self) -> Mapping[str, Any]:
        """Networks, scalers and optimiser by name."""

    def start(self, seed: int) -> None:  # noqa: B027
        """Begins to learn, with episodes of seeds from a first one."""

    @abc.abstractmethod
    def learn(self) -> dict[str, float]:
        """Learns from a batch, or makes some steps of the optimiser; returns metrics by name."""

    @abc.abstractmethod
    def export(self, metadata: Mapping[str, Any]) -> StoredPolicy:
        """Returns the present policy, without exploration."""

    @abc.abstractmethod
    def controller(self, policy: StoredPolicy, environments: SuiteVectorEnv) -> Controller:
        """Returns a controller that acts by an exported policy."""

    def state(self) -> dict[str, Any]:
        """Returns the state of learning, as in a `Checkpoint`; that of the episodes in progress is not part of it."""
        modules = {name: module.state_dict() for name, module in self.modules.items()}
        random = torch.get_rng_state()
        return {"modules": modules, "random": random, "steps": self.steps, "warmup_batches": self.warmup_batches}

    def check_fits(self, checkpoint: Checkpoint) -> None:
        """Checks that `load_state` can restore a checkpoint; raises a ValueError if it is one of other networks."""
        check_modules(checkpoint.modules, self.modules)
        # A generator of its own, so that a random state that is refused changes nothing.
        torch.Generator().set_state(checkpoint.random)

    def load_state(self, checkpoint: Checkpoint) -> None:
        """Restores the state of learning; the checkpoint has to fit."""
        for name, module in self.modules.items():
            module.load_state_dict(checkpoint.modules[name])
        torch.set_rng_state(checkpoint.random)
        self.steps, self.warmup_batches = checkpoint.steps, checkpoint.warmup_batches


class PPOLearner(Learner):
    """A PPO agent and the environments that it learns from.

    Attributes:
      agent: the PPO agent.
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
        size = spaces.flatdim(environments.single_observation_space)
        self.agent = Agent(size, action_space, config)
        self._observations = torch.empty(0)
        self._batch = Batch(config.rollouts, config.num_envs, size, len(config.action_scale))
        self._task: SuiteTask = environments.composer_task
        self._balance = TaskBalance.of(self._task)
        # Whether the standardisation of observations has been fitted.
        self._standardised = False

    @property
    def modules(self) -> Mapping[str, Any]:
        return self.agent.modules

    def imitate(
        self, observations: NDArray[np.float32], actions: NDArray[np.float32], report: Callable[[float], None]
    ) -> None:
        """Clones demonstrations; the next `value_batches` batches then train the value network alone.

        Args:
          observations: `(m, n)`, flat.
          actions: `(m, k)`.
          report: called after each pass over the demonstrations with its mean loss.
        """
        clone(self.agent, observations, actions, self._config.clone_epochs, report)
        self._warm_up_values()

    def adopt(self, policy: TrainedPolicy) -> None:
        """Starts from a trained policy; the next `value_batches` batches train the value network alone.

        Raises:
          ValueError: it does not fit the networks.
        """
        adopt_policy(self.agent, policy)
        self._warm_up_values()

    def _warm_up_values(self) -> None:
        self._standardised, self.warmup_batches = True, self._config.value_batches

    def start(self, seed: int) -> None:
        """Starts episodes at evenly spread times, so that a batch has steps from all parts of an episode.

        The observations made meanwhile fit the standardisation, unless cloning or a checkpoint has set it.

        Args:
          seed: of the first environment; each further environment has the next seed.
        """
        environments, count = self._environments, self._environments.num_envs
        # Rewards may depend on the steps made before an interruption.
        environments.reset_statistics(total_steps=self.steps // count)
        observations, _ = environments.reset(seed=seed)
        self._observations = self._tensor(observations)
        length = environments.template_env.max_episode_steps
        assert length, "the spec has the domain's where none is asked for"
        start_steps = np.random.default_rng(seed).permutation(count) * length // count
        for step in range(length):
            self._explore(starting=start_steps == step)
        self._standardised = True

    def _explore(self, starting: NDArray[np.bool_]) -> None:
        """Makes a control step without learning, then resets the environments that are `starting`."""
        actions, _ = self.agent.explore(self._observations)
        observations, *_ = self._environments.step(self._applied(actions))
        if starting.any():
            observations, _ = self._environments.reset(options={"reset_mask": starting})
        self._observations = self._tensor(observations)
        if not self._standardised:
            self.agent.observation_scaler.update(self._observations)

    def export(self, metadata: Mapping[str, Any]) -> TrainedPolicy:
        return export_policy(self.agent, metadata)

    def controller(self, policy: StoredPolicy, environments: SuiteVectorEnv) -> Controller:
        assert isinstance(policy, TrainedPolicy)
        return network_controller(policy, environments)

    def load_state(self, checkpoint: Checkpoint) -> None:
        super().load_state(checkpoint)
        self._standardised = True

    def learn(self) -> dict[str, float]:
        """Collects a batch and updates the networks with it.

        The first `value_batches` batches after cloning, or from a trained policy, train the value network alone (value
        warm-up): an untrained one would spoil the policy.

        Returns:
          Means by name: of the metrics of steps, of episodes that ended, and of the agent's own.

        Raises:
          DivergedError: the learning rate is too high, or rewards are too large.
        """
        means = self._collect()
        started = time.perf_counter()
        means |= self.agent.update(self._batch, values_only=self.warmup_batches > 0)
        means["time/update_milliseconds"] = 1000 * (time.perf_counter() - started)
        self.warmup_batches = max(self.warmup_batches - 1, 0)
        self.steps += self._config.batch_size
        self._check_finite()
        return means

    def _collect(self) -> dict[str, float]:
        """Makes the control steps of a batch.

        Returns:
          Means of the metrics of steps and of episodes that ended, by name.
        """
        self._batch.clear()
        collected: dict[str, list[NDArray]] = collections.defaultdict(list)
        for step in range(self._config.rollouts):
            for name, values in self._step(step).items():
                collected[name].append(values)
        self._batch.next_observations.copy_(self._observations)
        return {name: float(np.concatenate(parts).mean()) for name, parts in collected.items()}

    def _step(self, step: int) -> dict[str, NDArray]:
        """Makes a control step in all environments and adds it to the batch; returns its metrics."""
        batch = self._batch
        batch.observations[step] = self._observations
        batch.actions[step], batch.log_densities[step] = self.agent.explore(self._observations)
        observations, rewards, terminations, truncations, infos = self._environments.step(
            self._applied(batch.actions[step])
        )
        batch.rewards[step] = torch.as_tensor(rewards * self._config.reward_scale)
        ended = terminations | truncations
        batch.ended[step] = torch.as_tensor(ended)
        self._observations = self._tensor(observations)
        metrics = {"step/reward": rewards, **step_metrics(infos)}
        if ended.any():
            for i in np.flatnonzero(truncations & ~terminations).tolist():
                batch.add_truncated(step, i, self._tensor(infos["final_obs"][i]))
            of_episodes = episode_metrics(self._task, infos["final_info"])
            metrics |= {name: values[ended] for name, values in of_episodes.items()}
            metrics |= self._balance.add(infos["final_info"], ended) if self._balance else {}
        return metrics

    def _tensor(self, observations: Any) -> torch.Tensor:
        flat = self._task.policy_inputs.flatten(observations)
        return torch.as_tensor(flat, dtype=torch.float32)

    def _applied(self, actions: torch.Tensor) -> NDArray[np.float32]:
        """Returns the actions `(n, k)` of the environments for those of the policy."""
        return (actions * self.agent.policy.scale).numpy()

    def _check_finite(self) -> None:
        for name, model in self.agent.networks.items():
            if not all(parameter.isfinite().all() for parameter in model.parameters()):
                raise DivergedError(
                    f"after {self.steps} steps the {name} network is no longer finite: lower the learning rate"
                )
