"""`kitchen_suite.Recording`: its episodes, and the arrays of all their control steps."""

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.errors import assert_is_short, refused

import kitchen_suite
from kitchen_suite import EnvironmentSpec
from kitchen_suite.episodes.episode import Episode, NamedArrays
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.episodes.transitions import Transitions
from kitchen_suite.policies import PolicyRef

# Written by version 1.0.0 (commit ffbabf1f): kitchen-record --task_name=kettle --seed=5 --num_episodes=2
# --max_episode_steps=3
RECORDING_OF_1_0 = Path(__file__).parent / "recording_of_1_0"
DIGEST_OF_1_0 = "a01065f5853f75931e1aed8cf0c2cadf653d1b3401a5744c2fad7005a994067e"

# A user's whole program: which episodes succeeded, and a linear policy of all of them.
PROGRAM = """
import sys
import numpy as np
from kitchen_suite import Recording

recording = Recording.open(sys.argv[1])
print(recording.spec.task_name, [(episode.seed, episode.success) for episode in recording])
steps = recording.load_transitions()
inputs = np.c_[steps.observations["observation"][steps.rows], np.ones(len(steps.rows))]
weights, *_ = np.linalg.lstsq(inputs, steps.actions, rcond=None)
print(weights.shape, np.abs(inputs @ weights - steps.actions).mean() < np.abs(steps.actions).mean() / 2)
"""


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Episodes of 6, 1 and 4 control steps, of which the first one alone succeeded, and the last one was cut short."""
    spec = EnvironmentSpec.make("kitchen", "kettle", {}, max_episode_steps=6)
    written = Recording.create(tmp_path_factory.mktemp("runs"), spec.episodes(PolicyRef.parse("random"), seed=10))
    for index, length in enumerate((6, 1, 4)):
        written.append(episode(index, length, success=not index))
    return written


def episode(index, length, success=False, **further):
    """An episode of which each number tells where it belongs: its episode in the hundreds, then its row."""
    rows = 100.0 * index + np.arange(length + 1)
    arrays = {
        "observation/observation": np.repeat(rows[:, np.newaxis], 59, axis=1),
        "observation/achieved_goal/kettle": np.repeat(rows[:, np.newaxis], 7, axis=1),
        "info/episode_step": np.arange(length + 1),
        "action": np.repeat(rows[1:, np.newaxis], 9, axis=1).astype(np.float32),
        "reward": rows[1:],
        "termination": np.arange(1, length + 1) == (6 if success else 0),
        "truncation": np.arange(1, length + 1) == (1 if index == 1 else 0),
        **further,
    }
    return Episode(index=index, seed=10 + index, arrays=NamedArrays(arrays), metrics={"success": success})


def test_an_opened_recording_has_its_specification_and_episodes(recording):
    opened = kitchen_suite.Recording.open(str(recording.folder))
    assert opened.spec == recording.spec
    assert (opened.spec.domain_name, opened.spec.task_name, opened.spec.policy) == ("kitchen", "kettle", "random")
    found = [(each.index, each.seed, each.success, each.steps, each.total_reward) for each in opened]
    assert found == [(0, 10, True, 6, 21.0), (1, 11, False, 1, 101.0), (2, 12, False, 4, 810.0)]
    assert [opened.load_summary(index).success for index in opened.indices] == [True, False, False]
    assert opened.successful == [0]


def test_arrays_of_all_steps_are_those_of_the_episodes_in_order(recording):
    steps = recording.load_transitions()
    states = steps.observations["observation"]
    assert (states.shape, states.dtype) == ((14, 59), np.float64)
    assert (steps.actions.shape, steps.actions.dtype) == ((11, 9), np.float32)
    assert (steps.rewards.shape, steps.rewards.dtype) == ((11,), np.float64)
    assert [each.dtype for each in (steps.terminations, steps.truncations, steps.ends)] == [np.bool_] * 3
    assert [each.dtype for each in (steps.rows, steps.last, steps.indices, steps.lengths)] == [np.int64] * 4
    assert steps.observations.keys() == {"observation", "achieved_goal/kettle"}
    before = [*range(6), 100, *range(200, 204)]
    assert states[steps.rows, 0].tolist() == before
    assert states[steps.rows + 1, 0].tolist() == [number + 1 for number in before]
    assert steps.rewards.tolist() == steps.actions[:, 8].tolist() == [number + 1 for number in before]
    assert np.flatnonzero(steps.ends).tolist() == [5, 6, 10]
    assert np.flatnonzero(steps.terminations).tolist() == [5]
    assert np.flatnonzero(steps.truncations).tolist() == [6]
    assert steps.last.tolist() == [5] * 6 + [6] + [10] * 4
    assert (steps.indices.tolist(), steps.lengths.tolist()) == ([0, 1, 2], [6, 1, 4])
    assert steps.arrays["info/episode_step"][steps.rows].tolist() == [*range(6), 0, *range(4)]


def test_chosen_episodes_come_in_the_order_in_which_they_are_named(recording):
    steps = recording.load_transitions([2, 1])
    assert steps.rewards.tolist() == [201, 202, 203, 204, 101]
    assert (steps.indices.tolist(), steps.lengths.tolist()) == ([2, 1], [4, 1])
    assert recording.load_transitions(recording.successful).lengths.tolist() == [6]


def test_no_episodes_or_different_arrays_are_refused(recording):
    with refused(ValueError, "there are no episodes"):
        recording.load_transitions([])
    with refused(OSError, "episode_000007.npz"):
        recording.load_transitions([7])
    with refused(ValueError, "episodes 0 and 1", "label/is_intervention"):
        Transitions.of([episode(0, 2), episode(1, 2, **{"label/is_intervention": np.ones(2, np.bool_)})])


def test_an_observation_that_is_one_array_has_a_key_as_well():
    arrays = {name: rows for name, rows in episode(0, 2).arrays.items() if not name.startswith("observation/")}
    one = dataclasses.replace(episode(0, 2), arrays=NamedArrays({**arrays, "observation": np.ones((3, 59))}))
    assert Transitions.of([one]).observations["observation"].shape == (3, 59)


PICTURES = {f"observation/pixels/{camera}": np.full((3, 4, 4, 3), i, np.uint8) for i, camera in enumerate("ab")}
PICTURES["observation/pixels/franka_hand"] = np.full((3, 4, 4, 3), 7, np.uint8)


@pytest.mark.parametrize(
    "name", ["franka/hand", "franka_hand", "pixels/franka/hand", "pixels/franka_hand", "observation/pixels/franka/hand"]
)
def test_a_picture_is_found_by_the_name_of_its_camera(name):
    played = episode(0, 2, **PICTURES)
    picture = played.arrays["observation/pixels/franka_hand"]
    assert played.arrays[name] is picture
    observed = Transitions.of([played]).observations
    np.testing.assert_array_equal(observed[name.removeprefix("observation/")], picture)


def test_a_name_that_is_not_there_is_an_error_that_names_those_there_are():
    played = episode(0, 2, **PICTURES)
    with refused(KeyError, "franka/hnad", "did you mean", "observation/pixels/franka_hand", "reward") as raised:
        played.arrays["pixels/franka/hnad"]
    assert_is_short(str(raised.value))
    with refused(KeyError, "'desired_goal'", "achieved_goal/kettle", "pixels/franka_hand"):
        Transitions.of([played]).observations["desired_goal"]
    assert "franka/hand" not in played.arrays
    assert played.arrays.get("franka/hand") is None


def test_a_name_that_may_be_either_of_two_arrays_is_not_guessed():
    arrays = NamedArrays({"observation/a/b_c": np.zeros(1), "observation/a_b/c": np.ones(1)})
    assert arrays["observation/a_b/c"] == 1
    with refused(KeyError, "observation/a/b/c"):
        arrays["observation/a/b/c"]


def test_a_played_episode_finds_its_arrays_alike():
    spec = EnvironmentSpec.make("kitchen", "kettle", {}, max_episode_steps=2)
    (played,) = kitchen_suite.play(spec, "zero", [0])
    assert played.arrays["achieved_goal/kettle"].shape == (3, 7)
    assert (played.success, played.total_reward) == (False, 0.0)


def test_a_recording_of_version_1_0_is_read():
    recording = Recording.open(RECORDING_OF_1_0)
    assert recording.spec.versions["kitchen-suite"] == "1.0.0"
    assert recording.digest(recording.indices) == DIGEST_OF_1_0
    steps = recording.load_transitions()
    assert steps.lengths.tolist() == [3, 3]
    assert steps.observations["observation"].shape == (8, 59)
    assert np.array_equal(steps.truncations, steps.ends)


@pytest.mark.full
def test_a_program_of_ten_lines_learns_a_linear_policy(tmp_path):
    spec = EnvironmentSpec.make("kitchen", "kettle", {}, max_episode_steps=40)
    kitchen_suite.record(tmp_path / "runs", spec, "expert(action_noise=0.1)", num_episodes=2, seed=3)
    command = [sys.executable, "-c", PROGRAM, str(tmp_path / "runs")]
    printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    assert printed == "kettle [(3, True), (4, True)]\n(60, 9) True\n"
