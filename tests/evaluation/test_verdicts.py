"""The check of a receipt says what it confirms: if zero actions succeed, it refuses it, or its first line says why.

Every argument of every condition, every option of a reset, and every goal is forged, with all that follows made anew.
"""

import copy
import dataclasses
import functools
import json

import numpy as np
import pytest
from helpers.protocols import domain_of

from kitchen_suite import suite
from kitchen_suite.commands import evaluate, replay
from kitchen_suite.entities.pick_and_place import DEFAULT_DESIGN
from kitchen_suite.evaluation.evaluation import Evaluation
from kitchen_suite.evaluation.plan import EvaluationPlan, Replaced, make_plan, make_unprepared_plan
from kitchen_suite.evaluation.protocols import PROTOCOLS
from kitchen_suite.evaluation.receipt import Receipt
from kitchen_suite.evaluation.text import format_changes, format_subject
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies import PolicyRef
from kitchen_suite.tasks.kitchen.goals import INITIAL_QPOS
from kitchen_suite.versions import installed_versions

pytestmark = pytest.mark.usefixtures("folder")

ZERO = PolicyRef.parse("zero")
ARGUMENTS = sorted(suite.DOMAINS["kitchen"].arguments(suite.DOMAINS["kitchen"].env_class).keys() - {"domain"})

# What no result depends on: the observations that a policy needs.
HARMLESS = {"extra_observables"}


@functools.cache
def unprepared(name):
    """The plan of a protocol, whose goals from data are made up."""
    description = description_of(name)
    if PROTOCOLS[name].conditions[0].goals:
        return EvaluationPlan.of(description, {"goals": [reset_of(name)] * description["num_episodes"]})
    return EvaluationPlan.of(description)


def description_of(name):
    """The description of an evaluation under a protocol."""
    protocol = PROTOCOLS[name]
    conditions = {
        each.name or each.task_name or "random_4": {
            "task_name": each.task_name or "random_4",
            "task_kwargs": dict(each.task_kwargs),
            "policy_sha256": None,
        }
        for each in protocol.conditions
    }
    return {
        "protocol": name,
        "domain_name": domain_of(name),
        "policy": "zero",
        "seed": protocol.seed,
        "num_episodes": protocol.num_episodes,
        "max_episode_steps": protocol.max_episode_steps or suite.DOMAINS[domain_of(name)].episode_steps,
        "versions": installed_versions(),
        "conditions": json.loads(json.dumps(conditions)),
    }


def reset_of(name):
    goal = INITIAL_QPOS.copy()
    goal[22] = -0.75
    if name == "beso":
        return {"requested_tasks": ["microwave"], "goal_states": [goal.tolist()] * 2}
    return {"start_state": INITIAL_QPOS.tolist(), "goal_states": [goal.tolist()]}


def names(plan, name):
    """Whether the first line of the check of a plan has a name among the values replaced."""
    return any(f"{prefix}{name} " in format_subject(plan) for prefix in (" ", ": "))


# An argument of every condition that is changed in each protocol; that of others in the first one.
GIVEN = {
    **dict.fromkeys(ARGUMENTS, 10),
    **{"goals": {"kettle": [0.0] * 7}, "success": "strict", "variations": ["layout"], "physics": "fast"},
    **{"variation_split": "held_out", "control_mode": "joint_delta", "reward": "dense", "obs_type": "state"},
    **{"tasks_to_complete": ["close microwave"], "feedback": "true", "frame": "hand", "sleep": True},
    "quality": False,
    **{"design": 100, "split": "train", "certified": False, "num_slots": 2},
}


# Defaults of the kitchen's environments, and of its control mode.
DEFAULTS = {
    "physics": "exact",
    "control_mode": "joint_velocity",
    "control_timestep": 0.08,
    "velocity_scale": 2.0,
    "feedback": "observed",
    "obs_type": "goal",
    "reward": "sparse",
    "robot": "franka",
    "robot_noise_ratio": 0.01,
    "object_noise_ratio": 0.0005,
    "sleep": False,
    "variation_split": "seen",
    "quality": False,
}
DEFAULTS_OF_GENERATED = {
    "kitchens": {"design": 0, "physics": "fast"},
    "pick_and_place": {"design": DEFAULT_DESIGN, "physics": "fast"},
}


@pytest.mark.parametrize("argument", DEFAULTS)
def test_a_default_that_is_given_is_no_value_replaced(argument):
    replaced = Replaced(task_kwargs={argument: DEFAULTS[argument]})
    plan = make_unprepared_plan(ZERO, "default", replaced)
    assert plan.changes == {}
    assert plan.replaced == []
    assert format_subject(plan) == "kitchen, protocol default"


