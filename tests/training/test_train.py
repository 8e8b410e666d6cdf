"""`kitchen-train` from the command line: exit status, table, the files in its folder, and resuming."""

import functools
import importlib.util
import json
import os
import re
import resource
import signal
import sys

import numpy as np
import pytest
from help_text import flag_lines
from helpers.processes import open_process

from kitchen_suite import installation
from kitchen_suite.commands import play, train
from kitchen_suite.episodes import video
from kitchen_suite.policies.files import SHIPPED
from kitchen_suite.policies.perceptron import PerceptronPolicy
from kitchen_suite.rendering import gl

clients = pytest.mark.clients
COMMAND = [sys.executable, "-m", "kitchen_suite", "train"]
SMALL = {"num_envs": 4, "rollouts": 16, "hidden": [8], "mini_batches": 2, "learning_epochs": 2}
BATCH = 64
# An evaluation after every second batch.
TINY = [
    "--domain_name=open_cabinet",
    f"--hyperparameters={json.dumps(SMALL)}",
    f"--num_steps={6 * BATCH}",
    f"--eval_interval={2 * BATCH}",
    "--eval_episodes=2",
    "--num_threads=1",
]


@pytest.fixture
def run(run, folder):
    """Runs the command in an empty folder; returns status, stdout and stderr."""
    return functools.partial(run, train, *TINY, "--output=run")


@pytest.fixture
def evaluations(monkeypatch):
    """Replaces evaluations: each returns the next of these metrics, and the last one for ever; None interrupts."""
    from kitchen_suite.training import run as training_run

    results = [{"success": 0.0, "progress": 0.0, "return": 0.0}]

    def evaluate(policy, environments, seeds):
        metrics = results.pop(0) if len(results) > 1 else results[0]
        if metrics is None:
            raise KeyboardInterrupt
        return {f"episode/{name}": np.full(len(seeds), value) for name, value in metrics.items()}

    monkeypatch.setattr(training_run, "evaluate", evaluate)
    return results


def rows(out):
    """Returns seed and control steps of each row of the table."""
    return [
        (int(seed), int(steps.replace(",", ""))) for seed, steps in re.findall(r"^ *(\d+) +([\d,]+) +\d", out, re.M)
    ]


def files(folder):
    """Returns the names of all files of a seed but the curves, hidden ones included."""
    return sorted(name for name in os.listdir(folder) if not name.startswith("events."))


def checkpoint(batches):
    return f"checkpoint_{batches * BATCH:012d}.pt"


@clients
def test_a_run_leaves_a_policy_curves_and_the_last_checkpoints(run):
    status, out, err = run("--num_steps=640")
    assert (status, err) == (0, "")
    length = "at most 640 control steps for each seed, evaluated every 128 in 2 episodes"
    ends = "ends once two evaluations in a row reach a success of 98 % (target_success)"
    heading = f"open_cabinet top_drawer, PPO, in run\n{length}\n{ends}\ncurves: tensorboard --logdir=run\n"
    assert out.startswith(heading)
    assert rows(out) == [(0, batches * BATCH) for batches in (0, 2, 4, 6, 8, 10)]
    assert out.splitlines()[-1] == "best policy: run/policy.npz"
    assert sorted(os.listdir("run")) == ["policy.npz", "seed_0", "training.json"]
    assert files("run/seed_0") == [*map(checkpoint, (6, 8, 10)), "last_policy.npz", "policy.npz"]
    policy = PerceptronPolicy.load("run/policy.npz")
    assert (policy.metadata["domain_name"], policy.metadata["task_name"]) == ("open_cabinet", "top_drawer")
    assert policy.metadata["hyperparameters"]["num_envs"] == SMALL["num_envs"]
    assert [weight.shape for weight in policy.weights] == [(8, 25), (8, 8)]


@clients
@pytest.mark.parametrize("task_kwargs", [{}, {"reward": "grasp", "gripper": "deterministic"}])
def test_a_trained_policy_can_be_played(run, capsys, task_kwargs):
    assert run(f"--task_kwargs={json.dumps(task_kwargs)}", "--num_steps=64")[0] == 0
    assert play.main(["--policy_file=run/policy.npz", "--novideo", "--num_episodes=1"]) == 0
    assert re.search(r"^success rate .*\([01] of 1\)$", capsys.readouterr().out, re.MULTILINE)


