"""A script that teleoperates in a browser as a person does: by real pointer and key events.

It reads the page, drags the hand to where it wants to see it, and moves by keys what a drag cannot, which is along the
line of sight. Where it wants the hand is taken from the path of the scripted expert, in places some centimetres apart.
"""

import contextlib
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import mink
import numpy as np
from numpy.typing import NDArray

from kitchen_suite import policies, suite
from kitchen_suite.policies.experts.teleoperation import TeleoperatedPolicy
from kitchen_suite.rendering.cameras import camera_parameters
from kitchen_suite.viewer.hand import MOVES

# Size of the page [pixels]; the panel covers its right third.
WIDTH, HEIGHT = 960, 480

# Distance between places on a path [m], of a place that is reached, and of a key press.
SPACING, REACHED, NUDGE = 0.04, 0.012, 0.01
TURN, TURNED = np.deg2rad(5.0), np.deg2rad(4.0)

# Keys of the browser by the names of the panel.
KEYS = {"arrowup": "ArrowUp", "arrowdown": "ArrowDown", "arrowleft": "ArrowLeft", "arrowright": "ArrowRight"}
KEYS |= {"pageup": "PageUp", "pagedown": "PageDown"}

# Debian's packages chromium-headless-shell and chromium, and flags for software rendering.
BROWSERS = ("chromium-headless-shell", "chromium")
FLAGS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")


class Place(NamedTuple):
    """Where the hand is wanted: position [m], orientation, and whether the fingers are closed."""

    position: NDArray[np.float64]
    orientation: mink.SO3
    is_closed: bool


def expert_path(task_name: str, seed: int) -> list[Place]:
    """Returns places on the path of the scripted expert, and one some centimetres beyond its end."""
    environment = suite.load("kitchen", task_name, {"visuals": False, "random": seed})
    act = policies.find("expert(speed=0.5)")(environment, np.random.default_rng(seed))
    person = TeleoperatedPolicy(environment.task)
    path: list[Place] = []
    timestep = environment.reset()
    while not timestep.last():
        person.observe(timestep)
        position, quaternion = person.arm.hand
        fingers = timestep.observation["franka/joint_positions"][7:]
        place = Place(position, mink.SO3(quaternion), bool(fingers.mean() < 0.03))
        if not path or _differ(path[-1], place):
            path.append(place)
        timestep = environment.step(act(timestep))
    beyond = place.position + 2 * (place.position - path[-2].position)
    return [*path[1:], place, place._replace(position=beyond)]


def _differ(one: Place, other: Place) -> bool:
    moved = np.linalg.norm(other.position - one.position) >= SPACING
    turned = np.linalg.norm((other.orientation @ one.orientation.inverse()).log()) >= 2 * TURN
    return bool(moved or turned or one.is_closed != other.is_closed)


