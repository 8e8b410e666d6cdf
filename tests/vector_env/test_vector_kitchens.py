"""Vectors of generated kitchens of several designs: each row is the single environment of its design and seed."""

import threading

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from helpers.errors import refused
from helpers.vectors import assert_row, batch, play
from mujoco.batch import Batch

from kitchen_suite.entities.joints import addresses
from kitchen_suite.environment.seeds import EpisodeSeeds
from kitchen_suite.gymnasium_env.generated_kitchens import GeneratedKitchenEnv
from kitchen_suite.gymnasium_env.open_cabinet import FrankaOpenCabinetEnv
from kitchen_suite.vector_env.episodes import BatchEpisodes
from kitchen_suite.vector_env.generated_kitchens import GeneratedKitchenVectorEnv

VERBS = ("open", "close", "turn_on", "turn_off", "move_kettle")
# Two environments of the first design, which share a batch with the fifth.
DESIGNS, COUNT, SEED, LIMIT = (0, 3, 0, 7), 5, 11, 4

# All that an episode may hold, in a mode that reads poses of the hand from the physics.
EVERYTHING = {
    "reward": "dense",
    "num_slots": 3,
    "tasks_per_episode": (1, 3),
    "control_mode": "ee_delta_pose",
    "variations": {
        "franka/joint_offset": {"uniform": [-0.05, 0.05]},
        "fixtures/friction_scale": {"uniform": [0.8, 1.2]},
        "sensing/action_delay": {"choice": [0, 1]},
        "push/step": {"choice": [2, 3]},
        "push/joint_offsets": {"uniform": [-0.2, 0.2]},
    },
    "extra_observables": ["franka/end_effector_pose"],
}
# Cameras move, but are no part of the state of the physics.
SEEN = {"variations": ["camera"], "verbs": ["open"]}


def many(count=COUNT, design=DESIGNS, **settings):
    return GeneratedKitchenVectorEnv(count, design=design, **{"verbs": VERBS, "num_threads": 1, **settings})


def alone(count=COUNT, design=DESIGNS, **settings):
    return [GeneratedKitchenEnv(design[i % len(design)], **{"verbs": VERBS, **settings}) for i in range(count)]


@pytest.mark.full
def test_every_row_of_sixteen_designs_is_the_single_environment_of_its_design_and_seed():
    settings = {"verbs": VERBS, "max_episode_steps": 6}
    env = gymnasium.make_vec(
        "KitchenSuite/Kitchens-v1", 20, "vector_entry_point",
        autoreset_mode="Disabled", num_threads=2, design=range(16), **settings,
    )  # fmt: skip
    assert [part.nsim for part in batch(env).batches] == [2] * 4 + [1] * 12
    random = np.random.default_rng(1)
    mode, singles = AutoresetMode.DISABLED, alone(20, range(16), **settings)
    play(env.unwrapped, singles, mode, 16, seed=SEED, resets=lambda ended: ended | (random.random(20) < 0.1))


@pytest.mark.full
@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("threads", [1, 5])
def test_every_row_is_the_single_environment_with_all_that_an_episode_may_hold(mode, threads):
    settings = {**EVERYTHING, "max_episode_steps": LIMIT}
    env = many(autoreset_mode=mode, num_threads=threads, **settings)
    assert [rows.tolist() for rows in batch(env).rows] == [[0, 2, 4], [1], [3]]
    play(env, alone(**settings), mode, 3 * LIMIT, seed=SEED)


@pytest.mark.full
def test_threads_share_the_designs_and_an_error_in_one_of_them_is_raised():
    joined, both, raised = batch(many(4, range(4), num_threads=2)), threading.Barrier(2, timeout=20), threading.Event()
    # It would time out if one thread made all calls.
    joined.call(lambda part, mask: both.wait(), None)
    called = []

    def fail_in_the_other_thread(part, mask):
        called.append(part)
        if threading.current_thread() is not threading.main_thread():
            raised.set()
            raise ValueError("in a thread")
        assert raised.wait(20)

    with pytest.raises(ValueError, match="in a thread"):
        joined.call(fail_in_the_other_thread, None)
    assert len(called) == 4


@pytest.mark.full
def test_after_an_error_no_other_call_begins():
    joined, called = batch(many(3, range(3))), []

    def fail(part, mask):
        called.append(part)
        raise ValueError("at once")

    with pytest.raises(ValueError, match="at once"):
        joined.call(fail, None)
    assert called == [joined.batches[0]]


@pytest.mark.full
def test_one_design_however_often_has_one_batch():
    assert isinstance(batch(many(3, [2, 2, 2])), Batch)
    assert isinstance(batch(many(1, range(100))), Batch)


@pytest.mark.full
def test_a_reset_asks_each_kitchen_for_tasks_of_its_own():
    env = many(2, ["0", "7"])
    tasks = [env.template_of(i).composer_task.requests.tasks for i in range(2)]
    asked = [[next(task for task in tasks[i] if task not in tasks[1 - i])] for i in range(2)]
    env.reset(seed=0, options={"requested_tasks": asked})
    singles = alone(2, [0, 7])
    for i, single in enumerate(singles):
        single.reset(seed=i, options={"requested_tasks": asked[i]})
    assert env.instruction == tuple(single.instruction for single in singles)
    with refused(ValueError, "requested_tasks"):
        env.reset(options={"requested_tasks": asked[::-1]})
    assert env.instruction == tuple(single.instruction for single in singles)


