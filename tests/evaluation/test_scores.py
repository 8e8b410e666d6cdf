"""Scores of episodes, by hand-made cases and by properties."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from kitchen_suite import files
from kitchen_suite.evaluation import results as scores
from kitchen_suite.evaluation.protocols import Score
from kitchen_suite.evaluation.results import EpisodeResult, score_episodes


# Published examples of the interval: Newcombe 1998, table I.
@pytest.mark.parametrize(
    ("successes", "count", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilsons_interval_is_the_published_one(successes, count, low, high):
    np.testing.assert_allclose(scores.wilson(successes, count), (low, high), atol=5e-5)


@given(st.integers(1, 3_000), st.data())
@settings(deadline=None, derandomize=True, max_examples=50)
def test_wilsons_interval_contains_the_rate_and_is_symmetric(count, data):
    successes = data.draw(st.integers(0, count))
    low, high = scores.wilson(successes, count)
    assert 0.0 <= low <= successes / count <= high <= 1.0
    np.testing.assert_allclose(scores.wilson(count - successes, count), (1 - high, 1 - low), atol=1e-12)


def test_a_mean_has_students_interval():
    # The quantile of Student's t for three degrees of freedom is 3.182446.
    value, (low, high) = scores.mean([1, 2, 3, 4])
    half = 3.182446 * math.sqrt(5 / 3) / 2
    np.testing.assert_allclose((value, low, high), (2.5, 2.5 - half, 2.5 + half), atol=1e-6)
    assert scores.mean([1, 2, 3, 4], low=1, high=4)[1] == (1, 4)
    assert scores.mean([2, 2, 2]) == (2, (2, 2))
    assert scores.mean([5]) == (5, None)


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


def test_the_order_entropy_is_of_the_sequences_of_completed_tasks():
    # The orders are 10, 10, none, 12.
    assert scores.order_entropy(ASKED, STEPS) == pytest.approx(1.5)
    assert scores.order_entropy(ASKED[:2], STEPS[:2]) == 0.0
    # One order is the beginning of the other.
    assert scores.order_entropy(np.full((2, 2), True), np.array([[1, 2], [1, -1]])) == 1.0


tables = st.tuples(st.integers(1, 12), st.integers(1, 5)).flatmap(
    lambda shape: st.tuples(arrays.arrays(bool, shape), arrays.arrays(np.int64, shape, elements=st.integers(-1, 4)))
)


@given(tables, st.randoms(use_true_random=False))
@settings(deadline=None, derandomize=True, max_examples=100)
def test_scores_have_their_properties(table, random):
    asked, steps = table
    completed = scores.tasks_completed(asked, steps)
    most = asked.shape[1]
    rates = [scores.rate(mask)[0] for mask in scores.at_least(completed, most).values()]
    # The mean number of tasks is the sum of p1 to pN, which do not grow.
    assert sum(rates) == pytest.approx(completed.mean())
    assert rates == sorted(rates, reverse=True)
    entropy = scores.order_entropy(asked, steps)
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


def test_tasks_that_cannot_be_counted_have_progress():
    scored = score_episodes([result(0, None), result(1, None, success=True)])
    assert (scored["mean_progress"], scored["success"]) == (1.0, 0.5)
    assert not {"p1", "mean_tasks", "order_entropy", "task_rates"} & scored.keys()


@pytest.mark.parametrize("each", RESULTS)
def test_a_result_is_read_from_its_line(each):
    line = each.as_line("an evaluation")
    assert b"\n" not in line
    assert EpisodeResult.from_line(line, "an evaluation") == each
    with pytest.raises(ValueError, match="sha256"):
        EpisodeResult.from_line(line, "another evaluation")


LINE = RESULTS[0].as_line("")
# Lines whose digests are their own.
BEYOND = [{"control_steps": -1}, {"control_steps": 1e30}, {"seed": -1}, {"episode": -1}, {"asked": {"kettle": -1}}]
FORGED = [files.digest_line({**dataclasses.asdict(RESULTS[0]), **changes}, "").encode() for changes in BEYOND]


@pytest.mark.parametrize("line", [b"", b"{}", b"[1]", LINE[:-1], LINE.replace(b"true", b"1"), LINE + b" ", *FORGED])
def test_another_line_is_refused(line):
    with pytest.raises(ValueError, match=r"."):
        EpisodeResult.from_line(line, "")
