"""The experiments measure what is missing, continue where they were interrupted, and leave what has been measured."""

import json
import re
import subprocess

import numpy as np
import pytest
from docs_blocks import blocks_of
from docs_blocks import run as run_block
from docs_scripts import DOCS, load_script

from kitchen_suite import policies, suite
from kitchen_suite.commands import evaluate
from kitchen_suite.entities.props import BURNER_DISPLACEMENTS
from kitchen_suite.evaluation.protocols import PROTOCOLS

COMMITTED = sorted((DOCS / "experiments" / "results" / "evaluation").glob("*.json"))
SMALL = {"num_envs": 4, "rollouts": 16, "hidden": [8], "mini_batches": 2, "learning_epochs": 2}
FLAGS = ("--num_steps=128", "--eval_interval=64", "--eval_episodes=2", f"--hyperparameters={json.dumps(SMALL)}")


@pytest.fixture
def experiment():
    return load_script("experiments/experiment")


@pytest.mark.full
def test_an_episode_is_played_from_its_seed(experiment):
    environment = suite.load("kitchen", "kettle", {"visuals": False, "time_limit": 1.0})
    first, second = (experiment.play(environment, "random", seed) for seed in (1, 2))
    # 1 s of control steps of 0.08 s, though composer's own time limit ends one later.
    assert first == second == (False, 13)
    act = policies.find("random")(environment, np.random.default_rng(1))
    seen = [[*experiment.timesteps(environment, act)] for _ in range(2)]
    assert [(each[0].first(), each[-1].last(), len(each)) for each in seen] == [(True, True, 14)] * 2


def test_cases_without_a_row_are_measured_and_each_row_is_kept_at_once(experiment, tmp_path):
    path, measured = tmp_path / "rows.json", []

    def measure(case):
        if case["task"] == "c":
            raise RuntimeError
        measured.append(case["task"])
        return {"success": len(measured)}

    cases = [{"task": task, "mode": "m"} for task in "abc"]
    experiment.write_rows(path, [{**cases[1], "success": 5}])
    with pytest.raises(RuntimeError):
        experiment.measure_missing(path, cases, measure)
    assert measured == ["a"]
    assert experiment.read_rows(path) == [{**cases[1], "success": 5}, {**cases[0], "success": 1}]
    experiment.measure_missing(path, cases[:2], measure)
    assert measured == ["a"]


def test_results_of_processes_come_by_case(experiment):
    counts = {("a", 1): 2, ("b", 2): 1}
    assert experiment.play_cases(str, counts, 10) == {
        ("a", 1): ["('a', 1, 10)", "('a', 1, 11)"],
        ("b", 2): ["('b', 2, 10)"],
    }


@pytest.fixture
def results(tmp_path, monkeypatch):
    module = load_script("experiments/training")
    monkeypatch.setattr(module, "RESULTS", tmp_path / "training.json")
    monkeypatch.setattr(module, "EPISODES", 2)
    monkeypatch.setattr(module, "FLAGS", dict.fromkeys(module.SEEDS, FLAGS))
    return module


@pytest.mark.clients
def test_a_run_is_trained_and_measured_once(results, tmp_path, monkeypatch):
    assert results.main([str(tmp_path), "kettle:2"]) == 0
    (row,) = results.read()
    assert (row["task"], row["seed"], row["steps"], row["episodes"]) == ("kettle", 2, 128, 2)
    assert 0 < row["minutes"] < 10
    assert 0 < row["processor_minutes"] < 10
    assert row["success"] in ([0], [1], [2])
    monkeypatch.setattr(results.subprocess, "run", lambda *arguments, **options: pytest.fail("it ran again"))
    assert results.main([str(tmp_path), "kettle:2"]) == 0


