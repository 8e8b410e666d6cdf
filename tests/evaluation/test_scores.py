"""Scores of episodes, by hand-made cases and by properties."""

import dataclasses
import json
import math
import types

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from kitchen_suite import files
from kitchen_suite.evaluation import scores
from kitchen_suite.evaluation.protocols import Score
from kitchen_suite.evaluation.scores import EpisodeResult, score_episodes
from kitchen_suite.tasks.metrics import Completions


# Published examples of the interval: Newcombe 1998, table I.
@pytest.mark.parametrize(
    ("successes", "count", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilsons_interval_is_the_published_one(successes, count, low, high):
    np.testing.assert_allclose(scores.wilson(successes, count), (low, high), atol=5e-5)


@pytest.mark.full
@given(st.integers(1, 3_000), st.data())
@settings(deadline=None, derandomize=True, max_examples=50)
def test_wilsons_interval_contains_the_rate_and_is_symmetric(count, data):
    successes = data.draw(st.integers(0, count))
    low, high = scores.wilson(successes, count)
    assert 0.0 <= low <= successes / count <= high <= 1.0
    np.testing.assert_allclose(scores.wilson(count - successes, count), (1 - high, 1 - low), atol=1e-12)


def test_nearly_equal_values_have_the_interval_of_equal_ones():
    values = [0.5, 0.5 * (1.0 + 2.0**-52)]
    assert scores.mean(values) == (pytest.approx(0.5), None)
    equal = scores.mean([0.5, 0.5], low=0.0, high=1.0)[1]
    assert scores.mean(values, low=0.0, high=1.0)[1] == pytest.approx(equal, rel=1e-14)


def test_huge_and_tiny_values_have_the_interval_of_their_multiples():
    # Student's t at one degree of freedom is 12.7062.
    assert scores.mean([1e300, -1e300]) == (0.0, pytest.approx((-12.7062e300, 12.7062e300), rel=1e-5))
    assert scores.mean([1e-300, -1e-300]) == (0.0, pytest.approx((-12.7062e-300, 12.7062e-300), rel=1e-5))


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1.1e300])
@pytest.mark.parametrize("name", ["progress", "energy"])
def test_an_episode_with_a_number_that_has_no_mean_is_refused(name, value):
    numbers = {"progress": 0.0, "measures": {"energy": 1e300, "clean": True}}
    EpisodeResult(condition="a", episode=0, seed=7, success=True, control_steps=1, **numbers)
    numbers |= {"progress": value} if name == "progress" else {"measures": {"energy": value}}
    with pytest.raises(ValueError, match=f"^{name} of the episode of seed 7 is .*: it must be a number from -1e"):
        EpisodeResult(condition="a", episode=0, seed=7, success=True, control_steps=1, **numbers)


# The quantile of the normal distribution that leaves 2.5 % above.
Z = 1.959963984540054


def test_a_rate_is_the_share_of_true_verdicts_with_its_interval():
    assert scores.CONFIDENCE == 0.95
    for verdicts in ([True, False, True, True], np.array([1, 0, 2, 1])):
        value, interval = scores.rate(verdicts)
        assert (value, type(value)) == (0.75, float)
        # p + z^2 / 2n -+ z sqrt(p (1 - p) / n + z^2 / 4n^2), by 1 + z^2 / n.
        half = Z * math.sqrt(0.75 * 0.25 / 4 + Z**2 / 64)
        expected = [(0.75 + Z**2 / 8 + sign * half) / (1 + Z**2 / 4) for sign in (-1, 1)]
        np.testing.assert_allclose(interval, expected, rtol=1e-9)
    for verdict, expected in ((False, (0.0, Z**2 / (1 + Z**2))), (True, (1 / (1 + Z**2), 1.0))):
        value, interval = scores.rate([verdict])
        assert value == verdict
        np.testing.assert_allclose(interval, expected, rtol=1e-9)
    # Rounding would put the bounds of some of these numbers beside 0 and 1.
    for count in range(250, 300):
        assert scores.rate([False] * count)[1][0] == 0.0
        assert scores.rate([True] * count)[1][1] == 1.0


