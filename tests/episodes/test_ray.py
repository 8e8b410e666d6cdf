"""Workers on Ray: episodes equal those of one process, whichever workers die, and no process is left over."""

import contextlib
import json
import os
import secrets
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest
from helpers.processes import open_process, wait_until

import kitchen_suite
from kitchen_suite.commands import evaluate, record, rollout
from kitchen_suite.episodes.cluster import Cluster
from kitchen_suite.vector_env.base import processors

pytestmark = pytest.mark.ray

SHORT = "--max_episode_steps=20"
WORKERS = "--workers=2"
RAY = [sys.executable, "-c", "from ray.scripts.scripts import main; main()"]

POLICIES = """
import os
import signal
from pathlib import Path

import numpy as np

def die_once(timestep):
    if timestep.first() and Path("FOLDER", "mortal").exists():
        Path("FOLDER", "mortal").unlink()
        os.kill(os.getpid(), signal.SIGKILL)
    return np.full(9, 0.1)

def die(timestep):
    os.kill(os.getpid(), signal.SIGKILL)

def broken(timestep):
    raise KeyError("lost")
"""

# Four actions of the last chunk are left over at the end of an episode of twenty control steps.
MEMORY = """
import numpy as np

class Chunks:
    def __init__(self):
        self.waiting = []

    def reset(self):
        self.waiting = []

    def __call__(self, timestep):
        if not self.waiting:
            seen = timestep.observation["franka/joint_positions"]
            self.waiting = [0.3 * np.sin(9.0 * seen + number) for number in range(8)]
        return self.waiting.pop(0)

chunks = Chunks()
"""


@pytest.fixture
def run(run, folder, write_policies):
    """Runs a command in a folder that holds `my_policies.py`; returns its status, stdout and stderr."""
    write_policies(POLICIES.replace("FOLDER", str(folder)))
    return run


def load_all(folder):
    episodes = {}
    for path in sorted(Path(folder).glob("episode_*.npz")):
        with np.load(path, allow_pickle=False) as file:
            arrays = dict(file)
        about = json.loads(str(arrays.pop("metadata")))
        about.pop("seconds", None)
        episodes[path.name] = about, arrays
    return episodes


def assert_same_episodes(one, other):
    one, other = load_all(one), load_all(other)
    assert one.keys() == other.keys()
    for name, (about, arrays) in one.items():
        assert about == other[name][0]
        assert arrays.keys() == other[name][1].keys()
        for key, array in arrays.items():
            np.testing.assert_array_equal(array, other[name][1][key], key)


def test_a_recording_by_workers_is_that_of_one_process(run):
    command = ["--domain_name=open_cabinet", "--num_episodes=9", "--num_envs=2", "--seed=3"]
    status, out, err = run(record, "--output=many", WORKERS, *command)
    assert (status, err) == (0, "")
    assert "\nepisodes " in out
    assert run(record, "--output=one", *command)[0] == 0
    assert len(load_all("many")) == 9
    assert_same_episodes("many", "one")


def test_a_rollout_by_workers_is_that_of_one_process(run):
    command = ["--num_episodes=5", "--max_episode_steps=5"]
    status, out, err = run(rollout, "--output=many", WORKERS, *command)
    assert (status, err) == (0, "")
    alone = run(rollout, "--output=one", *command)[1]
    assert_same_episodes("many", "one")
    assert sorted(rows(out)) == rows(alone)


def rows(out):
    """The table without the time, which is the fifth column."""
    return [cells[:4] + cells[5:] for cells in map(str.split, out.split("\n\n")[1].splitlines()[1:])]


def test_an_evaluation_by_workers_is_that_of_one_process(run):
    command = ["--num_episodes=5", "--num_envs=2", SHORT]
    assert run(evaluate, *command, WORKERS, "--json=many.json", "--receipt=many.npz")[0] == 0
    assert run(evaluate, *command, "--json=one.json", "--receipt=one.npz")[0] == 0
    assert Path("many.json").read_bytes() == Path("one.json").read_bytes()
    with np.load("many.npz") as many, np.load("one.npz") as one:
        assert many.files == one.files
        for name in one.files:
            np.testing.assert_array_equal(many[name], one[name], name)