@pytest.mark.full
def test_where_a_simulation_diverges_only_its_own_episode_ends():
    env, twin = many(), many()
    env.reset(seed=SEED)
    twin.reset(seed=SEED)
    actions = np.zeros(env.action_space.shape, np.float32)
    batch(env).batches[0].qvel[1] = np.nan
    observations, rewards, terminations, _, infos = env.step(actions)
    expected = twin.step(actions)
    others = [0, 1, 3, 4]
    assert terminations.tolist() == infos["physics_error"].tolist() == [i == 2 for i in range(COUNT)]
    np.testing.assert_array_equal(observations[others], expected[0][others])
    np.testing.assert_array_equal(rewards[others], expected[1][others])
    assert infos["episode_step"].tolist() == [1, 1, 0, 1, 1]


@pytest.mark.full
@pytest.mark.rendering
def test_pictures_are_those_of_each_kitchen():
    settings = {"obs_type": "pixels", "cameras": ["overview"], "image_size": (32, 48), **SEEN}
    settings |= {"render_mode": "rgb_array", "width": 64, "height": 48, "render_quality": "fast"}
    env, singles = many(3, **settings), alone(3, **settings)
    observations, _ = env.reset(seed=SEED)
    actions = np.ones(env.action_space.shape, np.float32)
    for step in range(2):
        for i, single in enumerate(singles):
            if step:
                observation, *_ = single.step(actions[i])
            else:
                observation, _ = single.reset(seed=SEED + i)
            np.testing.assert_array_equal(observations[i], observation)
            np.testing.assert_array_equal(env.render_some([i])[0], single.render())
            parameters = single.camera_parameters("overview", 48, 32)
            present = env.camera_parameters("overview", 48, 32)
            np.testing.assert_array_equal(present.world_from_camera[i], parameters.world_from_camera)
        observations, *_ = env.step(actions)
    assert len(np.unique(observations, axis=0)) == 3
    env.close()


@pytest.mark.full
@pytest.mark.parametrize(
    ("design", "error", "message"),
    [
        ([], ValueError, "design must have at least one design"),
        ([0, -1], ValueError, "design[1]: design must be"),
        (["missing.json"], ValueError, "'missing.json'"),
        ([0, {"counter_height": 1.6, "style": "white", "rows": [{"side": "front"}]}], ValueError, "design[1]: rows[0]"),
    ],
    ids=["empty", "negative", "file", "JSON"],
)
def test_a_bad_design_of_several_is_named_by_its_place(design, error, message):
    with refused(error, message):
        many(2, design)


@pytest.mark.full
def test_extra_observables_that_kitchens_do_not_share_are_refused():
    with refused(ValueError, "design[1]: extra_observables have other sizes than in design[0]"):
        many(2, [2, 3], extra_observables=["wall_doors_1/handle_positions"])
    with refused(ValueError, "design[1]: extra observable 'kettle/pose' does not exist"):
        many(2, [0, 1], extra_observables=["kettle/pose"])


def test_environments_whose_robots_have_other_indices_are_refused():
    kitchen, cabinet = GeneratedKitchenEnv(0, verbs=VERBS), FrankaOpenCabinetEnv()
    with refused(ValueError, "the robot must be attached before anything that differs"):
        BatchEpisodes([kitchen.environment, cabinet.environment], 1, EpisodeSeeds(episode_seeds=False))


@pytest.mark.full
@pytest.mark.parametrize("physics", ["exact", "fast"])
def test_pushes_undo_parts_of_several_kitchens_as_in_single_ones(physics):
    push = {"push/step": {"choice": [2, 3]}, "push/undoes": 1, "push/which": {"uniform": [0, 1]}}
    settings = {"variations": push, "verbs": ("open", "turn_on"), "tasks_per_episode": 2, "reward": "dense"}
    env, singles = many(physics=physics, **settings), alone(physics=physics, **settings)
    env.reset(seed=SEED)
    asked = []
    for i, single in enumerate(singles):
        single.reset(seed=SEED + i)
        task, physics_of_row = single.composer_task, single.environment.physics
        asked.append(task.state.requested)
        for slot in np.flatnonzero(task.state.requested):
            columns = addresses(physics_of_row, task.mdp.task_joints(task.scene)[slot])[0]
            _, part = task.scene.parts[slot]
            values = [part.opened, part.opened * part.ratio][: columns.size]
            physics_of_row.data.qpos[columns] = values
            # After the time come the positions.
            batch(env).state[i][1 + columns] = values
        task.simulation.evaluate()
    actions = np.zeros(env.action_space.shape)
    open_parts = []
    for _ in range(5):
        result = env.step(actions)
        for i, single in enumerate(singles):
            assert_row(result, i, single.step(actions[i]))
        openings = result[-1]["openings"]
        open_parts.append([int((openings[i] > 0.75)[asked[i]].sum()) for i in range(COUNT)])
    # A push undoes one of two.
    assert open_parts[1] == [2] * COUNT
    assert open_parts[-1] == [1] * COUNT
