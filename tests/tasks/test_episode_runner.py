"""The life of an episode: one and many draw alike and in one order, and a batch refuses what it has not evaluated."""

import copy
import dataclasses

import gymnasium
import numpy as np
import pytest
from dm_control.composer.variation import distributions, noises
from helpers.errors import refused

from kitchen_suite import suite
from kitchen_suite.tasks import Observation, OpenCabinetTask
from kitchen_suite.tasks.episode.draws import BatchDraws, SingleDraws
from kitchen_suite.tasks.kitchen.mdp import KitchenMDP
from kitchen_suite.vector_env.episodes import Stream

SIZE = 7


def corrupt(values, random_state):
    return {name: value + random_state.normal(size=value.shape) for name, value in values.items()}


def test_many_draw_what_each_draws_alone():
    streams = [Stream(seed) for seed in range(4)]
    many = BatchDraws(streams, SIZE)
    single = [SingleDraws(Stream(seed).random_state) for seed in range(4)]
    values = {"a": np.arange(12.0).reshape(4, 3), "b": np.arange(4.0).reshape(4, 1)}
    generator = np.random.default_rng(0)
    for _ in range(20):
        many.rows = generator.random(4) < 0.7
        uniform, noise, noisy = many.uniform(), many.noise(SIZE).copy(), many.corrupted(values, corrupt)
        for i in np.flatnonzero(many.rows):
            assert uniform[i] == single[i].uniform()
            np.testing.assert_array_equal(noise[i], single[i].noise(SIZE))
            row = single[i].corrupted({name: value[i] for name, value in values.items()}, corrupt)
            for name, value in row.items():
                np.testing.assert_array_equal(noisy[name][i], value)
        for i in np.flatnonzero(~many.rows):
            # Nothing is drawn, and the values are without noise.
            np.testing.assert_array_equal(noisy["a"][i], values["a"][i])


class NoisyTask(OpenCabinetTask):
    """A task that draws in each way: its action, its noise, and the noise of an observation."""

    extra_observations = {
        "height": Observation(
            lambda simulation, state: simulation.named("site_xpos", "franka/gripper")[..., 2:],
            noise=noises.Additive(distributions.Uniform(-0.1, 0.1)),
        )
    }


@pytest.fixture
def noisy_domain():
    domain = dataclasses.replace(
        suite.DOMAINS["open_cabinet"],
        name="noisy_cabinet",
        task=NoisyTask,
        expert=None,
        env_id="Mine/NoisyCabinet-v1",
        task_id="Mine/Noisy{}-v1",
    )
    suite.register(domain)
    yield domain
    del suite._domains[domain.name]
    for env_id in {domain.env_id, *domain.task_ids.values()}:
        del gymnasium.registry[env_id]


@pytest.mark.full
def test_one_and_many_draw_in_one_order(noisy_domain, monkeypatch):
    calls = []
    for cls in (SingleDraws, BatchDraws):
        for name in ("uniform", "noise", "corrupted"):
            method = getattr(cls, name)
            monkeypatch.setattr(
                cls, name, lambda self, *given, method=method, name=name: calls.append(name) or method(self, *given)
            )

    def drawn(step):
        calls.clear()
        step()
        return tuple(calls)

    options = {"observation_noise": {"drawer_position": 0.01}}
    single = gymnasium.make(noisy_domain.env_id, **options).unwrapped
    many = gymnasium.make_vec(noisy_domain.env_id, 3, vectorization_mode="vector_entry_point", **options)
    action = np.zeros(single.action_space.shape)
    at_reset = drawn(lambda: single.reset(seed=0))
    assert at_reset == ("noise", "corrupted")
    assert drawn(lambda: many.reset(seed=0)) == at_reset * 3
    in_step = drawn(lambda: single.step(action))
    assert in_step == ("uniform", "noise", "corrupted")
    assert drawn(lambda: many.step(np.stack([action] * 3))) == in_step


@pytest.mark.parametrize("field", ["site_xpos", "cvel", "qfrc_bias"])
@pytest.mark.parametrize("reward", ["sparse", "dense"])
def test_an_observation_of_what_a_batch_has_not_evaluated_is_refused(monkeypatch, field, reward):
    own = KitchenMDP.observations.func

    def read(simulation, state):
        return simulation.read(field, np.array([0]))[..., 0].reshape(*state.positions.shape[:-1], -1)

    monkeypatch.setattr(KitchenMDP, "observations", property(lambda mdp: {**own(mdp), "another": Observation(read)}))
    environments = gymnasium.make_vec(
        "kitchen_suite:KitchenSuite/FrankaKitchen-v1", 2, vectorization_mode="vector_entry_point", reward=reward
    )
    # Rows that have just been started would have that of an earlier state, even where the sensors evaluate it.
    with refused(ValueError, field, "extra_observations", "sensors"):
        environments.reset(seed=0)


class EndingTask(OpenCabinetTask):
    """A task that ends its episode at the second control step."""

    extra_terminations = {"late": lambda step: np.abs(step.action[..., 0]) > 0.5}


def test_an_episode_that_continues_from_a_state_has_not_ended_by_what_the_one_before_did():
    domain = dataclasses.replace(suite.DOMAINS["open_cabinet"], name="ending", task=EndingTask, expert=None)
    environment = domain.load(random=0, visuals=False)
    size = environment.action_spec().shape[0]
    environment.reset()
    environment.step(np.zeros(size))
    state = environment.get_state()
    assert environment.step(np.eye(1, size)[0]).last()
    assert environment.task.runner.info(environment.task.episode)["termination/late"]
    environment.set_state(state)
    assert not environment.task.runner.info(environment.task.episode)["termination/late"]
    assert environment.step(np.zeros(size)).mid()


@pytest.mark.parametrize("domain", ["open_cabinet", "kitchens", "pick_and_place", "kitchen", "microwave_table"])
def test_a_copy_shows_success_as_the_original_does(domain):
    environment = suite.load(domain, suite.default_task(domain), {"random": 0}, visualize_reward=True)
    environment.reset()
    physics = environment.physics
    # Everything is opened as far as it goes.
    joints = [joint for prop in environment.task.scene.props.values() for joint in prop.joints if joint.tag == "joint"]
    for joint in joints:
        bound = physics.bind(joint)
        bound.qpos = bound.range[np.abs(bound.range).argmax()]
    physics.forward()
    environment.step(np.zeros(environment.action_spec().shape))
    copied = copy.deepcopy(environment)
    np.testing.assert_array_equal(copied.physics.model.geom_rgba, physics.model.geom_rgba)
    np.testing.assert_array_equal(copied.physics.model.mat_rgba, physics.model.mat_rgba)