def test_a_mean_has_students_interval():
    # The quantile of Student's t for three degrees of freedom is 3.182446.
    value, (low, high) = scores.mean([1, 2, 3, 4])
    half = 3.182446 * math.sqrt(5 / 3) / 2
    np.testing.assert_allclose((value, low, high), (2.5, 2.5 - half, 2.5 + half), atol=1e-6)
    assert scores.mean([1, 2, 3, 4], low=1, high=4)[1] == (1, 4)
    # For one degree of freedom it is 12.706205.
    value, interval = scores.mean([-5, 5])
    assert (value, type(value)) == (0.0, float)
    np.testing.assert_allclose(interval, (-5 * 12.706205, 5 * 12.706205), rtol=1e-6)
    assert scores.mean([-5, 5], low=-7) == (0.0, (-7, interval[1]))
    assert scores.mean([-5, 5], high=9) == (0.0, (interval[0], 9))
    assert scores.mean([5]) == (5, None)


def test_equal_values_leave_the_others_that_the_exact_limit_allows():
    # The exact limit of Clopper and Pearson for 0 of 10 is 0.308497.
    for count, unseen in ((10, 0.308497), (50, 0.071122)):
        for value in (0.0, 3.0, 4.0):
            middle, interval = scores.mean([value] * count, low=0, high=4)
            assert middle == value
            np.testing.assert_allclose(interval, (value - unseen * value, value + unseen * (4 - value)), atol=1e-5)
            assert all(type(bound) is float for bound in interval)
    # Without bounds nothing is known of other values.
    for bounds in ({}, {"low": 0.0}, {"high": 4.0}):
        assert scores.mean([2, 2, 2], **bounds) == (2, None)


def test_control_steps_are_within_an_episode():
    scored = score_episodes([result(0, {"kettle": 1}, steps=1), result(1, {"kettle": 9}, steps=280)], None, 280)
    assert scored["intervals"]["control_steps"] == [1.0, 280.0]
    failed = score_episodes([result(index, {"kettle": None}) for index in range(10)], None, 280)
    assert failed["intervals"]["control_steps"] == pytest.approx([280 - 0.308497 * 279, 280], abs=1e-3)
    assert failed["intervals"]["mean_tasks"] == pytest.approx([0, 0.308497], abs=1e-5)


def test_conditions_that_are_a_sample_have_the_interval_of_their_mean():
    shares = [0.0, 0.25, 1.0, 1.0, 0.75]
    by_condition = {f"kitchen {i}": {"success": each, "diverged_seeds": [i]} for i, each in enumerate(shares)}
    scored = scores.score_sample(by_condition, ("success",))
    # The quantile of Student's t for four degrees of freedom is 2.776445.
    half = 2.776445 * np.std(shares, ddof=1) / math.sqrt(5)
    assert (scored["success"], scored["diverged_seeds"]) == (0.6, [0, 1, 2, 3, 4])
    assert scored["intervals"]["success"] == pytest.approx([0.6 - half, 1.0], abs=1e-6)
    others = {name: {**each, "success": 1 - each["success"]} for name, each in by_condition.items()}
    assert scores.score_sample(others, ("success",))["intervals"]["success"] == pytest.approx([0, 0.4 + half], abs=1e-6)
    # An exact limit of 1 - 0.025^(1/5) is left to what was not seen.
    never = {name: {**each, "success": 0.0} for name, each in by_condition.items()}
    assert scores.score_sample(never, ("success",))["intervals"]["success"] == pytest.approx([0, 0.521824], abs=1e-6)


def test_no_episode_has_no_score():
    for function in (scores.rate, scores.mean):
        with pytest.raises(ValueError, match="needs at least one episode"):
            function([])


ASKED = np.array([[1, 1, 0], [1, 1, 1], [1, 1, 1], [0, 1, 1]], bool)
STEPS = np.array([[9, 3, 5], [9, 3, -1], [-1, -1, -1], [-1, 7, 7]])


def test_only_asked_tasks_count():
    completed = scores.tasks_completed(ASKED, STEPS)
    assert completed.tolist() == [2, 2, 0, 2]
    reached = scores.at_least(completed, 3)
    assert {name: mask.tolist() for name, mask in reached.items()} == {
        "p1": [True, True, False, True],
        "p2": [True, True, False, True],
        "p3": [False] * 4,
    }
    assert scores.at_least(completed, 0) == {}


