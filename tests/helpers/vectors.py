"""Vectorised environments: rows of what they return, and their inside, which no public name reaches."""

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode


def many(env_id, count, **settings):
    """Returns environments that are stepped together, as Gymnasium makes them."""
    return gymnasium.make_vec(env_id, count, vectorization_mode="vector_entry_point", **settings)


def batch(env):
    """Returns the simulations of a vectorised environment, with live arrays such as `qvel`."""
    return env.unwrapped._episodes.batch


def part(value, i):
    """Returns the row of environment `i` of nested arrays with a leading axis."""
    return {key: part(inner, i) for key, inner in value.items()} if isinstance(value, dict) else value[i]


def row(value, i):
    """Returns what the infos of environment `i` are without those of the others, and without masks."""
    if isinstance(value, dict):
        return {key: row(part, i) for key, part in value.items() if not key.startswith("_")}
    return value[i]


def assert_row(result, i, expected):
    """Checks observation, numbers and infos of environment `i`."""
    (observation, *numbers, infos), (single, *single_numbers, single_infos) = result, expected
    np.testing.assert_array_equal(observation[i], single)
    assert [array[i] for array in numbers] == single_numbers
    present = row(infos, i)
    np.testing.assert_equal({key: present[key] for key in single_infos}, single_infos)


def play(env, singles, mode, steps, *, seed, resets=lambda ended: ended):
    """Compares a vector with single environments of the next seeds in random steps, with an autoreset mode's resets.

    `resets` returns the mask of a reset by hand, given which episodes have ended.
    """
    random = np.random.default_rng(0)
    started, ended = env.reset(seed=seed), np.zeros(env.num_envs, bool)
    for i, single in enumerate(singles):
        assert_row(started, i, single.reset(seed=seed + i))
    for _ in range(steps):
        if mode == AutoresetMode.DISABLED and (mask := resets(ended)).any():
            started = env.reset(options={"reset_mask": mask})
            for i in np.flatnonzero(mask):
                assert_row(started, i, singles[i].reset())
            ended = ended & ~mask
        actions = random.uniform(-1.0, 1.0, env.action_space.shape).astype(np.float32)
        result = env.step(actions)
        for i, single in enumerate(singles):
            if ended[i] and mode == AutoresetMode.NEXT_STEP:
                observation, infos = single.reset()
                assert_row(result, i, (observation, 0.0, False, False, infos))
                continue
            observation, reward, terminated, truncated, infos = single.step(actions[i])
            if (terminated or truncated) and mode == AutoresetMode.SAME_STEP:
                np.testing.assert_array_equal(result[-1]["final_obs"][i], observation)
                assert_row((result[0], result[-1]["final_info"]), i, (result[0][i], infos))
                observation, infos = single.reset()
            assert_row(result, i, (observation, reward, terminated, truncated, infos))
        ended = result[2] | result[3]
        assert env.instruction == env.get_attr("task") == tuple(single.instruction for single in singles)
        assert env.get_attr("instructions") == tuple(single.instructions for single in singles)
    return ended
