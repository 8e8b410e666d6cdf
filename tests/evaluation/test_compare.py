"""`compare` and `kitchen-compare`: pairs, refusals, tables and JSON; `kitchen-evaluate --episodes`."""

import contextlib
import dataclasses
import json
import re

import numpy as np
import pytest
from helpers.errors import refused
from helpers.evaluations import EPISODES, TASKS, evaluated, kitchens

import kitchen_suite
from kitchen_suite import EnvironmentSpec
from kitchen_suite.commands import compare as compare_command
from kitchen_suite.commands import evaluate as evaluate_command
from kitchen_suite.evaluation import side_by_side
from kitchen_suite.evaluation.compare import PairedComparison, adjusted_p_values, all_as_json, compare_all
from kitchen_suite.evaluation.paired_scores import PairedScore, conclusion
from kitchen_suite.evaluation.text import format_comparison, format_comparisons, format_totals, label, p_text

SMALL = ["--num_episodes=3", "--max_episode_steps=4", "--num_envs=3"]


@pytest.fixture(scope="module")
def receipts(tmp_path_factory):
    """Receipts of short episodes of two policies, of which one succeeds: its threshold is large. Not verified here."""
    folder = tmp_path_factory.mktemp("receipts")
    for name in ("random", "zero"):
        kitchen_suite.evaluate(name, num_episodes=3, max_episode_steps=4, num_envs=3, receipt=folder / f"{name}.npz")
    return folder


@pytest.mark.full
def test_wins_losses_and_ties_are_counted_by_episode():
    one = evaluated((TASKS, TASKS, TASKS, TASKS, ("kettle",), ()))
    other = evaluated(((), ("kettle",), TASKS, TASKS, TASKS, ()))
    comparison = kitchen_suite.compare(one, other)
    assert (comparison.wins, comparison.losses, comparison.ties) == (2, 1, 3)
    # Of three episodes that differ, all outcomes but those of 0 or 3 wins are at least as likely as two wins.
    assert comparison.p_value == 1.0
    record = comparison.as_json()
    assert record["success_difference"] == pytest.approx(1 / 6, abs=1e-6)
    assert record["mean_tasks_difference"] == pytest.approx((2 + 1 - 1) / 6, abs=1e-6)
    low, high = record["intervals"]["success_difference"]
    assert -1.0 <= low < 0.0 < high <= 1.0
    assert [each["succeeded"] for each in record["differing"]] == ["a", "a", "b"]
    assert record["task_rates"]["kettle"]["wins"] == 1
    assert record["task_rates"]["microwave"]["losses"] == 1


@pytest.mark.full
def test_a_policy_with_itself_is_all_ties(receipts):
    path = receipts / "random.npz"
    comparison = kitchen_suite.compare(path, path)
    assert (comparison.wins, comparison.losses, comparison.ties, comparison.p_value) == (0, 0, 3, 1.0)
    record = comparison.as_json()
    assert record["differing"] == []
    assert {row["p_value_holm"] for row in record["task_rates"].values()} == {1.0}
    for name, (low, high) in record["intervals"].items():
        assert low < record[name] == 0.0 < high


def test_the_json_of_nearly_equal_differences_has_no_nan():
    def measured(*values):
        evaluation = evaluated()
        (results,) = evaluation.results.values()
        rows = zip(results, values, strict=True)
        with_effort = [dataclasses.replace(result, measures={"effort": value}) for result, value in rows]
        return dataclasses.replace(evaluation, results=dict.fromkeys(evaluation.results, with_effort))

    comparison = kitchen_suite.compare(measured(1.0, *[1.0 + 2.0**-52] * 5), measured(*[0.0] * 6))
    assert comparison.as_json()["intervals"]["effort_difference"] is None
    assert "NaN" not in json.dumps(comparison.as_json())
    assert "effort" in format_comparison(comparison)


def test_a_score_is_shown_in_its_own_unit():
    comparison = kitchen_suite.compare(evaluated(), evaluated(policy="random"))
    seconds = PairedScore.of_means(comparison.all_pairs, lambda result: 0.08 * result.control_steps, unit="s")
    comparison.scores["duration"] = seconds
    assert re.search(r"^duration +8 s +8 s +0 s ", format_comparison(comparison), flags=re.MULTILINE)
    assert comparison.as_json()["duration_difference"] == 0.0


def test_swapping_the_policies_mirrors_the_json():
    one = evaluated((TASKS, TASKS, TASKS, ("kettle",), TASKS, ()))
    other = evaluated(((), (), ("kettle",), TASKS, (), ()), policy="random")
    first = kitchen_suite.compare(one, other).as_json()
    second = kitchen_suite.compare(other, one).as_json()
    assert (first["a"], first["b"]) == (second["b"], second["a"])
    assert (first["wins"], first["losses"], first["ties"]) == (second["losses"], second["wins"], second["ties"])
    assert first["p_value"] == second["p_value"]
    for name, (low, high) in first["intervals"].items():
        assert second[name] == -first[name]
        assert second["intervals"][name] == pytest.approx([-high, -low], abs=1e-6)


