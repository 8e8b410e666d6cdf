"""`kitchen-play` as its user meets it: exit status, table, last line, video."""

import contextlib
import os
import re
import signal
import subprocess
import sys

import imageio.v2 as imageio
import numpy as np
import pytest
from dm_control.rl import control

from kitchen_suite.cli import play
from kitchen_suite.environment import Environment
from kitchen_suite.policies import trained as trained_policy
from kitchen_suite.policies.trained import TrainedPolicy
from kitchen_suite.rendering import gl

COMMAND = [sys.executable, "-m", "kitchen_suite.cli.play"]
OBSERVED, ACTED = 25, 8


def write_policy(path, **task_kwargs):
    """A policy that always does the same: it moves the robot a little, for ten control steps if nothing is said."""
    TrainedPolicy(
        mean=np.zeros(OBSERVED, np.float32),
        deviation=np.ones(OBSERVED, np.float32),
        clip=5.0,
        weights=(np.zeros((ACTED, OBSERVED), np.float32),),
        biases=(np.ones(ACTED, np.float32),),
        action_scale=np.full(ACTED, 0.01, np.float32),
        metadata={
            "domain_name": "open_cabinet",
            "task_name": "top_drawer",
            "task_kwargs": {"time_limit": 0.1, **task_kwargs},
        },
    ).save(path)


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    """Runs the command in a folder that holds `policy.npz`; gives status, stdout and stderr."""
    monkeypatch.chdir(tmp_path)
    write_policy(tmp_path / "policy.npz")

    def run(*arguments, file="policy.npz"):
        status = play.main([f"--policy_file={file}", *arguments])
        return status, *capsys.readouterr()

    return run


def rows(out):
    """Lines of the table, without its heading and the time."""
    return [re.sub(r"\d+\.\d\d ", "", line) for line in out.split("\n\n")[1].splitlines()[1:]]


def test_the_last_line_counts_successes(run):
    status, out, err = run("--novideo", "--num_episodes=3")
    assert (status, err) == (0, "")
    assert out.startswith("open_cabinet top_drawer, policy trained(file='policy.npz')\n")
    assert len(rows(out)) == 3
    assert out.splitlines()[-1] == "success 0/3"
    assert os.listdir() == ["policy.npz"]


def test_episodes_that_succeed_are_counted(run, monkeypatch):
    seeds = []

    def results(self):
        seeds.append(len(seeds))
        return {"success": seeds[-1] != 1}

    monkeypatch.setattr("kitchen_suite.tasks.OpenCabinetTask.episode_results", property(results))
    assert run("--novideo", "--num_episodes=4")[1].endswith("\nsuccess 3/4\n")


def test_ten_episodes_are_played_from_seed_0_on(run):
    status, out, _ = run("--novideo")
    assert status == 0
    assert [row.split()[:2] for row in rows(out)] == [[str(i), str(i)] for i in range(10)]
    assert out.splitlines()[-1] == "success 0/10"


def test_the_seed_fixes_the_table(run):
    _, one, _ = run("--novideo", "--seed=4", "--num_episodes=2")
    _, other, _ = run("--novideo", "--seed=4", "--num_episodes=2")
    assert rows(one) == rows(other)
    assert [row.split()[1] for row in rows(one)] == ["4", "5"]


def test_the_task_is_that_of_the_policys_file(run, tmp_path):
    write_policy(tmp_path / "other.npz", reward="grasp", gripper="deterministic", time_limit=0.05)
    status, out, _ = run("--novideo", "--num_episodes=1", file="other.npz")
    assert status == 0
    assert rows(out)[0].split()[3] == "5"


def test_without_a_file_it_plays_what_comes_with_the_package(run, tmp_path, monkeypatch):
    write_policy(tmp_path / "top_drawer.npz")
    monkeypatch.setattr(trained_policy, "SHIPPED", tmp_path)
    status, out, _ = run("--novideo", "--num_episodes=1", file="")
    assert status == 0
    assert "top_drawer.npz" in out.splitlines()[0]


def test_another_policy_that_comes_with_the_package_is_played_by_name(run, tmp_path, monkeypatch):
    write_policy(tmp_path / "top_drawer_grasp.npz", reward="grasp", time_limit=0.03)
    monkeypatch.setattr(trained_policy, "SHIPPED", tmp_path)
    status, out, _ = run("--novideo", "--num_episodes=1", "--shipped=top_drawer_grasp", file="")
    assert status == 0
    assert "top_drawer_grasp.npz" in out.splitlines()[0]
    assert rows(out)[0].split()[3] == "3"


def test_a_policy_that_does_not_come_with_the_package_is_told_with_those_that_do(run):
    status, _, err = run("--novideo", "--shipped=top_draw", file="")
    assert status == 2
    assert "did you mean 'top_drawer'?); choose from ['top_drawer', 'top_drawer_grasp']" in err


