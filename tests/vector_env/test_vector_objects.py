"""Vectors of kitchens with objects: each row is the single environment of its design and seed, and that of dm_env."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from helpers.object_kitchen import ARGUMENTS
from helpers.sweeps import MODES
from helpers.vectors import assert_row, batch, play

from kitchen_suite import suite
from kitchen_suite.gymnasium_env.pick_and_place import PickAndPlaceEnv
from kitchen_suite.vector_env.pick_and_place import PickAndPlaceVectorEnv

VERBS = ("put_on", "put_in", "take_out", "open_and_put_in")
# Two kitchens with drawers and cabinets, of the split `train`; two environments of the first one.
DESIGNS, COUNT, SEED, LIMIT = (5, 7), 3, 11, 4

VARIATIONS = {
    "franka/joint_offset": {"uniform": [-0.05, 0.05]},
    "objects/displacement": {"uniform": [-0.02, 0.02]},
    "objects/mass_scale": {"uniform": [0.5, 1.5]},
    "objects/friction_scale": {"uniform": [0.8, 1.2]},
    "sensing/action_delay": {"choice": [0, 1]},
    "push/step": {"choice": [2, 3]},
    "push/joint_offsets": {"uniform": [-0.2, 0.2]},
}


def drawn_arguments(number):
    """Returns arguments of a task that a number draws."""
    random = np.random.default_rng(number)
    rewards = ("sparse", "dense", "dense_gain")
    names = [name for name in VARIATIONS if random.random() < 0.6]
    return {
        "verbs": tuple(verb for verb in VERBS if verb == "put_on" or random.random() < 0.6),
        "tasks_per_episode": (1, 2) if random.random() < 0.5 else 2,
        "reward": rewards[number % 3],
        "num_slots": int(random.integers(1, 17)),
        "control_mode": MODES["pick_and_place"][number % 6],
        "physics": "exact" if random.random() < 0.2 else "fast",
        "variations": {name: VARIATIONS[name] for name in names},
        "quality": bool(random.random() < 0.3),
        "robot_noise_ratio": float(random.uniform(0.0, 0.02)),
        "object_noise_ratio": float(random.uniform(0.0, 0.02)),
    }


def alone(count=COUNT, design=DESIGNS, **settings):
    return [PickAndPlaceEnv(design[i % len(design)], **settings) for i in range(count)]


@pytest.mark.full
@pytest.mark.parametrize("number", range(12))
def test_every_row_is_the_single_environment_with_random_arguments(number):
    settings = {**drawn_arguments(number), "max_episode_steps": LIMIT}
    mode = [*AutoresetMode][number % 3]
    env = PickAndPlaceVectorEnv(COUNT, design=DESIGNS, num_threads=1 + number % 2, autoreset_mode=mode, **settings)
    assert [rows.tolist() for rows in batch(env).rows] == [[0, 2], [1]]
    random = np.random.default_rng(number)
    # In the mode without autoreset, episodes in progress are reset as well.
    resets = (lambda ended: ended | (random.random(COUNT) < 0.2)) if mode == AutoresetMode.DISABLED else None
    play(env, alone(**settings), mode, 3 * LIMIT, seed=SEED, **({"resets": resets} if resets else {}))


def test_every_row_is_the_single_environment_in_a_kitchen_of_ones_own():
    settings = {**ARGUMENTS, "verbs": VERBS, "tasks_per_episode": 2, "reward": "dense", "max_episode_steps": LIMIT}
    env = PickAndPlaceVectorEnv(2, num_threads=1, autoreset_mode=AutoresetMode.SAME_STEP, **settings)
    play(env, [PickAndPlaceEnv(**settings) for _ in range(2)], AutoresetMode.SAME_STEP, 2 * LIMIT, seed=SEED)


@pytest.mark.full
@pytest.mark.parametrize("number", range(6))
def test_the_environment_of_dm_env_is_the_single_one(number):
    arguments = {**drawn_arguments(number), "design": DESIGNS[number % 2]}
    env = PickAndPlaceEnv(**arguments)
    observation, _ = env.reset(seed=SEED)
    generator = np.random.Generator(np.random.PCG64(np.random.SeedSequence(SEED)))
    random = np.random.RandomState(generator.bit_generator)
    plain = suite.pick_and_place(**arguments, visuals=False, random=random)
    timestep = plain.reset()
    for action in np.random.default_rng(number).uniform(-1.0, 1.0, (3 * LIMIT, *env.action_space.shape)):
        assert plain.task.requested_tasks == env.composer_task.requested_tasks
        np.testing.assert_array_equal(observation, np.concatenate([*timestep.observation.values()]))
        observation, reward, terminated, *_ = env.step(action.astype(np.float32))
        timestep = plain.step(action.astype(np.float32))
        assert (reward, terminated) == (timestep.reward, timestep.last())


COPIES = {"deepcopy": copy.deepcopy, "pickle": lambda environment: pickle.loads(pickle.dumps(environment))}


@pytest.mark.full
@pytest.mark.parametrize("copied", COPIES.values(), ids=COPIES)
@pytest.mark.parametrize("reward", ["sparse", "dense"])
def test_a_copy_in_mid_episode_continues_to_the_bit(copied, reward):
    arguments = {**ARGUMENTS, "tasks_per_episode": 2, "verbs": VERBS, "reward": reward, "variations": VARIATIONS}
    one = PickAndPlaceEnv(**arguments)
    one.reset(seed=SEED)
    actions = np.random.default_rng(0).uniform(-1, 1, (8, 9)).astype(np.float32)
    for action in actions[:4]:
        one.step(action)
    other = copied(one)
    for action in actions[4:]:
        np.testing.assert_equal(other.step(action), one.step(action))
    np.testing.assert_equal(other.reset(), one.reset())
    np.testing.assert_equal(other.step(actions[0]), one.step(actions[0]))


def test_a_request_of_each_row_is_followed():
    env = PickAndPlaceVectorEnv(2, num_threads=1, verbs=VERBS, **ARGUMENTS)
    asked = [["put_on mug tray"], ["take_out can drawers_1/drawer_1"]]
    env.reset(seed=0, options={"requested_tasks": asked})
    single = PickAndPlaceEnv(verbs=VERBS, **ARGUMENTS)
    for i, tasks in enumerate(asked):
        single.reset(seed=i, options={"requested_tasks": tasks})
        assert env.instruction[i] == single.instruction
    result, expected = env.step(np.zeros((2, 9), np.float32)), single.step(np.zeros(9, np.float32))
    assert_row(result, 1, expected)


@pytest.mark.full
def test_layouts_of_several_designs_are_drawn_by_each():
    envs = gymnasium.make_vec("KitchenSuite/PickAndPlace-v1", 4, "vector_entry_point", design=range(4), num_threads=1)
    templates = [envs.unwrapped.template_of(i).composer_task.scene for i in range(4)]
    assert len({scene.layout for scene in templates}) == 4
    for number, scene in enumerate(templates):
        assert PickAndPlaceEnv(number).composer_task.scene.layout == scene.layout