class ScriptedPerson:
    """Moves the hand in a page of the viewer, by pointer and keys."""

    def __init__(self, page: Any, task_name: str, seed: int) -> None:
        """Takes a page of Playwright that shows a task of the kitchen, through the camera `overview`."""
        environment = suite.load("kitchen", task_name, {"visuals": False, "random": seed})
        person, timestep = TeleoperatedPolicy(environment.task), environment.reset()
        person.observe(timestep)
        self._page, self._orientation = page, mink.SO3(person.arm.hand[1])
        self._camera = camera_parameters(environment.physics, "overview", WIDTH, HEIGHT)
        base = environment.physics.bind(environment.task.robot.mjcf_model.find("body", "link0"))
        self._base = np.reshape(base.xmat, (3, 3)).copy()
        self._is_closed = False

    def text(self) -> str:
        """Returns the text of the panel."""
        # Not innerText, for which the browser arranges the page anew.
        return str(self._page.evaluate("() => document.body.textContent"))

    def hand(self) -> NDArray[np.float64]:
        """Returns where the page says that the hand is [m]."""
        found = re.search(r"hand\s*(-?[\d.]+), (-?[\d.]+), (-?[\d.]+) m", self.text())
        assert found
        return np.array([float(number) for number in found.groups()])

    @property
    def has_succeeded(self) -> bool:
        """Whether the page says so."""
        return re.search(r"success\s*yes", self.text()) is not None

    def go(self, place: Place) -> None:
        """Moves the hand to a place, or as near as it comes: what it pushes may hold it up."""
        self._turn(place.orientation)
        for _ in range(6):
            away = place.position - self.hand()
            if np.linalg.norm(away) < REACHED or self.has_succeeded:
                break
            self._drag(away)
            self._wait_until_still()
            self._press_along(place.position - self.hand())
            self._wait_until_still()
        if place.is_closed != self._is_closed:
            self.press("space")
            self._is_closed = place.is_closed
            time.sleep(0.8)

    def press(self, key: str) -> None:
        """Presses a key by viser's name."""
        self._page.keyboard.press(KEYS.get(key, key.capitalize() if len(key) > 1 else key.lower()))

    def _pixel(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        seen = np.linalg.inv(self._camera.world_from_camera) @ [*position, 1.0]
        image = self._camera.intrinsics @ seen[:3]
        return image[:2] / image[2]

    def _drag(self, away: NDArray[np.float64]) -> None:
        """Drags the ball at the hand by what the camera sees of an offset, in steps as those of a pointer."""
        here = self.hand()
        forward = self._camera.world_from_camera[:3, 2]
        seen = away - forward * (forward @ away)
        if np.linalg.norm(seen) < REACHED / 2:
            return
        start, end = self._pixel(here), self._pixel(here + seen)
        # Below the centre, where arrows begin.
        start[1], end[1] = start[1] + 9, end[1] + 9
        mouse = self._page.mouse
        mouse.move(*start)
        mouse.down()
        for part in np.linspace(0.125, 1.0, 8):
            mouse.move(*(start + (end - start) * part))
            time.sleep(0.03)
        mouse.up()

    def _press_along(self, away: NDArray[np.float64]) -> None:
        """Moves by keys, in steps of a nudge along the axes of the base."""
        steps = np.rint(self._base.T @ away / NUDGE).astype(int)
        for axis, count in enumerate(steps):
            self._press_times(axis, count, first=0)

    def _turn(self, orientation: mink.SO3) -> None:
        for _ in range(12):
            away = self._base.T @ (orientation @ self._orientation.inverse()).log()
            axis = int(np.abs(away).argmax())
            if abs(away[axis]) < TURNED:
                return
            sign = 1 if away[axis] > 0 else -1
            self._press_times(axis, sign, first=1)
            turn = self._base @ (sign * TURN * np.eye(3)[axis])
            self._orientation = mink.SO3.exp(turn) @ self._orientation

    def _press_times(self, axis: int, count: int, *, first: int) -> None:
        """Presses the key of the nudge along an axis, or of the turn about it."""
        wanted = np.eye(3)[axis] * np.sign(count)
        key = next(key for key, *directions in MOVES.values() if np.array_equal(directions[first], wanted))
        for _ in range(abs(count)):
            self.press(key)
            time.sleep(0.02)

    def _wait_until_still(self) -> None:
        before = self.hand()
        for _ in range(40):
            time.sleep(0.2)
            now = self.hand()
            if np.linalg.norm(now - before) < 0.002:
                return
            before = now


@contextlib.contextmanager
def shown(
    *flags: str,
    port: int = 18080,
    program: Sequence[str] = ("-m", "kitchen_suite", "view"),
    size: tuple[int, int] = (WIDTH, HEIGHT),
) -> Iterator[tuple[Any, Any]]:
    """Yields a page of headless Chromium that shows the viewer with some flags, and the viewer's process."""
    from playwright.sync_api import sync_playwright

    command = [sys.executable, *program, "--teleop", f"--port={port}", *flags]
    executable = next(filter(None, map(shutil.which, BROWSERS)), None)
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process, sync_playwright() as playwright:
        try:
            assert process.stdout
            address = process.stdout.readline().split()[0]
            browser = playwright.chromium.launch(executable_path=executable, args=FLAGS)
            page = browser.new_page(viewport={"width": size[0], "height": size[1]})
            page.set_default_timeout(120_000)
            page.goto(address)
            page.wait_for_function("() => /control step/.test(document.body.innerText)", polling=200)
            # viser's warning of software rendering.
            page.locator(".mantine-Notification-closeButton").click()
            page.wait_for_timeout(3_000)
            yield page, process
            browser.close()
        finally:
            process.kill()


def drive(task_name: str, seed: int, folder: Path, picture: Path | None = None) -> dict[str, Any]:
    """Plays a task by pointer and keys, and saves the episode; returns whether it succeeded, steps and time [s]."""
    path = expert_path(task_name, seed)
    flags = (f"--task_name={task_name}", f"--seed={seed}", f"--output={folder}", "--camera=overview")
    with shown(*flags) as (page, _):
        started, person = time.monotonic(), ScriptedPerson(page, task_name, seed)
        for place in path:
            person.go(place)
            if person.has_succeeded:
                break
        success = person.has_succeeded
        if picture:
            page.screenshot(path=picture)
        seconds = time.monotonic() - started
        person.press("enter")
        page.wait_for_function("() => /episodes saved\\s+1/.test(document.body.innerText)", polling=200)
    return {"task": task_name, "seed": seed, "success": success, "seconds": round(seconds, 1)}
