"""Errors of command lines that ask for workers; the tests need no Ray."""

import importlib.util
import os
import re
import socket

import pytest

from kitchen_suite import checks
from kitchen_suite.commands.commands import record, rollout
from kitchen_suite.workers.pool import waiting_line

COMMANDS = {"kitchen-record": record.main, "kitchen-rollout": rollout.main}
BAD = {
    "--workers=0": "must be at least 1",
    "--workers=-2": "must be at least 1",
    "--workers=1.5": "1.5",
    "--workers=many": "many",
    "--ray_address=auto": "--ray_address needs --workers",
}
BAD_ADDRESSES = ["", "nonsense", "somewhere:", ":6379", "localhost:port", "localhost:0", "localhost:65536", "ray://x"]


@pytest.fixture(params=COMMANDS)
def run(request, capsys, tmp_path, monkeypatch):
    """Runs either command; returns its status and stderr."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        status = COMMANDS[request.param](["--output=runs", *arguments])
        out, err = capsys.readouterr()
        assert out == ""
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


@pytest.mark.parametrize("address", BAD_ADDRESSES)
def test_a_malformed_address_is_refused(run, ray_found, address):
    status, err = run("--workers=2", f"--ray_address={address}")
    assert status == 2
    assert f"{address!r} is not a Ray address: it must be HOST:PORT, ray://HOST:PORT or auto" in err


@pytest.mark.parametrize("scheme", ["", "ray://"])
def test_an_address_where_nothing_answers_is_refused(run, ray_found, scheme):
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    status, err = run("--workers=2", f"--ray_address={scheme}127.0.0.1:{port}")
    assert status == 2
    assert f"no Ray answers at {scheme}127.0.0.1:{port}: " in err


def test_the_error_without_ray_says_what_to_install(run, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    status, err = run("--workers=2")
    assert status == 2
    assert f"workers need Ray: {checks.install_command('ray')}" in err


def test_workers_make_no_video(capsys, ray_found):
    assert rollout.main(["--workers=2", "--video=film.mp4"]) == 2
    assert "workers make no video" in capsys.readouterr().err


def test_a_pool_that_waits_says_what_it_waits_for():
    assert waiting_line(4, free=1.0, machines=[2.0, 8.0]) == (
        "waiting for processors: a worker needs 4, 1 of the cluster's are free"
    )


@pytest.mark.parametrize("machines", [[], [1], [2, 3, 3]])
def test_a_pool_whose_workers_fit_onto_no_machine_says_so_and_waits_for_larger_ones(machines):
    line = waiting_line(4, free=sum(machines), machines=machines)
    assert line.endswith(
        f"its largest machine has {max(machines, default=0)}: give a smaller --num_threads, or add one"
    )