def test_a_task_without_a_control_step_is_not_completed():
    steps = np.array([[0, -1, -7], [1, 2, 0]])
    asked = np.full((2, 3), True)
    assert scores.tasks_completed(asked, steps).tolist() == [0, 2]
    # The orders are none and 01.
    assert scores.order_entropy(asked, steps) == 1.0
    assert scores.order_entropy(asked[:1], steps[:1]) == 0.0


def test_the_order_entropy_is_of_the_sequences_of_completed_tasks():
    # The orders are 10, 10, none, 12.
    assert scores.order_entropy(ASKED, STEPS) == pytest.approx(1.5)
    assert scores.order_entropy(ASKED[:2], STEPS[:2]) == 0.0
    # One order is the beginning of the other.
    assert scores.order_entropy(np.full((2, 2), True), np.array([[1, 2], [1, -1]])) == 1.0
    # Tasks of one control step are in the order of the columns, and so are 1 and 2 of the second episode.
    assert scores.order_entropy(np.full((2, 3), True), np.array([[5, 5, 5], [1, 2, 3]])) == 0.0
    # One order of four, three of four.
    one, other = [1, 2], [2, 1]
    shares = scores.order_entropy(np.full((4, 2), True), np.array([one, other, other, other]))
    assert shares == pytest.approx(-0.25 * math.log2(0.25) - 0.75 * math.log2(0.75))


tables = st.tuples(st.integers(1, 12), st.integers(1, 5)).flatmap(
    lambda shape: st.tuples(arrays.arrays(bool, shape), arrays.arrays(np.int64, shape, elements=st.integers(-1, 4)))
)


@pytest.mark.full
@given(tables, st.randoms(use_true_random=False))
@settings(deadline=None, derandomize=True, max_examples=100)
def test_scores_have_their_properties(table, random):
    asked, steps = table
    with np.errstate(all="raise"):
        completed = scores.tasks_completed(asked, steps)
        entropy = scores.order_entropy(asked, steps)
    most = asked.shape[1]
    rates = [scores.rate(mask)[0] for mask in scores.at_least(completed, most).values()]
    # The mean number of tasks is the sum of p1 to pN, which do not grow.
    assert sum(rates) == pytest.approx(completed.mean())
    assert rates == sorted(rates, reverse=True)
    assert 0.0 <= entropy <= math.log2(len(asked)) + 1e-9
    orders = [
        tuple(sorted(np.flatnonzero(a & (s > 0)), key=lambda i, s=s: (s[i], i)))
        for a, s in zip(asked, steps, strict=True)
    ]
    shares = np.array([orders.count(order) / len(orders) for order in set(orders)])
    assert entropy == pytest.approx(-(shares * np.log2(shares)).sum(), abs=1e-9)
    shuffled = list(range(len(asked)))
    random.shuffle(shuffled)
    assert scores.order_entropy(asked[shuffled], steps[shuffled]) == pytest.approx(entropy)


def result(episode, asked, *, success=False, diverged=False, steps=280):
    return EpisodeResult(
        condition="all",
        episode=episode,
        seed=100 + episode,
        success=success,
        progress=0.5 + episode,
        control_steps=steps,
        asked=asked,
        diverged=diverged,
    )


RESULTS = [
    result(0, {"kettle": 20, "microwave": 50}, success=True, steps=50),
    result(1, {"light switch": None, "kettle": 30}),
    result(2, {"light switch": None, "microwave": None}, diverged=True),
    result(3, {"kettle": 60, "microwave": 40}, success=True, steps=60),
]