# What is given beside a protocol, and the words that say what differs from it.
WORDS = {
    "nothing varies": ("default", {"variations": []}, "variations 'none', not ['start']"),
    "none": ("default", {"variations": None}, "variations 'none', not ['start']"),
    "the protocol's groups": ("default", {"variations": "start"}, ""),
    "nothing varies in the protocol": ("d4rl", {"variations": ["start"]}, "variations ['start'], not 'none'"),
    "no groups as in the protocol": ("d4rl", {"variations": "none"}, ""),
    "physics": ("default", {"physics": "fast"}, "physics 'fast', not the default"),
    "quality of a protocol": ("clean", {"quality": False}, "quality False, not True"),
    "quality of another one": ("default", {"quality": True}, ""),
    "the default of another mode": (
        "default",
        {"control_mode": "ee_delta_pose", "angular_speed": 1.0, "linear_speed": 0.5},
        "control_mode 'ee_delta_pose', not the default; linear_speed 0.5, not the default",
    ),
    "images": (
        "default",
        {"obs_type": "pixels_agent_pos", "image_size": [128, 128], "render_quality": "high"},
        "obs_type 'pixels_agent_pos', not the default",
    ),
}


@pytest.mark.parametrize("kind", WORDS)
def test_values_replaced_are_those_that_differ_in_words_that_are_true(kind):
    protocol, task_kwargs, words = WORDS[kind]
    plan = make_unprepared_plan(ZERO, protocol, Replaced(task_kwargs=task_kwargs))
    assert format_changes(plan) == (f"values replaced: {words}" if words else "")
    assert plan.replaced == (["conditions"] if words else [])


@pytest.mark.full
@pytest.mark.parametrize("name", PROTOCOLS)
def test_every_value_that_is_not_the_protocols_is_named(name):
    plan = unprepared(name)
    assert format_subject(plan) == f"{domain_of(name)}, protocol {name}"
    first, spec = next(iter(plan.specs.items()))
    defaults = {**DEFAULTS, **DEFAULTS_OF_GENERATED.get(domain_of(name), {})}
    for argument in [*spec.task_kwargs, *(ARGUMENTS if name == "default" else ["threshold", "goals", "success"])]:
        # Quality replaces nothing where the scores are not made of it.
        if argument in (*HARMLESS, "robot") or (argument == "quality" and name != "clean"):
            continue
        value = GIVEN[argument] if spec.task_kwargs.get(argument) != GIVEN[argument] else 11
        for kwargs in (
            {**spec.task_kwargs, argument: value},
            {each: own for each, own in spec.task_kwargs.items() if each != argument},
        ):
            is_default = argument not in kwargs and spec.task_kwargs.get(argument) == defaults.get(argument)
            if kwargs != spec.task_kwargs and not is_default:
                forged = dataclasses.replace(spec, task_kwargs=kwargs)
                assert names(dataclasses.replace(plan, specs={**plan.specs, first: forged}), argument), argument
    for change in ({"seed": 1}, {"max_episode_steps": 7}):
        specs = {each: dataclasses.replace(one, **change) for each, one in plan.specs.items()}
        assert names(dataclasses.replace(plan, specs=specs), *change)
    assert names(dataclasses.replace(plan, num_episodes=1), "num_episodes")
    for argument, pair in dataclasses.replace(plan, num_episodes=1).changes.items():
        assert (argument, pair) == ("num_episodes", (1, PROTOCOLS[name].num_episodes))


@pytest.mark.full
@pytest.mark.parametrize("name", PROTOCOLS)
def test_conditions_are_the_protocols(name):
    plan = unprepared(name)
    description = description_of(name)
    first, *others = description["conditions"]
    moved = copy.deepcopy(description)
    moved["conditions"] = {"mine": moved["conditions"][first]}
    with pytest.raises(ValueError, match="'mine' is no condition"):
        EvaluationPlan.of(moved)
    if others:
        # The easiest one alone.
        assert names(dataclasses.replace(plan, specs={others[0]: plan.specs[others[0]]}), "conditions")
    spec = plan.specs[first]
    another = next(task for task in suite.DOMAINS[spec.domain_name].tasks if task != spec.task_name)
    replaced = dataclasses.replace(spec, task_name=another)
    assert names(dataclasses.replace(plan, specs={**plan.specs, first: replaced}), "task_name")


