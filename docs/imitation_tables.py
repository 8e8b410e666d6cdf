"""The tables of the page on imitation: presets, hyperparameters, and the results in docs/benchmarks/imitation/."""

import json
from collections.abc import Callable
from types import MappingProxyType
from typing import Any, get_type_hints

from docstrings import attributes
from entity_tables import markdown
from evaluation_tables import with_interval
from imitation_results import CELLS, DIGESTS

from kitchen_suite import suite
from kitchen_suite.training.imitation.methods import FlowHyperparameters, ImitationHyperparameters, TokenHyperparameters

# Classes of hyperparameters by algorithm; the first has those that all have.
_CLASSES: dict[str, type[ImitationHyperparameters]] = {
    "bc": ImitationHyperparameters,
    "flow": FlowHyperparameters,
    "vqbet": TokenHyperparameters,
}


def preset_table() -> str:
    """Returns the table of the sets of demonstrations of all domains."""
    rows = [
        (f"`{name}`", domain.name, f"`{preset['task_name']}`", _arguments(preset), f"`{preset['policy']}`")
        for domain in suite.DOMAINS.values()
        for name, preset in (domain.resolve("recording") or {}).items()
    ]
    return markdown(("`--preset`", "domain", "task", "arguments", "policy"), rows)


def _arguments(preset: Any) -> str:
    return ", ".join(f"`{name}`: {value}" for name, value in preset.get("task_kwargs", {}).items())


def hyperparameter_table() -> str:
    """Returns the table of the hyperparameters with their defaults."""
    defaults = {name: each() for name, each in _CLASSES.items()}
    meanings = {name: text for each in _CLASSES.values() for name, text in attributes(each).items()}
    names = dict.fromkeys(name for each in _CLASSES.values() for name in get_type_hints(each))
    rows = [
        (f"`{name}`", meanings[name], *(f"{getattr(config, name, '')}" for config in defaults.values()))
        for name in names
    ]
    return markdown(("name", "meaning", *(f"`{name}`" for name in defaults)), rows)


def result_table() -> str:
    """Returns the table of the trained and evaluated cells."""
    rows = [
        (
            f"`{cell.preset}`",
            cell.count,
            f"`{cell.algorithm}`",
            cell.seed,
            *(f"{result[f'p{number}']:.2f}" for number in range(1, 5)),
            with_interval(result, "mean_tasks"),
            f"{result['order_entropy']:.2f}",
            f"{result['minutes']:.1f}",
        )
        for cell in CELLS
        if cell.result.exists()
        for result in [json.loads(cell.result.read_text(encoding="utf-8"))]
    ]
    rates = (f"p{number}" for number in range(1, 5))
    header = ("set", "demonstrations", "`--algorithm`", "seed", *rates, "mean tasks", "order entropy", "minutes")
    return markdown(header, rows)


def digest_table() -> str:
    """Returns the table of the digests of the sets of demonstrations, and what they depend on."""
    result = json.loads(DIGESTS.read_text(encoding="utf-8"))
    rows = [
        (f"`{row['preset']}`", f"`{row['variations']}`" if row["variations"] else "", row["episodes"], row["digest"])
        for row in result["sets"]
    ]
    table = markdown(("`--preset`", "`--variations`", "`--num_episodes`", "SHA-256"), rows)
    versions = ", ".join(f"{name} {version}" for name, version in result["versions"].items())
    return f"{table}\n\nWith {versions}, on {result['machine']}."


IMITATION_TABLES: MappingProxyType[str, Callable[[], str]] = MappingProxyType(
    {
        "presets": preset_table,
        "imitation_hyperparameters": hyperparameter_table,
        "imitation_results": result_table,
        "digests": digest_table,
    }
)
