"""The live viewer in headless Chromium, with software rendering."""

import re
import subprocess
import sys

import pytest
from helpers import pages

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
        assert all(url.startswith((address, "data:", "blob:")) for url in asked), asked
    pages.assert_shows_a_scene(picture, slice(0, 330))


def wait_for_report(page, pattern):
    """Waits until the panel has a text."""
    # Not at every frame, of which there are few.
    page.wait_for_function(
        "pattern => new RegExp(pattern).test(document.body.innerText)", arg=re.compile(pattern).pattern, polling=200
    )
