"""`kitchen-record` from the command line: the files, interrupts, and completing a recording."""

import functools
import json
import os
import re
import shutil
import signal
import sys
import time
from pathlib import Path

import dm_env
import gymnasium
import numpy as np
import pytest
from helpers.episodes import assert_same_arrays
from helpers.episodes import load_episode as load
from helpers.processes import open_process
from helpers.sweeps import brief

from kitchen_suite import files, policies
from kitchen_suite.commands import record, rollout
from kitchen_suite.episodes import report
from kitchen_suite.episodes.episode import flatten
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.gymnasium_env import KITCHEN_ID, OPEN_CABINET_ID
from kitchen_suite.policies.files import shipped_as
from kitchen_suite.tasks.open_cabinet import rewards as drawer_reward
from kitchen_suite.vector_env import base as vector_base

pytestmark = pytest.mark.full

COMMAND = [sys.executable, "-m", "kitchen_suite", "record"]
SHORT = ["--max_episode_steps=5"]
# The microwave's goal lies within its threshold from the start, the kettle's does not.
EASY = '--task_kwargs={"tasks_to_complete": ["microwave", "kettle"], "goals": {"microwave": [-0.2]}}'

POLICIES = """
import os

import numpy as np

def brake(timestep):
    # It depends on every element of the observation, on the reward, and on whether the episode has just begun.
    total = sum(value.sum() for value in timestep.observation.values())
    for value in timestep.observation.values():
        value[...] = np.nan
    return np.sin(np.arange(9) * total) + (0.1 if timestep.first() else timestep.reward)

def far(timestep):
    return np.full(9, 3.0)

def stop(timestep):
    if os.path.exists("stop") and not timestep.first():
        raise KeyboardInterrupt
    return np.zeros(9)

def too_great(timestep):
    return np.full(8, 1e300)

def broken(timestep):
    raise KeyError("lost")
"""


@pytest.fixture
def run(run, write_policies):
    """Runs the command in a folder that holds `my_policies.py`; returns status, stdout and stderr."""
    write_policies(POLICIES)
    return functools.partial(run, record, "--num_threads=1")


def load_all(folder):
    return {name: load(f"{folder}/{name}") for name in sorted(os.listdir(folder)) if name != "recording.json"}


def names(*indices):
    return [f"episode_{index:06d}.npz" for index in indices]


def played_alone(environment, policy_name, seed):
    """Returns the arrays of an episode, played by a loop over the single environment."""
    inner = environment.unwrapped.environment
    policy = policies.find(policy_name)(inner, np.random.default_rng((seed, 1)))
    observation, info = environment.reset(seed=seed)

    def row():
        state = {"physics_state": inner.physics.get_state()}
        return {**flatten(observation, "observation"), **flatten(info, "info"), **state}

    rows, steps = [row()], []
    ended = False
    while not ended:
        view = dict(zip(inner.task.task_observables, split(environment, observation), strict=True))
        timestep = dm_env.transition(steps[-1][1], view) if steps else dm_env.restart(view)
        action = policy(timestep).clip(environment.action_space.low, environment.action_space.high).astype(np.float32)
        observation, reward, terminated, truncated, info = environment.step(action)
        ended = terminated or truncated
        rows.append(row())
        steps.append((action, reward, terminated, truncated))
    columns = zip(("action", "reward", "termination", "truncation"), zip(*steps, strict=True), strict=True)
    arrays = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    return {**arrays, **{name: np.array(column) for name, column in columns}}


def split(environment, observation):
    """Returns copies of the parts of an observation, one for each of the suite environment's own."""
    if isinstance(observation, dict):
        parts = np.split(observation["observation"].copy(), [9, 18, 39])
        tasks = environment.unwrapped.composer_task.goals
        return parts + [observation[kind][task].copy() for kind in ("achieved_goal", "desired_goal") for task in tasks]
    return np.split(observation.copy(), [8, 16, 19, 23, 24])


