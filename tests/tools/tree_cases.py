"""Episodes, recordings, evaluations and trainings whose arrays are compared between trees.

Public names alone are used: those that stay when modules move. A case returns arrays by path.
"""

import copy
import functools
import hashlib
import importlib.util
import itertools
import json
import os
import pickle
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trees

Arrays = dict[str, np.ndarray]
Case = Callable[[], Arrays]
Named = Iterator[tuple[str, Case]]
Options = Mapping[str, Any]

DOMAINS = ("kitchen", "open_cabinet", "microwave_table", "kitchens")
# Domains that have an expert in earlier trees, too.
EXPERT_DOMAINS = ("kitchen", "open_cabinet")
ENV_IDS = {
    "kitchen": "KitchenSuite/FrankaKitchen-v1",
    "open_cabinet": "KitchenSuite/FrankaOpenCabinet-v1",
    "microwave_table": "KitchenSuite/FrankaMicrowaveTable-v1",
    "kitchens": "KitchenSuite/Kitchens-v1",
}
# A task of each domain, and the standard deviation of random actions.
TASKS = {"kitchen": "all", "open_cabinet": "top_drawer", "microwave_table": "open", "kitchens": "any_2"}
SCALES = {"kitchen": 1.0, "open_cabinet": 0.05, "microwave_table": 0.05, "kitchens": 1.0}
GROUPS = ("start", "layout", "dynamics", "sensing", "appearance", "camera")
# Groups that vary nothing in a domain.
MISSING_GROUPS = {"kitchens": ("layout", "appearance")}
SPLITS = ("seen", "held_out")
AUTORESET = (("NextStep", 1), ("SameStep", 2), ("Disabled", 3))
# In the metadata of episodes, of which earlier trees had none.
ACTIONS_DIGEST = "actions_sha256"
# An array of recordings that earlier trees did not have; tests compare it with MuJoCo's own.
PHYSICS_STATE = "physics_state"

# Arguments of the tasks, which `suite.load` and the Gymnasium environments take alike, by domain and name of the case.
SETTINGS: dict[str, dict[str, dict[str, Any]]] = {
    "kitchen": {
        "defaults": {},
        "true feedback": {"feedback": "true"},
        "target feedback, slow, noisy": {"feedback": "target", "velocity_scale": 1.0, "robot_noise_ratio": 0.1},
        "fast": {"velocity_scale": 30.0},
        "no noise": {"robot_noise_ratio": 0.0, "object_noise_ratio": 0.0},
        "much noise": {"robot_noise_ratio": 0.3, "object_noise_ratio": 0.1},
        "own goals": {
            "goals": {"kettle": [0, 1, 2, 1, 0, 0, 0]},
            "threshold": 3.0,
            "terminate_on_tasks_completed": False,
        },
        "threshold by task": {"threshold": {"kettle": 0.9, "microwave": 1.0}},
        "tasks that stay": {
            "tasks_to_complete": ["kettle", "bottom burner", "top burner"],
            "remove_task_when_completed": False,
            "threshold": 1.2,
            "terminate_on_tasks_completed": False,
        },
        "tasks that end the episode": {"tasks_to_complete": ["kettle", "microwave"], "threshold": 1.2},
        "strict": {"success": "strict"},
        "dense": {"reward": "dense"},
        "dense gain": {"reward": "dense_gain", "threshold": 0.8},
        "dense, strict, removed": {"reward": "dense", "success": "strict", "tasks_to_complete": ["kettle"]},
        "two tasks per episode": {"tasks_per_episode": 2},
        "one to four tasks per episode, dense gain": {"tasks_per_episode": [1, 4], "reward": "dense_gain"},
        "tasks in turn": {"tasks_per_episode": 3, "tasks_in_turn": True, "threshold": 1.0},
        "tasks in turn, dense": {
            "tasks_per_episode": [2, 5],
            "tasks_in_turn": True,
            "reward": "dense",
            "threshold": 1.0,
            "terminate_on_tasks_completed": True,
        },
        "limit by task": {"tasks_per_episode": 4, "tasks_in_turn": True, "max_task_steps": 7},
        "closing tasks": {"tasks_to_complete": ["close microwave", "turn off light switch", "return kettle"]},
        "sleep": {"sleep": True},
    },
    "open_cabinet": {
        "defaults": {},
        "deterministic gripper": {"gripper": "deterministic"},
        "grasp reward": {"reward": "grasp"},
        "noise": {"observation_noise": {"joint_positions": 0.01, "handle_offset": 0.02, "drawer_velocity": 0.1}},
        "constants and choices": {
            "variations": {
                "cabinet/offset": [{"normal": [0, 0.01]}, 0, 0],
                "cabinet/yaw": {"uniform": [-0.1, 0.1]},
                "cabinet/drawer_top_friction": 2.0,
                "franka/pad_friction": {"choice": [1.1, 1.2]},
            }
        },
    },
    "microwave_table": {
        "defaults": {},
        "sampled gripper": {"gripper": "sampled"},
        "threshold": {"threshold": 0.8},
    },
    "kitchens": {
        "defaults": {},
        "another design": {"design": 3, "split": "test"},
        "certified": {"certified": True},
        "few slots": {"num_slots": 4},
        "dense": {"reward": "dense"},
        "dense gain": {"reward": "dense_gain"},
        "no noise": {"robot_noise_ratio": 0.0, "object_noise_ratio": 0.0},
    },
}
MODES: dict[str, dict[str, dict[str, Any]]] = {
    "shared": {
        "joint_delta": {},
        "joint_delta, fast": {"joint_speed": 2.5},
        "ee_delta_position": {},
        "ee_delta_position, hand": {"frame": "hand", "linear_speed": 0.5},
        "ee_delta_pose": {},
        "ee_delta_pose, hand": {"frame": "hand", "linear_speed": 0.1, "angular_speed": 2.0},
        "ee_pose": {},
    },
    "kitchen": {
        "joint_velocity": {},
        "joint_position": {},
        "joint_position, true feedback": {"feedback": "true"},
        "joint_position, target feedback": {"feedback": "target"},
    },
    "open_cabinet": {"joint_offset": {}, "joint_position": {}},
    "microwave_table": {"joint_offset": {}, "joint_position": {}},
    "kitchens": {"joint_velocity": {}, "joint_position": {}},
}
# Distributions of one's own, with a composer variation, which Python takes.
DISTRIBUTIONS: dict[str, dict[str, Any]] = {
    "kitchen": {
        "kettle/mass": {"normal": [0.9, 0.1]},
        "kettle/pose": [{"uniform": [-0.02, 0.02]}, {"uniform": [-0.02, 0.02]}, 0.0],
        "counter/texture": {"choice": [0, 1, 4]},
        "sensing/action_delay": 1,
        "sensing/robot_noise": {"uniform": [0.5, 2.0]},
    },
    "open_cabinet": {
        "cabinet/yaw": {"uniform": [-0.1, 0.1]},
        "cabinet/drawer_top": {"uniform": [0.0, 0.05]},
        "cabinet/drawer_top_friction": {"normal": [2.0, 0.3]},
    },
    "microwave_table": {"microwave/door": {"uniform": [-0.3, 0.0]}, "sensing/action_delay": 1},
    "kitchens": {"fixtures/damping_scale": {"uniform": [0.5, 2.0]}, "sensing/action_delay": 1},
}
EXTRAS = {
    "kitchen": ("franka/end_effector_velocity", "microwave/handle_positions", "franka/base_pose", "kettle/pose"),
    "open_cabinet": ("franka/gripper_width", "cabinet/handle_positions", "cabinet/pose", "franka/end_effector_pose"),
    "microwave_table": ("microwave/pose", "franka/end_effector_velocity", "franka/gripper_width"),
    "kitchens": ("franka/end_effector_pose", "oven_1/handle_positions", "kettle/pose"),
}


