"""Reads web pages of episodes, and the recordings of viser's in them, as a browser does."""

import base64
import io
import json
import re

import msgspec


def read_page(path):
    """The data of a page: title, episodes and chunks."""
    return script_json(path.read_text("utf-8"), "page-json")


def script_json(text, name):
    """The JSON of a script element."""
    return json.loads(re.search(rf'<script type="application/json" id="{name}">(.*?)</script>', text, re.DOTALL)[1])


def joined(page, episode):
    """The recording of an episode, in viser's format."""
    chunks = [page["chunks"][key] for key in episode["chunks"]]
    return b"".join(base64.b64decode(text) for text in (episode["size"], *chunks))


def contents(recording):
    """The MessagePack and the arrays of a recording; needs the extra `web`."""
    import zstandard

    reader = zstandard.ZstdDecompressor().stream_reader(io.BytesIO(recording[8:]), read_across_frames=True)
    text = reader.read()
    assert len(text) == int.from_bytes(recording[:8], "little")
    end = 8 + int.from_bytes(text[:8], "little")
    head, arrays, start = msgspec.msgpack.decode(text[8:end]), [], end
    for length in head["binaryBufferLengths"]:
        start += -start % 8
        arrays.append(text[start : start + length])
        start += length
    assert start == len(text)
    return head, arrays
