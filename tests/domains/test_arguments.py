"""Arguments reach the part that takes them; those of other ways of building environments are refused with the way."""

import itertools
import json

import dm_env
import gymnasium
import numpy as np
import pytest
from dm_control import mujoco
from dm_env import specs
from helpers.errors import refused

from kitchen_suite import signatures, suite
from kitchen_suite.commands import rollout
from kitchen_suite.entities import build_microwave_table_scene
from kitchen_suite.suite import DOMAINS
from kitchen_suite.tasks import MicrowaveTableTask


def of_gymnasium(domain):
    return domain.arguments(domain.env_class).keys()


def of_load(domain):
    return domain.arguments().keys()


def of_vectors(domain):
    return domain.arguments(domain.vector_env_class, domain.env_class).keys()


def load(domain, **task_kwargs):
    return suite.load(domain, suite.default_task(domain), {"visuals": False, **task_kwargs})


class BonusTask(MicrowaveTableTask):
    """A user's task with two arguments of its own, one of them without a default."""

    def __init__(self, scene, bonus, *, malus=0.0, **options):
        super().__init__(scene, **options)
        self.bonus, self.malus = bonus, malus


def build_marked_scene(elevation=0.0, *, visuals=True):
    """Builds a user's scene, with a mark at an elevation [m]."""
    scene = build_microwave_table_scene(visuals=visuals)
    scene.arena.mjcf_model.worldbody.add("site", name="mark", pos=(0.0, 0.0, elevation))
    return scene


BONUS = suite.Domain(
    "bonus",
    scene=build_marked_scene,
    task=BonusTask,
    tasks={"open": {"bonus": 1.0}},
    env_id="Mine/Bonus-v1",
    episode_steps=2,
)


@pytest.fixture(scope="module")
def bonus():
    """The suite with a user's domain; without it again after the tests."""
    suite.register(BONUS)
    yield BONUS
    del suite._domains[BONUS.name]
    for env_id in {BONUS.env_id, *BONUS.task_ids.values()}:
        del gymnasium.registry[env_id]


@pytest.mark.full
def test_arguments_of_a_users_scene_and_task_reach_them_from_every_front_end(bonus, capsys):
    own = {"malus": 0.5, "elevation": 2.0, "gripper": "sampled"}
    loaded = suite.load("bonus", "open", own).task
    single = gymnasium.make("Mine/BonusOpen-v1", **own)
    many = gymnasium.make_vec("Mine/BonusOpen-v1", 2, num_threads=1, **own)
    for task in (loaded, single.unwrapped.composer_task, many.unwrapped.composer_task):
        assert (task.bonus, task.malus) == (1.0, 0.5)
        assert task.scene.arena.mjcf_model.find("site", "mark").pos[2] == 2.0
        assert task.mdp.action_mode.settings == {"gripper": "sampled"}
    single.close()
    many.close()
    flags = ["--domain_name=bonus", "--num_episodes=1"]
    assert rollout.main([*flags, f"--task_kwargs={json.dumps(own)}"]) == 0
    capsys.readouterr()
    assert rollout.main([*flags, '--task_kwargs={"maluss": 1}']) == 2
    assert "did you mean 'malus'?" in capsys.readouterr().err


def test_an_argument_belongs_to_the_part_that_takes_it_and_has_the_outermost_default(bonus):
    found = BONUS.arguments(DOMAINS["microwave_table"].env_class)
    expected = {
        "elevation": ("scene", 0.0),
        "visuals": ("scene", None),
        "bonus": ("task", None),
        "malus": ("task", 0.0),
        "threshold": ("task", 0.3),
        "cameras": ("task", ()),
        "joint_speed": ("control", None),
        "action_limit": ("environment", 1.0),
    }
    assert {name: found[name][:2] for name in expected} == expected
    assert not found.keys() & {"self", "scene", "mdp", "root"}


