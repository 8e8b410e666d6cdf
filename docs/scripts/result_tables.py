"""The tables of measurements, from the results in docs/experiments/results/: `RESULT_TABLES`."""

import collections
import functools
import itertools
import json
import statistics
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import benchmark_tables
import numpy as np
from scipy import stats
from tabulate import tabulate

from kitchen_suite.entities.kitchen_designs import SPLITS
from kitchen_suite.evaluation.compare import compare
from kitchen_suite.evaluation.evaluation import Evaluation
from kitchen_suite.evaluation.methods import compare_methods
from kitchen_suite.evaluation.protocols import PROTOCOLS, SHIFT_GROUPS
from kitchen_suite.evaluation.text import format_comparison, format_evaluation, format_methods, p_text
from kitchen_suite.tasks import DEFAULT_TASKS
from kitchen_suite.tasks.generated_kitchens import certificates
from kitchen_suite.tasks.pick_and_place import certificates as object_certificates
from kitchen_suite.tasks.pick_and_place.certificates import ObjectCertificate
from kitchen_suite.tasks.pick_and_place.requests import VERBS as OBJECT_VERBS

RESULTS = Path(__file__).resolve().parent.parent / "experiments" / "results"
BOARD = Path(__file__).resolve().parent.parent / "board"


# Certificates that the package has.
CERTIFICATES = Path(certificates.__file__).parent / "certificates"
OBJECT_CERTIFICATES = Path(object_certificates.__file__).parent / "certificates"


def read_results(name: str) -> Any:
    """Returns the results of a measurement, by the name of its file."""
    return json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"))


