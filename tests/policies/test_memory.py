"""Policies with a memory: each episode has its own, whatever is given and however many are played at once."""

import functools
import threading

import numpy as np
import pytest
from helpers.errors import refused
from helpers.policies_with_memory import (
    EPISODES,
    LIMIT,
    SPEC,
    Chunks,
    Recurrent,
    Rows,
    RowsOfChunks,
    RowsOfRecurrent,
    alone,
    assert_as_alone,
    chunk,
    joints,
    make_chunks,
)

import kitchen_suite
from kitchen_suite import suite
from kitchen_suite.commands import evaluate, record, rollout
from kitchen_suite.episodes.play import play_singly
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.policies import PolicyError, PolicyRef

CABINET = {"domain_name": "open_cabinet", "num_episodes": EPISODES, "max_episode_steps": LIMIT}


# What is given, and what it takes.
GIVEN = {
    "a class": (lambda: Chunks, "observation", Chunks),
    "a function": (lambda: make_chunks, "timestep", Chunks),
    "a function with defaults": (lambda: lambda size=8: Recurrent(), "observation", Recurrent),
    "an object": (Chunks, "timestep", Chunks),
    "a recurrent object": (Recurrent, "observation", Recurrent),
    "a method of an object": (lambda: Recurrent().act, "observation", Recurrent),
    "a part of a method": (lambda: functools.partial(Recurrent().act), "observation", Recurrent),
    "an object for a batch": (RowsOfChunks, "batch", Chunks),
    "a method for a batch": (lambda: RowsOfRecurrent().__call__, "batch", Recurrent),
    "a class for a batch": (lambda: RowsOfRecurrent, "batch", Recurrent),
}


@pytest.mark.full
@pytest.mark.parametrize("num_envs", [1, 4, 16])
@pytest.mark.parametrize("case", GIVEN)
def test_an_episode_has_a_memory_of_its_own(case, num_envs):
    make, takes, policy = GIVEN[case]
    assert_as_alone(kitchen_suite.play(SPEC, make(), range(EPISODES), takes=takes, num_envs=num_envs), policy)


@pytest.mark.parametrize("case", ["a class", "a recurrent object", "an object for a batch"])
def test_three_environments_are_filled_again_without_the_memory_of_the_last_episode(case):
    make, takes, policy = GIVEN[case]
    assert_as_alone(kitchen_suite.play(SPEC, make(), range(EPISODES), takes=takes, num_envs=3), policy)


@pytest.mark.full
@pytest.mark.parametrize(
    ("policy", "rows"), [(Chunks, RowsOfChunks), (Recurrent, RowsOfRecurrent)], ids=["chunks", "recurrent"]
)
def test_evaluations_and_recordings_are_those_of_one_environment(policy, rows, tmp_path):
    evaluations, recordings = [], []
    for num_envs in (1, 4, 16):
        for given, takes in ((policy, "timestep"), (policy(), "observation"), (rows(), "batch")):
            threads = min(num_envs, 2)
            arguments = {"takes": takes, "num_envs": num_envs, "num_threads": threads}
            folder = tmp_path / f"{takes}_{num_envs}"
            evaluations.append(kitchen_suite.evaluate(given, **CABINET, **arguments))
            recording = kitchen_suite.record(folder, SPEC, given, num_episodes=EPISODES, **arguments)
            recordings.append([episode.digest for episode in recording])
            assert_as_alone(recording, policy)
    assert recordings == [recordings[0]] * len(recordings)
    first = evaluations[0]
    for other in evaluations[1:]:
        assert other.results == first.results
        for name, traces in first.traces.items():
            for one, another in zip(traces, other.traces[name], strict=True):
                np.testing.assert_array_equal(one.actions, another.actions)
    comparison = kitchen_suite.compare(first, evaluations[-1])
    assert (comparison.wins, comparison.losses) == (0, 0)
    assert first.check().verdict == "equal"


MODULE = """
from helpers.policies_with_memory import Chunks, Recurrent

class Acting(Chunks):
    pass

chunks, recurrent = Chunks(), Recurrent()
"""


