"""`kitchen-evaluate` from the command line: its scores, JSON and folder; interrupted evaluations continue."""

import functools
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from helpers.episodes import rollout_of
from helpers.sweeps import brief

from kitchen_suite.commands import evaluate
from kitchen_suite.domains.domain import Domain
from kitchen_suite.episodes import report
from kitchen_suite.evaluation import text
from kitchen_suite.evaluation.evaluation import Evaluation
from kitchen_suite.evaluation.folder import DESCRIPTION_FILE, EPISODES_FILE, EvaluationFolder
from kitchen_suite.evaluation.plan import Replaced, make_unprepared_plan
from kitchen_suite.evaluation.rollout import PlayedEpisode
from kitchen_suite.evaluation.scores import EpisodeResult
from kitchen_suite.evaluation.traces import Trace
from kitchen_suite.policies import PolicyRef
from kitchen_suite.vector_env import base as vector_base

SMALL = ["--num_episodes=5", "--max_episode_steps=4", "--num_envs=2"]


@pytest.fixture
def run(run, folder):
    """Runs the command in an empty folder; returns status, stdout and stderr."""
    return functools.partial(run, evaluate, *SMALL)


def read(path):
    return json.loads(path.read_text("utf-8"))


@pytest.mark.full
def test_the_scores_are_printed_and_written(run, tmp_path):
    status, out, err = run("--json=a.json")
    assert (status, err) == (0, "")
    heading = "kitchen, policy random, protocol default, variations start (seen): 5 episodes, seeds from 400000000"
    assert out.startswith(f"{heading}\nvalues replaced: num_episodes 5, not 200; ")
    assert out.partition("\n\n")[2].startswith("random_4 ")
    for label in ("p1", "p4", "mean tasks", "success", "control steps", "order entropy [bit]", "where asked"):
        assert label in out
    assert "p5" not in out
    result = read(tmp_path / "a.json")
    assert list(result) == [
        *("protocol", "domain_name", "policy", "seed", "num_episodes", "max_episode_steps", "versions"),
        *("task_name", "task_kwargs", "policy_sha256", "p1", "p2", "p3", "p4", "mean_tasks", "success"),
        *("success_at_end", "control_steps", "intervals", "task_rates", "order_entropy", "diverged_seeds"),
        "conditions",
    ]
    assert (result["protocol"], result["policy"]) == ("default", "random")
    assert result["task_kwargs"] == {"variations": ["start"]}
    assert sum(row["asked"] for row in result["task_rates"].values()) == 4 * 5
    (condition,) = result["conditions"].values()
    assert condition.items() <= result.items()
    assert not list(tmp_path.glob("*/"))


@pytest.mark.full
def test_the_json_does_not_depend_on_how_episodes_are_played(run, tmp_path):
    for number, flags in enumerate(["--num_envs=1 --num_threads=1", "--num_envs=3", "--num_envs=64 --num_threads=2"]):
        assert run(f"--json={number}.json", "--task_name=kettle", *flags.split())[0] == 0
    contents = {path.read_bytes() for path in tmp_path.glob("*.json")}
    assert len(contents) == 1


@pytest.mark.full
def test_the_scores_are_those_of_single_episodes(run, tmp_path):
    from kitchen_suite.episodes.spec import EnvironmentSpec

    kwargs = {"variations": "start", "tasks_to_complete": ["microwave", "kettle", "light switch"]}
    flags = ["--task_name=all", "--policy=expert", "--seed=5", "--max_episode_steps=100"]
    assert run(*flags, f"--task_kwargs={json.dumps(kwargs)}", "--json=a.json", "--num_episodes=3")[0] == 0
    result = read(tmp_path / "a.json")
    spec = EnvironmentSpec.make(domain_name="kitchen", task_name="all", task_kwargs=kwargs, max_episode_steps=100)
    rollout = rollout_of(spec.episodes(PolicyRef.parse("expert"), seed=5))
    infos = [rollout.play(index, 5 + index).last_info for index in range(3)]
    assert result["mean_tasks"] == pytest.approx(np.mean([(info["completion_steps"] > 0).sum() for info in infos]))
    assert result["control_steps"] == pytest.approx(np.mean([info["episode_step"] for info in infos]))
    assert result["mean_tasks"] > 2


