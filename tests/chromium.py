"""Headless Chromium with software rendering, and what its pictures show."""

import contextlib
import shutil

import numpy as np

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
