"""Goals of one's own that the expert reaches, and those that it does not, as docs/guide/experts.md says."""

import numpy as np
import pytest

from kitchen_suite import experts, suite

# Task, goal, threshold, and whether the expert reaches it.
GOALS = [
    ("microwave", [-0.2], 0.05, True),
    ("microwave", [-0.4], 0.1, True),
    ("microwave", [-1.2], 0.3, True),
    ("microwave", [-1.6], 0.3, False),
    ("kettle", [-0.23, 0.6, 1.62, 0.99, 0, 0, -0.06], 0.1, True),
    ("kettle", [0.23, 0.75, 1.62, 0.99, 0, 0, -0.06], 0.1, False),
    ("light switch", [-0.3, -0.02], 0.1, True),
    ("slide cabinet", [0.15], 0.05, True),
    ("hinge cabinet", [0, 0.8], 0.1, True),
    ("bottom burner", [-0.45, -0.005], 0.1, True),
]


@pytest.mark.nightly
@pytest.mark.parametrize(("name", "goal", "threshold", "reached"), GOALS)
def test_the_expert_reaches_goals_on_its_path_alone(name, goal, threshold, reached):
    arguments = {"tasks_to_complete": [name], "goals": {name: goal}, "threshold": threshold}
    environment = suite.load("kitchen", "all", {**arguments, "random": 0, "visuals": False})
    policy = experts.make_policy(environment, np.random.default_rng(0))
    timestep = environment.reset()
    while not timestep.last():
        timestep = environment.step(policy(timestep))
    assert (name in environment.task.completion_steps) == reached


@pytest.mark.full
@pytest.mark.parametrize("left_door", [-0.06, -0.15])
def test_for_strict_success_the_expert_shuts_the_left_door_of_the_hinge_cabinet(left_door):
    start = {"hinge_cabinet/doors": [left_door, 0.0]}
    arguments = {"success": "strict", "variations": start, "time_limit": 32.0, "random": 0, "visuals": False}
    environment = suite.load("kitchen", "hinge_cabinet", arguments)
    policy = experts.make_policy(environment, np.random.default_rng(0))
    timestep = environment.reset()
    left = []
    while not timestep.last():
        timestep = environment.step(policy(timestep))
        left.append(timestep.observation["achieved_goal/hinge cabinet"].ravel()[0])
    assert min(left) < left_door + 0.02
    assert abs(left[-1]) < 0.05
    assert "hinge cabinet" in environment.task.completion_steps