def test_a_callable_plays_on_workers():
    def still(observations):
        return np.zeros((len(observations["observation"]), 9))

    spec = kitchen_suite.EnvironmentSpec.make("kitchen", "kettle", {}, 5)
    arguments = {"policy": still, "seeds": range(5), "takes": "batch", "num_envs": 2}
    many = {episode.seed: episode.digest for episode in kitchen_suite.play(spec, **arguments, cluster=Cluster(2))}
    assert many == {episode.seed: episode.digest for episode in kitchen_suite.play(spec, **arguments)}


def test_a_policy_with_a_memory_plays_on_workers_as_in_one_process(run, write_policies):
    write_policies(MEMORY)
    names = ("my_policies:Chunks", "my_policies:chunks")
    command = ["--num_episodes=9", "--num_envs=2", SHORT]
    for number, name in enumerate(names):
        assert run(record, f"--output=many_{number}", WORKERS, f"--policy={name}", *command)[0] == 0
        assert run(record, f"--output=one_{number}", f"--policy={name}", *command, "--num_envs=1")[0] == 0
        assert_same_episodes(f"many_{number}", f"one_{number}")

    def rows():
        class Rows:
            def __init__(self):
                self.steps = np.zeros(16)

            def reset(self, rows):
                self.steps[rows] = 0

            def __call__(self, observations):
                self.steps += 1
                count = len(observations["observation"])
                return np.tile(0.1 * np.sin(self.steps[:count, np.newaxis]), 9)

        return Rows()

    spec = kitchen_suite.EnvironmentSpec.make("kitchen", "kettle", {}, 5)
    arguments = {"policy": rows, "seeds": range(7), "takes": "batch", "num_envs": 2}
    many = {episode.seed: episode.digest for episode in kitchen_suite.play(spec, **arguments, cluster=Cluster(2))}
    assert many == {episode.seed: episode.digest for episode in kitchen_suite.play(spec, **arguments)}


@pytest.mark.parametrize("cpus", [None, processors(), 0.5])
def test_workers_reserve_what_they_use_and_no_more_play_at_once_than_fit(monkeypatch, cpus):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)

    # Inside, since workers cannot import a module of tests.
    def probe(part):
        """When a worker began and ended, its processors, and its threads of NumPy."""
        import ray

        start = time.monotonic()
        time.sleep(0.2)
        cpus = ray.get_runtime_context().get_assigned_resources()["CPU"]
        return [(start, time.monotonic(), cpus, os.environ["OMP_NUM_THREADS"])]

    workers = 2 * processors() + 1
    cluster = Cluster(workers, cpus_per_worker=cpus)
    found = [*cluster.run(probe, (), range(4 * workers), num_threads=1)]
    reserved = 1 if cpus is None else cpus
    assert {each[2:] for each in found} == {(reserved, str(max(1, int(reserved))))}
    at_once = max(sum(start <= other[0] < end for other in found) for start, end, *_ in found)
    assert at_once <= processors() / reserved


def test_no_episode_is_lost_with_a_worker_that_is_killed(run, tmp_path):
    tmp_path.joinpath("mortal").touch()
    command = ["--num_episodes=12", "--num_envs=2", "--policy=my_policies:die_once", SHORT]
    status, out, _ = run(record, "--output=many", WORKERS, *command)
    assert status == 0
    assert not tmp_path.joinpath("mortal").exists()
    assert "\nepisodes              12\n" in out
    assert run(record, "--output=one", *command)[0] == 0
    assert_same_episodes("many", "one")


@pytest.mark.nightly
def test_a_thousand_episodes_are_those_of_one_process_whichever_workers_are_killed(tmp_path):
    spec = kitchen_suite.EnvironmentSpec.make("open_cabinet", "top_drawer", {}, 20)
    arguments = {"policy": "random", "seeds": range(1_000), "num_envs": 16}
    alone = {episode.seed: episode.digest for episode in kitchen_suite.play(spec, **arguments)}
    generator = np.random.default_rng(0)
    many = {}
    killed = set()
    for episode in kitchen_suite.play(spec, **arguments, cluster=Cluster(4)):
        many[episode.seed] = episode.digest
        # Three of the workers, one after the other, while parts of the episodes are being played.
        if len(many) in (100, 300, 600):
            victim = generator.choice([number for number in workers() if number not in killed])
            os.kill(victim, signal.SIGKILL)
            killed.add(victim)
    assert len(killed) == 3
    assert many == alone


