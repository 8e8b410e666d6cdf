"""`compare_methods` and `kitchen-compare --a --b`: pairs, refusals, tables and JSON."""

import json
import re

import numpy as np
import pytest
from helpers.errors import refused
from helpers.evaluations import TASKS, evaluated, kitchens

import kitchen_suite
from kitchen_suite.commands import compare as compare_command
from kitchen_suite.evaluation.text import format_methods

RATES = {"ppo": (0.9, 0.8, 0.85), "bc": (0.3, 0.4, 0.35)}


def trained(rate, training_seed, num_episodes=40, **arguments):
    """Evaluation of a training seed that succeeds at a rate."""
    succeeded = np.random.default_rng(training_seed).random(num_episodes) < rate
    completed = tuple(TASKS if success else ("kettle",) for success in succeeded)
    return evaluated(completed, num_episodes=num_episodes, **arguments)


def methods(**arguments):
    return [[trained(rate, seed, **arguments) for seed, rate in enumerate(rates)] for rates in RATES.values()]


@pytest.fixture
def files(tmp_path):
    """The paths of the evaluations of both methods, as a command takes them."""
    paths = {}
    for name, evaluations in zip(RATES, methods(), strict=True):
        paths[name] = [str(tmp_path / f"{name}_{seed}.json") for seed in range(len(evaluations))]
        for path, evaluation in zip(paths[name], evaluations, strict=True):
            evaluation.write(path)
    return {name: ",".join(each) for name, each in paths.items()}


def test_methods_are_compared_by_the_means_of_their_training_seeds():
    one, other = methods()
    comparison = kitchen_suite.compare_methods(one, other)
    means = [[each.scores["success"] for each in side] for side in (one, other)]
    assert comparison.difference == pytest.approx(np.mean(means[0]) - np.mean(means[1]))
    low, high = comparison.interval
    assert 0.1 < low < comparison.difference < high <= 1.0
    assert (comparison.better, comparison.p_value < 0.05) == ("a", True)
    record = comparison.as_json()
    assert record["num_seeds"] == {"a": 3, "b": 3}
    assert record["success_difference"] == record["scores"]["success"]["difference"]
    assert record["intervals"]["success_difference"] == pytest.approx([low, high], abs=1e-6)
    assert [each["success"] for each in record["a"]["training_seeds"]] == pytest.approx(means[0])
    assert record["scores"]["mean_tasks"]["a"] == pytest.approx(1.0 + record["scores"]["success"]["a"])
    json.dumps(record, allow_nan=False)
    assert kitchen_suite.compare_methods(other, one).better == "b"


def test_numbers_of_training_seeds_may_differ():
    one, other = methods()
    comparison = kitchen_suite.compare_methods(one[:2], other)
    assert comparison.as_json()["num_seeds"] == {"a": 2, "b": 3}
    assert "2 training seeds of A and 3 training seeds of B" in format_methods(comparison)


def test_seeds_that_differ_widen_the_interval():
    alike = kitchen_suite.compare_methods(*[[trained(rate, seed) for seed in range(3)] for rate in (0.7, 0.6)])
    spread = kitchen_suite.compare_methods(
        [trained(rate, seed) for seed, rate in enumerate((1.0, 0.4, 0.7))],
        [trained(rate, seed) for seed, rate in enumerate((0.9, 0.3, 0.6))],
    )
    widths = [high - low for low, high in (alike.interval, spread.interval)]
    assert widths[1] > 2 * widths[0]


def test_kitchens_are_the_unit_where_they_are_a_sample():
    # Four episodes of a kitchen are one observation: whole kitchens count as much as a fourth of each of four.
    sides = [[kitchens([4] * (count + seed)) for seed in range(2)] for count in (40, 20)]
    comparison = kitchen_suite.compare_methods(*sides)
    record = comparison.as_json()
    assert (record["unit"], record["clusters"], record["episodes"]) == ("kitchen", 100, 400)
    assert comparison.first.values(lambda result: result.success).shape == (2, 100)
    low, high = comparison.interval
    # Twenty of a hundred kitchens: about 20 % and twice 4 %, and not twice 2 % as of 400 episodes.
    assert (low, high) == pytest.approx((0.12, 0.28), abs=0.02)


