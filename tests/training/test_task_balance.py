"""Tasks drawn for each episode: those that succeed less are drawn more often in training."""

import copy

import numpy as np
import pytest
from helpers.training import SMALL, environments, learner

pytestmark = pytest.mark.clients

TASKS = ["kettle", "microwave"]


@pytest.fixture
def envs():
    made = environments(
        SMALL["num_envs"], domain="kitchen", tasks_to_complete=TASKS, tasks_per_episode=1, max_episode_steps=4
    )
    yield made
    made.close()


def infos_of(asked, completed):
    masks = {"requested_tasks_mask": asked, "episode_task_completions_mask": completed}
    return {name: np.array(mask, bool) for name, mask in masks.items()}


def test_the_weights_fall_with_the_success_of_a_task(envs):
    from kitchen_suite.training.ppo import TaskBalance

    task = envs.composer_task
    balance = TaskBalance.of(task)
    asked, completed = [[1, 0], [1, 0], [0, 1]], [[1, 0], [0, 0], [0, 1]]
    # The last episode has not ended.
    curves = balance.add(infos_of(asked, completed), np.array([True, True, False]))
    assert set(curves) == {"episode/success/kettle"}
    np.testing.assert_array_equal(curves["episode/success/kettle"], [1.0, 0.0])
    assert 0 < balance.success[0] < 0.05
    assert balance.success[1] == 0
    for _ in range(500):
        balance.add(infos_of([[1, 0], [0, 1]], [[1, 0], [0, 0]]), np.array([True, True]))
    np.testing.assert_allclose(task.task_weights, [0.05, 1.05], atol=1e-3)


def test_tasks_that_were_never_attempted_leave_the_balance_as_it_was(envs):
    from kitchen_suite.training.ppo import TaskBalance

    balance = TaskBalance.of(envs.composer_task)
    balance.success[:] = 0.5
    infos = {**infos_of([[1, 1]], [[1, 0]]), "attempted_tasks_mask": np.array([[True, False]])}
    assert set(balance.add(infos, np.array([True]))) == {"episode/success/kettle"}
    assert balance.success[0] > 0.5
    assert balance.success[1] == 0.5


def test_tasks_that_draw_nothing_have_no_balance():
    from kitchen_suite.training.ppo import TaskBalance

    for domain in ("kitchen", "open_cabinet"):
        made = environments(1, domain=domain)
        assert TaskBalance.of(made.composer_task) is None
        made.close()


def test_a_resumed_run_draws_tasks_as_often_as_before(envs):
    taught = learner(envs, domain="kitchen", action_scale=[0.1] * 9)
    taught.modules["balance"].add(infos_of([[1, 0]], [[1, 0]]), np.array([True]))
    weights = envs.composer_task.task_weights.copy()
    assert weights[0] < weights[1]
    stored = copy.deepcopy(taught.state())
    taught.modules["balance"].add(infos_of([[0, 1]] * 9, [[0, 1]] * 9), np.full(9, True))
    resumed = learner(envs, domain="kitchen", action_scale=[0.1] * 9)
    resumed.load_state(stored)
    np.testing.assert_array_equal(envs.composer_task.task_weights, weights)


def test_a_learner_has_curves_of_the_tasks_that_were_asked(envs):
    taught = learner(envs, domain="kitchen", action_scale=[0.1] * 9)
    taught.start(0)
    means = taught.learn()
    names = {f"episode/success/{name}" for name in TASKS}
    assert names & means.keys()
    assert all(means[name] == 0 for name in names & means.keys())
    np.testing.assert_allclose(envs.composer_task.task_weights, [1.05, 1.05])
