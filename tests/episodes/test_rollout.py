"""`kitchen-rollout` from the command line: exit status, table, error messages, and files."""

import functools
import json
import os
import re
import signal
import subprocess
import sys

import numpy as np
import pytest
from absl import flags
from dm_control.rl import control
from helpers.episodes import assert_same_arrays, load_episode, nested
from helpers.processes import open_process
from helpers.sweeps import brief

from kitchen_suite import installation, suite
from kitchen_suite.commands import rollout
from kitchen_suite.environment import Environment
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.rendering import gl
from kitchen_suite.versions import installed_versions

COMMAND = [sys.executable, "-m", "kitchen_suite", "rollout"]
SHORT = ["--max_episode_steps=5"]
HINT = "Try next: kitchen-rollout --domain_name=open_cabinet --policy=trained\n"

POLICIES = """
import numpy as np

episode = 0

def act(timestep):
    return np.full(9, 0.1, np.float32)

def far(timestep):
    return np.full(9, 3.0 if timestep.first() else -3.0)

def act_and_overwrite(timestep):
    for value in timestep.observation.values():
        value[...] = np.nan
    return act(timestep)

def interrupt_second_episode(timestep):
    global episode
    episode += timestep.first()
    if episode == 2 and timestep.reward is not None:
        raise KeyboardInterrupt
    return np.zeros(9)

def wrong_shape(timestep):
    return np.zeros(3)

def not_finite(timestep):
    return np.full(9, np.nan)

def nothing(timestep):
    pass

def broken(timestep):
    raise KeyError("lost")

not_callable = 3
"""


@pytest.fixture
def run(run, write_policies):
    """Runs the command in a folder that holds `my_policies.py`; returns status, stdout and stderr."""
    write_policies(POLICIES)
    return functools.partial(run, rollout)


def rows(out):
    """Cells of the table, by column, without the time."""
    lines = out.split("\n\n")[1].splitlines()
    names, *values = (re.split(r"\s{2,}", line.strip()) for line in lines)
    table = [dict(zip(names, row, strict=True)) for row in values]
    # Two decimals: a short episode takes less.
    assert all(float(row.pop("seconds")) >= 0 for row in table)
    return table


def episode_files(folder):
    """Names of all files in a folder, hidden ones too, but for the specification, which has to be there."""
    files = sorted(os.listdir(folder))
    files.remove("recording.json")
    return files


@pytest.mark.full
def test_without_arguments_it_plays_three_random_episodes_of_the_benchmark(run):
    status, out, err = run()
    assert (status, err) == (0, "")
    assert out.startswith("kitchen complete, policy random, variations none\n")
    nothing = {"return": "0", "steps": "280", "success": "no", "tasks completed (at control step)": "none"}
    assert rows(out) == [{"episode": str(i), "seed": str(i), **nothing} for i in range(3)]
    summary = dict(re.split(r"\s{2,}", line) for line in out.split("\n\n")[2].splitlines())
    assert int(summary.pop("steps per second")) > 0
    assert summary == {
        "episodes": "3",
        "mean return": "0",
        "success rate": "0% (0 of 3)",
        "mean tasks completed": "0",
    }
    # Only the plain command names one to try next.
    assert out.endswith(f"\n\n{HINT}")


@pytest.mark.full
def test_completions_are_listed_with_their_control_steps(run):
    status, out, _ = run("--num_episodes=1", "--task_name=all", '--task_kwargs={"threshold": 9}', *SHORT)
    assert status == 0
    assert max(map(len, out.splitlines())) <= 100
    row = " ".join(out.split("\n\n")[1].split())
    assert re.search(
        r" 0 0 7 1 \d+\.\d\d yes bottom burner \(1\), top burner \(1\), .* microwave \(1\), kettle \(1\)$", row
    )
    assert "success rate          100% (1 of 1)\nmean tasks completed  7\n" in out


@pytest.mark.full
@pytest.mark.parametrize("seed", brief([7, 2**32 + 7, 10**30], kept=[10**30]))
def test_the_seed_fixes_the_table_and_the_files(run, seed):
    tables, actions = [], []
    for folder in ("one", "other"):
        status, out, _ = run(f"--seed={seed}", f"--output={folder}", "--num_episodes=2", *SHORT)
        assert status == 0
        tables.append(rows(out))
        actions.append(load_episode(f"{folder}/episode_000001.npz")[1]["action"])
    assert tables[0] == tables[1]
    assert [row["seed"] for row in tables[0]] == [str(seed), str(seed + 1)]
    np.testing.assert_array_equal(*actions)


