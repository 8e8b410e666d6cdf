"""Training by PPO: the learner in its environments, with cloning before it, and the settings of a run."""

import collections
import concurrent.futures
import json
import time
from collections.abc import Callable, Mapping
from typing import Any, Self

import numpy as np
import torch
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from tqdm import tqdm

from kitchen_suite import checks, suite
from kitchen_suite.episodes.play import Controller, NetworkController
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.policies.stored import StoredPolicy
from kitchen_suite.policies.trained import TrainedPolicy
from kitchen_suite.settings import IMITATION, TrainSettings
from kitchen_suite.tasks.requests import Requests
from kitchen_suite.tasks.task import SuiteTask
from kitchen_suite.training.checkpoints import Checkpoint
from kitchen_suite.training.demonstrations import OBSERVATION_OPTIONS, check_same, load_to_clone
from kitchen_suite.training.hyperparameters import Hyperparameters, find_recipe
from kitchen_suite.training.learner import Learner, Training, episode_metrics
from kitchen_suite.training.ppo import Actor, Agent, Batch, adopt_policy, export_policy
from kitchen_suite.vector_env.base import SuiteVectorEnv

_LEAST_WEIGHT = 0.05  # Weight of a task that always succeeds; that of one that never does is greater by 1.
_MEMORY = 50  # Number of episodes of a task over which its success is averaged.

# Bound of cloned actions, in units of the action scale. Beyond it, servos and gripper are saturated, and the
# squared error of a few large actions would dominate the loss.
_ACTION_LIMIT = 5.0

# Minibatch size, and learning rate and weight decay of the optimiser (AdamW), of cloning.
_BATCH_SIZE, _LEARNING_RATE, _WEIGHT_DECAY = 512, 1e-3, 1e-4


class TaskBalance:
    """Sets the weights with which tasks are drawn: 1.05 minus their recent success, `success` `(n,)` in their order."""

    def __init__(self, requests: Requests) -> None:
        """Starts without success of the tasks that the requests of the task that starts the episodes draw from."""
        self._requests, self._names = requests, requests.drawn_tasks
        self.success = np.zeros(len(self._names))

    @classmethod
    def of(cls, task: SuiteTask) -> Self | None:
        """Returns the balance of a task; None if it does not draw tasks."""
        return cls(task.requests) if task.requests.drawn_tasks else None

    def add(self, infos: Mapping[str, Any], ended: NDArray[np.bool_]) -> dict[str, NDArray]:
        """Adds the `ended` ones `(n,)` of episodes, given last infos; returns successes of requested tasks by curve."""
        requested, completed = infos["requested_tasks_mask"], infos["episode_task_completions_mask"]
        # A task that is requested in turn counts only if it was attempted.
        requested = infos.get("attempted_tasks_mask", requested)
        for i in np.flatnonzero(ended).tolist():
            self.success += np.where(requested[i], completed[i] - self.success, 0.0) / _MEMORY
        self._set_weights()
        each = {name: completed[ended & requested[:, column], column] for column, name in enumerate(self._names)}
        return {f"episode/success/{name}": done.astype(np.float64) for name, done in each.items() if done.size}

    def state_dict(self) -> dict[str, torch.Tensor]:
        return {"success": torch.as_tensor(self.success)}

    def load_state_dict(self, state: Mapping[str, torch.Tensor]) -> None:
        """Restores the success of an interrupted run, and with it the weights."""
        self.success[:] = state["success"].numpy()
        self._set_weights()

    def _set_weights(self) -> None:
        self._requests.weights = 1.0 + _LEAST_WEIGHT - self.success


def clone(agent: Agent, observations: NDArray, actions: NDArray, epochs: int, report: Callable[[float], None]) -> None:
    """Fits the mean of a new agent's policy to observations `(m, n)` and actions `(m, k)`, by least squares.

    The demonstrations also fix the standardisation of observations. After each pass over them, `report` is called with
    its mean loss, in squared units of the action scale.
    """
    policy = agent.policy
    scaler, inputs = agent.observation_scaler, torch.as_tensor(observations)
    scaler.update(inputs)
    # Every PPO update adds to the statistics, which would change what the cloned policy sees.
    scaler.freeze()
    inputs = scaler(inputs)
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


