"""`kitchen-view` as a process of its own, driven through the protocol of viser's page."""

import http.client
import re
import signal
import socket
import subprocess
import sys

import numpy as np
import pytest
from helpers.errors import refused
from helpers.viser_client import TIMEOUT, Browser

from kitchen_suite import checks
from kitchen_suite.commands.commands import replay, view
from kitchen_suite.episodes.recording import RecordingFolder
from kitchen_suite.settings import ViewSettings
from kitchen_suite.viewer.viewer import live_episode, policies_for


def test_a_missing_extra_is_named_with_the_command_that_installs_it(capsys, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert view.main([]) == 2
    err = capsys.readouterr().err
    assert err == f"kitchen-view: kitchen-view needs viser and mjviser: {checks.install_command('web')}\n"


@pytest.mark.web
@pytest.mark.parametrize(
    "flag", ["--domain_name=moon", "--task_name=moon", "--policy=moon", "--camera=moon", "--port=80"]
)
def test_a_bad_argument_gets_one_line_and_status_2(flag, capsys):
    assert view.main(["--domain_name=microwave_table", flag]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("kitchen-view: ")
    assert err.count("\n") == 1


@pytest.mark.web
def test_a_port_in_use_gets_one_line_and_status_1(port, capsys):
    with socket.create_server(("127.0.0.1", port)):
        assert view.main(["--domain_name=microwave_table", f"--port={port}"]) == 1
    err = capsys.readouterr().err
    assert err == f"kitchen-view: port {port} cannot be used (Address already in use): choose another one with --port\n"


@pytest.fixture
def process(port):
    """The running command."""
    flags = ["--domain_name=microwave_table", "--policy=zero", f"--port={port}"]
    command = [sys.executable, "-m", "kitchen_suite", "view", *flags]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        yield running
        running.kill()


@pytest.mark.web
def test_episodes_are_shown_and_driven_until_an_interrupt(process, port):
    assert process.stdout.readline() == f"http://127.0.0.1:{port}  (Ctrl-C ends)\n"
    assert status(port, "localhost") == 200
    assert status(port, "evil.com") == 403
    browser = Browser(port)
    try:
        browser.wait(lambda: any("microwave/door" in name for name in browser.nodes) and "time" in browser.report())
        assert any(name.startswith("/surfaces/") for name in browser.nodes), "floor and worktop have their textures"
        browser.set("Run", False)
        browser.set("Seed", 7)
        browser.set("Reset", True)
        browser.wait(lambda: "control step | 0 of" in browser.report())
        for step in (1, 2):
            browser.set("Step", True)
            browser.wait(lambda step=step: f"control step | {step} of" in browser.report())
        browser.set("Policy", "random")
        browser.set("appearance", True)
        browser.set("Load", True)
        browser.wait(lambda: "control step | 0 of" in browser.report())
        browser.set("Run", True)
        browser.wait(lambda: re.search(r"control step \| [1-9]", browser.report()))
        browser.set("Policy", "moon")
        browser.set("Load", True)
        browser.wait(lambda: "**Error:** policy 'moon'" in browser.report())
        browser.set("Policy", "zero")
        browser.set("Domain", "open_cabinet")
        offered = ["expert", "random", "zero", "trained", "takeover"]
        browser.wait(lambda: browser.options.get(browser.widgets["Policy"]) == offered)
        browser.set("Load", True)
        browser.wait(lambda: "drawer opening" in browser.report())
    finally:
        browser.close()
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=TIMEOUT)
    assert (process.returncode, out, err) == (130, "", "kitchen-view: interrupted while showing episodes\n")


@pytest.mark.parametrize(
    ("domain", "task", "offered"),
    [
        ("kitchen", "kettle", ("expert", "random", "zero", "undirected", "trained", "takeover")),
        ("kitchen", "top_right_burner", ("expert", "random", "zero", "undirected")),
        ("microwave_table", "open", ("expert", "random", "zero")),
    ],
)
def test_the_policies_on_offer_can_act(domain, task, offered):
    assert policies_for(domain, task) == offered


def teleoperated(**settings):
    return live_episode(
        ViewSettings(domain_name="kitchen", task_name="kettle", teleop=True, render_quality="fast", **settings)
    )


def test_a_person_plays_goes_back_and_saves(tmp_path):
    episode = teleoperated(output=tmp_path / "mine", seed=5)
    assert episode.is_waiting
    with refused(ValueError, "nothing to save"):
        episode.save()
    episode.arm.nudge([0.0, 0.0, 0.05])
    assert not episode.is_waiting
    for _ in range(25):
        episode.step()
    episode.rewind(13)
    assert episode.is_waiting, "until the person goes on"
    assert "control step | 12 of 2000" in episode.report()
    episode.arm.grasp(True)
    episode.step()
    assert "fingers | closed" in episode.report()
    episode.save()
    with refused(ValueError, "an episode of seed 5 has been saved already"):
        episode.save()
    assert episode.next_seed == 6
    episode.close()
    # The next viewer goes on with the next seed.
    episode = teleoperated(output=tmp_path / "mine", seed=5)
    assert episode.seed == 6
    episode.start(3)
    episode.arm.nudge([0.02, 0.0, 0.0])
    episode.step()
    episode.save()
    assert "episodes saved | 1" in episode.report()
    episode.close()
    assert sorted(path.stem for path in (tmp_path / "mine").glob("*.npz")) == ["episode_000003", "episode_000005"]
    arrays = RecordingFolder.open(tmp_path / "mine").load(5).arrays
    assert arrays["label/is_intervention"].all()
    np.testing.assert_array_equal(arrays["label/teleop_action"], arrays["action"])
    assert replay.main([str(tmp_path / "mine")]) == 0


@pytest.mark.web
def test_a_folder_is_for_episodes_of_a_person(capsys, tmp_path):
    assert view.main([f"--output={tmp_path / 'mine'}"]) == 2
    assert "it needs --teleop" in capsys.readouterr().err


def status(port, host):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=TIMEOUT)
    connection.request("GET", "/", headers={"Host": f"{host}:{port}"})
    found = connection.getresponse()
    found.read()
    connection.close()
    return found.status
