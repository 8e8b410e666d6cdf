"""Parameters of any domain: variations as JSON describes them, and the randomizer that draws and sets them."""

import json

import mujoco
import numpy as np
import pytest
from dm_control.composer.variation import distributions
from helpers.errors import refused

from kitchen_suite import suite
from kitchen_suite.entities import parameters
from kitchen_suite.entities.parameters import Parameter, ParameterType
from kitchen_suite.tasks.variations import distributions as variations
from kitchen_suite.tasks.variations.randomizer import Draw, Randomizer

NUMBER, POSITIVE = (parameters.YAW, parameters.JOINT_DAMPING)
VECTOR = parameters.POSITION_OFFSET

# Mass of a body; MuJoCo derives further fields from it.
MASS = ParameterType(
    read=lambda physics, bodies: physics.bind(bodies[0]).mass,
    write=lambda physics, bodies, value: setattr(physics.bind(bodies[0]), "mass", value),
    model_fields=("body_mass",),
    non_negative=True,
    derived=True,
)
COLOUR = ParameterType(
    read=lambda physics, geoms: physics.bind(geoms[0]).rgba[:3],
    write=lambda physics, geoms, value: physics.bind(geoms[0]).rgba.__setitem__(slice(3), value),
    model_fields=("geom_rgba",),
    shape=(3,),
    visual=True,
)


def randomizer_of(env, offered, wanted):
    """Returns the randomizer of some of the parameters offered."""
    draws = [Draw(parameter=offered[name], variation=each) for name, each in wanted.items()]
    return Randomizer(env.physics, draws)


@pytest.fixture(scope="module")
def env_and_offered():
    return load_kitchen()


def draw(scene, value, parameter="microwave/yaw", seed=0, times=200):
    env, offered = scene
    parsed = variations.parse(json.loads(value), offered[parameter].type, "it")
    randomizer, random_state = randomizer_of(env, offered, {parameter: parsed}), np.random.RandomState(seed)
    return np.array([randomizer.draw(random_state)[parameter] for _ in range(times)])


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ('{"uniform": [2, 4]}', lambda random: random.uniform(2, 4)),
        ('{"uniform_integer": [2, 5]}', lambda random: random.randint(2, 5)),
        ('{"normal": [1, 0.1]}', lambda random: random.normal(1, 0.1)),
        ('{"log_normal": [1, 0.1]}', lambda random: random.lognormal(1, 0.1)),
        ('{"exponential": [2]}', lambda random: random.exponential(2)),
        ('{"poisson": [3]}', lambda random: random.poisson(3)),
        ('{"bernoulli": [0.3]}', lambda random: random.binomial(1, 0.3)),
        ('{"choice": [1, 2, 5]}', lambda random: random.choice([1, 2, 5])),
        ("0.5", lambda random: 0.5),
    ],
)
def test_json_draws_the_numbers_of_numpy(env_and_offered, value, expected):
    random = np.random.RandomState(3)
    np.testing.assert_array_equal(draw(env_and_offered, value, seed=3, times=20), [expected(random) for _ in range(20)])


def test_vectors_are_drawn_whole_or_by_element(env_and_offered):
    low, high = (-0.03, -0.05, 0.0), (0.03, 0.05, 0.0)
    scene, vector = env_and_offered, "microwave/offset"
    drawn = draw(scene, '{"uniform": [[-0.03, -0.05, 0], [0.03, 0.05, 0]]}', vector)
    random = np.random.RandomState(0)
    np.testing.assert_array_equal(drawn, [random.uniform(low, high) for _ in range(200)])
    assert (np.ptp(draw(scene, '{"uniform": [-1, 1]}', vector), axis=0) > 1.5).all()
    mixed = draw(scene, '[{"uniform": [1, 2]}, 0, {"choice": [3, 4]}]', vector)
    assert set(mixed[:, 2]) == {3, 4}
    assert np.ptp(mixed[:, 0]) > 0.5
    assert not mixed[:, 1].any()
    rows = {tuple(row) for row in draw(scene, '{"choice": [[0, 0, 0], [0.1, 0.2, 0]]}', vector)}
    assert rows == {(0, 0, 0), (0.1, 0.2, 0)}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("value", "quantity", "error", "shown"),
    [
        ('{"unifrom": [0, 1]}', NUMBER, ValueError, ["'unifrom'", "'uniform'"]),
        ('{"uniform": [0, 1], "normal": [0, 1]}', NUMBER, ValueError, ["it"]),
        ("{}", NUMBER, ValueError, ["it"]),
        ('{"uniform": [1]}', NUMBER, ValueError, ["uniform", "[1.0]"]),
        ('{"uniform": 1}', NUMBER, ValueError, ["must have a list of numbers, got 1"]),
        ('{"choice": []}', NUMBER, ValueError, ["must have a list of numbers"]),
        ('{"uniform": [2, 1]}', NUMBER, ValueError, ["a low that is not above its high"]),
        ('{"uniform": [-1, 1]}', POSITIVE, ValueError, ["must be non-negative"]),
        ('{"choice": [-1, 1]}', POSITIVE, ValueError, ["must be non-negative"]),
        ('{"uniform": ["a", "b"]}', NUMBER, TypeError, ["uniform"]),
        ('{"uniform": [NaN, 1]}', NUMBER, ValueError, ["must be finite"]),
        ('{"uniform": [[0], 1]}', NUMBER, ValueError, ["must have numbers, got"]),
        ('{"uniform": [[0, 0], 1]}', VECTOR, ValueError, ["must have numbers or lists of 3"]),
        ('{"choice": [[0, 0, [1]], 1]}', VECTOR, ValueError, ["must be an array"]),
        ('[{"uniform": [0, 1]}, 0]', VECTOR, ValueError, ["(3,)"]),
        ('[{"uniform": [[0, 0, 0], 1]}, 0, 0]', VECTOR, ValueError, ["must have numbers, got"]),
        ('{"normal": [0, -1]}', NUMBER, ValueError, ["normal of it cannot be drawn from"]),
        ('{"uniform": [-1e308, 1e308]}', NUMBER, ValueError, ["uniform of it cannot be drawn from"]),
        ('{"bernoulli": [2]}', NUMBER, ValueError, ["bernoulli of it cannot be drawn from"]),
        ('{"uniform_integer": [0.5, 2]}', NUMBER, ValueError, ["must have integers"]),
        ('{"uniform_integer": [0, 1e300]}', NUMBER, ValueError, ["must have integers"]),
    ],
)
def test_bad_json_is_refused_in_one_line(value, quantity, error, shown):
    with refused(error, *shown) as caught:
        variations.parse(json.loads(value), quantity, "it")
    assert "\n" not in str(caught.value)