@pytest.mark.full
def test_an_episode_is_the_same_alone_as_after_others(run):
    run("--seed=3", "--num_episodes=3", "--output=many", *SHORT)
    run("--seed=5", "--num_episodes=1", "--output=one", *SHORT)
    (one, alone), (other, after) = load_episode("one/episode_000000.npz"), load_episode("many/episode_000002.npz")
    assert one["seed"] == other["seed"] == 5
    assert_same_arrays(alone, after)


@pytest.mark.full
def test_the_policy_draws_from_a_stream_of_its_own(run):
    run("--num_episodes=1", "--output=random", *SHORT)
    run("--num_episodes=1", "--output=zero", "--policy=zero", *SHORT)
    (_, random), (_, zero) = (load_episode(f"{name}/episode_000000.npz") for name in ("random", "zero"))
    key = "observation/observation"
    np.testing.assert_array_equal(random[key][0], zero[key][0])
    assert (random[key][1, :9] != zero[key][1, :9]).all()
    assert not zero["action"].any()
    assert random["action"].std() > 0.4  # A uniform number in [-1, 1] has 0.58.


RECORDED = ("random", "my_policies:act", "my_policies:act_and_overwrite", "my_policies:far")


@pytest.mark.full
@pytest.mark.parametrize("policy", brief(RECORDED, kept=["my_policies:act_and_overwrite"]))
def test_an_episode_file_holds_what_suite_load_returns_when_the_actions_are_replayed(run, policy):
    task_kwargs = {"feedback": "true", "threshold": 0.5}
    arguments = ["--task_name=mixed", f"--task_kwargs={json.dumps(task_kwargs)}", f"--policy={policy}", "--seed=3"]
    status, _, _ = run(*arguments, "--num_episodes=2", "--output=new/runs", *SHORT)
    assert status == 0
    assert episode_files("new/runs") == [f"episode_00000{i}.npz" for i in range(2)]
    for index in range(2):
        metadata, arrays = load_episode(f"new/runs/episode_00000{index}.npz")
        spec = metadata.pop("recording")
        assert spec == {
            "domain_name": "kitchen",
            "task_name": "mixed",
            "task_kwargs": task_kwargs,
            "policy": policy,
            "seed": 3,
            "seeding": "dm_control",
            "max_episode_steps": 5,
            "versions": installed_versions(),
        }
        assert set(spec["versions"]) > {"kitchen-suite", "dm-control", "mujoco", "numpy", "gymnasium-robotics"}
        assert metadata.pop("seconds") > 0
        assert len(metadata.pop("actions_sha256")) == 64
        assert metadata == {
            "episode": index,
            "seed": 3 + index,
            "steps": 5,
            "total_reward": 1.0,
            "results": {"success": False, "tasks_completed": {"kettle": 1}},
            "instruction": "open the microwave door, then move the kettle to the top left burner, then turn on the "
            "bottom left burner, then turn on the light switch",
        }
        assert np.abs(arrays["action"]).max() <= 1.0
        assert_replays_in_suite_load(spec, 3 + index, arrays)
        tasks = [*nested(arrays, "observation/desired_goal", 0)]
        assert tasks == ["microwave", "kettle", "bottom burner", "light switch"]