REFUSALS = {
    "protocol": ({"protocol": "strict"}, ("protocol default", "strict", "success")),
    "task": ({"task_name": "kettle"}, ("conditions", "random_4", "kettle")),
    "physics": ({"task_kwargs": (("physics", "fast"),)}, ("physics 'exact', and 'fast'",)),
    "control step": ({"task_kwargs": (("control_timestep", 0.04),)}, ("control_timestep", "0.04")),
    "control mode": ({"task_kwargs": (("control_mode", "ee_delta_pose"),)}, ("control_mode", "ee_delta_pose")),
    "noise": ({"task_kwargs": (("robot_noise_ratio", 0.2),)}, ("robot_noise_ratio", "0.2")),
    "variations": ({"task_kwargs": (("variation_split", "held_out"),)}, ("variation_split 'seen', and 'held_out'",)),
    "length": ({"max_episode_steps": 99}, ("max_episode_steps 280, and 99",)),
    "seeds": ({"seed": 7}, ("seeds [400000000", "seeds [7, 8")),
    "number": ({"num_episodes": 5}, ("seeds [400000005] in zero (1) alone",)),
    "domain": ({"domain_name": "open_cabinet"}, ("domain_name 'kitchen', and 'open_cabinet'",)),
    "conditions": ({"protocol": "d4rl"}, ("protocol default, and d4rl", "conditions ['random_4']", "'partial'")),
}


@pytest.mark.full
@pytest.mark.parametrize("name", REFUSALS)
def test_what_cannot_be_paired_is_refused_with_what_differs(name):
    arguments, shown = REFUSALS[name]
    with refused(ValueError, "cannot be compared", *shown):
        kitchen_suite.compare(evaluated(), evaluated(**arguments))


HELD_OUT = (("variation_split", "held_out"),)
WITHOUT = (("variations", "none"),)


def test_what_an_argument_changes_is_compared_across_it():
    one = evaluated((TASKS,) * EPISODES)
    other = evaluated(((),) * 3 + (TASKS,) * 3, task_kwargs=WITHOUT)
    with refused(ValueError, "variations ['start'], and None", "--across=variations"):
        kitchen_suite.compare(one, other)
    comparison = kitchen_suite.compare(one, other, across=("variations",))
    assert (comparison.wins, comparison.losses, comparison.ties) == (3, 0, 3)
    record = comparison.as_json()
    assert record["across"] == ["variations"]
    assert record["a"]["arguments"] == {"variations": ["start"]}
    assert record["b"]["arguments"] == {"variations": None}
    assert record["variations"] == "variations start (seen) and variations none"
    heading = format_comparison(comparison).partition("\n\n")[0]
    assert "compared across variations" in heading
    assert "zero (2): policy zero, variations 'none'" in heading
    assert kitchen_suite.compare(one, other, across="variations").as_json() == record


def test_several_arguments_are_crossed_and_only_those():
    arguments = {"task_kwargs": (*HELD_OUT, ("physics", "fast")), "max_episode_steps": 99}
    one, other = evaluated(), evaluated(**arguments)
    names = ("physics", "variation_split", "max_episode_steps")
    assert kitchen_suite.compare(one, other, across=names).as_json()["b"]["arguments"] == {
        "physics": "fast",
        "variation_split": "held_out",
        "max_episode_steps": 99,
    }
    with refused(ValueError, "variation_split 'seen', and 'held_out'", "--across=max_episode_steps,physics,variation"):
        kitchen_suite.compare(one, other, across=("physics", "max_episode_steps"))
    three = compare_all([one, one, other], across=names)
    assert [each.as_json()["b"]["arguments"]["physics"] for each in three] == ["exact", "fast", "fast"]
    assert "compared across physics, variation_split, max_episode_steps" in format_comparisons(three)


@pytest.mark.parametrize(
    ("across", "shown"),
    [
        ("variation", ("'variation' does not exist", "did you mean 'variations'")),
        ("task_name", ("'task_name' does not exist",)),
        ("physics", ("nothing is compared across 'physics'", "it is 'exact'")),
        ("obs_type", ("nothing is compared across 'obs_type'",)),
    ],
)
def test_names_that_do_not_differ_or_exist_are_refused(across, shown):
    with refused(ValueError, *shown):
        kitchen_suite.compare(evaluated(), evaluated(task_kwargs=HELD_OUT), across=("variation_split", across))