@pytest.mark.clients
def test_one_network_is_measured_with_each_of_the_tasks_asked(results, tmp_path, monkeypatch):
    from kitchen_suite.training import run

    asked = []

    def evaluate(policy, environments, seeds):
        infos = environments.reset(seed=list(seeds))[1]
        asked.append(infos["requested_tasks_mask"])
        return {"episode/success": np.ones(len(seeds))}

    monkeypatch.setattr(run, "evaluate", evaluate)
    assert results.main([str(tmp_path), "random_1:1"]) == 0
    (row,) = results.read()
    assert row["success"] == [2] * 7
    np.testing.assert_array_equal(np.array(asked), np.repeat(np.eye(7, dtype=bool)[:, np.newaxis], 2, axis=1))


@pytest.mark.clients
def test_the_policies_with_the_most_successes_are_shipped(results, tmp_path, monkeypatch):
    monkeypatch.setattr(results, "SHIPPED", tmp_path / "shipped")
    results.SHIPPED.mkdir()
    for seed, success in ((1, 97), (2, 99), (3, 99)):
        results.add({"task": "kettle", "seed": seed, "success": [success]})
        (tmp_path / f"kettle_{seed}").mkdir()
        (tmp_path / f"kettle_{seed}" / "policy.npz").write_text(f"{seed}")
    for seed, success in ((1, [99, 100, 90]), (2, [97, 97, 97])):
        results.add({"task": "random_1", "seed": seed, "success": success})
        (tmp_path / f"random_1_{seed}").mkdir()
        (tmp_path / f"random_1_{seed}" / "policy.npz").write_text(f"seven {seed}")
    results.add({"task": "top_drawer", "seed": 1, "success": [100]})
    assert results.main([str(tmp_path), "ship"]) == 0
    shipped = {path.name: path.read_text() for path in results.SHIPPED.iterdir()}
    assert shipped == {"kettle.npz": "2", "seven_in_turn.npz": "seven 2"}


@pytest.mark.clients
def test_the_page_has_the_flags_of_the_one_network(tmp_path):
    script = load_script("experiments/training")
    task = f"--task_name={script.ONE} --output"
    (block,) = (block for block in blocks_of(DOCS / "guide" / "reinforcement_learning.md") if task in block.code)
    program = tmp_path / "programs" / "kitchen-train"
    program.parent.mkdir()
    program.write_text('#!/bin/sh\nprintf "%s\\n" "$@"\n')
    program.chmod(0o755)
    shown, used = _values(run_block(block, tmp_path, program.parent).splitlines()), _values(script.FLAGS[script.ONE])
    for name in ("--domain_name", "--task_name", "--output"):
        del shown[name]
    # The page sets no limit.
    del used["--num_steps"]
    assert shown == used


def _values(flags):
    """Returns flags by name; those with JSON are decoded."""
    pairs = (flag.split("=", 1) for flag in flags)
    return {name: json.loads(value) if value[0] == "{" else value for name, value in pairs}


@pytest.mark.clients
@pytest.mark.parametrize(
    ("domain", "kitchens", "task"),
    [("kitchens", 2, "open"), pytest.param("pick_and_place", 3, "any", marks=pytest.mark.full)],
)
def test_the_policy_for_unseen_kitchens_is_trained_and_shipped(domain, kitchens, task, tmp_path, monkeypatch):
    script = load_script("experiments/unseen_kitchens")
    kind = script.KINDS[domain]
    small = kind._replace(kitchens=kitchens, episodes=dict.fromkeys(kind.episodes, 2), steps=4)
    monkeypatch.setitem(script.KINDS, domain, small)
    monkeypatch.setattr(script, "SHIPPED", tmp_path / "shipped")
    monkeypatch.setattr(script, "in_processes", map)
    script.SHIPPED.mkdir()
    folder = tmp_path / "runs"
    script.main([str(folder), "train", f"--domain={domain}"])
    script.main([str(folder), "ship", f"--domain={domain}"])
    policy = policies.load_policy(tmp_path / "shipped" / f"{kind.name}.npz")
    assert (policy.metadata["domain_name"], policy.metadata["task_name"]) == (domain, task)