@pytest.mark.parametrize(
    ("policy", "num_envs", "num_threads"),
    brief(
        [(policy, *sizes) for policy in ("random", "my_policies:brake") for sizes in ((1, 1), (3, 2))],
        kept=[("random", 1, 1), ("my_policies:brake", 3, 2)],
    ),
)
def test_an_episode_is_that_of_the_single_environment(run, policy, num_envs, num_threads):
    how = [f"--policy={policy}", f"--num_envs={num_envs}", f"--num_threads={num_threads}"]
    status, _, err = run("--output=runs", "--num_episodes=4", "--seed=3", EASY, *how, *SHORT)
    assert (status, err) == (0, "")
    environment = gymnasium.make(
        KITCHEN_ID,
        tasks_to_complete=["microwave", "kettle"],
        goals={"microwave": [-0.2]},
        info_format="arrays",
        max_episode_steps=5,
    )
    assert list(load_all("runs")) == names(*range(4))
    for index, (about, arrays) in enumerate(load_all("runs").values()):
        assert (about["episode"], about["seed"], about["steps"]) == (index, 3 + index, 5)
        assert about["results"] == {"success": False, "tasks_completed": {"microwave": 1}}
        assert about["total_reward"] == 1.0
        assert_same_arrays(arrays, played_alone(environment, policy, 3 + index))


@pytest.mark.parametrize("num_envs", brief([1, 3], kept=[3]))
def test_rewards_of_the_cabinet_do_not_depend_on_what_was_played_before(run, monkeypatch, num_envs):
    # The second episode of an environment would begin with the greater penalties.
    monkeypatch.setattr(drawer_reward, "LATE_STAGE", 6)
    status, _, err = run("--domain_name=open_cabinet", "--output=runs", "--num_episodes=5", f"--num_envs={num_envs}")
    assert (status, err) == (0, "")
    lengths = set()
    for index, (_, arrays) in enumerate(load_all("runs").values()):
        assert_same_arrays(arrays, played_alone(gymnasium.make(OPEN_CABINET_ID), "random", index))
        assert arrays["action"].dtype == np.float32
        lengths.add(len(arrays["reward"]))
    # They end at different times, so that environments are reset one by one.
    assert len(lengths) > 1


def test_actions_are_recorded_as_they_were_applied(run):
    assert run("--output=runs", "--num_episodes=1", "--policy=my_policies:far", *SHORT)[0] == 0
    _, arrays = load("runs/episode_000000.npz")
    np.testing.assert_array_equal(arrays["action"], np.ones((5, 9), np.float32))


def test_the_policy_acts_as_in_a_rollout(run):
    run("--output=runs", "--num_episodes=2", *SHORT)
    rollout.main(["--output=rolled", "--num_episodes=2", *SHORT])
    for name in names(0, 1):
        rolled = load(f"rolled/{name}")[1]["action"]
        np.testing.assert_array_equal(load(f"runs/{name}")[1]["action"], rolled.astype(np.float32))


def test_goals_may_be_flat(run):
    assert run("--output=runs", "--num_episodes=1", '--task_kwargs={"goal_format": "flat"}', *SHORT)[0] == 0
    assert run("--output=dict", "--num_episodes=1", *SHORT)[0] == 0
    _, arrays = load("runs/episode_000000.npz")
    _, others = load("dict/episode_000000.npz")
    assert arrays["observation/achieved_goal"].shape == (6, 11)
    np.testing.assert_array_equal(
        arrays["observation/achieved_goal"][:, 1:8], others["observation/achieved_goal/kettle"]
    )
    np.testing.assert_array_equal(arrays["action"], others["action"])


def test_seeds_may_be_of_any_size(run):
    assert run("--output=runs", "--num_episodes=2", f"--seed={10**30}", *SHORT)[0] == 0
    assert [about["seed"] for about, _ in load_all("runs").values()] == [10**30, 10**30 + 1]