def _step_metrics(infos: Mapping[str, Any]) -> dict[str, NDArray]:
    """Returns the reward terms `(n,)` of a step, not of the reset after it; none if the task's reward has no terms."""
    ended, final_info = infos.get("_final_info", False), infos.get("final_info", infos)
    terms = [name for name in infos if name.startswith("reward/")]
    return {f"step/{name}": np.where(ended, final_info[name], infos[name]) for name in terms}


def network_controller(policy: TrainedPolicy, environments: SuiteVectorEnv) -> Controller:
    """Returns a controller that acts by a policy of PPO in all environments at once."""
    flatten = environments.composer_task.policy_inputs.flatten
    return NetworkController(lambda observations: policy(flatten(observations)))


class PPOLearner(Learner):
    """A PPO agent, the environments that it learns from, and the batch of control steps that is learned from next.

    While the agent learns from a batch, the next one is collected with the policy as it was before that update.
    """

    _actor: Actor  # From `start` on, as the last observations.
    _observations: torch.Tensor

    def __init__(self, environments: SuiteVectorEnv, config: Hyperparameters, seed: int) -> None:
        """Builds the agent of `num_envs` environments of autoreset mode `SameStep`; the seed is also of exploration."""
        torch.manual_seed(seed)
        self._environments, self._config = environments, config
        action_space = environments.single_action_space
        assert isinstance(action_space, spaces.Box)
        size = spaces.flatdim(environments.single_observation_space)
        self.agent = Agent(size, action_space, config)
        sizes = config.rollouts, config.num_envs, size, len(config.action_scale)
        self.batch, self._next_batch = Batch(*sizes), Batch(*sizes)
        # Metrics of the batch that is learned from next; None before the first one.
        self._collected: dict[str, float] | None = None
        self._updates = concurrent.futures.ThreadPoolExecutor(1)
        self._task: SuiteTask = environments.composer_task
        self._balance = TaskBalance.of(self._task)
        # Whether the standardisation of observations has been fitted.
        self._standardised = False

    @property
    def modules(self) -> Mapping[str, Any]:
        return self.agent.modules | ({"balance": self._balance} if self._balance else {})

    def imitate(self, observations: NDArray, actions: NDArray, report: Callable[[float], None]) -> None:
        """Clones demonstrations, as `clone`; the next `value_batches` batches then train the value network alone."""
        clone(self.agent, observations, actions, self._config.clone_epochs, report)
        self._standardised, self.warmup_batches = True, self._config.value_batches

    def adopt(self, policy: TrainedPolicy) -> None:
        """Starts from a trained policy; the next `value_batches` batches train the value network alone."""
        adopt_policy(self.agent, policy)
        self._standardised, self.warmup_batches = True, self._config.value_batches

    def start(self, seed: int) -> None:
        """Starts episodes at evenly spread times, so that a batch has steps from all parts of an episode.

        Environments have seeds from `seed` on. Observations made meanwhile fit the standardisation, unless it is set.
        """
        self._collected, self._actor = None, Actor(self.agent, self._config.noise_correlation, seed)
        environments, count = self._environments, self._environments.num_envs
        # Rewards may depend on the steps made before an interruption.
        environments.reset_statistics(total_steps=self.steps // count)
        observations, _ = environments.reset(seed=seed)
        self._observations = self._tensor(observations)
        length = environments.template_env.max_episode_steps
        assert length, "the spec has the domain's where none is asked for"
        start_steps = np.random.default_rng(seed).permutation(count) * length // count
        for step in range(length):
            observations, *_ = environments.step(self._applied(self._actor.explore(self._observations)))
            if (starting := start_steps == step).any():
                observations, _ = environments.reset(options={"reset_mask": starting})
            self._observations = self._tensor(observations)
            if not self._standardised:
                self.agent.observation_scaler.update(self._observations)
        self._standardised = True

    def export(self, metadata: Mapping[str, Any]) -> TrainedPolicy:
        return export_policy(self.agent, metadata)

    def controller(self, policy: StoredPolicy, environments: SuiteVectorEnv) -> Controller:
        assert isinstance(policy, TrainedPolicy)
        return network_controller(policy, environments)

    def load_state(self, checkpoint: Checkpoint) -> None:
        super().load_state(checkpoint)
        self._standardised = True

    def learn(self) -> dict[str, float]:
        """Updates the networks with a batch and collects the next one at the same time.

        The first `value_batches` batches after cloning, or from a trained policy, train the value network alone (value
        warm-up): an untrained one would spoil the policy. Returns means by name: of the metrics of steps, of episodes
        that ended, and of the agent's own. A DivergedError means too high a learning rate, or too large rewards.
        """
        self._actor.refresh()
        if self._collected is None:
            self._collected = self._collect(self.batch)
        update = self._updates.submit(self._update)
        following = self._collect(self._next_batch)
        means = self._collected | update.result()
        self._collected, self.batch, self._next_batch = following, self._next_batch, self.batch
        self.warmup_batches = max(self.warmup_batches - 1, 0)
        self.steps += self._config.batch_size
        self.check_finite(self.agent.networks)
        return means

    def _update(self) -> dict[str, float]:
        """Learns from the batch; returns the agent's metrics by name."""
        started = time.perf_counter()
        metrics = self.agent.update(self.batch, values_only=self.warmup_batches > 0)
        return metrics | {"time/update_milliseconds": 1000 * (time.perf_counter() - started)}

    def _collect(self, batch: Batch) -> dict[str, float]:
        """Makes the control steps of a batch; returns the means of the metrics of steps and ended episodes, by name."""
        collected: dict[str, list[NDArray]] = collections.defaultdict(list)
        for step in range(self._config.rollouts):
            for name, values in self._step(batch, step).items():
                collected[name].append(values)
        batch.next_observations.copy_(self._observations)
        return {name: float(np.concatenate(parts).mean()) for name, parts in collected.items()}

    def _step(self, batch: Batch, step: int) -> dict[str, NDArray]:
        """Makes a control step in all environments and adds it to a batch; returns its metrics."""
        batch.observations[step] = self._observations
        batch.actions[step] = self._actor.explore(self._observations)
        applied = self._applied(batch.actions[step])
        observations, rewards, terminations, truncations, infos = self._environments.step(applied)
        batch.rewards[step] = torch.as_tensor(rewards * self._config.reward_scale)
        ended = terminations | truncations
        batch.ended[step] = torch.as_tensor(ended)
        batch.truncated[step] = torch.as_tensor(truncations & ~terminations)
        self._observations = self._tensor(observations)
        metrics = {"step/reward": rewards, **_step_metrics(infos)}
        if ended.any():
            for i in np.flatnonzero(truncations & ~terminations).tolist():
                batch.last_observations[step, i] = self._tensor(infos["final_obs"][i])
            of_episodes = episode_metrics(self._task, infos["final_info"])
            metrics |= {name: values[ended] for name, values in of_episodes.items()}
            metrics |= self._balance.add(infos["final_info"], ended) if self._balance else {}
        return metrics

    def _tensor(self, observations: Any) -> torch.Tensor:
        return torch.as_tensor(self._task.policy_inputs.flatten(observations), dtype=torch.float32)

    def _applied(self, actions: torch.Tensor) -> NDArray[np.float32]:
        """Returns the actions `(n, k)` of the environments for those of the policy."""
        return (actions * self.agent.policy.scale).numpy()


def make_spec(settings: TrainSettings, task_kwargs: Mapping[str, Any], limit: int | None = None) -> EnvironmentSpec:
    """Returns the specification of environments of a run's task, with which `kitchen-play` can play the policy.

    Episodes have at most `limit` control steps, by default as many as the domain's.
    """
    spec = EnvironmentSpec.make(settings.domain_name, settings.task_name, task_kwargs, limit)
    default, seeing = spec.env_class.obs_types[0], "pixels_agent_pos"
    learned = (default, seeing) if settings.algorithm in IMITATION else (default,)
    if (obs_type := spec.task_kwargs.get("obs_type") or default) not in learned:
        taken = f"policies take the domain's default, {default!r}; those of imitation also {seeing!r}"
        raise ValueError(f"obs_type {obs_type!r} cannot be trained on with {settings.algorithm!r}: {taken}")
    spec.make_environment().close()
    return spec


class PPOTraining(Training):
    """The environments, hyperparameters and demonstrations of a run by PPO.

    Attributes:
      environments: that are trained in.
      demonstrations: observations `(m, n)` and actions `(m, k)` that are cloned first; None for none.
    """

    title = "PPO"
    steps = "control steps"

    def __init__(self, settings: TrainSettings, spec: EnvironmentSpec) -> None:
        """Makes the environments; `spec` is that of the environments that are evaluated in."""
        if settings.schedule.num_steps == 0 and not settings.demonstrations:
            raise ValueError("num_steps 0 is for cloning alone, which needs --demonstrations")
        if settings.num_demonstrations:
            raise ValueError("--num_demonstrations is for the other algorithms; PPO clones all episodes")
        self._settings, self._spec = settings, spec
        self.training_kwargs = self._make_training_kwargs()
        cloning = bool(settings.demonstrations)
        config = Hyperparameters.for_domain(settings.domain_name, settings.hyperparameters, cloning=cloning)
        arguments = {**settings.environment_kwargs, **self.training_kwargs}
        if (steps := arguments.pop("max_episode_steps", None)) is not None:
            checks.integer(steps, "max_episode_steps", minimum=1)
        training = make_spec(settings, arguments, steps)
        self.max_episode_steps = training.max_episode_steps
        options = {"autoreset_mode": AutoresetMode.SAME_STEP, **spec.env_class.flat_options}
        self.environments = training.make_vector_env(config.num_envs, settings.num_threads, **options)
        task = self.environments.composer_task
        self.config = config.for_actions(task.mdp.action_mode.spec(task.robot))
        self._initial_policy, self.demonstrations = self._load_initial_policy(), self._load_demonstrations()
        given = self._initial_policy.arrays.values() if self._initial_policy else ()
        self.data = *(self.demonstrations or ()), *given

    def make_learner(self, seed: int) -> PPOLearner:
        learner = PPOLearner(self.environments, self.config, seed)
        if self._initial_policy:
            learner.adopt(self._initial_policy)
        return learner

    def prepare(self, learner: PPOLearner) -> None:
        if not self.demonstrations:
            return
        with tqdm(total=self.config.clone_epochs, desc="cloning", unit="epoch", disable=None, leave=False) as bar:

            def report(loss: float) -> None:
                bar.set_postfix_str(f"loss {loss:.4f}", refresh=False)
                bar.update()

            learner.imitate(*self.demonstrations, report)

    def close(self) -> None:
        self.environments.close()

    def _make_training_kwargs(self) -> dict[str, Any]:
        """Returns the arguments of the environments that are trained in, which replace those of the task.

        The domain's are left out where the task's arguments have them.
        """
        settings, name = self._settings, self._settings.domain_name
        own = {} if settings.demonstrations else find_recipe(name).options
        given = {*settings.environment_kwargs, *suite.task_arguments(name, self._spec.task_name)}
        defaults = {option: value for option, value in own.items() if option not in given}
        arguments: dict[str, Any] = json.loads(json.dumps({**defaults, **settings.training_kwargs}))
        options = (*self._spec.env_class.goal_options, *suite.find_domain(name).control_options)
        if shared := sorted({*OBSERVATION_OPTIONS, *options} & arguments.keys()):
            raise ValueError(f"training_kwargs cannot change {shared}, on which the policy depends: use --task_kwargs")
        return arguments

    def _load_initial_policy(self) -> TrainedPolicy | None:
        """Returns the policy to start from, if any; raises as `TrainedPolicy.load`, and as `check_same`."""
        path = self._settings.initial_policy
        if path is None:
            return None
        if self._settings.demonstrations:
            raise ValueError("--initial_policy and --demonstrations both give a policy to start from: give one of them")
        policy = TrainedPolicy.load(path)
        domain, task, arguments = (policy.metadata[name] for name in ("domain_name", "task_name", "task_kwargs"))
        if domain != self._settings.domain_name:
            raise ValueError(f"{path} is a policy of the domain {domain}, not of {self._settings.domain_name}")
        trained, options = EnvironmentSpec.make(domain, task, arguments), suite.find_domain(domain).control_options
        check_same(path, trained, self._spec, (*OBSERVATION_OPTIONS, *options))
        return policy

    def _load_demonstrations(self) -> tuple[NDArray, NDArray] | None:
        """Returns the observations and actions to clone, if any; raises as `load_to_clone`."""
        if not self._settings.demonstrations:
            return None
        size = spaces.flatdim(self.environments.single_observation_space)
        expected = (size,), self.environments.single_action_space.shape
        loaded = [load_to_clone(folder, self._spec) for folder in self._settings.demonstrations]
        for folder, arrays in zip(self._settings.demonstrations, loaded, strict=True):
            if (found := tuple(array.shape[1:] for array in arrays)) != expected:
                problem = f"observations and actions of shapes {found}, but this task has {expected}"
                raise ValueError(f"{folder} holds {problem}")
        observations, actions = map(np.concatenate, zip(*loaded, strict=True))
        return observations, actions
