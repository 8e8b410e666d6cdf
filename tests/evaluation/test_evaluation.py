"""`Evaluation` as a value: written, read, checked, compared; what files say is held to the rest of it."""

import copy
import dataclasses
import json

import numpy as np
import pytest
from helpers.errors import refused

import kitchen_suite
from kitchen_suite import Evaluation, files
from kitchen_suite.commands import compare, evaluate, replay
from kitchen_suite.evaluation.evaluation import AlteredError
from kitchen_suite.evaluation.text import format_comparison, format_evaluation
from kitchen_suite.policies.files import shipped_as

pytestmark = pytest.mark.usefixtures("folder")

SHORT = {"task_name": "kettle", "num_episodes": 2, "max_episode_steps": 5, "num_envs": 2}


@pytest.fixture(scope="module")
def short():
    """An evaluation of two episodes of five control steps, in which nothing succeeds."""
    return kitchen_suite.evaluate("random", quality=True, **SHORT)


@pytest.mark.parametrize("name", ["a.npz", "a.json"])
def test_what_is_written_is_read(short, name):
    short.write(name)
    found = Evaluation.read(name)
    assert found.name == "a"
    assert found.plan.description == short.plan.description
    assert found.results == short.results
    assert found.as_json() == short.as_json()
    assert found.scores == short.scores
    found.write(f"again_{name}")
    assert files.Path(name).read_bytes() == files.Path(f"again_{name}").read_bytes()


def test_the_actions_are_kept_without_a_receipt(short):
    short.write("a.npz")
    (traces,) = short.traces.values()
    (found,) = Evaluation.read("a.npz").traces.values()
    for one, other in zip(traces, found, strict=True):
        assert one.actions.shape == (5, 9)
        np.testing.assert_array_equal(one.actions, other.actions)
        assert one.first_difference(other) is None


def test_an_evaluation_is_checked_without_files(short):
    seen = []
    check = short.check(progress=seen.append)
    assert check.verdict == "equal"
    assert [episode.verdict for episode in check.episodes] == ["equal", "equal"]
    assert [episode.seed for episode in check.episodes] == [400_000_000, 400_000_001]
    assert not check.differing
    assert check.scores == short.scores
    assert {id(episode) for episode in seen} == {id(episode) for episode in check.episodes}


@pytest.mark.full
@pytest.mark.parametrize(("quality", "verdict"), [(False, "other digits"), (True, "altered")])
def test_a_check_names_the_episode_and_the_numbers_that_differ(quality, verdict):
    """Other actions change positions here, and of the results only those of quality, such as the path's length."""
    evaluation = kitchen_suite.evaluate("random", quality=quality, **SHORT)
    ((name, traces),) = evaluation.traces.items()
    altered = dataclasses.replace(traces[1], actions=-traces[1].actions)
    check = dataclasses.replace(evaluation, traces={name: [traces[0], altered]}).check()
    assert check.verdict == verdict
    assert [episode.verdict for episode in check.episodes] == ["equal", verdict]
    (episode,) = check.differing
    assert (episode.condition, episode.episode, episode.seed) == (name, 1, 400_000_001)
    assert episode.differences[0] == "numbers differ from control step 1 on"
    assert any(each.startswith("measures ") for each in episode.differences) == quality


def test_other_endings_are_refused(short):
    with refused(ValueError, ".npz", ".json", "'a.txt'"):
        short.write("a.txt")
    with refused(ValueError, ".npz", "'a.json'"):
        kitchen_suite.evaluate("zero", receipt="a.json", **SHORT)


def rows(data):
    return data["episodes"]["kettle"]