def test_a_recording_holds_its_specification(run, tmp_path):
    status, out, _ = run("--output=runs", "--num_episodes=2", "--task_name=kettle", "--policy=zero", *SHORT)
    assert status == 0
    assert out.startswith(
        "kitchen kettle, policy zero, variations none, seeds from 0\n2 episodes in runs, 0 of them there already\n"
    )
    assert "\nepisodes              2\n" in out
    assert "\nsuccess rate          0% (0 of 2)\n" in out
    about = json.loads(tmp_path.joinpath("runs/recording.json").read_text(encoding="utf-8"))
    assert {"mujoco", "dm-control", "kitchen-suite", "numpy"} < about.pop("versions").keys()
    assert about == {
        "domain_name": "kitchen",
        "task_name": "kettle",
        "task_kwargs": {},
        "policy": "zero",
        "seed": 0,
        "seeding": "gymnasium",
        "max_episode_steps": 5,
    }


def test_an_interrupt_keeps_the_finished_episodes_and_the_same_command_completes_them(run, tmp_path):
    command = ["--output=runs", "--num_episodes=5", "--num_envs=2", "--policy=my_policies:stop", *SHORT]
    tmp_path.joinpath("stop").touch()
    assert run("--num_episodes=1", *command)[::2] == (
        130,
        "kitchen-record: interrupted\n",
    )
    assert list(load_all("runs")) == []
    tmp_path.joinpath("stop").unlink()
    assert run(*command, "--num_episodes=3")[0] == 0
    kept = load_all("runs")
    # A file that a killed process has left is neither read nor in the way.
    left = files.partial_path(tmp_path / "runs" / "episode_000004.npz")
    left.touch()
    status, out, _ = run(*command)
    assert status == 0
    assert "5 episodes in runs, 3 of them there already\n" in out
    assert "\nepisodes              5\n" in out
    assert sorted(os.listdir("runs")) == [left.name, *names(*range(5)), "recording.json"]
    assert {name: load(f"runs/{name}")[0]["seconds"] for name in kept} == {
        name: about["seconds"] for name, (about, _) in kept.items()
    }


def test_the_bar_counts_episodes_and_successes(run, monkeypatch):
    shown = []

    class Bar(report.EpisodeBar):
        def count(self, success):
            super().count(success)
            shown.append((self.n, self.total, self.postfix))

    monkeypatch.setattr("kitchen_suite.episodes.record.EpisodeBar", Bar)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    # So great that every task is complete after one step.
    easy = '--task_kwargs={"threshold": 9}'
    assert run("--output=runs", "--num_episodes=2", "--num_envs=1", easy)[0] == 0
    assert run("--output=runs", "--num_episodes=3", "--num_envs=1", easy)[0] == 0
    assert shown == [(1, 2, "success 100%"), (2, 2, "success 100%"), (3, 3, "success 100%")]


def test_a_complete_recording_is_left_alone(run):
    command = ["--output=runs", "--num_episodes=2", *SHORT]
    assert run(*command)[0] == 0
    before = load_all("runs")
    status, out, _ = run(*command)
    assert status == 0
    assert "2 episodes in runs, 2 of them there already\n" in out
    assert {name: about for name, (about, _) in load_all("runs").items()} == {
        name: about for name, (about, _) in before.items()
    }


def started(folder, *arguments):
    """Starts the command as a process; returns it once it has written three episodes of many."""
    process = open_process(
        [*COMMAND, f"--output={folder}", "--num_episodes=100000", "--num_envs=3", "--num_threads=1", *arguments]
    )
    while len(list(folder.glob("episode_*.npz"))) < 3:
        assert process.poll() is None
        time.sleep(0.01)
    return process


@pytest.mark.parametrize("number", brief([signal.SIGINT, signal.SIGTERM], kept=[signal.SIGTERM]))
def test_a_signal_keeps_the_finished_episodes(tmp_path, monkeypatch, number):
    monkeypatch.chdir(tmp_path)
    with started(tmp_path / "runs", *SHORT) as process:
        process.send_signal(number)
        out, err = process.communicate(timeout=60)
    count = len(load_all("runs"))
    assert count >= 3
    assert process.returncode == 130
    assert err == "kitchen-record: interrupted\n"
    assert f"\nepisodes              {count}\n" in out


