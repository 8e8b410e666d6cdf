"""Arguments of the environments that are trained in, which those that policies are evaluated in do not have."""

import json
import pathlib
import re

import numpy as np
import pytest

from kitchen_suite import suite
from kitchen_suite.training.recipes import find_recipe

pytestmark = pytest.mark.clients

KETTLE = ["--domain_name=kitchen", "--task_name=kettle"]


def description():
    """The description of the run."""
    return json.loads(pathlib.Path("runs", "training.json").read_text())


def task_of(environments):
    return environments.composer_task


def length_of(environments):
    return environments.template_env.max_episode_steps


def test_the_kitchen_is_trained_with_a_dense_reward_and_evaluated_with_its_own(prepared):
    learner, evaluated = prepared(*KETTLE)
    trained = learner.environments
    assert set(task_of(trained).mdp.rewards) == {"approach", "progress", "completion"}
    assert set(task_of(evaluated).mdp.rewards) == {"completion"}
    assert [task_of(each).scene.physics for each in (trained, evaluated)] == ["fast", "exact"]
    # Both have the same length, and the spaces of the policy.
    assert [length_of(each) for each in (trained, evaluated)] == [100, 100]
    assert trained.single_observation_space == evaluated.single_observation_space
    assert description()["task_kwargs"] == {}
    assert description()["training_kwargs"] == json.loads(json.dumps(find_recipe("kitchen").options))


def test_evaluations_begin_at_the_original_start_where_training_varies(prepared):
    learner, evaluated = prepared(
        *KETTLE, '--training_kwargs={"variations": {"microwave/door": -0.2}, "physics": "exact"}'
    )
    _, varied = learner.environments.reset(seed=0)
    _, info = evaluated.reset(seed=0)
    np.testing.assert_array_equal(varied["variation_values"]["microwave/door"], [-0.2, -0.2])
    assert "variation_values" not in info
    # They replace some of the domain's.
    assert description()["training_kwargs"]["reward"] == "dense_gain"
    assert description()["training_kwargs"]["physics"] == "exact"


@pytest.mark.parametrize("physics", ["exact", "fast"])
def test_the_physics_of_the_task_is_that_of_training_too(prepared, physics):
    learner, evaluated = prepared(*KETTLE, f"--physics={physics}")
    assert "physics" not in description()["training_kwargs"]
    assert description()["task_kwargs"] == {"physics": physics}
    for environments in (learner.environments, evaluated):
        assert task_of(environments).scene.physics == physics


def test_arguments_of_the_task_are_those_of_training_too(prepared):
    learner, evaluated = prepared(*KETTLE, "--variations=dynamics", '--task_kwargs={"reward": "dense"}')
    assert description()["training_kwargs"].keys() == {"max_episode_steps", "physics"}
    for environments in (learner.environments, evaluated):
        assert "kettle/mass" in environments.reset(seed=0)[1]["variation_values"]
        assert task_of(environments).mdp.terminate_on_tasks_completed is False


def test_drawers_are_ajar_in_training_alone(prepared):
    learner, evaluated = prepared()
    trained = learner.environments
    openings = np.array([trained.reset(seed=s)[1]["variation_values"]["cabinet/drawer_top"] for s in range(10)])
    assert set(openings.flatten().tolist()) > {0.0, 0.08}
    assert "variation_values" not in evaluated.reset(seed=0)[1]
    assert [length_of(each) for each in (trained, evaluated)] == [300, 300]


def test_a_domain_without_a_recipe_trains_in_the_environments_of_its_evaluations(prepared):
    learner, _ = prepared("--domain_name=microwave_table", "--task_name=open")
    assert description()["training_kwargs"] == {}
    assert length_of(learner.environments) == suite.DOMAINS["microwave_table"].episode_steps


BAD = {
    '{"control_mode": "joint_position"}': ["training_kwargs", "['control_mode']"],
    '{"extra_observables": ["kettle/pose"]}': ["training_kwargs", "['extra_observables']"],
    '{"max_episode_steps": 0}': ["max_episode_steps", "1"],
    '{"rewrad": "dense"}': ["'reward'"],
    '{"reward": "dens"}': ["'dense'"],
    "[1]": ["JSON object"],
}


@pytest.mark.parametrize("value", BAD)
def test_bad_arguments_of_training_are_refused_in_one_line(prepared, value):
    error = prepared(*KETTLE, f"--training_kwargs={value}", status=2)
    assert re.fullmatch(r"kitchen-train: [^\n]+\n", error)
    assert all(part in error for part in BAD[value]), error


def test_a_run_is_not_resumed_with_other_arguments_of_training(prepared):
    prepared(*KETTLE)
    error = prepared(*KETTLE, "--resume", '--training_kwargs={"reward": "dense"}', status=2)
    assert 'runs holds a training run with training_kwargs {"max_episode_steps": 100, "reward": "dense_gain"' in error


def test_episodes_begin_at_times_spread_over_the_length_of_training(prepared):
    learner, _ = prepared('--training_kwargs={"max_episode_steps": 6}')
    learner.start(0)
    # The steps 2 and 5 of six: the next one ends an episode.
    *_, infos = learner.environments.step(np.zeros(learner.environments.action_space.shape))
    assert sorted(infos["episode_step"]) == [0, 3]
