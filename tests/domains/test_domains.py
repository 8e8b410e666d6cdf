"""A domain of a user's own is known everywhere, and no module branches on a domain of which it is not part."""

import ast
import contextlib
import dataclasses
import functools
import pickle
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from helpers.errors import refused
from helpers.modules import modules

from kitchen_suite import environment_classes, gymnasium_env, kitchen_tasks, suite
from kitchen_suite.commands import rollout
from kitchen_suite.entities import build_kitchen_scene, build_microwave_table_scene
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.gymnasium_env import FrankaMicrowaveTableEnv, SuiteEnv
from kitchen_suite.policies import experts
from kitchen_suite.tasks import GOALS, KitchenTask, MicrowaveTableTask
from kitchen_suite.training.recipes import Recipe, find_recipe
from kitchen_suite.vector_env import FrankaMicrowaveTableVectorEnv, SuiteVectorEnv

# A record over the kitchen's classes, one of whose tasks has the name of one of the kitchen's.
OWN = dataclasses.replace(
    suite.DOMAINS["kitchen"],
    name="pantry",
    tasks={"kettle": {"tasks_to_complete": ("kettle",)}, "open_all": {"tasks_to_complete": ("microwave", "kettle")}},
    env_id="Mine/Pantry-v3",
    task_id="",
    benchmark_tasks=("open_all",),
    training=f"{__name__}:RECIPE",
    evaluation=None,
)
RECIPE = Recipe(hyperparameters={"num_envs": 5})
IDS = {"Mine/Pantry-v3", "Mine/PantryKettle-v3", "Mine/PantryOpenAll-v3"}


@pytest.fixture
def registered():
    """The suite with the domain above; without it again after the test."""
    suite.register(OWN)
    yield
    del suite._domains[OWN.name]
    for env_id in IDS:
        del gymnasium.registry[env_id]


@pytest.mark.full
@pytest.mark.usefixtures("registered")
def test_a_registered_domain_is_in_every_table():
    assert suite.TASKS_BY_DOMAIN["pantry"] == ("kettle", "open_all")
    assert ("pantry", "kettle") in suite.ALL_TASKS
    assert ("pantry", "open_all") in suite.BENCHMARKING
    assert suite.default_task("pantry") == "open_all"
    assert gymnasium_env.IDS["pantry"] == "Mine/Pantry-v3"
    assert gymnasium_env.TASK_IDS["pantry", "open_all"] == "Mine/PantryOpenAll-v3"
    assert gymnasium.registry.keys() >= IDS
    assert find_recipe("pantry") is RECIPE


@pytest.mark.full
@pytest.mark.usefixtures("registered")
def test_a_registered_domain_is_played_everywhere(capsys):
    environment = suite.load("pantry", "kettle", {"visuals": False, "random": 0})
    assert environment.task.tasks_to_complete == ["kettle"]
    single, many = gymnasium.make("Mine/PantryKettle-v3"), gymnasium.make_vec("Mine/PantryKettle-v3", 2)
    one, other = single.reset(seed=1)[0], many.reset(seed=0)[0]
    np.testing.assert_array_equal(other["observation"][1], one["observation"])
    assert rollout.main(["--domain_name=pantry", "--task_name=kettle", "--max_episode_steps=3"]) == 0
    assert capsys.readouterr().out.startswith("pantry kettle, policy random")


class GentleTask(MicrowaveTableTask):
    """A user's task; another reset makes it one."""

    def reset_physics(self, physics, random_state):
        super().reset_physics(physics, random_state)
        physics.bind(self.scene.joints("microwave")).qpos = -0.1


class DoubledTask(MicrowaveTableTask):
    """A task that shows another observation than its MDP computes."""

    def __init__(self, scene, **options):
        super().__init__(scene, **options)
        self.observed["door_position"].corruptor = lambda value, random_state: value + 1


class HalfTask(KitchenTask):
    """A user's task in the kitchen."""


def half_scene():
    return build_kitchen_scene(visuals=False)


@contextlib.contextmanager
def registering(name, **attributes):
    domain = suite.Domain(name, env_id=f"Mine/{name.title()}-v1", episode_steps=9, **attributes)
    suite.register(domain)
    yield
    del suite._domains[name]
    for env_id in {domain.env_id, *domain.task_ids.values()}:
        del gymnasium.registry[env_id]