@pytest.mark.parametrize("arguments", [{"seed": 7}, {"num_episodes": 5}, {"protocol": "strict"}])
def test_other_seeds_and_protocols_are_no_pairs_across_anything(arguments):
    other = evaluated(**{"task_kwargs": HELD_OUT, **arguments})
    with refused(ValueError, "cannot be compared") as caught:
        kitchen_suite.compare(evaluated(), other, across=("variation_split",))
    assert "--across" not in str(caught.value)


def test_the_command_compares_across_variations(run, receipts, folder):
    plain = str(receipts / "zero.npz")
    assert run(evaluate_command, *SMALL, "--policy=zero", "--variations=none", "--receipt=usual.npz")[0] == 0
    status, _, err = run(compare_command, plain, "usual.npz")
    assert (status, "--across=variations" in err) == (2, True)
    status, out, err = run(compare_command, plain, "usual.npz", "--across=variations", "--json=both.json")
    assert (status, err) == (0, "")
    assert "compared across variations" in out
    assert json.loads((folder / "both.json").read_text("utf-8"))["across"] == ["variations"]


def test_conditions_of_shift_are_compared_with_the_control_arm():
    evaluation = evaluated((TASKS,) * EPISODES, protocol="shift")
    failed = [dataclasses.replace(each, success=False) for each in evaluation.results["layout seen"][:5]]
    layout = [*failed, evaluation.results["layout seen"][5]]
    evaluation = dataclasses.replace(evaluation, results={**evaluation.results, "layout seen": layout})
    shifts = evaluation.shifts
    assert [*shifts] == [name for name in evaluation.results if name != "none"]
    score = shifts["layout seen"]["success"]
    assert (score.a, score.b, score.difference) == (pytest.approx(1 / 6), 1.0, pytest.approx(-5 / 6))
    assert score.p_value == 2 / 2**5
    assert score.p_value_holm == pytest.approx(min(1.0, len(shifts) * score.p_value))
    assert shifts["push"]["success"].p_value_holm == 1.0
    text = format_totals(evaluation)
    assert re.search(r"^layout seen +-83.3 % +-\d", text, flags=re.MULTILINE)
    assert "success, less that of 'none' in pairs" in text
    assert "shifts" not in evaluation.as_json()
    assert evaluated().shifts == evaluated(protocol="d4rl").shifts == {}


def reached(evaluation, steps):
    """The evaluation, whose episodes succeed at these control steps of each condition."""
    results = {
        name: [
            dataclasses.replace(each, success=step is not None, success_at_end=step is not None, steps_to_success=step)
            for each, step in zip(results, steps, strict=True)
        ]
        for name, results in evaluation.results.items()
    }
    return dataclasses.replace(evaluation, results=results)


def test_steps_to_success_are_compared_where_both_succeed():
    one = reached(evaluated(), (10, 20, 30, 40, None, 90))
    other = reached(evaluated(), (15, 20, 50, 43, 7, None))
    comparison = kitchen_suite.compare(one, other)
    score = comparison.scores["steps_to_success"]
    # By hand: 5, 0, 20 and 3 steps sooner in the first four episodes.
    assert (score.episodes, score.a, score.b, score.difference) == (4, 25.0, 32.0, -7.0)
    assert -20.0 <= score.interval[0] < -7.0 < score.interval[1] <= 0.0
    assert comparison.as_json()["steps_to_success_difference"] == -7.0
    assert re.search(r"^steps to success \(4 episodes\) +25 +32 +-7 +-", format_comparison(comparison), flags=re.M)
    several = format_comparisons(compare_all([one, other, one]))
    assert re.search(r" \(4 episodes\) +25 +32 +-7 +-", several)
    assert re.search(r" \(4 episodes\) +32 +25 +\+7 +", several)
    swapped = kitchen_suite.compare(other, one).scores["steps_to_success"]
    assert (swapped.difference, swapped.episodes) == (7.0, 4)


def test_conditions_of_shift_are_compared_with_the_control_arm_where_both_succeed():
    evaluation = reached(evaluated(protocol="shift"), (10, 20, None, None, None, None))
    layout = reached(evaluated(protocol="shift"), (None, None, 30, 30, 30, 30)).results["layout seen"]
    push = reached(evaluated(protocol="shift"), (30, None, 30, 30, 30, 30)).results["push"]
    evaluation = dataclasses.replace(evaluation, results={**evaluation.results, "layout seen": layout, "push": push})
    assert "steps_to_success" not in evaluation.shifts["layout seen"]
    assert evaluation.shifts["push"]["steps_to_success"].difference == 20.0
    *_, table = format_totals(evaluation).split("\n\n")
    assert table.startswith("steps to success, less that of 'none' in pairs")
    assert re.search(r"^push \(1 episode\) +\+20", table, flags=re.M)
    assert "layout seen" not in table


