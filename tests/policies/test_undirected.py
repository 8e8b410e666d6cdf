"""The expert that completes tasks in a random order, whatever is asked for, and undoes them again."""

import numpy as np
import pytest

from kitchen_suite import experts, policies, suite
from kitchen_suite.commands import rollout
from kitchen_suite.policies.experts.undirected import UndirectedExpert
from kitchen_suite.tasks import DEFAULT_TASKS, GOALS
from kitchen_suite.tasks.kitchen.goals import REVERSES

REPERTOIRE = ("microwave", "light switch", "close microwave", "turn off light switch")


@pytest.fixture(scope="module")
def kitchen():
    return suite.load("kitchen", "mixed", {"visuals": False, "terminate_on_tasks_completed": False})


def attempts(environment, steps, seed=0, **options):
    """Plays some control steps; returns the tasks that the expert has turned to, in order, and the actions."""
    expert = UndirectedExpert.for_task(environment.task, **options)
    expert.reset(np.random.default_rng(seed))
    environment.random_state.seed(seed)
    timestep, chosen, actions = environment.reset(), [], []
    flatten = environment.task.policy_inputs.flatten
    for _ in range(steps):
        actions.append(expert.act(expert.without_goals(flatten(timestep.observation))))
        if chosen[-1:] != [expert.under_way]:
            chosen.append(expert.under_way)
        timestep = environment.step(actions[-1])
    return chosen, np.array(actions)


@pytest.mark.full
def test_tasks_are_chosen_at_random_and_completed(kitchen):
    orders = {tuple(attempts(kitchen, 110, seed)[0]) for seed in range(4)}
    assert len(orders) == 4
    for order in orders:
        assert len(order) >= 2
        assert len({*order}) == len(order)
        assert {*order} <= {*DEFAULT_TASKS}
    chosen, actions = attempts(kitchen, 110, 0)
    again, same_actions = attempts(kitchen, 110, 0)
    assert chosen == again
    np.testing.assert_array_equal(actions, same_actions)
    # What was asked for and turned to first is complete when it turns to the third.
    first, second = chosen[:2]
    assert {first, second} & {*kitchen.task.mdp.goals.tasks} <= {*kitchen.task.episode_task_completions}


@pytest.mark.full
def test_what_has_been_done_is_undone_where_the_repertoire_allows_it(kitchen):
    chosen, _ = attempts(kitchen, 260, repertoire=REPERTOIRE)
    undone = [task for task in chosen if task in REVERSES]
    assert undone, chosen
    for task in undone:
        assert REVERSES[task] in chosen[: chosen.index(task)]
    assert len({*chosen}) < len(chosen)


def test_all_twenty_tasks_are_in_its_greatest_repertoire(kitchen):
    expert = UndirectedExpert.for_task(kitchen.task, repertoire="twenty")
    at_start = kitchen.task.policy_inputs.flatten(kitchen.reset().observation)[:59]
    expert.reset(np.random.default_rng(0))
    drawn = set()
    for seed in range(60):
        expert.reset(np.random.default_rng(seed))
        expert.act(at_start)
        drawn.add(expert.under_way)
    # At the start there is nothing to undo.
    assert drawn == {*GOALS} - {*REVERSES}


@pytest.mark.full
def test_the_last_of_the_tasks_asked_for_is_spared(kitchen):
    asked = kitchen.task.mdp.goals.tasks
    chosen, _ = attempts(kitchen, 270, repertoire=asked, spare_last=True)
    assert len({*chosen} - {""}) == len(asked) - 1
    assert chosen[-1] == ""  # There is nothing else to do.
    assert len(kitchen.task.episode_task_completions) == len(asked) - 1


@pytest.mark.full
def test_directed_episodes_do_what_is_asked_for_and_no_more(kitchen):
    asked = kitchen.task.mdp.goals.tasks
    chosen, _ = attempts(kitchen, 250, directed=1.0)
    assert {*chosen} - {""} == {*asked}
    shares = []
    for seed in range(40):
        expert = UndirectedExpert.for_task(kitchen.task, directed=0.3)
        expert.reset(np.random.default_rng(seed))
        expert.act(kitchen.task.policy_inputs.flatten(kitchen.reset().observation)[:59])
        shares.append(expert.is_directed)
    assert 4 <= sum(shares) <= 22


@pytest.mark.full
def test_one_action_in_some_is_uniform():
    environment = suite.load("kitchen", "mixed", {"visuals": False})
    observation = environment.task.policy_inputs.flatten(environment.reset().observation)[:59]
    changed = 0
    for seed in range(60):
        plain, noisy = (
            experts.make(environment.task, style=experts.MotionStyle(random_actions=share)) for share in (0.0, 0.5)
        )
        for expert in (plain, noisy):
            expert.reset(np.random.default_rng(seed))
        one, other = plain.act(observation), noisy.act(observation)
        np.testing.assert_array_equal(one[7:], other[7:])  # The fingers follow the plan.
        changed += not np.array_equal(one, other)
    assert 15 <= changed <= 45


@pytest.mark.full
@pytest.mark.parametrize("criterion", [{"success": "strict"}, {"threshold": 0.1}, {"threshold": {"kettle": 0.05}}])
def test_tasks_are_complete_as_the_environment_has_it(criterion):
    environment = suite.load("kitchen", "mixed", {"visuals": False, **criterion})
    expert = UndirectedExpert.for_task(environment.task, repertoire=["kettle", "microwave"])
    plain = experts.make(environment.task)
    flat = environment.task.policy_inputs.flatten(environment.reset().observation)[:59]
    distances, expected = (each._relative_distances(flat) for each in (expert, plain))
    assert distances == {task: expected[task] for task in distances}


def test_where_tasks_are_drawn_nothing_is_asked_for_in_every_episode(kitchen):
    environment = suite.load("kitchen", "random_2", {"visuals": False})
    UndirectedExpert.for_task(environment.task)
    for options in ({"directed": 0.5}, {"spare_last": True}):
        with pytest.raises(ValueError, match="the same tasks in every episode"):
            UndirectedExpert.for_task(environment.task, **options)


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"repertoire": []}, "repertoire"),
        ({"repertoire": "eight"}, "repertoire"),
        ({"repertoire": ["microwav"]}, "microwave"),
        ({"directed": 1.5}, "directed .* 1"),
        ({"directed": 0.5, "repertoire": ["kettle"]}, "repertoire with microwave"),
        ({"spare_last": 1}, "spare_last"),
        ({"random_actions": 2}, "random_actions .* 1"),
        ({"encoder": None}, "encoder"),
    ],
)
def test_bad_options_are_refused(kitchen, options, problem):
    text = ", ".join(f"{name}={value!r}" for name, value in options.items())
    with pytest.raises(policies.PolicyError, match=problem):
        policies.find(f"undirected({text})")(kitchen, np.random.default_rng(0))


def test_other_domains_have_none(refusal):
    error = refusal(rollout, "--domain_name=open_cabinet", "--policy=undirected", "--num_episodes=1")
    assert "open_cabinet; the domains with one are kitchen" in error
