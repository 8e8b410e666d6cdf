"""The live viewer in headless Chromium, with software rendering."""

import contextlib
import re
import subprocess
import sys

import numpy as np
import pytest
from helpers import pages

from kitchen_suite.commands import replay
from kitchen_suite.episodes.recording import Recording

pytestmark = pytest.mark.browser


@pytest.fixture
def address(port):
    """Address of a viewer that runs."""
    flags = ["--domain_name=microwave_table", "--policy=zero", f"--port={port}"]
    command = [sys.executable, "-m", "kitchen_suite", "view", *flags]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
        yield running.stdout.readline().split()[0]
        running.kill()


def test_the_viewer_is_driven_in_a_browser(address, tmp_path):
    picture = tmp_path / "viewer.png"
    with pages.opened(address) as (page, asked):
        page.get_by_text("control step").wait_for()
        page.get_by_role("checkbox", name="Run").click()
        page.get_by_role("button", name="Reset").click()
        wait_for_report(page, r"control step\s+0 of")
        page.get_by_role("button", name="Step").click()
        wait_for_report(page, r"control step\s+1 of")
        page.locator(".mantine-Notification-closeButton").click()  # of viser's warning of software rendering
        pages.wait_for_frames(page, 6)
        pages.take_picture(page, page, picture)
        own = address.partition("?")[0]
        assert all(url.startswith((own, "data:", "blob:")) for url in asked), asked
    pages.assert_shows_a_scene(picture, slice(0, 330))


def test_a_person_moves_the_hand_and_saves_an_episode(port, tmp_path):
    """With real keys."""
    folder = tmp_path / "mine"
    flags = ["--teleop", "--domain_name=microwave_table", f"--output={folder}", f"--port={port}"]
    command = [sys.executable, "-m", "kitchen_suite", "view", *flags]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
        with pages.opened(running.stdout.readline().split()[0]) as (page, _):
            wait_for_report(page, r"control step\s+0 of 2000")
            page.locator(".mantine-Notification-closeButton").click()
            page.keyboard.press("PageUp")
            wait_for_report(page, r"control step\s+[1-9]")
            page.keyboard.press("Space")
            wait_for_report(page, r"fingers\s+closed")
            page.keyboard.press("Enter")
            wait_for_report(page, r"episodes saved\s+1")
            wait_for_report(page, r"control step\s+0 of 2000")
        running.kill()
    arrays = Recording.open(folder).load(0).arrays
    assert arrays["label/is_intervention"].all()
    assert np.abs(arrays["action"]).max() > 0.0
    assert replay.main([str(folder)]) == 0


def test_a_script_moves_the_kettle_by_pointer_and_keys(tmp_path):
    """The hand itself is dragged; what is saved replays to the bit."""
    from helpers.scripted_person import drive

    driven = drive("kettle", 0, tmp_path / "mine", tmp_path / "end.png")
    assert driven["success"]
    assert replay.main([str(tmp_path / "mine")]) == 0
    pages.assert_shows_a_scene(tmp_path / "end.png", slice(0, 600))


def test_a_key_that_is_held_moves_on(port):
    with teleoperated(port) as page:
        height = hand_height(page)
        # Playwright repeats a key that is down, as a keyboard does.
        for _ in range(6):
            page.keyboard.down("PageUp")
        page.keyboard.up("PageUp")
        page.wait_for_timeout(3_000)
        assert hand_height(page) - height == pytest.approx(0.06, abs=0.01)


def test_a_phone_has_buttons(port):
    """A narrow page, without keys."""
    with teleoperated(port) as page:
        page.set_viewport_size({"width": 390, "height": 800})
        height = hand_height(page)
        page.get_by_role("button", name="Up", exact=True).first.click()
        wait_for_report(page, r"control step\s+[1-9]")
        page.wait_for_timeout(2_000)
        assert hand_height(page) > height + 0.005


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844)])
def test_the_hand_and_save_are_in_view_and_the_rest_is_folded(port, tmp_path, width, height):
    with teleoperated(port, f"--output={tmp_path / 'mine'}") as page:
        page.set_viewport_size({"width": width, "height": height})
        page.wait_for_timeout(2_000)
        for name in ("Save", "Forward", "Up", "Open or close"):
            box = page.get_by_role("button", name=name, exact=True).first.bounding_box()
            assert 0 <= box["y"] <= height - box["height"]
            assert 0 <= box["x"] <= width - box["width"]
        for name in ("Step", "Load"):
            assert not page.get_by_role("button", name=name, exact=True).first.is_visible()


def test_the_page_begins_with_the_task_and_its_success_and_a_phone_has_it_below_the_scene(port):
    with teleoperated(port) as page:
        assert page.title() == "Kitchen Suite"
        page.set_viewport_size({"width": 390, "height": 844})
        page.wait_for_timeout(2_000)
        sentence = page.get_by_text("move the kettle to the top left burner").bounding_box()
        success = page.get_by_text("success:").bounding_box()
        forward = page.get_by_role("button", name="Forward", exact=True).bounding_box()
        assert 0.5 * 844 < sentence["y"] < success["y"] < forward["y"]
        # The scene ends where the sheet begins.
        scene = page.locator("canvas").first.bounding_box()
        assert 0.5 * 844 < scene["height"] <= sentence["y"]
        assert scene["width"] == 390


def test_buttons_that_do_nothing_are_not_shown(port):
    with teleoperated(port) as page:
        page.set_viewport_size({"width": 1280, "height": 800})
        names = ("Rewind 1 s", "Rewind n steps", "Discard")
        shown = [page.get_by_role("button", name=name, exact=True) for name in names]
        assert not any(button.is_visible() for button in shown)
        page.get_by_role("button", name="Up", exact=True).click()
        for button in shown:
            button.wait_for()
        # Nobody else watches, and no policy has acted.
        for name in ("Take control", "Give back to the policy"):
            assert not page.get_by_role("button", name=name, exact=True).is_visible()


def test_saving_says_whether_the_task_was_done(port, tmp_path):
    with teleoperated(port, f"--output={tmp_path / 'mine'}") as page:
        page.set_viewport_size({"width": 1280, "height": 800})
        page.get_by_role("button", name="Up", exact=True).first.click()
        wait_for_report(page, r"control step\s+[1-9]")
        page.keyboard.press("Enter")
        wait_for_report(page, "Saved a failed episode")
        wait_for_report(page, "seed 0: the task was not done")


@contextlib.contextmanager
def teleoperated(port, *arguments):
    """A page in which a person moves the hand."""
    command = [sys.executable, "-m", "kitchen_suite", "view", "--teleop", "--task_name=kettle", f"--port={port}"]
    command += arguments
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
        with pages.opened(running.stdout.readline().split()[0]) as (page, _):
            wait_for_report(page, r"control step\s+0 of 2000")
            page.locator(".mantine-Notification-closeButton").click()
            yield page
        running.kill()


def hand_height(page):
    return float(re.search(r"hand\s*-?[\d.]+, -?[\d.]+, (-?[\d.]+) m", page.inner_text("body"))[1])


def wait_for_report(page, pattern):
    """Waits until the panel has a text."""
    # Not at every frame, of which there are few.
    page.wait_for_function(
        "pattern => new RegExp(pattern).test(document.body.innerText)", arg=re.compile(pattern).pattern, polling=200
    )