def test_without_an_episode_in_which_both_succeed_there_are_no_steps_to_success():
    one, other = reached(evaluated(), (10, None) * 3), reached(evaluated(), (None, 10) * 3)
    assert "steps_to_success" not in kitchen_suite.compare(one, other).scores
    assert "steps_to_success" not in kitchen_suite.compare(evaluated(), evaluated()).scores


def test_steps_to_success_in_kitchens_have_the_interval_of_whole_kitchens():
    one, other = kitchens([]), kitchens([])
    one, other = reached(one, (10, 20, 30, None)), reached(other, (10, 20, 30, 40))
    (name, *others) = one.results
    slow = [dataclasses.replace(each, steps_to_success=each.episode + 50) for each in one.results[name]]
    failed = {
        each: [dataclasses.replace(result, steps_to_success=None) for result in one.results[each]]
        for each in others[:90]
    }
    one = dataclasses.replace(one, results={**one.results, name: slow, **failed})
    score = kitchen_suite.compare(one, other).scores["steps_to_success"]
    # Four episodes of one kitchen, 40, 31, 22 and 13 steps later, and three each of nine kitchens, at the same time.
    assert score.episodes == 4 + 9 * 3
    assert score.difference == pytest.approx((40 + 31 + 22 + 13) / 31)
    # Of ten kitchens, one draw in three lacks that one.
    assert score.interval[0] == 0.0


@pytest.mark.parametrize("package", ["mujoco", "kitchen-suite"])
def test_other_versions_are_refused(package):
    one = evaluated()
    name, spec = next(iter(one.plan.specs.items()))
    specs = {name: dataclasses.replace(spec, versions={**spec.versions, package: "0.0.1"})}
    other = dataclasses.replace(one, plan=dataclasses.replace(one.plan, specs=specs))
    with refused(ValueError, f"version of {package}", "'0.0.1'"):
        kitchen_suite.compare(one, other)


def test_episodes_that_ask_for_other_tasks_are_refused():
    one = evaluated()
    (name,) = one.results
    changed = [dataclasses.replace(each, asked={"light switch": None, "kettle": None}) for each in one.results[name]]
    with refused(ValueError, "goals of the episodes of seeds [400000000"):
        kitchen_suite.compare(one, dataclasses.replace(one, results={name: changed}))


@pytest.mark.full
def test_what_policies_observe_may_differ():
    pixels = (("obs_type", "pixels_agent_pos"), ("image_size", (32, 32)))
    flat = (("goal_format", "flat"),)
    for arguments in (pixels, flat):
        assert kitchen_suite.compare(evaluated(), evaluated(task_kwargs=arguments)).ties == EPISODES
    assert kitchen_suite.compare(evaluated(), evaluated(task_kwargs=(("physics", "exact"),))).ties == EPISODES


@pytest.mark.full
def test_measured_quality_is_no_other_episode():
    arguments = {"num_episodes": 3, "max_episode_steps": 3, "num_envs": 3}
    plain = kitchen_suite.evaluate("zero", **arguments)
    measured = kitchen_suite.evaluate("zero", **arguments, quality=True)
    for sources in ((plain, measured), (measured, plain)):
        comparison = kitchen_suite.compare(*sources)
        assert (comparison.wins, comparison.losses, comparison.ties) == (0, 0, 3)
        assert [*comparison.scores] == ["success", "success_at_end", "mean_tasks"]
    assert "clean_success" in kitchen_suite.compare(measured, measured).scores


@pytest.mark.full
def test_conditions_are_paired_each_by_itself():
    one = evaluated((TASKS,) * EPISODES, protocol="d4rl")
    comparison = kitchen_suite.compare(one, evaluated(protocol="d4rl"))
    record = comparison.as_json()
    assert [*record["conditions"]] == ["complete", "partial", "mixed"]
    assert record["wins"] == 3 * record["conditions"]["mixed"]["success"]["wins"] == 3 * 2
    assert "success by condition" in format_comparison(comparison)
    assert record["variations"] == "variations none"


@pytest.mark.full
def test_variations_that_differ_by_condition_are_not_those_of_the_first():
    shift = evaluated(protocol="shift", num_episodes=1)
    assert kitchen_suite.compare(shift, shift).as_json()["variations"] == "variations by condition"


def test_several_policies_are_compared_in_all_pairs_with_holm():
    best = evaluated((TASKS,) * EPISODES)
    comparisons = compare_all([best, evaluated(((),) * EPISODES), evaluated(((),) * EPISODES)])
    assert [each.p_value for each in comparisons] == pytest.approx([2 / 2**6, 2 / 2**6, 1.0])
    # By hand: 1/32 x 3, 1/32 x 2 but not less than the one before, and 1.
    assert adjusted_p_values(comparisons) == pytest.approx([3 / 32, 3 / 32, 1.0])
    record = all_as_json(comparisons)
    assert [each["p_value_holm"] for each in record["comparisons"]] == adjusted_p_values(comparisons)
    assert "p (Holm)" in format_comparisons(comparisons)


