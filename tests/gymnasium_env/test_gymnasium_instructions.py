"""The task's sentence in Gymnasium environments, single and vectorised, and in infos when asked for."""

import pickle

import gymnasium
import numpy as np
import pytest
from helpers.errors import refused

from kitchen_suite import suite
from kitchen_suite.gymnasium_env import IDS, KITCHEN_ID, TASK_IDS
from kitchen_suite.tasks.kitchen.task import KitchenTask

PAIR = {"tasks_to_complete": ["kettle", "microwave"]}
SENTENCE = "move the kettle to the top left burner, then open the microwave door"


def vector(env_id, count=2, mode="vector_entry_point", **settings):
    return gymnasium.make_vec(env_id, count, vectorization_mode=mode, **settings)


@pytest.mark.full
@pytest.mark.parametrize("domain", suite.DOMAINS)
def test_every_environment_states_its_task(domain):
    task = suite.default_task(domain)
    expected = suite.load(domain, task, {"visuals": False}).task.instructions
    env_id = TASK_IDS[domain, task]
    environment, environments = gymnasium.make(env_id), vector(env_id, 3)
    assert environment.unwrapped.instruction == expected[0]
    assert environment.unwrapped.instructions == expected
    # Some tasks are drawn at a reset.
    environments.reset(seed=0)
    for row, sentence in enumerate(environments.unwrapped.instruction):
        environment.reset(seed=row)
        assert sentence == environment.unwrapped.instruction


# As LeRobot reads them.
@pytest.mark.full
@pytest.mark.parametrize("mode", ["vector_entry_point", "sync"])
@pytest.mark.parametrize("domain", suite.DOMAINS)
def test_lerobots_names_are_read_by_call_and_get_attr(domain, mode):
    environments = vector(IDS[domain], mode=mode, max_episode_steps=7)
    sentence = environments.get_attr("instruction")
    assert len(sentence) == 2
    for name in ("task", "task_description"):
        assert environments.call(name) == environments.get_attr(name) == sentence
    assert environments.call("_max_episode_steps") == (7, 7)


@pytest.mark.full
@pytest.mark.parametrize(
    ("name", "error", "shown"),
    [
        ("instructon", AttributeError, ["'instructon'", "'instruction'"]),
        ("environment", AttributeError, ["'environment'"]),
        (3, TypeError, ["attribute", "3"]),
    ],
)
def test_attributes_of_an_episode_are_not_read(name, error, shown):
    environments = vector(KITCHEN_ID)
    for read in (environments.get_attr, environments.call):
        with refused(error, *shown):
            read(name)


@pytest.mark.full
@pytest.mark.parametrize("domain", suite.DOMAINS)
def test_infos_have_the_sentence_when_asked_for(domain):
    environment, plain = (gymnasium.make(IDS[domain], **settings) for settings in ({"instructions": True}, {}))
    action = np.zeros(plain.action_space.shape, np.float32)
    pairs = [(environment.reset(seed=1), plain.reset(seed=1)), (environment.step(action), plain.step(action))]
    for (*_, asked), (*_, default) in pairs:
        assert asked.pop("instruction") == environment.unwrapped.instruction
        assert list(asked) == list(default)
    copy = pickle.loads(pickle.dumps(environment.unwrapped))
    assert copy.step(action)[-1]["instruction"] == environment.unwrapped.instruction


@pytest.mark.full
@pytest.mark.parametrize("domain", suite.DOMAINS)
def test_infos_of_many_have_the_sentence_of_each_in_every_domain(domain):
    environments, plain = vector(IDS[domain], 3, instructions=True), vector(IDS[domain], 3)
    actions = np.zeros(plain.action_space.shape, np.float32)
    pairs = [(environments.reset(seed=1), plain.reset(seed=1)), (environments.step(actions), plain.step(actions))]
    for (*_, asked), (*_, default) in pairs:
        assert tuple(asked.pop("instruction")) == environments.unwrapped.instruction
        assert asked.pop("_instruction").all()
        assert asked.keys() == default.keys()


@pytest.mark.full
def test_every_kitchen_states_its_own_task():
    settings = {"design": [0, 1, 2], "verbs": ["open", "close"]}
    environments = vector(IDS["kitchens"], 3, instructions=True, autoreset_mode="SameStep", **settings)
    *_, infos = environments.reset(seed=0)
    assert len({*infos["instruction"]}) > 1
    single = gymnasium.make(IDS["kitchens"], instructions=True, design=1, verbs=settings["verbs"])
    assert single.reset(seed=1)[1]["instruction"] == infos["instruction"][1]


@pytest.mark.full
def test_infos_of_many_have_the_sentence_of_each():
    environments = vector(KITCHEN_ID, instructions=True, **PAIR)
    *_, infos = environments.reset(seed=1)
    assert infos["instruction"].tolist() == [SENTENCE] * 2
    assert infos["_instruction"].tolist() == [True] * 2
    *_, infos = environments.reset(options={"reset_mask": np.array([False, True])})
    assert infos["instruction"].tolist() == [None, SENTENCE]
    assert "instruction" not in vector(KITCHEN_ID).reset(seed=1)[1]


@pytest.mark.full
def test_hindsight_rewards_take_infos_with_sentences():
    environments = vector(KITCHEN_ID, instructions=True, **PAIR)
    environments.reset(seed=1)
    observations, rewards, *_, infos = environments.step(np.zeros((2, 9), np.float32))
    goals = observations["achieved_goal"], observations["desired_goal"]
    np.testing.assert_array_equal(environments.unwrapped.compute_reward(*goals, infos), rewards)


@pytest.mark.parametrize("build", [gymnasium.make, vector])
@pytest.mark.parametrize(
    ("settings", "error", "shown"),
    [
        ({"info_format": "arrays"}, ValueError, ["info_format", "'lists'"]),
        ({"instructions": 1}, TypeError, ["instructions", "1"]),
    ],
)
def test_sentences_in_arrays_are_refused(build, settings, error, shown):
    with refused(error, *shown):
        build(KITCHEN_ID, **{"instructions": True, **settings})


@pytest.mark.full
def test_a_task_without_a_sentence_cannot_be_asked_for_it(monkeypatch):
    monkeypatch.setattr(KitchenTask, "instructions", ())
    with pytest.raises(ValueError, match=r"^the tasks of kitchen have no sentences: leave out instructions$"):
        gymnasium.make(KITCHEN_ID, instructions=True)
    assert gymnasium.make(KITCHEN_ID).unwrapped.instruction == ""
