"""A hand that holds the handle opens the drawer; pushing and an open gripper do not."""

import numpy as np
import pytest
from helpers import open_cabinet

from kitchen_suite import suite


def expert_episode(env):
    return open_cabinet.pulling_episode(env, open_cabinet.opening_policy)


def opened_and_held(env, episodes):
    results = [expert_episode(env) for _ in range(episodes)]
    return sum(opening >= 0.3 and held >= 0.95 for opening, held, _ in results)


@pytest.mark.full
def test_a_grasp_pulls_the_top_drawer_open():
    env = suite.load("open_cabinet", "top_drawer", {"random": 0, "visuals": False})
    assert opened_and_held(env, 4) == 4
    assert env.task.is_success


@pytest.mark.full
def test_a_grasp_pulls_the_bottom_drawer_open():
    env = suite.load("open_cabinet", "bottom_drawer", {"random": 0, "visuals": False})
    openings = [expert_episode(env)[0] for _ in range(3)]
    assert min(openings) >= 0.3


@pytest.mark.nightly
def test_fifty_random_starts():
    env = suite.load("open_cabinet", "top_drawer", {"random": 1, "visuals": False})
    assert opened_and_held(env, 50) >= 49


@pytest.mark.full
def test_the_same_actions_with_an_open_gripper_open_nothing():
    closing, opening = (suite.load("open_cabinet", "top_drawer", {"random": 0, "visuals": False}) for _ in range(2))
    _, _, actions = expert_episode(closing)
    timestep = opening.reset()
    for action in actions:
        timestep = opening.step(np.append(action[:-1], open_cabinet.OPEN))
    # The hand has gone as far.
    assert timestep.last()
    assert timestep.observation["handle_offset"][0] < -0.3
    assert closing.task.drawer_opening >= 0.3
    assert abs(opening.task.drawer_opening) < 1e-3


def test_pushing_on_the_front_with_the_gripper_open_does_not_open_it():
    env = suite.load("open_cabinet", "top_drawer", {"random": 0, "visuals": False})
    env.reset()
    task, physics = env.task, env.physics
    script = open_cabinet.pushing_script(env)
    front = physics.bind(task.scene.cabinet.mjcf_model.find("geom", "drawer_top_front")).element_id
    pushed, opened = 0, []
    for _ in range(700):
        # Without the environment, which ends an episode as soon as the gripper has reached through the handle.
        task.before_step(physics, next(script), env.random_state)
        physics.step(task.physics_steps_per_control_step)
        pushed += (physics.data.contact.geom == front).any()
        opened.append(physics.bind(task.scene.cabinet.drawer_joint("top")).qpos.item())
    assert pushed > 300
    assert max(opened) < 1e-3