def markdown(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Returns a table in markdown."""
    return tabulate([[*map(str, row)] for row in rows], header, tablefmt="github", disable_numparse=True) + "\n"


def benchmark_table(name: str) -> str:
    """Returns the tables of a result of `benchmarks.py`, `rendering.py` or `scaling.py` in docs/experiments."""
    return benchmark_tables.markdown(read_results(name))


def tracking_table() -> str:
    """Returns the table of drift and lines, from the result of `docs/experiments/control_modes.py tracking`."""
    rows = [
        (
            row["domain"],
            f"`{row['control_mode']}`",
            f"{1e3 * row['drift']:.2f}",
            f"{row['turn']:.2f}",
            *(f"{1e3 * row[key]:.1f}" if key in row else "" for key in ("lateral", "shortfall")),
            f"{row['rotation']:.2f}" if "rotation" in row else "",
        )
        for row in read_results("control_modes_tracking")
    ]
    header = ("domain", "mode", "drift [mm]", "drift [°]", "off the line [mm]", "short of its end [mm]", "rotation [°]")
    return markdown(header, rows)


def borders_table() -> str:
    """Returns the table of speeds at borders, from the result of `docs/experiments/control_modes.py borders`."""
    rows = [
        (
            row["domain"],
            f"`{row['control_mode']}`",
            "yes" if row["limited"] else "",
            f"{row['ratio']:.2f} ({row['free_ratio']:.2f})",
            f"{row['joint_speed']:.2f} ({row['free_joint_speed']:.2f})",
            f"{row['fast']:,} of {row['steps']:,}",
        )
        for row in read_results("control_modes_borders")
    ]
    header = ("domain", "mode", "limits", "hand (free)", "joint (free) [rad/s]", "steps beyond 1.5 or 3 rad/s")
    return markdown(header, rows)


def objects_random_table() -> str:
    """Returns the table of what `docs/experiments/objects.py random` has measured."""
    rows = [
        (
            f"`{row['physics']}`",
            f"{row['hours']:.0f}",
            *(f"{row[name]:.1f}" for name in ("furniture_mm", "floor_mm", "resting_mm")),
            row["deep_steps"],
            row["diverged"],
            row["lost"],
        )
        for row in read_results("objects_random")
    ]
    header = (
        "physics",
        "hours",
        "in furniture [mm]",
        "in the floor [mm]",
        "at rest [mm]",
        "control steps beyond 5 mm in furniture",
        "diverged episodes",
        "objects below the floor at the end",
    )
    return markdown(header, rows)


def control_speed_table() -> str:
    """Returns the table of speeds, from the result of `docs/experiments/control_modes.py speed`."""
    rows = [
        (f"`{row['control_mode']}`", f"{row['median']:.2f}", "{:.2f} to {:.2f}".format(*row["quartiles"]))
        for row in read_results("control_modes_speed")
    ]
    return markdown(("mode", "speed relative to `joint_velocity`", "quartiles"), rows)


def reward_table() -> str:
    """Returns the table of what `docs/experiments/kitchen_rewards.py` has measured."""
    header = (
        "task",
        "`original`: successes (steps)",
        "`strict`: successes (steps)",
        "greatest fall",
        "greatest potential before completion",
        "`dense`: expert, standing still",
        "`dense_gain`: expert, standing still",
    )
    return markdown(header, map(_reward_row, read_results("kitchen_rewards")))


def _reward_row(result: dict[str, Any]) -> tuple[str, ...]:
    successes = (
        f"{result[f'{name}_success']} of {result['episodes']} ({result[f'{name}_steps']:.0f})"
        for name in ("original", "strict")
    )
    return (
        f"`{result['task']}`",
        *successes,
        f"{result['greatest_fall']:.3f}",
        f"{result['greatest_potential']:.2f}",
        f"{result['dense_return']:.0f}, {result['dense_waiting']:.1f}",
        f"{result['gain_return']:.3f}, {result['gain_waiting']:.3f}",
    )


_ONE = "random_1"

# Failed tasks of a setting that are named one by one; difference of medians that counts as none [control steps].
_NAMED, _SAME_STEPS = 3, 3


def _measures(row: dict[str, Any]) -> Iterable[str]:
    """Returns the cells of a run's seed, control steps and times."""
    return (str(row["seed"]), f"{row['steps']:,}", f"{row['minutes']:.1f}", f"{row['processor_minutes']:.1f}")


def training_table() -> str:
    """Returns the table of the runs of single tasks."""
    rows = [
        (f"`{row['task']}`", *_measures(row), f"{row['success'][0]} of {row['episodes']}")
        for row in read_results("training")
        if row["task"] != _ONE
    ]
    return markdown(("task", "seed", "control steps", "minutes", "processor minutes", "successes"), rows)


def drawer_table() -> str:
    """Returns the table of how long policies that open the drawer are trained, here and elsewhere."""
    runs = [row for row in read_results("training") if row["task"] == "top_drawer"]
    seconds = [60.0 * row["minutes"] for row in runs]
    successes = [row["success"][0] for row in runs]
    (episodes,) = {row["episodes"] for row in runs}
    (processors,) = {row["processors"] for row in runs}
    rows = [
        (
            f"`kitchen-train --domain_name=open_cabinet --output=runs`, {len(runs)} seeds",
            f"{processors} processors",
            f"{min(seconds):.0f} to {max(seconds):.0f}",
            f"{min(successes) / episodes:.0%} to {max(successes) / episodes:.0%}",
        )
    ]
    for row in read_results("drawer_elsewhere"):
        where = f"a GPU, {row['environments']} environments"
        rows.append((f"[{row['training']}]({row['source']})", where, f"{row['seconds']:.0f}", f"{row['success']:.0%}"))
    return markdown(("training", "on", "seconds", "success"), rows)


def network_table() -> str:
    """Returns the table of the runs of one network for the seven tasks; a row for each run, a column for each task."""
    rows = [(*_measures(row), *row["success"]) for row in read_results("training") if row["task"] == _ONE]
    return markdown(("seed", "control steps", "minutes", "processor minutes", *DEFAULT_TASKS), rows)


def learning_curve_table(recipe: str) -> str:
    """Returns the table of a recipe's seeds: when half of the episodes succeed, and how many at the end."""
    rows = []
    for row in (each for each in read_results("learning_curves") if each["recipe"] == recipe):
        first = next((i for i, success in enumerate(row["success"]) if success >= 0.5), None)
        half = ("never", "") if first is None else (f"{row['control_steps'][first]:,}", f"{row['minutes'][first]:.1f}")
        end = (f"{row['control_steps'][-1]:,}", f"{row['minutes'][-1]:.1f}", f"{row['success'][-1]:.0%}")
        rows.append((row["seed"], *half, *end))
    header = ("seed", "half succeed after", "minutes", "control steps", "minutes", "success at the end")
    return markdown(header, rows)


def varied_expert_table() -> str:
    """Returns the table of the experts' successes, from `docs/experiments/variations.py experts`."""
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
    """Returns the table of refused layouts, from `docs/experiments/variations.py layouts`."""
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


def variation_speed_table() -> str:
    """Returns the table of speeds relative to no variation, from `docs/experiments/variations.py speed`."""
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
    if {*names} >= {*SHIFT_GROUPS}:
        return "all"
    return ", ".join(f"`{name}`" for name in names) or "none"


_MOST = 7


def results() -> Iterator[Mapping[str, Any]]:
    """Yields the committed results, in the order of the protocols and of the files' names.

    These are POLICY_PROTOCOL.json or POLICY_TASK_PROTOCOL.json; each result has the policy's name in its file's.
    """
    for name in PROTOCOLS:
        for path in sorted(RESULTS.glob(f"evaluation/*_{name}.json")):
            result = json.loads(path.read_text(encoding="utf-8"))
            yield {**result, "policy": path.stem.partition("_")[0]}


# The protocol with tables of its own, since it has many conditions.
_APART = "shift"


def goals_table() -> str:
    """Returns the table of the protocols with scores over all conditions."""
    rows = [
        (
            f"`{result['protocol']}`",
            result["policy"],
            result["num_episodes"] * len(result["conditions"]),
            _overall(result),
        )
        for result in results()
        if "overall" in result
    ]
    return markdown(("protocol", "policy", "episodes", "score"), rows)


def _overall(result: Mapping[str, Any]) -> str:
    """Returns the scores of a result over all conditions."""
    return "; ".join(f"{name.replace('_', ' ')} {value:.3g}" for name, value in result["overall"].items())


def evaluation_table() -> str:
    """Returns the table of the results of the protocols without tables of their own; a row for each condition."""
    rows = [
        (
            f"`{result['protocol']}`",
            f"`{name}`",
            result["policy"],
            result["num_episodes"],
            *(rate(condition, f"p{number}") for number in range(1, _MOST + 1)),
            with_interval(condition, "mean_tasks"),
            with_interval(condition, "success"),
            _score(result, condition),
            f"{condition['order_entropy']:.2f}",
            f"{condition['control_steps']:.0f}",
        )
        for result in results()
        if result["protocol"] != _APART
        for name, condition in result["conditions"].items()
    ]
    rates = (f"p{number}" for number in range(1, _MOST + 1))
    means = ("mean tasks", "success", "score", "order entropy", "steps")
    header = ("protocol", "condition", "policy", "episodes", *rates, *means)
    return markdown(header, rows)


def summary_table() -> str:
    """Returns the table of the main scores of the protocols without tables of their own; a row for each condition."""
    rows = [
        (
            f"`{result['protocol']}`",
            f"`{name}`",
            result["policy"],
            result["num_episodes"],
            rate(condition, "p4"),
            with_interval(condition, "mean_tasks"),
            rate(condition, "success"),
            _score(result, condition),
        )
        for result in results()
        if result["protocol"] != _APART and result["policy"] != "random"
        for name, condition in result["conditions"].items()
    ]
    header = ("protocol", "condition", "policy", "episodes", "p4", "mean tasks", "success", "score")
    return markdown(header, rows)


def shift_summary_table() -> str:
    """Returns the table of p4 of each policy in each condition of `shift`."""
    return _shift_table(rate)


def shift_table() -> str:
    """Returns the table of p4 with its interval, of each policy in each condition of `shift`."""
    return _shift_table(with_interval)


def _shift_table(cell: Callable[[Mapping[str, Any], str], str]) -> str:
    found = {result["policy"]: result["conditions"] for result in results() if result["protocol"] == "shift"}
    rows = [
        (f"`{condition.name}`", *(cell(each[condition.name], "p4") for each in found.values()))
        for condition in PROTOCOLS["shift"].conditions
    ]
    return markdown(("condition", *found), rows)


def shift_cost_table() -> str:
    """Returns the table of what each condition of `shift` costs, from the result of `docs/experiments/shift.py`."""
    found = read_results("shift_costs")
    rows = []
    for condition in next(iter(found.values()))["success"]:
        cells = []
        for result in found.values():
            score = result["success"][condition]
            low, high = (f"{100 * bound:+.1f}" for bound in score["interval"])
            cells += [f"{100 * score['difference']:+.0f} ({low} to {high})", p_text(score["p_value_holm"])]
        rows.append((f"`{condition}`", *cells))
    header = [cell for policy in found for cell in (f"{policy} [points]", "p (Holm)")]
    return markdown(("condition", *header), rows)


def task_rate_table() -> str:
    """Returns the table of the rates of single tasks, in the first condition of each result."""
    found = [*results()]
    tasks = sorted({task for result in found for task in result["task_rates"]})
    rows = [
        (f"`{result['protocol']}`", result["policy"], *(_task_rate(result["task_rates"].get(task)) for task in tasks))
        for result in found
    ]
    return markdown(("protocol", "policy", *tasks), rows)


def rate(condition: Mapping[str, Any], name: str) -> str:
    """Returns a number of a result; nothing if it has none of that name."""
    return f"{condition[name]:.3g}" if name in condition else ""


def with_interval(condition: Mapping[str, Any], name: str) -> str:
    """Returns a mean of a result with its interval."""
    interval = condition["intervals"][name]
    if interval is None:
        return f"{condition[name]:.3g}"
    low, high = interval
    return f"{condition[name]:.3g} ({low:.2f} to {high:.2f})"


def _score(result: Mapping[str, Any], condition: Mapping[str, Any]) -> str:
    score = PROTOCOLS[result["protocol"]].score
    return f"{condition[score.name]:.3g}" if score and score.name in condition else ""


def _task_rate(row: Mapping[str, Any] | None) -> str:
    return f"{row['completed']} of {row['asked']}" if row else ""


def imitation_table() -> str:
    """Returns the table of the trained and evaluated policies of docs/experiments/imitation.py."""
    found = [
        # The seed in the file is the evaluation's; the name has that of the training.
        {**json.loads(path.read_text(encoding="utf-8")), "seed": int(path.stem.rpartition("_")[2])}
        for path in RESULTS.glob("imitation/*.json")
    ]
    presets = ("fixed_order", "random_order", "goal_conditioned")
    algorithms = ("bc", "flow")
    found.sort(
        key=lambda each: (
            each["seed"],
            presets.index(each["preset"]),
            each["count"],
            algorithms.index(each["algorithm"]),
        )
    )
    rows = [
        (
            f"`{result['preset']}`",
            result["count"],
            f"`{result['algorithm']}`",
            result["seed"],
            *(f"{result[f'p{number}']:.2f}" for number in range(1, 5)),
            with_interval(result, "mean_tasks"),
            f"{result['order_entropy']:.2f}",
            f"{result['minutes']:.1f}",
        )
        for result in found
    ]
    rates = (f"p{number}" for number in range(1, 5))
    header = ("set", "demonstrations", "algorithm", "seed", *rates, "mean tasks", "order entropy", "minutes")
    return markdown(header, rows)


def offline_set_table() -> str:
    """Returns the table of what the sets for offline learning hold, from `docs/experiments/offline.py sets`."""
    rows = [
        (
            f"`{row['preset']}`" + (f", `{row['variations']}`" if row["variations"] else ""),
            f"`{row['task']}`",
            f"{row['episodes']:,}",
            f"{row['steps']:,}",
            f"{row['successes'] / row['episodes']:.0%}",
            f"{sum(int(count) * times for count, times in row['tasks_completed'].items()) / row['episodes']:.2f}",
            f"{row['minutes']:.1f}",
            f"{row['megabytes']:.0f}",
        )
        for row in read_results("datasets")["sets"]
    ]
    header = ("`--preset`", "rewards of", "episodes", "control steps", "success", "mean tasks", "minutes", "MB")
    return markdown(header, rows)


def offline_digest_table() -> str:
    """Returns the table of the digests of the sets for offline learning, and what they depend on."""
    result = read_results("datasets")
    rows = [
        (f"`{row['preset']}`", f"`{row['variations']}`" if row["variations"] else "", row["digest"])
        for row in result["sets"]
    ]
    versions = ", ".join(f"{name} {version}" for name, version in result["versions"].items())
    return f"{markdown(('`--preset`', '`--variations`', 'SHA-256'), rows)}\n\nWith {versions}, on {result['machine']}."


def offline_table() -> str:
    """Returns the table of the baselines of docs/experiments/offline.py: means over seeds, with intervals."""
    found = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(RESULTS.glob("offline/*.json"))]
    cells: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for result in found:
        (condition,) = result["conditions"].values()
        cells.setdefault((result["preset"], result["algorithm"]), []).append({**result, **condition})
    presets = ("complete", "partial", "mixed")
    rows = [
        (
            f"`{preset}`",
            f"`{algorithm}`",
            ", ".join(f"{_offline_score(each):.0f}" for each in results),
            _over_seeds([_offline_score(each) for each in results]),
            *(f"{statistics.fmean(each['success'] for each in results):.2f}",),
            f"{statistics.fmean(each['minutes'] for each in results):.1f}",
        )
        # For each set, `iql` before `idql`.
        for (preset, algorithm), results in sorted(
            cells.items(), key=lambda item: (presets.index(item[0][0]), len(item[0][1]))
        )
    ]
    return markdown(("set", "algorithm", "score of each seed", "mean", "success", "minutes"), rows)


