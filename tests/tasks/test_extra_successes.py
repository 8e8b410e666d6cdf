"""A success of a task's own, `extra_successes`, is that of its episodes in all front ends, scores and trainings."""

import contextlib
import copy

import gymnasium
import numpy as np
import pytest
from docs_scripts import load_script
from helpers.errors import refused

import kitchen_suite
from kitchen_suite import entities, files, suite, tasks
from kitchen_suite.environment import Environment
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.evaluation.compare import compare
from kitchen_suite.evaluation.evaluate import evaluate
from kitchen_suite.training.recipes import find_schedule

# By domain: what builds the scene, and the task.
DOMAINS = {
    "kitchen": (entities.build_kitchen_scene, tasks.KitchenTask),
    "kitchens": (entities.build_generated_kitchen, tasks.GeneratedKitchenTask),
    "pick_and_place": (entities.build_pick_and_place, tasks.PickAndPlaceTask),
    "microwave_table": (entities.build_microwave_table_scene, tasks.MicrowaveTableTask),
    "open_cabinet": (entities.build_open_cabinet_scene, tasks.OpenCabinetTask),
}
STEPS = 20


def first_up(step):
    """Whether the first element of the action is positive."""
    return step.action[..., 0] > 0.0


def second_up(step):
    return step.action[..., 1] > 0.0


CONDITIONS = {"first": first_up, "second": second_up}


def own_task(domain, **attributes):
    return type("OwnTask", (DOMAINS[domain][1],), {"extra_successes": CONDITIONS, **attributes})


def own_domain(domain, task):
    return suite.Domain(
        f"own_{domain}",
        scene=DOMAINS[domain][0],
        task=task,
        tasks={"push": {}},
        env_id=f"Own/{domain.title().replace('_', '')}-v1",
        episode_steps=STEPS,
    )


@contextlib.contextmanager
def registered(domain, **attributes):
    """Registers a domain with a class of one of the suite's tasks, and yields the record."""
    record = own_domain(domain, own_task(domain, **attributes))
    suite.register(record)
    try:
        yield record
    finally:
        del suite._domains[record.name]
        for env_id in {record.env_id, *record.task_ids.values()}:
            del gymnasium.registry[env_id]


def loaded(domain, **attributes):
    return own_domain(domain, own_task(domain, **attributes)).load(random=0, visuals=False, time_limit=None)


def action_of(size, first, second):
    action = np.zeros(size)
    action[:2] = first, second
    return action


@pytest.mark.parametrize("domain", DOMAINS)
def test_an_episode_has_succeeded_from_the_first_step_at_which_all_conditions_are_true(domain):
    environment = loaded(domain)
    environment.reset()
    task = environment.task
    (size,) = environment.action_spec().shape
    found = [task.episode_metrics]
    for signs in ((0.5, -0.5), (-0.5, 0.5), (0.5, 0.5), (-0.5, -0.5)):
        timestep = environment.step(action_of(size, *signs))
        found.append(task.episode_metrics)
    # Both were true before, each alone, and neither is at the end.
    assert found == [{"success": success} for success in (False, False, False, True, True)]
    assert not timestep.last()
    assert task.episode_completions is None
    environment.reset()
    assert task.episode_metrics == {"success": False}


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_its_success_is_equal_in_all_front_ends(domain):
    with registered(domain) as record:
        env = gymnasium.make(record.env_id)
        envs = gymnasium.make_vec(record.env_id, 3, num_threads=1)
        environment = record.load(visuals=False, time_limit=None)
        env.reset(seed=1)
        envs.reset(seed=0)
        environment.reset()
        rng = np.random.default_rng(3)
        # Small actions, with which no episode ends.
        actions = rng.uniform(-0.1, 0.1, (10, 3, *env.action_space.shape)).astype(np.float32)
        up = actions[..., :2] > 0.0
        expected = np.logical_or.accumulate(up.all(axis=-1), axis=0)
        assert not expected[0].all()
        assert expected[-1].any()
        for step, batch in enumerate(actions):
            *_, info = env.step(batch[1])
            _, _, terminations, _, infos = envs.step(batch)
            assert not terminations.any()
            environment.step(env.unwrapped.clip_actions(batch[1].astype(np.float64)))
            assert infos["is_success"].tolist() == expected[step].tolist()
            assert info["is_success"] == expected[step, 1] == environment.task.episode_metrics["success"]
            for place, name in enumerate(CONDITIONS):
                assert infos[f"success/{name}"].tolist() == up[step, :, place].tolist()
                assert info[f"success/{name}"] == up[step, 1, place]
            if "success_at_any_time" in info:
                assert info["success_at_any_time"] == expected[step, 1]
                assert infos["success_at_any_time"].tolist() == expected[step].tolist()
        # A reset of one row begins its episode alone.
        mask = np.array([False, True, False])
        _, infos = envs.reset(options={"reset_mask": mask})
        kept = envs.unwrapped._episodes.info()["is_success"]
        assert kept.tolist() == (expected[-1] & ~mask).tolist()