@pytest.mark.full
@pytest.mark.parametrize(
    ("name", "policy"),
    [
        ("my_policies:Acting", Chunks),
        ("my_policies:chunks", Chunks),
        ("gym:my_policies:Recurrent", Recurrent),
        ("gym:my_policies:recurrent", Recurrent),
        ("gym:my_policies:recurrent.act", Recurrent),
    ],
)
def test_commands_play_the_policy_of_a_file_alike_in_1_4_and_16_environments(name, policy, write_policies, folder, run):
    write_policies(MODULE)
    common = ["--domain_name=open_cabinet", f"--num_episodes={EPISODES}", f"--max_episode_steps={LIMIT}"]
    for count in (1, 4, 16):
        arguments = [*common, f"--policy={name}", f"--num_envs={count}"]
        assert run(record, *arguments, "--variations=start", f"--output=runs_{count}")[0] == 0
        assert_as_alone(Recording.open(folder / f"runs_{count}"), policy)
        assert run(evaluate, *arguments, f"--json={count}.json", f"--receipt={count}.npz")[0] == 0
    for count in (4, 16):
        assert (folder / f"{count}.json").read_bytes() == (folder / "1.json").read_bytes()
        assert (folder / f"{count}.npz").read_bytes() == (folder / "1.npz").read_bytes()
    # One after the other, in float64.
    output = "--output=rollout"
    assert run(rollout, *common, f"--policy={name}", "--variations=start", output)[0] == 0
    assert len(Recording.open(folder / "rollout").indices) == EPISODES


def test_a_factory_is_called_once_for_each_environment_and_objects_are_reset_before_each_episode():
    made = []

    class Counted(Chunks):
        def __init__(self):
            super().__init__()
            self.resets = 0
            made.append(self)

        def reset(self):
            super().reset()
            self.resets += 1

    assert len([*kitchen_suite.play(SPEC, Counted, range(6), num_envs=3)]) == 6
    assert len(made) == 3
    assert sum(each.resets for each in made) == 6
    given = Counted()
    assert len([*kitchen_suite.play(SPEC, given, range(4), num_envs=2)]) == 4
    assert given.resets == 0, "copies act, not the object that was given"


def test_a_factory_of_policies_without_reset_is_called_for_each_episode():
    made = []

    def make():
        waiting = []

        def act(timestep):
            if not waiting:
                waiting.extend(chunk(joints(timestep)))
            return waiting.pop(0)

        made.append(act)
        return act

    assert_as_alone(kitchen_suite.play(SPEC, make, range(EPISODES), num_envs=3), Chunks)
    assert len(made) == EPISODES


def test_a_batched_policy_is_told_of_exactly_the_rows_that_begin_an_episode():
    lengths = {seed: len(actions) for seed, actions in alone(Chunks).items()}
    # Which row plays what, and when it begins the next one.
    policy, num_envs = RowsOfChunks(), 4
    assert_as_alone(kitchen_suite.play(SPEC, policy, range(EPISODES), takes="batch", num_envs=num_envs), Chunks)
    left, waiting, expected = [0] * num_envs, [*range(EPISODES)], []
    while waiting or any(left):
        beginning = [row for row in range(num_envs) if not left[row]][: len(waiting)]
        for row in beginning:
            left[row] = lengths[waiting.pop(0)]
        if beginning:
            expected.append(beginning)
        left = [max(0, steps - 1) for steps in left]
    assert policy.told == expected


class Locked(Chunks):
    def __init__(self):
        super().__init__()
        self.lock = threading.Lock()


class Same(Chunks):
    def __deepcopy__(self, memo):
        return self


class NeedsRows(Chunks):
    def reset(self, rows):
        pass


class NeedsPath(Chunks):
    def __init__(self, path):
        super().__init__()


def act_with_a_default(timestep=None):
    return np.zeros(8)


def failing():
    raise KeyError("weights")


def resetting(rows):
    raise KeyError("row 7")


FAILING_RESET = Rows(Chunks)
FAILING_RESET.reset = resetting
THE_SAME = Chunks()