def _offline_score(condition: Mapping[str, Any]) -> float:
    """Returns D4RL's score: the share of the tasks asked for that are completed, times 100."""
    return 100.0 * float(condition["mean_tasks"]) / 4


def _over_seeds(scores: Sequence[float]) -> str:
    """Returns the mean of the scores of seeds with its interval of 95 %, by Student's distribution."""
    mean = statistics.fmean(scores)
    if len(scores) < 2:
        return f"{mean:.0f}"
    half = stats.t.ppf(0.975, len(scores) - 1) * statistics.stdev(scores) / len(scores) ** 0.5
    return f"{mean:.0f} ({mean - half:.0f} to {mean + half:.0f})"


def offline_online_table() -> str:
    """Returns the table of clones and of what PPO makes of them, from `docs/experiments/offline.py online`."""
    rows = [
        (
            row["seed"],
            *(with_interval(row[stage], "success") for stage in ("clone", "online")),
            *(f"{row[stage]['mean_tasks']:.2f}" for stage in ("clone", "online")),
            f"{row['online']['steps']:,}",
            f"{row['online']['minutes']:.1f}",
        )
        for row in read_results("offline_online")
    ]
    header = (
        "seed",
        "success of the clone",
        "after PPO",
        "mean tasks of the clone",
        "after PPO",
        "control steps",
        "minutes",
    )
    return markdown(header, rows)