def test_every_score_of_several_policies_is_shown():
    evaluation = evaluated()
    measured = {
        name: [
            dataclasses.replace(each, measures={"caught": True, "effort": 1.0}, success_at_end=False)
            for each in results
        ]
        for name, results in evaluation.results.items()
    }
    one = dataclasses.replace(evaluation, results=measured)
    text = format_comparisons(compare_all([one, one, one]))
    lines = text.splitlines()
    scores = kitchen_suite.compare(one, one).scores
    assert scores.keys() == {"success", "success_at_end", "mean_tasks", "caught", "effort"}
    for name in scores:
        assert any(line.startswith(label(name)) for line in lines), name


@pytest.mark.parametrize("sources", [[], [0]])
def test_one_policy_alone_is_refused(sources):
    with refused(ValueError, "number of policies", "at least 2"):
        compare_all([evaluated() for _ in sources])


def test_kitchens_are_the_unit_where_they_are_a_sample():
    comparison = kitchen_suite.compare(kitchens([4, 4, 4]), kitchens([]))
    record = comparison.as_json()
    assert (record["unit"], record["clusters"], record["episodes"]) == ("kitchen", 100, 400)
    assert (comparison.wins, record["success_difference"]) == (12, 0.03)
    # By episodes 12 wins of 12, p = 0.0005; of three kitchens all outcomes but two are as extreme.
    assert comparison.p_value == record["scores"]["success"]["p_value"] == record["p_value"] == 2 / 2**3
    assert record["task_rates"]["door"]["p_value"] == 0.25
    assert comparison.better is None
    assert record["conclusion"].startswith("no difference is shown")
    text = format_comparison(comparison)
    assert "400 episodes in pairs, of 100 kitchens, which are the unit" in text
    assert "3 kitchens in which zero succeeds more often, 0 in which zero" in re.sub(r" \(\d\)", "", text)
    assert "kitchen 99" not in text
    assert "100 kitchens" in format_comparisons(compare_all([kitchens([4]), kitchens([]), kitchens([2])]))


def test_kitchens_show_a_difference_where_many_of_them_differ():
    comparison = kitchen_suite.compare(kitchens([]), kitchens([3] * 20))
    low, high = comparison.scores["success"].interval
    assert (comparison.better, comparison.p_value < 1e-5, low < -0.15 < high < 0.0) == ("b", True, True)
    assert "succeeds more often" in comparison.conclusion


def test_episodes_are_the_unit_elsewhere():
    comparison = kitchen_suite.compare(evaluated(), evaluated())
    assert (comparison.unit, comparison.is_sample) == ("episode", False)
    assert not {"unit", "clusters"} & comparison.as_json().keys()


@pytest.mark.parametrize(("low", "high"), [(-0.1, 0.2), (0.1, 0.4), (0.0, 0.3), (-0.4, -0.1)])
@pytest.mark.parametrize("p_value", [0.01, 0.05, 0.125])
def test_a_conclusion_never_contradicts_itself(low, high, p_value):
    difference = (low + high) / 2
    score = PairedScore(episodes=4, a=0.5, b=0.5 - difference, difference=difference, interval=(low, high))
    score = dataclasses.replace(score, p_value=p_value)
    is_shown = p_value < 0.05 and not low <= 0.0 <= high
    assert (score.greater is not None) == is_shown
    text = conclusion(difference, (low, high), p_value, ("first", "second"), "kitchen")
    assert text.startswith(("first succeeds", "second succeeds") if is_shown else "no difference is shown: ")
    assert ("compatible" in text) == (p_value >= 0.05 and low <= 0.0 <= high)
    if is_shown:
        assert "by 10.0 to 40.0 percentage points" in text
        assert text.startswith("first" if difference > 0 else "second")


def test_four_wins_of_four_show_no_difference():
    comparison = kitchen_suite.compare(evaluated((TASKS,) * 4, num_episodes=4), evaluated(((),) * 4, num_episodes=4))
    low, _ = comparison.scores["success"].interval
    assert (low > 0.0, comparison.p_value) == (True, 0.125)
    assert comparison.better is None
    assert "p decides, which is exact" in comparison.conclusion
    assert "is approximate where few episodes differ" in comparison.conclusion


def numbers_in(value):
    """All numbers of decoded JSON, as tables may show them."""
    if isinstance(value, dict):
        value = [*value.values()]
    if isinstance(value, list):
        return {text for each in value for text in numbers_in(each)}
    if isinstance(value, bool) or not isinstance(value, int | float):
        return {*re.findall(r"\d+(?:\.\d+)?", str(value))}
    shown = {f"{abs(value):.4g}", f"{abs(100 * value):.1f}", f"{value:.2f}", f"{value:.2g}", str(value)}
    return {number for text in shown for number in re.findall(r"\d+(?:\.\d+)?", text)}


