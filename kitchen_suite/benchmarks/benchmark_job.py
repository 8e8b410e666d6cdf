"""The work of `kitchen-benchmark`: measurements, and their tables in plain text and in Markdown."""

import concurrent.futures
import dataclasses
import json
import platform
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

from kitchen_suite import checks, suite
from kitchen_suite.benchmarks import rendering
from kitchen_suite.benchmarks.cases import BenchmarkDomain
from kitchen_suite.benchmarks.measurements import measure_rates, named_ratios, overhead, scaling, soak, summarize
from kitchen_suite.episodes.report import table
from kitchen_suite.settings import FAILURE, BenchmarkSettings
from kitchen_suite.versions import installed_versions

# Header and rows.
Table = tuple[Sequence[str], Sequence[Sequence[str]]]


class BenchmarkJob:
    """A measurement, printed as tables or as JSON."""

    errors: ClassVar = {OSError: FAILURE, concurrent.futures.BrokenExecutor: FAILURE}

    def __init__(self, settings: BenchmarkSettings) -> None:
        self._settings = settings
        self._measure = MEASURES[checks.choice(settings.measure, MEASURES, "measure")]
        self._domain = find_cases(settings.domain_name)
        self._num_envs = settings.num_envs or self._measure.num_envs
        if settings.measure != "scaling" and len(self._num_envs) != 1:
            raise ValueError(f"{settings.measure} takes exactly one number of environments, got {self._num_envs}")
        self._num_steps = self._measure.num_steps
        if settings.num_steps is not None:
            self._num_steps = checks.integer(settings.num_steps, "num_steps", minimum=1)

    def run(self) -> bool:
        if not self._settings.json:
            # Not among the results.
            print(f"{command_line(self._settings)} takes minutes", file=sys.stderr, flush=True)
        results = self.measure()
        print(json.dumps(results) if self._settings.json else plain(results))
        return True

    def progress(self) -> str:
        return "before there were results"

    def measure(self) -> dict[str, Any]:
        """Measures; returns the results with the command and the versions, as JSON represents them."""
        return {
            "measure": self._settings.measure,
            "command": command_line(self._settings),
            "versions": versions(),
            **self._measure.run(self._domain, self._settings, self._num_envs, self._num_steps),
        }


def find_cases(domain_name: str) -> BenchmarkDomain:
    """Returns the benchmark cases of a domain."""
    cases: BenchmarkDomain | None = suite.find_domain(domain_name).resolve("benchmark")
    if cases is None:
        names = [domain.name for domain in suite.DOMAINS.values() if domain.benchmark]
        raise ValueError(f"domain {domain_name!r} has no benchmark; choose from {names}")
    return cases


def command_line(settings: BenchmarkSettings) -> str:
    """Returns the command of these settings, with the flags that differ from their defaults but for --json."""
    flags = []
    for field in dataclasses.fields(settings):
        value = getattr(settings, field.name)
        if field.name != "json" and value != field.default:
            text = ",".join(map(str, value)) if isinstance(value, tuple) else value
            flags.append(f"--{field.name}={text}")
    return " ".join(["kitchen-benchmark", *flags])


def versions() -> dict[str, str]:
    """Returns the versions that speed depends on: of Python, the suite, its packages, and EnvPool where installed."""
    envpool = checks.version_of("envpool")
    known = {"python": platform.python_version(), **installed_versions()}
    return {**known, "envpool": envpool} if envpool else known


@dataclasses.dataclass(frozen=True, kw_only=True)
class Measure:
    """One of the measurements of `kitchen-benchmark`: its results, as JSON represents them, and their tables.

    `num_envs` and `num_steps` are the numbers of environments and of control steps where the settings name none.
    """

    run: Callable[[BenchmarkDomain, BenchmarkSettings, Sequence[int], int], dict[str, Any]]
    tables: Callable[[Mapping[str, Any]], list[Table]]
    num_envs: tuple[int, ...]
    num_steps: int = 0


def _run_speed(domain: BenchmarkDomain, settings: BenchmarkSettings, num_envs: Sequence[int], _: int) -> dict[str, Any]:
    steps = settings.max_episode_steps or domain.domain.episode_steps
    cases = domain.cases(num_envs[0])
    rates = measure_rates(domain, cases, rounds=settings.rounds, steps=steps)
    return {
        "results": summarize(rates, cases),
        "ratios": named_ratios(rates, domain.ratios(num_envs[0])),
        "overhead": overhead(domain.load(visuals=False), domain.adapter(), repeats=settings.rounds),
    }