@clients
def test_the_kitchen_can_be_trained(run, capsys):
    scale = json.dumps({**SMALL, "action_scale": [0.1] * 9})
    status, out, err = run(
        "--domain_name=kitchen", "--task_name=kettle", f"--hyperparameters={scale}", "--num_steps=64"
    )
    assert (status, err) == (0, "")
    assert out.startswith("kitchen kettle, PPO")
    assert play.main(["--policy_file=run/policy.npz", "--novideo", "--num_episodes=1"]) == 0
    assert capsys.readouterr().out.startswith("kitchen kettle, policy trained")


@clients
def test_a_run_is_evaluated_at_its_end(run):
    _, out, _ = run("--num_steps=320", "--eval_interval=100000")
    assert rows(out) == [(0, 0), (0, 5 * BATCH)]
    assert checkpoint(5) in files("run/seed_0")


@clients
def test_the_best_policy_is_kept(run, evaluations):
    evaluations[:] = [{"success": success, "progress": 0.0, "return": 1.0} for success in (0.1, 0.5, 0.5, 0.2)]
    assert run()[0] == 0
    training = PerceptronPolicy.load("run/policy.npz").metadata["training"]
    assert training == {"seed": 0, "steps": 2 * BATCH, "success": 0.5, "return": 1.0}


@clients
def test_two_evaluations_in_a_row_at_the_target_end_it(run, evaluations):
    evaluations[:] = [{"success": success, "progress": 0.3, "return": 0.0} for success in (1.0, 0.5, 0.9, 0.95, 0.0)]
    _, out, _ = run("--target_success=0.9", "--num_steps=640")
    assert rows(out)[-1] == (0, 6 * BATCH)
    assert "seed 0: the target was reached; best evaluation: success 100%" in out


@clients
def test_a_seed_without_progress_is_followed_by_the_next(run, evaluations):
    # Each seed is evaluated at its start, and before it is given up.
    evaluations[:] = [{"success": 0.0, "progress": progress, "return": 0.0} for progress in (0, 0, 0, 0.2)]
    status, out, _ = run("--patience=64", "--seed=5")
    assert status == 0
    assert "seed 5: there was no progress" in out
    assert "seed 6: all steps were made" in out
    assert rows(out) == [(5, 0), (5, BATCH), (6, 0), (6, BATCH), *((6, batches * BATCH) for batches in (2, 4, 6))]
    assert sorted(os.listdir("run")) == ["policy.npz", "seed_5", "seed_6", "training.json"]


@clients
@pytest.mark.parametrize("restarts", [0, 2])
def test_no_more_seeds_are_tried_than_allowed(run, evaluations, restarts):
    status, out, _ = run("--patience=64", f"--restarts={restarts}")
    assert status == 0
    assert re.findall(r"seed (\d): there was no progress", out) == [str(i) for i in range(restarts + 1)]
    assert os.path.exists("run/policy.npz")


@clients
def test_the_best_seeds_policy_becomes_the_runs(run, evaluations):
    returns = [0.0, 1.0, 0.0, 3.0, 0.0, 2.0]
    evaluations[:] = [{"success": 0.0, "progress": 0.0, "return": value} for value in returns]
    run("--patience=64", "--restarts=2")
    assert PerceptronPolicy.load("run/policy.npz").metadata["training"]["seed"] == 1


@clients
def test_patience_of_zero_never_gives_up(run, evaluations):
    assert "seed 0: all steps were made" in run("--patience=0")[1]


@clients
def test_an_interrupted_restart_goes_on_with_its_own_seed(run, evaluations):
    nothing = {"success": 0.0, "progress": 0.0, "return": 0.0}
    evaluations[:] = [nothing, nothing, nothing, None, {**nothing, "progress": 1.0}]
    assert run("--patience=64")[0] == 130
    status, out, _ = run("--patience=64", "--resume")
    assert status == 0
    # The first seed stays given up. The second had only its first evaluation.
    assert "seed 0: there was no progress" in out
    assert rows(out) == [(1, batches * BATCH) for batches in (1, 2, 4, 6)]


