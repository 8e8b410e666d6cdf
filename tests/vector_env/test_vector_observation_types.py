"""Vectorised environments observe what the single ones do, of every type, to the bit."""

import gymnasium
import numpy as np
import pytest
import tree
from gymnasium.vector import AutoresetMode
from helpers.comparisons import assert_same
from helpers.open_cabinet import VARIED

from kitchen_suite import suite

pytestmark = pytest.mark.full

EXTRAS = ["franka/end_effector_pose", "franka/end_effector_velocity", "franka/gripper_width"]
PIXELS = {"image_size": [20, 28], "render_quality": "fast", "cameras": ["overview", "franka/hand"]}
TYPES = {
    "state": {"obs_type": "state", "extra_observables": EXTRAS},
    "parts": {"obs_type": "environment_state_agent_pos", "extra_observables": EXTRAS},
    "goal": {"extra_observables": ["kettle/handle_positions", *EXTRAS]},
    "pixels": {"obs_type": "pixels", **PIXELS, "depth": True, "segmentation": True},
    "pixels of one camera": {"obs_type": "pixels", "image_size": [20, 28], "render_quality": "fast"},
    "pixels_agent_pos": {"obs_type": "pixels_agent_pos", "extra_observables": EXTRAS, **PIXELS},
    "pixels and state": {"obs_type": "pixels_environment_state_agent_pos", "extra_observables": EXTRAS, **PIXELS},
}
DOMAINS = {"kitchen": {}, "open_cabinet": {"variations": VARIED}, "microwave_table": {}, "kitchens": {}}
COUNT, EPISODE = 3, 3
# Every type, each domain with numbers and with pictures.
IN_EVERY_RUN = {
    *(("kitchen", name) for name in ("goal", "pixels of one camera")),
    *(("open_cabinet", name) for name in ("parts", "pixels")),
    *(("microwave_table", name) for name in ("state", "pixels and state")),
    *(("kitchens", name) for name in ("parts", "pixels_agent_pos")),
}


def row(observations, i):
    return tree.map_structure(lambda array: array[i].copy(), observations)


def cases():
    for name, settings in TYPES.items():
        for domain in DOMAINS if name != "goal" else ["kitchen"]:
            marks = [pytest.mark.rendering] if name.startswith("pixels") else []
            # The same code runs for all domains.
            if (domain, name) not in IN_EVERY_RUN:
                marks.append(pytest.mark.nightly)
            yield pytest.param(domain, settings, id=f"{domain} {name}", marks=marks)


def make(domain, mode, **settings):
    arguments = {"max_episode_steps": EPISODE, **DOMAINS[domain], **settings}
    env_id = suite.DOMAINS[domain].env_id
    many = gymnasium.make_vec(
        env_id, COUNT, vectorization_mode="vector_entry_point", autoreset_mode=mode, num_threads=1, **arguments
    )
    return many, [gymnasium.make(env_id, **arguments).unwrapped for _ in range(COUNT)]


def assert_rows(observations, expected):
    for i, observation in enumerate(expected):
        assert_same(row(observations, i), observation)


@pytest.mark.parametrize(("domain", "settings"), [*cases()])
def test_observations_equal_those_of_the_single_environments(domain, settings):
    many, singles = make(domain, AutoresetMode.SAME_STEP, **settings)
    observations, _ = many.reset(seed=4)
    assert observations in many.observation_space
    assert_rows(observations, [env.reset(seed=4 + i)[0] for i, env in enumerate(singles)])
    kept, copied = observations, row(observations, 0)
    steps = [0] * COUNT
    for step in range(5):
        actions = np.random.default_rng(step).uniform(-0.5, 0.5, many.action_space.shape)
        observations, *_, infos = many.step(actions)
        expected = []
        for i, env in enumerate(singles):
            observation, _, terminated, *_ = env.step(actions[i])
            steps[i] += 1
            # The fast motions of some starts terminate the cabinet's episodes before their limit.
            if terminated or steps[i] == EPISODE:
                assert_same(infos["final_obs"][i], observation)
                observation, _ = env.reset()
                steps[i] = 0
            expected.append(observation)
        assert_rows(observations, expected)
    # Observations returned before stay as they were.
    assert_same(row(kept, 0), copied)
    for env in (many, *singles):
        env.close()