@pytest.mark.parametrize("table_format", ["text", "markdown", "latex"])
@pytest.mark.parametrize("count", [2, 3])
def test_everything_printed_is_in_the_json(count, table_format):
    one = evaluated((TASKS, TASKS, TASKS, ("kettle",), TASKS, ()))
    other = evaluated(((), (), ("kettle",), TASKS, (), ()), policy="random")
    comparisons = compare_all([one, other, evaluated()][:count])
    if count == 2:
        text, record = format_comparison(comparisons[0], table_format), comparisons[0].as_json()
    else:
        text, record = format_comparisons(comparisons, table_format), all_as_json(comparisons)
    # The level of the intervals, that of p-values, and the number of pairs.
    known = numbers_in(record) | {"95", "0.05", str(len(comparisons))}
    assert {*re.findall(r"\d+(?:\.\d+)?", text)} <= known


@pytest.mark.parametrize(
    ("value", "shown"),
    [(2.13e-16, "2.1e-16"), (0.0035, "0.0035"), (0.0473, "0.047"), (0.123, "0.12"), (1.0, "1.00"), (None, "")],
)
def test_p_values_have_two_digits(value, shown):
    """So that one below 0.05 is not shown as 0.05."""
    assert p_text(value) == shown


def test_latex_has_tables_and_comments_alone():
    text = format_comparison(kitchen_suite.compare(evaluated(), evaluated()), "latex")
    outside = re.sub(r"\\begin\{tabular\}.*?\\end\{tabular\}", "", text, flags=re.DOTALL)
    assert text.count(r"\begin{tabular}") == 2
    assert all(line.startswith("%") for line in outside.splitlines() if line)
    assert not re.search(r"(?<!\\)%", text[text.index(r"\begin") : text.index(r"\end")])


def test_the_command_prints_and_writes(run, receipts, tmp_path):
    path = tmp_path / "both.json"
    names = [str(receipts / f"{name}.npz") for name in ("random", "zero")]
    status, out, err = run(compare_command, *names, f"--json={path}")
    assert (status, err) == (0, "")
    assert out.startswith("kitchen, protocol default, variations start (seen): 3 episodes in pairs, seeds from 4")
    record = json.loads(path.read_text("utf-8"))
    assert record == kitchen_suite.compare(*names).as_json()
    differences = {"success_difference", "success_at_end_difference", "mean_tasks_difference"}
    assert {"wins", "losses", "ties", "p_value", "intervals", *differences} <= record.keys()
    assert record["intervals"].keys() == differences
    status, out, _ = run(compare_command, *names, names[0], "--format=markdown", f"--json={path}")
    assert status == 0
    assert re.search(r"\| +p \(Holm\) \|", out)
    assert len(json.loads(path.read_text("utf-8"))["comparisons"]) == 3


@pytest.mark.full
def test_what_cannot_be_paired_ends_with_status_2(run, receipts, folder):
    assert run(evaluate_command, *SMALL, "--seed=5", "--receipt=other.npz")[0] == 0
    status, out, err = run(compare_command, "other.npz", str(receipts / "zero.npz"))
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "seeds [5, 6, 7] in other alone" in err


@pytest.mark.full
def test_rows_of_episodes_can_be_paired(run, folder):
    """The remedies of the messages about files without episodes, and about folders of evaluations, are followed."""
    status, out, _ = run(evaluate_command, *SMALL, "--episodes", "--json=rows.json", "--receipt=a.npz")
    assert status == 0
    rows = json.loads((folder / "rows.json").read_text("utf-8"))["episodes"]["random_4"]
    assert [row["seed"] for row in rows] == [400000000, 400000001, 400000002]
    assert len(re.findall(r"^random_4 +4000000\d\d +no ", out, flags=re.MULTILINE)) == 3
    assert run(compare_command, "rows.json", "a.npz")[0] == 0
    flags = [*SMALL, "--output=evaluation", "--json=scores.json"]
    assert run(evaluate_command, *flags)[0] == 0
    status, _, err = run(compare_command, "scores.json", "a.npz")
    assert (status, "--episodes" in err) == (2, True)
    status, _, err = run(compare_command, "evaluation", "a.npz")
    assert status == 2
    (remedy,) = re.findall(r"--output=evaluation --resume --receipt=\S+", err)
    assert run(evaluate_command, *SMALL, *remedy.replace("FILE", "again").split())[0] == 0
    assert run(compare_command, "again.npz", "rows.json")[0] == 0