@clients
def test_a_run_that_reached_its_target_can_be_resumed_with_a_higher_one(run, evaluations):
    evaluations[:] = [{"success": 0.9, "progress": 0.0, "return": 0.0}]
    first = run("--target_success=0.9")[1]
    assert rows(first)[-1] == (0, 2 * BATCH)
    assert " 90 % (target_success)" in first
    assert "had finished" not in first
    finished = run("--target_success=0.9", "--resume")[1]
    assert rows(finished) == []
    assert "target_success above 0.9" in finished
    assert rows(run("--target_success=0.95", "--resume")[1])[-1] == (0, 6 * BATCH)


@clients
@pytest.mark.parametrize("name", ["num_steps", "patience"])
def test_a_finished_run_names_what_trains_it_on(run, evaluations, name):
    evaluations[:] = [{"success": 0.1, "progress": 0.0, "return": 0.0}]
    ending = {"num_steps": ["--num_steps=128"], "patience": ["--patience=64", "--restarts=0"]}[name]
    assert rows(run(*ending)[1])
    again = run(*ending, "--resume")[1]
    assert rows(again) == []
    assert f"a {name} above" in again
    assert "(target_success)" not in run("--num_steps=192", "--target_success=1.1", "--resume")[1]


@clients
def test_the_policy_of_an_interrupted_run_lies_where_that_of_a_finished_one_does(run, evaluations):
    evaluations[:] = [{"success": success, "progress": 0.1, "return": 1.0} for success in (0.1, 0.4, 0.3)] + [None]
    assert run()[0] == 130
    assert PerceptronPolicy.load("run/policy.npz").metadata["training"]["steps"] == 2 * BATCH


@clients
def test_the_policy_of_an_earlier_seed_stays_until_a_better_one_is_found(run, evaluations):
    found = [{"success": success, "progress": 0.0, "return": 1.0} for success in (0.1, 0.4, 0.3, 0.2)]
    evaluations[:] = [*found, None]
    assert run("--patience=64")[0] == 130
    training = PerceptronPolicy.load("run/policy.npz").metadata["training"]
    assert (training["seed"], training["success"]) == (0, 0.4)


@clients
def test_resuming_does_not_replace_the_policy_of_the_best_seed_by_that_of_the_first(run, evaluations):
    of_seeds = [(0.1, 0.0), (0.2, 0.0), (0.4, 1.0), (0.3, 1.0)]
    found = [{"success": success, "progress": progress, "return": 1.0} for success, progress in of_seeds]
    evaluations[:] = [*found, None]
    assert run("--patience=64")[0] == 130
    assert PerceptronPolicy.load("run/policy.npz").metadata["training"]["seed"] == 1
    evaluations[:] = [None]
    assert run("--patience=64", "--resume")[0] == 130
    assert PerceptronPolicy.load("run/policy.npz").metadata["training"]["seed"] == 1


@clients
def test_divergence_is_reported_in_one_line(run):
    changes = json.dumps({**SMALL, "learning_rate": 1e30, "kl_target": 0})
    status, _, err = run(f"--hyperparameters={changes}")
    assert status == 1
    assert re.fullmatch(
        r"kitchen-train: after \d+ steps the \w+ network is no longer finite: lower the learning rate\n", err
    )
    assert files("run/seed_0") == [checkpoint(0), "last_policy.npz", "policy.npz"]


@clients
def test_a_finished_run_can_be_resumed_with_more_steps(run):
    run()
    status, out, err = run("--resume", f"--num_steps={8 * BATCH}")
    assert (status, err) == (0, "")
    assert rows(out) == [(0, 8 * BATCH)]
    assert files("run/seed_0") == [*map(checkpoint, (4, 6, 8)), "last_policy.npz", "policy.npz"]


@clients
def test_a_finished_run_stays_as_it_is(run):
    run()
    before = files("run/seed_0")
    status, out, _ = run("--resume")
    assert (status, rows(out), files("run/seed_0")) == (0, [], before)
    assert "seed 0: all steps were made" in out