SMALL_ONE = {
    "num_envs": 2,
    "rollouts": 16,
    "hidden": [256, 128],
    "mini_batches": 2,
    "learning_epochs": 1,
    "value_batches": 1,
}


@pytest.mark.clients
@pytest.mark.parametrize("algorithm", ["bc", "flow"])
def test_a_method_of_imitation_is_trained_and_measured_once(tmp_path, monkeypatch, algorithm):
    module = load_script("experiments/imitation")
    monkeypatch.setattr(module, "RESULTS", tmp_path / "results")
    monkeypatch.setattr(module, "SETS", {"fixed_order": (2, "complete")})
    monkeypatch.setattr(module, "CELLS", (module.Cell(algorithm, "fixed_order", 1, 2),))
    for name, value in {"SIZES": {"width": 8, "batch_size": 8}, "STEPS": 10, "EPISODES": 2}.items():
        monkeypatch.setattr(module, name, value)
    monkeypatch.setattr(module, "TRAINING", ("--eval_interval=10", "--eval_episodes=1"))
    assert module.main([str(tmp_path / "work")]) == 0
    result = json.loads((tmp_path / "results" / f"{algorithm}_fixed_order_1_2.json").read_text())
    assert (result["algorithm"], result["preset"], result["count"]) == (algorithm, "fixed_order", 1)
    assert (result["task_name"], result["num_episodes"]) == ("complete", 2)
    assert result["minutes"] > 0
    monkeypatch.setattr(module, "record", lambda *arguments: pytest.fail("it ran again"))
    assert module.main([str(tmp_path / "work")]) == 0


@pytest.fixture
def evaluations(tmp_path, monkeypatch):
    """The script, with a folder of its own for the results."""
    module = load_script("experiments/evaluation")
    monkeypatch.setattr(module, "SCORES", tmp_path / "evaluation")
    monkeypatch.setattr(module, "RECEIPTS", tmp_path / "receipts")
    return module


def test_committed_results_are_of_whole_protocols():
    # `bc` is evaluated by experiments/imitation.py.
    cases = {*load_script("experiments/evaluation").CASES, ("bc", "shift")}
    for path in COMMITTED:
        result = json.loads(path.read_text("utf-8"))
        protocol = PROTOCOLS[result["protocol"]]
        assert tuple(path.stem.split("_")) in cases, path
        assert path.stem.endswith(f"_{protocol.name}"), path
        assert (result["seed"], result["num_episodes"]) == (protocol.seed, protocol.num_episodes), path
        task = "all" if "all" in path.stem.split("_") else "random_4"
        names = [condition.name or condition.task_name or task for condition in protocol.conditions]
        assert list(result["conditions"]) == names, path


def test_committed_receipts_are_small_ones():
    script = load_script("experiments/evaluation")
    sizes = {path.name: path.stat().st_size for path in script.RECEIPTS.iterdir()}
    assert sizes
    assert {name: size for name, size in sizes.items() if size > script.MAX_RECEIPT} == {}


def run(script, monkeypatch, *arguments, fails=()):
    """Runs the script with short evaluations, of which those named fail after their folder was made."""
    done = []

    def play(command, check):
        (policy, protocol, *_) = (flag.partition("=")[2] for flag in command[4:])
        done.append((policy, protocol, "--resume" in command))
        status = evaluate.main([*command[4:], "--num_episodes=2", "--max_episode_steps=1"])
        if status or (policy, protocol) in fails:
            raise RuntimeError

    monkeypatch.setattr(subprocess, "run", play)
    script.main(arguments)
    return done


