"""Servers of viser: one for browsers on this machine alone, and one without a port; needs the extra `web`."""

import contextlib
import io
import json
import logging
import secrets
import socket
import urllib.parse
from collections.abc import Iterator, Sequence
from typing import Any

from kitchen_suite import installation

# Before their import, so that a missing one is named with what installs it.
installation.installed(("mjviser", "viser"), "kitchen_suite.viewer", "web")

import viser  # noqa: E402

HOST = "127.0.0.1"

TITLE = "Kitchen Suite"

# On a phone viser's panel lies upon the scene; here it is a sheet below it, of the whole width: the hand is seen.
# The place of a label is left out where there is none, as beside rows of buttons.
_STYLE = """
@media (max-width: 36em) {
  div:has(> .mantine-Paper-root[style*="position: fixed"]) { flex-direction: column; }
  .mantine-Paper-root[style*="position: fixed"] { position: static !important; width: 100% !important;
    max-height: 45dvh !important; flex: none; }
  .mantine-Paper-root[style*="position: fixed"] [style*="width: 20em"] { width: 100% !important; }
}
div:has(> p > label:empty) { display: none; }
"""

# Names under which a browser on this machine reaches `HOST`; also through a port that ssh forwards.
_LOCAL_NAMES = ("127.0.0.1", "localhost")


class _LocalServer(viser.ViserServer):
    """A server whose page cannot be shared."""

    def request_share_url(self, verbose: bool = True) -> None:
        """Does nothing: viser would send all that the page shows to a server of its makers, which anybody can open."""


def new_token() -> str:
    """Returns a random token, which another user of the machine cannot guess."""
    return secrets.token_hex(16)


def address_of(port: int, token: str = "") -> str:
    """Returns the address of the page of a server, which has the token of its connections, if there is one."""
    page = f"http://{HOST}:{port}"
    # viser's page connects to the address that this argument names.
    return f"{page}/?websocket=ws://{HOST}:{port}/{token}" if token else page


@contextlib.contextmanager
def local_server(port: int, token: str = "") -> Iterator[viser.ViserServer]:
    """Yields a server that talks to pages of this machine alone.

    It is bound to `HOST`. A page of another site cannot use it either: the names that a connection has as its host and
    origin must be local, so that a foreign name that resolves to this machine is refused. With a token, only pages at
    `address_of(port, token)` are talked to, so that other users of the machine are refused as well.
    """
    _check_port(port)
    with _running(_LocalServer, host=HOST, port=port, label=TITLE) as server, _refusing_quietly():
        # viser takes the next free port.
        if server.get_port() != port:
            raise OSError(f"port {port} is in use: choose another one")
        _refuse_others(server, token)
        server.gui.configure_theme(show_share_button=False, show_logo=False)
        _set_up_pages(server)
        yield server


def silent_server() -> contextlib.AbstractContextManager[viser.ViserServer]:
    """Returns a context with a server that listens to no port; its scene can be recorded."""
    # asyncio binds a server to each address of a sequence.
    return _running(viser.ViserServer, host=(), port=0)


@contextlib.contextmanager
def _running(server_class: type[viser.ViserServer], **arguments: Any) -> Iterator[viser.ViserServer]:
    """Yields a server of a class, which prints nothing, and stops it in the end."""
    with contextlib.redirect_stdout(io.StringIO()):
        server = server_class(verbose=False, **arguments)
    try:
        yield server
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()


def _set_up_pages(server: viser.ViserServer) -> None:
    """Gives pages their title, and the layout of `_STYLE`, for which viser has no public way."""
    source = f"""
      document.title = {json.dumps(TITLE)};
      const style = document.createElement("style");
      style.textContent = {json.dumps(_STYLE)};
      document.head.append(style);
    """
    # Kept by viser for browsers that come later.
    server._websock_server.queue_message(viser._messages.RunJavascriptMessage(source))  # noqa: SLF001


def _refuse_others(server: viser.ViserServer, token: str) -> None:
    """Ends each connection that is not of a page of this machine, or lacks the token, before anything is sent or read.

    What viser answers without a connection is the same for everybody: the empty page, as it is in viser's package.
    """
    # viser calls the functions of `on_client_connect` first of all. It has no public way to its own sockets, and to the
    # request that a connection began with: these two private names are the reason why setup.cfg limits its version.
    sockets = server._websock_server  # noqa: SLF001
    connections = sockets._live_connections  # noqa: SLF001

    async def check(client: viser.infra.WebsockClientConnection) -> None:
        request = connections[client.client_id].request
        headers = request.headers
        given = request.path.partition("?")[0].strip("/")
        if token and not secrets.compare_digest(given.encode(), token.encode()):
            raise PermissionError("the connection does not have the token of the address")
        if not is_local(headers.get_all("Host"), headers.get_all("Origin")):
            raise PermissionError("the connection is not of a page of this machine")

    sockets.on_client_connect(check)
    # Pages that were faster connect again, and are checked then.
    sockets.disconnect_all_clients()


@contextlib.contextmanager
def _refusing_quietly() -> Iterator[None]:
    """Context in which a connection is refused without a traceback, which strangers could fill a terminal with."""
    log = logging.getLogger("websockets.server")
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        log.setLevel(level)


def is_local(hosts: Sequence[str], origins: Sequence[str]) -> bool:
    """Returns whether a request is addressed to this machine, and comes from a page of the address that it asks.

    That is decided by the values of its `Host` headers, and of its `Origin` headers, which only pages send.
    """
    if len(hosts) != 1:
        return False
    try:
        name = urllib.parse.urlsplit(f"//{hosts[0]}").hostname
    except ValueError:
        return False
    return name in _LOCAL_NAMES and all(origin == f"http://{hosts[0]}" for origin in origins)


def _check_port(port: int) -> None:
    """Raises an OSError if a port is in use, or may not be used."""
    with socket.socket() as probe:
        # As asyncio binds: also where a closed connection still waits.
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError as error:
            raise OSError(f"port {port} cannot be used ({error.strerror}): choose another one") from error
