"""`kitchen_suite.play` and `record`: policies of all kinds, and episodes that depend on their seed alone."""

import dataclasses
import json

import numpy as np
import pytest
from helpers.errors import refused

import kitchen_suite
from kitchen_suite import EnvironmentSpec
from kitchen_suite.commands import evaluate
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.policies import PolicyError, PolicyRef, load_policy
from kitchen_suite.policies.files import SHIPPED, shipped_as

LIMIT = 12


def kitchen(**kwargs):
    return EnvironmentSpec.make("kitchen", "kettle", kwargs, LIMIT)


def by_seed(episodes):
    return {episode.seed: episode for episode in episodes}


def assert_same(one, other):
    assert one.keys() == other.keys()
    for seed, episode in one.items():
        assert episode.digest == other[seed].digest
        assert episode.metrics == other[seed].metrics


@pytest.mark.full
@pytest.mark.parametrize("num_envs", [2, 5])
def test_an_episode_depends_on_its_seed_alone(num_envs):
    alone = by_seed(kitchen_suite.play(kitchen(), "random", [3, 9, 4]))
    assert [alone[seed].index for seed in (3, 9, 4)] == [0, 1, 2]
    assert_same(alone, by_seed(kitchen_suite.play(kitchen(), "random", [3, 9, 4], num_envs=num_envs)))
    later = by_seed(kitchen_suite.play(kitchen(), "random", [9]))
    for name, array in later[9].arrays.items():
        np.testing.assert_array_equal(array, alone[9].arrays[name], name)


@pytest.mark.full
def test_an_episode_is_that_of_the_gymnasium_environment():
    spec = kitchen()
    (episode,) = kitchen_suite.play(spec, "random", [7])
    environment = spec.make_environment()
    observation, _ = environment.reset(seed=7)
    for step, action in enumerate(episode.arrays["action"]):
        np.testing.assert_array_equal(episode.arrays["observation/observation"][step], observation["observation"])
        observation, reward, *_ = environment.step(action)
        assert reward == episode.arrays["reward"][step]
    assert episode.summary.steps == LIMIT
    assert episode.summary.total_reward == episode.arrays["reward"].sum()


@pytest.mark.full
def test_the_environments_of_a_recording_are_played_and_recorded_again(tmp_path):
    spec = EnvironmentSpec.make("open_cabinet", None, {}, 3)
    first = kitchen_suite.record(tmp_path / "first", spec, "random", num_episodes=1, seed=5)
    assert first.spec.policy == "random"
    assert_same(by_seed(first), by_seed(kitchen_suite.play(first.spec, "random", [5])))
    second = kitchen_suite.record(tmp_path / "second", first.spec, "zero", num_episodes=1, seed=6)
    assert (second.spec.policy, second.spec.seed, second.spec.task_kwargs) == ("zero", 6, first.spec.task_kwargs)
    # By another policy than the one of the recording, whose file had this digest.
    of_a_file = dataclasses.replace(first.spec, policy_sha256="0" * 64)
    (episode,) = kitchen_suite.play(of_a_file, SHIPPED / "top_drawer.npz", [5])
    assert episode.steps == 3


def of_observation(observation):
    return 0.01 * observation["observation"][:9]


def of_batch(observations):
    return 0.01 * observations["observation"][:, :9]


@pytest.mark.full
def test_a_callable_may_take_a_time_step_an_observation_or_a_batch():
    spec = EnvironmentSpec.make("kitchen", "kettle", {"robot_noise_ratio": 0.0}, LIMIT)
    one = by_seed(kitchen_suite.play(spec, of_observation, range(3), takes="observation", num_envs=2))
    assert_same(one, by_seed(kitchen_suite.play(spec, of_batch, range(3), takes="batch", num_envs=2)))
    assert_same(one, by_seed(kitchen_suite.play(spec, of_batch, range(3), takes="batch")))
    (episode,) = kitchen_suite.play(spec, lambda timestep: np.full(9, 0.1), [0])
    np.testing.assert_array_equal(episode.arrays["action"], np.full((LIMIT, 9), np.float32(0.1)))


@pytest.mark.full
def test_a_file_is_a_policy():
    file = shipped_as("kettle")
    trained_for = load_policy(file).metadata
    spec = EnvironmentSpec.make("kitchen", trained_for["task_name"], trained_for["task_kwargs"], LIMIT)
    named = by_seed(kitchen_suite.play(spec, f"trained(file={str(file)!r})", [0]))
    assert_same(named, by_seed(kitchen_suite.play(spec, file, [0])))
    assert_same(named, by_seed(kitchen_suite.play(spec, str(file), [0])))


class NeedsGradient:
    """Raises as a tensor of PyTorch does that requires a gradient, where it is taken for an array."""

    def __array__(self, dtype=None, copy=None):
        raise RuntimeError("Can't call numpy() on Tensor that requires grad")


