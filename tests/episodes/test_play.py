"""`kitchen-play` from the command line: exit status, table, last line, video."""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import warnings

import imageio.v2 as imageio
import numpy as np
import pytest
from dm_control.rl import control
from helpers.processes import open_process

from kitchen_suite import installation
from kitchen_suite.commands import play, rollout
from kitchen_suite.environment import Environment
from kitchen_suite.policies import files as policy_files
from kitchen_suite.policies.perceptron import PerceptronPolicy
from kitchen_suite.rendering import gl

COMMAND = [sys.executable, "-m", "kitchen_suite", "play"]
OBSERVATION_SIZE, ACTION_SIZE = 25, 8


SMALL = ("--width=96", "--height=70")


def write_policy(path, task_name="top_drawer", metadata=None, **task_kwargs):
    """Writes a policy whose action is constant: it moves the robot a little."""
    PerceptronPolicy(
        mean=np.zeros(OBSERVATION_SIZE, np.float32),
        deviation=np.ones(OBSERVATION_SIZE, np.float32),
        clip=5.0,
        weights=(np.zeros((ACTION_SIZE, OBSERVATION_SIZE), np.float32),),
        biases=(np.ones(ACTION_SIZE, np.float32),),
        action_scale=np.full(ACTION_SIZE, 0.01, np.float32),
        metadata={
            "domain_name": "open_cabinet",
            "task_name": task_name,
            "task_kwargs": task_kwargs,
            **(metadata or {}),
        },
    ).save(path)


@pytest.fixture
def run(capsys, tmp_path, monkeypatch):
    """Runs the command for short episodes in a folder with `policy.npz`; returns status, stdout and stderr."""
    monkeypatch.chdir(tmp_path)
    write_policy(tmp_path / "policy.npz")

    def run(*arguments, file="policy.npz"):
        named = [] if file is None else [f"--policy_file={file}"]
        status = play.main([*named, "--max_episode_steps=10", *arguments])
        return status, *capsys.readouterr()

    return run


def successes(out):
    """Returns numbers of successes and of episodes, wherever they are printed."""
    found = re.findall(r"^success(?: rate +\S+ \(| )(\d+)(?: of |/)(\d+)", out, re.MULTILINE)
    return [(int(count), int(episodes)) for count, episodes in found]


def rows(out):
    """Lines of the table, without its heading and the duration."""
    return [re.sub(r"\d+\.\d\d ", "", line) for line in out.split("\n\n")[1].splitlines()[1:]]


def test_successes_are_counted_once(run):
    status, out, err = run("--novideo", "--num_episodes=3")
    assert (status, err) == (0, "")
    assert out.startswith("open_cabinet top_drawer, policy trained(file='policy.npz'), variations none\n")
    assert len(rows(out)) == 3
    assert successes(out) == [(0, 3)]
    assert os.listdir() == ["policy.npz"]


def test_the_path_of_a_policy_may_have_a_colon(run, tmp_path):
    write_policy(tmp_path / "run-12:30.npz")
    status, out, err = run("--novideo", "--num_episodes=1", file="run-12:30.npz")
    assert (status, err) == (0, "")
    assert successes(out) == [(0, 1)]


def test_episodes_that_succeed_are_counted(run, monkeypatch):
    seeds = []

    def metrics(self, infos):
        seeds.append(len(seeds))
        return {"success": seeds[-1] != 1}

    monkeypatch.setattr("kitchen_suite.tasks.metrics.OpeningRecords.metrics", metrics)
    assert successes(run("--novideo", "--num_episodes=4")[1]) == [(3, 4)]
    assert seeds == [0, 1, 2, 3]


def test_ten_episodes_are_played_from_seed_0_on(run):
    status, out, _ = run("--novideo")
    assert status == 0
    assert [row.split()[:2] for row in rows(out)] == [[str(i), str(i)] for i in range(10)]
    assert successes(out) == [(0, 10)]


