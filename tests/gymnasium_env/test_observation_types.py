"""The observation types of the Gymnasium environments, extra observables, and pictures as observations."""

import copy
import pickle

import gymnasium
import mujoco
import numpy as np
import pytest
from helpers.comparisons import assert_same
from helpers.errors import refused
from helpers.sweeps import brief

from kitchen_suite import suite
from kitchen_suite.gymnasium_env import FrankaKitchenEnv, FrankaOpenCabinetEnv
from kitchen_suite.gymnasium_env.generated_kitchens import GeneratedKitchenEnv
from kitchen_suite.gymnasium_env.microwave_table import FrankaMicrowaveTableEnv
from kitchen_suite.gymnasium_env.pick_and_place import PickAndPlaceEnv

pytestmark = pytest.mark.full

CLASSES = {
    "kitchen": FrankaKitchenEnv,
    "open_cabinet": FrankaOpenCabinetEnv,
    "microwave_table": FrankaMicrowaveTableEnv,
    "kitchens": GeneratedKitchenEnv,
    "pick_and_place": PickAndPlaceEnv,
}
# Elements of the robot, of the flat observation, and their bound.
SIZES = {
    "kitchen": (18, 59, np.inf),
    "open_cabinet": (16, 25, 5.0),
    "microwave_table": (18, 23, np.inf),
    "kitchens": (18, 363, np.inf),
    "pick_and_place": (18, 619, np.inf),
}
# A prop with handles, and the number of their coordinates.
HANDLES = {
    "kitchen": ("oven", 12),
    "open_cabinet": ("cabinet", 12),
    "microwave_table": ("microwave", 3),
    "kitchens": ("oven_1", 12),
    "pick_and_place": ("can", 6),
}
PIXELS = {"image_size": (24, 32), "render_quality": "fast"}
EXTRAS = ("franka/gripper_width", "franka/end_effector_pose", "franka/end_effector_velocity")


def steps(env, count=4, seed=1):
    """Returns the observations of a reset and of some steps."""
    generator = np.random.default_rng(seed)
    observations = [env.reset(seed=3)[0]]
    for _ in range(count):
        observations.append(env.step(generator.uniform(-0.5, 0.5, env.action_space.shape))[0])
    return observations


@pytest.mark.parametrize("domain", CLASSES)
def test_types_of_numbers_split_the_same_flat_observation(domain):
    (robot, size, bound), env_class = SIZES[domain], CLASSES[domain]
    flat, split = env_class(obs_type="state"), env_class(obs_type="environment_state_agent_pos")
    assert flat.observation_space.shape == (size,)
    assert set(split.observation_space) == {"environment_state", "agent_pos"}
    for part, length in (("agent_pos", robot), ("environment_state", size - robot)):
        space = split.observation_space[part]
        assert space == gymnasium.spaces.Box(-bound, bound, (length,), flat.observation_space.dtype.type)
    for whole, parts in zip(steps(flat), steps(split), strict=True):
        assert_same(whole, np.concatenate([parts["agent_pos"], parts["environment_state"]]))
        assert parts in split.observation_space
        assert_same(whole, split.observations.recover_flat(parts))


def test_the_kitchens_state_is_the_observation_of_its_goal_dictionary():
    goals, state = FrankaKitchenEnv(), FrankaKitchenEnv(obs_type="state")
    assert goals.observation_space == FrankaKitchenEnv(obs_type="goal").observation_space
    for one, other in zip(steps(goals), steps(state), strict=True):
        assert_same(one["observation"], other)


@pytest.mark.parametrize("domain", CLASSES)
def test_extra_observables_are_appended_where_they_belong(domain):
    robot, size, _ = SIZES[domain]
    handles, count = HANDLES[domain]
    names = [f"{handles}/handle_positions", *EXTRAS]
    plain = CLASSES[domain](obs_type="state")
    flat = CLASSES[domain](obs_type="state", extra_observables=names)
    split = CLASSES[domain](obs_type="environment_state_agent_pos", extra_observables=names)
    assert flat.observation_space.shape == (size + 14 + count,)
    assert split.observation_space["agent_pos"].shape == (robot + 14,)
    assert split.observation_space["environment_state"].shape == (size - robot + count,)
    each = zip(steps(plain), steps(flat), steps(split), strict=True)
    for base, whole, parts in each:
        assert whole in flat.observation_space
        assert_same(whole[:size], base)
        assert_same(whole[:robot], parts["agent_pos"][:robot])
        assert_same(whole[size : size + 14], parts["agent_pos"][robot:])
        assert_same(whole[size + 14 :], parts["environment_state"][size - robot :])
    physics, dtype = flat.environment.physics, flat.observation_space.dtype
    hand = physics.bind(flat.environment.task.robot.end_effector)
    width = physics.bind(flat.environment.task.robot.joints[-2:]).qpos.sum()
    assert_same(whole[size : size + 4], np.array([width, *hand.xpos], dtype))
    sites = [physics.bind(site).xpos for site in flat.environment.task.scene.props[handles].handles]
    assert_same(whole[size + 14 :], np.concatenate(sites).astype(dtype))