@pytest.mark.full
def test_a_domain_without_tasks_to_count_has_success_and_progress(run, tmp_path):
    status, out, _ = run("--domain_name=open_cabinet", "--json=a.json", "--num_episodes=2", "--max_episode_steps=2")
    assert status == 0
    assert out.startswith(
        "open_cabinet, policy random, protocol default, variations start (seen): 2 episodes, seeds from"
    )
    result = read(tmp_path / "a.json")
    assert result["intervals"].keys() == {"mean_progress", "success", "success_at_end", "control_steps"}
    assert "order entropy" not in out


@pytest.mark.full
def test_every_condition_of_a_protocol_is_scored(run, tmp_path):
    status, out, _ = run("--protocol=d4rl", "--json=a.json", "--num_episodes=1", "--max_episode_steps=1")
    assert status == 0
    assert "1 episode of each condition" in out
    result = read(tmp_path / "a.json")
    assert list(result["conditions"]) == ["complete", "partial", "mixed"]
    assert result["task_name"] == "complete"
    assert result["d4rl_score"] == 0.0
    lines = out.partition("\ncondition ")[2].splitlines()
    assert lines[0].split()[:2] == ["p1", "p2"]
    assert [line.split()[0] for line in lines[2:5]] == ["complete", "partial", "mixed"]


DESCRIPTION = {"protocol": "default", "conditions": {"all": {}}}


def trace_of(seed):
    """A trace of an episode of one control step, whose action is its seed."""
    return Trace(
        actions=np.full((1, 9), seed, np.float32),
        checks=np.zeros(2, np.uint16),
        digest=np.zeros(32, np.uint8),
        last=np.zeros(60, np.float32),
    )


def add_results(folder, seeds, barrier):
    """Adds results with many measures to an evaluation, at the same time as other processes."""
    opened = EvaluationFolder(folder, DESCRIPTION)
    barrier.wait()
    for seed in seeds:
        result = EpisodeResult(
            condition="all",
            episode=seed,
            seed=seed,
            success=True,
            progress=1.0,
            control_steps=1,
            # Longer than the buffers of files.
            measures={f"measure {number}": float(number) for number in range(1_000)},
        )
        opened.add(PlayedEpisode(result, trace_of(seed)))


@pytest.mark.full
def test_lines_of_several_processes_do_not_mix(tmp_path):
    EvaluationFolder.create(tmp_path / "runs", DESCRIPTION)
    context = multiprocessing.get_context("spawn")
    barrier = context.Barrier(3)
    parts = [range(0, 30), range(20, 50), range(40, 70)]
    processes = [context.Process(target=add_results, args=(tmp_path / "runs", part, barrier)) for part in parts]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    found = EvaluationFolder.resume(tmp_path / "runs", DESCRIPTION)
    assert sorted(found.played) == [("all", seed) for seed in range(70)]
    assert all(trace.actions[0, 0] == result.seed for result, trace, _ in found.played.values())


@pytest.mark.full
def test_conditions_that_are_a_sample_are_scored_together():
    plan = make_unprepared_plan(PolicyRef.parse("zero"), "unseen-kitchens", Replaced(domain_name="kitchens"))
    # In kitchen 0 nothing succeeds, in kitchen 1 one of four episodes, and so on to all four, again and again.
    results = {
        name: [
            EpisodeResult(
                condition=name,
                episode=index,
                seed=plan.first.seed + index,
                success=index < number % 5,
                progress=float(index < number % 5),
                control_steps=280,
                diverged=number == 0 and index == 3,
            )
            for index in range(4)
        ]
        for number, name in enumerate(plan.specs)
    }
    evaluation = Evaluation(plan=plan, results=results)
    record = evaluation.as_json()
    assert record["success"] == evaluation.scores["success"] == 0.5
    assert record["diverged_seeds"] == [400_000_003]
    assert record["conditions"]["kitchen 1"]["success"] == 0.25
    # The quantile of Student's t for 99 degrees of freedom is 1.984217.
    half = 1.984217 * np.std([0.0, 0.25, 0.5, 0.75, 1.0] * 20, ddof=1) / 10
    assert evaluation.scores["intervals"]["success"] == pytest.approx([0.5 - half, 0.5 + half], abs=1e-6)
    shown = text.format_sample(evaluation.scores, results)
    assert [line.split()[:4] for line in shown.splitlines() if " of 4" in line] == [
        [str(count), "of", "4", "20"] for count in range(4, -1, -1)
    ]
    assert "kitchen 0, kitchen 5, kitchen 10, kitchen 15, kitchen 20, kitchen 25, ..." in shown
    assert "the physics diverged in 1 episode" in shown
    assert "fast physics, variations none: 4 episodes of each condition" in text.format_heading(plan)


