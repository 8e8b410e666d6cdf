"""A state is refused by an environment with another scene or other arguments, which the error names."""

import copy
import dataclasses
import json
import os
import pickle
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from dm_control import mjcf
from helpers.errors import refused

from kitchen_suite import suite
from kitchen_suite.entities import build_kitchen_scene, build_microwave_table_scene
from kitchen_suite.entities.cabinet import CabinetConfig
from kitchen_suite.environment import Environment
from kitchen_suite.environment.digests import digest, scene_digest
from kitchen_suite.suite import DOMAINS
from kitchen_suite.tasks import KitchenTask, MicrowaveTableTask


def load(domain, **task_kwargs):
    options = {"visuals": False, "random": 3, **task_kwargs}
    environment = suite.load(domain, suite.default_task(domain), options)
    environment.reset()
    return environment


def assert_refused(environment, state, *names):
    """The environment refuses the state by an error with some names, and stays as it is."""
    before = environment.get_state()
    with refused(ValueError, "another environment", *names):
        environment.set_state(state)
    np.testing.assert_equal(environment.get_state(), before)


@pytest.fixture(scope="module")
def kitchen_state():
    return load("kitchen").get_state()


@pytest.mark.parametrize("size", ["panel", "worktop", "drawer_front_height", "drawer_travel"])
def test_the_state_of_another_cabinet_is_refused(size):
    built = CabinetConfig()
    other = dataclasses.replace(built, **{size: 1.02 * getattr(built, size)})
    assert_refused(load("open_cabinet", cabinet_config=other), load("open_cabinet").get_state(), "cabinet_config")


OTHERS = [
    ("kitchen", {"threshold": 0.25}, "threshold"),
    ("kitchen", {"threshold": {"kettle": 0.29}}, "threshold"),
    ("kitchen", {"success": "strict"}, "success"),
    ("kitchen", {"velocity_scale": 2.04}, "velocity_scale"),
    ("kitchen", {"feedback": "target"}, "feedback"),
    ("kitchen", {"control_mode": "joint_position"}, "control_mode"),
    ("kitchen", {"robot_noise_ratio": 0.0102}, "robot_noise_ratio"),
    ("kitchen", {"object_noise_ratio": 0.0}, "object_noise_ratio"),
    ("kitchen", {"goals": {"kettle": [-0.23, 0.76, 1.62, 0.99, 0.0, 0.0, -0.06]}}, "goals"),
    ("kitchen", {"remove_task_when_completed": False}, "remove_task_when_completed"),
    ("kitchen", {"terminate_on_tasks_completed": False}, "terminate_on_tasks_completed"),
    ("kitchen", {"tasks_in_order": True}, "tasks_in_order"),
    ("kitchen", {"max_task_steps": 50}, "max_task_steps"),
    ("kitchen", {"reward": "dense"}, "reward"),
    ("kitchen", {"variations": "start"}, "variations"),
    ("open_cabinet", {"reward": "grasp"}, "reward"),
    ("open_cabinet", {"observation_noise": {"joint_positions": 0.01}}, "observation_noise"),
    ("open_cabinet", {"gripper": "deterministic"}, "gripper"),
    ("microwave_table", {"threshold": 0.306}, "threshold"),
    ("kitchens", {"object_noise_ratio": 0.0102}, "object_noise_ratio"),
    ("kitchens", {"tasks_per_episode": 2}, "tasks_per_episode"),
    ("kitchens", {"design": 1}, "design"),
    ("pick_and_place", {"object_noise_ratio": 0.0102}, "object_noise_ratio"),
    ("pick_and_place", {"tasks_per_episode": 2}, "tasks_per_episode"),
    ("pick_and_place", {"design": 7}, "design"),
]


@pytest.mark.full
@pytest.mark.parametrize(("domain", "arguments", "name"), OTHERS)
def test_the_state_of_an_environment_with_other_arguments_is_refused(domain, arguments, name):
    assert_refused(load(domain, **arguments), load(domain).get_state(), name)


@pytest.mark.full
def test_the_state_of_another_split_or_distribution_is_refused():
    state = load("kitchen", variations="start,layout").get_state()
    assert_refused(load("kitchen", variations="start,layout", variation_split="held_out"), state, "variation_split")
    narrow, wide = ({"kettle/mass": {"uniform": [0.5, high]}} for high in (0.6, 0.7))
    assert_refused(load("kitchen", variations=wide), load("kitchen", variations=narrow).get_state(), "variations")


