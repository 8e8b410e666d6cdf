"""The tables of the page on variations: `VARIATION_TABLES`."""

import collections
import functools
from collections.abc import Callable, Sequence

import numpy as np
from benchmark_results import read_results
from entity_tables import markdown
from numpy.typing import NDArray

from kitchen_suite import suite
from kitchen_suite.entities import appearance as surfaces
from kitchen_suite.entities.props import BURNERS
from kitchen_suite.tasks.episode import sensing_parameters
from kitchen_suite.tasks.kitchen.variations import DONE, done_parameter
from kitchen_suite.tasks.variations import appearance
from kitchen_suite.tasks.variations.distributions import GROUPS, Bands, Choice, Distribution

_SURFACES = {
    "kitchen": surfaces.KITCHEN,
    "open_cabinet": surfaces.OPEN_CABINET,
    "microwave_table": surfaces.MICROWAVE_TABLE,
}
# Parameters that exist only where observations have noise.
_NOISY = {"open_cabinet": {"observation_noise": {"handle_offset": 0.01}}}
_PALETTES = {name: each for name, each in vars(appearance).items() if isinstance(each, appearance.Palette)}


def parameter_table(domain: str) -> str:
    """Returns the table of the parameters that a domain's groups vary; equal ones share a row."""
    options = {"visuals": False, **_NOISY.get(domain, {})}
    task = suite.load(domain, suite.default_task(domain), options | {"variations": GROUPS}).task
    units = {each.name: each.unit for each in (*task.scene.parameters, *sensing_parameters(task.mdp.noise_parts))}
    if DONE in task.variations.wanted:
        units[DONE] = done_parameter(task.scene, dict).unit
    names = collections.defaultdict(list)
    for name, variation in task.variations.wanted.items():
        default = task.variations.randomizer.defaults[name]
        values = [_described(domain, name, default, each) for each in (variation.seen, variation.held_out)]
        row = (variation.group, units[name], _number_or_vector(default), *values)
        names[row].append(f"`{name}`")
    rows = [(", ".join(names[row]), *row) for row in names]
    return markdown(("parameter", "group", "unit", "default", "seen", "held out"), rows)


def _described(domain: str, name: str, default: NDArray[np.float64], distribution: Distribution) -> str:
    if isinstance(distribution, Bands):
        return _bands(distribution.intervals, default)
    assert isinstance(distribution, Choice)
    if name.endswith("color"):
        return _colors(distribution.values)
    labels = _labels(domain, name)
    numbers = (f"{value:g}" for value in distribution.values)
    return ", ".join(f"{number} {labels[int(number)]}" if labels else number for number in numbers)


def _labels(domain: str, name: str) -> Sequence[str]:
    """Returns meanings of the values of a parameter that is an index; none of other parameters."""
    textures = {f"{surface.prefix}texture": surface.textures for surface in _SURFACES[domain]}
    if name in textures:
        return ["as built", *(texture.name.replace("_", " ") for texture in textures[name])]
    return [burner.replace("_", " ") for burner in BURNERS] if name == "kettle/burner" else []


def _colors(values: NDArray[np.float64]) -> str:
    for name, palette in _PALETTES.items():
        for colors in (palette.seen, palette.held_out):
            shades = len(values) // len(colors)
            if len(values) == shades * len(colors) and np.allclose(values[shades - 1 :: shades], colors):
                return f"{len(colors)} of `{name}`"
    raise ValueError(f"no palette has the colours {values.tolist()}")


def _bands(bands: NDArray[np.float64], default: NDArray[np.float64]) -> str:
    """Returns the text of intervals `(k, 2)` or `(k, 2, n)`; of a vector, one text where all elements share it."""
    if not default.shape:
        return _intervals(bands, float(default))
    texts = [_intervals(bands[:, :, i], value) for i, value in enumerate(default)]
    return _vector(texts)


def _intervals(bands: NDArray[np.float64], default: float) -> str:
    """Returns the text of intervals `(k, 2)` of one number."""
    if (bands[:, 0] == bands[:, 1]).all():
        values, counts = np.unique(bands[:, 0], return_counts=True)
        shares = [f"{value:g} ({100 * count / len(bands):.0f} %)" for value, count in zip(values, counts, strict=True)]
        return " or ".join(shares) if len(shares) > 1 else f"{values[0]:g}"
    intervals = np.unique(bands, axis=0)
    offsets = intervals - default
    middle = "" if default == 0 else f"{default:.5g} "
    if np.allclose(offsets, -offsets[::-1, ::-1]):
        low, high = np.abs(offsets[-1])
        return f"{middle}± {high:.3g}" if len(intervals) == 1 else f"{middle}± ({low:.3g} to {high:.3g})"
    return " or ".join(f"{low:.5g} to {high:.5g}" for low, high in intervals)


def _number_or_vector(value: NDArray[np.float64]) -> str:
    return _vector([f"{each:.5g}" for each in value]) if value.shape else f"{value:.5g}"


def _vector(texts: Sequence[str]) -> str:
    return f"{len(texts)} times {texts[0]}" if len({*texts}) == 1 else f"({', '.join(texts)})"


def expert_table() -> str:
    """Returns the table of the experts' successes, from `docs/variation_results.py experts`."""
    rows = [
        (
            row["domain"],
            f"`{row['task']}`",
            _group_names(row["groups"]),
            row["split"].replace("_", " "),
            f"{row['success']} of {row['episodes']} ({100 * row['success'] / row['episodes']:.1f} %)",
            row["refused_layouts"],
        )
        for row in read_results("variations_experts")
    ]
    return markdown(("domain", "task", "groups", "split", "successes", "refusals"), rows)


def layout_table() -> str:
    """Returns the table of refused layouts, from `docs/variation_results.py layouts`."""
    rows = [
        (
            row["domain"],
            f"`{row['task']}`",
            row["split"].replace("_", " "),
            row["draws"],
            f"{row['refused']} ({100 * row['refused'] / row['draws']:.1f} %)",
        )
        for row in read_results("variations_layouts")
    ]
    return markdown(("domain", "task", "split", "episodes", "first layout refused"), rows)


def speed_table() -> str:
    """Returns the table of speeds relative to no variation, from `docs/variation_results.py speed`."""
    rows = [
        (
            row["domain"],
            _group_names(row["groups"]),
            f"{row['median']:.3f}",
            "{:.3f} to {:.3f}".format(*row["quartiles"]),
        )
        for row in read_results("variations_speed")
    ]
    return markdown(("domain", "groups", "speed", "quartiles"), rows)


def _group_names(groups: str | Sequence[str]) -> str:
    names = groups.split(",") if isinstance(groups, str) else groups
    if {*names} == {*GROUPS}:
        return "all"
    return ", ".join(f"`{name}`" for name in names) or "none"


VARIATION_TABLES: dict[str, Callable[[], str]] = {
    **{f"{domain}_variations": functools.partial(parameter_table, domain) for domain in suite.DOMAINS},
    "variations_experts": expert_table,
    "variations_layouts": layout_table,
    "variations_speed": speed_table,
}