@pytest.mark.full
def test_diverged_episodes_count_as_failures_and_are_named(run, tmp_path, monkeypatch):
    step, count = vector_base.SuiteVectorEnv.step_some, 0

    def diverge(self, actions, mask):
        nonlocal count
        count += 1
        observations, rewards, terminations, truncations, infos = step(self, actions, mask)
        diverged = np.array([False, count == 2, False])
        return observations, rewards, terminations | diverged, truncations, infos | {"physics_error": diverged}

    monkeypatch.setattr(vector_base.SuiteVectorEnv, "step_some", diverge)
    status, out, err = run("--num_episodes=3", "--num_envs=3", "--seed=7", "--output=runs", "--json=a.json")
    assert (status, err) == (0, "")
    assert "the physics diverged in 1 episode, counted as failures that completed nothing: seeds [8]\n" in out
    result = read(tmp_path / "a.json")
    assert (result["diverged_seeds"], result["control_steps"]) == ([8], 4.0)
    # It is scored with the tasks that it asked for.
    assert sum(row["asked"] for row in result["task_rates"].values()) == 4 * 3
    assert [line["diverged"] for line in lines(tmp_path / "runs")].count(True) == 1


def lines(folder):
    return [json.loads(line) for line in folder.joinpath(EPISODES_FILE).read_text("utf-8").splitlines()]


KETTLE = ("--task_name=kettle", "--json=a.json", "--output=runs")


@pytest.mark.full
def test_an_evaluation_goes_on_where_it_was_cut_off(run, tmp_path):
    assert run(*KETTLE)[0] == 0
    folder, whole = tmp_path / "runs", (tmp_path / "a.json").read_bytes()
    assert [line["seed"] for line in lines(folder)] == [*range(400_000_000, 400_000_005)]
    episodes = folder / EPISODES_FILE
    everything = episodes.read_bytes()
    second, size = everything.index(b"\n", 200) + 1, len(everything)
    # At the start, after the second line, within the third, before the end of the last one, and after it.
    for end in (0, second, second + 60, size - 1, size):
        episodes.write_bytes(everything[:end])
        (tmp_path / "a.json").unlink()
        kept = everything[:end].rpartition(b"\n")[0]
        assert run(*KETTLE, "--resume")[0] == 0
        assert (tmp_path / "a.json").read_bytes() == whole
        assert episodes.read_bytes().startswith(kept)
        assert sorted(episodes.read_bytes().splitlines()) == sorted(everything.splitlines())


@pytest.mark.full
def test_an_interrupt_says_how_far_it_came_and_how_to_continue(run, tmp_path, monkeypatch):
    assert run(*KETTLE)[0] == 0
    whole = (tmp_path / "a.json").read_bytes()
    count = report.EpisodeBar.count

    def interrupt(self, success):
        count(self, success)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(report.EpisodeBar, "count", interrupt)
        status, _, err = run("--task_name=kettle", "--output=again")
    assert (status, err) == (
        130,
        "kitchen-evaluate: interrupted\n",
    )
    assert run("--task_name=kettle", "--output=again", "--resume", "--json=b.json")[0] == 0
    assert (tmp_path / "b.json").read_bytes() == whole


