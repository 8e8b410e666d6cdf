"""Variations of the cabinet and the pads: what is drawn, in which order, and how it reaches the scene."""

import json

import gymnasium
import numpy as np
import pytest
from dm_control.composer.variation import distributions
from helpers.open_cabinet import VARIED, load

from kitchen_suite.gymnasium_env import OPEN_CABINET_ID

# What `VARIED` draws, as JSON describes it, in another order.
JSON = """{
    "franka/pad_friction": {"uniform": [1.2, 1.8]},
    "cabinet/offset": {"uniform": [[-0.03, -0.05, 0.0], [0.03, 0.05, 0.0]]},
    "cabinet/yaw": {"uniform": [-0.1, 0.1]},
    "cabinet/drawer_top_friction": {"uniform": [2.5, 4.0]},
    "cabinet/drawer_top_damping": {"uniform": [10.0, 20.0]}
}"""


def scene_state(env):
    env.reset()
    cabinet, robot = env.task.scene.cabinet, env.task.scene.robot
    slide, pads = env.physics.bind(cabinet.drawer_joint("top")), env.physics.bind(robot.pads)
    handle = env.physics.bind(cabinet.handle_site("top"))
    return np.concatenate([handle.xpos, handle.xmat[:3], slide.frictionloss, slide.damping, pads.friction[:, 0]])


def test_without_variations_only_the_robots_pose_is_drawn():
    env = load()
    starts = {tuple(scene_state(env)) for _ in range(5)}
    assert len(starts) == 1


@pytest.mark.full
def test_resets_draw_the_scene_anew():
    env = load(variations=VARIED)
    starts = np.array([scene_state(env) for _ in range(200)])
    ranges = starts.max(axis=0) - starts.min(axis=0)
    np.testing.assert_allclose(ranges[7:], [10.0, 0.6, 0.6], rtol=0.05)
    np.testing.assert_allclose(ranges[6], 1.5, rtol=0.05)
    # The handle moves with the cabinet: up to 3 cm and 5 cm, and 0.3 m times the yaw to the side.
    assert (ranges[:2] > [0.05, 0.1]).all()
    np.testing.assert_allclose(starts[:, 2], 0.66, atol=1e-12)


def test_constants_are_set_and_offsets_start_from_the_built_pose():
    varied = {"cabinet/offset": (0.01, 0.0, 0.0), "cabinet/drawer_top_friction": distributions.Uniform(2, 4)}
    env = load(variations=varied)
    for _ in range(3):
        state = scene_state(env)
        np.testing.assert_allclose(state[:3], [0.313, 0, 0.66], atol=1e-12)
        assert 2 <= state[6] <= 4
        assert state[7] == 15.0


def test_the_same_seed_draws_the_same_scenes():
    one, same = (load(variations=VARIED) for _ in range(2))
    for _ in range(3):
        np.testing.assert_array_equal(scene_state(one), scene_state(same))


def test_observations_follow_the_cabinet():
    env = load(variations=VARIED)
    for _ in range(20):
        observation = env.reset().observation
        data = env.physics.named.data
        offset = data.site_xpos["cabinet/drawer_top_handle"] - data.site_xpos["franka/gripper"]
        np.testing.assert_allclose(observation["handle_offset"], offset, atol=1e-6)


def test_both_pads_have_the_same_friction():
    starts = scene_state(load(variations={"franka/pad_friction": 1.3}))
    np.testing.assert_array_equal(starts[-2:], 1.3)


@pytest.mark.parametrize(
    ("name", "value", "error"),
    [
        ("cabinet/offset", (0.1, 0.0), ValueError),
        ("cabinet/offset", 0.1, ValueError),
        ("cabinet/yaw", 0.2, ValueError),
        ("cabinet/yaw", (0.1, 0.2), ValueError),
        ("cabinet/yaw", "left", TypeError),
        ("cabinet/drawer_top_friction", -1.0, ValueError),
        ("franka/pad_friction", -0.1, ValueError),
    ],
)
def test_constants_out_of_range_are_refused(name, value, error):
    with pytest.raises(error, match=f"variation's {name} must"):
        load(variations={name: value})


@pytest.mark.full
@pytest.mark.parametrize(
    ("name", "value"), [("cabinet/offset", (0.01, 0.0, np.nan)), ("cabinet/drawer_top_damping", np.nan)]
)
def test_draws_that_are_no_numbers_are_refused_at_the_reset(name, value):
    env = load(variations={"cabinet/drawer_top_friction": 2.0, name: lambda random_state: value})
    with pytest.raises(ValueError, match=f"variation's {name} must"):
        env.reset()
    slide = env.physics.bind(env.task.scene.cabinet.drawer_joint("top"))
    values = env.task.get_state()["variation_values"]
    assert values["cabinet/drawer_top_friction"] == slide.frictionloss == 3.0
    assert not env.physics.data.qpos.any()