def test_its_success_is_part_of_saved_states_copies_and_pickles():
    environment = loaded("microwave_table")
    environment.reset()
    (size,) = environment.action_spec().shape
    before = environment.get_state()
    environment.step(action_of(size, 0.5, 0.5))
    after = environment.get_state()
    assert after["task"]["own_success"]["reached"]
    environment.set_state(before)
    assert environment.task.episode_metrics == {"success": False}
    environment.set_state(after)
    environment.step(action_of(size, -0.5, -0.5))
    assert environment.task.episode_metrics == {"success": True}
    for other in (copy.deepcopy(environment), copy.copy(environment)):
        assert other.task.episode_metrics == {"success": True}


def test_a_class_without_conditions_keeps_its_states_and_infos():
    environment = suite.load("microwave_table", suite.default_task("microwave_table"), {"random": 0, "visuals": False})
    environment.reset()
    assert "own_success" not in environment.get_state()["task"]
    assert not [key for key in environment.task.runner.info(environment.task.episode) if key.startswith("success/")]
    assert "own_success" not in environment.task.parts


def test_a_class_that_extends_another_adds_removes_and_replaces_conditions():
    base = own_task("microwave_table")
    derived = type("Derived", (base,), {"extra_successes": {"second": None}})
    task = derived(entities.build_microwave_table_scene(visuals=False))
    assert [*task.successes] == ["first"]
    for value, error in (([first_up], TypeError), ({"first": 1}, TypeError), ({"second/": first_up}, ValueError)):
        with refused(error, "extra_successes", "Mine"):
            type("Mine", (base,), {"extra_successes": value})(entities.build_microwave_table_scene(visuals=False))


def test_a_task_with_an_mdp_of_a_users_own_may_have_conditions():
    lever = load_script("examples/my_domain")
    task = type("OwnLever", (lever.LeverTask,), {"extra_successes": CONDITIONS})
    environment = Environment(task(lever.build_lever_scene(visuals=False)), random_state=0)
    environment.reset()
    # Over, the lever is a success of the base, and ends its episodes still.
    environment.physics.named.data.qpos["lever/hinge"] = 1.0
    assert environment.step(np.zeros(8)).last()
    assert environment.task.episode_metrics == {"success": False}
    environment.reset()
    environment.step(action_of(8, 0.5, 0.5))
    assert environment.task.episode_metrics == {"success": True}


# Results


class Pushes:
    """Succeeds in the third step, or never; a policy for any number of episodes, since it counts their steps."""

    def __init__(self, succeeds):
        self._succeeds = succeeds
        self._steps = 0

    def __call__(self, timestep):
        self._steps = 0 if timestep.first() else self._steps + 1
        sign = 0.5 if self._succeeds and self._steps == 2 else -0.5
        return action_of(9, sign, sign)


@pytest.mark.full
def test_results_and_comparisons_count_it():
    with registered("kitchen") as record:
        evaluations = [
            evaluate(Pushes(succeeds), domain_name=record.name, num_episodes=6, num_envs=1, max_episode_steps=8)
            for succeeds in (True, False)
        ]
        good, bad = (each.scores for each in evaluations)
        assert (good["success"], bad["success"]) == (1.0, 0.0)
        # The seven tasks of the kitchen, which nobody has named, have no scores.
        assert not {"p1", "mean_tasks", "task_rates", "order_entropy"} & good.keys()
        assert (good["mean_progress"], bad["mean_progress"]) == (1.0, 0.0)
        comparison = compare(*evaluations)
        assert [comparison.as_json()[name] for name in ("wins", "losses", "ties")] == [6, 0, 0]


@pytest.mark.full
def test_recordings_and_replays_count_it(tmp_path):
    with registered("kitchen") as record:
        spec = EnvironmentSpec.make(record.name, "push", task_kwargs={})
        recording = kitchen_suite.record(tmp_path / "runs", spec, Pushes(True), num_episodes=2, num_envs=1)
        assert [episode.metrics for episode in recording] == [{"success": True}] * 2
        assert recording.load(0).arrays["info/is_success"].tolist() == [False] * 3 + [True] * (STEPS - 2)
        assert kitchen_suite.replay(tmp_path / "runs").verdict == "equal"


@pytest.mark.torch
@pytest.mark.parametrize("is_met", [True, False])
def test_training_keeps_checkpoints_by_it(is_met, tmp_path):
    """No policy opens the door so soon: the success of the kept policy is that of a condition that is always met."""
    from kitchen_suite.training.ppo import train

    def condition(step):
        return np.full(step.action.shape[:-1], is_met)

    with registered("microwave_table", extra_successes={"first": condition}) as record:
        file = train(
            tmp_path / "run",
            EnvironmentSpec.make(record.name, "push", task_kwargs={}),
            find_schedule(record.name, "ppo", num_steps=256, eval_interval=128, eval_episodes=4),
            hyperparameters={"num_envs": 4, "rollouts": 16, "hidden": [8], "mini_batches": 2, "learning_epochs": 2},
            num_threads=1,
        )
        assert files.load_metadata(file, "a trained policy")["training"]["success"] == is_met
        assert evaluate(file, domain_name=record.name, num_episodes=4).scores["success"] == is_met
