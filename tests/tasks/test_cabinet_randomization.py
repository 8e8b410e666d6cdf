"""Domain randomisation of open_cabinet: values drawn, values refused."""

import numpy as np
import pytest
from dm_control.composer.variation import distributions

from kitchen_suite import suite
from kitchen_suite.tasks import Randomization
from kitchen_suite.tasks.open_cabinet.randomization import MODERATE


def load(task="top_drawer", **options):
    return suite.load("open_cabinet", task, {"random": 0, "visuals": False, **options})


def scene_state(env):
    env.reset()
    cabinet, robot = env.task.scene.cabinet, env.task.scene.robot
    slide, pads = (
        env.physics.bind(cabinet.drawer_joint("top")),
        env.physics.bind([robot.finger_geoms(side)[0] for side in ("left", "right")]),
    )
    handle = env.physics.bind(cabinet.handle_site("top"))
    return np.concatenate([handle.xpos, handle.xmat[:3], slide.frictionloss, slide.damping, pads.friction[:, 0]])


def test_without_randomization_only_the_robots_pose_is_drawn():
    env = load()
    starts = {tuple(scene_state(env)) for _ in range(5)}
    assert len(starts) == 1


def test_randomization_draws_the_scene_anew():
    env = load(randomization=MODERATE)
    starts = np.array([scene_state(env) for _ in range(200)])
    ranges = starts.max(axis=0) - starts.min(axis=0)
    np.testing.assert_allclose(ranges[7:], [10.0, 0.6, 0.6], rtol=0.05)
    np.testing.assert_allclose(ranges[6], 1.5, rtol=0.05)
    # The handle moves with the cabinet: up to 3 cm and 5 cm, and 0.3 m times the yaw to the side.
    assert (ranges[:2] > [0.05, 0.1]).all()
    np.testing.assert_allclose(starts[:, 2], 0.66, atol=1e-12)


def test_randomization_takes_constants_and_offsets_start_from_the_built_pose():
    env = load(
        randomization=Randomization(cabinet_offset=(0.01, 0.0, 0.0), drawer_friction=distributions.Uniform(2, 4))
    )
    for _ in range(3):
        state = scene_state(env)
        np.testing.assert_allclose(state[:3], [0.313, 0, 0.66], atol=1e-12)
        assert 2 <= state[6] <= 4
        assert state[7] == 15.0


def test_the_same_seed_draws_the_same_scenes():
    one, same = (load(randomization=MODERATE) for _ in range(2))
    for _ in range(3):
        np.testing.assert_array_equal(scene_state(one), scene_state(same))


def test_observations_follow_the_cabinet():
    env = load(randomization=MODERATE)
    for _ in range(20):
        observation = env.reset().observation
        data = env.physics.named.data
        offset = data.site_xpos["cabinet/drawer_top_handle"] - data.site_xpos["franka/gripper"]
        np.testing.assert_allclose(observation["handle_offset"], offset, atol=1e-6)


def test_both_pads_have_the_same_friction():
    starts = scene_state(load(randomization=Randomization(pad_friction=1.3)))
    np.testing.assert_array_equal(starts[-2:], 1.3)


@pytest.mark.parametrize(
    ("option", "value", "error"),
    [
        ("cabinet_offset", (0.1, 0.0), ValueError),
        ("cabinet_offset", 0.1, ValueError),
        ("cabinet_offset", (0.1, 0.0, np.nan), ValueError),
        ("cabinet_yaw", np.inf, ValueError),
        ("cabinet_yaw", (0.1, 0.2), ValueError),
        ("cabinet_yaw", "left", TypeError),
        ("drawer_friction", -1.0, ValueError),
        ("drawer_friction", True, TypeError),
        ("drawer_damping", np.nan, ValueError),
        ("drawer_damping", {"low": 1.0}, TypeError),
        ("pad_friction", -0.1, ValueError),
    ],
)
def test_values_out_of_range_are_refused(option, value, error):
    with pytest.raises(error, match=f"randomization's {option} must"):
        Randomization(**{option: value})
    # The value of a variation is refused at the reset.
    options = {"drawer_friction": 2.0, option: lambda random_state: value}
    env = load(randomization=Randomization(**options))
    with pytest.raises(error, match=f"randomization's {option} must"):
        env.reset()
    slide = env.physics.bind(env.task.scene.cabinet.drawer_joint("top"))
    assert env.task.get_state()["randomization"]["drawer_friction"] == slide.frictionloss == 3.0
    assert not env.physics.data.qpos.any()


def test_a_variation_may_stand_within_an_offset():
    offset = (distributions.Uniform(0.01, 0.02), 0.0, 0.0)
    state = scene_state(load(randomization=Randomization(cabinet_offset=offset)))
    assert 0.313 <= state[0] <= 0.323
    np.testing.assert_allclose(state[1:3], [0, 0.66], atol=1e-12)


def test_the_pose_is_drawn_before_the_scene():
    plain, randomized = load(random=3), load(random=3, randomization=MODERATE)
    for env in (plain, randomized):
        env.reset()
    np.testing.assert_array_equal(plain.physics.data.qpos, randomized.physics.data.qpos)
