"""The job of `kitchen-benchmark`."""

import concurrent.futures
import dataclasses
import importlib.metadata
import json
import pkgutil
import platform
from typing import Any

from kitchen_suite import checks, suite
from kitchen_suite.benchmarks import baselines, memory, rendering, report, speed
from kitchen_suite.benchmarks.cases import BenchmarkDomain
from kitchen_suite.settings import BenchmarkSettings
from kitchen_suite.versions import installed_versions

_DEFAULT_NUM_ENVS = {"speed": (32,), "scaling": (1, 8, 32, 128, 512), "soak": (32,), "rendering": (1,)}
_DEFAULT_NUM_STEPS = {"speed": 0, "scaling": 10_000, "soak": 1_000_000, "rendering": 0}


class BenchmarkJob:
    """A measurement, printed as tables or as JSON."""

    failures: tuple[type[Exception], ...] = (OSError, concurrent.futures.BrokenExecutor)
    usage_errors: tuple[type[Exception], ...] = ()

    def __init__(self, settings: BenchmarkSettings) -> None:
        """Checks the settings.

        Raises:
          ValueError: the domain or the measure is unknown, a number is not positive, or the measure takes one number of
            environments and there are several.
        """
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
        print(json.dumps(results) if self._settings.json else report.plain(results))
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
    """Returns the benchmark cases of a domain.

    Raises:
      ValueError: there is no such domain, or none with benchmarks.
    """
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
