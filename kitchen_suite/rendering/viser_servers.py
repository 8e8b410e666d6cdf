"""Servers of viser: one bound to localhost, and one without a port; needs the extra `web`."""

import contextlib
import http
import io
import logging
import socket
import types
import unittest.mock
import urllib.parse
import warnings
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from kitchen_suite import checks

if TYPE_CHECKING:
    import viser

HOST = "127.0.0.1"

# Names under which a browser on this machine reaches `HOST`; also through a port that ssh forwards.
_LOCAL_NAMES = ("127.0.0.1", "localhost")

_PACKAGES = ("mjviser", "viser")


def check_extra(what: str) -> None:
    """Raises an ImportError if the extra `web` is missing, which `what` needs."""
    checks.installed(_PACKAGES, what, "web")


@contextlib.contextmanager
def local_server(port: int, label: str) -> Iterator["viser.ViserServer"]:
    """Yields a server that answers browsers on this machine, and refuses all others.

    It is bound to `HOST`. A page of another site cannot use it either: the names that a request has as its host and
    origin must be local, so that a foreign name that resolves to this machine is refused. The title is the `label`.
    """
    _check_port(port)
    with _server(_refusing_others, host=HOST, port=port, label=label) as server, _refusing_garbage():
        # viser takes the next free port.
        if server.get_port() != port:
            raise OSError(f"port {port} is in use: choose another one with --port")
        # It would send all that the page shows to a server of viser's, which anybody could open.
        server.request_share_url = lambda verbose=True: None
        server.gui.configure_theme(show_share_button=False, show_logo=False)
        yield server


def silent_server() -> contextlib.AbstractContextManager["viser.ViserServer"]:
    """Returns a context with a server that listens to no port; its scene can be recorded."""
    return _server(lambda serve: _Unbound, host=HOST, port=0)


@contextlib.contextmanager
def _server(
    wrap: Callable[[Callable[..., Any]], Callable[..., Any]], **arguments: Any
) -> Iterator["viser.ViserServer"]:
    """Yields a server of viser, made with arguments of `viser.ViserServer`, which prints nothing.

    `wrap` makes of the function `serve` of websockets the one that the server is started with. viser has no argument
    for it, and looks it up when it starts.
    """
    import viser
    import websockets.asyncio.server as websockets_server

    serve = unittest.mock.Mock(wraps=wrap(websockets_server.serve))
    with unittest.mock.patch.object(websockets_server, "serve", serve), contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(verbose=False, **arguments)
    try:
        if not serve.called:
            raise ImportError(f"viser {viser.__version__} starts its server in another way: install viser 1.1")
        yield server
    finally:
        with contextlib.redirect_stdout(io.StringIO()):
            server.stop()


@contextlib.contextmanager
def _refusing_garbage() -> Iterator[None]:
    """Context in which a browser is disconnected, without a word, that sends what no page of viser's does."""
    log = logging.getLogger("websockets.server")
    level = log.level
    with warnings.catch_warnings():
        # viser would go on with arguments of another type, which raise errors later and elsewhere.
        warnings.filterwarnings("error", r"\[viser\] .* does not match annotation")
        log.setLevel(logging.CRITICAL)
        try:
            yield
        finally:
            log.setLevel(level)


class _Unbound:
    """Stands for a websockets server that listens to no port."""

    server = types.SimpleNamespace(sockets=())

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        pass

    async def __aenter__(self) -> "_Unbound":
        return self

    async def __aexit__(self, *exception: object) -> None:
        pass


def _refusing_others(serve: Callable[..., Any]) -> Callable[..., Any]:
    """Returns `serve` of websockets with a check of every request before viser's own."""

    def guarded(*args: Any, process_request: Callable[..., Any], **kwargs: Any) -> Any:
        # None, in answer to a request to open a connection, lets websockets open it.
        def answer(connection: Any, request: Any) -> Any:
            if not is_local(request.headers.get_all("Host"), request.headers.get_all("Origin")):
                problem = "This viewer answers only browsers on its own machine.\n"
                return connection.respond(http.HTTPStatus.FORBIDDEN, problem)
            return process_request(connection, request)

        return serve(*args, process_request=answer, **kwargs)

    return guarded


def is_local(hosts: list[str], origins: list[str]) -> bool:
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
            raise OSError(f"port {port} cannot be used ({error.strerror}): choose another one with --port") from error
