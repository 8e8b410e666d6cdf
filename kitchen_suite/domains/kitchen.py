"""The domain `kitchen`: the tasks of FrankaKitchen-v1, alone and in sets."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from kitchen_suite import checks
from kitchen_suite.domains.base import CONTROL_OPTIONS, Domain, build_environment, check_task_options, checked_visuals

if TYPE_CHECKING:
    from kitchen_suite.environment import Environment


def kitchen(
    *,
    tasks_to_complete: Sequence[str],
    time_limit: float | None = 22.4,
    random: int | np.random.RandomState | None = None,
    visuals: bool = True,
    render_quality: str = "high",
    sleep: bool = False,
    environment_kwargs: Mapping[str, Any] | None = None,
    **task_options: Any,
) -> "Environment":
    """Builds a kitchen environment.

    Args:
      tasks_to_complete: names of the tasks, spelt as in `tasks.GOALS`.
      time_limit: length of an episode [s]; `None` for no limit.
      random: seed, or random state to draw from.
      visuals: `False` omits geoms and textures that only rendering needs; trajectories are the same to the bit.
      render_quality: `high`, or `fast`: images without shadows, reflections, sky and multisampling, and with fewer
        faces; see `rendering.quality.set_render_quality`.
      sleep: whether MuJoCo may put resting objects to sleep: faster, but trajectories are only nearly the same; see
        `build_kitchen_scene`.
      environment_kwargs: further arguments of `Environment`.
      **task_options: further arguments of `KitchenTask`, among them the observables that `SuiteTask` adds.

    Raises:
      TypeError: an argument of the wrong type, or an unknown one.
      ValueError: see `KitchenTask`; or the time limit is not positive and finite.
    """
    from kitchen_suite.entities import build_kitchen_scene
    from kitchen_suite.tasks import KitchenTask
    from kitchen_suite.tasks.kitchen.action import CONTROL_MODES

    check_task_options(task_options, kitchen, KitchenTask, CONTROL_MODES)
    scene = build_kitchen_scene(visuals=checked_visuals(visuals, task_options), sleep=checks.boolean(sleep, "sleep"))
    return build_environment(
        KitchenTask(scene, tasks_to_complete=tasks_to_complete, **task_options),
        time_limit=time_limit,
        random=random,
        render_quality=render_quality,
        environment_kwargs=environment_kwargs,
    )


# Spelt and ordered as `tasks.DEFAULT_TASKS`.
_GOALS = (
    "bottom burner",
    "top burner",
    "light switch",
    "slide cabinet",
    "hinge cabinet",
    "microwave",
    "kettle",
)

# Further tasks, one at a time.
_FURTHER_GOALS = (
    "bottom right burner",
    "top right burner",
    "left hinge cabinet",
    "close microwave",
    "close slide cabinet",
    "close hinge cabinet",
    "close left hinge cabinet",
    "turn off bottom burner",
    "turn off top burner",
    "turn off bottom right burner",
    "turn off top right burner",
    "turn off light switch",
    "return kettle",
)

# `complete` and `partial` are two data sets of D4RL, of demonstrations for the same four goals.
_TASKS = {
    **{name.replace(" ", "_"): (name,) for name in _GOALS},
    "complete": ("microwave", "kettle", "light switch", "slide cabinet"),
    "partial": ("microwave", "kettle", "light switch", "slide cabinet"),
    "mixed": ("microwave", "kettle", "bottom burner", "light switch"),
    "all": _GOALS,
    **{name.replace(" ", "_"): (name,) for name in _FURTHER_GOALS},
}

# `random_4` asks for four of the default tasks in each episode.
_RANDOM = {
    f"random_{count}": {"tasks_to_complete": _GOALS, "tasks_per_episode": count} for count in range(1, len(_GOALS) + 1)
}

# The doors of microwave and hinge cabinet are closed in half of the episodes of training, and ajar in the others [rad]:
# exploration alone reaches their handles, and does not pull.
_AJAR = {
    "microwave/door": {"choice": (*[0.0] * 6, -0.05, -0.1, -0.15, -0.2, -0.27, -0.35)},
    "hinge_cabinet/doors": {"choice": ((0.0, 0.0),) * 6 + tuple((0.0, q) for q in (0.08, 0.2, 0.35, 0.5, 0.65, 0.8))},
}

# Sets of demonstrations: four tasks always in the same order; four of the seven in an order drawn for each episode; and
# one to seven of them, in the order that suits the expert. Noise on its actions and poses makes all episodes differ.
_DEMONSTRATOR = "expert(action_noise=0.1, jitter=0.01)"
_PRESETS: Mapping[str, Mapping[str, Any]] = {
    "fixed_order": {"task_name": "complete", "policy": _DEMONSTRATOR},
    "random_order": {"task_name": "random_4", "task_kwargs": {"tasks_in_turn": True}, "policy": _DEMONSTRATOR},
    "goal_conditioned": {"task_name": "all", "task_kwargs": {"tasks_per_episode": [1, 7]}, "policy": _DEMONSTRATOR},
}

_STATE_OPTIONS = ("velocity_scale", "feedback", *CONTROL_OPTIONS)

KITCHEN = Domain(
    name="kitchen",
    build=kitchen,
    tasks=MappingProxyType({**{name: {"tasks_to_complete": goals} for name, goals in _TASKS.items()}, **_RANDOM}),
    env_id="KitchenSuite/FrankaKitchen-v1",
    env="kitchen_suite.gymnasium_env.kitchen:FrankaKitchenEnv",
    vector_env="kitchen_suite.vector_env.kitchen:FrankaKitchenVectorEnv",
    episode_steps=280,
    task_id="KitchenSuite/{}-v1",
    # The three task sets of D4RL's Franka kitchen.
    benchmark_tasks=("complete", "partial", "mixed"),
    replaceable=("tasks_to_complete",),
    array_options=MappingProxyType({"info_format": "arrays"}),
    flat_options=MappingProxyType({"goal_format": "flat"}),
    state_options=_STATE_OPTIONS,
    cloning_options=("tasks_to_complete", "tasks_per_episode", "tasks_in_turn", "goals", *_STATE_OPTIONS),
    hyperparameters=MappingProxyType(
        {
            "num_envs": 64,
            "rollouts": 32,
            "learning_epochs": 5,
            "mini_batches": 4,
            "hidden": (128, 128),
            "learning_rate": 5e-4,
            "value_learning_rate": 5e-4,
            "kl_target": 0.0,
            "discount": 0.98,
            "entropy_scale": 0.0,
            "reward_scale": 10.0,
            "exploration": 0.5,
            "noise_correlation": 0.7,
            "standardisation_epsilon": 0.05,
            "action_scale": (1.0,) * 9,
        }
    ),
    cloning_hyperparameters=MappingProxyType(
        {
            "num_envs": 32,
            "rollouts": 140,
            "learning_epochs": 5,
            "hidden": (512, 512),
            "mini_batches": 10,
            "learning_rate": 1e-4,
            "value_learning_rate": 1e-3,
            "discount": 0.995,
            "reward_scale": 1.0,
            "exploration": 0.1,
            "noise_correlation": 0.0,
            "action_scale": (0.5,) * 9,
        }
    ),
    training_options=MappingProxyType(
        {
            "max_episode_steps": 100,
            "reward": "dense_gain",
            "sleep": True,
            "variations": _AJAR,
        }
    ),
    training_settings=MappingProxyType(
        {"num_steps": 4_000_000, "eval_interval": 40_000, "target_success": 0.97, "patience": 1_000_000}
    ),
    recording_presets=MappingProxyType(_PRESETS),
    evaluation_task="random_4",
    protocols=("strict", "diffusion-policy", "d4rl", "beso"),
    expert="kitchen_suite.policies.experts.kitchen:KitchenExpert",
    benchmark="kitchen_suite.benchmarks.kitchen:KITCHEN",
)