def workers():
    """Processes of Ray on this machine that play a part of the episodes."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            if path.read_bytes().startswith(b"ray::_checked"):
                found.append(int(path.parent.name))
    return found


def test_workers_that_always_die_end_the_command(run):
    status, _, err = run(record, "--output=runs", "--workers=1", "--num_episodes=3", "--policy=my_policies:die", SHORT)
    assert status == 1
    assert err.startswith("kitchen-record: a part of the episodes could not be played: ")
    assert err.count("\n") == 1
    assert load_all("runs") == {}


@pytest.mark.parametrize("command", [record, rollout, evaluate])
def test_an_error_of_a_policy_in_a_worker_is_reported_in_one_line(run, command):
    status, _, err = run(command, "--output=runs", WORKERS, "--num_episodes=3", "--policy=my_policies:broken")
    assert status == 2
    assert err.startswith(f"{command.COMMAND.name}: policy 'my_policies:broken' raised KeyError")
    assert err.count("\n") == 1


def test_the_error_of_ray_about_an_address_is_a_failure_in_one_line(run):
    status, _, err = run(record, "--output=runs", WORKERS, "--ray_address=nonsense")
    assert (status, err.count("\n")) == (1, 1)
    assert "cannot use Ray at nonsense: " in err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_keeps_the_finished_episodes_and_leaves_no_process(run, tmp_path, number):
    process = open_process(
        [sys.executable, "-m", "kitchen_suite", "record", "--output=runs", WORKERS, "--num_episodes=2000", SHORT],
        env={**os.environ, "KITCHEN_SUITE_TEST": str(tmp_path)},
        # As Ctrl-C does, the signal goes to a whole group of processes.
        start_new_session=True,
    )
    while len(list(tmp_path.glob("runs/episode_*.npz"))) < 3:
        assert process.poll() is None
        time.sleep(0.01)
    assert len(processes_of(tmp_path)) > 3
    os.killpg(process.pid, number)
    _, err = process.communicate(timeout=60)
    count = len(load_all("runs"))
    assert count >= 3
    assert (process.returncode, err) == (130, "kitchen-record: interrupted\n")
    wait_until(lambda: not processes_of(tmp_path))
    # The same command completes the recording.
    wanted = max(int(name[8:14]) for name in load_all("runs")) + 2
    assert run(record, "--output=runs", f"--num_episodes={wanted}", SHORT)[0] == 0
    assert len(load_all("runs")) == wanted


@pytest.fixture
def cluster():
    """Address of a cluster with two processors, and the environment that its clients need."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    # Paths of sockets must be short.
    with tempfile.TemporaryDirectory(prefix="ray", ignore_cleanup_errors=True) as folder:
        token = Path(folder, "token")
        token.write_text(secrets.token_hex(32))
        environment = os.environ | {
            "PYTHONPATH": os.pathsep.join(sys.path),
            "RAY_AUTH_MODE": "token",
            "RAY_AUTH_TOKEN_PATH": str(token),
            "RAY_USAGE_STATS_ENABLED": "0",
        }
        head = [*RAY, "start", "--head", "--block", f"--port={port}", "--num-cpus=2", "--include-dashboard=false"]
        with subprocess.Popen(
            [*head, f"--temp-dir={folder}"], cwd=folder, env=environment, stdout=subprocess.DEVNULL
        ) as process:
            yield f"127.0.0.1:{port}", environment
            process.terminate()


def test_a_cluster_elsewhere_plays_and_the_command_writes(run, cluster, tmp_path):
    address, environment = cluster
    command = ["--num_episodes=5", "--num_envs=2", SHORT]
    wait_until(lambda: answers(address))
    there = ["record", "--output=many", WORKERS, f"--ray_address={address}", *command]
    done = subprocess.run(
        [sys.executable, "-m", "kitchen_suite", *there], env=environment, capture_output=True, text=True, timeout=120
    )
    assert (done.returncode, done.stderr) == (0, ""), done.stderr
    assert run(record, "--output=one", *command)[0] == 0
    assert len(load_all("many")) == 5
    assert_same_episodes("many", "one")


def answers(address):
    host, port = address.split(":")
    with socket.socket() as client:
        return client.connect_ex((host, int(port))) == 0


def processes_of(folder):
    """Processes that were started, directly or not, with that folder in their environment."""
    found = []
    for path in Path("/proc").glob("[0-9]*/environ"):
        try:
            if f"KITCHEN_SUITE_TEST={folder}".encode() in path.read_bytes().split(b"\0"):
                found.append(path.parent.name)
        except OSError:
            continue
    return found
