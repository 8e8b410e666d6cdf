"""Measures the greatest returns of dense rewards that training finds without completing the task.

`python docs/experiments/failed_returns.py` trains each of the kitchen's seven tasks with each dense reward, as
`kitchen-train` does with its defaults, for 120,000 control steps, and writes results/failed_returns.json. After every
20,000 steps the policy plays 20 episodes of 280 control steps with that reward. Each row has the greatest return of
those that did not complete the task. Cases that have a row are skipped, so an interrupted command continues. It needs
the extra `train`, and takes 3 minutes for a case on two processors. `docs/scripts/tables.py` makes the tables.
"""

import contextlib
from typing import Any

from experiment import RESULTS, Row, make_parser, measure_missing
from gymnasium.vector import AutoresetMode

from kitchen_suite import suite
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.tasks import DEFAULT_TASKS

REWARDS = ("dense", "dense_gain")
# Control steps of training, and between evaluations.
STEPS = 120_000
INTERVAL = 20_000
# Episodes of an evaluation, and their control steps.
EPISODES = 20
EPISODE_STEPS = 280

# Seeds that neither training nor its evaluations use.
FIRST_SEED = 40_000


def spec_of(task: str, arguments: dict[str, Any], steps: int) -> EnvironmentSpec:
    """Returns the specification of environments of a task, with episodes of some control steps."""
    return EnvironmentSpec.make(
        domain_name="kitchen", task_name=task.replace(" ", "_"), task_kwargs=arguments, max_episode_steps=steps
    )


def measure(case: Row, steps: int = STEPS) -> Row:
    """Trains a task with a reward; returns the rest of its row."""
    from kitchen_suite.training.ppo import NetworkController, PPOLearner
    from kitchen_suite.training.recipes import PPOHyperparameters, find_recipe
    from kitchen_suite.training.run import evaluate

    domain, config = suite.DOMAINS["kitchen"], PPOHyperparameters.defaults("kitchen")
    options = dict(find_recipe("kitchen").options)
    steps_of_training = options.pop("max_episode_steps")
    reward = {"reward": case["reward"]}
    training = spec_of(case["task"], {**options, **reward}, steps_of_training)
    evaluated = spec_of(case["task"], reward, EPISODE_STEPS)
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
                metrics = evaluate(NetworkController(learner.export({}), evaluation), evaluation, seeds)
                failed += metrics["episode/return"][metrics["episode/success"] == 0].tolist()
    return {"episodes": len(failed), "greatest_return": max(failed, default=None)}


def main() -> None:
    """Measures the cases that have no row yet."""
    import torch

    torch.set_num_threads(1)
    cases = ({"task": task, "reward": reward} for reward in REWARDS for task in DEFAULT_TASKS)
    measure_missing(RESULTS / "failed_returns.json", cases, measure)


if __name__ == "__main__":
    make_parser(__doc__).parse_args()
    main()