@pytest.mark.full
def test_the_script_makes_what_is_missing_and_continues(evaluations, tmp_path, monkeypatch):
    folder, names = str(tmp_path / "runs"), ("random:default", "random:d4rl")
    with pytest.raises(RuntimeError):
        run(evaluations, monkeypatch, folder, *names, fails=[("random", "default")])
    evaluations.result_file(("random", "default")).unlink()
    assert run(evaluations, monkeypatch, folder, *names) == [("random", "default", True), ("random", "d4rl", False)]
    assert run(evaluations, monkeypatch, folder, *names) == []
    assert sorted(path.name for path in evaluations.RECEIPTS.iterdir()) == ["random_d4rl.npz", "random_default.npz"]
    # A greater receipt stays in the folder of the runs.
    monkeypatch.setattr(evaluations, "MAX_RECEIPT", 100)
    assert run(evaluations, monkeypatch, folder, "random:gas") == [("random", "gas", False)]
    assert evaluations.receipt_file(("random", "gas"), tmp_path / "runs").exists()
    assert not evaluations.receipt_file(("random", "gas"), evaluations.RECEIPTS).exists()
    assert sorted(path.name for path in evaluations.SCORES.iterdir()) == [
        "random_d4rl.json",
        "random_default.json",
        "random_gas.json",
    ]


@pytest.mark.full
def test_goals_are_taken_from_demonstrations_that_are_recorded_first(evaluations, tmp_path, monkeypatch):
    commands = []
    monkeypatch.setattr(subprocess, "run", lambda command, check: commands.append(command))
    with pytest.raises(FileNotFoundError):
        evaluations.main([str(tmp_path / "runs"), "random:goal-reaching"])
    recorded, evaluated = commands
    assert recorded[3] == "record"
    assert f"--dataset={tmp_path / 'runs' / 'demonstrations'}" in evaluated
    assert recorded[4] == f"--output={tmp_path / 'runs' / 'demonstrations'}"


@pytest.mark.full
def test_the_tables_have_the_results(evaluations, tmp_path, monkeypatch):
    tables = load_script("scripts/result_tables")
    monkeypatch.setattr(tables, "RESULTS", evaluations.SCORES.parent)
    run(evaluations, monkeypatch, str(tmp_path / "runs"), "random:default", "random:d4rl")
    rows = [[cell.strip(" `") for cell in row.split("|")[1:5]] for row in tables.evaluation_table().splitlines()[2:]]
    assert rows == [
        ["default", "random_4", "random", "2"],
        *(["d4rl", name, "random", "2"] for name in ("complete", "partial", "mixed")),
    ]
    assert "0 of 2" in tables.task_rate_table()
    assert len(tables.shift_table().splitlines()) == 2 + len(PROTOCOLS["shift"].conditions)


@pytest.mark.full
def test_the_page_explains_every_field(tmp_path, capsys):
    page = (DOCS / "guide" / "evaluation.md").read_text("utf-8")
    named = set(re.findall(r"`(\w+)`", page))
    for flags in (["--protocol=d4rl", "--num_episodes=1"], ["--domain_name=open_cabinet", "--num_episodes=1"]):
        file = tmp_path / "a.json"
        assert evaluate.main([*flags, "--max_episode_steps=1", f"--json={file}"]) == 0
        result = json.loads(file.read_text("utf-8"))
        assert {name for name in result if not re.fullmatch(r"p\d", name)} <= named
        for rates in result.get("task_rates", {}).values():
            assert rates.keys() <= named
    capsys.readouterr()


