"""Policies on a server: a client of openpi's protocol, with messages of msgpack over a websocket.

A server first sends its metadata, a map. A request is a map of the observation's arrays by key, and the task's sentence
as `prompt`. An answer is a map with `actions`: one action `(k,)`, or a chunk `(t, k)` for the next control steps. An
answer of text reports an error. Arrays are maps of `__ndarray__`, `data`, `dtype` and `shape`; nothing is pickled.
"""

import collections
import contextlib
import re
import time
import weakref
from typing import Any

import dm_env
import msgpack
import numpy as np
from numpy.typing import NDArray
from websockets.exceptions import ConnectionClosed, InvalidMessage, WebSocketException
from websockets.sync.client import ClientConnection, connect

from kitchen_suite import checks
from kitchen_suite.closing import closed_on_error

MAX_BYTES = 2**24  # Of an answer: far more than a chunk of actions takes.
_PAUSES = (0.25, 0.5, 1.0, 2.0, 4.0)  # Before further attempts [s]: the server may be starting.
# Errors after which a request is sent again.
_LOST = (ConnectionRefusedError, ConnectionResetError, BrokenPipeError, ConnectionClosed, InvalidMessage)
_TOO_LARGE = 1009  # Reason for which a connection is closed: RFC 6455, section 7.4.1.
_NUMBERS = re.compile(r"[<>|=]?[biuf]\d{1,2}")


class RemotePolicy:
    """Acts as a server answers; a chunk of actions is played to its end before the next request.

    Each policy has a connection of its own, so that a server can tell apart episodes that are played at once. Calls
    raise a ConnectionError if the server cannot be reached, or does not answer with actions.

    Attributes:
      instruction: the sentence that is sent; while it is empty, that of the environment's task.
      metadata: of the server.
    """

    def __init__(self, environment: dm_env.Environment, address: str, timeout: float) -> None:
        """Connects to an address such as `ws://localhost:8000`; an answer may take `timeout` [s]."""
        self.instruction = ""
        self._task, self._size = environment.task, environment.action_spec().shape[0]
        self._address, self._timeout = address, timeout
        self._connection: ClientConnection | None = None
        self._chunk: collections.deque[NDArray] = collections.deque()
        self.metadata: dict[Any, Any] = {}
        self._closing = contextlib.ExitStack()
        # The threads of connections would keep them open until the process ends.
        weakref.finalize(self, self._closing.close)
        with closed_on_error([self._closing]):
            self._ask(None)

    def __call__(self, timestep: dm_env.TimeStep) -> NDArray:
        if timestep.first():
            self._chunk.clear()
        if not self._chunk:
            request: dict[str, Any] = {key: np.asarray(value) for key, value in timestep.observation.items()}
            request["prompt"] = self.instruction or self._task.instruction
            self._chunk.extend(_actions(self._ask(msgpack.packb(request, default=_packed)), self._size))
        return self._chunk.popleft()

    def _ask(self, request: bytes | None, pauses: tuple[float, ...] = _PAUSES) -> dict[Any, Any]:
        """Returns the answer to a request, or without one the metadata; tries again after pauses [s]."""
        try:
            if self._connection is None:
                self._connection = self._connect()
                self.metadata = _content(self._connection.recv(self._timeout))
            if request is None:
                return self.metadata
            with contextlib.suppress(TimeoutError):
                # It would be taken for the answer.
                unasked = checks.shown(_content(self._connection.recv(0)))
                raise ConnectionError(f"the server sent a message that was not asked for: {unasked}")
            self._connection.send(request)
            return _content(self._connection.recv(self._timeout))
        except _LOST as error:
            self._connection = None
            if _TOO_LARGE in (getattr(getattr(error, side, None), "code", None) for side in ("sent", "rcvd")):
                raise ConnectionError(f"a message is too large (here, above {MAX_BYTES} bytes): {error}") from error
            if not pauses:
                raise ConnectionError(f"the server is not there: {checks.shown(error)}") from error
        except TimeoutError as error:
            raise ConnectionError(f"the server did not answer within {self._timeout:g} s") from error
        except ConnectionError:  # Of the content of a message.
            raise
        except (OSError, WebSocketException) as error:
            raise ConnectionError(f"there is no such server: {checks.shown(error)}") from error
        time.sleep(pauses[0])
        return self._ask(request, pauses[1:])

    def _connect(self) -> ClientConnection:
        """Returns a new connection, which is direct, and without pings, since a busy server does not answer them."""
        limits: dict[str, Any] = {"max_size": MAX_BYTES, "open_timeout": self._timeout, "close_timeout": 1.0}
        # The one that was lost.
        self._closing.close()
        return self._closing.enter_context(
            connect(self._address, compression=None, proxy=None, ping_interval=None, **limits)
        )


def _actions(answer: dict[Any, Any], size: int) -> NDArray:
    """Returns the actions `(t, size)` of an answer, t >= 1."""
    actions = answer.get("actions")
    if not isinstance(actions, np.ndarray) or actions.dtype.kind not in "fiu":
        raise ConnectionError(f"the server's actions must be an array of numbers, got {checks.shown(answer)}")
    if actions.ndim not in (1, 2) or actions.shape[-1] != size or not len(actions):
        raise ConnectionError(f"the server's actions must have shape ({size},) or (t, {size}), got {actions.shape}")
    if not np.isfinite(actions).all():
        raise ConnectionError(f"the server's actions must be finite, got {checks.shown(actions)}")
    return np.atleast_2d(actions)


def _content(message: str | bytes) -> dict[Any, Any]:
    """Returns the map that a message holds."""
    if isinstance(message, str):
        raise ConnectionError(f"the server reports an error: {checks.shortened(message, 500)}")
    try:
        content = msgpack.unpackb(message, object_hook=_unpacked)
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise ConnectionError(f"the server's message cannot be read: {checks.shown(error)}") from error
    if not isinstance(content, dict):
        raise ConnectionError(f"the server's message must be a map, got {checks.shown(content)}")
    return content


def _packed(array: NDArray) -> dict[bytes, Any]:
    return {b"__ndarray__": True, b"data": array.tobytes(), b"dtype": array.dtype.str, b"shape": array.shape}


def _unpacked(content: dict[Any, Any]) -> Any:
    if not content.keys() & {b"__ndarray__", b"__npgeneric__"}:
        return content
    if not _NUMBERS.fullmatch(content[b"dtype"]):
        raise ValueError(f"{checks.shown(content[b'dtype'])} is no type of numbers")
    dtype, data = np.dtype(content[b"dtype"]), content[b"data"]
    return np.frombuffer(data, dtype).reshape(content[b"shape"]) if b"__ndarray__" in content else dtype.type(data)
