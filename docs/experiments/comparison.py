"""Measures what pairing episodes buys, and whether the paired interval contains the true difference.

The played episodes are results/comparison_pool.json and results/comparison/; what follows is results/comparison.json.

python docs/experiments/comparison.py    plays what is missing, and measures

The truth is known by construction. In each episode of the pool the scripted expert succeeds and random actions fail. A
mixture of the two draws a coin in each episode, and plays the one or the other: an episode is a function of its seed
and of who acts, so that the mixture's result is that of the component in the pool. Mixture A succeeds in 95 % of the
episodes, and mixture B in 90 %. Three constructions differ in what the two have in common:

  independent coins   nothing: two policies whose failures have nothing to do with the episode
  hard episodes       a fifth of the episodes, chosen by their seeds, is hard. There A fails in 25 %, B in 50 %, each by
                      a coin of its own; elsewhere none fails
  nested failures     one number of the seed decides: B fails wherever A does, and elsewhere as often again

Each comparison draws its episodes from the pool with replacement, so that the true difference is the pool's. The
comparison without pairs draws the episodes of B apart from those of A.

Two shipped policies are compared as well: the expert and the trained network, from held-out starts. Needs the extra
`experts`.
"""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from experiment import RESULTS, Row, make_parser, measure_missing, read_rows, run_command, write_rows
from numpy.typing import NDArray
from scipy import stats

import kitchen_suite
from kitchen_suite.evaluation.paired import PairedVerdicts, score_interval
from kitchen_suite.evaluation.scores import wilson

POOL = RESULTS / "comparison_pool.json"
EVALUATIONS = RESULTS / "comparison"
MEASURED = RESULTS / "comparison.json"

EPISODES = 1_000  # In the pool.
FIRST_SEED = 600_000_000

COMPARISONS = 2_000
EPISODES_EACH = 200  # Of a comparison whose interval is measured.
LEVEL = 0.05
POWER = 0.80
LARGEST = 1_000  # Episodes of a comparison whose power is measured.
COUNT_STEP = 10  # Numbers of episodes are searched in steps of so many.

# Success rates of the mixtures.
RATE_A = 0.95
RATE_B = 0.90

HARD = 0.2  # Fraction of hard episodes.

# The light switch takes the expert some 30 control steps.
POOL_CASES: list[Row] = [
    {
        "policy": policy,
        "task": "light_switch",
        "physics": "fast",
        "max_episode_steps": 60,
        "seed": FIRST_SEED,
        "episodes": EPISODES,
    }
    for policy in ("expert", "random")
]

# Evaluations of the shipped policies, by kitchen-evaluate with these flags.
SHIPPED = ("expert", "trained")
SHIPPED_FLAGS = ("--variation_split=held_out", "--episodes")

# Probabilities of success `(n,)` of A and of B in episodes of difficulties `(n,)`, uniform from 0 to 1.
Difficulties = NDArray[np.float64]
Construction = Callable[[Difficulties], tuple[NDArray[np.float64], NDArray[np.float64]]]


def independent_coins(difficulties: Difficulties) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the same probabilities in all episodes."""
    return np.full_like(difficulties, RATE_A), np.full_like(difficulties, RATE_B)


def hard_episodes(difficulties: Difficulties) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns probabilities that are less than 1 in hard episodes alone."""
    is_hard = difficulties < HARD
    return np.where(is_hard, 1.0 - (1.0 - RATE_A) / HARD, 1.0), np.where(is_hard, 1.0 - (1.0 - RATE_B) / HARD, 1.0)