@pytest.mark.full
def test_a_killed_evaluation_ends_with_the_same_json(run, tmp_path):
    flags = ["--task_name=random_2", "--num_episodes=24", "--max_episode_steps=20", "--num_envs=4", "--num_threads=1"]
    assert run(*flags, "--json=a.json")[0] == 0
    command = [sys.executable, "-m", "kitchen_suite", "evaluate", *flags, "--output=runs"]
    episodes = tmp_path / "runs" / EPISODES_FILE
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        while not episodes.exists() or episodes.read_bytes().count(b"\n") < 5:
            assert process.poll() is None
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    assert 5 <= len(lines(tmp_path / "runs")) < 24
    with episodes.open("ab") as file:
        file.write(b'{"condition": "random_2", "epis')
    assert run(*flags, "--output=runs", "--resume", "--json=b.json")[0] == 0
    assert (tmp_path / "b.json").read_bytes() == (tmp_path / "a.json").read_bytes()
    assert len(lines(tmp_path / "runs")) == 24


@pytest.mark.full
def test_another_evaluations_folder_is_refused(run, tmp_path):
    assert run(*KETTLE, "--num_episodes=1", "--max_episode_steps=1")[0] == 0
    folder = tmp_path / "runs"
    before = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    assert before.keys() == {DESCRIPTION_FILE, EPISODES_FILE}
    tiny = (*KETTLE, "--num_episodes=1", "--max_episode_steps=1")
    for arguments, message in {
        tiny: "runs holds an evaluation already: resume it",
        (*tiny, "--resume", "--seed=3"): "with seed 400000000, not 3",
        (*tiny, "--resume", "--policy=zero"): 'with policy "random", not "zero"',
        (*tiny, "--resume", "--num_episodes=2"): "with num_episodes 1, not 2",
        (*tiny, "--resume", "--output=nothing"): "nothing does not hold an evaluation to resume",
    }.items():
        status, out, err = run(*arguments)
        assert (status, out) == (2, "")
        assert message in err
    assert {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()} == before


@pytest.mark.full
@pytest.mark.parametrize("line", brief(["", "{}", "[", '"x"', "\xff", "ANOTHER NAME"], kept=["{}", "ANOTHER NAME"]))
def test_damaged_lines_are_refused(run, tmp_path, line):
    tiny = ("--task_name=kettle", "--output=runs", "--num_episodes=1", "--max_episode_steps=1")
    assert run(*tiny)[0] == 0
    path = tmp_path / "runs" / EPISODES_FILE
    whole = path.read_text("utf-8")
    changed = {"ANOTHER NAME": whole.replace('"kettle"', '"kettles"', 1)}
    path.write_text(changed.get(line, f"{line}\n"), encoding="latin-1")
    status, out, err = run(*tiny, "--resume")
    assert (status, out) == (1, "")
    assert f"runs/{EPISODES_FILE} does not hold the episodes of an evaluation" in err
    assert err.count("\n") == 1


BAD = {
    "--protocol=d4r": ["'d4r'", "'d4rl'", "diffusion-policy"],
    "--protocol=d4rl --domain_name=open_cabinet": ["'d4rl'", "'open_cabinet'"],
    "--protocol=shift --variation_split=seen": ["'shift'", "['variation_split']"],
    "--domain_name=garage": ["'garage'"],
    "--task_name=ketle": ["'kettle'"],
    "--policy=expret": ["'expert'"],
    "--policy=trained --task_name=close_microwave": ["kitchen", "close_microwave"],
    "--policy=trained(file='none.npz')": ["'none.npz'"],
    "--resume": ["resumed", "output"],
    "--json=nowhere/a.json": ["--json", "'nowhere'"],
    "--json=.": ["--json"],
    "--json": ["--json"],
    "--num_episodes=0": ["--num_episodes", "1"],
    f"--seed={2**63}": ["seed", "must be at most"],
    "--variations=starts": ["'start'"],
    '--task_kwargs={"thresold":1}': ["'threshold'"],
    '--task_kwargs={"max_episode_steps":1}': ["max_episode_steps", "task_kwargs"],
    '--protocol=strict --task_kwargs={"threshold":0.1}': ["0.1", "'strict'"],
    '--variations=start --task_kwargs={"variations":"layout"}': ["'layout'", "task_kwargs"],
}