def kitchen_policy_table() -> str:
    """Returns the table of the whole kitchen's policies, from the result of `docs/experiments/kitchen_policy.py`."""
    rows = [
        (
            f"`{policy}`",
            condition,
            result["num_episodes"],
            result["max_episode_steps"],
            with_interval(result, "success"),
            with_interval(result, "mean_tasks"),
            f"{result['control_steps']:.0f}",
        )
        for policy, measured in read_results("kitchen_policy").items()
        for condition, result in measured["conditions"].items()
    ]
    return markdown(("policy", "condition", "episodes", "at most steps", "success", "mean tasks", "steps"), rows)


def digest_table() -> str:
    """Returns the table of the digests of the sets of demonstrations, and what they depend on."""
    result = read_results("demonstrations")
    rows = [
        (f"`{row['preset']}`", f"`{row['variations']}`" if row["variations"] else "", row["episodes"], row["digest"])
        for row in result["sets"]
    ]
    table = markdown(("`--preset`", "`--variations`", "`--num_episodes`", "SHA-256"), rows)
    versions = ", ".join(f"{name} {version}" for name, version in result["versions"].items())
    return f"{table}\n\nWith {versions}, on {result['machine']}."


def fast_settings_table() -> str:
    """Returns the table of what options of the fast physics buy and cost."""
    rows = []
    for row in read_results("fast_settings"):
        failed = row["failed"]
        text = ", ".join(failed) if len(failed) <= _NAMED else f"{len(failed)}, such as {', '.join(failed[:2])}"
        rows.append((row["settings"], f"{1000 * row['timestep']:.1f}", f"{row['ratio']:.1f}", text or "none"))
    return markdown(("settings", "physics step [ms]", "speed / `exact`", "tasks that the expert fails"), rows)


