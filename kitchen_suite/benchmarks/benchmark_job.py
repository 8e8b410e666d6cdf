"""The work of `kitchen-benchmark`: measurements, and their tables in plain text and in Markdown."""

import concurrent.futures
import dataclasses
import importlib.metadata
import json
import pkgutil
import platform
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from kitchen_suite import checks, suite
from kitchen_suite.benchmarks import baselines, memory, rendering, speed
from kitchen_suite.benchmarks.cases import BenchmarkDomain
from kitchen_suite.rollouts.report import table
from kitchen_suite.settings import BenchmarkSettings
from kitchen_suite.versions import installed_versions

# Header and rows.
Table = tuple[Sequence[str], Sequence[Sequence[str]]]

_DEFAULT_NUM_ENVS = {"speed": (32,), "scaling": (1, 8, 32, 128, 512), "soak": (32,), "rendering": (1,)}
_DEFAULT_NUM_STEPS = {"speed": 0, "scaling": 10_000, "soak": 1_000_000, "rendering": 0}


class BenchmarkJob:
    """A measurement, printed as tables or as JSON."""

    failures: tuple[type[Exception], ...] = (OSError, concurrent.futures.BrokenExecutor)
    usage_errors: tuple[type[Exception], ...] = ()

    def __init__(self, settings: BenchmarkSettings) -> None:
        """Checks the settings."""
        measure = checks.choice(settings.measure, _DEFAULT_NUM_ENVS, "measure")
        self._settings = settings
        self._domain = find_cases(settings.domain_name)
        self._num_envs = settings.num_envs or _DEFAULT_NUM_ENVS[measure]
        self._num_steps = _DEFAULT_NUM_STEPS[measure] if settings.num_steps is None else settings.num_steps
        if measure != "scaling" and len(self._num_envs) != 1:
            raise ValueError(f"{measure} takes exactly one number of environments, got {self._num_envs}")
        if settings.num_steps is not None:
            checks.integer(settings.num_steps, "num_steps", minimum=1)

    def run(self) -> bool:
        """Measures and prints the results; returns True."""
        results = self.measure()
        print(json.dumps(results) if self._settings.json else plain(results))
        return True

    def progress(self) -> str:
        """Returns how far the job came: there are no results before its end."""
        return "before there were results"

    def measure(self) -> dict[str, Any]:
        """Measures; returns the results with the command and the versions, as JSON represents them."""
        measures = {
            "speed": self._speed,
            "scaling": self._scaling,
            "soak": self._soak,
            "rendering": self._rendering,
        }
        return {
            "measure": self._settings.measure,
            "command": command_line(self._settings),
            "versions": versions(),
            **measures[self._settings.measure](),
        }

    def _speed(self) -> dict[str, Any]:
        domain, settings, (num_envs,) = self._domain, self._settings, self._num_envs
        steps = settings.max_episode_steps or domain.max_episode_steps
        cases = domain.cases(num_envs)
        rates = speed.measure_rates(domain, cases, rounds=settings.rounds, steps=steps)
        return {
            "results": speed.summarize(rates, cases),
            "ratios": speed.named_ratios(rates, domain.ratios(num_envs)),
            "overhead": speed.overhead(*domain.environments(), repeats=settings.rounds),
        }

    def _scaling(self) -> dict[str, Any]:
        return {"results": memory.scaling(self._domain, self._num_envs, num_steps=self._num_steps)}

    def _soak(self) -> dict[str, Any]:
        (num_envs,) = self._num_envs
        return {"results": memory.soak(self._domain, num_envs=num_envs, num_steps=self._num_steps)}

    def _rendering(self) -> dict[str, Any]:
        return {"results": rendering.measure(self._domain, rounds=self._settings.rounds)}


def find_cases(domain_name: str) -> BenchmarkDomain:
    """Returns the benchmark cases of a domain."""
    benchmark = suite.find_domain(domain_name).benchmark
    if benchmark is None:
        names = [domain.name for domain in suite.DOMAINS.values() if domain.benchmark]
        raise ValueError(f"domain {domain_name!r} has no benchmark; choose from {names}")
    cases: BenchmarkDomain = pkgutil.resolve_name(benchmark)
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
    envpool = {"envpool": importlib.metadata.version("envpool")} if baselines.has_envpool() else {}
    return {"python": platform.python_version(), **installed_versions(), **envpool}


def speed_tables(results: Mapping[str, Any]) -> list[Table]:
    """Returns tables of the cases' ratios to bare MuJoCo, of the named ratios, and of the overhead beyond physics."""
    cases = [
        (name, *_statistics(row), f"{row['ratio_per_thread']:.2f}", f"{row['steps_per_second']:.0f}")
        for name, row in results["results"].items()
    ]
    ratios = [(name, *_statistics(row)) for name, row in results["ratios"].items()]
    overhead = [(name, f"{microseconds:.1f}") for name, microseconds in results["overhead"].items()]
    return [
        (("ratio to bare mj_step", "median", "min", "max", "per thread", "steps/s"), cases),
        (("other ratios", "median", "min", "max"), ratios),
        (("overhead beyond physics, without visuals", "us per control step"), overhead),
    ]


def _statistics(row: Mapping[str, float]) -> tuple[str, ...]:
    return tuple(f"{row[key]:.2f}" for key in ("ratio", "min", "max"))


def scaling_tables(results: Mapping[str, Any]) -> list[Table]:
    """Returns a table of throughput and memory by number of environments and threads."""
    rows = [
        (
            f"{row['vector_env']}, {row['num_envs']}",
            str(row["num_threads"]),
            f"{row['steps_per_second']:.0f}",
            "" if row["memory"] is None else f"{row['memory']:.2f}",
        )
        for row in results["results"]
    ]
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
    contents = [
        (content, *(_milliseconds(row["contents"][content]) for row in renderers.values()))
        for content in renderers[first]["contents"]
    ]
    return [
        (("frames", f"ratio to {first}", "frames/s", "faces of meshes"), frames),
        (("parts of a frame [ms]", *rows[0][1]["times"]), parts),
        ((f"saved where left out, {size} [ms]", *renderers), contents),
    ]


def _milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:.1f}"


# By measure.
TABLES: Mapping[str, Callable[[Mapping[str, Any]], list[Table]]] = {
    "speed": speed_tables,
    "scaling": scaling_tables,
    "soak": soak_tables,
    "rendering": rendering_tables,
}


def plain(results: Mapping[str, Any]) -> str:
    """Returns all tables for a terminal, with the command and the versions."""
    return _document(results, "simple")


def markdown(results: Mapping[str, Any]) -> str:
    """Returns all tables in markdown, with the command and the versions."""
    return f"{_document(results, 'pipe')}.\n"


def _document(results: Mapping[str, Any], style: str) -> str:
    tables = TABLES[results["measure"]](results)
    versions = ", ".join(f"{name} {version}" for name, version in results["versions"].items())
    return "\n\n".join([*(table(*each, style) for each in tables), f"`{results['command']}`: {versions}"])