@pytest.mark.parametrize(
    "arguments",
    [
        ["--json=a.npz", "--receipt=a.npz"],
        ["--json=a.html", "--web=a.html"],
        ["--json=runs/evaluation.json", "--output=runs"],
        ["--json=runs/../runs/episodes.jsonl", "--output=runs"],
    ],
    ids=" ".join,
)
def test_two_outputs_in_one_file_are_refused(run, tmp_path, arguments):
    (tmp_path / "runs").mkdir()
    status, out, err = run(*arguments, "--num_episodes=1", "--max_episode_steps=1")
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "must be different files" in err
    assert os.listdir(tmp_path) == ["runs"]
    assert not os.listdir(tmp_path / "runs")


@pytest.mark.parametrize("arguments", BAD)
def test_a_bad_argument_gets_one_line_and_status_2(run, tmp_path, arguments):
    status, out, err = run("--output=runs", *arguments.split()) if arguments != "--resume" else run(arguments)
    assert (status, out) == (2, "")
    assert err.startswith("kitchen-evaluate: ")
    assert all(part in err for part in BAD[arguments]), err
    assert err.count("\n") == 1
    assert not (tmp_path / "runs").exists()


@pytest.mark.full
def test_a_policy_that_fails_ends_in_one_line(run, tmp_path):
    (tmp_path / "faulty.py").write_text("def act(timestep):\n    return [0.0]\n")
    sys.modules.pop("faulty", None)
    status, _, err = run("--policy=faulty:act", "--task_name=kettle")
    assert status == 2
    assert err.count("\n") == 1
    assert "'faulty:act' returned a bad action" in err


@pytest.mark.full
def test_actions_of_another_size_are_refused_before_all_kitchens_are_built(run, tmp_path, monkeypatch):
    """And the control mode that the protocol sets is named in the heading and in the error."""
    (tmp_path / "nine_joints.py").write_text("def act(timestep):\n    return [0.0] * 9\n")
    sys.modules.pop("nine_joints", None)
    built = []
    load = Domain.load
    monkeypatch.setattr(Domain, "load", lambda self, **arguments: built.append(arguments) or load(self, **arguments))
    kitchens = ["--domain_name=kitchens", "--protocol=unseen-kitchens", "--num_envs=1"]
    status, out, err = run("--policy=nine_joints:act", *kitchens)
    assert status == 2
    assert ", control_mode ee_delta_pose, " in out
    assert "bad action in control_mode 'ee_delta_pose': action must have shape (7,), got shape (9,)" in err
    assert {arguments["design"] for arguments in built} == {0}


OWN = "each episode varies (variations start (seen))"


@pytest.mark.full
def test_a_policy_of_ones_own_is_told_that_starts_vary_and_which_flag_decides(run, tmp_path):
    (tmp_path / "still.py").write_text("def act(timestep):\n    return [0.0] * 9\n")
    sys.modules.pop("still", None)
    short = ["--num_episodes=1", "--max_episode_steps=2"]
    assert OWN in run("--policy=still:act", *short)[1]
    _, out, _ = run("--policy=still:act", *short, "--variations=none")
    assert "each episode varies" not in out
    assert "variations none: 1 episode" in out
    assert "each episode varies" not in run("--policy=zero", *short)[1]
    # Its conditions vary in different ways, which no flag replaces.
    assert "each episode varies" not in run("--policy=still:act", *short, "--protocol=shift")[1]


@pytest.mark.full
def test_a_folder_that_is_full_ends_in_one_line(run, tmp_path, monkeypatch):
    def refuse(self, played):
        raise OSError(28, "No space left on device", "runs/episodes.jsonl")

    monkeypatch.setattr("kitchen_suite.evaluation.folder.EvaluationFolder.add", refuse)
    status, _, err = run(*KETTLE)
    assert (status, err.count("\n")) == (1, 1)
    assert "No space left on device: 'runs/episodes.jsonl'" in err
    assert not (tmp_path / "a.json").exists()


@pytest.mark.full
def test_a_progress_bar_counts_all_episodes(run, monkeypatch):
    made = []

    class Bar(report.EpisodeBar):
        def __init__(self, *args):
            super().__init__(*args)
            made.append(self)

    monkeypatch.setattr("kitchen_suite.episodes.report.EpisodeBar", Bar)
    assert run("--protocol=d4rl", "--num_episodes=1", "--max_episode_steps=1")[0] == 0
    assert [bar.total for bar in made] == [3]
