"""Options of the kitchen's task, seen through timesteps."""

import dataclasses

import gymnasium
import numpy as np
import pytest
from helpers.errors import refused
from helpers.kitchen import POSITION_HIGH, POSITION_LOW
from helpers.sweeps import brief
from helpers.vectors import many

from kitchen_suite import suite
from kitchen_suite.entities.props import Microwave
from kitchen_suite.tasks import DEFAULT_TASKS, GOALS
from kitchen_suite.tasks.goals import GoalSet, Progress, goal_distances
from kitchen_suite.tasks.kitchen import observation as noise
from kitchen_suite.tasks.kitchen.control_modes import position_target
from kitchen_suite.tasks.kitchen.observation import KitchenSensors
from kitchen_suite.tasks.rewards import completions
from kitchen_suite.tasks.terms import Observation

# Greatest noise of each element at a ratio of 1.
AMPLITUDES = noise.noise_scale(robot_ratio=1.0, object_ratio=1.0)


def load(task_name="all", **options):
    return suite.load("kitchen", task_name, task_kwargs={"random": 0, "visuals": False, **options})


def run(environment, steps, action=None):
    timesteps = [environment.reset()]
    timesteps += [environment.step(np.zeros(9) if action is None else action) for _ in range(steps)]
    return timesteps


def set_objects(environment, task, value):
    """Sets the positions of a task's objects."""
    environment.physics.data.qpos[9:][GOALS[task].elements_in(environment.task.scene)] = value
    environment.physics.forward()


def test_a_completed_task_is_rewarded_once():
    environment = load("all", goals={"microwave": [0.1]}, terminate_on_tasks_completed=False)
    assert [timestep.reward for timestep in run(environment, 3)] == [None, 1.0, 0.0, 0.0]
    assert "microwave" not in environment.task.tasks_to_complete


def test_a_kept_task_is_rewarded_in_every_step_within_its_threshold():
    options = {"remove_task_when_completed": False, "terminate_on_tasks_completed": False}
    environment = load("all", goals={"microwave": [0.1]}, **options)
    assert [timestep.reward for timestep in run(environment, 3)] == [None, 1.0, 1.0, 1.0]
    set_objects(environment, "microwave", -0.5)
    assert environment.step(np.zeros(9)).reward == 0.0
    assert environment.task.tasks_to_complete == list(DEFAULT_TASKS)
    assert environment.task.episode_task_completions == ["microwave"]


def test_a_kept_set_terminates_once_every_task_was_completed_at_some_step():
    environment = load("all", tasks_to_complete=["microwave", "slide cabinet"], remove_task_when_completed=False)
    environment.reset()
    set_objects(environment, "microwave", -0.75)
    timestep = environment.step(np.zeros(9))
    assert (timestep.mid(), timestep.reward) == (True, 1.0)
    set_objects(environment, "microwave", 0.0)
    set_objects(environment, "slide cabinet", 0.37)
    timestep = environment.step(np.zeros(9))
    assert (timestep.last(), timestep.reward, timestep.discount) == (True, 1.0, 0.0)
    assert environment.task.completion_steps == {"microwave": 1, "slide cabinet": 2}


@pytest.mark.full
@pytest.mark.parametrize("task", brief(GOALS, kept=[*DEFAULT_TASKS, "close hinge cabinet", "return kettle"]))
def test_every_task_is_completed_by_reaching_its_goal(task):
    environment = load(task.replace(" ", "_"))
    environment.reset()
    assert environment.step(np.zeros(9)).reward == 0.0
    set_objects(environment, task, GOALS[task].value)
    timestep = environment.step(np.zeros(9))
    assert (timestep.reward, timestep.discount) == (1.0, 0.0)


def test_lists_keep_configured_order_and_completions_their_chronology():
    order = ["microwave", "kettle", "slide cabinet", "light switch"]
    environment = load("all", tasks_to_complete=order, terminate_on_tasks_completed=False)
    environment.reset()
    set_objects(environment, "light switch", GOALS["light switch"].value)
    environment.step(np.zeros(9))
    assert environment.task.tasks_to_complete == ["microwave", "kettle", "slide cabinet"]
    set_objects(environment, "slide cabinet", GOALS["slide cabinet"].value)
    set_objects(environment, "microwave", GOALS["microwave"].value)
    environment.step(np.zeros(9))
    assert environment.task.step_task_completions == ["microwave", "slide cabinet"]
    assert environment.task.episode_task_completions == ["light switch", "microwave", "slide cabinet"]