@clients
def test_a_truncated_checkpoint_is_reported_in_one_line_and_without_it_the_one_before_used(run):
    run()
    path = f"run/seed_0/{checkpoint(6)}"
    os.truncate(path, os.path.getsize(path) // 2)
    status, _, err = run("--resume")
    assert (status, err.count("\n")) == (1, 1)
    assert err.startswith(f"kitchen-train: {path} does not hold a checkpoint")
    os.remove(path)
    status, out, _ = run("--resume")
    assert status == 0
    assert rows(out) == [(0, 6 * BATCH)]


@pytest.fixture
def limit_files():
    """Returns a function that bounds the size of files [bytes], beyond which writing fails as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@clients
# Within the description, the curves, a policy, and a checkpoint.
@pytest.mark.parametrize("size", [30, 1_000, 4_000, 10_000])
@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_full_disk_ends_with_one_line(run, limit_files, size, tmp_path):
    limit_files(size)
    status, _, err = run("--num_steps=10000000")
    assert status in (1, 2)
    # The thread of the curves may print its traceback first.
    assert re.fullmatch(r"kitchen-train: \[Errno 27\] File too large[^\n]*", err.splitlines()[-1])
    assert not [path for path in tmp_path.rglob(".*") if path.is_file()]


@clients
def test_a_folder_with_a_seed_of_an_older_run_is_not_taken_for_a_new_one(run, tmp_path):
    tmp_path.joinpath("run", "seed_0").mkdir(parents=True)
    status, _, err = run("--output=run")
    assert status == 2
    assert "run holds a training run already" in err


@clients
def test_a_folder_with_a_run_is_not_overwritten(run):
    run()
    before = files("run/seed_0")
    status, out, err = run()
    assert (status, out) == (2, "")
    assert "run holds a training run already" in err
    assert files("run/seed_0") == before


RESUMED_AS = {
    f"--hyperparameters={json.dumps({**SMALL, 'hidden': [9]})}": "hidden [8], not [9]",
    "--seed=1": "seed 0, not 1",
    "--task_name=bottom_drawer": 'task_name "top_drawer", not "bottom_drawer"',
    '--task_kwargs={"gripper": "deterministic"}': 'gripper null, not "deterministic"',
}


@clients
def test_a_run_with_another_description_is_not_resumed(run):
    run("--num_steps=64")
    for argument, difference in RESUMED_AS.items():
        status, out, err = run("--resume", argument)
        assert (status, out) == (2, "")
        assert f"run holds a training run with {difference}" in err


@clients
def test_without_a_run_nothing_is_resumed(run):
    status, out, err = run("--resume")
    assert (status, out) == (2, "")
    assert "there is no training.json" in err
    assert not os.path.exists("run")


BAD = {
    '--hyperparameters={"num_env": 8}': ["'num_envs'"],
    '--hyperparameters={"num_envs": 0}': ["num_envs", "1"],
    '--hyperparameters={"learning_rate": -1}': ["learning_rate"],
    '--hyperparameters={"hidden": 64}': ["hidden"],
    '--hyperparameters={"num_envs": 5, "rollouts": 5, "mini_batches": 2}': ["mini_batches", "2", "25"],
    '--hyperparameters={"exploration": 0}': ["exploration", "0"],
    '--hyperparameters={"noise_correlation": 1.0}': ["noise_correlation", "1", "1.0"],
    '--hyperparameters={"action_scale": [1, 2]}': ["action_scale", "8"],
    '--task_kwargs={"griper": 1}': ["griper"],
    '--task_kwargs={"obs_type": "pixels"}': ["obs_type"],
    '--task_kwargs={"drawer": "bottom"}': ["['drawer']"],
    '--task_kwargs={"max_episode_steps": 5}': ["max_episode_steps"],
    '--hyperparameters={"discount": 1.5}': ["discount", "1", "1.5"],
    '--hyperparameters={"ratio_clip": -0.1}': ["ratio_clip"],
    '--hyperparameters={"num_envs": 1000000000000}': ["num_envs", "65536"],
    "--initial_policy=nowhere.npz": ["nowhere.npz"],
    f"--initial_policy={SHIPPED / 'kettle.npz'}": ["open_cabinet"],
    "--demonstrations=nowhere": ["there is no recording in nowhere"],
    "--num_steps=0": ["demonstrations"],
}


@clients
@pytest.mark.parametrize("argument", BAD)
def test_a_bad_argument_gets_one_line_status_2_and_no_folder(run, argument):
    status, out, err = run(argument)
    assert (status, out) == (2, "")
    assert re.fullmatch(r"kitchen-train: [^\n]+\n", err)
    assert all(part in err for part in BAD[argument]), err
    assert not os.path.exists("run")


BAD_FLAGS = {
    "--output=": ["--output"],
    "--num_steps=-1": ["0"],
    "--eval_interval=0": ["1"],
    "--seed=-1": ["negative"],
    "--hyperparameters=[1]": ["JSON object"],
    "--task_kwargs=3": ["JSON object"],
}


@pytest.mark.parametrize("argument", BAD_FLAGS)
def test_a_bad_flag_gets_one_line_and_status_2_even_without_the_extra(run, argument):
    status, out, err = run(argument)
    assert (status, out) == (2, "")
    assert re.fullmatch(r"kitchen-train: [^\n]+\n", err)
    assert all(part in err for part in BAD_FLAGS[argument]), err


def test_a_missing_output_is_named(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert train.main(TINY) == 2
    assert re.fullmatch(r"kitchen-train: [^\n]*--output[^\n]+\n", capsys.readouterr().err)
    assert os.listdir() == []


@pytest.mark.parametrize("missing", [["torch"], ["tensorboard"], ["tensorboard", "torch"]])
def test_a_missing_extra_names_what_to_install(run, monkeypatch, missing):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name in missing else object())
    status, out, err = run()
    assert (status, out) == (2, "")
    assert f"needs {' and '.join(missing)}: {installation.install_command('train')}" in err


@pytest.mark.parametrize("flag", ["--help", "-h"])
def test_help_lists_every_flag(run, flag):
    status, out, err = run(flag)
    assert (status, err) == (0, "")
    assert {*flag_lines(out)} == {*train.COMMAND.flags()} - {"h"}


@clients
@pytest.mark.rendering
def test_the_best_policy_is_filmed_at_the_end(run, monkeypatch):
    # The start and one more frame of the seven seconds.
    monkeypatch.setattr(video, "film", functools.partial(video.film, frames_per_second=0.2))
    status, out, err = run("--num_steps=64", "--video=film.mp4")
    assert (status, err) == (0, "")
    assert out.splitlines()[-1] == "video film.mp4"
    import imageio_ffmpeg

    assert imageio_ffmpeg.count_frames_and_secs("film.mp4")[0] == 2
    assert sorted(os.listdir()) == ["film.mp4", "run"]


@clients
def test_without_ffmpeg_a_video_is_refused_before_the_training(run, monkeypatch):
    def missing():
        raise ImportError("a video needs imageio-ffmpeg")

    monkeypatch.setattr("kitchen_suite.episodes.video.check_ffmpeg", missing)
    monkeypatch.setattr(gl, "prepare", lambda rendering: None)
    assert run("--video=film.mp4") == (2, "", "kitchen-train: a video needs imageio-ffmpeg\n")
    assert not os.path.exists("run")


@clients
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_after_a_signal_the_run_can_be_resumed(run, tmp_path, number):
    with open_process([*COMMAND, *TINY, f"--output={tmp_path / 'run'}", "--num_steps=1000000000"]) as process:
        while not rows(process.stdout.readline())[-1:] > [(0, 0)]:
            assert process.poll() is None
        process.send_signal(number)
        _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err == "kitchen-train: interrupted\n"
    checkpoints = [name for name in files("run/seed_0") if name.startswith("checkpoint")]
    assert len(checkpoints) >= 2
    assert not [name for name in files("run/seed_0") if name.startswith(".")]
    steps = int(checkpoints[-1][11:-3])
    status, out, _ = run("--resume", f"--num_steps={steps + 2 * BATCH}")
    assert status == 0
    assert rows(out) == [(0, steps + 2 * BATCH)]
    assert len([name for name in os.listdir("run/seed_0") if name.startswith("events.")]) == 2
