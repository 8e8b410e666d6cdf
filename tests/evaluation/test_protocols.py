"""The protocols, number by number, and how flags replace their values."""

import dataclasses
import json
import shutil
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from docs_scripts import DOCS, load_script
from helpers.errors import refused
from helpers.protocols import domain_of
from helpers.sweeps import brief

from kitchen_suite import imports, suite
from kitchen_suite.commands import evaluate, record
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.evaluation import criteria
from kitchen_suite.evaluation.plan import Replaced, find_protocol, make_plan
from kitchen_suite.evaluation.protocols import (
    KITCHEN,
    PROTOCOLS,
    SHIFT_GROUPS,
    UNSEEN_SEED,
    Condition,
    DomainProtocols,
    Score,
    domain_protocols,
)
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies import PolicyRef
from kitchen_suite.policies.files import shipped_as
from kitchen_suite.tasks.kitchen import observation as noise
from kitchen_suite.tasks.variations.distributions import GROUPS, SPLITS

# Greatest noise of each element at a ratio of 1.
AMPLITUDES = noise.noise_scale(robot_ratio=1.0, object_ratio=1.0)

VELOCITY = {"control_mode": "joint_velocity"}
D4RL = VELOCITY | {"robot_noise_ratio": 0.1, "object_noise_ratio": 0.1}
IN_ORDER = {"tasks_in_order": True}
EXACTLY = {"robot_noise_ratio": 0.0, "object_noise_ratio": 0.0, "terminate_on_tasks_completed": False}

# Protocols with goals or many steps, whose tests take longer.
LONG = ("beso", "goal-reaching", "unseen-kitchens", "unseen-pick-and-place")