def test_kill_9_loses_only_the_episodes_in_progress(run, tmp_path):
    with started(tmp_path / "runs", *SHORT) as process:
        process.kill()
        assert process.communicate(timeout=60)[1] == ""
    # Every file is whole, and the same command adds the others.
    count = len(list(tmp_path.glob("runs/episode_*.npz"))) + 2
    assert run("--output=runs", f"--num_episodes={count}", "--num_envs=2", *SHORT)[0] == 0
    assert sorted(os.listdir("runs")) == [*names(*range(count)), "recording.json"]
    assert run("--output=again", f"--num_episodes={count}", "--num_envs=3", *SHORT)[0] == 0
    for (_, one), (_, other) in zip(load_all("runs").values(), load_all("again").values(), strict=True):
        assert_same_arrays(one, other)


OTHER = {
    "--seed=1": ["runs", "seed 0", "1"],
    "--policy=zero": ['"random"', '"zero"'],
    "--task_name=mixed": ["task_name", "complete", "mixed"],
    "--max_episode_steps=6": ["max_episode_steps", "5", "6"],
    '--task_kwargs={"threshold": 1}': ["task_kwargs", "1"],
}


def test_a_folder_with_another_recording_is_refused(run):
    assert run("--output=runs", "--num_episodes=1", *SHORT)[0] == 0
    for argument, shown in OTHER.items():
        status, out, err = run("--output=runs", "--num_episodes=2", *SHORT, argument)
        assert (status, out, err.count("\n")) == (2, "", 1)
        assert all(part in err for part in shown), err
    assert list(load_all("runs")) == names(0)


def test_a_recording_made_with_another_mujoco_is_not_continued(run, tmp_path):
    run("--output=runs", "--num_episodes=1", *SHORT)
    path = tmp_path / "runs" / "recording.json"
    path.write_text(re.sub(r'"mujoco": "[^"]*"', '"mujoco": "3.0.0"', path.read_text()))
    status, _, err = run("--output=runs", "--num_episodes=2", *SHORT)
    assert status == 2
    assert '"mujoco": "3.0.0"' in err


def test_two_recordings_started_together_do_not_share_a_folder(run, tmp_path, monkeypatch):
    check_writable = files.check_writable

    def check_late(folder):
        # Another recording begins right before this one writes its specification.
        monkeypatch.setattr(files, "check_writable", check_writable)
        assert run("--output=runs", "--num_episodes=1", "--seed=5", *SHORT)[0] == 0

    monkeypatch.setattr(files, "check_writable", check_late)
    status, _, err = run("--output=runs", "--num_episodes=2", *SHORT)
    assert status == 2
    assert "runs holds a recording with seed 5, not 0" in err
    assert [about["seed"] for about, _ in load_all("runs").values()] == [5]
    assert json.loads(tmp_path.joinpath("runs/recording.json").read_text())["seed"] == 5


def test_a_recording_is_not_completed_with_another_policy_of_the_same_file_name(run, tmp_path):
    command = ["--output=runs", "--domain_name=open_cabinet", "--policy=trained(file='p.npz')", "--max_episode_steps=5"]
    shutil.copy(shipped_as("top_drawer"), tmp_path / "p.npz")
    assert run(*command, "--num_episodes=1")[0] == 0
    shutil.copy(shipped_as("top_drawer_grasp"), tmp_path / "p.npz")
    status, _, err = run(*command, "--num_episodes=2")
    assert (status, err.count("\n")) == (2, 1)
    assert "runs holds a recording with policy_sha256" in err
    assert list(load_all("runs")) == names(0)
    os.remove("p.npz")
    status, _, err = run(*command, "--num_episodes=2")
    assert status == 2
    assert "no such file: 'p.npz'" in err