def test_episodes_are_scored():
    scored = score_episodes(RESULTS, Score(name="d4rl_score", best=100.0, tasks=2))
    assert [scored[name] for name in ("p1", "p2", "mean_tasks", "success")] == [0.75, 0.5, 1.25, 0.5]
    assert "p3" not in scored
    assert scored["d4rl_score"] == 62.5
    assert scored["control_steps"] == 167.5
    assert scored["order_entropy"] == 2.0
    assert scored["diverged_seeds"] == [102]
    assert {task: (row["completed"], row["asked"], row["rate"]) for task, row in scored["task_rates"].items()} == {
        "kettle": (3, 3, 1.0),
        "light switch": (0, 2, 0.0),
        "microwave": (2, 3, 0.666667),
    }
    low, high = scored["intervals"]["mean_tasks"]
    assert scored["intervals"]["d4rl_score"] == pytest.approx([50 * low, 50 * high], abs=1e-4)
    assert scored["intervals"]["p1"] == [round(bound, 6) for bound in scores.wilson(3, 4)]
    assert (low, high) == (0.0, 2.0)
    # With more episodes the bounds are within; for 15 degrees of freedom, the quantile of Student's t is 2.131450.
    many = score_episodes(RESULTS * 4, Score(name="score", best=1.0, tasks=2))
    half = 2.131450 * np.std([2, 1, 0, 2] * 4, ddof=1) / 4
    assert many["intervals"]["mean_tasks"] == pytest.approx([1.25 - half, 1.25 + half], abs=2e-6)
    assert many["intervals"]["score"] == pytest.approx([0.625 - half / 2, 0.625 + half / 2], abs=2e-6)


def test_scores_have_six_decimals_and_each_its_interval():
    scored = score_episodes(RESULTS[:3], Score(name="score", best=1.0, tasks=7))
    names = ["p1", "p2", "mean_tasks", "score", "success", "control_steps"]
    assert list(scored) == [*names, "intervals", "task_rates", "order_entropy", "diverged_seeds"]
    assert list(scored["intervals"]) == names
    rates = scored["task_rates"]
    assert rates["microwave"].keys() == {"rate", "interval", "asked", "completed"}
    assert rates["microwave"]["interval"] == pytest.approx(scores.wilson(1, 2), abs=1e-6)
    assert (scored["p1"], scored["score"], scored["control_steps"]) == (0.666667, 0.142857, 203.333333)
    assert scored["order_entropy"] == 1.584963
    intervals = [*scored["intervals"].values(), *(row["interval"] for row in rates.values())]
    for bounds in intervals:
        assert type(bounds) is list
        assert bounds == [round(bound, 6) for bound in bounds]
    assert any(round(bound, 5) != bound for bounds in intervals for bound in bounds)


def test_verdicts_among_further_measures_are_rates_and_numbers_means():
    measured = [{"gentle": True, "energy": 0.0, "gain": -5}, {"gentle": False, "energy": 1.0, "gain": 5}]
    results = [dataclasses.replace(RESULTS[0], measures=each) for each in measured]
    scored = score_episodes(results)
    assert [scored[name] for name in ("gentle", "energy", "gain")] == [0.5, 0.5, 0.0]
    assert scored["intervals"]["gentle"] == pytest.approx(scores.wilson(1, 2), abs=1e-6)
    # The quantile of Student's t for one degree of freedom is 12.706205. Energies are not negative, gains may be.
    assert scored["intervals"]["energy"] == pytest.approx([0.0, 0.5 + 0.5 * 12.706205], abs=2e-6)
    assert scored["intervals"]["gain"] == pytest.approx([-5 * 12.706205, 5 * 12.706205], abs=1e-5)


def test_one_episode_has_scores_without_intervals_of_means():
    scored = score_episodes(RESULTS[:1])
    assert (scored["mean_tasks"], scored["success"], scored["order_entropy"]) == (2.0, 1.0, 0.0)
    assert (scored["intervals"]["mean_tasks"], scored["intervals"]["control_steps"]) == (None, None)
    assert scored["intervals"]["success"] == pytest.approx(scores.wilson(1, 1), abs=1e-6)
    assert scored["diverged_seeds"] == []
    assert "score" not in scored


def test_an_episode_that_asks_for_no_task_completes_none():
    scored = score_episodes([result(0, {}), result(1, {"kettle": 5})])
    assert (scored["p1"], scored["mean_tasks"]) == (0.5, 0.5)
    assert (scored["task_rates"]["kettle"]["asked"], scored["order_entropy"]) == (1, 1.0)
    scored = score_episodes([result(0, {}), result(1, {})])
    assert (scored["mean_tasks"], scored["task_rates"], scored["order_entropy"]) == (0.0, {}, 0.0)