def test_the_velocity_of_the_hand_is_that_of_its_position():
    env = FrankaKitchenEnv(obs_type="state", extra_observables=EXTRAS[1:], robot_noise_ratio=0)
    env.reset(seed=0)
    env.step(np.full(9, 0.2))
    physics, robot = env.environment.physics, env.environment.task.robot
    before = physics.bind(robot.end_effector).xpos.copy()
    observed = env.present_observation["franka/end_effector_velocity"][:3]
    physics.step(1)
    after = physics.bind(robot.end_effector).xpos
    # The velocity changes within a physics step of 2 ms.
    np.testing.assert_allclose((after - before) / physics.timestep(), observed, atol=0.02)
    assert np.abs(observed).max() > 0.1


def test_the_goal_dictionary_has_extra_observables_in_its_observation():
    env = FrankaKitchenEnv(["kettle"], extra_observables=("kettle/handle_positions",))
    assert env.observation_space["observation"].shape == (62,)
    observation, _ = env.reset(seed=0)
    assert observation["observation"].shape == (62,)
    added, *goals = list(env.present_observation)[4:]
    assert (added, goals) == ("kettle/handle_positions", ["achieved_goal/kettle", "desired_goal/kettle"])


def test_copies_and_states_keep_extra_observables():
    env = FrankaOpenCabinetEnv(extra_observables=EXTRAS, action_limit=1.0)
    expected = steps(env)[-1]
    twin = pickle.loads(pickle.dumps(env))
    other = FrankaOpenCabinetEnv(extra_observables=EXTRAS, action_limit=1.0)
    other.reset(seed=9)
    assert_same(other.set_state(env.get_state()), expected)
    action = np.full(8, 0.1)
    assert_same(env.step(action)[0], twin.step(action)[0])
    assert_same(other.step(action)[0], copy.deepcopy(twin).set_state(twin.get_state()))


# For each kind of bad settings: what the error shows.
BAD = {
    "unknown type": ({"obs_type": "pixel"}, ["obs_type", "'pixels'"]),
    "unknown camera": ({"obs_type": "pixels", "cameras": ["overvew"]}, ["camera", "'overview'"]),
    "no cameras": ({"obs_type": "pixels", "cameras": []}, ["cameras", "empty"]),
    "no height": ({"obs_type": "pixels", "image_size": (0, 8)}, ["height of image_size", "1", "0"]),
    "too wide": ({"obs_type": "pixels", "image_size": (8, 5000)}, ["width of image_size", "1920", "5000"]),
    "array for a size": (
        {"obs_type": "pixels", "image_size": np.array([8, 8])},
        ["image_size must be (height, width), got array([8, 8])"],
    ),
    "one number": ({"obs_type": "pixels", "image_size": 64}, ["image_size", "(height, width)", "64"]),
    "depth that is no bool": ({"obs_type": "pixels", "depth": "yes"}, ["depth", "True or False"]),
    "cameras without pictures": ({"cameras": ["left"]}, ["cameras=['left']", "'pixels_agent_pos'"]),
    "size without pictures": ({"obs_type": "state", "image_size": (8, 8)}, ["image_size=(8, 8)", "needs an obs_type"]),
    "depth without pictures": ({"depth": True}, ["depth=True", "needs an obs_type"]),
    "pictures without visuals": ({"obs_type": "pixels", "visuals": False}, ["visuals=False"]),
    "unknown quantity": ({"extra_observables": ["franka/pose"]}, ["extra observable", "'franka/pose'"]),
    "quantity in place of a list": ({"extra_observables": "franka/gripper_width"}, ["extra_observables"]),
    "name of another library": ({"observation_type": "pixels"}, ["'observation_type'", "'obs_type'"]),
}


