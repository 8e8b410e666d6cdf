"""For Stable-Baselines3, which it needs: the vectorised environments as a `VecEnv`, and evaluations during training."""

import contextlib
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv, VecMonitor

from kitchen_suite import checks, signatures
from kitchen_suite.closing import closed_on_error
from kitchen_suite.evaluation.evaluate import evaluate
from kitchen_suite.evaluation.evaluation import Evaluation
from kitchen_suite.evaluation.plan import Replaced, make_plan
from kitchen_suite.policies import BATCH, PolicyRef
from kitchen_suite.vector_env import arguments as vector_arguments
from kitchen_suite.vector_env.base import SHARED_ATTRIBUTES, SHARED_METHODS, SuiteVectorEnv

Indices = int | Iterable[int] | None

# Arguments of Stable-Baselines3's `make_vec_env` for environments that are built and wrapped one by one.
_ONE_BY_ONE = ("wrapper_class", "vec_env_cls", "vec_env_kwargs", "wrapper_kwargs")


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
        vector_arguments.autoreset_mode(environments.metadata["autoreset_mode"], AutoresetMode.SAME_STEP)
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
        columns = (timeouts.tolist(), *(self._column(infos[name]) for name in self._info_keys))
        result = [dict(zip(names, values, strict=True)) for values in zip(*columns, strict=True)]
        for i in np.flatnonzero(dones).tolist():
            result[i] = {
                **_row(infos["final_info"], i),
                "TimeLimit.truncated": result[i]["TimeLimit.truncated"],
                "terminal_observation": infos["final_obs"][i],
            }
            self.reset_infos[i] = _row(infos, i)
        return observations, rewards.astype(np.float32), dones, result

    def _column(self, values: Any) -> Sequence[Any]:
        """Returns an info of each environment, of its values `(n, ...)` or of nested ones."""
        return [_row(values, i) for i in range(self.num_envs)] if isinstance(values, Mapping) else values

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
        if attr_name in (*SHARED_ATTRIBUTES, "spec"):
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
        """Calls one of `SHARED_METHODS`, which do not depend on an episode, and returns the result for each index."""
        if method_name not in SHARED_METHODS:
            raise AttributeError(
                f"{method_name} cannot be called: the environments are stepped together; only "
                f"{', '.join(SHARED_METHODS)} can"
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
    env_id: str | EnvSpec,
    n_envs: int = 1,
    seed: int | None = None,
    start_index: int = 0,
    monitor_dir: str | os.PathLike[str] | None = None,
    *,
    env_kwargs: Mapping[str, Any] | None = None,
    monitor_kwargs: Mapping[str, Any] | None = None,
    info_keys: Sequence[str] = (),
    **settings: Any,
) -> VecMonitor:
    """Makes vectorised environments for Stable-Baselines3, with its statistics of episodes.

    The arguments are those of `stable_baselines3.common.env_util.make_vec_env`, except those for environments that are
    built and wrapped one by one: `wrapper_class`, `wrapper_kwargs`, `vec_env_cls` and `vec_env_kwargs`.

    Args:
      env_id: such as `kitchen_suite.gymnasium_env:KitchenSuite/FrankaKitchen-v1`.
      n_envs: number of environments.
      seed: environment `i` is seeded with `seed + i`, and the action space with `seed`.
      start_index: number in the name of the file in `monitor_dir`.
      monitor_dir: folder for the statistics of episodes, in one file such as `0.monitor.csv`; none without it.
      env_kwargs: arguments of the vectorised environment, such as `goal_format` and `num_threads`.
      monitor_kwargs: arguments of `VecMonitor`: `info_keywords`.
      info_keys: infos that each step returns; see `SuiteVecEnv`.
      **settings: more arguments of the vectorised environment, in place of `env_kwargs`.

    Raises:
      TypeError: an unknown argument, an argument of the wrong type, or one that is given twice.
      ValueError: a value that is refused.
    """
    if not isinstance(env_id, str | EnvSpec):
        raise TypeError(f"env_id must be an id such as 'KitchenSuite/Kettle-v1', got {checks.shown(env_id)}")
    if given := [name for name in _ONE_BY_ONE if settings.pop(name, None)]:
        raise TypeError(
            f"{', '.join(given)}: here all environments are stepped together; "
            "stable_baselines3.common.env_util.make_vec_env builds and wraps them one by one"
        )
    if "num_envs" in settings:
        raise TypeError("num_envs is called n_envs here, as in Stable-Baselines3")
    arguments = dict(env_kwargs or {})
    if twice := sorted(arguments.keys() & settings.keys()):
        raise TypeError(f"{', '.join(twice)} is given twice: as an argument, and in env_kwargs")
    of_monitor = dict(monitor_kwargs or {})
    own = {*signatures.names(VecMonitor)} - {"venv", "filename"}
    checks.keywords(of_monitor, own, what="argument in monitor_kwargs")
    environments = gymnasium.make_vec(
        env_id,
        n_envs,
        vectorization_mode="vector_entry_point",
        autoreset_mode=AutoresetMode.SAME_STEP,
        **arguments,
        **settings,
    )
    with closed_on_error([environments]):
        adapted = SuiteVecEnv(cast(SuiteVectorEnv, environments), info_keys=info_keys)
        file = None
        if monitor_dir is not None:
            os.makedirs(monitor_dir, exist_ok=True)
            file = os.path.join(monitor_dir, str(start_index))
        monitored = VecMonitor(adapted, file, **of_monitor)
    if seed is not None:
        monitored.seed(seed)
        monitored.action_space.seed(seed)
    return monitored