@pytest.mark.full
@pytest.mark.filterwarnings("ignore:The `n_sub_steps`:DeprecationWarning")
def test_the_state_of_another_number_of_physics_steps_is_refused(kitchen_state):
    other = suite.load("kitchen", "complete", {"visuals": False}, {"n_sub_steps": 20})
    assert_refused(other, kitchen_state, "n_sub_steps")


SAME = [
    {"threshold": 0.3},
    {"threshold": dict.fromkeys(("kettle", "microwave"), np.float64(0.3))},
    {"success": "original"},
    {"velocity_scale": 2},
    {"control_mode": "joint_velocity", "feedback": "observed"},
    {"terminate_on_tasks_completed": True},
    {"variations": []},
    {"physics": "exact", "control_timestep": 0.08},
    {"time_limit": None},
    {"visuals": True, "render_quality": "fast"},
    {"visuals": True, "cameras": ["overview"], "depth": True},
    {"extra_observables": ["franka/end_effector_pose"]},
    {"sleep": False, "robot": "franka"},
]


# States of 1.0 were taken there as well.
@pytest.mark.full
@pytest.mark.parametrize("arguments", SAME, ids=str)
def test_a_state_is_taken_however_the_same_arguments_are_written(arguments, kitchen_state):
    environment = load("kitchen", **arguments)
    environment.set_state(kitchen_state)
    np.testing.assert_array_equal(environment.get_state()["physics"], kitchen_state["physics"])


@pytest.mark.full
def test_the_names_of_groups_may_be_written_in_any_way_and_order():
    state = load("kitchen", variations="start,layout").get_state()
    load("kitchen", variations=["layout", "start"]).set_state(state)


@pytest.mark.full
def test_the_default_cabinet_may_be_given():
    load("open_cabinet", cabinet_config=CabinetConfig()).set_state(load("open_cabinet").get_state())


def test_the_environment_that_the_error_names_takes_the_state():
    state = load("microwave_table", threshold=0.25).get_state()
    assert_refused(load("microwave_table"), state, "threshold", "built with the same arguments")
    load("microwave_table", threshold=0.25).set_state(state)


def test_a_state_of_1_0_which_has_no_digests_is_taken():
    environment = load("open_cabinet")
    state = {name: part for name, part in environment.get_state().items() if name != "digests"}
    environment.step(np.zeros(8))
    environment.set_state(state)
    np.testing.assert_array_equal(environment.get_state()["physics"], state["physics"])


@pytest.mark.parametrize(("digests", "error"), [(3, TypeError), ({}, ValueError), ({"scene": 3}, ValueError)])
def test_digests_that_are_none_are_refused(digests, error):
    environment = load("open_cabinet")
    with refused(error, "digests" if error is TypeError else "scene"):
        environment.set_state({**environment.get_state(), "digests": digests})


# The front ends pass different defaults on.
@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_all_front_ends_have_the_same_digests_with_and_without_pictures(domain):
    record = DOMAINS[domain]
    env_id, expected = record.task_ids[record.default_task], load(domain).get_state()["digests"]
    assert {"scene", "task", "control_mode"} <= expected.keys()
    for options in ({}, {"render_mode": "rgb_array"}, {"obs_type": "pixels"}, {"quality": True}):
        env = gymnasium.make(env_id, **options)
        env.reset(seed=0)
        assert env.unwrapped.get_state()["digests"] == expected, options
        env.close()
    envs = gymnasium.make_vec(env_id, 2, vectorization_mode="vector_entry_point", num_threads=1)
    envs.reset(seed=0)
    assert envs.template_env.get_state()["digests"] == expected
    envs.close()


def test_a_gymnasium_environment_refuses_the_state_of_another_at_a_reset():
    one, other = (gymnasium.make(DOMAINS["microwave_table"].env_id, threshold=each) for each in (0.3, 0.25))
    one.reset(seed=0)
    other.reset(seed=0)
    with refused(ValueError, "another environment", "threshold"):
        other.reset(options={"state": one.unwrapped.get_state()})
    copy.deepcopy(one).reset(options={"state": pickle.loads(pickle.dumps(one.unwrapped.get_state()))})