def assert_replays_in_suite_load(spec, seed, arrays):
    environment = suite.load(
        spec["domain_name"], spec["task_name"], {**spec["task_kwargs"], "random": seed, "time_limit": 5 * 0.08}
    )
    timesteps = [environment.reset(), *map(environment.step, arrays["action"])]
    assert [timestep.last() for timestep in timesteps] == [False] * 5 + [True]
    assert arrays["action"].dtype == arrays["reward"].dtype == np.float64
    np.testing.assert_array_equal(arrays["reward"], [timestep.reward for timestep in timesteps[1:]])
    # Of the time limit alone.
    assert [timestep.discount for timestep in timesteps[1:]] == [1.0] * 5
    assert arrays["termination"].tolist() == [False] * 5
    assert arrays["truncation"].tolist() == [False] * 4 + [True]
    names = ("episode_step", "is_success", "task_distances", "completion_steps", "tasks_to_complete_mask")
    names += ("step_task_completions_mask", "episode_task_completions_mask")
    assert {name for name in arrays if name.startswith("info/")} == {f"info/{name}" for name in names}
    assert arrays["info/episode_step"].tolist() == [*range(6)]
    single = EpisodeSpec(**spec).make_environment().unwrapped
    for row, timestep in enumerate(timesteps):
        recorded = nested(arrays, "observation", row)
        goals = {
            f"{kind}/{task}": goal
            for kind in ("achieved_goal", "desired_goal")
            for task, goal in recorded[kind].items()
        }
        observation = {**single.observations.split(recorded["observation"]), **goals}
        assert list(observation) == list(environment.observation_spec())
        for key, part in environment.observation_spec().items():
            assert observation[key].dtype == part.dtype
            np.testing.assert_array_equal(observation[key], timestep.observation[key], key)


@pytest.mark.full
def test_completion_steps_are_in_the_file(run):
    run("--num_episodes=1", "--task_name=microwave", '--task_kwargs={"threshold": 9}', "--output=runs")
    metadata, arrays = load_episode("runs/episode_000000.npz")
    assert metadata["results"] == {"success": True, "tasks_completed": {"microwave": 1}}
    assert (arrays["reward"], arrays["termination"], arrays["truncation"]) == (1.0, True, False)


@pytest.mark.full
def test_actions_are_written_as_they_were_applied(run):
    assert run("--output=runs", "--num_episodes=1", "--policy=my_policies:far", *SHORT)[0] == 0
    _, arrays = load_episode("runs/episode_000000.npz")
    np.testing.assert_array_equal(arrays["action"], np.repeat([[1.0], [-1.0]], [1, 4], axis=0).repeat(9, axis=1))


@pytest.mark.full
def test_an_interrupt_keeps_the_finished_episodes(run):
    status, out, err = run("--policy=my_policies:interrupt_second_episode", "--output=runs", *SHORT)
    assert (status, err) == (130, "kitchen-rollout: interrupted\n")
    assert [row["episode"] for row in rows(out)] == ["0"]
    assert "\nepisodes              1\n" in out
    assert episode_files("runs") == ["episode_000000.npz"]
    assert len(load_episode("runs/episode_000000.npz")[1]["reward"]) == 5


@pytest.mark.full
def test_an_interrupt_while_a_file_is_written_leaves_no_part_of_it(run, monkeypatch):
    write = np.savez_compressed

    def interrupted_write(file, **arrays):
        if json.loads(str(arrays["metadata"]))["episode"] == 1:
            file.write(b"half")
            raise KeyboardInterrupt
        write(file, **arrays)

    monkeypatch.setattr(np, "savez_compressed", interrupted_write)
    assert run("--output=runs", *SHORT)[0] == 130
    assert episode_files("runs") == ["episode_000000.npz"]


@pytest.mark.full
def test_an_interrupt_at_the_beginning_of_an_array_is_an_interrupt(run, monkeypatch):
    def interrupt(*arguments):
        raise KeyboardInterrupt

    # Then zipfile cannot close the file, and raises a ValueError.
    monkeypatch.setattr("zipfile._get_compressor", interrupt)
    status, _, err = run("--output=runs", *SHORT)
    assert (status, err) == (130, "kitchen-rollout: interrupted\n")
    assert episode_files("runs") == []


@pytest.mark.full
def test_only_the_plain_command_names_one_to_try_next(run):
    assert HINT not in run(*SHORT)[1]


@pytest.mark.full
def test_a_full_disk_gets_one_line(run, monkeypatch):
    def fail(file, **arrays):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", fail)
    status, out, err = run("--output=runs", *SHORT)
    assert (status, err) == (1, "kitchen-rollout: [Errno 28] No space left on device\n")
    assert "no episode was finished" not in out
    assert not os.path.exists("runs")


@pytest.mark.full
def test_diverging_physics_gets_one_line(run, monkeypatch):
    def diverge(self, action):
        raise control.PhysicsError("Physics state has become invalid.")

    monkeypatch.setattr(Environment, "step", diverge)
    assert run()[::2] == (1, "kitchen-rollout: Physics state has become invalid.\n")