@pytest.mark.full
def test_recordings_are_paired_by_seed(folder):
    spec = EnvironmentSpec.make("kitchen", "kettle", {}, max_episode_steps=3)
    for name, policy, seed in (("a", "random", 4), ("b", "zero", 4), ("c", "zero", 5)):
        kitchen_suite.record(name, spec, policy, num_episodes=2, seed=seed)
    comparison = kitchen_suite.compare("a", "b")
    assert (comparison.ties, comparison.first.name, comparison.as_json()["protocol"]) == (2, "a", None)
    assert [one.seed for one, _ in comparison.all_pairs] == [4, 5]
    with refused(ValueError, "seeds [4] in a alone", "seeds [6] in c alone"):
        kitchen_suite.compare("a", "c")


@pytest.mark.full
def test_a_recording_and_an_evaluation_are_no_pair(receipts, folder):
    spec = EnvironmentSpec.make("kitchen", "random_4", {}, max_episode_steps=3)
    kitchen_suite.record("a", spec, "random", num_episodes=1)
    with refused(ValueError, "protocol default, and a recording, without a protocol"):
        kitchen_suite.compare(receipts / "zero.npz", "a")


def test_cabinets_are_compared_by_progress(folder):
    for name in ("random", "zero"):
        kitchen_suite.evaluate(
            name, domain_name="open_cabinet", num_episodes=3, max_episode_steps=3, receipt=f"{name}.npz"
        )
    record = kitchen_suite.compare("random.npz", "zero.npz").as_json()
    assert "task_rates" not in record
    assert record["mean_progress_difference"] == record["scores"]["mean_progress"]["difference"]


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("missing.npz", "there is no"),
        ("text.npz", "receipt"),
        ("text.json", "results of an evaluation"),
        (".", "is a folder"),
    ],
)
def test_other_files_are_refused(run, receipts, folder, name, shown):
    for file in ("text.npz", "text.json"):
        (folder / file).write_text('{"a": 1}', encoding="utf-8")
    status, out, err = run(compare_command, name, str(receipts / "zero.npz"))
    assert (out, err.count("\n")) == ("", 1)
    assert status == (1 if name == "text.npz" else 2)
    assert shown in err


def test_an_altered_receipt_is_refused(receipts, folder):
    contents = bytearray((receipts / "zero.npz").read_bytes())
    contents[100] ^= 1
    (folder / "altered.npz").write_bytes(contents)
    with refused(OSError, "altered.npz"):
        kitchen_suite.compare("altered.npz", receipts / "zero.npz")


def test_a_file_that_is_compared_is_never_written_to(run, receipts):
    names = [str(receipts / f"{name}.npz") for name in ("random", "zero")]
    status, _, err = run(compare_command, *names, f"--json={names[0]}")
    assert (status, "different files" in err) == (2, True)
    assert kitchen_suite.compare(*names).ties == 3


@pytest.mark.full
def test_policies_of_one_name_without_paths_are_told_apart_by_their_places():
    def act(observations):
        return np.zeros((len(observations["observation"]), 9))

    arguments = {"takes": "batch", "task_name": "kettle", "num_episodes": 2, "max_episode_steps": 3}
    name = f"object {__name__}.test_policies_of_one_name_without_paths_are_told_apart_by_their_places.<locals>.act"
    comparison = kitchen_suite.compare(*(kitchen_suite.evaluate(act, **arguments) for _ in range(2)))
    assert (comparison.first.name, comparison.second.name) == (f"{name} (1)", f"{name} (2)")


def test_policies_of_one_name_are_told_apart_by_their_paths(receipts, folder):
    (folder / "zero.npz").write_bytes((receipts / "zero.npz").read_bytes())
    comparison = kitchen_suite.compare("zero.npz", receipts / "zero.npz")
    assert (comparison.first.name, comparison.second.name) == ("zero.npz", str(receipts / "zero.npz"))


def differing(receipts):
    """A comparison in which the first policy alone succeeds in the last episode."""
    comparison = kitchen_suite.compare(receipts / "random.npz", receipts / "zero.npz")
    (name,) = comparison.pairs
    one, other = comparison.pairs[name][-1]
    pairs = [*comparison.pairs[name][:-1], (dataclasses.replace(one, success=True), other)]
    return PairedComparison(first=comparison.first, second=comparison.second, pairs={name: pairs})


@pytest.mark.full
def test_episodes_are_played_again_as_they_were(receipts):
    comparison = differing(receipts)
    ((one, _),) = comparison.differing
    steps = [buffer.steps for buffer, _ in side_by_side.replayed(comparison.first, one)]
    assert steps == [0, 1, 2, 3, 4]
    *_, (buffer, _) = side_by_side.replayed(comparison.first, one)
    np.testing.assert_array_equal(buffer.arrays()["action"], comparison.first.recorded(None, one)[1])


