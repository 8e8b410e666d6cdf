"""Recorded physics states: from them everything that an environment measures can be computed again."""

import contextlib

import numpy as np
import pytest
import tree
from helpers.episodes import assert_same_arrays, played_together, rollout_of

from kitchen_suite.episodes.episode import PHYSICS_STATE, Episode
from kitchen_suite.episodes.replay import compare, replay_episode
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies import PolicyRef

LIMIT, COUNT = 8, 3
CASES = {
    "kitchen": ("kitchen", "random_2", {"variations": ["start", "push"]}),
    "kitchen, fast": ("kitchen", "kettle", {"physics": "fast"}),
    "open_cabinet": ("open_cabinet", "top_drawer", {"variations": ["dynamics"]}),
    "kitchens": ("kitchens", "any_2", {}),
}


def spec_of(domain_name, task_name, task_kwargs):
    environments = EnvironmentSpec.make(domain_name, task_name, task_kwargs, LIMIT)
    return environments.episodes(PolicyRef.parse("random"), seed=3)


@pytest.fixture(params=CASES.values(), ids=CASES)
def spec(request):
    return spec_of(*request.param)


@pytest.mark.full
def test_one_environment_and_many_record_the_same_states(spec):
    played = played_together(spec, COUNT, 2)
    with contextlib.closing(spec.make_environment()) as environment:
        for episode in played.values():
            states = episode.arrays[PHYSICS_STATE]
            model = suite_env(environment).environment.physics.model
            assert (states.shape, states.dtype) == ((episode.steps + 1, model.nq + model.nv + model.na), np.float64)
            assert_same_arrays(replay_episode(environment, episode, spec.seeding).arrays, episode.arrays)


@pytest.mark.full
def test_sensors_read_the_same_in_a_recorded_state(spec):
    rollout = rollout_of(spec)
    with contextlib.closing(rollout.environment):
        environment, readings = suite_env(rollout.environment), []

        def read():
            task = environment.composer_task
            reading = task.mdp.sensors.read(task.simulation)
            return [np.array(part) for part in tree.flatten(getattr(reading, "values", reading)) if part is not None]

        episode = rollout.play(0, 3, lambda buffer, environment: readings.append(read()))
        physics = environment.environment.physics
        for state, reading in zip(episode.arrays[PHYSICS_STATE], readings, strict=True):
            with physics.reset_context():
                physics.set_state(state)
            np.testing.assert_array_equal(environment.physics_state, state)
            for one, other in zip(read(), reading, strict=True):
                np.testing.assert_array_equal(one, other)


def test_the_observation_without_noise_is_that_of_the_recorded_state():
    kwargs = {"robot_noise_ratio": 0.0, "object_noise_ratio": 0.0}
    rollout = rollout_of(spec_of("kitchen", "kettle", kwargs))
    with contextlib.closing(rollout.environment):
        episode = rollout.play(0, 3)
        states, observations = episode.arrays[PHYSICS_STATE], episode.arrays["observation/observation"]
        physics = suite_env(rollout.environment).environment.physics
        parts = suite_env(rollout.environment).composer_task.mdp.sensors.slices
        nq = physics.model.nq
        np.testing.assert_array_equal(observations[:, parts.robot_positions], states[:, :9])
        np.testing.assert_array_equal(observations[:, parts.robot_velocities], states[:, nq : nq + 9])


def test_recordings_without_states_play_again_with_no_difference():
    spec = spec_of("open_cabinet", "top_drawer", {})
    rollout = rollout_of(spec)
    with contextlib.closing(rollout.environment) as environment:
        episode = rollout.play(0, 3)
        arrays = {name: array for name, array in episode.arrays.items() if name != PHYSICS_STATE}
        older = Episode(index=0, seed=3, arrays=arrays)
        older.check()
        task = suite_env(environment).composer_task
        comparison = compare(task, older, replay_episode(environment, older, spec.seeding), spec.task_name)
        assert comparison.verdict == "equal"
        states = episode.arrays[PHYSICS_STATE].copy()
        states[-1, -1] += 1e-12
        changed = Episode(index=0, seed=3, arrays={**arrays, PHYSICS_STATE: states})
        comparison = compare(task, changed, replay_episode(environment, changed, spec.seeding), spec.task_name)
        assert comparison.arrays == (PHYSICS_STATE,)