# Alterations of JSON with its episodes; those of receipts are in test_receipts.py.
FORGED = {
    "every success": lambda data: [row.update(success=True) for row in rows(data)],
    "one episode twice": lambda data: rows(data).__setitem__(1, copy.deepcopy(rows(data)[0])),
    "one episode less": lambda data: rows(data).pop(),
    "other seeds": lambda data: [row.update(seed=row["seed"] + 7) for row in rows(data)],
    "another number": lambda data: rows(data)[0].update(episode=1),
    "another condition": lambda data: rows(data)[0].update(condition="all"),
    "conditions": lambda data: data["episodes"].update(all=data["episodes"].pop("kettle")),
    "control steps": lambda data: rows(data)[0].update(control_steps=10**9),
    "no control steps": lambda data: rows(data)[0].update(control_steps=0),
    "a limit": lambda data: data.update(max_episode_steps=10**9),
    "a count": lambda data: data.update(num_episodes=10**9),
    "a measure less": lambda data: rows(data)[0]["measures"].pop("energy"),
    "a measure more": lambda data: rows(data)[0]["measures"].update(mine=1.0),
    "another measure": lambda data: rows(data)[0]["measures"].update(energy=1e6),
    "no number": lambda data: rows(data)[0].update(progress=float("inf")),
    "a score": lambda data: data.update(success=1.0),
    "a type": lambda data: data.update(success=False),
    "an interval": lambda data: data["intervals"].update(success=[0.9, 1.0]),
    "a score of a condition": lambda data: data["conditions"]["kettle"].update(success=1.0),
    "other tasks": lambda data: rows(data)[0].update(asked={"microwave": None}),
    "another domain": lambda data: data.update(domain_name="open_cabinet"),
    "code": lambda data: data.update(domain_name="os:system"),
    "a version": lambda data: data["versions"].update(mujoco="3, confirmed by its authors"),
    "an escape": lambda data: data.update(policy="x\x1b[2J"),
    "more": lambda data: data.update(more=1),
    "no episodes": lambda data: data.update(episodes=3),
    "a task done too late": lambda data: rows(data)[0].update(asked={"kettle": 10**6}),
    "success of a diverged episode": lambda data: rows(data)[0].update(diverged=True, success=True),
    "clean without success": lambda data: rows(data)[0]["measures"].update(clean_success=True),
}


@pytest.mark.parametrize("kind", FORGED)
def test_json_that_does_not_agree_with_itself_is_refused_by_every_reader(run, short, kind):
    short.write("a.json")
    short.write("b.npz")
    data = json.loads(files.Path("a.json").read_text("utf-8"))
    FORGED[kind](data)
    files.Path("c.json").write_text(json.dumps(data), encoding="utf-8")
    with pytest.raises(AlteredError, match=r"^c\.json: "):
        Evaluation.read("c.json")
    with pytest.raises(AlteredError):
        kitchen_suite.compare("c.json", "b.npz")
    status, out, err = run(compare, "c.json", "b.npz")
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert "\x1b" not in err


# Alterations of an episode from which all scores are computed anew, and what each is refused for.
CONTRADICTIONS = {
    "another seed": ({"seed": 7}, "is another one"),
    "too long": ({"control_steps": 6}, "6 control steps, of at most 5"),
    "no length": ({"control_steps": 0}, "0 control steps"),
    "diverged early": ({"diverged": True, "control_steps": 3}, "3 control steps"),
    "diverged and succeeded": ({"diverged": True, "success": True}, "has diverged, and completed something"),
    "diverged and completed": ({"diverged": True, "asked": {"kettle": 2}}, "has diverged, and completed something"),
    "done too late": ({"asked": {"kettle": 6}}, "completes tasks at control steps [6], of 5"),
    "other measures": ({"measures": {"energy": 1.0}}, "is measured by ['energy']"),
    "clean without success": ({"clean": True}, "has clean_success True, and success False"),
    "clean by a half": ({"clean": 0.5}, "has clean_success 0.5"),
}


@pytest.mark.parametrize("kind", CONTRADICTIONS)
def test_an_episode_that_contradicts_itself_is_refused_though_scores_follow_from_it(short, kind):
    changes, shown = CONTRADICTIONS[kind]
    ((name, results),) = short.results.items()
    if "clean" in changes:
        changes = {"measures": {**results[0].measures, "clean_success": changes["clean"]}}
    altered = dataclasses.replace(results[0], **changes)
    forged = dataclasses.replace(short, results={name: [altered, *results[1:]]})
    forged.write("a.json")
    forged.write("a.npz")
    for path in ("a.json", "a.npz"):
        with refused(AlteredError, path, "episode 0 of kettle", shown):
            Evaluation.read(path)


def test_comparisons_say_that_files_were_not_replayed(short):
    short.write("a.json")
    assert "not replayed" not in format_comparison(kitchen_suite.compare(short, short))
    assert "not replayed, as kitchen-replay does: a\n" in format_comparison(kitchen_suite.compare("a.json", short))


def refuses(destination, *words, **arguments):
    """Asserts that an evaluation is refused before its first episode, and that nothing is left behind."""
    calls = []
    before = sorted(files.Path().rglob("*"))
    with pytest.raises((OSError, ValueError)) as error:
        kitchen_suite.evaluate(lambda timestep: calls.append(timestep), **SHORT, **{**arguments, **destination})
    assert all(word in str(error.value) for word in words), error.value
    assert not calls
    assert sorted(files.Path().rglob("*")) == before