BAD_BATCHES = {
    "a tensor that requires a gradient": (lambda observations: NeedsGradient(), "requires grad"),
    "rows of two lengths": (lambda observations: [[0.0], [0.0, 1.0]], "bad actions"),
    "the shape": (lambda observations: np.zeros(9), "shape"),
    "strings": (lambda observations: np.full((2, 9), "x"), "numbers"),
    "NaN": (lambda observations: np.full((2, 9), np.nan), "finite"),
    "an exception": (lambda observations: observations["nothing"], "KeyError"),
}


@pytest.mark.full
@pytest.mark.parametrize("case", BAD_BATCHES)
def test_bad_actions_of_a_batch_are_refused(case):
    policy, shown = BAD_BATCHES[case]
    with refused(PolicyError, "test_play_function", shown):
        list(kitchen_suite.play(kitchen(), policy, range(2), takes="batch", num_envs=2))


@pytest.mark.parametrize("num_envs", [1, 2])
def test_a_bad_action_of_an_observation_is_refused(num_envs):
    with refused(PolicyError, "test_play_function", "bad action", "requires grad"):
        list(kitchen_suite.play(kitchen(), lambda timestep: NeedsGradient(), range(2), num_envs=num_envs))


def test_bad_arguments_are_refused():
    for arguments, shown in (
        ({"policy": "rndom"}, "'random'"),
        ({"policy": "random", "takes": "batch"}, "callables"),
        ({"policy": of_batch, "takes": "batches"}, "'batch'"),
        ({"policy": "random", "num_envs": 0}, "num_envs"),
        ({"policy": "random", "seeds": [-1]}, "seed"),
    ):
        with refused(ValueError, shown):
            list(kitchen_suite.play(kitchen(), **{"seeds": [0], **arguments}))
    with refused(TypeError, "callable"):
        PolicyRef.of(3)


@pytest.mark.full
def test_a_recording_is_of_what_play_plays(tmp_path):
    made = kitchen_suite.record(tmp_path / "runs", kitchen(), "random", num_episodes=3, seed=5, num_envs=2)
    assert_same(by_seed(kitchen_suite.play(kitchen(), "random", range(5, 8))), by_seed(made))
    assert [episode.seed for episode in Recording.open(tmp_path / "runs")] == [5, 6, 7]
    longer = kitchen_suite.record(tmp_path / "runs", kitchen(), "random", num_episodes=4, seed=5)
    assert [episode.index for episode in longer] == [0, 1, 2, 3]
    with refused(ValueError, "runs", "policy"):
        kitchen_suite.record(tmp_path / "runs", kitchen(), "zero", num_episodes=4, seed=5)


@pytest.mark.full
def test_a_recording_of_a_callable_replays_without_it(tmp_path):
    made = kitchen_suite.record(tmp_path / "runs", kitchen(), of_batch, takes="batch", num_episodes=2)
    assert made.spec.policy == f"object {__name__}.of_batch"
    assert kitchen_suite.replay(tmp_path / "runs").verdict == "equal"


@pytest.mark.full
def test_an_evaluation_has_the_numbers_of_the_command(tmp_path, run):
    evaluation = kitchen_suite.evaluate(
        "expert", num_episodes=2, max_episode_steps=LIMIT, receipt=tmp_path / "receipt.npz"
    )
    arguments = ["--policy=expert", "--num_episodes=2", f"--max_episode_steps={LIMIT}"]
    assert run(evaluate, *arguments, f"--json={tmp_path / 'scores.json'}")[0] == 0
    assert evaluation.as_json() == json.loads((tmp_path / "scores.json").read_text())
    assert evaluation.scores["success"] == 0.0
    assert kitchen_suite.replay(tmp_path / "receipt.npz").verdict == "equal"


@pytest.mark.full
def test_a_batched_policy_is_evaluated(tmp_path):
    evaluation = kitchen_suite.evaluate(
        of_batch, takes="batch", task_name="kettle", num_episodes=3, max_episode_steps=LIMIT, num_envs=2
    )
    same = kitchen_suite.evaluate(
        of_observation, takes="observation", task_name="kettle", num_episodes=3, max_episode_steps=LIMIT
    )
    assert evaluation.scores == same.scores
    assert evaluation.as_json()["policy"] == f"object {__name__}.of_batch"


@pytest.mark.full
def test_a_recording_of_an_object_is_not_continued_by_another_one(tmp_path):
    kitchen_suite.record(tmp_path / "runs", kitchen(), lambda timestep: np.zeros(9), num_episodes=1)
    with refused(FileExistsError, "runs", "object"):
        kitchen_suite.record(tmp_path / "runs", kitchen(), lambda timestep: np.ones(9), num_episodes=2)
    with refused(ValueError, "resumed"):
        kitchen_suite.evaluate(of_batch, takes="batch", output=tmp_path / "evaluation", resume=True)


