"""Sets of demonstrations by name, as `kitchen-record --preset` makes them: task, policy, and number of episodes."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

_DEMONSTRATOR = "expert(action_noise=0.1, jitter=0.01)"
_UNDIRECTED = "undirected(action_noise=0.1, jitter=0.01{})"

# Size of the sets that are made as D4RL's `partial` and `mixed`.
_D4RL = {"num_episodes": 1_000, "max_episode_steps": 140}

# As many steps as OGBench's sets of play have.
_PLAY = {
    "task_name": "all",
    "task_kwargs": {"terminate_on_tasks_completed": False},
    "num_episodes": 1_000,
    "max_episode_steps": 1_000,
}

# Noise on actions and poses makes all episodes differ. The last five are for offline learning:
# docs/guide/learning_from_data.md.
KITCHEN_PRESETS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        # Four tasks, always in the same order.
        "fixed_order": {"task_name": "complete", "policy": _DEMONSTRATOR},
        # Four of the seven, in an order drawn for each episode.
        "random_order": {"task_name": "random_4", "task_kwargs": {"tasks_in_turn": True}, "policy": _DEMONSTRATOR},
        # One to seven, in the order that suits the expert.
        "goal_conditioned": {"task_name": "all", "task_kwargs": {"tasks_per_episode": [1, 7]}, "policy": _DEMONSTRATOR},
        # The four tasks of D4RL's `complete`, always in the same order, in about as many episodes.
        "complete": {"task_name": "complete", "policy": _DEMONSTRATOR, "num_episodes": 20},
        # Tasks in random order; some episodes do the four that are rewarded, and no others.
        "partial": {"task_name": "partial", "policy": _UNDIRECTED.format(", directed=0.1"), **_D4RL},
        # Tasks in random order; no episode does all four that are rewarded.
        "mixed": {"task_name": "mixed", "policy": _UNDIRECTED.format(", spare_last=True"), **_D4RL},
        # All twenty tasks, without end: what has been done is undone.
        "play": {**_PLAY, "policy": _UNDIRECTED.format(", repertoire='twenty'")},
        # The same with large noise, and one uniform action in ten.
        "noisy": {**_PLAY, "policy": "undirected(action_noise=0.5, random_actions=0.1, repertoire='twenty')"},
    }
)
