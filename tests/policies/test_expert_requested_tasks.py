"""The kitchen's expert where episodes ask for some of the configured tasks."""

import numpy as np
import pytest
from helpers.episodes import play_expert
from helpers.errors import refused
from helpers.sweeps import brief

from kitchen_suite import suite
from kitchen_suite.commands import record
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.policies.experts.kitchen import KitchenExpert
from kitchen_suite.tasks import DEFAULT_TASKS


@pytest.mark.full
@pytest.mark.parametrize("seed", brief(range(8), [0, 2]))
def test_the_expert_does_the_tasks_asked_and_no_others(seed):
    environment = suite.load("kitchen", "random_4", task_kwargs={"random": seed, "visuals": False})
    play_expert(environment)
    task = environment.task
    assert {*task.completion_steps} == {*task.requested_tasks}
    others = [name not in task.requested_tasks for name in DEFAULT_TASKS]
    assert (task.task_distances[others] > task.threshold).all()


@pytest.mark.full
def test_in_order_is_the_configured_order_and_flat_observations_do():
    environment = suite.load(
        "kitchen",
        "random_2",
        task_kwargs={"random": 1, "visuals": False, "tasks_to_complete": ["light switch", "kettle"]},
        environment_kwargs={"flat_observation": True},
    )
    play_expert(environment, in_order=True)
    assert [*environment.task.completion_steps] == ["light switch", "kettle"]


@pytest.mark.full
@pytest.mark.parametrize("seed", brief(range(8), [1]))
def test_the_expert_does_tasks_asked_in_turn_in_the_order_asked(seed):
    arguments = {"random": seed, "visuals": False, "tasks_in_turn": True}
    environment = suite.load("kitchen", "random_4", task_kwargs=arguments)
    play_expert(environment)
    assert [*environment.task.completion_steps] == environment.task.requested_tasks


def test_bad_settings_are_refused():
    with refused(TypeError, "observes_requests"):
        KitchenExpert(["kettle"], observes_requests=1)
    with refused(ValueError, "(60,)"):
        KitchenExpert(["kettle"], observes_requests=True).act(np.zeros(59))


@pytest.mark.full
def test_vectorised_recordings_of_the_expert(tmp_path):
    arguments = ["--task_name=random_1", "--policy=expert", "--num_episodes=3", "--num_envs=2", "--num_threads=1"]
    assert record.main([f"--output={tmp_path}/runs", *arguments]) == 0
    folder = Recording.open(tmp_path / "runs")
    for index in folder.indices:
        infos = folder.load(index).last_info
        assert infos["is_success"]
        np.testing.assert_array_equal(infos["episode_task_completions_mask"], infos["requested_tasks_mask"])