def speed_tables(results: Mapping[str, Any]) -> list[Table]:
    """Returns tables of the cases' ratios to bare MuJoCo, of the named ratios, and of the overhead beyond physics."""
    cases = []
    for name, row in results["results"].items():
        cases.append((name, *_statistics(row), f"{row['ratio_per_thread']:.2f}", f"{row['steps_per_second']:.0f}"))
    ratios = [(name, *_statistics(row)) for name, row in results["ratios"].items()]
    overhead = [(name, f"{microseconds:.1f}") for name, microseconds in results["overhead"].items()]
    return [
        (("ratio to bare mj_step", "median", "min", "max", "per thread", "steps/s"), cases),
        (("other ratios", "median", "min", "max"), ratios),
        (("overhead beyond physics, without visuals", "us per control step"), overhead),
    ]


def _statistics(row: Mapping[str, float]) -> list[str]:
    return [f"{row[key]:.2f}" for key in ("ratio", "min", "max")]


def scaling_tables(results: Mapping[str, Any]) -> list[Table]:
    """Returns a table of throughput and memory by number of environments and threads."""
    rows = []
    for row in results["results"]:
        memory = "" if row["memory"] is None else f"{row['memory']:.2f}"
        name = f"{row['vector_env']}, {row['num_envs']}"
        rows.append((name, str(row["num_threads"]), f"{row['steps_per_second']:.0f}", memory))
    return [(("environments", "threads", "steps/s", "MiB per environment"), rows)]


def soak_tables(results: Mapping[str, Any]) -> list[Table]:
    """Returns a table of memory in the course of a long run."""
    samples = zip(results["results"]["num_steps"], results["results"]["memory"], strict=True)
    return [(("control steps", "MiB"), [(f"{steps:.0f}", f"{memory:.1f}") for steps, memory in samples])]


def rendering_tables(results: Mapping[str, Any]) -> list[Table]:
    """Returns tables of frames per second, of the parts of a frame's time, and of what that time is spent on."""
    by_size = {f"{each['size']} x {each['size']}": each["renderers"] for each in results["results"]}
    rows = [(f"{name}, {size}", row) for size, renderers in by_size.items() for name, row in renderers.items()]
    size, renderers = next(iter(by_size.items()))
    first = next(iter(renderers))
    frames = [
        (name, f"{row['ratio']:.1f}", f"{1 / row['times']['frame']:.1f}", str(row["num_faces"])) for name, row in rows
    ]
    parts = [(name, *map(_milliseconds, row["times"].values())) for name, row in rows]
    contents = []
    for content in renderers[first]["contents"]:
        contents.append((content, *(_milliseconds(row["contents"][content]) for row in renderers.values())))
    return [
        (("frames", f"ratio to {first}", "frames/s", "faces of meshes"), frames),
        (("parts of a frame [ms]", *rows[0][1]["times"]), parts),
        ((f"saved where left out, {size} [ms]", *renderers), contents),
    ]


def _milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:.1f}"


MEASURES: Mapping[str, Measure] = {
    "speed": Measure(run=_run_speed, tables=speed_tables, num_envs=(32,)),
    "scaling": Measure(
        run=lambda domain, settings, *sizes: {"results": scaling(domain, *sizes)},
        tables=scaling_tables,
        num_envs=(1, 8, 32, 128, 512),
        num_steps=10_000,
    ),
    "soak": Measure(
        run=lambda domain, settings, num_envs, num_steps: {"results": soak(domain, num_envs[0], num_steps)},
        tables=soak_tables,
        num_envs=(32,),
        num_steps=1_000_000,
    ),
    "rendering": Measure(
        run=lambda domain, settings, *_: {"results": rendering.measure(domain.renderers, rounds=settings.rounds)},
        tables=rendering_tables,
        num_envs=(1,),
    ),
}


def plain(results: Mapping[str, Any]) -> str:
    """Returns all tables for a terminal, with the command and the versions."""
    return _document(results, "simple")


def markdown(results: Mapping[str, Any]) -> str:
    """Returns all tables in markdown, with the command and the versions."""
    return f"{_document(results, 'pipe')}.\n"


def _document(results: Mapping[str, Any], style: str) -> str:
    tables = MEASURES[results["measure"]].tables(results)
    versions = ", ".join(f"{name} {version}" for name, version in results["versions"].items())
    return "\n\n".join([*(table(*each, style) for each in tables), f"`{results['command']}`: {versions}"])
