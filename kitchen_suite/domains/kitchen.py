"""The domain `kitchen`: the tasks of FrankaKitchen-v1, and others like them."""

from types import MappingProxyType

from kitchen_suite.domains.domain import Domain
from kitchen_suite.environment_classes import KITCHEN_ENVIRONMENT
from kitchen_suite.kitchen_tasks import DEFAULT_TASKS, FURTHER_TASKS, TASK_SETS

_GOALS = {
    **{name.replace(" ", "_"): (name,) for name in DEFAULT_TASKS},
    **TASK_SETS,
    **{name.replace(" ", "_"): (name,) for name in FURTHER_TASKS},
}

# `random_4` asks for four of the default tasks in each episode.
_RANDOM = {
    f"random_{count}": {"tasks_to_complete": DEFAULT_TASKS, "tasks_per_episode": count}
    for count in range(1, len(DEFAULT_TASKS) + 1)
}

KITCHEN = Domain(
    "kitchen",
    scene="kitchen_suite.entities:build_kitchen_scene",
    task="kitchen_suite.tasks:KitchenTask",
    tasks=MappingProxyType({**{name: {"tasks_to_complete": goals} for name, goals in _GOALS.items()}, **_RANDOM}),
    env_id="KitchenSuite/FrankaKitchen-v1",
    episode_steps=280,
    task_id="KitchenSuite/{}-v1",
    # The three task sets of D4RL's Franka kitchen.
    benchmark_tasks=("complete", "partial", "mixed"),
    replaceable=("tasks_to_complete",),
    env=KITCHEN_ENVIRONMENT.single,
    vector_env=KITCHEN_ENVIRONMENT.vector,
    training="kitchen_suite.training.recipes:KITCHEN_RECIPE",
    recording="kitchen_suite.episodes.presets:KITCHEN_PRESETS",
    evaluation="kitchen_suite.evaluation.protocols:KITCHEN",
    expert="kitchen_suite.policies.experts.kitchen:KitchenExpert",
    undirected="kitchen_suite.policies.experts.undirected:UndirectedExpert",
)