def groups(domain: str) -> tuple[str, ...]:
    """Returns the groups of variations of a domain."""
    return tuple(group for group in GROUPS if group not in MISSING_GROUPS.get(domain, ()))


def has(*packages: str) -> bool:
    return all(importlib.util.find_spec(package) for package in packages)


def has_experts() -> bool:
    return has("mink", "daqp")


# Arrays


def flat(name: str, nested: Any) -> Arrays:
    """Returns the leaves of nested containers as arrays by path; lists of strings are one array."""
    if isinstance(nested, Mapping):
        parts = {str(key): part for key, part in nested.items()}
        return {**({} if parts else {f"{name}/empty": np.array(True)}), **_joined(name, parts)}
    if isinstance(nested, tuple) and hasattr(nested, "_asdict"):
        return flat(name, nested._asdict())
    if isinstance(nested, np.ndarray) and nested.dtype == object:
        nested = nested.tolist()
    if isinstance(nested, list | tuple) and not all(isinstance(part, str) for part in nested):
        return _joined(name, dict(enumerate(nested)))
    if nested is None or isinstance(nested, list | tuple):
        return {name: np.array(json.dumps(nested))}
    leaf = np.asarray(nested)
    # Integers of more than 64 bits, which generators have.
    return {name: np.array(repr(nested)) if leaf.dtype == object else leaf}


def _joined(name: str, parts: Mapping[Any, Any]) -> Arrays:
    leaves: Arrays = {}
    for key, part in parts.items():
        leaves |= flat(f"{name}/{key}" if name else str(key), part)
    return leaves


def stacked(rows: Sequence[Arrays]) -> Arrays:
    """Returns the rows of a trajectory as one array for each name, with the rows that have it where not all do."""
    arrays: Arrays = {}
    for name in dict.fromkeys(itertools.chain(*rows)):
        having = [step for step, row in enumerate(rows) if name in row]
        column = [rows[step][name] for step in having]
        kinds = {(part.shape, part.dtype.kind if part.dtype.kind == "U" else part.dtype) for part in column}
        if len(kinds) == 1:
            arrays[name] = np.stack(column)
        else:
            arrays |= {f"{name}@{step}": part for step, part in zip(having, column, strict=True)}
        if len(having) < len(rows):
            arrays[f"{name}@rows"] = np.array(having)
    return arrays