def nested_failures(difficulties: Difficulties) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns probabilities of 0 or 1."""
    return (difficulties >= 1.0 - RATE_A).astype(float), (difficulties >= 1.0 - RATE_B).astype(float)


CONSTRUCTIONS: dict[str, Construction] = {
    "independent coins": independent_coins,
    "hard episodes": hard_episodes,
    "nested failures": nested_failures,
}


def play(case: Row) -> Row:
    """Returns whether each episode of a case succeeded, as a text of zeros and ones."""
    evaluation = kitchen_suite.evaluate(
        case["policy"],
        task_name=case["task"],
        task_kwargs={"physics": case["physics"]},
        seed=case["seed"],
        num_episodes=case["episodes"],
        max_episode_steps=case["max_episode_steps"],
        num_envs=100,
    )
    (results,) = evaluation.results.values()
    return {"successes": "".join(str(int(result.success)) for result in results)}


def successes(policy: str) -> NDArray[np.bool_]:
    """Returns which episodes `(n,)` of the pool a policy succeeded in."""
    (row,) = (row for row in read_rows(POOL) if row["policy"] == policy)
    return np.array([*row["successes"]]) == "1"


def evaluate_shipped() -> None:
    """Evaluates the shipped policies that have no results yet."""
    EVALUATIONS.mkdir(exist_ok=True)
    for policy in SHIPPED:
        path = EVALUATIONS / f"{policy}.json"
        if not path.exists():
            run_command("evaluate", f"--policy={policy}", *SHIPPED_FLAGS, f"--json={path}")


class Mixtures:
    """Draws episodes of the two mixtures of a construction."""

    def __init__(self, construction: Construction) -> None:
        """Spreads the difficulties evenly over the episodes of the pool, in an order drawn from the seeds."""
        order = np.random.default_rng(FIRST_SEED).permutation(EPISODES)
        self._probabilities = construction((order + 0.5) / EPISODES)
        self._expert = successes("expert")
        self._random = successes("random")
        first, second = (
            np.where(self._expert, each, 0.0) + np.where(self._random, 1.0 - each, 0.0) for each in self._probabilities
        )
        self.difference = float(np.mean(first - second))

    def draw(self, count: int, generator: np.random.Generator) -> tuple[NDArray[np.bool_], ...]:
        """Returns successes `(COMPARISONS, count)`: of A and B in the same episodes, and of B in others."""
        shape = (COMPARISONS, count)
        together = generator.integers(EPISODES, size=shape)
        apart = generator.integers(EPISODES, size=shape)
        return tuple(
            self._played(self._probabilities[which], episodes, generator)
            for which, episodes in ((0, together), (1, together), (1, apart))
        )

    def _played(
        self, probabilities: NDArray[np.float64], episodes: NDArray[np.int64], generator: np.random.Generator
    ) -> NDArray[np.bool_]:
        acts_by_expert = generator.random(episodes.shape) < probabilities[episodes]
        return np.where(acts_by_expert, self._expert[episodes], self._random[episodes])


@functools.cache
def paired_interval(wins: int, losses: int, count: int) -> tuple[float, float]:
    """Returns the interval of kitchen-compare."""
    return score_interval(wins, losses, count)


@functools.cache
def unpaired_interval(first: int, second: int, count: int, second_count: int | None = None) -> tuple[float, float]:
    """Returns Newcombe's interval of the difference of two rates on different episodes, from both Wilson intervals."""
    other_count = count if second_count is None else second_count
    low_a, high_a = wilson(first, count)
    low_b, high_b = wilson(second, other_count)
    rate_a, rate_b = first / count, second / other_count
    difference = rate_a - rate_b
    below = np.hypot(rate_a - low_a, high_b - rate_b)
    above = np.hypot(high_a - rate_a, rate_b - low_b)
    return float(difference - below), float(difference + above)


@functools.cache
def paired_p_value(wins: int, losses: int) -> float:
    """Returns the exact p-value of McNemar's test."""
    return PairedVerdicts(wins=wins, losses=losses, ties=0).p_value


@functools.cache
def unpaired_p_value(first: int, second: int, count: int) -> float:
    """Returns the p-value of Fisher's exact test."""
    return float(stats.fisher_exact([[first, count - first], [second, count - second]]).pvalue)


def counts(drawn: tuple[NDArray[np.bool_], ...]) -> list[tuple[int, int, int, int]]:
    """Returns wins and losses in the same episodes, and successes of A and of B in different ones, by comparison."""
    a, b, other_b = drawn
    columns = (a & ~b, ~a & b, a, other_b)
    return [*zip(*(column.sum(axis=1).tolist() for column in columns), strict=True)]


