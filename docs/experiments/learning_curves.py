"""Learning curves of Stable-Baselines3: its PPO learns to open the drawer, its SAC with HER to move the kettle.

`python docs/experiments/learning_curves.py drawer kettle` trains the seeds that have no row yet in
results/learning_curves.json, with one thread, and draws docs/pictures/learning_curves_drawer.png and
learning_curves_kettle.png. It needs what the page of Stable-Baselines3 installs, and matplotlib. Times are those of the
processor, without evaluations.
"""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import contextlib
import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from experiment import PICTURES, RESULTS, Row, make_parser, measure_missing, numbers, read_rows

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

FILE = RESULTS / "learning_curves.json"
SEEDS = (1, 2, 3)

# Arguments that observations and actions of the drawer depend on, and control steps of its episodes.
DRAWER_TASK = {"control_mode": "joint_delta"}
DRAWER_STEPS = 300

# Seven of twelve episodes of training start with the drawer shut, the others with it open by a little [m].
AJAR = {"cabinet/drawer_top": {"choice": (*[0.0] * 7, 0.02, 0.04, 0.06, 0.08, 0.08)}}

# Arguments that observations and actions of the kettle depend on, control steps of its episodes, and environments.
KETTLE_TASK = {"control_mode": "ee_delta_position", "goal_format": "flat", "physics": "fast"}
KETTLE_STEPS = 60
KETTLE_ENVS = 64