@pytest.mark.full
@pytest.mark.parametrize("name", ["beso", "goal-reaching"])
def test_resets_hold_the_goals_of_their_condition_and_nothing_else(name):
    plan = unprepared(name)
    count = plan.num_episodes
    with plan.first.make_environment() as environment:
        requests = suite_env(environment).composer_task.requests
    done = INITIAL_QPOS.copy()
    done[22] = -0.75
    values = {
        "requested_tasks": ["microwave"],
        "goal_states": [INITIAL_QPOS.tolist()] * len(reset_of(name)["goal_states"]),
        "start_state": done.tolist(),
        "task_id": 1,
        "render_goal": False,
    }
    assert {*values} == {*requests.options}
    for option in ("state", "variation_values", *requests.options):
        value = values.get(option, {})
        if option in reset_of(name):
            without = {key: each for key, each in reset_of(name).items() if key != option}
            with pytest.raises(ValueError, match="which are its goals"):
                plan.with_resets({"goals": [without] * count})
            continue
        with pytest.raises(ValueError, match="which are its goals"):
            plan.with_resets({"goals": [{**reset_of(name), option: value}] * count})
    # What is reached at the start, as far as the protocol measures goals by states.
    if name == "goal-reaching":
        for goal in (INITIAL_QPOS, INITIAL_QPOS + np.r_[np.zeros(29), 0.05]):
            with pytest.raises(ValueError, match="holds at the start"):
                plan.with_resets({"goals": [{**reset_of(name), "goal_states": [goal.tolist()]}] * count})
    receipt = Receipt(evaluation=plan.description, replaced=[], results={}, traces={})
    assert "goals_sha256" in receipt.evaluation


@pytest.mark.full
def test_a_receipt_of_zero_actions_that_succeed_says_so(run, tmp_path):
    flags = ["--policy=zero", "--num_episodes=2", "--max_episode_steps=5", "--num_envs=2"]
    easy = '--task_kwargs={"threshold": 10}'
    status, out, _ = run(evaluate, *flags, easy, "--receipt=a.npz", "--json=a.json")
    assert status == 0
    assert (
        "values replaced: num_episodes 2, not 200; max_episode_steps 5, not 280; threshold 10, not the default" in out
    )
    status, out, _ = run(replay, "a.npz", "--published=a.json")
    first, *lines = out.splitlines()
    assert status == 0
    assert "threshold 10, not the default" in first
    assert "2 of 2 successful episodes repeat one action from start to end" in first
    assert "the published result a.json is that of the receipt" in lines
    assert any("success" in line and "100.0 %" in line and " to " in line for line in lines)

    result = json.loads((tmp_path / "a.json").read_text("utf-8"))
    for forged in ({**result, "success": 0.5}, {**result, "seed": 1}, {}, [], {**result, "more": 1}):
        (tmp_path / "b.json").write_text(json.dumps(forged), encoding="utf-8")
        status, _, err = run(replay, "a.npz", "--published=b.json")
        assert (status, err.count("\n")) == (1, 1)
        assert "published result b.json is not that of the receipt" in err
    # The threshold is hidden: the scores do not follow any more.
    receipt = Receipt.read(tmp_path / "a.npz")
    evaluation = copy.deepcopy(receipt.evaluation)
    del evaluation["conditions"]["random_4"]["task_kwargs"]["threshold"]
    plan = EvaluationPlan.of(evaluation)
    anew = Evaluation(plan=plan, results=receipt.results).as_json()
    dataclasses.replace(receipt, evaluation=anew, replaced=plan.replaced).write(tmp_path / "c.npz")
    status, out, _ = run(replay, "c.npz")
    assert status == 1
    assert "threshold" not in out.splitlines()[0]


@pytest.mark.full
def test_published_results_are_those_of_receipts(run):
    assert run(replay, "nothing", "--published=x.json")[0] == 2
    assert make_plan(ZERO, replaced=Replaced(num_episodes=2)).changes == {"num_episodes": (2, 200)}


def test_constant_actions_are_counted():
    @dataclasses.dataclass
    class Some:
        success: bool = False
        measures: dict = dataclasses.field(default_factory=dict)
        actions: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((3, 2)))

    moving = np.arange(6.0).reshape(3, 2)
    each = [Some(), Some(True), Some(True, actions=moving), Some(measures={"goal_reached": True})]
    plan = unprepared("default")
    assert Evaluation(plan=plan, results={"a": each}, traces={"a": each}).constant_successes == (2, 3)
    assert Evaluation(plan=plan, results={"a": [Some()]}, traces={"a": [Some()]}).constant_successes == (0, 0)
