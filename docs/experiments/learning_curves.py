"""Learning curves of Stable-Baselines3: its PPO learns to open the drawer.

`python docs/experiments/learning_curves.py` trains the seeds that have no row yet in results/learning_curves.json, with
one thread, and draws docs/pictures/learning_curves.png. It needs what the page of Stable-Baselines3 installs, and
matplotlib. Times are those of the processor, without evaluations.
"""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import contextlib
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from experiment import PICTURES, RESULTS, Row, make_parser, measure_missing, numbers, read_rows

if TYPE_CHECKING:
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecEnv

FILE = RESULTS / "learning_curves.json"
PICTURE = PICTURES / "learning_curves.png"

SEEDS = (1, 2, 3)
# Control steps of a seed, over all environments, and between its evaluations.
STEPS = 6_144_000
INTERVAL = 409_600
# Episodes of an evaluation, and control steps of an episode, in training as well.
EPISODES = 50
EPISODE_STEPS = 300

# Arguments that observations and actions depend on.
TASK = {"control_mode": "joint_delta"}

# Seven of twelve episodes of training start with the drawer shut, the others with it open by a little [m].
AJAR = {"cabinet/drawer_top": {"choice": (*[0.0] * 7, 0.02, 0.04, 0.06, 0.08, 0.08)}}


def build(seed: int) -> tuple["VecEnv", "PPO"]:
    """Returns normalised environments, and a model that learns in them."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecNormalize
    from torch import nn

    from kitchen_suite.adapters.stable_baselines3 import make_vec_env

    environments = make_vec_env(
        "kitchen_suite:KitchenSuite/FrankaOpenCabinet-v1",
        n_envs=256,
        seed=seed,
        num_threads=1,
        max_episode_steps=EPISODE_STEPS,
        variations=AJAR,
        **TASK,
    )
    normalised = VecNormalize(environments, gamma=0.99)
    model = PPO(
        "MlpPolicy",
        normalised,
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
    return normalised, model


def train(case: Row) -> Row:
    """Trains a seed; returns the control steps, minutes of processor time and scores of its evaluations."""
    import torch

    from kitchen_suite.adapters.stable_baselines3 import EvaluationCallback

    torch.set_num_threads(1)
    environments, model = build(case["seed"])
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

    callback = TimedCallback(
        INTERVAL // environments.num_envs,
        verbose=1,
        num_episodes=EPISODES,
        domain_name="open_cabinet",
        task_kwargs=TASK,
        max_episode_steps=EPISODE_STEPS,
    )
    with contextlib.closing(environments):
        started = time.process_time()
        model.learn(STEPS, callback=callback)
    scores = [each.scores for each in callback.evaluations.values()]
    return {
        "control_steps": [*callback.evaluations],
        "minutes": [round(each / 60, 2) for each in seconds],
        "success": [each["success"] for each in scores],
        "opening": [round(each["mean_progress"], 3) for each in scores],
    }


def draw(rows: Sequence[Row]) -> None:
    """Draws success over control steps and over minutes, a line for each seed."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 2, figsize=(10, 3.5), sharey=True, layout="constrained")
    for row in rows:
        success = [100 * each for each in row["success"]]
        style = {"label": f"seed {row['seed']}", "linewidth": 1.8}
        axes[0].plot([each / 1e6 for each in row["control_steps"]], success, **style)
        axes[1].plot(row["minutes"], success, **style)
    for axis, label in zip(axes, ("control steps [million]", "minutes of one processor"), strict=True):
        # Lines at 0 and at 100 % are seen as well.
        axis.set(xlabel=label, xlim=(0, None), ylim=(-2, 103))
        axis.grid(alpha=0.3)
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylabel("episodes that succeed [%]")
    axes[0].legend()
    figure.savefig(PICTURE, dpi=150)
    pyplot.close(figure)


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the command."""
    parser = make_parser(__doc__)
    parser.add_argument("--seeds", type=numbers, default=SEEDS)
    given = parser.parse_args(arguments)
    measure_missing(FILE, [{"seed": seed} for seed in given.seeds], train)
    draw(read_rows(FILE))


if __name__ == "__main__":
    main()