REFUSED = {
    "it cannot be copied": (Locked(), "timestep", ["cannot be copied", "Locked", "a factory"]),
    "a method of what cannot be copied": (Locked().__call__, "observation", ["cannot be copied", "a factory"]),
    "its copy is itself": (Same(), "timestep", ["the same object", "a factory"]),
    "reset without rows": (Chunks(), "batch", ["takes no rows", "reset(rows)"]),
    "a method without rows": (Recurrent().act, "batch", ["takes no rows", "reset(rows)"]),
    "a factory without rows": (Chunks, "batch", ["takes no rows", "reset(rows)"]),
    "reset with rows": (NeedsRows(), "timestep", ["reset() of", "(rows)", "takes='batch'"]),
    "a factory with rows": (lambda: NeedsRows(), "timestep", ["reset() of", "(rows)", "takes='batch'"]),
    "a class that needs arguments": (NeedsPath, "timestep", ["NeedsPath", "needs arguments", "a factory"]),
    "an action": (act_with_a_default, "timestep", ["act_with_a_default", "requires no argument", "a factory returns"]),
    "a class of a factory": (lambda: Chunks, "timestep", ["returned", "a factory returns a policy"]),
    "a factory that fails": (failing, "timestep", ["factory", "failing", "KeyError: 'weights'", "test_memory.py"]),
    "a reset that fails": (FAILING_RESET, "batch", ["reset(rows)", "row 7", "test_memory.py"]),
    "the same object twice": (lambda: THE_SAME, "timestep", ["returns the same object twice"]),
}


@pytest.mark.parametrize("case", REFUSED)
def test_memories_that_would_be_mixed_and_what_makes_no_policy_are_refused(case, tmp_path):
    policy, takes, shown = REFUSED[case]
    with refused(PolicyError, *shown):
        kitchen_suite.record(tmp_path / "runs", SPEC, policy, takes=takes, num_episodes=2, num_envs=2)
    assert not [*tmp_path.iterdir()]


def test_an_evaluation_refuses_what_it_would_mix_and_leaves_nothing(tmp_path):
    for policy, takes in ((Locked(), "timestep"), (Chunks(), "batch"), (Chunks, "batch")):
        with refused(PolicyError, "has a reset()" if takes == "batch" else "cannot be copied"):
            kitchen_suite.evaluate(policy, takes=takes, **CABINET, output=tmp_path / "evaluation")
        assert not [*tmp_path.iterdir()]


def test_a_command_refuses_an_object_that_cannot_be_copied_in_one_line(write_policies, refusal):
    write_policies(MODULE + "\nimport threading\nchunks.lock = threading.Lock()\n")
    line = refusal(evaluate, "--domain_name=open_cabinet", "--policy=my_policies:chunks", "--num_episodes=1")
    assert "my_policies:chunks" in line
    assert "a factory" in line


class AnyArguments:
    """Is called as a module of PyTorch is, whose signature requires nothing."""

    def __call__(self, *args, **kwargs):
        (given,) = args
        return np.zeros((*given.shape[:-1], 8))


def test_a_policy_of_any_number_of_arguments_is_no_factory():
    for takes in ("observation", "batch"):
        (episode,) = kitchen_suite.play(SPEC, AnyArguments(), [0], takes=takes)
        assert not episode.arrays["action"].any()


def test_a_builder_resets_the_policy_of_a_row_and_makes_another_one_without_a_row():
    environment = suite.load("open_cabinet", "top_drawer", {"visuals": False})
    build = PolicyRef.of(Chunks()).builder()
    timestep = environment.reset()

    def next_action(**row):
        return build(environment, np.random.default_rng(0), **row)(timestep)

    one, other = (build(environment, np.random.default_rng(0)) for _ in range(2))
    first, second = one(timestep), one(timestep)
    assert (first != second).any()
    np.testing.assert_array_equal(other(timestep), first)
    of_row = build(environment, np.random.default_rng(0), row="a")
    of_row(timestep)
    np.testing.assert_array_equal(next_action(row="b"), first)
    np.testing.assert_array_equal(of_row(timestep), second)
    np.testing.assert_array_equal(next_action(row="a"), first)


def test_episodes_one_after_the_other_have_one_policy_that_is_reset():
    made = []

    class Counted(Chunks):
        def __init__(self):
            super().__init__()
            made.append(self)

    reference = PolicyRef.of(Counted, "observation")
    spec = SPEC.episodes(reference, seed=0)
    episodes = play_singly([(seed, seed) for seed in range(EPISODES)], spec, reference)
    for episode in episodes:
        expected = alone(Chunks)[episode.seed]
        # Their actions are float64, those of environments with an action space float32: both end alike.
        np.testing.assert_allclose(episode.arrays["action"][: len(expected)], expected[: episode.steps], atol=1e-5)
    assert len(made) == 1