def fast_experts_table() -> str:
    """Returns the tables of the experts in both physics: the default control mode by task, and sums over all modes."""
    rows = read_results("fast_experts")
    default = [row for row in rows if row["mode"] == "joint_velocity"]
    by_task = [
        (f"`{row['task']}`", *(_successes(row, physics) for physics in ("exact", "fast")))
        for row in default
        if row["domain"] == "kitchen"
    ]
    by_mode = []
    for (domain, mode), group in itertools.groupby(rows, key=lambda row: (row["domain"], row["mode"])):
        played = [*group]
        sums = (f"{sum(row[physics]['success'] for row in played):,}" for physics in ("exact", "fast"))
        moved = [f"{row['task']} {_later(row):+.0f}" for row in played if abs(_later(row)) > _SAME_STEPS]
        total = f"{sum(row['episodes'] for row in played):,}"
        by_mode.append((f"`{domain}`", f"`{mode}`", total, *sums, ", ".join(moved) or "none"))
    header = ("domain", "mode", "episodes", "`exact`", "`fast`", "tasks with a median of more than 3 steps apart")
    return "\n".join(
        [
            markdown(("task", "`exact`: successes (steps)", "`fast`: successes (steps)"), by_task),
            markdown(header, by_mode),
        ]
    )


def _successes(row: dict[str, Any], physics: str) -> str:
    found = row[physics]
    return f"{found['success']} of {row['episodes']}" + (f" ({found['steps']:.0f})" if found["success"] else "")


def _later(row: dict[str, Any]) -> float:
    """Returns by how many control steps the median episode is longer in the fast physics; 0 where one has none."""
    exact, fast = (row[physics]["steps"] for physics in ("exact", "fast"))
    return 0.0 if exact is None or fast is None else fast - exact


def fast_policies_table() -> str:
    """Returns the table of the shipped policies in both physics."""
    rows = read_results("fast_policies")
    return markdown(
        ("policy", "episodes", "`exact`", "`fast`"),
        [(f"`{row['policy']}`", row["episodes"], row["exact"], row["fast"]) for row in rows],
    )


def fast_parting_table() -> str:
    """Returns the table of how far trajectories of the same actions part."""
    rows = read_results("fast_parting")
    steps = [key for key in rows[0] if key != "task"]
    cells = [
        (f"`{row['task']}`", *(f"{row[s][0]:.4f}, {row[s][1]:.4f}, {row[s][2]:.0f}" if s in row else "" for s in steps))
        for row in rows
    ]
    return markdown(("task", *(f"step {step}" for step in steps)), cells)


def fast_random_table() -> str:
    """Returns the table of a million control steps with random actions."""
    rows = [
        (
            f"`{row['domain']}`",
            f"`{row['physics']}`",
            f"{row['steps']:,}",
            row["not_finite"],
            ", ".join(row["warnings"]) or "none",
            f"{row['hinge']:.4f}",
            f"{1000 * row['slide']:.2f}",
        )
        for row in read_results("fast_random")
    ]
    header = (
        "domain",
        "physics",
        "control steps",
        "not finite",
        "warnings",
        "hinges beyond their range [rad]",
        "slides [mm]",
    )
    return markdown(header, rows)


def certificate_table() -> str:
    """Returns the table of certified tasks by split and verb, from the certificates that the package has."""
    rows = []
    for split in SPLITS:
        found = certificates.read(CERTIFICATES / f"{split}.jsonl").values()
        tasks = [(name.partition(" ")[0], steps is not None) for each in found for name, steps in each.steps.items()]
        verbs = dict.fromkeys(verb for verb, _ in tasks)
        shares = [statistics.mean(done for name, done in tasks if name == verb) for verb in verbs]
        reached = [reaches for each in found for reaches in each.reached.values()]
        everything = statistics.mean(done for _, done in tasks)
        depth = max(each.depth_mm for each in found)
        values = (f"{len(found)}", f"{len(tasks)}", f"{everything:.1%}", *(f"{share:.1%}" for share in shares))
        rows.append((f"`{split}`", *values, f"{statistics.mean(reached):.1%}", f"{depth:.1f}"))
    verbs_in_code = (f"`{verb}`" for verb in verbs)
    header = ("split", "kitchens", "pairs", "certified", *verbs_in_code, "handles in reach", "greatest depth [mm]")
    return markdown(header, rows)