@pytest.mark.full
@pytest.mark.rendering
def test_a_video_shows_both_policies_with_their_names(receipts, folder):
    import imageio.v2 as imageio

    comparison = differing(receipts)
    picture = side_by_side.Picture(width=320, height=160)
    assert side_by_side.film(comparison, folder / "both.mp4", picture, 3) == 1
    with contextlib.closing(imageio.get_reader("both.mp4")) as reader:
        seen = np.stack([*reader.iter_data()]).astype(float)
    # A start and four control steps, and the end for a second of 12.5 frames.
    assert seen.shape == (5 + 12, 160, 320, 3)
    # Both begin alike, and only the captions with their names differ.
    left, right = seen[0, :, :160], seen[0, :, 160:]
    assert np.abs(left[20:140] - right[20:140]).mean() < 2.0
    assert np.abs(left[:12] - right[:12]).max() > 100.0
    # Their actions differ, and the captions of the end say which one succeeded.
    assert np.abs(seen[-1, 20:140, :160] - seen[-1, 20:140, 160:]).mean() > 0.2
    assert np.abs(seen[-1, :12] - seen[0, :12]).max() > 100.0


@pytest.mark.full
@pytest.mark.rendering
def test_the_command_films_the_episodes_that_differ(run, folder, receipts):
    names = [str(receipts / f"{name}.npz") for name in ("random", "zero")]
    status, out, err = run(compare_command, *names, "--video=both.mp4")
    assert (status, err) == (0, "")
    assert "nothing to show" in out
    assert not (folder / "both.mp4").exists()


@pytest.mark.full
def test_what_cannot_be_filmed_is_refused_first(run, folder, receipts):
    names = [str(receipts / f"{name}.npz") for name in ("random", "zero")]
    status, out, err = run(compare_command, *names, names[0], "--video=both.mp4")
    assert (status, out) == (2, "")
    assert "two policies, not 3" in err
    assert run(evaluate_command, *SMALL, "--episodes", "--json=rows.json")[0] == 0
    status, out, err = run(compare_command, "rows.json", names[1], "--video=both.mp4")
    assert (status, out) == (2, "")
    assert "write a receipt" in err


GATES = {
    "worse": ("worse", (TASKS,) * EPISODES, ((),) * EPISODES, 4, "failed: random is worse than zero"),
    "not_better": ("not_better", (TASKS,) * EPISODES, ((),) * EPISODES, 4, "failed: random is worse than zero"),
    "alike": ("worse", (TASKS,) * 4, ((),) + (TASKS,) * 3, 0, "passed: random is shown to be neither better nor"),
    "alike, not better": ("not_better", (TASKS,) * 4, (TASKS,) * 4, 4, "failed: random is shown to be neither"),
    "better": ("not_better", ((),) * EPISODES, (TASKS,) * EPISODES, 0, "passed: random is better than zero"),
    # The interval excludes 0, and the exact p is 0.125.
    "too few": ("worse", (TASKS,) * 4, ((),) * 4, 0, "passed: random is shown to be neither"),
}


@pytest.mark.parametrize("name", GATES)
def test_a_gate_fails_with_status_4(run, folder, name):
    gate, first, second, expected, shown = GATES[name]
    evaluated(first, num_episodes=len(first)).write("zero.json")
    evaluated(second, num_episodes=len(second), policy="random").write("random.json")
    status, out, err = run(compare_command, "zero.json", "random.json", f"--fail_if={gate}", "--json=both.json")
    assert (status, err) == (expected, "")
    assert f"--fail_if={gate} {shown}" in out
    assert (folder / "both.json").exists()


def test_a_gate_decides_across_arguments_and_by_kitchens(run, folder):
    evaluated((TASKS,) * EPISODES).write("usual.json")
    evaluated(((),) * EPISODES, task_kwargs=WITHOUT).write("varied.json")
    assert run(compare_command, "usual.json", "varied.json", "--across=variations", "--fail_if=worse")[0] == 4
    kitchens([4] * 3).write("many.json")
    kitchens([]).write("none.json")
    kitchens([1] * 12).write("spread.json")
    # Twelve episodes in three kitchens prove less than in twelve.
    assert run(compare_command, "many.json", "none.json", "--fail_if=worse")[0] == 0
    assert run(compare_command, "spread.json", "none.json", "--fail_if=worse")[0] == 4


def test_a_gate_is_about_two_policies(run, receipts):
    names = [str(receipts / f"{name}.npz") for name in ("random", "zero")]
    status, out, err = run(compare_command, *names, names[0], "--fail_if=worse")
    assert (status, out, "second of two policies, not of 3" in err) == (2, "", True)
    status, out, err = run(compare_command, names[0])
    assert (status, out) == (2, "")
    assert "at least 2 are needed" in err
    assert "--a and --b" in err