@pytest.mark.full
def test_the_seed_fixes_the_table(run):
    _, one, _ = run("--novideo", "--seed=4", "--num_episodes=2")
    _, other, _ = run("--novideo", "--seed=4", "--num_episodes=2")
    assert rows(one) == rows(other)
    assert [row.split()[1] for row in rows(one)] == ["4", "5"]


@pytest.mark.full
def test_the_number_of_control_steps_can_be_limited(run):
    steps = [row.split()[3] for row in rows(run("--novideo", "--num_episodes=2")[1])]
    assert steps == ["10", "10"]
    steps = [row.split()[3] for row in rows(run("--novideo", "--num_episodes=2", "--max_episode_steps=7")[1])]
    assert steps == ["7", "7"]


@pytest.mark.full
def test_the_task_is_that_of_the_policys_file(run, tmp_path, capsys):
    task_kwargs = {"action_limit": 0.004, "gripper": "deterministic"}
    write_policy(tmp_path / "other.npz", task_name="bottom_drawer", **task_kwargs)
    status, out, _ = run("--novideo", "--num_episodes=1", file="other.npz")
    assert status == 0
    assert out.startswith("open_cabinet bottom_drawer, policy trained(file='other.npz'), variations none\n")
    command = ["--domain_name=open_cabinet", "--task_name=bottom_drawer", "--policy=trained(file='other.npz')"]
    command += ["--num_episodes=1", "--max_episode_steps=10"]
    tables = []
    for arguments in ([f"--task_kwargs={json.dumps(task_kwargs)}"], []):
        assert rollout.main([*command, *arguments]) == 0
        tables.append(rows(capsys.readouterr().out))
    assert rows(out) == tables[0] != tables[1]


