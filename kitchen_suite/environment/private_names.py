"""The private names of dm_control on which the environment relies, and a check that they exist."""

import importlib.metadata
import pkgutil
from collections.abc import Collection, Mapping

# By class. Most are attributes of instances, some are methods.
PRIVATE_NAMES: Mapping[str, tuple[str, ...]] = {
    "dm_control.composer.environment:Environment": (
        "_delayed_observation_padding",
        "_fixed_initial_state",
        "_fixed_random_state",
        "_hooks",
        "_legacy_step",
        "_make_observation_updater",
        "_mjcf_never_compiled",
        "_n_sub_steps",
        "_observation_updater",
        "_overridden_n_sub_steps",
        "_physics",
        "_physics_proxy",
        "_random_state",
        "_recompile_physics",
        "_reset_next_step",
        "_strip_singleton_obs_buffer_dim",
        "_substep",
        "_task",
    ),
    "dm_control.mujoco.engine:Physics": (
        "_contexts",
        "_free_rendering_contexts",
        "_make_rendering_contexts",
        "_reload_from_data",
        "_step_with_up_to_date_position_velocity",
        "_warnings",
    ),
    "dm_control.mujoco.engine:Camera": ("_render_on_gl_thread",),
    "dm_control.composer.environment:_EnvironmentHooks": (
        "_after_substep",
        "_before_substep",
        "_initialize_episode",
    ),
    "dm_control.composer.environment:_Hook": ("entity_hooks", "extra_hooks"),
    "dm_control.composer.observation.updater:Updater": (
        "_enabled_structure",
        "_observables",
        "_physics_steps_per_control_step",
        "_step_counter",
        "_strip_singleton_buffer_dim",
    ),
    "dm_control.composer.observation.updater:_EnabledObservable": ("buffer", "observation_callable"),
}


def check_private_names(required: Mapping[str, Collection[str]] = PRIVATE_NAMES) -> None:
    """Raises an ImportError unless the installed dm_control has the required names, by class."""
    if missing := [f"{path}.{name}" for path, names in required.items() for name in sorted({*names} - names_of(path))]:
        installed = importlib.metadata.version("dm-control")
        needed = "dm-control >= 1.0.50, < 1.1"
        raise ImportError(f"dm-control {installed} has no {', '.join(missing)}; kitchen_suite needs {needed}")


def names_of(path: str) -> set[str]:
    """Returns the names that a class defines or that its methods use; none where there is no such class."""
    try:
        cls = pkgutil.resolve_name(path)
    except (AttributeError, ImportError):
        return set()
    members = [member for base in cls.__mro__ for member in vars(base).items()]
    code = [member.__code__ for _, member in members if hasattr(member, "__code__")]
    return {name for name, _ in members}.union(*(block.co_names for block in code))