@pytest.fixture
def kitchen_policy(tmp_path, monkeypatch):
    script = load_script("experiments/kitchen_policy")
    few = (script.Recording("exact", "", 2, 120), script.Recording("fast", "start", 2, 120))
    strict = script.Recording("exact", "start", 2, 400, "strict")
    monkeypatch.setattr(script, "RESULTS", tmp_path / "results.json")
    seen = script.Recording("exact", "start", 2, 120, "pixels")
    monkeypatch.setattr(script, "ROUNDS", {"kitchen": (few, few), "kitchen_strict": ((strict,),), "pixels": ((seen,),)})
    small = ('--hyperparameters={"width": 8, "batch_size": 8}', "--eval_episodes=1")
    monkeypatch.setattr(script, "STEPS", {name: (20,) * len(rounds) for name, rounds in script.ROUNDS.items()})
    monkeypatch.setattr(script, "TRAINING", dict.fromkeys(script.TRAINING, small))
    monkeypatch.setattr(script, "LATEST", 5)
    monkeypatch.setattr(script, "EPISODES", 1)
    conditions = {name: script.CONDITIONS["kitchen"][name] for name in ("all", "random 4, fast")}
    seeing = {"complete": script.CONDITIONS["pixels"]["complete"]}
    monkeypatch.setattr(script, "CONDITIONS", {**script.CONDITIONS, "kitchen": conditions, "pixels": seeing})
    monkeypatch.setattr(script, "TASKS_PER_EPISODE", 1)
    return script


@pytest.mark.clients
def test_the_kitchens_policy_is_corrected_in_rounds_and_measured(kitchen_policy, tmp_path, monkeypatch):
    folder = tmp_path / "runs"
    assert kitchen_policy.main(["kitchen", str(folder), "train"]) == 0
    assert {path.name for path in (folder / "corrections_1").iterdir()} == {"exact_original", "fast_start"}
    # What has been made is not made again; an interrupted training goes on.
    (folder / "policy_1" / "complete").unlink()
    commands = []
    with monkeypatch.context() as context:
        context.setattr(subprocess, "run", lambda command, check: commands.append(command))
        assert kitchen_policy.main(["kitchen", str(folder), "train"]) == 0
    (command,) = commands
    assert command[-1] == "--resume"
    assert sum("corrections_1" in flag for flag in command) == 1
    assert kitchen_policy.last_policy("kitchen", folder) == folder / "policy_1" / "policy.npz"

    assert kitchen_policy.main(["kitchen", str(folder), "evaluate"]) == 0
    results = json.loads(kitchen_policy.RESULTS.read_text("utf-8"))["kitchen"]["conditions"]
    assert {name: result["task_kwargs"].get("physics") for name, result in results.items()} == {
        "all": None,
        "random 4, fast": "fast",
    }


@pytest.mark.clients
def test_the_policy_for_strict_success_learns_from_strict_demonstrations(kitchen_policy, tmp_path):
    folder = tmp_path / "runs"
    assert kitchen_policy.main(["kitchen_strict", str(folder), "train"]) == 0
    assert kitchen_policy.main(["kitchen_strict", str(folder), "evaluate"]) == 0
    (result,) = json.loads(kitchen_policy.RESULTS.read_text("utf-8"))["kitchen_strict"]["conditions"].values()
    assert (result["task_kwargs"]["success"], result["max_episode_steps"]) == ("strict", 400)


@pytest.mark.clients
@pytest.mark.rendering
def test_the_policy_from_pictures_learns_and_is_measured(kitchen_policy, tmp_path):
    folder = tmp_path / "runs"
    assert kitchen_policy.main(["pixels", str(folder), "train"]) == 0
    assert kitchen_policy.main(["pixels", str(folder), "evaluate"]) == 0
    results = json.loads(kitchen_policy.RESULTS.read_text("utf-8"))["pixels"]
    assert results["action_milliseconds"] > 0.0
    assert results["conditions"]["complete"]["task_kwargs"]["cameras"] == ["workspace", "franka/hand"]


def test_the_kettle_is_recorded_around_a_burner_and_never_on_it(kitchen_policy):
    for name, (least, greatest) in kitchen_policy.RINGS.items():
        places = np.array(kitchen_policy.ring_variations(name)["kettle/pose"]["choice"])
        distances = np.linalg.norm(places[:, :2] - BURNER_DISPLACEMENTS[2, :2], axis=1)
        assert least - 0.001 < distances.min()
        assert distances.max() < greatest + 0.001