@pytest.mark.parametrize(("settings", "shown"), BAD.values(), ids=BAD)
def test_bad_settings_are_refused(settings, shown):
    with refused((TypeError, ValueError), *shown) as caught:
        FrankaMicrowaveTableEnv(**settings)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("obs_type", "lost"),
    [("pixels_agent_pos", ["kettle/pose"]), ("pixels", ["franka/gripper_width", "kettle/pose"])],
)
def test_extra_observables_do_not_vanish_without_a_word(obs_type, lost):
    with refused(ValueError, "extra_observables", f"{lost}", f"{obs_type!r}", "'pixels_environment_state_agent_pos'"):
        FrankaKitchenEnv(obs_type=obs_type, extra_observables=["kettle/pose", "franka/gripper_width"])


@pytest.mark.parametrize("domain", ["open_cabinet", "microwave_table", "kitchens", "pick_and_place"])
def test_domains_without_goals_refuse_the_goal_dictionary(domain):
    with refused(ValueError, "obs_type", "'goal'"):
        CLASSES[domain](obs_type="goal")


@pytest.mark.rendering
@pytest.mark.parametrize("domain", brief(CLASSES, kept=["microwave_table"]))
def test_one_camera_is_an_array_and_several_are_a_dict(domain):
    one = CLASSES[domain](obs_type="pixels", **PIXELS)
    assert one.observation_space == gymnasium.spaces.Box(0, 255, (24, 32, 3), np.uint8)
    several = CLASSES[domain](obs_type="pixels", cameras=("franka/hand", "overview"), **PIXELS)
    with_robot = CLASSES[domain](obs_type="pixels_agent_pos", **PIXELS)
    assert list(several.observation_space) == ["franka_hand", "overview"]
    assert set(with_robot.observation_space) == {"pixels", "agent_pos"}
    state = CLASSES[domain](obs_type="environment_state_agent_pos")
    each = zip(*(steps(env, 2) for env in (one, several, with_robot, state)), strict=True)
    for picture, pictures, both, numbers in each:
        assert picture in one.observation_space
        assert pictures in several.observation_space
        assert_same(both, {"pixels": picture, "agent_pos": numbers["agent_pos"]})
        assert picture.std() > 10
        assert pictures["franka_hand"].std() > 10
    default = "workspace" if domain.startswith("kitchen") else "overview"
    assert_same(picture, one.environment.physics.render(24, 32, camera_id=default))
    assert_same(pictures["franka_hand"], several.environment.physics.render(24, 32, camera_id="franka/hand"))
    for env in (one, several, with_robot):
        env.close()


@pytest.mark.rendering
def test_pictures_come_beside_the_state_of_robot_and_objects():
    extras = {"extra_observables": ["kettle/pose", "franka/gripper_width"]}
    env = FrankaKitchenEnv(obs_type="pixels_environment_state_agent_pos", **extras, **PIXELS)
    numbers = FrankaKitchenEnv(obs_type="environment_state_agent_pos", **extras)
    pictures = FrankaKitchenEnv(obs_type="pixels", **PIXELS)
    for whole, parts, picture in zip(*(steps(each, 2) for each in (env, numbers, pictures)), strict=True):
        assert whole in env.observation_space
        assert_same(whole, {"pixels": picture, **parts})
        assert_same(env.observations.recover_flat(whole), numbers.observations.recover_flat(parts))
    assert [whole[key].shape for key in ("environment_state", "agent_pos")] == [(41 + 7,), (18 + 1,)]
    for each in (env, pictures):
        each.close()


@pytest.mark.rendering
def test_depth_and_segmentation_come_beside_the_pixels():
    env = FrankaOpenCabinetEnv(obs_type="pixels", depth=True, segmentation=True, **PIXELS)
    observation = steps(env, 1)[-1]
    assert observation in env.observation_space
    shapes = {name: (array.shape, array.dtype) for name, array in observation.items()}
    expected = {"depth": ((24, 32, 1), np.float32), "segmentation": ((24, 32, 2), np.int32)}
    assert shapes == {"pixels": ((24, 32, 3), np.uint8), **expected}
    physics = env.environment.physics
    assert_same(observation["depth"][..., 0], physics.render(24, 32, camera_id="overview", depth=True))
    assert_same(observation["segmentation"], physics.render(24, 32, camera_id="overview", segmentation=True))
    two = FrankaOpenCabinetEnv(obs_type="pixels_agent_pos", cameras=["overview", "handle"], depth=True, **PIXELS)
    assert set(two.observation_space) == {"pixels", "depth", "agent_pos"}
    assert list(two.observation_space["depth"]) == ["overview", "handle"]
    env.close()