def load_kitchen():
    env = suite.load("kitchen", "microwave", {"random": 0, "visuals": False})
    env.reset()
    microwave = env.task.scene.props["microwave"]
    (door,) = microwave.joints
    geoms = microwave.mjcf_model.find_all("geom")
    offered = (
        *parameters.joint_parameters("microwave/door", door),
        *parameters.pose_parameters(microwave),
        Parameter(name="microwave/door_mass", unit="kg", type=MASS, elements=(door.parent,)),
        Parameter(name="microwave/colour", unit="1", type=COLOUR, elements=(geoms[0],)),
    )
    return env, {parameter.name: parameter for parameter in offered}


@pytest.mark.full
def test_parameters_of_another_scene_are_drawn_and_set():
    env, offered = load_kitchen()
    microwave = env.task.scene.props["microwave"]
    damping = distributions.Uniform(5.0, 6.0)
    randomizer = randomizer_of(env, offered, {"microwave/door_damping": damping, "microwave/yaw": 0.2})
    # The arena's XML rotates the microwave.
    np.testing.assert_allclose(randomizer.values["microwave/yaw"], 0.3)
    drawn = randomizer.draw(np.random.RandomState(4))
    assert list(drawn) == ["microwave/door_damping", "microwave/yaw"]
    assert drawn["microwave/door_damping"] == np.random.RandomState(4).uniform(5, 6)
    randomizer.set(drawn)
    assert env.physics.bind(microwave.joints).damping == drawn["microwave/door_damping"]
    for name, value in randomizer.values.items():
        np.testing.assert_allclose(offered[name].get(env.physics), value)
    assert randomizer.model_fields == ("dof_damping", "body_quat", "body_sameframe")


def test_an_offset_starts_from_the_built_position_and_moves_the_joints():
    env, offered = load_kitchen()
    (door,) = env.task.scene.props["microwave"].joints
    built = env.physics.bind(door).xanchor.copy()
    randomizer = randomizer_of(env, offered, {"microwave/offset": (0.1, 0.0, 0.02)})
    for _ in range(2):
        randomizer.set(randomizer.draw(np.random.RandomState(0)))
        np.testing.assert_allclose(env.physics.bind(door).xanchor - built, [0.1, 0, 0.02], atol=1e-12)


def test_what_mujoco_derives_follows_and_the_state_stays():
    env, offered = load_kitchen()
    randomizer = randomizer_of(env, offered, {"microwave/door_mass": 40.0})
    model, state = env.physics.model.ptr, env.physics.get_state().copy()
    names = [name for name in dir(model) if isinstance(getattr(model, name), np.ndarray)]
    before = {name: getattr(model, name).copy() for name in names}
    randomizer.set(randomizer.draw(np.random.RandomState(0)))
    np.testing.assert_array_equal(env.physics.get_state(), state)
    changed = {name for name in names if not np.array_equal(getattr(model, name), before[name], equal_nan=True)}
    assert "dof_invweight0" in changed
    assert changed <= set(randomizer.model_fields)
    expected = {name: getattr(model, name).copy() for name in changed}
    mujoco.mj_setConst(model, mujoco.MjData(model))
    for name, values in expected.items():
        np.testing.assert_array_equal(getattr(model, name), values)


def test_visual_fields_are_apart():
    env, offered = load_kitchen()
    randomizer = randomizer_of(env, offered, {"microwave/colour": (0.1, 0.2, 0.3)})
    randomizer.set(randomizer.draw(np.random.RandomState(0)))
    np.testing.assert_allclose(offered["microwave/colour"].get(env.physics), (0.1, 0.2, 0.3), rtol=1e-6)
    assert (randomizer.model_fields, randomizer.visual_fields) == ((), ("geom_rgba",))


def test_nothing_wanted_draws_and_sets_nothing():
    env, _ = load_kitchen()
    randomizer, random_state = Randomizer(env.physics, []), np.random.RandomState(0)
    positions = env.physics.data.xpos.copy()
    env.physics.data.qpos[0] += 0.1
    randomizer.set(randomizer.draw(random_state))
    np.testing.assert_array_equal(env.physics.data.xpos, positions)
    assert random_state.uniform() == np.random.RandomState(0).uniform()
    assert (randomizer.values, randomizer.model_fields) == ({}, ())


def test_bad_constants_are_refused(env_and_offered):
    env, offered = env_and_offered
    with refused(ValueError, "microwave/door_damping", "non-negative", "-1.0"):
        randomizer_of(env, offered, {"microwave/door_damping": -1.0})
