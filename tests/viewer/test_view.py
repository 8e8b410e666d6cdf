"""`kitchen-view` as a process of its own, driven through the protocol of viser's page."""

import http.client
import re
import signal
import socket
import subprocess
import sys

import pytest
from helpers.viser_client import TIMEOUT, Browser

from kitchen_suite import installation
from kitchen_suite.commands import view


def test_a_missing_extra_is_named_with_the_command_that_installs_it(capsys, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert view.main([]) == 2
    err = capsys.readouterr().err
    assert f"needs viser and mjviser: {installation.install_command('web')}" in err


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
    assert err.count("\n") == 1
    assert f"port {port} cannot be used" in err


@pytest.fixture
def process(port):
    """The running command."""
    flags = ["--domain_name=microwave_table", "--policy=zero", f"--port={port}", "--no_token"]
    command = [sys.executable, "-m", "kitchen_suite", "view", *flags]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        yield running
        running.kill()


@pytest.mark.web
def test_episodes_are_shown_and_driven_until_an_interrupt(process, port):
    assert process.stdout.readline() == f"http://127.0.0.1:{port}  (Ctrl-C ends)\n"
    assert status(port, "localhost") == 200
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
        browser.set("Domain", "open_cabinet")
        offered = ["expert", "random", "zero", "trained", "takeover"]
        browser.wait(lambda: browser.options.get(browser.widgets["Policy"]) == offered)
        browser.set("Load", True)
        browser.wait(lambda: "drawer opening" in browser.report())
    finally:
        browser.close()
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=TIMEOUT)
    assert (process.returncode, out, err) == (130, "", "kitchen-view: interrupted\n")


@pytest.mark.web
@pytest.mark.parametrize(
    ("domain", "task", "offered"),
    [
        ("kitchen", "kettle", ("expert", "random", "zero", "undirected", "trained", "takeover")),
        ("kitchen", "top_right_burner", ("expert", "random", "zero", "undirected")),
        ("microwave_table", "open", ("expert", "random", "zero")),
    ],
)
def test_the_policies_on_offer_can_act(domain, task, offered):
    from kitchen_suite.viewer.panels import policies_for

    assert policies_for(domain, task) == offered


@pytest.mark.web
def test_a_folder_is_for_episodes_of_a_person(capsys, tmp_path):
    assert view.main([f"--output={tmp_path / 'mine'}"]) == 2
    assert "it needs teleop" in capsys.readouterr().err


def status(port, host):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=TIMEOUT)
    connection.request("GET", "/", headers={"Host": f"{host}:{port}"})
    found = connection.getresponse()
    found.read()
    connection.close()
    return found.status