def test_metrics_are_read_from_infos():
    environment = load("all", tasks_to_complete=["microwave", "kettle"])
    environment.reset()
    set_objects(environment, "kettle", GOALS["kettle"].value)
    environment.step(np.zeros(9))
    task = environment.task
    assert task.episode_metrics == {"success": False, "tasks_completed": {"kettle": 1}}
    assert task.records.metrics({"completion_steps": np.array([5, 2])}) == {
        "success": True,
        "tasks_completed": {"kettle": 2, "microwave": 5},
    }


@pytest.mark.full
def test_the_objects_must_be_in_the_order_of_the_observation():
    environment = load()
    scene = environment.task.scene
    swapped = dataclasses.replace(scene, props=dict(reversed(scene.props.items())))
    with refused(ValueError, "'oven'", "'kettle'"):
        KitchenSensors(swapped, environment.task.mdp.goals)


def test_a_prop_whose_joints_are_not_in_the_table_is_named():
    environment = load()
    scene = environment.task.scene
    furnished = dataclasses.replace(scene, props={**scene.props, "safe": Microwave(visuals=False, name="safe")})
    with refused(ValueError, "OBSERVED_PROPS", "'safe'", "{'microwave': (1, 1, 1)}"):
        KitchenSensors(furnished, environment.task.mdp.goals)


def test_one_entry_adds_an_observation_without_noise(monkeypatch):
    original = KitchenSensors.observations

    def observations(self):
        lamp = Observation(lambda simulation, _: simulation.read("qpos", self.indices.object_qpos[9:10]))
        return {**original.fget(self), "lamp": lamp}

    monkeypatch.setattr(KitchenSensors, "observations", property(observations))
    environment = load()
    lamp = environment.task.mdp.initial_qpos[18:19]
    np.testing.assert_array_equal(environment.reset().observation["lamp"], lamp)
    env_id = suite.DOMAINS["kitchen"].task_ids["kettle"]
    single, vector = gymnasium.make(env_id, obs_type="state"), many(env_id, 2, obs_type="state")
    one, several = single.reset(seed=0)[0], vector.reset(seed=0)[0]
    np.testing.assert_array_equal(one, several[0])
    np.testing.assert_array_equal(several[:, noise.SIZE :], [lamp, lamp])


def test_lists_are_fresh():
    environment = load("complete")
    environment.reset()
    environment.task.tasks_to_complete.clear()
    environment.task.goals["kettle"][:] = np.nan
    assert len(environment.task.tasks_to_complete) == 4
    assert np.isfinite(environment.task.goals["kettle"]).all()


def test_a_goal_can_be_overridden_and_is_seen():
    environment = load("kettle", goals={"kettle": np.arange(7.0)})
    np.testing.assert_array_equal(environment.reset().observation["desired_goal/kettle"], np.arange(7.0))


@pytest.mark.full
@pytest.mark.parametrize("threshold", [0.7, 0.8])
def test_the_threshold_decides(threshold):
    reward = run(load("microwave", threshold=threshold), 1)[1].reward
    assert reward == (1.0 if threshold > 0.75 else 0.0)


@pytest.mark.full
def test_noise_is_on_by_default_within_its_amplitude_and_can_be_switched_off():
    bounds = {
        "franka/joint_positions": 0.01 * AMPLITUDES[noise.FRANKA_SLICES.robot_positions],
        "franka/joint_velocities": 0.01 * AMPLITUDES[noise.FRANKA_SLICES.robot_velocities],
        "object_positions": 0.0005 * AMPLITUDES[noise.FRANKA_SLICES.object_positions],
        "object_velocities": 0.0005 * AMPLITUDES[noise.FRANKA_SLICES.object_velocities],
    }
    quiet = {"robot_noise_ratio": 0.0, "object_noise_ratio": 0.0, "velocity_scale": 0.0, "feedback": "target"}
    noisy = {"velocity_scale": 0.0, "feedback": "target"}
    plain, corrupted = run(load(**quiet), 200), run(load(**noisy), 200)
    for key, bound in bounds.items():
        seen, true = (np.array([timestep.observation[key] for timestep in steps]) for steps in (corrupted, plain))
        size = np.abs(seen - true) / bound
        assert (size <= 1 + 1e-6).all()
        # 201 uniform draws: the greatest is above 0.9 but for a chance of 1e-9, the mean within five standard errors.
        assert (size.max(axis=0) > 0.9).all()
        assert np.abs(size.mean(axis=0) - 0.5).max() < 5 * np.sqrt(1 / 12 / 201)


def test_noise_does_not_depend_on_what_is_enabled():
    plain, fuller = load(), load()
    for prop in ("microwave", "kettle", "oven"):
        fuller.task.scene.props[prop].observables.enable_all()
    for one, other in zip(run(plain, 3), run(fuller, 3), strict=True):
        np.testing.assert_array_equal(one.observation["object_positions"], other.observation["object_positions"])