def digests(model: Any) -> Arrays:
    """Returns a digest of each array of a compiled model, and of its names."""
    parts = {name: getattr(model, name) for name in dir(model) if not name.startswith("_") and name != "paths"}
    arrays = {name: part for name, part in parts.items() if isinstance(part, np.ndarray | bytes)}
    return {
        f"model/{name}": np.array(hashlib.sha256(np.ascontiguousarray(part).tobytes()).hexdigest()[:16])
        for name, part in arrays.items()
    }


# suite.load


def play_dm_env(
    domain: str,
    task: str,
    policy: str = "random",
    *,
    steps: int = 40,
    episodes: int = 2,
    seed: int = 3,
    with_model: bool = False,
    environment_kwargs: Options | None = None,
    **task_kwargs: Any,
) -> Arrays:
    """Plays episodes of an environment of `suite.load`, of some steps each.

    A policy that does not fit the task leaves the name of its error.
    """
    from kitchen_suite import policies, suite

    environment = suite.load(domain, task, {"random": seed, "visuals": False, **task_kwargs}, environment_kwargs)
    build, rows = policies.find(policy), []
    constants = {
        "action_spec": repr(environment.action_spec()),
        "observation_spec": [f"{name}: {spec!r}" for name, spec in environment.observation_spec().items()],
    }
    for episode in range(episodes):
        try:
            act = build(environment, np.random.default_rng((seed + episode, 1)))
        except Exception as error:
            return flat("", {**constants, "refused": type(error).__name__})
        timestep = environment.reset()
        model = digests(environment.physics.model.ptr) if with_model else {}
        rows.append({**flat("", _row(environment, timestep)), **model})
        for _ in range(steps):
            if timestep.last():
                break
            action = act(timestep)
            timestep = environment.step(action)
            rows.append(flat("", {**_row(environment, timestep), "action": action}))
    end = {
        "state": environment.get_state(),
        "metrics": json.dumps(environment.task.episode_metrics),
        "instructions": environment.task.instructions,
        "variation": _variation_values(environment.task),
        "random": environment.random_state.uniform(size=3),
    }
    return {**stacked(rows), **flat("", {**constants, **end})}


def _row(environment: Any, timestep: Any) -> dict[str, Any]:
    data = environment.physics.data
    physics = {"qpos": data.qpos.copy(), "qvel": data.qvel.copy(), "ctrl": data.ctrl.copy()}
    observation = {**timestep.observation}
    return {
        **timestep._replace(observation=observation)._asdict(),
        **physics,
        "order": list(observation),
        # That of microwave_table came after 9955c49.
        "terms": getattr(environment.task, "reward_terms", None)
        if environment.task.domain_name != "microwave_table"
        else None,
    }


# Both trees are played: tasks of 9955c49 have these themselves, later ones have them as components.


def _variation_values(task: Any) -> dict[str, np.ndarray]:
    return task.variations.values if hasattr(task, "variations") else task.variation_values


def _request_variation(task: Any, names: Sequence[str], values: Options) -> None:
    if hasattr(task, "checked_reset"):
        task.follow(task.checked_reset({"variation": names, "variation_values": values}))
    elif hasattr(task, "variations"):
        task.variations.follow(task.variations.request(names, values))
    else:
        task.request_variation(task.variation_request(names, values))


def play_request(domain: str, task: str, *, names: Sequence[str], values: Options, **task_kwargs: Any) -> Arrays:
    """Plays an episode with requested variations."""
    from kitchen_suite import suite

    environment = suite.load(domain, task, {"random": 1, "visuals": False, **task_kwargs})
    _request_variation(environment.task, names, values)
    rows = []
    for _ in range(2):
        rows += [flat("", _row(environment, environment.reset()))]
        rows += [flat("", {"values": _variation_values(environment.task)})]
    return stacked(rows)