# Arguments of `evaluate` that the callback sets itself, or that make no sense while a model is trained.
_OWN_ARGUMENTS = ("policy", "takes", "cluster", "output", "resume", "receipt", "verbose", "table_format")

# First seed of the evaluations: none of a protocol, whose seeds are for the final score.
_SEED = 300_000_000


class ModelPolicy:
    """A model of Stable-Baselines3 or sb3-contrib as a policy for a batch, also a recurrent one.

    Where the model was trained in a `VecNormalize`, observations are normalised as there.
    """

    def __init__(self, model: BaseAlgorithm, *, deterministic: bool = True) -> None:
        """Takes a model, which acts in any number of environments.

        Args:
          model: such as `PPO.load(path)`, or one in training.
          deterministic: whether the model takes its likeliest action.
        """
        self._model, self._deterministic = model, deterministic
        self._states: tuple[NDArray, ...] | None = None  # Of recurrent networks.
        self._beginning: set[int] = set()

    def reset(self, rows: NDArray[np.int64]) -> None:
        """Has the episodes of some rows begin with the next call."""
        self._beginning |= {*rows.tolist()}

    def __call__(self, observations: Any) -> NDArray:
        """Returns the actions `(n, k)` for observations of `n` environments."""
        normalize = self._model.get_vec_normalize_env()
        seen = observations if normalize is None else normalize.normalize_obs(observations)
        first = next(iter(seen.values())) if isinstance(seen, Mapping) else seen
        starts = np.isin(np.arange(len(first)), [*self._beginning])
        if starts.all():
            # The last states may be of another number of environments.
            self._states = None
        actions, self._states = self._model.predict(
            seen, state=self._states, episode_start=starts, deterministic=self._deterministic
        )
        self._beginning = set()
        return actions


