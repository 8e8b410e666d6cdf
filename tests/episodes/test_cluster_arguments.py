"""Errors of what asks for workers, and what a worker does; these tests need no Ray."""

import contextlib
import functools
import importlib.util
import os
import re

import numpy as np
import pytest
from helpers.errors import refused

import kitchen_suite
from kitchen_suite import EnvironmentSpec, installation
from kitchen_suite.commands import evaluate, record, rollout
from kitchen_suite.episodes.cluster import Cluster, ClusterError, _checked
from kitchen_suite.episodes.play import play_part, play_singly
from kitchen_suite.policies import PolicyRef
from kitchen_suite.tasks.open_cabinet import rewards as reward
from kitchen_suite.versions import installed_versions

COMMANDS = {"kitchen-record": record.main, "kitchen-rollout": rollout.main, "kitchen-evaluate": evaluate.main}
BAD = {
    "--workers=0": "[1, 10000]",
    "--ray_address=auto": "ray_address needs the number of workers",
    "--cpus_per_worker=2": "cpus_per_worker needs the number of workers",
    "--cpus_per_worker=0": "[0.01, 1024]",
    "--cpus_per_worker=1025": "[0.01, 1024]",
}


@pytest.fixture(params=COMMANDS)
def run(request, capsys, tmp_path, monkeypatch):
    """Runs a command; returns its status and stderr."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        status = COMMANDS[request.param](["--output=runs", *arguments])
        _, err = capsys.readouterr()
        assert re.fullmatch(rf"{request.param}: [^\n]+\n", err)
        assert not os.path.exists("runs")
        return status, err

    return run


@pytest.fixture
def ray_found(monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: name == "ray" or find(name))


@pytest.mark.parametrize("argument", BAD)
def test_a_bad_argument_gets_one_line_and_status_2(run, argument):
    status, err = run(argument)
    assert status == 2
    assert BAD[argument] in err


def test_the_error_without_ray_says_what_to_install(run, monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "ray" else find(name))
    status, err = run("--workers=2")
    assert status == 2
    assert f"workers need Ray: {installation.install_command('ray')}" in err


def test_workers_make_no_video(capsys, ray_found):
    assert rollout.main(["--workers=2", "--video=film.mp4"]) == 2
    assert "workers make no video" in capsys.readouterr().err


class FakeRay:
    """As much of Ray as plays parts one after the other; remembers what was asked for."""

    class exceptions:  # noqa: N801
        class RayError(Exception):
            pass

    def __init__(self, processors):
        self._processors = processors
        self.options = None

    def nodes(self):
        return [{"Alive": True, "Resources": {"CPU": self._processors}}]

    def put(self, shared):
        return shared

    def remote(self, **options):
        self.options = options

        class Remote:
            def __init__(self, function):
                self.remote = lambda *arguments: functools.partial(function, *arguments)

        return Remote

    def wait(self, waiting):
        return waiting[:1], waiting[1:]

    def get(self, reference):
        return reference()

    def cancel(self, reference, force):
        raise AssertionError


def reserved(cluster, monkeypatch, num_threads, processors=4):
    """The processors that each part of a run reserves."""
    ray = FakeRay(processors)
    monkeypatch.setattr(Cluster, "_connected", lambda self: contextlib.nullcontext(ray))
    numbers = [*range(5)]
    assert sorted(cluster.run(lambda part: [-each for each in part], (), numbers, num_threads=num_threads)) == sorted(
        -each for each in numbers
    )
    return ray.options["num_cpus"]


@pytest.mark.parametrize(
    ("cpus", "num_threads", "expected"), [(None, 1, 1), (None, 3, 3), (0.01, 1, 0.01), (0.5, 2, 0.5), (4, 1, 4)]
)
def test_a_worker_reserves_a_processor_for_each_thread_or_what_it_is_given(
    ray_found, monkeypatch, cpus, num_threads, expected
):
    assert reserved(Cluster(2, cpus_per_worker=cpus), monkeypatch, num_threads) == expected


@pytest.mark.parametrize(("cpus", "num_threads"), [(None, 5), (4.5, 1)])
def test_a_worker_for_which_no_machine_is_large_enough_is_refused(ray_found, monkeypatch, cpus, num_threads):
    needed = f"{cpus or num_threads:g}"
    with refused(ClusterError, f"reserves {needed} processors", "more than 4", "num_threads", "cpus_per_worker"):
        reserved(Cluster(2, cpus_per_worker=cpus), monkeypatch, num_threads)


@pytest.mark.parametrize(
    ("cpus", "error"), [(0, ValueError), (0.009, ValueError), (1025, ValueError), (-1, ValueError), ("2", TypeError)]
)
def test_bad_numbers_of_processors_are_refused(ray_found, cpus, error):
    with refused(error, "cpus_per_worker", str(cpus)):
        Cluster(2, cpus_per_worker=cpus)


def test_every_play_on_workers_says_how_many_threads_it_uses(ray_found, monkeypatch):
    found = []
    monkeypatch.setattr(
        Cluster,
        "run",
        lambda self, function, arguments, items, *, num_threads: found.append((arguments[-1], num_threads)) or iter(()),
    )
    spec = EnvironmentSpec.make("open_cabinet", "top_drawer", {}, 3)
    for num_threads in (None, 3):
        list(kitchen_suite.play(spec, "random", range(2), num_threads=num_threads, cluster=Cluster(2)))
    assert found == [(1, 1), (3, 3)]


def spec_of(task, seeding="gymnasium", steps=12):
    domain = "kitchen" if task == "kettle" else "open_cabinet"
    return EnvironmentSpec.make(domain, task, {}, steps).episodes(PolicyRef.parse("random"), seed=3, seeding=seeding)


def test_rewards_of_a_rollout_do_not_depend_on_what_the_worker_played_before(monkeypatch):
    # The second episode of an environment would begin with the greater penalties.
    monkeypatch.setattr(reward, "LATE_STAGE", 2)
    spec = spec_of("top_drawer", "dm_control", steps=50)
    first, again = play_singly([(0, 7), (1, 7)], spec, PolicyRef.parse("random"))
    np.testing.assert_array_equal(first.arrays["reward"], again.arrays["reward"])


@pytest.mark.full
def test_a_worker_with_other_versions_is_refused():
    versions = installed_versions()
    arguments = (spec_of("kettle"), PolicyRef.parse("random"), 1, 1)
    assert [episode.seed for episode in _checked([(0, 3)], (play_part, arguments, versions))] == [3]
    with refused(ClusterError, f"mujoco {versions['mujoco']} instead of 3.0.0, so its episodes would differ"):
        _checked([(0, 3)], (play_part, arguments, versions | {"mujoco": "3.0.0"}))
