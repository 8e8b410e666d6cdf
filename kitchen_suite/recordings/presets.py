"""Presets of `kitchen-record`: sets of demonstrations, by name, with the settings that they fix."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

_DEMONSTRATOR = "expert(action_noise=0.1, jitter=0.01)"

# Four tasks always in the same order; four of the seven in an order drawn for each episode; and one to seven of them,
# in the order that suits the expert. Noise on its actions and poses makes all episodes differ.
KITCHEN: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "fixed_order": {"task_name": "complete", "policy": _DEMONSTRATOR},
        "random_order": {"task_name": "random_4", "task_kwargs": {"tasks_in_turn": True}, "policy": _DEMONSTRATOR},
        "goal_conditioned": {"task_name": "all", "task_kwargs": {"tasks_per_episode": [1, 7]}, "policy": _DEMONSTRATOR},
    }
)