def test_a_receipt_in_place_of_a_folder_is_refused_before_the_first_episode():
    files.Path("taken.npz").mkdir()
    refuses({"receipt": "taken.npz"}, "receipt", "folder")


def test_a_receipt_in_a_missing_folder_is_refused_before_the_first_episode():
    refuses({"receipt": "missing/a.npz"}, "missing", "receipt")


def test_a_receipt_that_is_its_own_folder_is_refused_before_the_first_episode():
    refuses({"output": "o.npz", "receipt": "o.npz"}, "must be different files")


def test_a_receipt_never_replaces_a_trace():
    files.Path("runs/traces").mkdir(parents=True)
    refuses({"output": "runs", "receipt": "runs/traces/000_000000.npz"}, "must not be in the folder")


def test_a_receipt_never_replaces_an_episode_of_its_dataset():
    files.Path("runs").mkdir()
    refuses({"dataset": "runs", "receipt": "runs/episode_000000.npz"}, "must not be in the folder")


def test_a_receipt_never_replaces_the_policy(run):
    files.Path("policy.npz").write_bytes(shipped_as("kettle").read_bytes())
    before = files.Path("policy.npz").read_bytes()
    status, _, err = run(evaluate, "--policy=policy.npz", "--task_name=kettle", "--receipt=policy.npz")
    assert (status, "must be different files" in err) == (2, True)
    assert files.Path("policy.npz").read_bytes() == before


@pytest.mark.full
def test_a_comparison_is_never_written_into_a_recording(run, short):
    short.write("a.npz")
    spec = kitchen_suite.EnvironmentSpec.make("kitchen", "kettle", {}, max_episode_steps=2)
    kitchen_suite.record("runs", spec, "zero", num_episodes=1)
    status, _, err = run(compare, "runs", "a.npz", "--json=runs/recording.json")
    assert (status, "must not be in the folder" in err) == (2, True)


@pytest.mark.full
def test_an_altered_folder_is_not_resumed_and_the_remedy_works():
    whole = kitchen_suite.evaluate("random", output="runs", **SHORT)
    path = files.Path("runs/episodes.jsonl")
    lines = path.read_text("utf-8").splitlines(keepends=True)
    for old, new in (('"seed": 400000000', '"seed": 7'), ('"control_steps": 5', '"control_steps": 3')):
        path.write_text("".join(line.replace(old, new) for line in lines), encoding="utf-8")
        with refused(ValueError, "the folder was altered", "remove its line from episodes.jsonl"):
            kitchen_suite.evaluate("random", output="runs", resume=True, **SHORT)
    path.write_text(lines[1], encoding="utf-8")
    assert kitchen_suite.evaluate("random", output="runs", resume=True, **SHORT).results == whole.results


@pytest.mark.full
def test_an_episode_whose_trace_is_missing_is_played_again():
    whole = kitchen_suite.evaluate("random", output="runs", **SHORT)
    files.Path("runs/traces/000_000001.npz").unlink()
    again = kitchen_suite.evaluate("random", output="runs", resume=True, **SHORT)
    assert again.results == whole.results
    assert again.check().verdict == "equal"


def test_errors_of_a_callback_are_its_own(short):
    def fail(episode):
        raise ValueError("mine")

    with pytest.raises(ValueError, match=r"^mine$") as raised:
        short.check(progress=fail)
    assert not isinstance(raised.value, AlteredError)


def test_a_measured_number_is_no_success(short):
    ((name, results),) = short.results.items()
    still = [dataclasses.replace(result, measures={**result.measures, "energy": 1.0}) for result in results]
    assert dataclasses.replace(short, results={name: still}).constant_successes == (0, 0)


def test_a_receipt_never_replaces_the_files_of_its_folder(run):
    files.Path("runs").mkdir()
    for name in ("evaluation.json", "episodes.jsonl"):
        status, _, err = run(evaluate, "--num_episodes=1", "--output=runs", f"--json=runs/{name}")
        assert (status, "must be different files" in err) == (2, True)
    assert not [*files.Path("runs").iterdir()]