@pytest.mark.full
@pytest.mark.parametrize(
    ("name", "drawn", "nearest"),
    [
        ("cabinet/offset", (0.1, 0.0, 0.1), (0.035, 0.0, 0.0)),
        ("cabinet/drawer_top_friction", -1.0, 2.0),
        ("franka/pad_friction", 5.0, 2.0),
    ],
)
def test_draws_out_of_range_are_moved_into_it(name, drawn, nearest):
    env = load(variations={name: lambda random_state: drawn})
    env.reset()
    np.testing.assert_array_equal(env.task.variations.values[name], nearest)


@pytest.mark.full
def test_a_variation_may_stand_within_an_offset():
    offset = (distributions.Uniform(0.01, 0.02), 0.0, 0.0)
    state = scene_state(load(variations={"cabinet/offset": offset}))
    assert 0.313 <= state[0] <= 0.323
    np.testing.assert_allclose(state[1:3], [0, 0.66], atol=1e-12)


@pytest.mark.full
def test_the_pose_is_drawn_before_the_scene():
    plain, varied = load(random=3), load(random=3, variations=VARIED)
    for env in (plain, varied):
        env.reset()
    np.testing.assert_array_equal(plain.physics.data.qpos, varied.physics.data.qpos)


@pytest.mark.full
@pytest.mark.parametrize("variations", [VARIED, json.loads(JSON)], ids=["composer", "JSON"])
def test_values_are_drawn_after_the_pose_in_the_order_of_the_table(variations):
    for seed in range(5):
        env = load(random=seed, variations=variations)
        random_state = np.random.RandomState(seed)
        for _ in range(3):
            env.reset()
            random_state.uniform(-0.125, 0.125, 9)
            expected = {
                "cabinet/offset": random_state.uniform((-0.03, -0.05, 0), (0.03, 0.05, 0)),
                "cabinet/yaw": random_state.uniform(-0.1, 0.1),
                "cabinet/drawer_top_friction": random_state.uniform(2.5, 4.0),
                "cabinet/drawer_top_damping": random_state.uniform(10.0, 20.0),
                "franka/pad_friction": random_state.uniform(1.2, 1.8),
            }
            # The seed with which refused layouts are drawn again; none of these is refused.
            random_state.randint(2**31)
            state = env.task.get_state()
            assert state["layout_refusals"] == 0
            drawn = state["variation_values"]
            assert list(drawn) == list(expected)
            for name, value in expected.items():
                np.testing.assert_array_equal(drawn[name], value)
                assert drawn[name].dtype == np.float64


def test_json_draws_what_composer_distributions_do_in_the_vectorised_environment():
    arguments = {"vectorization_mode": "vector_entry_point", "num_threads": 1}
    environments = [
        gymnasium.make_vec(OPEN_CABINET_ID, 3, variations=each, **arguments) for each in (VARIED, json.loads(JSON))
    ]
    generator = np.random.default_rng(0)
    first, other = [env.reset(seed=7)[0] for env in environments]
    np.testing.assert_array_equal(first, other)
    assert len(np.unique(first[:, 16])) == 3
    for _ in range(5):
        actions = generator.normal(scale=0.03, size=(3, 8))
        steps = [env.step(actions) for env in environments]
        for one, same in zip(*(step[:4] for step in steps), strict=True):
            np.testing.assert_array_equal(one, same)


def test_only_fields_of_wanted_parameters_are_changed():
    assert load().task.variations.randomizer.model_fields == ()
    wanted = {"franka/pad_friction": 1.2, "cabinet/yaw": {"uniform": [0, 0.1]}}
    fields = ("body_quat", "body_sameframe", "geom_friction")
    assert load(variations=wanted).task.variations.randomizer.model_fields == fields


def test_the_cabinet_offers_parameters_of_all_its_joints():
    env = load()
    env.reset()
    offered = {parameter.name: parameter for parameter in env.task.scene.cabinet.parameters}
    names = {f"cabinet/{name}" for name in ("drawer_top", "drawer_bottom", "door_left", "door_right")}
    resistances = {f"{name}_{kind}" for name in names for kind in ("friction", "damping")}
    assert offered.keys() == {"cabinet/offset", "cabinet/yaw", *resistances, *names}
    units = {name: offered[f"cabinet/{name}"].unit for name in ("drawer_top_damping", "door_left_friction")}
    assert units == {"drawer_top_damping": "N s/m", "door_left_friction": "N m"}
    config = env.task.scene.cabinet.config
    assert offered["cabinet/door_left_damping"].get(env.physics) == config.door_damping
    assert offered["cabinet/drawer_top_friction"].get(env.physics) == config.drawer_friction