@pytest.mark.parametrize("num_envs", brief([1, 2], kept=[2]))
def test_a_policy_file_replaced_in_the_middle_of_a_run_changes_no_episode(run, tmp_path, monkeypatch, num_envs):
    shutil.copy(shipped_as("top_drawer"), tmp_path / "p.npz")
    command = ["--domain_name=open_cabinet", "--policy=trained(file='p.npz')", "--num_episodes=3", *SHORT]
    assert run(*command, "--output=alone")[0] == 0
    append = Recording.append

    def replace(self, *arguments):
        append(self, *arguments)
        shutil.copy(shipped_as("top_drawer_grasp"), tmp_path / "p.npz")

    monkeypatch.setattr(Recording, "append", replace)
    assert run(*command, "--output=runs", f"--num_envs={num_envs}")[0] == 0
    for found, expected in zip(load_all("runs").values(), load_all("alone").values(), strict=True):
        assert_same_arrays(found[1], expected[1])


def test_a_policy_file_replaced_before_the_first_episode_is_refused(run, tmp_path, monkeypatch):
    shutil.copy(shipped_as("top_drawer"), tmp_path / "p.npz")
    make_vector_env = EpisodeSpec.make_vector_env

    def replace(self, *arguments):
        shutil.copy(shipped_as("top_drawer_grasp"), tmp_path / "p.npz")
        return make_vector_env(self, *arguments)

    monkeypatch.setattr(EpisodeSpec, "make_vector_env", replace)
    command = ["--domain_name=open_cabinet", "--policy=trained(file='p.npz')", "--num_episodes=1", *SHORT]
    status, _, err = run(*command, "--output=runs")
    assert (status, err.count("\n")) == (2, 1)
    assert "p.npz is not the file that the command began with" in err
    assert not Path("runs").exists()


MISFITS = {
    "episode": 3,
    "seed": 4,
    "steps": "five",
    "total_reward": None,
    "seconds": [],
    "results": {"success": 1.5},
    "instruction": None,
    "recording": {},
}


@pytest.mark.parametrize("name", brief(MISFITS, kept=["seed", "results"]))
def test_an_episode_of_another_recording_is_not_counted_as_its_own(run, name):
    assert run("--output=runs", "--num_episodes=2", *SHORT)[0] == 0
    about, arrays = load(f"runs/{names(1)[0]}")
    np.savez_compressed(f"runs/{names(1)[0]}", **arrays, metadata=json.dumps({**about, name: MISFITS[name]}))
    status, _, err = run("--output=runs", "--num_episodes=3", *SHORT)
    assert (status, err.count("\n")) == (1, 1)
    assert re.search(r"runs/episode_000001.npz|episode 1 in runs has metrics", err)


def test_an_episode_without_instruction_counts_and_has_the_empty_one(run):
    assert run("--output=runs", "--num_episodes=1", *SHORT)[0] == 0
    about, arrays = load(f"runs/{names(0)[0]}")
    assert about.pop("instruction").startswith("open the microwave door, then move the kettle")
    np.savez_compressed(f"runs/{names(0)[0]}", **arrays, metadata=json.dumps(about))
    assert run("--output=runs", "--num_episodes=2", *SHORT)[0] == 0
    folder = Recording.open(Path("runs"))
    assert folder.load(0).instruction == ""
    assert folder.load(1).instruction.startswith("open the microwave door, then move the kettle")


def test_a_folder_of_rollouts_is_refused(run):
    rollout.main(["--output=runs", "--num_episodes=1", *SHORT])
    before = load_all("runs")
    status, out, err = run("--output=runs", *SHORT)
    assert (status, out.count("\n\nseed")) == (2, 0)
    assert 'seeding "dm_control", not "gymnasium"' in err
    os.remove("runs/recording.json")
    status, _, err = run("--output=runs", *SHORT)
    assert (status, err.count("\n")) == (2, 1)
    assert "holds a recording already" in err
    assert load_all("runs")[names(0)[0]][0] == before[names(0)[0]][0]