@pytest.mark.full
def test_episodes_are_never_overwritten(run):
    run("--num_episodes=1", "--output=runs", *SHORT)
    before = load_episode("runs/episode_000000.npz")[0]
    status, _, err = run("--seed=1", "--output=runs", *SHORT)
    assert (status, err.count("\n")) == (2, 1)
    assert "holds episodes already" in err
    assert load_episode("runs/episode_000000.npz")[0] == before


@pytest.mark.full
def test_a_policy_is_found_in_the_working_directory(run):
    status, out, _ = run("--policy=my_policies:act", "--num_episodes=1", *SHORT)
    assert status == 0
    assert out.startswith("kitchen complete, policy my_policies:act, variations none\n")


BAD = {
    "--num_episodes=0": "flag --num_episodes=0: ",
    "--seed=-1": "flag --seed=-1: ",
    "--max_episode_steps=0": "flag --max_episode_steps=0: ",
    "--domain_name=kitchn": "did you mean 'kitchen'?",
    "--task_name=ketle": "did you mean 'kettle'?",
    "--policy=rndom": "did you mean 'random'?",
    "--policy=": "choose from",
    "--policy=nowhere:act": "No module named 'nowhere'",
    "--policy=my_policies:lost": "has no attribute 'lost'",
    "--policy=my_policies:": "cannot be called",
    "--policy=my_policies:not_callable": "cannot be called: it is 3",
    "--policy=my_policies:wrong_shape": "'my_policies:wrong_shape' returned a bad action",
    "--policy=my_policies:not_finite": "'my_policies:not_finite' returned a bad action",
    "--policy=my_policies:nothing": "'my_policies:nothing' returned a bad action",
    "--policy=my_policies:broken": "'my_policies:broken' raised KeyError: 'lost'",
    "--camera=overvew": "did you mean 'overview'?",
    "--camera=99": "2 (overview)",
    "--camera=-1": "'overview'",
    "--output=my_policies.py": "is not a folder",
    "--output=my_policies.py/inside": "my_policies.py",
    "--output=": "is empty",
    "--video=film.avi": ".mp4",
    "--video_episodes=0": "flag --video_episodes=0: ",
    "--video_fps=0": "flag --video_fps=0: ",
    "--width=0": "flag --width=0: ",
    "--height=33": "even",
    '--task_kwargs={"goals": {"microwave": -0.4}}': "(1,), got shape (), the number -0.4",
    '--task_kwargs={"thresold": 1}': "'thresold' (did you mean 'threshold'?)",
    '--task_kwargs={"threshold": "x"}': "threshold must be a number, got 'x'",
    "--task_name=top_drawer": "'top_drawer' belongs to domain 'open_cabinet'",
}


@pytest.mark.parametrize("argument", BAD)
def test_a_bad_argument_gets_one_line_and_status_2(run, argument):
    status, _, err = run(argument)
    assert status == 2
    assert re.fullmatch(r"kitchen-rollout: [^\n]+\n", err)
    assert BAD[argument] in err


@pytest.mark.parametrize(
    "name",
    [
        "autoreset_mode",
        "info_format",
        "instructions",
        "max_episode_steps",
        "num_envs",
        "num_threads",
        "random",
        "render_mode",
        "time_limit",
        "visuals",
    ],
)
def test_an_argument_that_the_command_sets_itself_is_refused(run, name):
    status, out, err = run(f'--task_kwargs={{"{name}": 1, "threshold": 1}}', "--output=runs")
    assert (status, out) == (2, "")
    assert f"{name} cannot be among the task_kwargs" in err
    assert not os.path.exists("runs")


@pytest.mark.full
@pytest.mark.parametrize("argument", ["--camera=nowhere", "--policy=nowhere:act", "--task_name=nothing"])
def test_nothing_is_made_before_all_arguments_are_known_to_be_good(run, argument):
    status, out, _ = run(argument, "--output=runs")
    assert (status, out) == (2, "")
    assert not os.path.exists("runs")