class EvaluationCallback(BaseCallback):
    """Evaluates the model under a protocol while it is trained, in the suite's vectorised environments.

    Each evaluation plays the same episodes, so that any two can be compared in pairs: `kitchen_suite.compare` takes two
    of `evaluations`. The logger has `eval/success_rate`, `eval/mean_tasks` or `eval/mean_progress`, and
    `eval/mean_ep_length`. Where the training environment is a `VecNormalize`, it normalises observations here as well.

    Attributes:
      evaluations: the evaluations, by the number of timesteps after which they were made.
      best_success: the greatest success rate; -1 before the first evaluation.
    """

    def __init__(
        self,
        eval_freq: int,
        *,
        best_model_save_path: str | os.PathLike[str] | None = None,
        deterministic: bool = True,
        verbose: int = 0,
        **evaluate_kwargs: Any,
    ) -> None:
        """Prepares the evaluations.

        Args:
          eval_freq: number of steps of the training environment, all environments together, between evaluations.
          best_model_save_path: folder in which the model with the greatest success rate is kept, as `best_model.zip`.
          deterministic: whether the model takes its likeliest action.
          verbose: 1 to print a line for each evaluation.
          **evaluate_kwargs: arguments of `kitchen_suite.evaluate`, such as `protocol`, `task_name` and `num_episodes`;
            `task_kwargs` need those of training on which observations and actions depend, such as
            `{"obs_type": "state"}`. `seed` is 300,000,000 by default: seeds of a protocol are for the final score.

        Raises:
          TypeError: an unknown argument.
          ValueError: a value that is refused.
        """
        super().__init__(verbose)
        self._eval_freq = checks.integer(eval_freq, "eval_freq", minimum=1)
        offered = {*signatures.names(evaluate)} - {*_OWN_ARGUMENTS}
        checks.keywords(evaluate_kwargs, offered, what="argument of an evaluation")
        self._arguments: dict[str, Any] = {"seed": _SEED, **evaluate_kwargs}
        self._best_model = None if best_model_save_path is None else Path(best_model_save_path) / "best_model"
        self._deterministic = deterministic
        self.evaluations: dict[int, Evaluation] = {}
        self.best_success = -1.0

    def _init_callback(self) -> None:
        """Raises a ValueError if the model does not take the observations of the evaluation, or has other actions."""
        of_plan = {*signatures.names(Replaced)} & self._arguments.keys()
        replaced = Replaced(**{name: self._arguments[name] for name in of_plan})
        given = self._arguments.get("dataset")
        dataset = None if given is None else Path(given)
        plan = make_plan(PolicyRef.parse("zero"), self._arguments.get("protocol", "default"), replaced, dataset)
        with contextlib.closing(plan.first.make_environment()) as environment:
            observation, _ = environment.reset(seed=0)
            advice = "pass the arguments of the training environment as task_kwargs"
            try:
                action = self._policy()(_batch_of_one(observation))[0]
            except (AssertionError, IndexError, KeyError, TypeError, ValueError) as error:
                raise ValueError(
                    f"the model does not take observations of the evaluation, {advice}: {error}"
                ) from error
            if action.shape != environment.action_space.shape:
                found = f"{action.shape}, not {environment.action_space.shape}"
                raise ValueError(f"the model has other actions than the evaluation, {advice}: shape {found}")

    def _policy(self) -> ModelPolicy:
        """Returns the policy of an evaluation, or of a condition of one: without a memory of what was played before."""
        return ModelPolicy(self.model, deterministic=self._deterministic)

    def _on_step(self) -> bool:
        if self.n_calls % self._eval_freq == 0:
            self._evaluate()
        return True

    def _evaluate(self) -> None:
        evaluation = evaluate(self._policy, takes=BATCH, **self._arguments)
        self.evaluations[self.num_timesteps] = evaluation
        scores = evaluation.scores
        logged = {"success_rate": scores["success"], "mean_ep_length": scores["control_steps"]}
        logged |= {name: scores[name] for name in ("mean_tasks", "mean_progress") if name in scores}
        for name, value in logged.items():
            self.logger.record(f"eval/{name}", value)
        self.logger.record("time/total_timesteps", self.num_timesteps, exclude="tensorboard")
        self.logger.dump(self.num_timesteps)
        if self.verbose:
            low, high = scores["intervals"]["success"]
            print(
                f"{self.num_timesteps} timesteps: success {scores['success']:.1%} ({low:.1%} to {high:.1%})", flush=True
            )
        if scores["success"] > self.best_success:
            self.best_success = scores["success"]
            if self._best_model is not None:
                self._best_model.parent.mkdir(parents=True, exist_ok=True)
                self.model.save(self._best_model)


def _row(infos: Mapping[str, Any], i: int) -> dict[str, Any]:
    """Returns the infos of environment `i`; those of variations are nested."""
    own = {key: value for key, value in infos.items() if not key.startswith(("_", "final_"))}
    return {key: _row(value, i) if isinstance(value, Mapping) else value[i] for key, value in own.items()}


def _batch_of_one(observation: Any) -> Any:
    """Returns the observation of an environment, an array or a dict of arrays, as those of one environment of many."""
    if isinstance(observation, Mapping):
        return {key: _batch_of_one(part) for key, part in observation.items()}
    return np.asarray(observation)[np.newaxis]