@pytest.mark.full
def test_zero_action_drifts_as_in_the_original_but_holds_with_target_feedback():
    def drift(feedback):
        timesteps = run(load(feedback=feedback, robot_noise_ratio=0.0), 120)
        first, last = (
            timestep.observation["franka/joint_positions"][:7] for timestep in (timesteps[20], timesteps[-1])
        )
        return np.abs(last - first).max()

    assert drift("observed") > 0.5
    assert drift("true") > 0.5
    assert drift("target") < 0.01


@pytest.mark.full
@pytest.mark.parametrize("feedback", ["observed", "true", "target"])
def test_only_observed_feedback_lets_the_noise_move_the_robot(feedback):
    def end(**noise):
        environment = load(feedback=feedback, **noise)
        run(environment, 20, np.full(9, 0.3))
        return environment.physics.data.qpos.copy()

    quiet = end(robot_noise_ratio=0.0, object_noise_ratio=0.0)
    assert np.array_equal(end(), quiet) == (feedback != "observed")


def test_velocities_are_clipped_to_ten():
    fast, faster = (
        position_target(np.full(9, 0.02), np.full(9, 0.9), velocity_scale=scale, timestep=1e-3) for scale in (20, 200)
    )
    np.testing.assert_array_equal(fast, faster)
    np.testing.assert_array_equal(fast[[0, 1, 2, 4, 5, 6, 7]], 0.02 + 10 * 1e-3)


def test_velocity_scale_one_is_one_radian_per_second():
    ours, half = load(velocity_scale=1.0), load(velocity_scale=2.0)
    np.testing.assert_array_equal(
        run(ours, 5, np.full(9, 0.5))[-1].observation["franka/joint_positions"],
        run(half, 5, np.full(9, 0.25))[-1].observation["franka/joint_positions"],
    )


def test_actions_beyond_one_are_clipped():
    inside, beyond = (run(load(), 3, np.full(9, value))[-1].observation for value in (1.0, 50.0))
    np.testing.assert_array_equal(inside["franka/joint_positions"], beyond["franka/joint_positions"])


def test_position_targets_stay_within_bounds_over_batches():
    rng = np.random.default_rng(0)
    positions, actions = rng.normal(scale=3, size=(100, 9)), rng.normal(scale=2, size=(100, 9))
    batch = position_target(positions, actions, velocity_scale=2.0, timestep=0.08)
    assert (batch >= POSITION_LOW).all()
    assert (batch <= POSITION_HIGH).all()
    single = [position_target(q, a, velocity_scale=2.0, timestep=0.08) for q, a in zip(positions, actions, strict=True)]
    np.testing.assert_array_equal(batch, single)


def test_distances_are_euclidean_over_batches():
    goals = GoalSet.build(GOALS, ["kettle", "microwave", "light switch"])
    achieved = np.random.default_rng(0).normal(size=(4, 5, 10))
    distances = goal_distances(achieved, goals.desired, goals.first_elements)
    for i, (task, values) in enumerate(goals.split(achieved).items()):
        np.testing.assert_allclose(distances[..., i], np.linalg.norm(values - GOALS[task].value, axis=-1), rtol=1e-14)


def test_completions_over_batches():
    within = np.random.default_rng(0).random((6, 50, 3)) < 0.1
    progress, rewards = Progress.initial((6, 3)), np.zeros(6)
    for t in range(50):
        progress = progress.update(within[:, t], remove_task_when_completed=True)
        rewards += completions(progress)
        assert not (progress.completions & progress.remaining).any()
    first = np.where(within.any(axis=1), within.argmax(axis=1) + 1, -1)
    np.testing.assert_array_equal(progress.completion_steps, first)
    np.testing.assert_array_equal(rewards, progress.completed.sum(axis=-1))


def test_the_reset_writes_the_references_state_unnormalised():
    environment = load(robot_noise_ratio=0.0, object_noise_ratio=0.0)
    observation = environment.reset().observation
    assert observation["object_positions"][17] == 1.00618764
    assert not observation["franka/joint_velocities"].any()
    assert not environment.physics.data.ctrl.any()
    assert environment.physics.time() == 0.0


def test_the_reward_can_be_seen():
    options = {"random": 0, "goals": {"microwave": [0.1]}, "terminate_on_tasks_completed": False}
    environment = suite.load("kitchen", "all", options, visualize_reward=True)
    door = environment.task.scene.props["microwave"].mjcf_model.find("geom", "door_visual")
    environment.reset()
    plain = environment.physics.bind(door).rgba.copy()
    environment.step(np.zeros(9))
    assert not np.array_equal(environment.physics.bind(door).rgba, plain)
    set_objects(environment, "microwave", -0.5)
    environment.step(np.zeros(9))
    np.testing.assert_array_equal(environment.physics.bind(door).rgba, plain)
