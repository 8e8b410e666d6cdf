"""Web pages and the live viewer in headless Chromium, with software rendering."""

import contextlib
import shutil

import numpy as np
import pytest

from kitchen_suite.cli import rollout

pytestmark = pytest.mark.browser

# Debian's packages chromium-headless-shell and chromium.
BROWSERS = ("chromium-headless-shell", "chromium")
FLAGS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking")

TIMEOUT = 300_000  # [ms], on a machine with other work and no graphics card
SIZE = {"width": 660, "height": 300}


@contextlib.contextmanager
def opened(path):
    """Yields a browser's page of a file, and the addresses that it asks for."""
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
        page.goto(f"file://{path}")
        yield page, asked
        assert not errors
        browser.close()


def wait_for_numbers(page, text):
    """Waits until the numbers beside the scene have a text."""
    has_text = "text => document.querySelector('#numbers').innerText.includes(text)"
    # Not at every frame, of which there are few.
    page.wait_for_function(has_text, arg=text, polling=200)


def frames(page, count):
    """Waits until the player has drawn a number of frames."""
    page.frames[-1].evaluate(
        "count => new Promise(done => { let n = 0; (function next() {"
        " if (n++ > count) done(n); else requestAnimationFrame(next); })(); })",
        count,
    )


def test_a_page_plays_in_a_browser_from_the_file_alone(tmp_path):
    path, picture = tmp_path / "page.html", tmp_path / "page.png"
    arguments = ["--num_episodes=2", "--policy=expert", "--task_name=kettle", f"--web={path}"]
    assert rollout.main(arguments) == 0
    with opened(path) as (page, asked):
        player = page.frame_locator("#player")
        time = player.locator("input").first
        time.wait_for()
        assert page.locator("#episode option").all_inner_texts() == ["episode 0, seed 0", "episode 1, seed 1"]
        time.fill("0.0")
        page.get_by_text("tasks completed").wait_for()
        wait_for_numbers(page, "0 of 1")
        assert "move the kettle" in page.inner_text("#instruction")
        # The address of the page changes first, and then the player's.
        with page.expect_event("framenavigated", lambda frame: frame != page.main_frame):
            page.select_option("#episode", "1")
        assert page.url.endswith("page.html#2")
        time.wait_for()
        time.fill("2.0")  # [s], between the end of the episode and that of its last frame
        wait_for_numbers(page, "1 of 1")
        assert "yes" in page.inner_text("#numbers")
        frames(page, 6)
        # A browser that draws without a pause in software has no time for the picture.
        page.frames[-1].evaluate("window.requestAnimationFrame = () => 0")
        page.screenshot(path=picture)
        assert all(url.startswith(("file:", "data:", "blob:")) for url in asked), asked
    assert_shows_the_scene(picture)


def assert_shows_the_scene(picture):
    """Asserts that the right part of a picture shows shapes, of several colours, in its middle."""
    import imageio.v3 as imageio

    image = imageio.imread(picture)[..., :3]
    middle = image[image.shape[0] // 4 : -image.shape[0] // 4, -image.shape[1] // 3 :]
    colours = np.unique(middle.reshape(-1, 3) // 16, axis=0)
    assert len(colours) > 20
    assert middle.std() > 20
