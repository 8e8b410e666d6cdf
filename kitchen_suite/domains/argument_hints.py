"""Hints on arguments that some environments take and others do not: what does the same there, for error messages."""

from collections.abc import Mapping
from types import MappingProxyType

_IMAGES = "environment.physics.render(height, width, camera_id) returns an image"
_VIEWS = "dm_control.mujoco.Camera and MovableCamera, over environment.physics, take views and options of their own"
_MANY = "it is an argument of gymnasium.make_vec, which builds many environments"

VECTOR_ONLY: Mapping[str, str] = MappingProxyType(
    {
        "autoreset_mode": f"{_MANY}; with vectorization_mode='sync' it belongs into vector_kwargs",
        "num_envs": _MANY,
        "num_threads": _MANY,
    }
)
"""Arguments of vectorised environments alone."""

GYMNASIUM_ONLY: Mapping[str, str] = MappingProxyType(
    {
        **VECTOR_ONLY,
        "action_limit": "it is for Gymnasium alone; control_mode='joint_delta' has bounded actions",
        "camera_id": _IMAGES,
        "camera_name": _IMAGES,
        "default_camera_config": _VIEWS,
        "domain": "the domain is an argument of suite.load itself",
        "goal_format": "it is for Gymnasium alone; here goals are observed task by task",
        "height": _IMAGES,
        "info_format": "it is for Gymnasium alone; here there are no infos, and environment.task has what is completed",
        "instructions": "it is for Gymnasium alone; environment.task.instruction is the sentence",
        "max_episode_steps": "time_limit is the length of an episode [s], in place of its number of control steps",
        "max_geom": _VIEWS,
        "obs_type": "it is for Gymnasium alone; cameras adds images to the observation, and the environment argument "
        "flat_observation makes one array of its numbers",
        "render_mode": _IMAGES,
        "visual_options": _VIEWS,
        "width": _IMAGES,
    }
)
"""Arguments of the Gymnasium environments that `suite.load` does not take."""

LOAD_ONLY: Mapping[str, str] = MappingProxyType(
    {
        **VECTOR_ONLY,
        "environment_kwargs": "it is for suite.load alone",
        "flat_observation": "it is for suite.load alone; obs_type='state' is one array",
        "random": "it is for suite.load alone; reset(seed=...) seeds an episode",
        "seed": "reset(seed=...) seeds an episode",
        "time_limit": "max_episode_steps is the number of control steps of an episode, in place of its length [s]",
    }
)
"""Arguments of `suite.load` that the Gymnasium environments do not take."""
