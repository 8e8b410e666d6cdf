"""When episodes reach their success, and whether it lasts: in results, scores, files and infos."""

import dataclasses
import json

import numpy as np
import pytest

import kitchen_suite
from kitchen_suite import Evaluation
from kitchen_suite.commands.evaluate import main
from kitchen_suite.episodes.spec import reset_to_seed
from kitchen_suite.evaluation.evaluation import AlteredError
from kitchen_suite.evaluation.scores import EpisodeResult, score_episodes

# The expert opens the microwave within some 45 control steps, and needs about 40 to open it again after a push.
UNDONE = {"terminate_on_tasks_completed": False, "variations": {"push/step": 60, "push/undoes": 1.0}}
DISTANCE = 0.3  # Of the original, at which a task of the kitchen is complete.


@pytest.fixture(scope="module")
def undone():
    return kitchen_suite.evaluate(
        "expert", task_name="microwave", num_episodes=3, max_episode_steps=64, task_kwargs=UNDONE, quality=True
    )


def test_success_that_was_undone_is_none_at_the_end(undone):
    """By the distances that are observed: within the threshold before the push, and not at the end."""
    spec = undone.plan.specs["microwave"]
    environment = spec.make_environment()
    for result, trace in zip(undone.results["microwave"], undone.traces["microwave"], strict=True):
        reset_to_seed(environment, result.seed, spec.seeding, result.reset or None)
        distances = []
        for action in trace.actions:
            observation, _, _, _, info = environment.step(action)
            achieved, desired = (observation[key]["microwave"] for key in ("achieved_goal", "desired_goal"))
            distances.append(float(np.linalg.norm(achieved - desired)))
        within = np.array(distances) < DISTANCE
        assert result.success
        assert result.steps_to_success == within.argmax() + 1 < 60
        assert result.success_at_end is bool(within[-1]) is False
        assert info["success_at_end"] == result.success_at_end
        assert info["steps_to_success"] == result.steps_to_success
    environment.close()
    assert undone.scores["success"] == 1.0
    assert undone.scores["success_at_end"] == 0.0
    assert 30 < undone.scores["steps_to_success"] < 60


@pytest.mark.full
def test_the_cabinet_succeeds_at_the_end_as_before():
    evaluation = kitchen_suite.evaluate(
        "expert", domain_name="open_cabinet", num_episodes=2, max_episode_steps=290, quality=True
    )
    (results,) = evaluation.results.values()
    for result in results:
        assert result.success_at_end is result.success
        assert result.steps_to_success is None or result.steps_to_success <= 290
    random = kitchen_suite.evaluate("random", domain_name="open_cabinet", num_episodes=2, max_episode_steps=5)
    assert "steps_to_success" not in random.scores
    assert random.scores["success_at_end"] == 0.0


@pytest.mark.full
def test_files_keep_it_and_a_check_finds_it_altered(undone, tmp_path):
    for name in ("a.npz", "a.json"):
        undone.write(tmp_path / name)
        assert Evaluation.read(tmp_path / name).results == undone.results
    assert Evaluation.read(tmp_path / "a.npz").check().verdict == "equal"
    lasting = [dataclasses.replace(each, success_at_end=True) for each in undone.results["microwave"]]
    dataclasses.replace(undone, results={"microwave": lasting}).write(tmp_path / "b.npz")
    check = Evaluation.read(tmp_path / "b.npz").check()
    assert check.verdict == "altered"
    assert "success_at_end True, replayed False" in check.differing[0].differences


def test_files_of_version_1_0_say_nothing_of_it_and_are_equal(undone, tmp_path):
    silent = [
        dataclasses.replace(each, success_at_end=None, steps_to_success=None) for each in undone.results["microwave"]
    ]
    old = dataclasses.replace(undone, results={"microwave": silent})
    assert not {"success_at_end", "steps_to_success"} & old.scores.keys()
    assert not {"success_at_end", "steps_to_success"} & old.episode_rows["microwave"][0].keys()
    old.write(tmp_path / "old.npz")
    check = Evaluation.read(tmp_path / "old.npz").check()
    assert check.verdict == "equal"
    assert check.scores == old.scores
    mixed = dataclasses.replace(undone, results={"microwave": [silent[0], *undone.results["microwave"][1:]]})
    mixed.write(tmp_path / "mixed.npz")
    with pytest.raises(AlteredError, match="some episodes alone"):
        Evaluation.read(tmp_path / "mixed.npz")


@pytest.mark.parametrize(
    ("changes", "shown"),
    [
        ({"success": False, "asked": {"microwave": None}}, "succeeds at its end, and does not succeed"),
        ({"steps_to_success": None}, "succeeds at no control step"),
        ({"steps_to_success": 65}, "succeeds at control step 65, of 64"),
        ({"success_at_end": None}, "some episodes alone say whether they end in success"),
    ],
)
def test_contradictions_are_found(undone, tmp_path, changes, shown):
    first, *others = undone.results["microwave"]
    forged = dataclasses.replace(dataclasses.replace(first, success_at_end=True), **changes)
    dataclasses.replace(undone, results={"microwave": [forged, *others]}).write(tmp_path / "a.npz")
    with pytest.raises(AlteredError, match=shown):
        Evaluation.read(tmp_path / "a.npz")


def test_scores_of_single_values():
    results = [
        EpisodeResult(
            condition="a",
            episode=i,
            seed=i,
            success=steps is not None,
            progress=0.0,
            control_steps=100,
            success_at_end=at_end,
            steps_to_success=steps,
        )
        for i, (at_end, steps) in enumerate([(True, 10), (False, 20), (False, None), (True, 60)])
    ]
    scores = score_episodes(results)
    assert scores["success"] == 0.75
    assert scores["success_at_end"] == 0.5
    assert scores["steps_to_success"] == 30.0


def test_diverged_episodes_do_not_end_in_success(tmp_path, undone):
    diverged = dataclasses.replace(
        undone.results["microwave"][0], success=False, diverged=True, asked={"microwave": None}
    )
    others = undone.results["microwave"][1:]
    dataclasses.replace(undone, results={"microwave": [diverged, *others]}).write(tmp_path / "a.json")
    with pytest.raises(AlteredError, match="has diverged, and succeeded"):
        Evaluation.read(tmp_path / "a.json")


@pytest.mark.parametrize(("least", "status"), [("0", 0), ("1", 4)])
def test_a_success_rate_below_the_gate_ends_with_status_4(capsys, tmp_path, monkeypatch, least, status):
    monkeypatch.chdir(tmp_path)
    flags = ["--policy=zero", "--num_episodes=2", "--max_episode_steps=3", f"--fail_under={least}", "--json=a.json"]
    assert main(flags) == status
    out, err = capsys.readouterr()
    assert "success" in out
    assert json.loads((tmp_path / "a.json").read_text())["success"] == 0.0
    gate = "kitchen-evaluate: success 0.0 % is below --fail_under, 100 %\n"
    assert gate in err if status else gate not in err


@pytest.mark.parametrize("least", ["90", "-0.1", "nan", "most"])
def test_a_gate_that_is_no_rate_is_refused_at_the_start(capsys, least):
    assert main(["--policy=zero", f"--fail_under={least}"]) == 2
    assert "fail_under" in capsys.readouterr().err