@pytest.mark.full
def test_arguments_of_numpy_are_those_of_python(tmp_path):
    given = {"threshold": np.float64(0.25), "tasks_to_complete": np.array(["kettle"])}
    spec = EnvironmentSpec.make("kitchen", "all", given, np.int64(LIMIT))
    same = EnvironmentSpec.make("kitchen", "all", {"threshold": 0.25, "tasks_to_complete": ["kettle"]}, LIMIT)
    assert spec == same
    assert spec.episodes(PolicyRef.parse("random"), seed=np.int64(3)).as_json()["seed"] == 3
    kitchen_suite.record(tmp_path / "runs", spec, "random", num_episodes=np.int64(1), seed=np.uint8(3))
    assert [episode.seed for episode in Recording.open(tmp_path / "runs")] == [3]


@pytest.mark.full
def test_an_evaluation_of_numbers_of_numpy_can_be_written(tmp_path):
    receipt = tmp_path / "receipt.npz"
    arguments = {"task_name": "kettle", "max_episode_steps": np.int16(3), "receipt": receipt}
    evaluation = kitchen_suite.evaluate("random", seed=np.int64(5), num_episodes=np.int64(2), **arguments)
    written = json.loads(json.dumps(evaluation.as_json()))
    assert (written["seed"], written["num_episodes"], written["max_episode_steps"]) == (5, 2, 3)
    assert kitchen_suite.replay(receipt).verdict == "equal"


def test_no_arguments_are_the_defaults():
    assert EnvironmentSpec.make("kitchen", "kettle", None) == EnvironmentSpec.make("kitchen", "kettle", {})


@pytest.mark.parametrize("value", ["", 0, [], [("threshold", 0.3)]])
def test_arguments_that_are_no_dict_are_refused(value):
    with refused(TypeError, "task_kwargs must be a dict or None", repr(value)):
        EnvironmentSpec.make("kitchen", "kettle", value)


def test_an_argument_that_json_cannot_hold_is_refused():
    with refused(TypeError, "threshold must consist of what JSON can hold"):
        EnvironmentSpec.make("kitchen", "kettle", {"threshold": {0.3}})


@pytest.mark.parametrize("steps", [0, -1, 2.5, True])
def test_a_bad_length_of_episodes_is_refused(steps):
    with refused((TypeError, ValueError), "max_episode_steps"):
        EnvironmentSpec.make("kitchen", "kettle", {}, steps)


def test_bad_numbers_of_environments_leave_nothing_behind(tmp_path):
    for call in (
        lambda: kitchen_suite.record(tmp_path / "runs", kitchen(), "zero", num_episodes=1, num_envs=0),
        lambda: kitchen_suite.evaluate("zero", num_episodes=1, num_envs=0, output=tmp_path / "evaluation"),
    ):
        with refused(ValueError, "num_envs"):
            call()
    assert not [*tmp_path.iterdir()]


def test_a_receipt_without_a_folder_is_refused_before_anything_is_played(tmp_path):
    with refused(FileNotFoundError, "nowhere"):
        kitchen_suite.evaluate("zero", num_episodes=10**5, receipt=tmp_path / "nowhere" / "receipt.npz")


def test_a_reference_and_a_path_say_themselves_what_they_are(tmp_path):
    reference = PolicyRef.of(of_batch, "batch")
    assert PolicyRef.of(reference) is reference
    assert PolicyRef.of(reference, "batch") is reference
    with refused(ValueError, "contradicts", "'batch'"):
        PolicyRef.of(reference, "observation")
    named = PolicyRef.of(tmp_path / "policy (1).npz")
    assert (named.key, named.file()) == ("trained", tmp_path / "policy (1).npz")
    with refused(ValueError, "not well-formed"):
        PolicyRef.parse("expert(speed=0.8, speed=2)")


@pytest.mark.full
def test_a_recording_with_a_gap_counts_what_it_has(tmp_path):
    recording = kitchen_suite.record(tmp_path / "runs", kitchen(), "zero", num_episodes=5)
    recording.remove(2)
    assert recording.present(4) == [0, 1, 3]
    assert recording.missing(4) == [(2, 2)]


@pytest.mark.full
def test_a_label_of_some_actions_alone_is_refused():
    class Forgetful:
        labels = {"a": 1.0}

        def __call__(self, timestep):
            self.labels = {} if timestep.reward is not None else {"a": 1.0}
            return np.zeros(9)

    with refused(PolicyError, "['a']"):
        list(kitchen_suite.play(kitchen(), Forgetful(), range(2), num_envs=2))