@pytest.mark.full
@pytest.mark.parametrize("name", suite.DOMAINS)
def test_a_class_of_a_users_own_is_represented_by_its_own_name(name):
    domain = suite.find_domain(name)
    own = type("TaskOfAUser", (domain.resolve("task"),), {})
    environment = dataclasses.replace(domain, task=own).load(**domain.tasks[domain.default_task], visuals=False)
    assert repr(environment.task).startswith("TaskOfAUser(")
    assert "TaskOfAUser(" in repr(environment)


@pytest.mark.full
def test_a_domain_needs_six_fields():
    fields = {"scene": build_microwave_table_scene, "task": GentleTask, "tasks": {"open": {}}}
    with registering("gentle", **fields):
        env = gymnasium.make("Mine/Gentle-v1", variations="start", max_episode_steps=3)
        assert isinstance(env.unwrapped, FrankaMicrowaveTableEnv)
        assert isinstance(env.unwrapped.composer_task, GentleTask)
        told = gymnasium.make("Mine/GentleOpen-v1", instructions=True)
        assert told.reset(seed=0)[1]["instruction"] == told.unwrapped.instruction == "open the microwave door"
        many = gymnasium.make_vec("Mine/GentleOpen-v1", 2, variations="start")
        one, other = env.reset(seed=1)[0], many.reset(seed=0)[0]
        np.testing.assert_array_equal(other[1], one)
        twin = pickle.loads(pickle.dumps(env.unwrapped))
        action = np.full(8, 0.1)
        np.testing.assert_array_equal(twin.step(action)[0], env.unwrapped.step(action)[0])
        assert suite.load("gentle", "open", {"time_limit": None, "random": 0}).step_limit == np.inf
        assert rollout.main(["--domain_name=gentle", "--num_episodes=1", "--max_episode_steps=3"]) == 0


@pytest.mark.full
def test_the_environment_classes_of_a_task_are_inherited_and_its_domain_may_name_others():
    fields = {"scene": build_microwave_table_scene, "task": GentleTask, "tasks": {"open": {}}}
    general = environment_classes.ANY_ENVIRONMENT
    with registering("gentle", **fields, env=general.single, vector_env=general.vector):
        env = gymnasium.make("Mine/Gentle-v1")
        assert type(env.unwrapped) is SuiteEnv
        assert isinstance(env.unwrapped.composer_task, GentleTask)
    own = type("PlainTask", (GentleTask,), {"environment_classes": general})
    plain, gentle = (
        suite.Domain("plain", env_id="Mine/Plain-v1", episode_steps=9, **{**fields, "task": task})
        for task in (own, GentleTask)
    )
    assert (plain.env_class, plain.vector_env_class) == (SuiteEnv, SuiteVectorEnv)
    assert (gentle.env_class, gentle.vector_env_class) == (FrankaMicrowaveTableEnv, FrankaMicrowaveTableVectorEnv)


@pytest.mark.parametrize("name", suite.DOMAINS)
def test_a_domain_of_the_suite_has_the_classes_of_its_task(name):
    domain = suite.DOMAINS[name]
    assert (domain.env, domain.vector_env) == domain.resolve("task").environment_classes
    assert domain.env_class.default_domain == name


@pytest.mark.full
def test_a_kitchen_of_a_users_has_its_goals_and_its_state_alone():
    tasks = {"half": {"tasks_to_complete": ("kettle", "microwave"), "reward": "dense"}}
    with registering("half", scene=half_scene, task=HalfTask, tasks=tasks):
        # The only task of the domain.
        env = gymnasium.make("Mine/Half-v1")
        observation, _ = env.reset(seed=0)
        assert observation["observation"].shape == (59,)
        assert list(observation["desired_goal"]) == ["kettle", "microwave"]
        assert env.unwrapped.composer_task.reward_name == "dense"