def coverage(mixtures: Mixtures) -> Row:
    """Measures how often the intervals contain the true difference, and how wide they are on average."""
    row: Row = {"episodes": EPISODES_EACH, "comparisons": COMPARISONS, "difference": round(mixtures.difference, 6)}
    paired, unpaired = [], []
    for wins, losses, first, second in counts(mixtures.draw(EPISODES_EACH, np.random.default_rng(1))):
        paired.append(paired_interval(wins, losses, EPISODES_EACH))
        unpaired.append(unpaired_interval(first, second, EPISODES_EACH))
    for name, intervals in (("paired", np.array(paired)), ("unpaired", np.array(unpaired))):
        inside = (intervals[:, 0] <= mixtures.difference) & (mixtures.difference <= intervals[:, 1])
        row[f"{name}_coverage"] = round(float(inside.mean()), 4)
        row[f"{name}_width"] = round(float(np.diff(intervals).mean()), 4)
    return row


def powers(mixtures: Mixtures, count: int) -> tuple[float, float]:
    """Returns how often a difference is found in comparisons of `count` episodes, with pairs and without."""
    drawn = counts(mixtures.draw(count, np.random.default_rng((2, count))))
    paired = [paired_p_value(wins, losses) < LEVEL for wins, losses, _, _ in drawn]
    unpaired = [unpaired_p_value(first, second, count) < LEVEL for _, _, first, second in drawn]
    return float(np.mean(paired)), float(np.mean(unpaired))


def episodes_needed(mixtures: Mixtures) -> Row:
    """Returns the least numbers of episodes, with pairs and without, that find the difference often enough."""
    row: Row = {}
    for count in range(COUNT_STEP, LARGEST + 1, COUNT_STEP):
        for name, power in zip(("paired", "unpaired"), powers(mixtures, count), strict=True):
            if power >= POWER and f"{name}_episodes" not in row:
                row |= {f"{name}_episodes": count, f"{name}_power": round(power, 4)}
        if len(row) == 4:
            break
    return row


def shipped() -> Row:
    """Returns what pairing buys with the expert and the network that ship with the suite."""
    comparison = kitchen_suite.compare(*(EVALUATIONS / f"{policy}.json" for policy in SHIPPED))
    first, second = (
        np.array(each) for each in zip(*((a.success, b.success) for a, b in comparison.all_pairs), strict=True)
    )
    apart = unpaired_interval(int(first.sum()), int(second.sum()), first.size)
    low, high = comparison.success.interval
    return {
        "construction": "expert and trained",
        "episodes": first.size,
        "expert": float(first.mean()),
        "trained": float(second.mean()),
        "wins": comparison.wins,
        "losses": comparison.losses,
        "difference": round(comparison.success.difference, 6),
        "paired_width": round(high - low, 4),
        "unpaired_width": round(apart[1] - apart[0], 4),
        "correlation": round(float(np.corrcoef(first, second)[0, 1]), 4),
        "episodes_ratio": round(variance_ratio(first, second), 4),
    }


def variance_ratio(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> float:
    """Returns the episodes that pairs need for the same precision, as a fraction of those that two samples need."""
    differences = first.astype(float) - second
    return float(differences.var() / (first.var() + second.var()))


def main() -> None:
    """Plays what is missing, and measures."""
    make_parser(__doc__).parse_args()
    measure_missing(POOL, POOL_CASES, play)
    evaluate_shipped()
    rows: list[dict[str, Any]] = []
    for name, construction in CONSTRUCTIONS.items():
        mixtures = Mixtures(construction)
        rows.append({"construction": name, **coverage(mixtures), **episodes_needed(mixtures)})
        print(rows[-1], flush=True)
    rows.append(shipped())
    print(rows[-1])
    write_rows(MEASURED, rows)


if __name__ == "__main__":
    main()