def dm_env_cases() -> Named:
    from kitchen_suite import suite

    case = functools.partial(functools.partial, play_dm_env)
    for domain in DOMAINS:
        for task in suite.TASKS_BY_DOMAIN[domain]:
            yield f"load {domain} {task}, random", case(domain, task, steps=20)
            yield f"load {domain} {task}, trained", case(domain, task, "trained", steps=60, episodes=1)
            if has_experts() and domain in EXPERT_DOMAINS:
                yield f"load {domain} {task}, expert", case(domain, task, "expert", steps=80, episodes=1)
        task = TASKS[domain]
        yield f"load {domain} {task}, zero", case(domain, task, "zero")
        yield f"load {domain} {task}, model", case(domain, task, steps=3, with_model=True, visuals=True)
        yield f"load {domain} {task}, model without visuals", case(domain, task, steps=3, with_model=True)
        yield f"load {domain} {task}, large seed", case(domain, task, steps=10, seed=2**35 + 1)
        yield f"load {domain} {task}, time limit", case(domain, task, time_limit=0.5, episodes=3)
        yield (
            f"load {domain} {task}, flat",
            case(domain, task, steps=10, environment_kwargs={"flat_observation": True}),
        )
        buffered = {"strip_singleton_obs_buffer_dim": False}
        yield f"load {domain} {task}, buffered", case(domain, task, steps=10, environment_kwargs=buffered)
        recompiled = {"recompile_mjcf_every_episode": True}
        yield f"load {domain} {task}, recompiled", case(domain, task, steps=5, environment_kwargs=recompiled)
        yield (
            f"load {domain} {task}, extra observables",
            case(domain, task, steps=10, extra_observables=EXTRAS[domain]),
        )
        for name, settings in SETTINGS[domain].items():
            yield f"load {domain} {task}, {name}", case(domain, task, steps=30, **settings)
        for name, control in modes(domain):
            yield f"load {domain} {task}, {name}", case(domain, task, steps=15, **control)
            if has_experts() and domain in EXPERT_DOMAINS:
                expert = case(domain, task, "expert", steps=60, episodes=1, **control)
                yield f"load {domain} {task}, {name}, expert", expert
        for group, split in itertools.product(groups(domain), SPLITS):
            varied = {"variations": group, "variation_split": split, "with_model": True, "episodes": 3, "steps": 4}
            visuals = group in ("appearance", "camera")
            yield f"load {domain} {task}, varied {group} {split}", case(domain, task, visuals=visuals, **varied)
        everything = {"variations": groups(domain), "episodes": 3, "steps": 4}
        yield f"load {domain} {task}, varied all", case(domain, task, **everything)
        own = {"variations": DISTRIBUTIONS[domain], "episodes": 3, "steps": 10}
        yield f"load {domain} {task}, own distributions", case(domain, task, **own)
    if has_experts():
        noisy = "expert(speed=0.8, jitter=0.005, action_noise=0.002)"
        yield "load kitchen all, noisy expert to the end", case("kitchen", "all", noisy, steps=280, episodes=1)
        yield "load open_cabinet bottom_drawer, noisy expert", case("open_cabinet", "bottom_drawer", noisy, steps=300)
    yield "load open_cabinet top_drawer, trained grasp", case("open_cabinet", "top_drawer", "trained", reward="grasp")
    turn = {"tasks_in_turn": True, "steps": 150, "episodes": 1}
    yield "load kitchen random_1, trained in turn", case("kitchen", "random_1", "trained", **turn)
    yield "load kitchen random_4, trained in turn", case("kitchen", "random_4", "trained", **turn)
    yield "load open_cabinet top_drawer, composer variation", play_composer_variation
    yield "load open_cabinet top_drawer, cabinet config", play_cabinet_config
    asked = {"names": ["dynamics"], "values": {"kettle/pose": [0.02, 0.0, 0.1]}, "variations": "start,dynamics"}
    yield "load kitchen kettle, requested variation", functools.partial(play_request, "kitchen", "kettle", **asked)
    yield "load kitchen random_3, requested tasks", play_requested_tasks


def play_composer_variation() -> Arrays:
    from dm_control.composer.variation import distributions

    varied = {"cabinet/yaw": distributions.Uniform(-0.05, 0.05), "sensing/action_delay": distributions.Bernoulli(0.5)}
    return play_dm_env("open_cabinet", "top_drawer", variations=varied, episodes=3, steps=5)


def play_cabinet_config() -> Arrays:
    from kitchen_suite.entities import CabinetConfig

    config = CabinetConfig(drawer_friction=5.0)
    return play_dm_env("open_cabinet", "top_drawer", cabinet_config=config, steps=5, with_model=True)


def play_requested_tasks() -> Arrays:
    from kitchen_suite import suite

    environment = suite.load("kitchen", "random_3", {"random": 1, "visuals": False})
    task = environment.task
    asked = {"requested_tasks": ["kettle", "top burner"]}
    if hasattr(task, "checked_reset"):
        task.follow(task.checked_reset(asked))
    elif hasattr(task, "requests"):
        task.requests.follow(task.requests.checked(asked))
    else:
        task.request_reset(task.reset_request(asked))
    rows = [flat("", _row(environment, environment.reset())) for _ in range(3)]
    task.task_weights = np.arange(7.0) + 1.0
    rows += [flat("", _row(environment, environment.reset())) for _ in range(3)]
    return {**stacked(rows), **flat("state", environment.get_state())}