def test_a_recording_is_refused_by_a_rollout(run, capsys, tmp_path):
    assert run("--output=runs", "--num_episodes=1", *SHORT)[0] == 0
    assert rollout.main(["--output=runs", "--num_episodes=1", *SHORT]) == 2
    assert "holds episodes already" in capsys.readouterr().err
    assert json.loads(tmp_path.joinpath("runs/recording.json").read_text(encoding="utf-8"))["seeding"] == "gymnasium"


def test_an_episode_whose_physics_diverges_is_left_out_and_named(run, monkeypatch):
    step = vector_base.SuiteVectorEnv.step_some
    count = 0

    def diverge(self, actions, mask):
        nonlocal count
        count += 1
        observations, rewards, terminations, truncations, infos = step(self, actions, mask)
        diverged = np.array([False, count == 2, False])
        return observations, rewards, terminations | diverged, truncations, infos | {"physics_error": diverged}

    monkeypatch.setattr(vector_base.SuiteVectorEnv, "step_some", diverge)
    status, out, err = run("--output=runs", "--num_episodes=6", "--num_envs=3", *SHORT)
    assert (status, err) == (1, "kitchen-record: the physics diverged in 1 episodes, left out: seeds [1]\n")
    assert "\nepisodes              5\n" in out
    assert list(load_all("runs")) == names(0, 2, 3, 4, 5)
    assert [len(arrays["reward"]) for _, arrays in load_all("runs").values()] == [5] * 5


def test_a_full_disk_gets_one_line(run, monkeypatch):
    def fail(file, **arrays):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", fail)
    status, out, err = run("--output=runs", "--num_episodes=1", *SHORT)
    assert (status, err) == (1, "kitchen-record: [Errno 28] No space left on device\n")
    assert out.endswith("\nno episode was finished\n")
    assert not os.path.exists("runs")


BAD = {
    "--num_episodes=0": "flag --num_episodes=0: ",
    "--num_envs=0": "flag --num_envs=0: ",
    "--num_threads=0": "flag --num_threads=0: ",
    "--max_episode_steps=0": "flag --max_episode_steps=0: ",
    "--seed=-1": "flag --seed=-1: ",
    "--policy=my_policies:lost": "has no attribute 'lost'",
    "--policy=my_policies:broken": "'my_policies:broken' raised KeyError: 'lost'",
    "--policy=my_policies:too_great": "returned a bad action",
    "--output=my_policies.py": "my_policies.py",
    '--task_kwargs={"disable_env_checker": true}': "unexpected keyword argument 'disable_env_checker'",
    "--num_threads=99999999999": "flag --num_threads=99999999999: ",
    '--task_kwargs={"threshold": -1}': "threshold must be",
    '--task_kwargs={"info_format": "lists"}': "info_format cannot be among the task_kwargs",
}


@pytest.mark.parametrize("argument", BAD)
def test_a_bad_argument_gets_one_line_and_status_2(run, argument):
    status, _, err = run("--output=runs", *SHORT, argument)
    assert status == 2
    assert re.fullmatch(r"kitchen-record: [^\n]+\n", err)
    assert BAD[argument] in err


def test_an_action_beyond_float32_is_refused(run):
    status, _, err = run("--output=runs", "--domain_name=open_cabinet", "--policy=my_policies:too_great")
    assert status == 2
    assert "does not fit into float32" in err


def test_arguments_that_the_task_fixes_are_refused(run):
    status, _, err = run("--output=runs", "--domain_name=open_cabinet", '--task_kwargs={"drawer": "bottom"}')
    assert status == 2
    assert "task 'top_drawer' fixes ['drawer']" in err


@pytest.mark.parametrize("argument", ["--policy=nowhere:act", "--task_name=nothing"])
def test_nothing_is_made_before_all_arguments_are_known_to_be_good(run, argument):
    assert run("--output=runs", argument)[:2] == (2, "")
    assert not os.path.exists("runs")