@pytest.mark.full
def test_an_argument_that_neither_scene_nor_task_has_is_refused():
    with registering("half", scene=half_scene, task=HalfTask, tasks={"half": {}}):
        with pytest.raises(TypeError, match="unexpected argument 'sleep'; choose from"):
            suite.load("half", "half", {"sleep": True})
        with pytest.raises(TypeError, match="unexpected keyword argument 'sleeps'"):
            gymnasium.make("Mine/Half-v1", sleeps=True)


@pytest.mark.full
def test_environments_that_differ_are_refused_and_nothing_changes():
    fields = {"scene": build_microwave_table_scene, "task": DoubledTask, "tasks": {"open": {}}}
    known, ids = set(suite.DOMAINS), set(gymnasium.registry)
    message = r"observation.* at a reset of Mine/MoreOpen-v1 is .* in the single environment and .* in dm_env's one"
    with pytest.raises(ValueError, match=message), registering("more", **fields):
        pass
    assert (set(suite.DOMAINS), set(gymnasium.registry)) == (known, ids)


def test_the_suite_is_as_before_once_the_domain_is_gone():
    assert "pantry" not in suite.TASKS_BY_DOMAIN
    assert not gymnasium.registry.keys() & IDS
    assert {name for name, _ in suite.ALL_TASKS} == set(suite.DOMAINS)


@pytest.mark.parametrize(
    ("changes", "shown"),
    [
        ({"name": "kitchen"}, ["'kitchen'"]),
        ({"env_id": "KitchenSuite/FrankaKitchen-v1"}, ["['KitchenSuite/FrankaKitchen-v1']"]),
        ({"task_id": "KitchenSuite/{}-v1"}, ["['KitchenSuite/Kettle-v1']"]),
    ],
)
def test_a_name_or_id_that_is_taken_is_refused_and_nothing_changes(changes, shown):
    known, ids = set(suite.DOMAINS), set(gymnasium.registry)
    with refused(ValueError, *shown):
        suite.register(dataclasses.replace(OWN, **changes))
    assert (set(suite.DOMAINS), set(gymnasium.registry)) == (known, ids)


def test_only_records_are_registered():
    with refused(TypeError, "domain", "'kitchen'"):
        suite.register("kitchen")


@pytest.mark.parametrize(
    ("changes", "error", "shown"),
    [
        ({"name": "My Pantry"}, ValueError, ["'My Pantry'"]),
        ({"name": 3}, TypeError, ["name of a domain", "3"]),
        ({"scene": 3}, TypeError, ["3"]),
        ({"task": "kitchen"}, ValueError, ["'kitchen'"]),
        ({"tasks": {}}, ValueError, ["'pantry'"]),
        ({"tasks": ["kettle"]}, TypeError, ["tasks"]),
        ({"tasks": {"open-all": {}}, "benchmark_tasks": ()}, ValueError, ["'open-all'"]),
        ({"env_id": "Pantry"}, ValueError, ["'Pantry'"]),
        ({"env_id": 5}, TypeError, ["id of an environment", "5"]),
        ({"task_id": 7}, TypeError, ["task_id", "7"]),
        ({"physics": "slow"}, ValueError, ["physics", "'slow'", "'fast'"]),
        ({"task_id": "Mine/Task-v1"}, ValueError, ["an id of its own"]),
        ({"task_id": "Mine/{}"}, ValueError, ["'Mine/Kettle'"]),
        ({"env": "pantry"}, ValueError, ["'pantry'"]),
        ({"expert": 3}, TypeError, ["expert", "3"]),
        ({"episode_steps": 0}, ValueError, ["episode_steps", "1"]),
        ({"measures": ["objects_dropped"]}, TypeError, ["measures", "objects_dropped"]),
        ({"measures": {"objects_dropped": "0"}}, TypeError, ["measures['objects_dropped']", "'0'"]),
        ({"benchmark_tasks": ("kettles",)}, ValueError, ["'kettle'"]),
    ],
)
def test_a_bad_record_is_refused(changes, error, shown):
    with refused(error, *shown) as raised:
        dataclasses.replace(OWN, **changes)
    assert "\n" not in str(raised.value)