def modes(domain: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yields names of settings of all control modes of a domain, and the arguments."""
    for name, options in {**MODES[domain], **MODES["shared"]}.items():
        yield name, {"control_mode": name.partition(",")[0], **options}


# Gymnasium


def actions(rng: np.random.Generator, space: Any, scale: float) -> np.ndarray:
    """Returns normal actions, within the bounds of their space."""
    low, high = np.asarray(space.low, float), np.asarray(space.high, float)
    centre = np.where(np.isfinite(low) & np.isfinite(high), (low + high) / 2, 0.0)
    return np.clip(centre + rng.normal(size=space.shape) * scale, low, high)


def play_gymnasium(
    domain: str, *, steps: int = 24, seed: int = 11, resets: Sequence[Options] = (), **kwargs: Any
) -> Arrays:
    """Plays an episode, saves and restores its state on the way, and starts further ones with options."""
    import gymnasium

    import kitchen_suite.gymnasium_env  # noqa: F401

    environment = gymnasium.make(ENV_IDS[domain], **kwargs)
    inner, rng = environment.unwrapped, np.random.default_rng(seed)
    rows = [_named("reset", environment.reset(seed=seed))]
    for step in range(steps):
        if step == steps // 2:
            inner.set_state(copy.deepcopy(inner.get_state()))
            twin = pickle.loads(pickle.dumps(inner))
            rows.append(flat("state", inner.get_state()))
        action = actions(rng, environment.action_space, SCALES[domain])
        result = inner.step(action.astype(np.float32 if step % 2 else np.float64))
        rows.append(_named("step", result))
        if step >= steps // 2:
            rows.append(_named("twin", twin.step(action.astype(np.float32 if step % 2 else np.float64))))
        if domain == "kitchen" and isinstance(result[0], Mapping) and "achieved_goal" in result[0]:
            observation, info = result[0], result[-1]
            reward = inner.compute_reward(observation["achieved_goal"], observation["desired_goal"], info)
            rows.append(flat("computed", reward))
    saved = inner.get_state()
    rows.append(flat("saved", saved))
    for options in resets:
        rows.append(_named("reset", environment.reset(seed=seed + 1, options=dict(options))))
        rows.append(_named("step", inner.step(action)))
    rows.append(_named("reset", environment.reset()))
    rows.append(_named("restored", environment.reset(options={"state": saved})))
    rows.append(_named("step", inner.step(action)))
    constants = {
        "action_space": repr(environment.action_space),
        "observation_space": repr(environment.observation_space),
        "instruction": inner.instruction,
        "metadata": json.dumps(inner.metadata, default=repr, sort_keys=True),
        "spec": json.dumps([environment.spec.id, environment.spec.max_episode_steps]),
    }
    environment.close()
    return {**stacked(rows), **flat("", constants)}


def _named(name: str, result: Sequence[Any]) -> Arrays:
    """Returns what `reset` or `step` returns as arrays, with the order of the observation's keys."""
    parts = ("observation", "info") if len(result) == 2 else ("observation", "reward", "ended", "truncated", "info")
    named = dict(zip(parts, result, strict=True))
    order = [*named["observation"]] if isinstance(named["observation"], Mapping) else []
    return flat(name, {**named, "order": order})


def play_vectorised(
    domain: str,
    mode: str,
    num_threads: int,
    *,
    steps: int = 24,
    count: int = 4,
    resets: Sequence[Options] = (),
    **kwargs: Any,
) -> Arrays:
    """Plays several episodes in each of some environments, and starts further ones with options."""
    import gymnasium

    import kitchen_suite.gymnasium_env  # noqa: F401

    environments = gymnasium.make_vec(
        ENV_IDS[domain],
        count,
        vectorization_mode="vector_entry_point",
        num_threads=num_threads,
        autoreset_mode=gymnasium.vector.AutoresetMode(mode),
        max_episode_steps=9,
        **kwargs,
    )
    rng, rows, seeds = np.random.default_rng(5), [], (4, 2**40, 1, 7)
    rows.append(_named("reset", environments.reset(seed=5)))
    rows.append(_named("reset", environments.reset(seed=[*seeds[:count]])))

    def act() -> np.ndarray:
        return actions(rng, environments.action_space, SCALES[domain])

    for _ in range(steps):
        result = environments.step(act())
        rows.append(_named("step", result))
        ended = result[2] | result[3]
        if mode == "Disabled" and ended.any():
            rows.append(_named("masked", environments.reset(options={"reset_mask": ended})))
    for options in resets:
        rows.append(_named("options", environments.reset(seed=9, options=dict(options))))
        rows.append(_named("step", environments.step(act())))
    if mode == "Disabled":
        environments.reset()
        running = np.full(count, True)
        for left in (3, 2, 1):
            mask = running & (np.arange(count) < left)
            if not mask.any():
                break
            some = environments.unwrapped.step_some(act(), mask)
            running &= ~(some[2] | some[3])
            # Observations and infos of the others have no meaning.
            rows.append({name: part[mask] for name, part in _named("some", some).items() if part.shape[:1] == (count,)})
    constants = {
        "instruction": list(environments.unwrapped.instruction),
        "action_space": repr(environments.action_space),
        "observation_space": repr(environments.observation_space),
        "seeds": environments.unwrapped.np_random_seed,
    }
    environments.close()
    return {**stacked(rows), **flat("", constants)}


def gymnasium_cases() -> Named:
    case = functools.partial(functools.partial, play_gymnasium)
    kitchen = SETTINGS["kitchen"]
    formats = {
        "flat goals, arrays": {"goal_format": "flat", "info_format": "arrays"},
        "instructions": {"instructions": True, "tasks_per_episode": 3},
        "in turn, flat goals, arrays": {**kitchen["tasks in turn"], "goal_format": "flat", "info_format": "arrays"},
    }
    limits = {
        "open_cabinet": {"limited": {"action_limit": 0.03}},
        "microwave_table": {"unlimited": {"action_limit": None}},
        "kitchens": {"instructions of every episode": {"tasks_per_episode": 2}},
    }
    for domain in DOMAINS:
        settings = {**SETTINGS[domain], **(formats if domain == "kitchen" else limits[domain])}
        settings |= {"own episode limit": {"max_episode_steps": 10}}
        settings |= {f"observation {name}": each for name, each in observations(domain)}
        settings |= dict(modes(domain))
        settings |= {
            f"varied {group} held_out": {"variations": group, "variation_split": "held_out"} for group in groups(domain)
        }
        settings |= {"own distributions": {"variations": DISTRIBUTIONS[domain]}}
        for number, (name, kwargs) in enumerate(settings.items()):
            yield f"gymnasium {domain}, {name}", case(domain, **kwargs)
            limit = {key: value for key, value in kwargs.items() if key != "max_episode_steps"}
            every = name in ("defaults", "tasks in turn", "own distributions", "dense gain", "grasp reward")
            for mode, num_threads in AUTORESET if every else (AUTORESET[number % 3],):
                many = functools.partial(play_vectorised, domain, mode, num_threads, **limit)
                yield f"vector {domain}, {name}, {mode}, {num_threads} threads", many
        if domain == "open_cabinet":
            yield "gymnasium open_cabinet, bottom drawer", case(domain, drawer="bottom")
    yield from options_cases()
    if os.environ["MUJOCO_GL"] != "disable":
        for domain in DOMAINS:
            pictures = {
                "obs_type": "pixels_agent_pos",
                "image_size": (24, 32),
                "render_quality": "fast",
                "cameras": ("overview", "franka/hand"),
                "depth": True,
                "segmentation": True,
            }
            yield f"gymnasium {domain}, pictures", case(domain, steps=4, **pictures)
            many = functools.partial(play_vectorised, domain, "SameStep", 2, steps=11, count=2, **pictures)
            yield f"vector {domain}, pictures", many
        yield "gymnasium kitchen, rendered", play_rendered


def observations(domain: str) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yields arguments of all observation types without pictures, with and without extra observables."""
    for obs_type in ("state", "environment_state_agent_pos"):
        yield obs_type, {"obs_type": obs_type}
        yield f"{obs_type}, extra", {"obs_type": obs_type, "extra_observables": EXTRAS[domain]}
    if domain == "kitchen":
        yield "goal, extra", {"obs_type": "goal", "extra_observables": EXTRAS[domain]}
        yield "state, two tasks per episode", {"obs_type": "state", "tasks_per_episode": 2}


def options_cases() -> Named:
    """Yields cases of the options of `reset`."""
    varied = ["start", "layout", "dynamics"]
    kitchen_values = {"kettle/mass": 1.0, "kettle/burner": 1}
    single: dict[str, tuple[dict[str, Any], list[Options]]] = {
        "kitchen": (
            {"variations": varied},
            [
                {"variation": ["dynamics", "microwave/yaw"], "variation_values": kitchen_values},
                {"variation": []},
                {"variation_values": {"kettle": {"mass": 1.0}}},
            ],
        ),
        "open_cabinet": ({"variations": varied}, [{"variation": "layout"}, {"variation_values": {"cabinet/yaw": 0.1}}]),
        "microwave_table": ({"variations": varied}, [{"variation": ["start"]}]),
        "kitchens": ({"variations": ["start", "dynamics"]}, [{"variation": ["start"]}]),
    }
    vector = {
        "kitchen": {"kettle/mass": np.array([0.8, 0.9, 1.0, 1.1])},
        "open_cabinet": {"cabinet/yaw": np.array([0.0, 0.05, 0.1, -0.1])},
        "microwave_table": {"microwave/yaw": np.array([-1.6, -1.5, -1.55, -1.7])},
        "kitchens": {"fixtures/damping_scale": np.array([0.8, 0.9, 1.1, 1.2])},
    }
    for domain, (kwargs, resets) in single.items():
        yield (
            f"gymnasium {domain}, options of variations",
            functools.partial(play_gymnasium, domain, resets=resets, **kwargs),
        )
        rows = [
            {"variation": ["start", *vector[domain]], "variation_values": vector[domain]},
            {"variation": ["dynamics"]},
        ]
        rows.append({"reset_mask": np.array([True, False, True, False])})
        yield (
            f"vector {domain}, options of variations",
            functools.partial(play_vectorised, domain, "NextStep", 2, resets=rows, **kwargs),
        )
    asked = [{"requested_tasks": ["kettle", "microwave"]}, {"requested_tasks": np.arange(7) == 2}]
    each = [{"requested_tasks": [["kettle"], None, ["microwave", "top burner"], None]}]
    for in_turn in (False, True):
        kwargs = {"tasks_per_episode": [1, 4], "tasks_in_turn": in_turn}
        yield (
            f"gymnasium kitchen, requested tasks, in turn {in_turn}",
            functools.partial(play_gymnasium, "kitchen", resets=asked, **kwargs),
        )
        yield (
            f"vector kitchen, requested tasks, in turn {in_turn}",
            functools.partial(play_vectorised, "kitchen", "SameStep", 1, resets=each, **kwargs),
        )


def play_rendered() -> Arrays:
    """Renders the free camera of a single environment, and the first ones of a vector."""
    import gymnasium

    import kitchen_suite.gymnasium_env  # noqa: F401

    kwargs = {"render_mode": "rgb_array", "width": 32, "height": 24, "render_quality": "fast"}
    environment = gymnasium.make(ENV_IDS["kitchen"], **kwargs)
    environment.reset(seed=0)
    environments = gymnasium.make_vec(ENV_IDS["kitchen"], 2, vectorization_mode="vector_entry_point", **kwargs)
    environments.reset(seed=0)
    arrays = {"one": environment.render(), "many": np.stack(environments.render())}
    environments.close()
    environment.close()
    return arrays


# Commands


def run(name: str, *arguments: str) -> str:
    """Runs a command of the tree that is compared."""
    return trees.run_command(Path(os.environ["COMPARED_TREE"]), name, *arguments)


def rollout(*arguments: str) -> Arrays:
    """Returns the episodes of a rollout, as its table has them, without the times."""
    rows = [line.split() for line in run("kitchen-rollout", *arguments).splitlines() if line.strip()]
    rows = [row for row in rows if row[0].isdecimal()]
    assert rows
    return {f"row_{i}": np.array([*row[:4], *row[5:]]) for i, row in enumerate(rows)}


def npz(path: Path) -> Arrays:
    """Returns the arrays of an npz file; the names in its metadata stand for these."""
    with np.load(path) as file:
        arrays = {name: file[name] for name in file if name not in ("metadata", PHYSICS_STATE)}
        names = json.loads(str(file["metadata"])) if "metadata" in file else {}
    return {**arrays, "metadata": np.array(json.dumps(sorted({*names} - {ACTIONS_DIGEST})))}


def record(*arguments: str) -> Arrays:
    """Records, and replays: kitchen-replay succeeds only where the replay is equal. Returns the recorded arrays."""
    with tempfile.TemporaryDirectory() as folder:
        run("kitchen-record", f"--output={folder}/r", "--num_threads=1", *arguments)
        run("kitchen-replay", f"{folder}/r", "--num_episodes=3")
        arrays: Arrays = {}
        for path in sorted(Path(folder, "r").glob("episode_*.npz")):
            arrays |= {f"{path.stem}/{name}": part for name, part in npz(path).items()}
        description = json.loads(Path(folder, "r", "recording.json").read_text(encoding="utf-8"))
        return {**arrays, "description": np.array(json.dumps(sorted(description)))}


def record_minari(*arguments: str) -> Arrays:
    """Records, and makes a Minari dataset. Returns the arrays and attributes of its HDF5 file."""
    import h5py

    arrays: Arrays = {}

    def note(path: str, part: Any) -> None:
        attributes = {name: value for name, value in part.attrs.items() if name != ACTIONS_DIGEST}
        arrays.update({f"{path}@{name}": np.asarray(value) for name, value in attributes.items()})
        if isinstance(part, h5py.Dataset):
            arrays[path] = np.array(part.asstr()[()] if part.dtype == object else part)

    with tempfile.TemporaryDirectory() as folder:
        run("kitchen-record", f"--output={folder}/r", *arguments)
        run("kitchen-convert", f"{folder}/r", "--dataset=compared/trees-v0", f"--data_path={folder}/data")
        (path,) = Path(folder, "data").rglob("main_data.hdf5")
        with h5py.File(path) as file:
            file.visititems(note)
    return {name: part for name, part in arrays.items() if part.dtype != object}


def train(*arguments: str, demonstrations: Sequence[str] = (), **hyperparameters: Any) -> Arrays:
    """Returns the parameters of a small policy after a few updates, or after an imitation of some episodes."""
    with tempfile.TemporaryDirectory() as folder:
        if demonstrations:
            run("kitchen-record", f"--output={folder}/d", *demonstrations)
            arguments = (*arguments, f"--demonstrations={folder}/d")
        changes = f"--hyperparameters={json.dumps(hyperparameters)}"
        short = ("--eval_episodes=2", "--restarts=0", "--num_threads=1", "--target_success=2", changes)
        run("kitchen-train", f"--output={folder}/t", *short, *arguments)
        policy, *_ = sorted(Path(folder, "t").rglob("policy.npz"))
        return npz(policy)


def evaluate(*arguments: str) -> Arrays:
    """Returns the JSON of an evaluation."""
    with tempfile.TemporaryDirectory() as folder:
        run("kitchen-evaluate", f"--json={folder}/e.json", "--num_threads=1", *arguments)
        return flat("", json.loads(Path(folder, "e.json").read_text(encoding="utf-8")))


def play_shipped(name: str) -> Arrays:
    """Returns the values of the summary that kitchen-play prints, by name."""
    printed = run("kitchen-play", f"--shipped={name}", "--num_episodes=2", "--max_episode_steps=60", "--novideo")
    rows = [re.fullmatch(r"([a-z]\S*(?: \S+)*) {2,}(\S.*)", line) for line in printed.splitlines()]
    found = {row[1]: np.array(row[2]) for row in rows if row}
    del found["steps per second"]
    assert "mean return" in found, printed
    return found


def export(domain: str) -> Arrays:
    """Returns digests of the exported files, but for the scene's MJCF, of which `scene.mjb` is the compiled model."""
    with tempfile.TemporaryDirectory() as folder:
        run("kitchen-export", f"--domain_name={domain}", f"--output={folder}/e")
        files = sorted(path for path in Path(folder, "e").rglob("*") if path.is_file() and path.name != "scene.xml")
        return {path.name: np.array(hashlib.sha256(path.read_bytes()).hexdigest()) for path in files}


def command_cases() -> Named:
    case = functools.partial
    cabinet, table = "--domain_name=open_cabinet", "--domain_name=microwave_table"
    short, two = "--max_episode_steps=40", "--num_episodes=2"
    if has("torch", "tensorboard"):
        small = {"num_envs": 8, "rollouts": 16, "mini_batches": 2, "hidden": [16]}
        steps = ("--num_steps=384", "--eval_interval=128")
        cloned = {**small, "clone_epochs": 3, "value_batches": 1}
        kettle = ("--domain_name=kitchen", "--task_name=kettle")
        shown = (cabinet, "--policy=trained", two)
        yield "train open_cabinet", case(train, cabinet, *steps, **small)
        yield "train open_cabinet, varied", case(train, cabinet, *steps, "--variations=start,sensing", **small)
        yield "train kitchen kettle", case(train, *kettle, *steps, **small)
        yield (
            "train kitchen in turn",
            case(
                train,
                "--domain_name=kitchen",
                "--task_name=random_1",
                '--task_kwargs={"tasks_in_turn": true, "max_task_steps": 20}',
                *steps,
                **small,
            ),
        )
        yield "train microwave_table", case(train, table, *steps, **small)
        yield "train open_cabinet from demonstrations", case(train, cabinet, *steps, demonstrations=shown, **cloned)
        successes = (*kettle, "--policy=trained", two)
        imitated = ("--num_steps=20", "--eval_interval=10", *kettle)
        options = {"width": 16, "blocks": 1, "chunk": 4, "batch_size": 32}
        yield "train kitchen by bc", case(train, *imitated, "--algorithm=bc", demonstrations=successes, **options)
    experts = ("expert",) if has_experts() else ()
    for policy in ("random", "trained", *experts):
        yield (
            f"evaluate kitchen, default, {policy}",
            case(evaluate, f"--policy={policy}", two, "--max_episode_steps=120"),
        )
        yield f"evaluate open_cabinet, {policy}", case(evaluate, cabinet, f"--policy={policy}", two)
    yield "evaluate microwave_table", case(evaluate, table, two)
    for protocol in ("strict", "diffusion-policy", "d4rl", "shift"):
        yield f"evaluate kitchen, {protocol}", case(evaluate, f"--protocol={protocol}", short, two)
    yield "evaluate microwave_table, shift", case(evaluate, table, "--protocol=shift", short, two)
    if experts:
        yield "evaluate kitchen, shift, expert", case(evaluate, "--protocol=shift", "--policy=expert", short, two)
    yield "rollout kitchen", case(rollout, two)
    yield "rollout open_cabinet trained", case(rollout, cabinet, "--policy=trained", "--seed=5", two)
    yield "rollout microwave_table", case(rollout, table, two)
    if experts:
        yield "rollout kitchen expert", case(rollout, "--task_name=all", "--policy=expert", two)
        yield "record kitchen expert", case(record, "--policy=expert", "--num_episodes=4", "--num_envs=3")
        for preset in ("fixed_order", "random_order", "goal_conditioned"):
            yield f"record kitchen {preset}", case(record, f"--preset={preset}", two, "--max_episode_steps=100")
        mode = ("--control_mode=ee_delta_pose", "--task_name=kettle", two)
        yield "record kitchen expert, ee_delta_pose", case(record, "--policy=expert", *mode)
    yield "record kitchen random", case(record, "--task_name=kettle", "--num_episodes=5", "--num_envs=2", short)
    yield "record kitchen random_4", case(record, "--task_name=random_4", "--num_episodes=4", short)
    yield "record open_cabinet trained", case(record, cabinet, "--policy=trained", "--num_episodes=4", "--seed=9")
    yield "record open_cabinet random", case(record, cabinet, "--num_episodes=6", "--num_envs=4", short)
    yield "record microwave_table random", case(record, table, "--num_episodes=3", short)
    for domain in DOMAINS:
        # Nothing of a generated kitchen's layout varies.
        groups = "start,sensing" if domain == "kitchens" else "start,layout,sensing"
        varied = (f"--domain_name={domain}", f"--variations={groups}", "--variation_split=held_out")
        yield f"record {domain}, varied", case(record, *varied, two, short)
        if has("minari", "h5py"):
            yield f"record {domain} to Minari", case(record_minari, f"--domain_name={domain}", two, short)
        yield f"export {domain}", case(export, domain)
    for name in ("kettle", "kitchen", "seven_in_turn", "top_drawer", "top_drawer_grasp"):
        yield f"play {name}", case(play_shipped, name)


@functools.cache
def cases() -> dict[str, Case]:
    """Returns all cases by name, the long ones first."""
    return dict(itertools.chain(command_cases(), gymnasium_cases(), dm_env_cases()))