@pytest.mark.full
def test_list_names_domains_tasks_and_cameras(run):
    status, out, err = run("--list")
    assert (status, err) == (0, "")
    words = set(re.split(r"[\s,]+", out))
    assert words > {"tasks", "cameras", "overview", "left", "right", "franka/wrist"}
    assert words > {name for pair in suite.ALL_TASKS for name in pair}
    assert max(map(len, out.splitlines())) <= 100


@pytest.mark.full
def test_flags_are_not_global_and_reset_before_each_run(run):
    assert rows(run("--seed=5", "--num_episodes=1", *SHORT)[1])[0]["seed"] == "5"
    assert rows(run("--num_episodes=1", *SHORT)[1])[0]["seed"] == "0"
    assert "num_episodes" not in flags.FLAGS


@pytest.mark.full
def test_a_video_without_ffmpeg_names_what_to_install(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    monkeypatch.setattr(gl, "prepare", lambda rendering: None)
    status, out, err = run("--video=film.mp4")
    assert (status, out) == (2, "")
    assert f"imageio-ffmpeg: {installation.install_command('video')}" in err


def in_a_process(*arguments, unset=(), **variables):
    environment = {name: value for name, value in os.environ.items() if name not in unset}
    return subprocess.run(arguments, env={**environment, **variables}, capture_output=True, text=True, timeout=60)


@pytest.mark.full
def test_as_a_process_it_does_the_same(run):
    process = in_a_process(*COMMAND, "--seed=4", *SHORT)
    assert (process.returncode, process.stderr) == (0, "")
    assert rows(process.stdout) == rows(run("--seed=4", *SHORT)[1])
    process = in_a_process(*COMMAND, "--sed=4")
    assert (process.returncode, process.stdout) == (2, "")
    assert re.fullmatch(r"kitchen-rollout: there is no flag --sed [^\n]+\n", process.stderr)


@pytest.mark.full
def test_without_a_video_no_gl_library_is_loaded():
    script = """
import sys
from kitchen_suite.commands import rollout
assert "dm_control" not in sys.modules
assert rollout.main(["--num_episodes=1", "--max_episode_steps=2"]) == 0
with open("/proc/self/maps", encoding="ascii") as maps:
    assert not [line for line in maps if any(name in line for name in ("libEGL", "libGL", "libOSMesa"))]
# Gymnasium-Robotics imports glfw, which loads no GL library before it is initialised.
assert "dm_control._render.glfw_renderer" not in sys.modules
"""
    process = in_a_process(sys.executable, "-c", script, unset=["MUJOCO_GL", "PYOPENGL_PLATFORM"])
    assert (process.returncode, process.stderr) == (0, "")


@pytest.mark.full
def test_a_gl_library_that_does_not_exist_is_an_error_for_videos_alone(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert in_a_process(*COMMAND, *SHORT, MUJOCO_GL="nonsense").returncode == 0
    process = in_a_process(*COMMAND, "--video=film.mp4", MUJOCO_GL="nonsense")
    assert (process.returncode, process.stdout) == (1, "")
    assert re.fullmatch(r"kitchen-rollout: .*MUJOCO_GL .nonsense. does not exist; choose from[^\n]+\n", process.stderr)


@pytest.mark.full
def test_a_reader_that_leaves_sees_no_traceback():
    with subprocess.Popen(
        [*COMMAND, "--num_episodes=1000", *SHORT], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "kitchen complete, policy random, variations none\n"
        process.stdout.close()
        assert process.wait(timeout=60) == 141
        assert process.stderr.read() == ""


@pytest.mark.full
@pytest.mark.parametrize("number", brief([signal.SIGINT, signal.SIGTERM], kept=[signal.SIGINT]))
def test_a_signal_keeps_the_finished_episodes(tmp_path, number):
    with open_process([*COMMAND, "--num_episodes=100000", f"--output={tmp_path}", *SHORT]) as process:
        while not re.match(r" +2 ", process.stdout.readline()):
            assert process.poll() is None
        process.send_signal(number)
        _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert re.fullmatch(r"kitchen-rollout: interrupted\n", err)
    files = episode_files(tmp_path)
    assert len(files) >= 3
    assert files == [f"episode_{i:06d}.npz" for i in range(len(files))]
    assert load_episode(tmp_path / files[-1])[0]["episode"] == len(files) - 1
