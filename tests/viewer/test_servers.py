"""The server of `kitchen-view` answers this machine alone."""

import contextlib
import http.client
import importlib.util
import runpy
import socket
import time
from pathlib import Path

import msgspec
import pytest
from helpers.errors import refused
from helpers.viser_client import CAMERA

from kitchen_suite.installation import install_command

pytestmark = pytest.mark.web


@pytest.fixture
def servers():
    from kitchen_suite.viewer import servers

    return servers


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost:8080", "localhost", "LOCALHOST:9000"])
def test_local_names_are_answered(servers, host):
    assert servers.is_local([host], [])
    assert servers.is_local([host], [f"http://{host}"])


@pytest.mark.parametrize(
    "hosts",
    [
        [],
        [""],
        ["evil.com"],
        ["evil.com:8080"],
        ["localhost.evil.com"],
        ["localhost@evil.com"],
        ["192.168.0.2:8080"],
        ["0.0.0.0:8080"],
        ["[::1"],
        ["localhost:8080", "evil.com"],
    ],
)
def test_other_names_are_refused(servers, hosts):
    assert not servers.is_local(hosts, [])


@pytest.mark.parametrize(
    "origins",
    [
        ["http://evil.com"],
        ["null"],
        ["http://localhost:9000"],
        ["https://localhost:8080"],
        ["http://localhost:8080", "http://evil.com"],
    ],
)
def test_pages_of_other_origins_are_refused(servers, origins):
    assert not servers.is_local(["localhost:8080"], origins)


def test_a_missing_extra_is_named_with_the_command_that_installs_it(servers, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with refused(ImportError, install_command("web")):
        runpy.run_path(servers.__file__)


@pytest.mark.parametrize(
    ("host", "origin"),
    [("evil.com", "http://evil.com"), ("localhost", "http://evil.com"), ("evil.com", None)],
)
def test_pages_of_others_get_no_message_and_give_no_command(servers, port, capfd, host, origin):
    from websockets.exceptions import ConnectionClosed

    with servers.local_server(port) as server:
        clicks = []
        button = server.gui.add_button("Button")
        button.on_click(lambda event: clicks.append(event))
        updates = {"value": True}
        click = msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": button._impl.uuid, "updates": updates})
        with connected(port, host, origin) as connection:
            with contextlib.suppress(ConnectionClosed):
                connection.send(msgspec.msgpack.encode(CAMERA))
                connection.send(click)
            with pytest.raises(ConnectionClosed):
                connection.recv(timeout=120)
        with connected(port, f"localhost:{port}", f"http://localhost:{port}") as connection:
            assert connection.recv(timeout=120)
            connection.send(msgspec.msgpack.encode(CAMERA))
            connection.send(click)
            deadline = time.monotonic() + 120
            while not clicks and time.monotonic() < deadline:
                time.sleep(0.02)
        assert len(clicks) == 1
    assert capfd.readouterr() == ("", "")


def connected(port, host, origin):
    """A connection of viser's protocol with given headers."""
    import viser
    from websockets.sync.client import connect

    names = [f"viser-v{viser.__version__}"]
    return connect(
        f"ws://{host}/", subprotocols=names, origin=origin, sock=socket.create_connection(("127.0.0.1", port))
    )


def test_the_page_of_viser_is_all_that_is_answered_without_a_connection(servers, port):
    with servers.local_server(port):
        assert status(port, f"localhost:{port}") == 200


def status(port, host):
    """The status of an answer."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
    connection.request("GET", "/", headers={"Host": host})
    found = connection.getresponse().status
    connection.close()
    return found


def test_only_the_local_address_is_bound(servers, port):
    with servers.local_server(port) as server:
        (listening,) = {line.split()[1] for line in tcp_sockets() if line.split()[1].endswith(f":{port:04X}")}
        assert listening.partition(":")[0] in ("0100007F", "7F000001")
        assert server.get_port() == port


def tcp_sockets():
    """Rows of the sockets that listen."""
    rows = [row for name in ("tcp", "tcp6") for row in Path(f"/proc/net/{name}").read_text().splitlines()[1:]]
    return [row for row in rows if row.split()[3] == "0A"]


def test_a_port_in_use_is_an_error(servers, port):
    with servers.local_server(port):
        second = servers.local_server(port)
        with pytest.raises(OSError, match=f"port {port} cannot be used"):
            second.__enter__()


def test_nothing_can_be_shared_through_the_makers_of_viser(servers, port):
    with servers.local_server(port) as server:
        assert server.request_share_url() is None
