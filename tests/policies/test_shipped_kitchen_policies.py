"""The policies that come with the package for the kitchen's seven tasks do them, in all kinds of environments."""

import contextlib
import json

import numpy as np
import pytest
from helpers.episodes import play, successes, successes_together
from helpers.sweeps import brief
from helpers.vectors import many

from kitchen_suite import suite
from kitchen_suite.commands import play as play_command
from kitchen_suite.commands import rollout as rollout_command
from kitchen_suite.gymnasium_env import KITCHEN_ID, FrankaKitchenEnv
from kitchen_suite.policies import find, load_policy
from kitchen_suite.policies.files import SHIPPED, shipped, shipped_as
from kitchen_suite.policies.perceptron import PerceptronPolicy
from kitchen_suite.tasks import DEFAULT_TASKS

TASKS = [task.replace(" ", "_") for task in DEFAULT_TASKS]

OBJECTS = "pick_and_place_put_on_put_in_take_out_open_and_put_in"

# First of the seeds; training and its evaluations take theirs from 500,000,000 on.
UNSEEN = 30_000


def through_suite(task, count):
    with suite.load("kitchen", task, {"visuals": False}) as environment:
        return successes(environment, range(UNSEEN, UNSEEN + count), "trained")


def through_vector(task, count):
    policy = PerceptronPolicy.load(shipped_as(task))
    arguments = {"goal_format": "flat", "info_format": "arrays", **suite.task_arguments("kitchen", task)}
    with contextlib.closing(many(KITCHEN_ID, count, **arguments)) as environments:
        flatten = environments.composer_task.policy_inputs.flatten
        return successes_together(environments, lambda observations: policy(flatten(observations)), UNSEEN)


@pytest.mark.full
@pytest.mark.parametrize("task", brief(TASKS, ["kettle"]))
def test_it_does_its_task(task):
    assert through_suite(task, 3) >= 2


@pytest.mark.nightly
@pytest.mark.parametrize("play_episodes", [through_suite, through_vector])
@pytest.mark.parametrize("task", TASKS)
def test_it_does_its_task_nearly_always(play_episodes, task):
    assert play_episodes(task, 100) >= 95


def test_a_policy_comes_with_the_package_for_each_of_the_seven_tasks():
    for task in TASKS:
        policy = PerceptronPolicy.load(shipped_as(task))
        assert (policy.metadata["domain_name"], policy.metadata["task_name"]) == ("kitchen", task)
        assert policy.metadata["task_kwargs"] == {}
        assert policy.metadata["training"]["success"] >= 0.95


@pytest.mark.parametrize("task", brief(DEFAULT_TASKS, ["light switch"]))
def test_one_network_does_the_task_that_is_asked(task):
    environment = suite.load("kitchen", "random_1", {"visuals": False})
    done = 0
    for seed in range(UNSEEN, UNSEEN + 3):
        environment.task.follow(environment.task.checked_reset({"requested_tasks": [task]}))
        play(environment, find("trained"), seed)
        done += environment.task.episode_metrics["success"]
        assert environment.task.requested_tasks == [task]
    assert done >= 2


def test_the_policies_are_small():
    sizes = {path.stem: path.stat().st_size for path in SHIPPED.glob("*.npz")}
    assert sizes.pop("kitchen") < 5_000_000
    assert sizes.pop("kitchens_open") < 5_000_000
    assert sizes.pop(OBJECTS) < 5_000_000
    assert sizes.pop("pixels") < 10_000_000
    assert max(sizes.values()) < 300_000


def test_the_policy_for_objects_plays_in_the_environments_of_its_protocol():
    arguments = {"split": "test", "certified": True, "num_slots": 2, "control_mode": "ee_delta_pose", "visuals": False}
    environment = suite.load("pick_and_place", "any", {"design": 22, **arguments})
    assert shipped_as(OBJECTS).exists()
    act = find("trained")(environment, np.random.default_rng(0))
    timestep = environment.reset()
    (requested,) = np.flatnonzero(environment.task.state.requested)
    distances = [environment.task.state.hand_distances[requested]]
    for _ in range(150):
        timestep = environment.step(act(timestep))
        distances.append(environment.task.state.hand_distances[requested])
    assert min(distances) < 0.5 * distances[0]