BAD = {
    "--policy_file=nothing.npz": "nothing.npz",
    "--shipped=top_drawer": "--shipped and --policy_file both name a policy",
    "--policy_file=text.npz": "text.npz does not hold a trained policy",
    "--policy_file=.": "directory",
    "--policy_file=strange.npz": "unexpected keyword argument 'griper'",
    "--num_episodes=0": "positive",
    "--seed=-1": "non-negative",
    "--video_episodes=0": "positive",
    "--video_file=film.avi": ".mp4",
    "--video_file=nowhere/film.mp4": "there is no folder 'nowhere'",
    "--camera=overvew": "did you mean 'overview'?",
    "--colour=red": "Unknown command line flag 'colour'",
    "all": "unexpected argument 'all'",
}


@pytest.mark.parametrize("argument", BAD)
def test_a_bad_argument_gets_one_line_and_status_2(run, tmp_path, argument):
    tmp_path.joinpath("text.npz").write_text("no policy")
    write_policy(tmp_path / "strange.npz", griper="sampled")
    status, out, err = run("--novideo", argument)
    assert (status, out) == (2, "")
    assert re.fullmatch(r"kitchen-play: [^\n]+\n", err)
    assert BAD[argument] in err


def test_a_policy_of_other_sizes_gets_one_line_and_status_2(run, tmp_path):
    path = tmp_path / "policy.npz"
    policy = TrainedPolicy.load(path)
    known = {**policy.metadata, "domain_name": "kitchen", "task_name": "kettle", "task_kwargs": {}}
    TrainedPolicy(**{**vars(policy), "metadata": known}).save(path)
    status, _, err = run("--novideo")
    assert status == 2
    assert re.fullmatch(r"kitchen-play: [^\n]+ takes 25 numbers and returns 8, but this task shows 73 [^\n]+\n", err)


def test_diverging_physics_is_told_in_one_line(run, monkeypatch):
    def diverge(self, action):
        raise control.PhysicsError("Physics state has become invalid.")

    monkeypatch.setattr(Environment, "step", diverge)
    assert run("--novideo")[::2] == (1, "kitchen-play: Physics state has become invalid.\n")


def test_a_video_without_ffmpeg_names_what_to_install(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    monkeypatch.setattr(gl, "prepare", lambda rendering: None)
    status, out, err = run()
    assert (status, out) == (2, "")
    assert err == "kitchen-play: a video needs imageio-ffmpeg: pip install 'kitchen-suite[video]'\n"


@pytest.mark.parametrize("flag", ["--help", "-h"])
def test_help_tells_of_every_flag(run, flag):
    status, out, err = run(flag)
    assert (status, err) == (0, "")
    for name in ("policy_file", "num_episodes", "seed", "[no]video", "video_file", "video_episodes", "camera"):
        assert f"--{name}: " in out


@pytest.mark.rendering
def test_the_first_episodes_are_filmed(run):
    status, out, err = run("--num_episodes=3", "--video_episodes=1", "--video_file=film.mp4")
    assert (status, err) == (0, "")
    assert out.splitlines()[-2:] == ["video film.mp4", "success 0/3"]
    with contextlib.closing(imageio.get_reader("film.mp4")) as reader:
        assert reader.get_meta_data()["fps"] == 12.5
        # Ten control steps of 0.01 s: the start, and the eighth.
        assert [frame.shape for frame in reader] == [(480, 640, 3)] * 2


def test_without_a_video_no_gl_library_is_loaded(run):
    script = """
import sys
from kitchen_suite import play
assert "dm_control" not in sys.modules
assert play.main(["--policy_file=policy.npz", "--novideo"]) == 0
with open("/proc/self/maps", encoding="ascii") as maps:
    assert not [line for line in maps if any(name in line for name in ("libEGL", "libGL", "libOSMesa", "glfw"))]
"""
    variables = {name: value for name, value in os.environ.items() if name not in ("MUJOCO_GL", "PYOPENGL_PLATFORM")}
    process = subprocess.run([sys.executable, "-c", script], env=variables, capture_output=True, text=True, timeout=60)
    assert (process.returncode, process.stderr) == (0, "")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_is_told_in_one_line(tmp_path, number):
    write_policy(tmp_path / "policy.npz")
    with subprocess.Popen(
        [*COMMAND, f"--policy_file={tmp_path / 'policy.npz'}", "--novideo", "--num_episodes=100000"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A shell's background jobs ignore SIGINT, and hand that down to what they start.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as process:
        while not re.match(r" +2 ", process.stdout.readline()):
            assert process.poll() is None
        process.send_signal(number)
        out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert re.fullmatch(r"kitchen-play: interrupted after \d+ of 100000 episodes\n", err)
    assert "success rate" in out