@pytest.mark.parametrize("name", ["mdp", "scene", "root"])
def test_what_the_suite_passes_itself_is_no_argument(name):
    with refused(TypeError, f"unexpected argument {name!r}"):
        load("kitchen", **{name: 1})


@pytest.mark.full
def test_a_second_environment_inspects_no_signature_again():
    gymnasium.make(DOMAINS["kitchen"].env_id).close()
    inspected = signatures.signature.cache_info().misses
    gymnasium.make(DOMAINS["kitchen"].env_id, velocity_scale=3.0).close()
    assert signatures.signature.cache_info().misses == inspected


# The first words of an error that lists all arguments.
LIST = "choose from"


@pytest.mark.parametrize("domain", DOMAINS.values(), ids=DOMAINS)
def test_what_suite_load_does_not_take_is_refused_with_the_way(domain):
    missing = (of_gymnasium(domain) | of_vectors(domain)) - of_load(domain)
    assert {"action_limit", "obs_type", "num_envs"} <= missing
    for name in sorted(missing):
        with refused(TypeError, f"unexpected argument {name!r}: ") as raised:
            suite.load(domain.name, suite.default_task(domain.name), {name: 1})
        assert LIST not in str(raised.value)


@pytest.mark.parametrize("domain", DOMAINS.values(), ids=DOMAINS)
def test_what_gymnasium_does_not_take_is_refused_with_the_way(domain):
    single, many = of_gymnasium(domain), of_vectors(domain)
    environment_class, vector_class = domain.env_class, domain.vector_env_class
    assert {"time_limit", "random", "environment_kwargs"} <= of_load(domain) - many
    for name in sorted((of_load(domain) | many) - single):
        with refused(TypeError, f"unexpected keyword argument {name!r}: ") as raised:
            environment_class(**{name: 1})
        assert LIST not in str(raised.value)
    for name in sorted(of_load(domain) - many):
        with refused(TypeError, f"unexpected keyword argument {name!r}: "):
            vector_class(1, num_threads=1, **{name: 1})


def test_other_names_still_get_the_nearest_and_the_list():
    with refused(TypeError, "action_limits", LIST):
        load("open_cabinet", action_limits=1)
    with refused(TypeError, "time_limits", LIST):
        gymnasium.make(DOMAINS["kitchen"].env_id, time_limits=1)


# What the errors name, followed.


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_the_control_mode_that_the_error_on_action_limit_names_has_bounds(domain):
    spec = load(domain, control_mode="joint_delta").action_spec()
    assert isinstance(spec, specs.BoundedArray)
    assert np.isfinite([spec.minimum, spec.maximum]).all()


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_the_other_ways_of_dm_env_exist(domain):
    environment = load(domain, time_limit=0.5)
    assert environment.step_limit == np.ceil(0.5 / environment.control_timestep())
    assert isinstance(environment.task.instruction, str)
    flat = suite.load(domain, suite.default_task(domain), {"visuals": False}, {"flat_observation": True})
    (array,) = flat.reset().observation.values()
    assert array.ndim == 1
    if domain == "kitchen":
        assert [key for key in environment.reset().observation if key.startswith("achieved_goal/")]
        assert environment.task.step_task_completions == []


@pytest.mark.full
@pytest.mark.rendering
def test_images_are_rendered_by_physics_and_by_dm_controls_cameras():
    environment = suite.load("open_cabinet", "top_drawer")
    environment.reset()
    assert environment.physics.render(24, 32, camera_id="overview").shape == (24, 32, 3)
    camera = mujoco.MovableCamera(environment.physics, 24, 32, max_geom=500)
    camera.set_pose((0.4, 0.0, 0.5), 2.0, 125.0, -25.0)
    assert camera.render().shape == (24, 32, 3)


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_the_ways_of_gymnasium_exist(domain):
    environment = gymnasium.make(DOMAINS[domain].env_id, obs_type="state", max_episode_steps=2)
    observation, _ = environment.reset(seed=0)
    assert observation.ndim == 1
    environment.step(environment.action_space.sample())
    *_, truncated, _ = environment.step(environment.action_space.sample())
    assert truncated
    environment.close()
    vectors = gymnasium.make_vec(
        DOMAINS[domain].env_id, 1, vectorization_mode="sync", vector_kwargs={"autoreset_mode": "SameStep"}
    )
    assert vectors.metadata["autoreset_mode"].value == "SameStep"
    vectors.close()
    many = gymnasium.make_vec(DOMAINS[domain].env_id, num_envs=2, num_threads=1, autoreset_mode="SameStep")
    assert many.num_envs == 2
    many.close()
    assert isinstance(load(domain).reset(), dm_env.TimeStep)


