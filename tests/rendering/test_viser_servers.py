"""The server of `kitchen-view` answers this machine alone."""

import http.client
import importlib.util
from pathlib import Path

import pytest
from helpers.errors import refused

from kitchen_suite.rendering import viser_servers


@pytest.mark.parametrize("host", ["127.0.0.1:8080", "localhost:8080", "localhost", "LOCALHOST:9000"])
def test_local_names_are_answered(host):
    assert viser_servers.is_local([host], [])
    assert viser_servers.is_local([host], [f"http://{host}"])


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
def test_other_names_are_refused(hosts):
    assert not viser_servers.is_local(hosts, [])


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
def test_pages_of_other_origins_are_refused(origins):
    assert not viser_servers.is_local(["localhost:8080"], origins)


def test_a_missing_extra_is_named_with_the_command_that_installs_it(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with refused(ImportError, "'.[web]'"):
        viser_servers.check_extra("a page")


@pytest.mark.web
def test_requests_are_answered_or_refused_by_their_host(port, capfd):
    with viser_servers.local_server(port, "test"):
        assert status(port, f"localhost:{port}") == 200
        assert status(port, "evil.com") == 403
        assert status(port, "evil.com", "websocket") == 403
        assert status(port, f"localhost:{port}", "websocket", Origin="http://evil.com") == 403
        assert capfd.readouterr() == ("", "")
        # viser says that this client is not its own.
        assert status(port, f"localhost:{port}", "websocket", Origin=f"http://localhost:{port}") == 101


def status(port, host, upgrade="", **headers):
    """The status of an answer."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
    if upgrade:
        headers |= {"Connection": "Upgrade", "Upgrade": upgrade, "Sec-WebSocket-Version": "13"}
        headers |= {"Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ=="}
    connection.request("GET", "/", headers={"Host": host, **headers})
    found = connection.getresponse().status
    connection.close()
    return found


@pytest.mark.web
def test_only_the_local_address_is_bound(port):
    with viser_servers.local_server(port, "test") as server:
        (listening,) = {line.split()[1] for line in tcp_sockets() if line.split()[1].endswith(f":{port:04X}")}
        assert listening.partition(":")[0] in ("0100007F", "7F000001")
        assert server.get_port() == port


def tcp_sockets():
    """Rows of the sockets that listen."""
    rows = [row for name in ("tcp", "tcp6") for row in Path(f"/proc/net/{name}").read_text().splitlines()[1:]]
    return [row for row in rows if row.split()[3] == "0A"]


@pytest.mark.web
def test_a_port_in_use_is_an_error(port):
    with viser_servers.local_server(port, "test"):
        second = viser_servers.local_server(port, "test")
        with pytest.raises(OSError, match=f"port {port} cannot be used .*: choose another one with --port"):
            second.__enter__()


@pytest.mark.web
def test_nothing_can_be_shared_through_the_makers_of_viser(port):
    with viser_servers.local_server(port, "test") as server:
        assert server.request_share_url() is None
