"""The controls that move the hand in a page: buttons and keys, arrows and a ball to drag."""

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from kitchen_suite.viewer.live_page import LivePage, show_where

if TYPE_CHECKING:
    from kitchen_suite.policies.experts.teleoperation import Teleoperation

# Lengths and angles of a nudge [m, degrees] by name.
NUDGES = {"2 mm, 1 degree": (0.002, 1.0), "1 cm, 5 degrees": (0.01, 5.0), "3 cm, 15 degrees": (0.03, 15.0)}

# Keys of the nudges, and their directions in the frame of the robot's base: offset, and axis of the turn. The letters
# are robosuite's.
MOVES: Mapping[str, tuple[str, Sequence[float], Sequence[float]]] = {
    "Forward": ("arrowup", (1, 0, 0), (0, 0, 0)),
    "Back": ("arrowdown", (-1, 0, 0), (0, 0, 0)),
    "Left": ("arrowleft", (0, 1, 0), (0, 0, 0)),
    "Right": ("arrowright", (0, -1, 0), (0, 0, 0)),
    "Up": ("pageup", (0, 0, 1), (0, 0, 0)),
    "Down": ("pagedown", (0, 0, -1), (0, 0, 0)),
    "Yaw left": ("O", (0, 0, 0), (0, 0, 1)),
    "Yaw right": ("P", (0, 0, 0), (0, 0, -1)),
    "Pitch up": ("Y", (0, 0, 0), (0, 1, 0)),
    "Pitch down": ("H", (0, 0, 0), (0, -1, 0)),
    "Roll left": ("E", (0, 0, 0), (1, 0, 0)),
    "Roll right": ("R", (0, 0, 0), (-1, 0, 0)),
}
_HELP = (
    "Drag the hand, or the arrows and rings at it. Keys: arrows, page up and down; O P, Y H, E R to turn; space opens "
    "or closes the fingers; backspace rewinds a second; B gives back to the policy. Time stands still until you move "
    "the hand."
)


class Person(Protocol):
    """An episode or a policy whose arm a person moves in the page."""

    @property
    def arm(self) -> "Teleoperation":
        """The arm that is commanded."""

    @property
    def can_hand_back(self) -> bool:
        """Whether another policy could act in place of the person, who acts."""

    def hand_back(self) -> None:
        """Lets another policy act again."""


class HandPanel:
    """Buttons and keys that move the hand."""

    def __init__(self, page: LivePage, person: Callable[[], Person]) -> None:
        """Adds them to a page; `person` returns whose arm moves when a command is carried out."""
        gui = page.gui
        self._page = page
        self._person = person
        # Rows of two buttons, for those who have no keys.
        for row in zip(*[iter(MOVES)] * 2, strict=True):
            gui.add_button_group("", row).on_click(self._click)
        for label, (key, _, _) in MOVES.items():
            # Of the present size.
            page.add_key(label, key, functools.partial(self._nudge, label))
        page.add_button("Open or close", self._open_or_close, "space", hint="The fingers.")
        self._give_back = page.add_button("Give back to the policy", lambda: person().hand_back(), "B", visible=False)
        self._size = page.guard(gui.add_dropdown("Nudge", tuple(NUDGES), initial_value=list(NUDGES)[1]))
        page.add_take_control()
        with gui.add_folder("Help", expand_by_default=False):
            gui.add_markdown(_HELP)

    def update(self) -> None:
        """Shows the button that gives back to the policy where it does something."""
        show_where(self._give_back, self._person().can_hand_back)

    async def _click(self, event: Any) -> None:
        if self._page.accepts(event):
            self._page.commands.put(functools.partial(self._nudge, event.target.value))

    def _open_or_close(self) -> None:
        arm = self._person().arm
        arm.grasp(not arm.is_closed)

    def _nudge(self, label: str) -> None:
        _, offset, turn = MOVES[label]
        length, angle = NUDGES[self._size.value]
        self._person().arm.nudge(length * np.array(offset), math.radians(angle) * np.array(turn))


class HandGizmo:
    """Arrows and rings at the commanded pose of the hand, and a ball at the hand, which can be dragged."""

    def __init__(self, page: LivePage, person: Person) -> None:
        """Adds them to the scene; the pose commands a person's arm."""
        scene = page.server.scene
        self._page = page
        self._person = person
        self._is_dragged = False
        self._is_waiting = False
        self._pose = self._offset = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
        self._arrows = scene.add_transform_controls("/hand/arrows", scale=0.2, depth_test=False, opacity=0.7)
        self._ball = scene.add_icosphere(
            "/hand/ball", radius=0.05, color=(255, 170, 0), opacity=0.35, cast_shadow=False, receive_shadow=False
        )
        self._arrows.on_update(self._move)
        self._ball.on_drag(self._drag)
        self.update()

    def update(self) -> None:
        """Moves them to the commanded pose and to the hand; not what is being dragged."""
        arm = self._person.arm
        position, orientation = arm.hand
        self._ball.position = position
        if not self._is_dragged:
            self._arrows.position, self._arrows.wxyz = arm.command or (position, orientation)

    def release(self) -> None:
        """Ends what is being dragged."""
        self._is_dragged = False

    async def _move(self, event: Any) -> None:
        if self._page.accepts(event):
            self._is_dragged = event.phase != "end"
            self._command(self._arrows.position, self._arrows.wxyz)

    async def _drag(self, event: Any) -> None:
        if not self._page.accepts(event):
            return
        if event.phase == "start":
            # The point that was clicked is not the centre, and moves with the hand.
            self._offset = self._ball.position - np.array(event.start_position), self._arrows.wxyz
        offset, orientation = self._offset
        self._command(np.array(event.end_position) + offset, orientation)

    def _command(self, position: Any, orientation: Any) -> None:
        """Commands a pose, in place of all poses since the last time."""
        pose = np.array(position, float), np.array(orientation, float)
        # A browser can send anything, such as a place 100 m away.
        if not all((np.abs(part) < 100.0).all() for part in pose) or not pose[1].any():
            return
        self._pose = pose
        if not self._is_waiting:
            self._is_waiting = True
            self._page.commands.put(self._follow)

    def _follow(self) -> None:
        self._is_waiting = False
        self._person.arm.move_to(*self._pose)