@pytest.mark.torch
def test_a_domain_without_hyperparameters_trains_on_the_range_of_its_actions():
    from kitchen_suite.training.ppo import PPOHyperparameters

    for domain, scale in (("kitchen", (1.0,) * 9), ("microwave_table", (*(0.01,) * 7, 2.0))):
        task = suite.load(domain, suite.default_task(domain), {"visuals": False}).task
        spec = task.mdp.action_mode.spec(task.robot)
        assert PPOHyperparameters().for_actions(spec).action_scale == scale
        assert PPOHyperparameters(action_scale=(0.5,)).for_actions(spec).action_scale == (0.5,)


def test_a_task_outside_the_suite_has_no_expert():
    with refused(ValueError, "open_cabinet"):
        experts.make(object())


# A module is a domain's own where a part of its name has the domain's in it.
def is_own(module):
    return any(name in module for name in suite.DOMAINS)


@functools.cache
def own_classes():
    """Names of all classes that are a domain's own."""
    trees = [tree for module, tree in modules().items() if is_own(module)]
    return {node.name for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}


def names_a_domain(node):
    return any(isinstance(part, ast.Constant) and part.value in tuple(suite.DOMAINS) for part in ast.walk(node))


def names_a_class_of_a_domain(node):
    names = {part.id for part in ast.walk(node) if isinstance(part, ast.Name)}
    return (names | {part.attr for part in ast.walk(node) if isinstance(part, ast.Attribute)}) & own_classes()


def branches(tree):
    """Comparisons, cases and tables by a domain's name, and tests for a class of a domain; the lines they stand in."""
    for node in ast.walk(tree):
        match node:
            case ast.Compare() | ast.MatchValue() if names_a_domain(node):
                yield node.lineno
            case ast.Dict(keys=keys) if any(key and names_a_domain(key) for key in keys):
                yield node.lineno
            case ast.Call(func=ast.Name(id="isinstance" | "issubclass" | "type")) | ast.Compare() | ast.MatchClass():
                if names_a_class_of_a_domain(node):
                    yield node.lineno


def test_the_search_finds_branches():
    found = [*branches(ast.parse("if domain == 'kitchen': pass\nisinstance(task, KitchenTask)\n{'open_cabinet': 1}"))]
    assert sorted(found) == [1, 2, 3]


def test_no_module_branches_on_a_domain_of_which_it_is_not_part():
    lines = {module: [*branches(tree)] for module, tree in modules().items() if not is_own(module)}
    assert {module: found for module, found in lines.items() if found} == {}


def test_every_name_of_a_task_has_a_goal():
    assert (*kitchen_tasks.DEFAULT_TASKS, *kitchen_tasks.FURTHER_TASKS) == tuple(GOALS)


@pytest.mark.parametrize(
    ("kwargs", "shown"),
    [
        ({}, "kitchen 0 of train, fast physics, variations none"),
        ({"design": 7, "split": "test", "physics": "exact"}, "kitchen 7 of test, variations none"),
        ({"design": {"placed": []}}, "a custom kitchen, fast physics, variations none"),
    ],
)
def test_headings_name_the_generated_kitchen(kwargs, shown):
    assert EnvironmentSpec.make("kitchens", "open", kwargs).circumstances == shown


GENERIC = """
import dataclasses
import importlib
import gymnasium
from kitchen_suite import suite
from kitchen_suite.domains import microwave_table
from kitchen_suite.environment_classes import ANY_ENVIRONMENT

classes = {"env": ANY_ENVIRONMENT.single, "vector_env": ANY_ENVIRONMENT.vector}
domain = dataclasses.replace(microwave_table.MICROWAVE_TABLE, **classes)
microwave_table.MICROWAVE_TABLE = domain
for env_id in (domain.env_id, *domain.task_ids.values()):
    gymnasium.registry.pop(env_id, None)
importlib.reload(suite)
single = gymnasium.make(domain.env_id)
many = gymnasium.make_vec(domain.env_id, num_envs=1)
assert (single.reset(seed=0)[0] == many.reset(seed=0)[0][0]).all()
print(type(single.unwrapped).__name__, type(many).__name__)
"""


@pytest.mark.full
def test_a_domain_of_the_suite_needs_no_environments_of_its_own():
    process = subprocess.run([sys.executable, "-c", GENERIC], capture_output=True, text=True, check=True)
    assert process.stdout == "SuiteEnv SuiteVectorEnv\n"