def object_certificate_table() -> str:
    """Returns the table of kitchens with a certified task with objects, from the certificates that the package has."""
    rows = []
    for path in sorted(OBJECT_CERTIFICATES.glob("*.jsonl")):
        found = certificates.read(path, ObjectCertificate).values()
        for verb in OBJECT_VERBS:
            tried = [
                [steps for name, steps in each.steps.items() if name.startswith(f"{verb} ")]
                for each in found
                if any(name.startswith(f"{verb} ") for name in each.steps)
            ]
            kitchens = sum(any(steps is not None for steps in each) for each in tried)
            tasks = [steps is not None for each in tried for steps in each]
            cells = (f"{len(tried)}", f"{kitchens}", f"{len(tasks)}", f"{sum(tasks)}")
            rows.append((f"`{path.stem}`", f"`{verb}`", *cells))
    return markdown(
        ("split", "verb", "kitchens with such tasks", "with a certified one", "tasks tried", "certified"), rows
    )


def objects_expert_table() -> str:
    """Returns the table of the expert's success with objects, from `docs/experiments/objects.py expert`."""
    rows = [
        (
            f"`{row['split']}`",
            "certified" if row["certified"] else "any",
            f"`{row['verb']}`",
            row["episodes"],
            f"{row['completed'] / row['episodes']:.0%}",
            *(row[cause] for cause in ("no_way", "not_moved", "elsewhere", "on_floor")),
            row["dropped"],
        )
        for row in read_results("objects_expert")
    ]
    causes = ("no way found", "not moved", "elsewhere", "on the floor")
    header = ("split", "requests", "verb", "episodes", "completed", *causes, "any object dropped")
    return markdown(header, rows)


def objects_policies_table() -> str:
    """Returns the table of the protocol unseen-pick-and-place by what was asked for, from receipts of the board."""
    rows = []
    for policy, folder in {"expert": "expert", "trained": "objects_clone"}.items():
        evaluation = Evaluation.read(BOARD / folder / "unseen-pick-and-place.npz")
        results = [result for of_kitchen in evaluation.results.values() for result in of_kitchen]
        successes = collections.defaultdict(list)
        for result in results:
            (name,) = result.asked
            successes[name.split(" ")[0]].append(result.success)
        forces = [result.measures["peak_carried_contact_force"] for result in results]
        rows.append(
            (
                policy,
                *(f"{sum(successes[verb])} of {len(successes[verb])}" for verb in OBJECT_VERBS),
                f"{sum(result.measures['objects_dropped'] for result in results):.0f}",
                *(f"{share:.0f} N" for share in np.quantile(forces, [0.5, 0.9])),
            )
        )
    collisions = ("hardest collision: median", "nine of ten below")
    header = ("policy", *(f"`{verb}`" for verb in OBJECT_VERBS), "objects dropped", *collisions)
    return markdown(header, rows)


def kitchens_expert_table() -> str:
    """Returns the table of the expert's success with fresh noise, from `docs/experiments/kitchens.py expert`."""
    (result,) = read_results("kitchens_expert")
    by_task = {name: row for name, row in result.items() if isinstance(row, dict)}
    pairs = sum(row["pairs"] for row in by_task.values())
    low, high = result["interval"]
    rows = [(f"`{name}`", row["pairs"], f"{row['success']:.1%}") for name, row in by_task.items()]
    return markdown(
        ("task", "certified pairs", "success"),
        [*rows, ("all", pairs, f"{result['success']:.1%} ({low:.1%} to {high:.1%})")],
    )


def kitchens_mode_table() -> str:
    """Returns the table of the expert's successes by control mode, from `docs/experiments/kitchens.py modes`."""
    rows = read_results("kitchens_modes")
    verbs = sorted({name for row in rows for name, cell in row.items() if isinstance(cell, list)})
    cells = [
        (
            f"`{row['mode']}`",
            f"{row['successes']} of {row['episodes']}",
            *("{} of {}".format(*row[verb]) for verb in verbs),
        )
        for row in rows
    ]
    return markdown(("control mode", "all", *(f"`{verb}`" for verb in verbs)), cells)


def kitchens_design_table() -> str:
    """Returns the table of how different the designs are, from `docs/experiments/kitchens.py designs`."""
    rows = [
        (
            f"`{row['split']}`",
            *(row["designs"], row["sequences"], f"{row['least_common_kind']:.0%}", row["cells"]),
            f"{row['seconds_median']:.2f} (at most {row['seconds_greatest']:.2f})",
            f"{row['nearest_train_median_m']:.3f} (least {row['nearest_train_least_m']:.3f})"
            if "nearest_train_median_m" in row
            else "",
        )
        for row in read_results("kitchens_designs")
    ]
    header = ("designs", "distinct sequences", "kitchens with the rarest kind", "10 cm cells with a handle")
    return markdown(("split", *header, "built in, processor time [s]", "from the nearest of `train` [m]"), rows)