def test_a_policy_of_another_task_is_warned_of(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_policy(tmp_path / "policy.npz")
    command = ["--domain_name=open_cabinet", "--num_episodes=1", "--max_episode_steps=2"]
    command += ["--policy=trained(file='policy.npz')"]
    with pytest.warns(UserWarning, match="open_cabinet top_drawer, not for open_cabinet bottom_drawer"):
        assert rollout.main([*command, "--task_name=bottom_drawer"]) == 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert rollout.main([*command, "--task_name=top_drawer"]) == 0


def test_a_policy_of_a_task_that_does_not_exist_here_is_played(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_policy(tmp_path / "policy.npz", task_name="third_drawer")
    command = ["--domain_name=open_cabinet", "--num_episodes=1", "--max_episode_steps=2"]
    assert rollout.main([*command, "--policy=trained(file='policy.npz')"]) == 0


def test_without_a_file_it_plays_the_policy_that_grasps(run, tmp_path, monkeypatch):
    write_policy(tmp_path / "top_drawer_grasp.npz")
    monkeypatch.setattr(policy_files, "SHIPPED", tmp_path)
    status, out, _ = run("--novideo", "--num_episodes=1", file=None)
    assert status == 0
    assert "top_drawer_grasp.npz" in out.splitlines()[0]


def test_other_policies_that_come_with_the_package_are_played_by_name(run, tmp_path, monkeypatch):
    write_policy(tmp_path / "bottom.npz", task_name="bottom_drawer", reward="grasp")
    monkeypatch.setattr(policy_files, "SHIPPED", tmp_path)
    status, out, _ = run("--novideo", "--num_episodes=1", "--shipped=bottom", file=None)
    assert status == 0
    assert out.startswith("open_cabinet bottom_drawer, policy trained(file='")
    assert "bottom.npz" in out.splitlines()[0]


def test_an_unknown_shipped_policy_is_refused_with_a_list_of_those_that_exist(run):
    status, _, err = run("--novideo", "--shipped=top_draw", file=None)
    assert status == 2
    assert "did you mean 'top_drawer'?); choose from ['bottom_burner', " in err
    assert "'top_drawer', 'top_drawer_grasp']" in err


def test_the_list_names_the_physics_of_training_and_of_the_success(run, tmp_path, monkeypatch):
    shipped = tmp_path / "shipped"
    shipped.mkdir()
    trained = {"training": {"success": 0.98}}
    write_policy(shipped / "carried_over.npz", metadata={**trained, "training_kwargs": {"physics": "fast"}})
    write_policy(shipped / "exact.npz", metadata={**trained, "training_kwargs": None})
    write_policy(shipped / "fast.npz", metadata=trained, physics="fast")
    monkeypatch.setattr(policy_files, "SHIPPED", shipped)
    status, out, _ = run("--list", file=None)
    assert status == 0
    rows = [re.split(r"\s{2,}", line.strip()) for line in out.splitlines()]
    assert rows[0][:4] == ["--shipped", "task", "trained in", "success"]
    assert {name: (physics, success) for name, _, physics, success, *_ in rows[2:]} == {
        "carried_over": ("fast", "98% in exact"),
        "exact": ("exact", "98% in exact"),
        "fast": ("fast", "98% in fast"),
    }


BAD = {
    "--policy_file=nothing.npz": "nothing.npz",
    "--shipped=top_drawer": "shipped and policy_file both name a policy",
    "--policy_file=text.npz": "text.npz does not hold a trained policy",
    "--policy_file=.": "directory",
    "--policy_file=strange.npz": "unexpected keyword argument 'griper' (did you mean 'gripper'?)",
    "--policy_file=limited.npz": "time_limit cannot be among the task_kwargs",
    "--camera=overvew": "did you mean 'overview'?",
    "--video=film.mp4": "video and novideo contradict each other",
}


@pytest.mark.parametrize("argument", BAD)
def test_a_bad_argument_gets_one_line_and_status_2(run, tmp_path, argument):
    tmp_path.joinpath("text.npz").write_text("no policy")
    write_policy(tmp_path / "strange.npz", griper="sampled")
    write_policy(tmp_path / "limited.npz", time_limit=0.1)
    status, out, err = run("--novideo", *argument.split())
    # A damaged file, or a folder in place of one, is a failure to read.
    assert (status, out) == (1 if "text.npz" in argument else 2, "")
    assert re.fullmatch(r"kitchen-play: [^\n]+\n", err)
    assert BAD[argument] in err


@pytest.mark.full
def test_a_policy_of_other_sizes_gets_one_line_and_status_2(run, tmp_path):
    path = tmp_path / "policy.npz"
    policy = PerceptronPolicy.load(path)
    known = {**policy.metadata, "domain_name": "kitchen", "task_name": "kettle", "task_kwargs": {}}
    PerceptronPolicy(**{**vars(policy), "metadata": known}).save(path)
    status, _, err = run("--novideo")
    assert status == 2
    assert re.fullmatch(
        r"kitchen-play: [^\n]+ 25 observed numbers to 8 [^\n]+, but this task has 73 and 9[^\n]+\n", err
    )


def test_diverging_physics_gets_one_line(run, monkeypatch):
    def diverge(self, action):
        raise control.PhysicsError("Physics state has become invalid.")

    monkeypatch.setattr(Environment, "step", diverge)
    assert run("--novideo")[::2] == (1, "kitchen-play: Physics state has become invalid.\n")


NO_FFMPEG = "a video needs imageio-ffmpeg: "


def test_a_video_without_ffmpeg_names_what_to_install(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    monkeypatch.setattr(gl, "prepare", lambda rendering: None)
    assert run("--video=film.mp4") == (2, "", f"kitchen-play: {NO_FFMPEG}{installation.install_command('video')}\n")


def without_ffmpeg(monkeypatch):
    monkeypatch.setattr(gl, "can_render", lambda library: True)
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)


def without_gl(monkeypatch):
    monkeypatch.setattr(gl, "can_render", lambda library: False)


def without_a_free_name(monkeypatch):
    monkeypatch.setattr(gl, "can_render", lambda library: True)
    os.mkdir("kitchen-play.mp4")


@pytest.mark.parametrize(
    ("prepare", "reason"),
    [
        (without_gl, "nothing can be rendered here with MUJOCO_GL="),
        (without_ffmpeg, NO_FFMPEG),
        (without_a_free_name, "kitchen-play.mp4 is a folder"),
    ],
)
def test_a_default_video_that_cannot_be_made_is_left_out_with_one_line(run, monkeypatch, prepare, reason):
    prepare(monkeypatch)
    status, out, err = run("--num_episodes=1")
    assert (status, err) == (0, "")
    assert len(rows(out)) == 1
    assert out.splitlines()[-1].startswith(f"no video: {reason}")
    assert successes(out) == [(0, 1)]


def test_a_video_that_is_asked_for_is_an_error_where_nothing_can_be_rendered(run, monkeypatch):
    without_gl(monkeypatch)
    status, out, err = run("--num_episodes=1", "--video=film.mp4")
    assert (status, out) == (1, "")
    assert err.startswith("kitchen-play: nothing can be rendered here with MUJOCO_GL=")


@pytest.mark.full
@pytest.mark.rendering
def test_the_first_episodes_are_filmed(run):
    status, out, err = run("--num_episodes=3", "--video_episodes=1", "--video=film.mp4", *SMALL)
    assert (status, err) == (0, "")
    assert out.splitlines()[-1] == "video film.mp4"
    assert successes(out) == [(0, 3)]
    with contextlib.closing(imageio.get_reader("film.mp4")) as reader:
        assert reader.get_meta_data()["fps"] == 12.5
        # Ten control steps of 0.01 s: the start, and the eighth.
        assert [frame.shape for frame in reader] == [(70, 96, 3)] * 2


@pytest.mark.full
@pytest.mark.rendering
def test_by_default_the_first_episode_is_filmed(run):
    status, out, err = run("--num_episodes=2", "--max_episode_steps=1", *SMALL)
    assert (status, err) == (0, "")
    assert out.splitlines()[-1] == "video kitchen-play.mp4"
    assert successes(out) == [(0, 2)]
    with contextlib.closing(imageio.get_reader("kitchen-play.mp4")) as reader:
        assert sum(1 for _ in reader) == 1


@pytest.mark.full
def test_without_a_video_no_gl_library_is_loaded(run):
    script = """
import sys
from kitchen_suite.commands import play
assert "dm_control" not in sys.modules
assert play.main(["--policy_file=policy.npz", "--novideo", "--num_episodes=1", "--max_episode_steps=5"]) == 0
with open("/proc/self/maps", encoding="ascii") as maps:
    assert not [line for line in maps if any(name in line for name in ("libEGL", "libGL", "libOSMesa"))]
# Gymnasium-Robotics imports glfw, which loads no GL library before it is initialised.
assert "dm_control._render.glfw_renderer" not in sys.modules
"""
    variables = {name: value for name, value in os.environ.items() if name not in ("MUJOCO_GL", "PYOPENGL_PLATFORM")}
    process = subprocess.run([sys.executable, "-c", script], env=variables, capture_output=True, text=True, timeout=60)
    assert (process.returncode, process.stderr) == (0, "")


@pytest.mark.full
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_gets_one_line_and_the_summary(tmp_path, number):
    write_policy(tmp_path / "policy.npz")
    with open_process(
        [
            *COMMAND,
            f"--policy_file={tmp_path / 'policy.npz'}",
            "--novideo",
            "--num_episodes=100000",
            "--max_episode_steps=10",
        ],
    ) as process:
        while not re.match(r" +2 ", process.stdout.readline()):
            assert process.poll() is None
        process.send_signal(number)
        out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert re.fullmatch(r"kitchen-play: interrupted\n", err)
    assert "success rate" in out