PRINTS = """
import json
from kitchen_suite import suite
built = [suite.load(name, suite.default_task(name), {"visuals": False}) for name in %r]
print(json.dumps([environment.get_state()["digests"] for environment in built]))
"""


@pytest.mark.full
def test_digests_are_the_same_in_every_process():
    names = [*DOMAINS]
    found = []
    for seed in ("1", "2"):
        environ = {**os.environ, "PYTHONHASHSEED": seed}
        done = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", PRINTS % names],
            capture_output=True,
            text=True,
            check=True,
            env=environ,
        )
        found.append(json.loads(done.stdout))
    assert found == [[load(name).get_state()["digests"] for name in names]] * 2


def shelf(height, mesh_scale=1.0):
    """A scene of MJCF alone, with a shelf at a height [m]."""
    root = mjcf.RootElement(model="shelf")
    root.worldbody.add("geom", name="board", type="box", size=(0.3, 0.2, 0.01 * mesh_scale), pos=(0, 0, height))
    return root


def test_the_last_digits_of_a_scene_do_not_count():
    assert 0.1 + 0.2 != 0.3
    assert scene_digest(shelf(0.1 + 0.2)) == scene_digest(shelf(0.3))
    assert scene_digest(shelf(6.1e-17)) == scene_digest(shelf(-0.0)) == scene_digest(shelf(0.0))
    assert scene_digest(shelf(0.3)) != scene_digest(shelf(0.300001))
    assert scene_digest(shelf(0.3)) != scene_digest(shelf(0.3, 1.02))


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ([1, 2], (1.0, np.float32(2))),
        (np.array([0.3, 0.1]), [0.1 + 0.2, 0.1]),
        ({"a": 1, "b": True}, {"b": np.bool_(True), "a": 1.0}),
        ({"a", "b", "c"}, frozenset("cba")),
        (range(3), [0, 1, 2]),
        (-0.0, 0),
        (CabinetConfig(), dataclasses.replace(CabinetConfig())),
        (object(), object()),
    ],
)
def test_equal_arguments_have_equal_digests(one, other):
    assert digest(one) == digest(other)


@pytest.mark.parametrize(
    ("one", "other"),
    [(1, True), (None, "None"), ("1", 1.5), ([1, 2], [2, 1]), ({"a": 1}, {"a": 2}), (2**80, 2**80 + 1), (0, None)],
)
def test_other_arguments_have_other_digests(one, other):
    assert digest(one) != digest(other)


class BonusTask(MicrowaveTableTask):
    """A user's task with an argument of its own, which no part of the state has."""

    def __init__(self, scene, *, bonus=1.0, **options):
        super().__init__(scene, **options)
        self.bonus = bonus


def build_marked_scene(elevation=0.5, *, visuals=True):
    """A user's scene, with a bump on the floor at an elevation [m]."""
    scene = build_microwave_table_scene(visuals=visuals)
    scene.arena.mjcf_model.worldbody.add("geom", name="bump", size=(0.05,), pos=(2.0, 0.0, elevation))
    return scene


BONUS = suite.Domain(
    "bonus",
    scene=build_marked_scene,
    task=BonusTask,
    tasks={"open": {}},
    env_id="Mine/DigestBonus-v1",
    episode_steps=5,
)


def test_arguments_of_a_users_domain_count_as_well():
    def make(**arguments):
        return BONUS.load(visuals=False, random=0, **arguments)

    state = make().get_state()
    assert_refused(make(bonus=1.02), state, "bonus")
    assert_refused(make(elevation=0.51), state, "scene", "elevation")
    make(bonus=1, elevation=np.float64(0.5)).set_state(state)


@pytest.mark.full
def test_environments_built_from_tasks_tell_states_apart():
    def make(**options):
        environment = Environment(KitchenTask(build_kitchen_scene(visuals=False), **options), random_state=0)
        environment.reset()
        return environment

    state = make().get_state()
    assert_refused(make(threshold=0.25), state, "threshold")
    make(threshold=0.3).set_state(state)
    # As built by name, whose scene and arguments are the same.
    seven = suite.load("kitchen", "all", {"visuals": True})
    seven.set_state(state)


@pytest.mark.full
def test_the_state_of_a_scene_that_was_edited_since_is_refused():
    environment = load("kitchen")
    state = environment.get_state()
    environment.task.root_entity.mjcf_model.option.gravity = (0.0, 0.0, -9.0)
    environment.reset()
    assert_refused(environment, state, "scene")