@pytest.mark.rendering
def test_objects_are_seen_where_the_parameters_of_cameras_project_them():
    geoms = {"overview": "kettle/grip_visual", "left": "kettle/grip_visual", "franka/hand": "franka/left_finger_visual"}
    env = FrankaKitchenEnv(
        obs_type="pixels", cameras=[*geoms], segmentation=True, image_size=(96, 128), render_quality="fast"
    )
    segmentation = steps(env, 2)[-1]["segmentation"]
    model, data = env.environment.physics.model, env.environment.physics.data
    for camera, name in geoms.items():
        geom = model.geom(name).id
        parameters = env.camera_parameters(camera, 128, 96)
        column, row, depth = (
            parameters.intrinsics @ np.linalg.solve(parameters.world_from_camera, [*data.geom_xpos[geom], 1.0])[:3]
        )
        pixel = segmentation[camera.replace("/", "_")][round(row / depth), round(column / depth)]
        assert pixel.tolist() == [geom, mujoco.mjtObj.mjOBJ_GEOM]
    for arguments, shown in {
        ("overvew", 8, 8): ["'overvew'", "'overview'"],
        ("left", 8, 0): ["height", "0"],
        ("left", 8.5, 8): ["width", "8.5"],
    }.items():
        with refused((TypeError, ValueError), *shown):
            env.camera_parameters(*arguments)
    env.close()


@pytest.mark.rendering
def test_pictures_change_nothing_but_the_observation():
    plain, seeing = FrankaKitchenEnv(), FrankaKitchenEnv(obs_type="pixels_agent_pos", **PIXELS)
    plain.reset(seed=0)
    seeing.reset(seed=0)
    for action in np.random.default_rng(0).uniform(-1, 1, (5, 9)):
        one, other = plain.step(action), seeing.step(action)
        assert_same(one[1:], other[1:])
        assert_same(one[0]["observation"][:18], other[0]["agent_pos"])
    assert_same(plain.get_state(), seeing.get_state())
    achieved, desired = one[0]["achieved_goal"], one[0]["desired_goal"]
    assert plain.compute_reward(achieved, desired, other[4]) == one[1]
    seeing.close()


@pytest.mark.rendering
def test_copies_see_the_same():
    env = FrankaKitchenEnv(obs_type="pixels", **PIXELS)
    last = steps(env)[-1]
    twin = pickle.loads(pickle.dumps(env))
    assert_same(twin.set_state(env.get_state()), last)
    assert_same(twin.step(np.ones(9))[0], env.step(np.ones(9))[0])
    blind = FrankaKitchenEnv()
    blind.reset(seed=1)
    blind.set_state(twin.get_state())
    assert_same(blind.get_state(), env.get_state())
    for each in (env, twin):
        each.close()


@pytest.mark.rendering
def test_rendering_beside_observed_pictures_shows_the_same_scene():
    env = FrankaOpenCabinetEnv(
        obs_type="pixels", **PIXELS, render_mode="rgb_array", camera_name="overview", width=32, height=24
    )
    for _ in range(2):
        for observation in steps(env, 2):
            assert observation.std() > 10
        # Two renderers with other settings of anti-aliasing draw the same edges to within a pixel.
        assert np.abs(env.render().astype(int) - observation).mean() < 8
    env.close()
    assert_same(steps(env, 2)[-1], observation)
    env.close()


@pytest.mark.rendering
def test_pictures_of_a_user_s_own_policy_are_those_of_the_suite():
    env = FrankaKitchenEnv(["kettle"], obs_type="pixels", cameras=("franka/hand",), **PIXELS)
    generator = np.random.Generator(np.random.PCG64(np.random.SeedSequence(5)))
    options = {"random": np.random.RandomState(generator.bit_generator), "cameras": ["franka/hand"], **PIXELS}
    plain = suite.load("kitchen", "kettle", options)
    env.reset(seed=5)
    timestep = plain.reset()
    for _ in range(2):
        assert list(env.present_observation) == list(timestep.observation)
        assert_same(env.present_observation, dict(timestep.observation))
        env.step(np.full(9, 0.3))
        timestep = plain.step(np.full(9, 0.3))
    env.close()