def kitchens_speed_table() -> str:
    """Returns the table of speeds of vectors of several designs, from `docs/experiments/kitchens.py speed`."""
    rows = [(row["threads"], row["clock_ratio"], row["processors_ratio"]) for row in read_results("kitchens_speed")]
    return markdown(("threads", "speed of 16 designs, relative to one", "by processor time"), rows)


def evaluation_example() -> str:
    """Returns the output of kitchen-evaluate of the pretrained policy, from its JSON with `--episodes`."""
    evaluation = Evaluation.read(RESULTS / "comparison" / "trained_seen.json")
    return f"```\n{format_evaluation(evaluation)}\n```\n"


def comparison_example() -> str:
    """Returns the output of kitchen-compare for two files of `kitchen-evaluate --episodes --json`."""
    comparison = compare(*(RESULTS / "comparison" / f"{policy}.json" for policy in ("expert", "trained")))
    return f"```\n{format_comparison(comparison)}\n```\n"


def comparison_across() -> str:
    """Returns the first lines of the output of kitchen-compare across the starts of one policy."""
    files = (RESULTS / "comparison" / f"{name}.json" for name in ("trained_seen", "trained"))
    text = format_comparison(compare(*files, across=("variation_split",)))
    # Without the table by task.
    shown, _, _ = text.rpartition("\n\n")
    return f"```\n{shown}\n```\n"


def comparison_seeds() -> str:
    """Returns the output of kitchen-compare for two methods, by evaluations with `--episodes --json`."""
    a, b = ([RESULTS / "comparison" / f"{name}_{seed}.json" for seed in range(1, 6)] for name in ("gain", "dense"))
    return f"```\n{format_methods(compare_methods(a, b))}\n```\n"


def comparison_methods() -> str:
    """Returns the table of simulated comparisons of methods, from `docs/experiments/comparisons.py methods`."""
    rows = [
        (
            row["case"],
            row["seeds"],
            f"{100 * row['seed_deviation']:.0f} %",
            f"{row['coverage']:.1%}",
            f"{100 * row['width']:.0f} %",
            f"{row['coverage_resampled']:.1%}",
        )
        for row in read_results("comparison_methods")
    ]
    header = (
        "policies",
        "training seeds",
        "deviation of their rates",
        "intervals that contain the truth",
        "mean width",
    )
    return markdown((*header, "by resampling both levels"), rows)


def comparison_kitchens() -> str:
    """Returns the table of equal policies in kitchens, from `docs/experiments/comparisons.py kitchens`."""
    rows = [
        (row["correlation"], f"{row['alarms']:.1%}", f"{row['alarms_episodes']:.1%}")
        for row in read_results("comparison_kitchens")
    ]
    return markdown(("correlation within a kitchen", "false alarms by kitchens", "by episodes"), rows)


def quality_table(starts: str) -> str:
    """Returns the table of the quality of episodes with `varied` or with `usual` starts."""
    rows = []
    for row in read_results("quality_scores"):
        if row["starts"] != starts:
            continue
        intervals = row["intervals"]
        rates = (_rate(row[name], intervals[name]) for name in ("success", "clean_success"))
        others = (f"{row[name]:.2f}" for name in ("objects_disturbed", "stray_contacts"))
        forces = (f"{row[name]:.0f}" for name in ("peak_arm_contact_force", "peak_contact_force", "energy"))
        path = (f"{row['path_length']:.2f}", f"{row['log_dimensionless_jerk']:.1f}", f"{row['control_steps']:.0f}")
        where = (row["task"],) if starts == "usual" else (row["domain"], f"`{row['task']}`")
        rows.append((*where, row["policy"], *rates, *others, *forces, *path))
    header = (
        *(("task",) if starts == "usual" else ("domain", "task")),
        *("policy", "success", "clean success", "objects disturbed", "stray contacts", "peak on the arm [N]"),
        *("peak on the hand [N]", "energy [J]", "path [m]", "smoothness", "control steps"),
    )
    return markdown(header, rows)


def _rate(value: float, interval: Sequence[float]) -> str:
    """Returns a rate with its interval."""
    low, high = interval
    return f"{value:.2f} ({low:.2f} to {high:.2f})"


def quality_object_table() -> str:
    """Returns the table of the objects that the expert disturbs."""
    rows = [
        (
            row["domain"],
            f"`{row['task']}`",
            ", ".join(f"{name} ({count})" for name, count in row["objects"].items()) or "none",
            f"{row['stray_contacts']} of {row['episodes']}",
        )
        for row in read_results("quality_objects")
    ]
    return markdown(("domain", "task", "disturbed (episodes)", "episodes with stray contacts"), rows)