def build_drawer(seed: int) -> "BaseAlgorithm":
    """Returns PPO with the normalised environments that it learns in."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecNormalize
    from torch import nn

    from kitchen_suite.adapters.stable_baselines3 import make_vec_env

    environments = make_vec_env(
        "kitchen_suite:KitchenSuite/FrankaOpenCabinet-v1",
        n_envs=256,
        seed=seed,
        num_threads=1,
        max_episode_steps=DRAWER_STEPS,
        variations=AJAR,
        **DRAWER_TASK,
    )
    return PPO(
        "MlpPolicy",
        VecNormalize(environments, gamma=0.99),
        n_steps=16,
        batch_size=1024,
        n_epochs=2,
        learning_rate=1e-3,
        # Exploration that is correlated in time, as that of kitchen-train.
        use_sde=True,
        sde_sample_freq=16,
        policy_kwargs={"net_arch": [128, 128], "activation_fn": nn.ELU, "log_std_init": -1.0},
        device="cpu",
        seed=seed,
    )


def build_kettle(seed: int) -> "BaseAlgorithm":
    """Returns SAC with hindsight experience replay, and the environments that it learns in."""
    from stable_baselines3 import SAC, HerReplayBuffer

    from kitchen_suite.adapters.stable_baselines3 import make_vec_env
    from kitchen_suite.tasks.kitchen.mdp import REWARD_STATE
    from kitchen_suite.tasks.kitchen.shaping import Shaping

    environments = make_vec_env(
        "kitchen_suite:KitchenSuite/Kettle-v1",
        n_envs=KETTLE_ENVS,
        seed=seed,
        num_threads=1,
        max_episode_steps=KETTLE_STEPS,
        reward="dense",
        # What the dense reward of a relabelled goal depends on.
        info_keys=[f"{REWARD_STATE}/{name}" for name in Shaping._fields],
        **KETTLE_TASK,
    )
    return SAC(
        "MultiInputPolicy",
        environments,
        replay_buffer_class=HerReplayBuffer,
        # While the kettle has not been moved, a relabelled goal is complete at once: half of the samples keep theirs.
        replay_buffer_kwargs={"copy_info_dict": True, "n_sampled_goal": 1},
        # Nothing can be relabelled before the first episodes have ended.
        learning_starts=KETTLE_ENVS * (KETTLE_STEPS + 1),
        train_freq=1,
        gradient_steps=16,
        # It falls linearly to 0.
        learning_rate=lambda remaining: 7e-4 * remaining,
        gamma=0.95,
        tau=0.02,
        ent_coef=0.05,
        policy_kwargs={"net_arch": [128, 128]},
        device="cpu",
        seed=seed,
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Recipe:
    """How a task is learned, and evaluated meanwhile.

    Attributes:
      build: returns a model of a seed.
      steps: control steps of a seed, over all environments.
      interval: control steps between evaluations.
      evaluation: arguments of `kitchen_suite.evaluate`.
      scores: names of the scores that a row keeps.
      axis_unit: control steps of a unit of the picture's axis.
      axis_label: label of the axis.
    """

    build: Callable[[int], "BaseAlgorithm"]
    steps: int
    interval: int
    evaluation: Mapping[str, Any]
    scores: Sequence[str]
    axis_unit: float
    axis_label: str


RECIPES = {
    "drawer": Recipe(
        build=build_drawer,
        steps=6_144_000,
        interval=409_600,
        evaluation={
            "num_episodes": 50,
            "domain_name": "open_cabinet",
            "task_kwargs": DRAWER_TASK,
            "max_episode_steps": DRAWER_STEPS,
        },
        scores=("success", "mean_progress"),
        axis_unit=1e6,
        axis_label="control steps [million]",
    ),
    "kettle": Recipe(
        build=build_kettle,
        steps=40_960,
        interval=4_096,
        evaluation={
            "num_episodes": 50,
            "task_name": "kettle",
            # Episodes start as in training; those of the protocol have varied starts.
            "task_kwargs": {**KETTLE_TASK, "variations": None},
            "max_episode_steps": KETTLE_STEPS,
        },
        scores=("success",),
        axis_unit=1e3,
        axis_label="control steps [thousand]",
    ),
}


def train(case: Row) -> Row:
    """Trains a seed; returns the control steps, minutes of processor time and scores of its evaluations."""
    import torch

    from kitchen_suite.adapters.stable_baselines3 import EvaluationCallback

    torch.set_num_threads(1)
    recipe = RECIPES[case["recipe"]]
    model = recipe.build(case["seed"])
    environments = model.get_env()
    assert environments is not None
    evaluating = 0.0
    seconds: list[float] = []

    class TimedCallback(EvaluationCallback):
        """Takes the time of training alone."""

        def _evaluate(self) -> None:
            nonlocal evaluating
            before = time.process_time()
            seconds.append(before - started - evaluating)
            super()._evaluate()
            evaluating += time.process_time() - before

    callback = TimedCallback(recipe.interval // environments.num_envs, verbose=1, **recipe.evaluation)
    with contextlib.closing(environments):
        started = time.process_time()
        model.learn(recipe.steps, callback=callback)
    scores = {name: [round(each.scores[name], 3) for each in callback.evaluations.values()] for name in recipe.scores}
    minutes = [round(each / 60, 2) for each in seconds]
    return {"control_steps": [*callback.evaluations], "minutes": minutes, **scores}


def draw(name: str, rows: Sequence[Row]) -> None:
    """Draws success over control steps and over minutes, a line for each seed."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    recipe = RECIPES[name]
    figure, axes = pyplot.subplots(1, 2, figsize=(10, 3.5), sharey=True, layout="constrained")
    for row in rows:
        success = [100 * each for each in row["success"]]
        style = {"label": f"seed {row['seed']}", "linewidth": 1.8}
        axes[0].plot([each / recipe.axis_unit for each in row["control_steps"]], success, **style)
        axes[1].plot(row["minutes"], success, **style)
    for axis, text in zip(axes, (recipe.axis_label, "minutes of one processor"), strict=True):
        # Lines at 0 and at 100 % are seen as well.
        axis.set(xlabel=text, xlim=(0, None), ylim=(-2, 103))
        axis.grid(alpha=0.3)
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylabel("episodes that succeed [%]")
    axes[0].legend()
    figure.savefig(PICTURES / f"learning_curves_{name}.png", dpi=150)
    pyplot.close(figure)


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the command."""
    parser = make_parser(__doc__)
    parser.add_argument("recipes", nargs="+", choices=RECIPES)
    parser.add_argument("--seeds", type=numbers, default=SEEDS)
    given = parser.parse_args(arguments)
    for name in given.recipes:
        measure_missing(FILE, [{"recipe": name, "seed": seed} for seed in given.seeds], train)
        draw(name, [row for row in read_rows(FILE) if row["recipe"] == name])


if __name__ == "__main__":
    main()
