"""Instructions: every task has a sentence and paraphrases; sets of tasks join them in the order asked."""

import re

import numpy as np
import pytest
from helpers.errors import refused
from helpers.sweeps import brief

from kitchen_suite import suite
from kitchen_suite.entities.scenes import build_microwave_table_scene
from kitchen_suite.tasks import GOALS
from kitchen_suite.tasks.goals import Goal, GoalSet
from kitchen_suite.tasks.microwave_table.task import MicrowaveTableTask
from kitchen_suite.tasks.open_cabinet.task import INSTRUCTIONS

_OTHERS = [pair for pair in suite.ALL_TASKS if pair[0] != "kitchen"]


def load(domain, task, **task_kwargs):
    return suite.load(domain, task, {"visuals": False, "random": 0, **task_kwargs})


def own_task(**attributes):
    """Returns a user's own task, whose class sets attributes."""
    return type("OwnTask", (MicrowaveTableTask,), attributes)(build_microwave_table_scene(visuals=False))


@pytest.mark.full
@pytest.mark.parametrize(
    ("domain", "name"),
    brief(suite.ALL_TASKS, kept=[("kitchen", "kettle"), ("kitchen", "all"), *_OTHERS]),
)
def test_every_task_has_a_sentence_and_three_paraphrases(domain, name):
    task = load(domain, name).task
    assert task.instruction == task.instructions[0]
    assert len(set(task.instructions)) == len(task.instructions) >= 4
    for sentence in task.instructions:
        assert re.fullmatch(r"[a-z]+( [a-z]+)+(, then [a-z]+( [a-z]+)+)*", sentence)
    if domain == "kitchen" and name.replace("_", " ") in GOALS:
        assert task.instructions == GOALS[name.replace("_", " ")].instructions


@pytest.mark.full
def test_the_sentences_are_of_the_goals():
    assert load("kitchen", "microwave").task.instruction == "open the microwave door"
    assert load("microwave_table", "open").task.instruction == "open the microwave door"
    assert load("open_cabinet", "bottom_drawer").task.instruction == "open the bottom drawer of the cabinet"


def test_no_two_tasks_of_a_domain_share_a_sentence():
    for tables in ([goal.instructions for goal in GOALS.values()], INSTRUCTIONS.values()):
        sentences = [sentence for instructions in tables for sentence in instructions]
        assert len(set(sentences)) == len(sentences)


def test_several_tasks_join_their_sentences_in_the_order_asked():
    task = load("kitchen", "all", tasks_to_complete=["kettle", "microwave"], goals={"microwave": [-1.2]}).task
    kettle, microwave = GOALS["kettle"].instructions, GOALS["microwave"].instructions
    assert task.instruction == "move the kettle to the top left burner, then open the microwave door"
    assert task.instructions == tuple(f"{one}, then {two}" for one, two in zip(kettle, microwave, strict=True))


def test_a_set_has_as_many_instructions_as_each_of_its_tasks():
    known = {
        "two": Goal(prop="oven", value=(0.0,), instructions=("turn it", "twist it")),
        "one": Goal(prop="hood", value=(0.0,), instructions=("press it",)),
        "none": Goal(prop="kettle", value=(0.0,)),
    }
    assert GoalSet.build(known, ["two", "one"]).instructions([0, 1]) == ("turn it, then press it",)
    assert GoalSet.build(known, ["two", "none"]).instructions([0, 1]) == ()


@pytest.mark.full
def test_drawing_takes_each_instruction_and_leaves_the_environments_stream_alone():
    environment, untouched = load("kitchen", "kettle"), load("kitchen", "kettle")
    environment.reset()
    untouched.reset()
    generator = np.random.default_rng(0)
    drawn = [environment.task.draw_instruction(generator) for _ in range(400)]
    counts = [drawn.count(sentence) for sentence in environment.task.instructions]
    assert sum(counts) == 400
    # Each is expected 100 times, with a standard deviation of 8.7.
    assert min(counts) > 60
    again = np.random.default_rng(0)
    assert [environment.task.draw_instruction(again) for _ in range(400)] == drawn
    one, other = environment.step(np.zeros(9)), untouched.step(np.zeros(9))
    for key, values in one.observation.items():
        np.testing.assert_array_equal(values, other.observation[key])


@pytest.mark.parametrize("generator", [0, None, np.random.RandomState(0)])
def test_only_generators_are_drawn_from(generator):
    with pytest.raises(TypeError, match=r"generator must be a numpy\.random\.Generator, got"):
        load("microwave_table", "open").task.draw_instruction(generator)


def test_a_users_task_sets_its_sentence_in_one_line():
    task = own_task(instructions=("open the door gently", "pull gently"))
    assert task.instruction == "open the door gently"
    assert task.draw_instruction(np.random.default_rng(0)) in task.instructions
    assert own_task().instruction == "open the microwave door"


def test_a_task_without_a_sentence_has_the_empty_one():
    task = own_task(instructions=())
    assert task.instruction == ""
    with pytest.raises(ValueError, match="no instructions to draw from: the task has no sentence"):
        task.draw_instruction(np.random.default_rng(0))


@pytest.mark.parametrize(
    ("instructions", "error", "shown"),
    [
        ("open it", TypeError, ["instructions", "'open it'"]),
        ((3,), TypeError, ["instructions", "(3,)"]),
        (("open it", " "), ValueError, ["instructions"]),
    ],
)
def test_bad_instructions_of_a_task_are_refused(instructions, error, shown):
    task = own_task(instructions=instructions)
    for ask in (lambda: task.instruction, lambda: task.draw_instruction(np.random.default_rng(0))):
        with refused(error, *shown):
            ask()


def test_bad_instructions_of_a_goal_are_refused():
    with refused(TypeError, "'oven'", "'x'"):
        Goal(prop="oven", value=(0.0,), instructions="x")
