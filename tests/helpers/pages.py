"""Web pages of episodes: their recordings, and headless Chromium with software rendering."""

import base64
import contextlib
import io
import re
import shutil

import msgspec
import numpy as np


def read_page(path):
    """The data of a page: title, episodes and chunks."""
    return script_json(path.read_text("utf-8"), "page-json")


def script_json(text, name):
    """The JSON of a script element, as a browser reads it: without NaN."""
    found = re.search(rf'<script type="application/json" id="{name}">(.*?)</script>', text, re.DOTALL)[1]
    return msgspec.json.decode(found)


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


# Debian's packages chromium-headless-shell and chromium.
BROWSERS = ("chromium-headless-shell", "chromium")
FLAGS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking")

TIMEOUT = 300_000  # [ms], on a machine with other work and no graphics card
SIZE = {"width": 660, "height": 300}


@contextlib.contextmanager
def opened(address):
    """Yields a browser's page, and the addresses that it asks for."""
    from playwright.sync_api import sync_playwright

    executable = next(filter(None, map(shutil.which, BROWSERS)), None)
    assert executable, f"needs one of {BROWSERS}: apt-get install {BROWSERS[0]}"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=FLAGS, timeout=TIMEOUT)
        page = browser.new_page(viewport=SIZE)
        page.set_default_timeout(TIMEOUT)
        asked, errors = [], []
        page.on("request", lambda request: asked.append(request.url))
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(address)
        yield page, asked
        assert not errors
        browser.close()


def wait_for_frames(frame, count):
    """Waits until a frame of a page has been drawn a number of times."""
    frame.evaluate(
        "count => new Promise(done => { let n = 0; (function next() {"
        " if (n++ > count) done(n); else requestAnimationFrame(next); })(); })",
        count,
    )


def take_picture(page, frame, path):
    """Writes a picture of a page one of whose frames draws all the time."""
    # A browser that draws without a pause in software has no time for the picture.
    frame.evaluate("window.requestAnimationFrame = () => 0")
    page.screenshot(path=path)


def assert_shows_a_scene(path, columns):
    """Asserts that some columns of a picture show shapes, of several colours, in the middle of its height."""
    import imageio.v3 as imageio

    image = imageio.imread(path)[..., :3]
    middle = image[image.shape[0] // 4 : -image.shape[0] // 4, columns]
    colours = np.unique(middle.reshape(-1, 3) // 16, axis=0)
    assert len(colours) > 20
    assert middle.std() > 20