@pytest.mark.rendering
@pytest.mark.parametrize(
    "mode",
    [pytest.param(AutoresetMode.NEXT_STEP, marks=pytest.mark.nightly), AutoresetMode.DISABLED],
    ids=lambda mode: mode.value,
)
def test_pictures_follow_the_autoreset_mode(mode):
    settings = {"obs_type": "pixels_agent_pos", "extra_observables": EXTRAS, **PIXELS}
    many, singles = make("microwave_table", mode, **settings)
    many.reset(seed=4)
    for i, env in enumerate(singles):
        env.reset(seed=4 + i)
    actions = np.full(many.action_space.shape, 0.3)
    many.step(actions)
    expected = [env.step(actions[0])[0] for env in singles]
    if mode == AutoresetMode.DISABLED:
        # The episode of environment 1 starts later than the others.
        expected[1], _ = singles[1].reset(seed=11)
        mask = np.array([False, True, False])
        observations, _ = many.reset(seed=[None, 11, None], options={"reset_mask": mask})
        assert_rows(observations, expected)
    for _ in range(EPISODE - 1):
        observations, *_ = many.step(actions)
        expected = [env.step(actions[0])[0] for env in singles]
        assert_rows(observations, expected)
    if mode == AutoresetMode.NEXT_STEP:
        observations, *_ = many.step(actions)
        assert_rows(observations, [env.reset()[0] for env in singles])
    for env in (many, *singles):
        env.close()


@pytest.mark.rendering
def test_only_episodes_that_moved_are_rendered_again(monkeypatch):
    many, singles = make(
        "open_cabinet", AutoresetMode.SAME_STEP, obs_type="pixels", image_size=[20, 28], render_quality="fast"
    )
    shown = []
    show = many._episodes.show
    monkeypatch.setattr(many._episodes, "show", lambda i: (shown.append(i), show(i)))
    many.reset(seed=0)
    _ = many.present_observation
    assert shown == [0, 1, 2]
    for _ in range(EPISODE):
        many.step(np.zeros(many.action_space.shape))
    assert shown == [0, 1, 2] * (EPISODE + 2)
    for env in (many, *singles):
        env.close()


def test_the_present_observation_is_the_one_that_the_step_returned():
    many, singles = make("open_cabinet", AutoresetMode.SAME_STEP, extra_observables=EXTRAS)
    returned, _ = many.reset(seed=0)
    for i, env in enumerate(singles):
        env.reset(seed=i)
    for step in range(EPISODE - 1):
        assert_same(np.concatenate([*many.present_observation.values()], axis=-1), returned)
        assert_rows(many.present_observation, [env.present_observation for env in singles])
        actions = np.random.default_rng(step).uniform(-0.5, 0.5, many.action_space.shape)
        returned, *_ = many.step(actions)
        for env, action in zip(singles, actions, strict=True):
            env.step(action)


@pytest.mark.parametrize("camera", ["overview", "franka/hand"])
def test_the_parameters_of_cameras_are_those_of_the_single_environments(camera):
    many, singles = make("kitchen", AutoresetMode.SAME_STEP, variations=["camera"])
    with pytest.raises(gymnasium.error.ResetNeeded):
        many.camera_parameters(camera, 64, 48)
    many.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1, 1, many.action_space.shape)
    many.step(actions)
    expected = []
    for i, env in enumerate(singles):
        env.reset(seed=i)
        env.step(actions[i])
        expected.append(env.camera_parameters(camera, 64, 48))
    found = many.camera_parameters(camera, 64, 48)
    assert_rows(found._asdict(), [each._asdict() for each in expected])
    assert len(np.unique(found.world_from_camera, axis=0)) == COUNT


def test_extra_observables_leave_the_trajectories_of_the_batch_as_they_are():
    plain, _ = make("kitchen", AutoresetMode.SAME_STEP)
    observing, _ = make("kitchen", AutoresetMode.SAME_STEP, **TYPES["goal"])
    plain.reset(seed=0)
    observing.reset(seed=0)
    for step in range(6):
        actions = np.random.default_rng(step).uniform(-1, 1, plain.action_space.shape)
        one, other = plain.step(actions), observing.step(actions)
        assert_same(one[0]["observation"], other[0]["observation"][:, :59])
        assert_same(one[1:4], other[1:4])
