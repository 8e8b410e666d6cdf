"""A self-contained web page that shows recorded episodes in 3-D; needs the extra `web`.

Each episode is a recording of viser's, which viser's own player shows: MessagePack and binary arrays, compressed by
zstd. The page holds it in chunks, each a zstd frame of its own, so that episodes share what they have in common, above
all the meshes: frames that follow each other are decoded as one.
"""

import base64
import hashlib
import html
import importlib.resources
import re
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec
import numpy as np

_MIN_SHARED = 512  # Bytes from which a message has a chunk of its own: meshes are larger, poses are smaller.


class WebPage:
    """Episodes of a page."""

    def __init__(self) -> None:
        self._chunks: dict[str, str] = {}
        self._episodes: list[dict[str, Any]] = []

    def __len__(self) -> int:
        """Number of episodes."""
        return len(self._episodes)

    def add(self, recording: bytes, about: Mapping[str, Any]) -> None:
        """Adds an episode: a recording of viser's, and its name and progress, as `web_page.html` reads them."""
        parts = list(_parts(recording))
        size = sum(map(len, parts)).to_bytes(8, "little")
        self._episodes.append({**about, "size": base64.b64encode(size).decode(), "chunks": [*map(self._chunk, parts)]})

    def html(self, title: str) -> str:
        """Returns the page, which loads nothing from elsewhere."""
        import viser

        # viser's page, which plays the recording that it is given as a global variable.
        player = importlib.resources.files(viser).joinpath("client/build/index.html").read_text(encoding="utf-8")
        values = {
            "title": html.escape(title),
            "page": _script_json({"title": title, "episodes": self._episodes, "chunks": self._chunks}),
            "player": _script_json(player),
        }
        text = importlib.resources.files(__package__).joinpath("web_page.html").read_text(encoding="utf-8")
        return re.sub(r"\[\[(\w+)\]\]", lambda match: values[match[1]], text)

    def _chunk(self, part: bytes) -> str:
        """Stores a part unless it is there; returns its key."""
        import zstandard

        key = hashlib.sha256(part).hexdigest()[:16]
        if key not in self._chunks:
            # The level of viser's own recordings.
            frame = zstandard.ZstdCompressor(level=12).compress(part)
            self._chunks[key] = base64.b64encode(frame).decode()
        return key


def _parts(recording: bytes) -> Iterator[bytes]:
    """Yields the decompressed contents of a recording part by part; each large message is one part."""
    import zstandard

    size = int.from_bytes(recording[:8], "little")
    contents = zstandard.ZstdDecompressor().decompress(recording[8:], max_output_size=size)
    end = 8 + int.from_bytes(contents[:8], "little")
    head, messages = _encoded(contents[8:end])
    length = len(head) + sum(map(len, messages))
    waiting = length.to_bytes(8, "little") + head
    for message in messages:
        if len(message) < _MIN_SHARED:
            waiting += message
            continue
        yield waiting
        yield message
        waiting = b""
    arrays = contents[end + -end % 8 :]
    # They begin at a multiple of 8 bytes, after another number of bytes than before.
    padding = bytes(-(8 + length) % 8) if arrays else b""
    yield waiting + padding + arrays


def _encoded(payload: bytes) -> tuple[bytes, list[bytes]]:
    """Returns the MessagePack of a recording: all before its messages, and each message."""
    recorded = msgspec.msgpack.decode(payload)
    messages = recorded.pop("messages")
    head = bytes([0x80 | (len(recorded) + 1)])  # MessagePack: a map with this number of keys.
    for key, value in (*recorded.items(), ("messages", None)):
        head += msgspec.msgpack.encode(key) + (b"" if value is None else msgspec.msgpack.encode(value))
    return head + b"\xdd" + len(messages).to_bytes(4, "big"), [msgspec.msgpack.encode(each) for each in messages]


def _script_json(value: Any) -> str:
    """Returns JSON that can stand in a script element; numbers that JSON does not have are null."""
    # Numbers of NumPy, such as metrics of a task of the user's own, become Python's.
    return msgspec.json.encode(value, enc_hook=np.generic.item).decode().replace("<", "\\u003c")