@pytest.mark.parametrize("table_format", ["text", "markdown", "latex"])
def test_a_paper_has_a_row_a_method_and_a_column_a_score(files, table_format):
    comparison = kitchen_suite.compare_methods(files["ppo"].split(","), files["bc"].split(","))
    text = format_methods(comparison, table_format)
    rows = [line for line in text.splitlines() if re.match(r"^[| ]*(ppo|bc) +[|&]? +3 ", line)]
    assert len(rows) == 2
    for row, side in zip(rows, "ab", strict=True):
        assert len(re.findall(r" to ", row)) == len(comparison.scores) == 2
        assert f"{100 * comparison.as_json()['scores']['success'][side]:.1f} " in row
    assert "3 training seeds of ppo and 3 training seeds of bc" in text
    if table_format == "latex":
        outside = re.sub(r"\\begin\{tabular\}.*?\\end\{tabular\}", "", text, flags=re.DOTALL)
        assert all(line.startswith("%") for line in outside.splitlines() if line)


def test_one_training_seed_is_refused_with_the_reason():
    one, other = methods()
    with refused(ValueError, "at least two training seeds of b", "differ from seed to seed"):
        kitchen_suite.compare_methods(one, other[:1])
    with refused(ValueError, "at least two training seeds of a"):
        kitchen_suite.compare_methods([], other)
    with refused(TypeError, "a must be a list of evaluations", "'a.npz'"):
        kitchen_suite.compare_methods("a.npz", other)


def test_a_training_seed_that_is_given_twice_is_refused(files):
    one, other = methods()
    with refused(ValueError, "given twice as a training seed of a"):
        kitchen_suite.compare_methods([one[0], one[1], one[0]], other)
    first = files["ppo"].split(",")[0]
    with refused(ValueError, "ppo_0.json", "given twice as a training seed of b"):
        kitchen_suite.compare_methods(one, [first, first])


@pytest.mark.parametrize("arguments", [{"protocol": "strict"}, {"seed": 7}, {"num_episodes": 30}])
def test_other_episodes_are_refused(arguments):
    one, other = methods()
    with refused(ValueError, "cannot be compared"):
        kitchen_suite.compare_methods(one, [*other[:2], trained(0.5, 9, **arguments)])


def test_the_command_compares_methods(run, files, tmp_path):
    path = tmp_path / "methods.json"
    sides = [f"--a={files['ppo']}", f"--b={files['bc']}"]
    status, out, err = run(compare_command, *sides, f"--json={path}")
    assert (status, err) == (0, "")
    assert "40 episodes of each policy, seeds from 400000000; 3 training seeds of ppo and 3" in out
    assert "ppo: success of ppo_0 " in out
    assert "ppo succeeds more often" in out
    record = json.loads(path.read_text("utf-8"))
    assert record == kitchen_suite.compare_methods(files["ppo"].split(","), files["bc"].split(",")).as_json()
    for flag, expected in (("worse", 4), ("not_better", 4)):
        status, out, _ = run(compare_command, *sides, f"--fail_if={flag}")
        assert (status, f"--fail_if={flag} failed: bc is worse than ppo" in out) == (expected, True)
    status, out, _ = run(compare_command, f"--a={files['bc']}", f"--b={files['ppo']}", "--fail_if=not_better")
    assert (status, "passed: ppo is better than bc" in out) == (0, True)


@pytest.mark.parametrize(
    ("others", "shown"),
    [
        (["more.json"], "a policy does not apply"),
        (["--across=variations"], "--across does not apply"),
        (["--video=a.mp4"], "--video or --web does not apply"),
        (["--web=a.html"], "--video or --web does not apply"),
        (["--b="], "--a and --b go together"),
    ],
)
def test_what_does_not_apply_to_methods_is_refused(run, files, others, shown):
    status, out, err = run(compare_command, f"--a={files['ppo']}", f"--b={files['bc']}", *others)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert shown in err


def test_a_file_of_a_method_is_never_written_to(run, files):
    first = files["ppo"].split(",")[0]
    status, _, err = run(compare_command, f"--a={files['ppo']}", f"--b={files['bc']}", f"--json={first}")
    assert (status, "different files" in err) == (2, True)
