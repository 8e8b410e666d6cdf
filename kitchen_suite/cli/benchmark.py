"""`kitchen-benchmark`: how fast the suite steps and what memory it takes, against bare MuJoCo and its peers.

Machines are shared and noisy, so what counts are ratios: in every round each contender makes one episode with the same
actions, and its rate is divided by that of bare MuJoCo in the same round. The table gives the median over the rounds.
Nothing is rendered, and no GL library is loaded.
"""

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from absl import flags

from kitchen_suite.cli import common
from kitchen_suite.rendering import gl

# All else is imported late: dm_control must not be before `gl.prepare`.

_NAME = "kitchen-benchmark"

_FLAGS = flags.FlagValues()
_DOMAIN_NAME = flags.DEFINE_enum(
    "domain_name", "kitchen", ["kitchen", "open_cabinet"], "what to measure", flag_values=_FLAGS
)
_MEASURE = flags.DEFINE_enum(
    "measure",
    "speed",
    ["speed", "scaling", "soak"],
    "speed: ratios of control steps a second; scaling: the vectorised environments by number and threads, with memory; "
    "soak: memory in the course of a long run",
    flag_values=_FLAGS,
)
_ROUNDS = flags.DEFINE_integer("rounds", 9, "speed: rounds that count", lower_bound=1, flag_values=_FLAGS)
_STEPS = flags.DEFINE_integer(
    "steps", None, "speed: control steps of an episode; by default the domain's", lower_bound=1, flag_values=_FLAGS
)
_ENVIRONMENTS = flags.DEFINE_integer(
    "environments", 32, "speed, soak: how many are stepped together", lower_bound=1, flag_values=_FLAGS
)
_SIZES = flags.DEFINE_list(
    "sizes", ["1", "8", "32", "128", "512"], "scaling: how many are stepped together", flag_values=_FLAGS
)
_CONTROL_STEPS = flags.DEFINE_integer(
    "control_steps",
    None,
    "scaling, soak: control steps to make, all environments counted",
    lower_bound=1,
    flag_values=_FLAGS,
)
_HELP = flags.DEFINE_bool("help", False, "show this help, and exit", short_name="h", flag_values=_FLAGS)
_JSON = flags.DEFINE_bool("json", False, "print JSON in place of tables", flag_values=_FLAGS)


def _speed() -> dict[str, Any]:
    from kitchen_suite.benchmarks import speed as benchmark_measure
    from kitchen_suite.benchmarks.domains import DOMAINS

    domain, environments = DOMAINS[_DOMAIN_NAME.value], _ENVIRONMENTS.value
    contenders = domain.contenders(environments)
    rates = benchmark_measure.measure(domain, contenders, rounds=_ROUNDS.value, steps=_STEPS.value or domain.steps)
    return {
        "results": benchmark_measure.summarize(rates, contenders),
        "comparisons": benchmark_measure.compare(rates, domain.comparisons(environments)),
        "overhead": benchmark_measure.overhead(*domain.own()),
    }


def _scaling() -> dict[str, Any]:
    from kitchen_suite.benchmarks import memory as benchmark_memory

    sizes = [int(size) for size in _SIZES.value]
    return {
        "results": benchmark_memory.scaling(_DOMAIN_NAME.value, sizes, control_steps=_CONTROL_STEPS.value or 10_000)
    }


def _soak() -> dict[str, Any]:
    from kitchen_suite.benchmarks import memory as benchmark_memory

    control_steps = _CONTROL_STEPS.value or 1_000_000
    return {
        "results": benchmark_memory.soak(
            _DOMAIN_NAME.value, environments=_ENVIRONMENTS.value, control_steps=control_steps
        )
    }


_MEASUREMENTS: Mapping[str, Callable[[], dict[str, Any]]] = MappingProxyType(
    {"speed": _speed, "scaling": _scaling, "soak": _soak}
)


def main(argv: Sequence[str]) -> int:
    """Measures and prints; returns the exit code, 2 for bad flags."""
    try:
        common.parse(_FLAGS, _NAME, argv[1:])
        if odd := [size for size in _SIZES.value if not size.isdecimal() or not int(size)]:
            raise flags.IllegalFlagValueError(f"flag --sizes must list positive whole numbers, got {odd[0]!r}")
    except flags.Error as error:
        return common.fail(_NAME, error, common.USAGE)
    if _HELP.value:
        print(common.describe(_FLAGS, __doc__))
        return 0
    gl.prepare(rendering=False)
    from kitchen_suite.benchmarks import report as benchmark_report

    results = {
        "measure": _MEASURE.value,
        "command": " ".join([_NAME, *(flag for flag in argv[1:] if flag != "--json")]),
        "versions": benchmark_report.versions(),
        **_MEASUREMENTS[_MEASURE.value](),
    }
    print(json.dumps(results) if _JSON.value else benchmark_report.plain(results))
    return 0


def console_main() -> int:
    """Entry point of `kitchen-benchmark`."""
    return main(sys.argv)


if __name__ == "__main__":
    sys.exit(console_main())