SIGHT = {
    "obs_type": "pixels_agent_pos",
    "cameras": ["workspace", "franka/hand"],
    "image_size": [64, 64],
    "render_quality": "fast",
}


@pytest.mark.full
@pytest.mark.rendering
def test_a_policy_sees_and_does_what_is_asked(capsys):
    kwargs = {**SIGHT, "variations": ["start"]}
    flags = ["--policy=trained", "--task_name=complete", f"--task_kwargs={json.dumps(kwargs)}", f"--seed={UNSEEN}"]
    assert rollout_command.main([*flags, "--num_episodes=3"]) == 0
    assert "policy trained" in capsys.readouterr().out
    environment = FrankaKitchenEnv(["kettle"], **SIGHT)
    assert shipped(environment.composer_task) == shipped_as("pixels")
    assert shipped(FrankaKitchenEnv(["kettle"]).composer_task) == shipped_as("kettle")
    # Without one of its cameras it cannot act.
    environment = FrankaKitchenEnv(["kettle"], **{**SIGHT, "cameras": ["workspace"]})
    assert shipped(environment.composer_task) == shipped_as("kettle")


def completed_share(task, count, **arguments):
    """Returns the share of the tasks asked that the policy of the whole kitchen completes."""
    path = shipped_as("kitchen")
    layout = (
        {"extra_observables": [*load_policy(path).given.extra_observables]}
        if "layout" in arguments["variations"]
        else {}
    )
    build = find(f"trained(file={str(path)!r})")
    completed, asked = 0, 0
    with suite.load("kitchen", task, {"visuals": False, "time_limit": 22.4, **layout, **arguments}) as environment:
        for seed in range(UNSEEN, UNSEEN + count):
            play(environment, build, seed)
            completed += len(environment.task.episode_metrics["tasks_completed"])
            asked += len(environment.task.requested_tasks)
    return completed / asked


CASES = [("all", ""), ("all", "start"), ("random_4", "start"), ("complete", "layout"), ("kettle", "start")]


@pytest.mark.full
@pytest.mark.parametrize(("task", "variations"), brief(CASES, CASES[:2], full=CASES[2:4]))
def test_one_policy_does_what_is_asked_in_the_whole_kitchen(task, variations):
    assert completed_share(task, 2, variations=[variations] if variations else []) > 0.8


# In moved kitchens it is for the exact physics; docs/experiments/imitation.md has its success in both.
NEARLY_ALL = [(task, variations, "exact") for task, variations in CASES]
NEARLY_ALL += [(task, variations, "fast") for task, variations in CASES if variations != "layout"]


@pytest.mark.nightly
@pytest.mark.parametrize(("task", "variations", "physics"), NEARLY_ALL)
def test_it_does_nearly_all_that_is_asked(task, variations, physics):
    varied = [variations] if variations else []
    assert completed_share(task, 50, variations=varied, physics=physics) >= 0.95


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("task", "arguments", "least"),
    [
        ("complete", {"variations": ["layout"], "variation_split": "held_out"}, 0.5),
        ("random_4", {"variations": ["start"], "variation_split": "held_out"}, 0.8),
        # 0.91 in the results; four fifths of what it does undisturbed are asked, whatever a processor's rounding.
        ("random_4", {"variations": ["push"]}, 0.8),
    ],
)
def test_it_goes_on_where_it_has_not_been(task, arguments, least):
    assert completed_share(task, 50, **arguments) >= least


def test_all_policies_are_listed_with_their_success_and_size(capsys):
    assert play_command.main(["--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    paths = sorted(SHIPPED.glob("*.npz"))
    assert [line.split()[0] for line in lines[2:]] == [path.stem for path in paths]
    for line, path in zip(lines[2:], paths, strict=True):
        metadata = load_policy(path).metadata
        assert f"{metadata['domain_name']} {metadata['task_name']}" in line
        assert f"{metadata['training']['success']:.0%}" in line
        assert line.endswith(f" {path.stat().st_size / 1024:.0f} KiB")