def outcome(build):
    """Returns the error of building an environment, without what Gymnasium adds to it; None if it is built."""
    try:
        build().close()
    except (TypeError, ValueError) as error:
        return type(error), str(error).partition(" was raised from")[0]
    return None


def outcomes(domain, arguments):
    """Returns the errors of `suite.load`, `gymnasium.make` and `make_vec` with some arguments of their default task."""
    record = DOMAINS[domain]
    env_id = record.task_ids[record.default_task]
    return (
        outcome(lambda: load(domain, **arguments)),
        outcome(lambda: gymnasium.make(env_id, **arguments)),
        outcome(lambda: gymnasium.make_vec(env_id, 1, num_threads=1, **arguments)),
    )


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_none_is_taken_or_refused_alike_by_all_ways_to_build(domain):
    record = DOMAINS[domain]
    task_kwargs = record.tasks[record.default_task]
    names = of_load(record) & of_gymnasium(record) - (task_kwargs.keys() - {*record.replaceable})
    assert len(names) > 9
    taken = {name: None for name in sorted(names) if outcome(lambda name=name: load(domain, **{name: None})) is None}
    assert outcomes(domain, taken) == (None, None, None)
    for name in sorted(names - taken.keys()):
        one, single, many = outcomes(domain, {name: None})
        assert one == single == many, name
        assert name in one[1]


@pytest.mark.parametrize("name", ["control_mode", "cameras", "depth", "segmentation", "visuals"])
def test_none_stands_for_the_default_of_suite_load(name):
    one = suite.load("microwave_table", "open", {name: None})
    assert one.task.mdp.action_mode.name == "joint_offset"
    assert one.task.pictures.by_name == {}
    assert one.physics.model.ngeom == suite.load("microwave_table", "open").physics.model.ngeom


# Other tests may have registered further ones when this is run.
OWN = (*DOMAINS,)


@pytest.mark.full
@pytest.mark.parametrize("domain", OWN)
def test_the_domain_of_another_id_is_refused_with_that_id(domain):
    record = DOMAINS[domain]
    ids = (record.env_id, *list(record.task_ids.values())[:1])
    for other, env_id, build in itertools.product(OWN, ids, (gymnasium.make, gymnasium.make_vec)):
        found = outcome(lambda build=build, env_id=env_id, other=other: build(env_id, domain=other))
        if domain == other:
            assert found is None
        else:
            assert found[0] is ValueError
            assert found[1].startswith(f"domain {other!r}")
            assert repr(DOMAINS[other].env_id) in found[1]
            assert "tasks_to_complete" not in found[1]


@pytest.mark.full
def test_the_way_that_the_error_about_a_domain_names_is_the_way():
    with refused(ValueError, "'open_cabinet'", "FrankaOpenCabinetEnv", "leave out domain") as raised:
        gymnasium.make("KitchenSuite/FrankaKitchen-v1", domain="open_cabinet")
    env_id = str(raised.value).split("'")[-2]
    env = gymnasium.make(env_id)
    assert env.unwrapped.composer_task.domain_name == "open_cabinet"
    env.close()


@pytest.mark.parametrize("name", ["", "nonsense"])
def test_a_domain_that_does_not_exist_is_refused(name):
    with refused(ValueError, f"domain {name!r}", "'open_cabinet'"):
        gymnasium.make("KitchenSuite/FrankaKitchen-v1", domain=name)