def quality_speed_table() -> str:
    """Returns the table of the speed of environments that measure quality."""

    def alone(row: Mapping[str, Any]) -> str:
        return f"{row['physics_ratio']:.2f}" if "physics_ratio" in row else ""

    rows = [
        (row["domain"], row["physics"], row["environments"], f"{row['ratio']:.2f}", alone(row))
        for row in read_results("quality_speed")
    ]
    return markdown(("domain", "physics", "environments", "speed with quality", "of the physics steps alone"), rows)


def holding_table(*, real: bool) -> str:
    """Returns the table of what fingers hold: shapes, or real objects, by scene; each cell has a number by mass."""
    rows = [row for row in read_results("holding") if (" of " not in row["kind"]) == real]
    scenes = list(dict.fromkeys((row["domain"], row["physics"]) for row in rows))
    cells = []
    for kind in dict.fromkeys(row["kind"] for row in rows):
        of_kind = [row for row in rows if row["kind"] == kind]
        by_scene = ([row for row in of_kind if (row["domain"], row["physics"]) == scene] for scene in scenes)
        cells.append((kind, *(", ".join(map(_held, each)) for each in by_scene)))
    return markdown(("object" if real else "shape", *(f"`{name}`, {physics}" for name, physics in scenes)), cells)


def _held(row: dict[str, Any]) -> str:
    """Returns by how much an object moved in the hand [mm], or that it was not held."""
    return f"{1000 * row['drift']:.1f}" if row["held"] and row["identical"] else "lost"


def holding_speed_table() -> str:
    """Returns the table of control steps a second of vectorised scenes with cans, and without."""
    rates = {(row["domain"], row["cans"], row["physics"]): row["rate"] for row in read_results("holding_speed")}
    rows = []
    for domain, cans in dict.fromkeys((domain, cans) for domain, cans, _ in rates):
        exact, fast = rates[domain, cans, "exact"], rates[domain, cans, "fast"]
        rows.append((f"`{domain}`", cans, exact, fast, f"{fast / exact:.1f}"))
    return markdown(("domain", "cans", "`exact` [control steps/s]", "`fast` [control steps/s]", "fast / exact"), rows)


RESULT_TABLES: dict[str, Callable[[], str]] = {
    "holding_shapes": functools.partial(holding_table, real=False),
    "holding_objects": functools.partial(holding_table, real=True),
    "holding_speed": holding_speed_table,
    "control_modes_tracking": tracking_table,
    "control_modes_borders": borders_table,
    "objects_random": objects_random_table,
    "control_modes_speed": control_speed_table,
    "kitchen_rewards": reward_table,
    "training_tasks": training_table,
    "training_network": network_table,
    "learning_curves_drawer": functools.partial(learning_curve_table, "drawer"),
    "learning_curves_kettle": functools.partial(learning_curve_table, "kettle"),
    "training_drawer": drawer_table,
    "variations_experts": varied_expert_table,
    "variations_layouts": layout_table,
    "variations_speed": variation_speed_table,
    "evaluation_results": evaluation_table,
    "quality_varied": functools.partial(quality_table, "varied"),
    "quality_usual": functools.partial(quality_table, "usual"),
    "quality_objects": quality_object_table,
    "quality_speed": quality_speed_table,
    "evaluation_goals": goals_table,
    "evaluation_shift": shift_table,
    "shift_costs": shift_cost_table,
    "evaluation_summary": summary_table,
    "evaluation_shift_summary": shift_summary_table,
    "evaluation_tasks": task_rate_table,
    "imitation_results": imitation_table,
    "kitchen_policy": kitchen_policy_table,
    "evaluation_example": evaluation_example,
    "comparison_example": comparison_example,
    "comparison_across": comparison_across,
    "comparison_seeds": comparison_seeds,
    "comparison_methods": comparison_methods,
    "comparison_kitchens": comparison_kitchens,
    "digests": digest_table,
    "offline_sets": offline_set_table,
    "offline_digests": offline_digest_table,
    "offline_results": offline_table,
    "offline_online": offline_online_table,
    "kitchens_certificates": certificate_table,
    "pick_and_place_certificates": object_certificate_table,
    "pick_and_place_expert": objects_expert_table,
    "pick_and_place_policies": objects_policies_table,
    "kitchens_expert": kitchens_expert_table,
    "kitchens_modes": kitchens_mode_table,
    "kitchens_designs": kitchens_design_table,
    "kitchens_speed": kitchens_speed_table,
    "fast_settings": fast_settings_table,
    "fast_experts": fast_experts_table,
    "fast_policies": fast_policies_table,
    "fast_parting": fast_parting_table,
    "fast_random": fast_random_table,
    "kitchen_rendering_card": functools.partial(benchmark_table, "kitchen_rendering_card"),
    **{
        name: functools.partial(benchmark_table, name)
        for name in (
            *(f"{domain}_{each}" for domain in ("kitchen", "open_cabinet") for each in ("speed", "rendering")),
            "scaling",
        )
    },
}
