"""Measures the greatest returns of dense rewards that training finds without completing the task.

`python docs/experiments/failed_returns.py` trains each of the kitchen's seven tasks with each dense reward, as
`kitchen-train` does with its defaults, for 120,000 control steps, and writes results/failed_returns.json. After every
20,000 steps the policy plays 20 episodes of 280 control steps with that reward. Each row has the greatest return of
those that did not complete the task. Cases that have a row are skipped, so an interrupted command continues. It needs
the extra `train`, and takes 3 minutes for a case on two processors. `docs/scripts/tables.py` makes the tables.
"""

import contextlib
import json
from pathlib import Path
from typing import Any

from gymnasium.vector import AutoresetMode
from tqdm import tqdm

from kitchen_suite import suite
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.tasks import DEFAULT_TASKS

RESULTS = Path(__file__).parent / "results" / "failed_returns.json"

REWARDS = ("dense", "dense_gain")
STEPS, INTERVAL = 120_000, 20_000
EPISODES, EPISODE_STEPS = 20, 280

# Seeds that neither training nor its evaluations use.
FIRST_SEED = 40_000


def spec_of(task: str, arguments: dict[str, Any], steps: int) -> EnvironmentSpec:
    """Returns the specification of environments of a task, with episodes of some control steps."""
    return EnvironmentSpec.make(
        domain_name="kitchen", task_name=task.replace(" ", "_"), task_kwargs=arguments, max_episode_steps=steps
    )


def measure(task: str, reward: str, steps: int = STEPS) -> dict[str, Any]:
    """Trains a task with a reward; returns its row."""
    from kitchen_suite.training.hyperparameters import Hyperparameters, find_recipe
    from kitchen_suite.training.learner import evaluate
    from kitchen_suite.training.reinforcement import PPOLearner, network_controller

    domain, config = suite.DOMAINS["kitchen"], Hyperparameters.defaults("kitchen")
    options = dict(find_recipe("kitchen").options)
    steps_of_training = options.pop("max_episode_steps")
    training = spec_of(task, {**options, "reward": reward}, steps_of_training)
    evaluated = spec_of(task, {"reward": reward}, EPISODE_STEPS)
    flat, failed = domain.env_class.flat_options, []
    with (
        contextlib.closing(training.make_vector_env(config.num_envs, None, AutoresetMode.SAME_STEP, **flat)) as envs,
        contextlib.closing(evaluated.make_vector_env(EPISODES, None, **flat)) as evaluation,
    ):
        learner = PPOLearner(envs, config, 0)
        learner.start(0)
        while learner.steps < steps:
            before = learner.steps
            learner.learn()
            if learner.steps // INTERVAL > before // INTERVAL:
                seeds = range(FIRST_SEED, FIRST_SEED + EPISODES)
                metrics = evaluate(network_controller(learner.export({}), evaluation), evaluation, seeds)
                failed += metrics["episode/return"][metrics["episode/success"] == 0].tolist()
    return {"task": task, "reward": reward, "episodes": len(failed), "greatest_return": max(failed, default=None)}


def main() -> None:
    """Measures the cases that have no row yet."""
    import torch

    torch.set_num_threads(1)
    rows = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else []
    measured = {(row["task"], row["reward"]) for row in rows}
    cases = [(task, reward) for reward in REWARDS for task in DEFAULT_TASKS if (task, reward) not in measured]
    for case in tqdm(cases, unit="case"):
        rows.append(measure(*case))
        RESULTS.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
