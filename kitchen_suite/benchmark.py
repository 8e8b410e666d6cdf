"""`kitchen-benchmark`: how fast the suite steps, against bare MuJoCo, in one interleaved run.

Machines are shared and noisy, so what counts are ratios: in every round each contender makes one episode with the same
actions, and its rate is divided by that of bare MuJoCo in the same round. The table gives the median over the rounds.
Nothing is rendered, and no GL library is loaded.
"""

import json
import platform
import statistics
import sys
import time
from collections.abc import Mapping, Sequence
from importlib import metadata
from typing import TYPE_CHECKING

import numpy as np
from absl import flags
from tqdm import tqdm

from kitchen_suite import gl

# All else is imported late: dm_control must not be before `gl.prepare`.
if TYPE_CHECKING:
    from kitchen_suite.benchmark_domains import Domain


def measure(domain: "Domain", *, rounds: int, steps: int) -> dict[str, list[float]]:
    """Control steps per second of each contender in each round; a first round to warm up is not counted."""
    entries = domain.contenders()
    rates: dict[str, list[float]] = {name: [] for name in entries}
    rng = np.random.default_rng(0)
    for number in tqdm(range(rounds + 1), desc="rounds", disable=None):
        actions = domain.draw(rng, steps)
        for name, episode in entries.items():
            start = time.perf_counter()
            episode(actions)
            if number:
                rates[name].append(steps / (time.perf_counter() - start))
    return rates


def summarize(rates: Mapping[str, Sequence[float]]) -> dict[str, dict[str, float]]:
    """For each contender: median, least and greatest ratio to the first one, and median steps per second."""
    summary = {}
    baseline = next(iter(rates.values()))
    for name, values in rates.items():
        ratios = [value / bare for value, bare in zip(values, baseline, strict=True)]
        summary[name] = {
            "ratio": statistics.median(ratios),
            "least": min(ratios),
            "greatest": max(ratios),
            "steps_per_second": statistics.median(values),
        }
    return summary


def added_cost(plain: Sequence[float], adapted: Sequence[float]) -> float:
    """What an adapter adds to a control step, as a share, from the rates without and with it; median over rounds."""
    return statistics.median(without / with_it - 1 for without, with_it in zip(plain, adapted, strict=True))


def versions() -> dict[str, str]:
    """Versions of what decides the speed."""
    packages = ("mujoco", "dm_control", "numpy", "gymnasium-robotics")
    return {"python": platform.python_version(), **{package: metadata.version(package) for package in packages}}


def report(summary: Mapping[str, Mapping[str, float]], cost: float) -> str:
    """The summary as a table, and what the adapter costs."""
    lines = [f"{'':34}{'ratio':>7}{'least':>8}{'greatest':>10}{'steps/s':>9}"]
    lines += [
        f"{name:34}{row['ratio']:7.2f}{row['least']:8.2f}{row['greatest']:10.2f}{row['steps_per_second']:9.0f}"
        for name, row in summary.items()
    ]
    lines.append(f"The Gymnasium adapter adds {cost:.1%} to a control step.")
    return "\n".join([*lines, ", ".join(f"{name} {version}" for name, version in versions().items())])


_FLAGS = flags.FlagValues()
_DOMAIN_NAME = flags.DEFINE_enum(
    "domain_name", "kitchen", ["kitchen", "open_cabinet"], "what to measure", flag_values=_FLAGS
)
_ROUNDS = flags.DEFINE_integer("rounds", 9, "rounds that count", lower_bound=1, flag_values=_FLAGS)
_STEPS = flags.DEFINE_integer(
    "steps", None, "control steps of an episode; by default the domain's", lower_bound=1, flag_values=_FLAGS
)
_HELP = flags.DEFINE_bool("help", False, "show this help, and exit", short_name="h", flag_values=_FLAGS)
_JSON = flags.DEFINE_bool("json", False, "print JSON in place of the table", flag_values=_FLAGS)


def main(argv: Sequence[str]) -> int:
    """Measures and prints; returns the exit code, 2 for bad flags."""
    try:
        _FLAGS.unparse_flags()
        if extra := _FLAGS(argv)[1:]:
            raise flags.UnrecognizedFlagError(extra[0])
    except flags.Error as error:
        print("kitchen-benchmark:", " ".join(str(error).split()), file=sys.stderr)
        return 2
    if _HELP.value:
        print(__doc__, *_FLAGS.get_help(include_special_flags=False).splitlines()[2:], sep="\n")
        return 0
    gl.prepare(rendering=False)
    from kitchen_suite.benchmark_domains import ADAPTER, DOMAINS, SUITE

    domain = DOMAINS[_DOMAIN_NAME.value]
    rates = measure(domain, rounds=_ROUNDS.value, steps=_STEPS.value or domain.steps)
    summary, cost = summarize(rates), added_cost(rates[SUITE], rates[ADAPTER])
    results = {"versions": versions(), "results": summary, "adapter_cost": cost}
    print(json.dumps(results) if _JSON.value else report(summary, cost))
    return 0


def console_main() -> int:
    """Entry point of `kitchen-benchmark`."""
    return main(sys.argv)


if __name__ == "__main__":
    sys.exit(console_main())
