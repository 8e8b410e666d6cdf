"""Web pages in headless Chromium, with software rendering."""

import pytest
from helpers import pages

from kitchen_suite.commands import rollout

pytestmark = pytest.mark.browser


def wait_for_numbers(page, text):
    """Waits until the numbers beside the scene have a text."""
    has_text = "text => document.querySelector('#numbers').innerText.includes(text)"
    # Not at every frame, of which there are few.
    page.wait_for_function(has_text, arg=text, polling=200)


def test_a_page_plays_in_a_browser_from_the_file_alone(tmp_path):
    path, picture = tmp_path / "page.html", tmp_path / "page.png"
    arguments = ["--num_episodes=2", "--policy=expert", "--task_name=kettle", f"--web={path}"]
    assert rollout.main(arguments) == 0
    with pages.opened(f"file://{path}") as (page, asked):
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
        pages.wait_for_frames(page.frames[-1], 6)
        pages.take_picture(page, page.frames[-1], picture)
        assert all(url.startswith(("file:", "data:", "blob:")) for url in asked), asked
    pages.assert_shows_a_scene(picture, slice(-220, None))