@pytest.mark.full
def test_paths_of_folders_name_what_can_be_read():
    spec = kitchen_suite.EnvironmentSpec.make("kitchen", "kettle", {}, max_episode_steps=2)
    kitchen_suite.record("recorded", spec, "zero", num_episodes=1)
    kitchen_suite.evaluate("zero", output="kept", **SHORT)
    for folder, words in {
        "recorded": ("Recording.open",),
        "kept": ("--output=kept --resume --receipt=FILE.npz",),
        ".": ("is a folder",),
    }.items():
        with refused(ValueError, *words):
            Evaluation.read(folder)
    # The remedy of a recording.
    assert kitchen_suite.Recording.open("recorded").indices == [0]


@pytest.mark.full
@pytest.mark.parametrize(
    ("source", "flags"),
    [
        ("a.npz", ["--num_episodes=2"]),
        ("a.npz", ["--episodes=0"]),
        ("runs", ["--num_envs=4"]),
        ("runs", ["--num_threads=1"]),
        ("runs", ["--published=a.json"]),
        ("runs", ["--dataset=runs"]),
    ],
)
def test_flags_that_do_not_apply_are_refused(run, short, source, flags):
    short.write("a.npz")
    spec = kitchen_suite.EnvironmentSpec.make("kitchen", "kettle", {}, max_episode_steps=2)
    kitchen_suite.record("runs", spec, "zero", num_episodes=1)
    status, out, err = run(replay, source, *flags)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert flags[0].partition("=")[0] in err
    assert "does not apply" in err


@pytest.mark.full
def test_episodes_of_a_recording_are_chosen_by_numbers_too():
    spec = kitchen_suite.EnvironmentSpec.make("kitchen", "kettle", {}, max_episode_steps=2)
    kitchen_suite.record("runs", spec, "zero", num_episodes=3, seed=4)
    check = kitchen_suite.replay("runs", episodes=[0, 2])
    assert [(episode.episode, episode.seed) for episode in check.episodes] == [(0, 4), (2, 6)]
    assert (check.verdict, check.scores["success"], check.scores["control_steps"]) == ("equal", 0.0, 2.0)
    with refused(TypeError, "episodes", "'0,5,7-9'", "got 0"):
        kitchen_suite.replay("runs", episodes=0)
    with refused(ValueError, "no episode 7"):
        kitchen_suite.replay("runs", episodes=[7])
    with refused(ValueError, "at least one"):
        kitchen_suite.replay("runs", episodes=[])
    with refused(ValueError, "num_envs", "receipts"):
        kitchen_suite.replay("runs", num_envs=4)


@pytest.mark.full
def test_an_interrupted_evaluation_writes_a_receipt_of_all_episodes(short):
    whole = kitchen_suite.evaluate("random", output="runs", **SHORT)
    lines = files.Path("runs/episodes.jsonl").read_text("utf-8").splitlines(keepends=True)
    files.Path("runs/episodes.jsonl").write_text(lines[0], encoding="utf-8")
    seen = []
    again = kitchen_suite.evaluate("random", output="runs", resume=True, progress=seen.append, **SHORT)
    assert again.results == whole.results
    assert sorted(result.seed for result in seen) == [400_000_000, 400_000_001]
    assert again.check().verdict == "equal"


@pytest.mark.full
def test_the_plan_is_announced_before_the_first_episode():
    order = []
    kitchen_suite.evaluate(
        "zero",
        announce=lambda plan: order.append(plan.protocol),
        progress=lambda result: order.append(result.condition),
        **SHORT,
    )
    assert order == ["default", "kettle", "kettle"]


def test_one_task_is_shown_once(short):
    text = format_evaluation(kitchen_suite.evaluate("zero", **SHORT))
    for repeated in ("p1", "mean tasks", "order entropy", "where asked"):
        assert repeated not in text
    assert text.count("\nsuccess  ") == 1


@pytest.mark.full
def test_functions_print_nothing(capfd, short):
    evaluation = kitchen_suite.evaluate("zero", output="runs", receipt="a.npz", **SHORT)
    evaluation.write("a.json")
    Evaluation.read("a.npz").check()
    kitchen_suite.replay("a.npz", published="a.json")
    kitchen_suite.compare("a.npz", "a.json")
    kitchen_suite.compare_methods(["a.npz", "a.json"], [evaluation, Evaluation.read("a.json")])
    spec = kitchen_suite.EnvironmentSpec.make("kitchen", "kettle", {}, max_episode_steps=2)
    kitchen_suite.record("recorded", spec, "zero", num_episodes=1)
    kitchen_suite.replay("recorded")
    kitchen_suite.convert("recorded", "d4rl", "me/kettle", "data")
    assert [*kitchen_suite.play(spec, "zero", seeds=[0])]
    assert capfd.readouterr() == ("", "")