def test_tasks_that_cannot_be_counted_have_progress():
    scored = score_episodes([result(0, None), result(1, None, success=True)])
    assert (scored["mean_progress"], scored["success"]) == (1.0, 0.5)
    assert not {"p1", "mean_tasks", "order_entropy", "task_rates"} & scored.keys()


def test_a_task_that_the_first_step_completes_counts():
    scored = score_episodes([result(0, {"kettle": 1}), result(1, {"kettle": None})])
    assert (scored["p1"], scored["mean_tasks"], scored["task_rates"]["kettle"]["rate"]) == (0.5, 0.5, 0.5)


def test_one_task_that_cannot_be_counted_leaves_progress():
    scored = score_episodes([*RESULTS, result(4, None)], Score(name="score", best=1.0, tasks=2))
    assert list(scored) == ["mean_progress", "success", "control_steps", "intervals", "diverged_seeds"]
    assert scored["mean_progress"] == 2.5
    half = 2.776445 * math.sqrt(2.5 / 5)
    assert scored["intervals"]["mean_progress"] == pytest.approx([2.5 - half, 2.5 + half], abs=2e-6)


def ended(completions):
    """A task at the end of an episode, as far as results read it."""
    records = types.SimpleNamespace(
        completions=lambda infos: completions and completions._replace(steps=infos["steps"]),
        progress=lambda infos: infos["progress"],
    )
    return types.SimpleNamespace(records=records)


def test_a_result_is_of_the_last_infos():
    none = np.zeros(3, np.int64)
    completions = Completions(("kettle", "microwave", "top burner"), np.array([True, True, False]), none)
    infos = {"is_success": np.True_, "progress": np.array(0.25), "steps": np.array([7, -1, 9])}
    place = {"condition": "all", "episode": 3, "seed": 103}
    one = EpisodeResult.of(task=ended(completions), infos=infos, control_steps=280, **place)
    expected = EpisodeResult(
        **place, success=True, progress=0.25, control_steps=280, asked={"kettle": 7, "microwave": None}, diverged=False
    )
    assert one == expected
    assert (type(one.success), type(one.progress)) == (bool, float)
    other = EpisodeResult.of(ended(None), {**infos, "is_success": False}, control_steps=9, diverged=True, **place)
    assert other == dataclasses.replace(expected, success=False, control_steps=9, asked=None, diverged=True)
    with pytest.raises(dataclasses.FrozenInstanceError):
        one.success = False
    with pytest.raises(TypeError, match="positional"):
        EpisodeResult(*dataclasses.asdict(one).values())


def parsed(record):
    return files.parse(record, EpisodeResult, "not a result")


def test_a_result_counts_no_tasks_and_has_not_diverged_unless_told():
    plain = EpisodeResult(condition="all", episode=0, seed=0, success=False, progress=0.0, control_steps=0)
    assert (plain.asked, plain.diverged) == (None, False)
    assert parsed(plain.as_json()) == plain


def test_a_result_as_json_has_all_its_attributes():
    one = dataclasses.replace(RESULTS[0], measures={"energy": 2.0}, reset={"a": 1})
    assert one.as_json() == {
        "condition": "all",
        "episode": 0,
        "seed": 100,
        "success": True,
        "progress": 0.5,
        "control_steps": 50,
        "asked": {"kettle": 20, "microwave": 50},
        "diverged": False,
        "measures": {"energy": 2.0},
        "reset": {"a": 1},
    }


def test_the_greatest_seed_is_that_of_64_bits():
    one = dataclasses.replace(RESULTS[0], seed=9223372036854775807)
    assert parsed(one.as_json()) == one


@pytest.mark.parametrize("each", RESULTS)
def test_a_result_is_read_from_its_json(each):
    assert parsed(json.loads(json.dumps(each.as_json()))) == each


# Values that no result has.
BEYOND = [{"control_steps": -1}, {"control_steps": 1e30}, {"seed": -1}, {"seed": 2**63}, {"episode": -1}]
BEYOND += [{"asked": {"kettle": -1}}, {"success": 1}, {"progress": "x"}]


@pytest.mark.parametrize("changes", BEYOND)
def test_json_of_another_form_is_refused(changes):
    with pytest.raises(ValueError, match=r"."):
        parsed({**RESULTS[0].as_json(), **changes})