# Task and arguments of each condition, first seed, episodes, control steps, score.
LITERAL = {
    "default": ([("random_4", {"variations": ["start"]})], 400_000_000, 200, 280, None),
    "strict": ([("random_4", {"variations": ["start"], "success": "strict"})], 400_000_000, 200, 400, None),
    "clean": ([("random_4", {"variations": ["start"], "quality": True})], 400_000_000, 200, 280, None),
    # diffusion_policy/config/task/kitchen_lowdim_abs.yaml and env_runner/kitchen_lowdim_runner.py: test_start_seed,
    # n_test, max_steps, abs_action, robot_noise_ratio (which env/kitchen scales the objects' noise by as well), / 7.
    "diffusion-policy": (
        [("all", {"control_mode": "joint_position", "robot_noise_ratio": 0.1, "object_noise_ratio": 0.1})],
        100_000,
        50,
        280,
        ("score", 1.0, 7),
    ),
    "d4rl": (
        [("complete", VELOCITY), ("partial", VELOCITY), ("mixed", VELOCITY)],
        400_000_000,
        100,
        280,
        ("d4rl_score", 100.0, 4),
    ),
    # main.py:32 of seohongpark/HIQL: eval_episodes; evaluation.py of qortmdgh4141/GAS.
    "hiql": ([("partial", D4RL), ("mixed", D4RL)], 400_000_000, 50, 280, ("d4rl_score", 100.0, 4)),
    "gas": ([("partial", D4RL)], 400_000_000, 50, 280, ("d4rl_score", 100.0, 4)),
    # cfg/gym/finetune/kitchen-complete-v0/ft_ppo_diffusion_mlp.yaml of irom-princeton/dppo, lines 15 to 49.
    "dppo": (
        [("complete", D4RL), ("partial", D4RL), ("mixed", D4RL)],
        400_000_000,
        40,
        280,
        ("mean_reward", 1.0, 4),
    ),
    # d4rl/d4rl/kitchen/kitchen_envs.py of clvrai/skimo: classes of the three sequences.
    "spirl": ([("mixed", D4RL | IN_ORDER)], 400_000_000, 100, 280, ("subtasks", 4.0, 4)),
    "skild": (
        [("all", D4RL | IN_ORDER | {"tasks_to_complete": ["kettle", "bottom burner", "top burner", "slide cabinet"]})],
        400_000_000,
        100,
        280,
        ("subtasks", 4.0, 4),
    ),
    "skimo": (
        [
            (
                "all",
                D4RL
                | IN_ORDER
                | {"tasks_to_complete": ["microwave", "light switch", "slide cabinet", "hinge cabinet"]},
            )
        ],
        400_000_000,
        100,
        280,
        ("subtasks", 4.0, 4),
    ),
    "random-4": ([("random_4", VELOCITY)], 400_000_000, 1_000, 280, None),
    # beso/envs/franka_kitchen/goals.py of intuitive-robots/beso: the last two states; configs: 100 runs of ten seeds.
    "beso": ([("all", VELOCITY | {"tasks_per_episode": [1, 7], "goal_states": 2})], 400_000_000, 1_000, 280, None),
    # docs/api/world.md of stable-worldmodel: goal_offset 30, eval_budget 50.
    "goal-reaching": ([("all", VELOCITY | EXACTLY | {"goal_states": 1})], 400_000_000, 100, 50, None),
    "shift": (
        [
            ("random_4", {}),
            *(
                ("random_4", {"variations": list(groups), "variation_split": split})
                for groups in (*((group,) for group in SHIFT_GROUPS), SHIFT_GROUPS)
                for split in SPLITS
            ),
            ("random_4", {"variations": ["push"]}),
        ],
        400_000_000,
        100,
        280,
        None,
    ),
    "unseen-kitchens": (
        [
            (
                "open",
                {
                    "design": design,
                    "split": "test",
                    "certified": True,
                    "num_slots": 1,
                    "control_mode": "ee_delta_pose",
                    "physics": "fast",
                },
            )
            for design in range(100)
        ],
        400_000_000,
        4,
        280,
        None,
    ),
    "unseen-pick-and-place": (
        [
            (
                "any",
                {
                    "design": design,
                    "split": "test",
                    "certified": True,
                    "num_slots": 2,
                    "control_mode": "ee_delta_pose",
                    "physics": "fast",
                },
            )
            for design in range(100)
        ],
        400_000_000,
        4,
        500,
        None,
    ),
}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Recorded episodes of the expert, two of which complete tasks."""
    folder = tmp_path_factory.mktemp("dataset") / "runs"
    flags = ["--policy=expert", "--task_name=random_4", "--num_episodes=2", "--max_episode_steps=60"]
    assert record.main([f"--output={folder}", *flags]) == 0
    return folder


def plan(protocol="default", policy="random", dataset=None, **replaced):
    """Plans an evaluation, as `evaluate` does."""
    return make_plan(PolicyRef.parse(policy), protocol, Replaced(**replaced), dataset)


def takes_goals(protocol):
    """Whether a protocol needs a dataset."""
    return any(condition.goals for condition in protocol.conditions)


def test_the_numbers_of_the_protocols_are_the_published_ones():
    assert list(LITERAL) == list(PROTOCOLS)
    for name, protocol in PROTOCOLS.items():
        conditions, seed, episodes, steps, score = LITERAL[name]
        played = [(each.task_name or KITCHEN.task_name, each.task_kwargs) for each in protocol.conditions]
        assert played == conditions, name
        own = suite.DOMAINS[domain_of(name)].episode_steps
        numbers = (protocol.seed, protocol.num_episodes, protocol.max_episode_steps or own)
        assert numbers == (seed, episodes, steps), name
        assert type(protocol.num_episodes) is int
        assert protocol.score == (score and Score(name=score[0], best=score[1], tasks=score[2])), name


def test_shift_has_every_group_of_variations():
    assert (*SHIFT_GROUPS, "push") == GROUPS


@pytest.mark.parametrize(
    ("settings", "values"),
    [
        (PROTOCOLS["d4rl"], {"num_episodes": 1}),
        (Condition(name="none"), {"name": "all"}),
        (Score(name="score", best=1.0, tasks=7), {"name": "d4rl_score", "best": 100.0, "tasks": 4}),
        (DomainProtocols(), {"task_name": "kettle"}),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_protocol_cannot_be_changed(settings, values):
    for name, value in values.items():
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(settings, name, value)
    # Nor are values taken for others by their order.
    with pytest.raises(TypeError, match="positional"):
        type(settings)(*values.values())


@pytest.mark.full
@pytest.mark.parametrize(
    "name", brief(PROTOCOLS, [name for name in PROTOCOLS if name not in ("shift", *LONG)], full=LONG)
)
def test_a_plan_has_the_numbers_of_its_protocol(name, dataset):
    protocol = PROTOCOLS[name]
    made = plan(protocol=name, dataset=dataset if takes_goals(protocol) else None, domain_name=domain_of(name))
    assert [(spec.task_name, dict(spec.task_kwargs)) for spec in made.specs.values()] == [
        (condition.task_name or KITCHEN.task_name, condition.task_kwargs) for condition in protocol.conditions
    ]
    assert {(spec.seed, spec.max_episode_steps, spec.seeding) for spec in made.specs.values()} == {
        (protocol.seed, protocol.max_episode_steps or suite.find_domain(domain_of(name)).episode_steps, "gymnasium")
    }
    assert (made.num_episodes, made.score) == (protocol.num_episodes, protocol.score)


@pytest.mark.full
def test_diffusion_policys_episodes_are_those_of_its_code():
    (spec,) = plan(protocol="diffusion-policy").specs.values()
    environment = spec.make_environment()
    task = suite_env(environment).composer_task
    assert len(task.mdp.goals.tasks) == 7
    assert task.threshold == 0.3
    # Tasks count once, and only the last one of all ends the episode.
    assert task.mdp.remove_task_when_completed
    assert task.mdp.terminate_on_tasks_completed
    assert task.mdp.action_mode.name == "joint_position"
    np.testing.assert_array_equal(task.mdp.noise_scale, 0.1 * AMPLITUDES)
    assert suite_env(environment).environment.control_timestep() == pytest.approx(1 / 12.5)


def test_scores_over_all_conditions():
    # A third has six decimals.
    thirds = {str(number): {"goal_reached": number // 2} for number in range(3)}
    assert PROTOCOLS["goal-reaching"].overall(thirds) == {"goal_reached": 0.333333}
    assert PROTOCOLS["default"].overall(thirds) == {}


def test_the_conditions_of_shift_have_names():
    names = [condition.name for condition in PROTOCOLS["shift"].conditions]
    groups = [f"{group} {split}" for group in (*SHIFT_GROUPS, "all") for split in SPLITS]
    assert names == ["none", *groups, "push"]


@pytest.mark.clients
def test_training_never_uses_the_seeds():
    from kitchen_suite.training.run import EVALUATION_SEEDS

    assert max(UNSEEN_SEED + protocol.num_episodes for protocol in PROTOCOLS.values()) <= EVALUATION_SEEDS


@pytest.mark.parametrize("domain", suite.DOMAINS.values(), ids=lambda domain: domain.name)
def test_domains_name_protocols_that_exist_for_them(domain):
    own = {None, domain.name}
    offered = {name for name, protocol in PROTOCOLS.items() if protocol.domain_name in own}
    assert {"default", "clean", "shift"} <= offered
    assert {*domain_protocols(domain.name).protocols} <= offered
    for name in offered:
        assert find_protocol(name, domain.name) is PROTOCOLS[name]
        tasks = {
            condition.task_name or domain_protocols(domain.name).task_name or domain.default_task
            for condition in PROTOCOLS[name].conditions
        }
        assert tasks <= domain.tasks.keys()


def test_the_protocols_of_the_kitchen_are_refused_elsewhere():
    for name in (name for name, protocol in PROTOCOLS.items() if protocol.domain_name == "kitchen"):
        with refused(ValueError, f"protocol {name!r} is not for domain 'open_cabinet'", "'default'"):
            find_protocol(name, "open_cabinet")


def test_default_is_the_default_task_of_another_domain():
    made = plan(domain_name="open_cabinet")
    assert list(made.specs) == ["top_drawer"]
    assert dict(made.first.task_kwargs) == {"variations": ["start"]}
    assert (made.first.max_episode_steps, made.score) == (700, None)


@pytest.mark.full
def test_conditions_of_groups_that_a_domain_does_not_have_are_left_out():
    made = plan(protocol="shift", domain_name="kitchens")
    groups = ("start", "dynamics", "sensing", "camera")
    assert [*made.specs] == ["none", *(f"{group} {split}" for group in (*groups, "all") for split in SPLITS), "push"]
    assert made.specs["all seen"].task_kwargs["variations"] == [*groups]
    assert made.replaced == []


@pytest.mark.full
@pytest.mark.parametrize(("protocol", "kwargs"), [("default", {}), ("shift", {}), ("clean", {"quality": True})])
def test_a_domain_without_variations_is_evaluated(protocol, kwargs):
    domain = load_script("examples/my_domain").LEVER
    suite.register(domain)
    try:
        made = plan(protocol=protocol, domain_name=domain.name)
        assert [spec.task_kwargs for spec in made.specs.values()] == [kwargs]
        assert made.replaced == []
    finally:
        del suite._domains[domain.name]
        for env_id in (domain.env_id, *domain.task_ids.values()):
            gymnasium.registry.pop(env_id, None)


def test_what_is_given_replaces_the_protocols_values():
    made = plan(
        protocol="strict",
        task_name="kettle",
        seed=7,
        num_episodes=3,
        max_episode_steps=40,
        task_kwargs={
            "success": "original",
            "control_mode": "joint_position",
            "variations": ["start", "dynamics"],
            "variation_split": "held_out",
        },
    )
    assert list(made.specs) == ["kettle"]
    assert dict(made.first.task_kwargs) == {
        "variations": ["start", "dynamics"],
        "success": "original",
        "control_mode": "joint_position",
        "variation_split": "held_out",
    }
    assert (made.first.seed, made.num_episodes, made.first.max_episode_steps) == (7, 3, 40)


@pytest.mark.full
@pytest.mark.parametrize(("task", "score"), [("partial", 100.0), ("kettle", None)])
def test_one_task_replaces_all_conditions_and_keeps_the_score_of_its_own_sets(task, score):
    made = plan(protocol="d4rl", task_name=task)
    assert list(made.specs) == [task]
    assert (made.score and made.score.best) == score


@pytest.mark.full
@pytest.mark.parametrize(
    ("task_kwargs", "has_score"),
    [
        ({"tasks_to_complete": ["kettle"]}, False),
        ({"tasks_per_episode": 1}, False),
        ({"robot_noise_ratio": 0.5}, True),
    ],
)
def test_a_published_score_is_only_of_its_own_tasks(task_kwargs, has_score):
    assert (plan("d4rl", task_kwargs=task_kwargs).score is not None) == has_score


def test_arguments_in_which_conditions_differ_are_not_replaced():
    with refused(ValueError, "'shift'", "['variations']"):
        plan(protocol="shift", task_kwargs={"variations": ["start"]})


@pytest.mark.full
def test_the_expert_gets_the_poses_that_it_needs_where_layouts_vary():
    made = plan(policy="expert", task_name="kettle", task_kwargs={"variations": ["layout"]})
    assert made.first.task_kwargs["extra_observables"] == ["franka/base_pose"]
    given = plan(
        policy="expert",
        task_name="microwave",
        task_kwargs={"variations": ["layout"], "extra_observables": ["microwave/pose"]},
    )
    assert given.first.task_kwargs["extra_observables"] == ["microwave/pose", "franka/base_pose"]


@pytest.mark.full
def test_a_description_has_no_path(tmp_path):
    file = tmp_path / "own.npz"
    shutil.copyfile(shipped_as("kettle"), file)
    options = {"task_name": "kettle", "task_kwargs": {"reward": "sparse", "variations": None}}
    own = plan(policy=f"trained(file={str(file)!r})", **options)
    described = own.description
    assert str(tmp_path) not in str(described)
    assert described["policy"] == "trained"
    # The one of the package is the same file.
    assert described == plan(policy="trained", **options).description
    assert len(described["conditions"]["kettle"]["policy_sha256"]) == 64


def test_values_are_the_protocols_by_default():
    values = evaluate.COMMAND.flags()
    replaced = {name for name in values if "the protocol's" in values[name].help}
    assert replaced >= {"task_name", "control_mode", "variation_split", "seed", "num_episodes", "max_episode_steps"}
    assert all(values[name].value is None for name in replaced)


@pytest.mark.full
def test_goals_are_those_of_the_dataset(dataset):
    folder = Recording.open(dataset)
    episodes = [folder.load(index).arrays["observation/observation"][:, criteria.STATE] for index in folder.indices]
    demonstrated = plan(protocol="beso", dataset=dataset, num_episodes=8)
    for options in demonstrated.resets["goals"]:
        (index,) = (i for i, states in enumerate(episodes) if np.array_equal(states[-2:], options["goal_states"]))
        assert set(options["requested_tasks"]) == folder.load_summary(index).metrics["tasks_completed"].keys()
    reached = plan(protocol="goal-reaching", dataset=dataset, num_episodes=8)
    for options in reached.resets["goals"]:
        places = [np.flatnonzero((states == options["start_state"]).all(axis=1)) for states in episodes]
        ((index, (step,)),) = ((i, steps.tolist()) for i, steps in enumerate(places) if steps.size)
        np.testing.assert_array_equal(episodes[index][step + 30], options["goal_states"][0])
    # They depend on nothing but the seed of an episode.
    later = plan(protocol="beso", dataset=dataset, num_episodes=4, seed=UNSEEN_SEED + 4)
    assert later.resets["goals"] == demonstrated.resets["goals"][4:]
    assert len({each.description["goals_sha256"] for each in (demonstrated, reached, later)}) == 3


@pytest.mark.full
def test_recorded_actions_lead_to_the_goal(dataset):
    """From the start of a goal, which is at rest, some of the recorded actions lead to the goal."""
    folder, made = Recording.open(dataset), plan(protocol="goal-reaching", dataset=dataset, num_episodes=6)
    episodes = [folder.load(index).arrays for index in folder.indices]
    envs, reached = made.first.make_environment(), []
    for index, options in enumerate(made.resets["goals"]):
        for arrays in episodes:
            states = arrays["observation/observation"][:, criteria.STATE]
            for step in np.flatnonzero((states == options["start_state"]).all(axis=1)):
                observation, _ = envs.reset(seed=made.first.seed + index, options=options)
                rows = [
                    observation["observation"],
                    *(envs.step(a)[0]["observation"] for a in arrays["action"][step:][:30]),
                ]
                seen = np.stack(rows)[:, criteria.STATE]
                np.testing.assert_allclose(seen[0], options["start_state"], atol=1e-12)
                reached.append(criteria.goal_reached(seen, np.array(options["goal_states"])))
    assert len(reached) == 6
    assert np.mean(reached) >= 0.5


@pytest.mark.full
@pytest.mark.parametrize(
    ("settings", "shown"),
    [
        ({"protocol": "beso"}, ("'beso'", "needs a dataset")),
        ({"protocol": "default", "dataset": Path("runs")}, ("'default'", "takes no goals")),
        ({"protocol": "beso", "dataset": Path("none")}, ("none",)),
    ],
    ids=str,
)
def test_a_dataset_is_given_where_it_is_needed(settings, shown):
    with refused((ValueError, OSError), *shown):
        plan(**settings)


@pytest.mark.full
def test_states_are_measured_and_goals_taken_with_the_franka_alone(dataset, tmp_path, monkeypatch):
    # Files may name it once somebody has named it here.
    monkeypatch.syspath_prepend(DOCS / "examples")
    imports.named("my_arm:MY_ARM", "robot")
    for protocol in ("beso", "goal-reaching"):
        with refused(ValueError, repr(protocol), "'franka'", "'my_arm:MY_ARM'"):
            plan(protocol=protocol, task_kwargs={"robot": "my_arm:MY_ARM", "control_mode": "ee_delta_pose"})
    runs = Path(shutil.copytree(dataset, tmp_path / "runs"))
    specification = json.loads((runs / "recording.json").read_text())
    (runs / "recording.json").write_text(json.dumps(specification | {"task_kwargs": {"robot": "my_arm:MY_ARM"}}))
    with refused(ValueError, "runs", "'franka'", "'my_arm:MY_ARM'"):
        plan(protocol="goal-reaching", dataset=runs)


@pytest.mark.full
def test_a_dataset_without_goals_is_named(tmp_path):
    folder = tmp_path / "runs"
    assert record.main([f"--output={folder}", "--policy=zero", "--num_episodes=1", "--max_episode_steps=3"]) == 0
    for protocol in ("beso", "goal-reaching"):
        with refused(ValueError, "runs", "no episode with a goal"):
            plan(protocol=protocol, dataset=folder)
