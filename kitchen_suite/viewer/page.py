"""The page in which a person moves the hand: who controls, buttons and keys, arrows to drag, pictures; extra `web`."""

import functools
import math
import queue
import time
from collections.abc import Callable, Coroutine, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from kitchen_suite.rendering.cameras import camera_names, find_camera
from kitchen_suite.rendering.web_scenes import WebScene, set_camera

if TYPE_CHECKING:
    from dm_control import mjcf

    from kitchen_suite.policies.experts.teleoperation import Teleoperation

FIRST_CAMERA = "overview"  # The camera through which a person looks at first, where there is no flag for it.

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
    "or closes the fingers; backspace goes back a second. Time stands still until you move the hand."
)

# Pictures of a camera of the model beside the scene: none, or one of this height and width [pixels]; and the least time
# between two of them [s], for browsers that draw slowly.
NO_PICTURE, _PICTURE, _PICTURE_EVERY = "none", (150, 200), 0.24

_NOTICE = 6.0  # Time that a browser shows a text [s].

_WRISTS = ("franka/wrist", "franka/hand")  # Cameras whose pictures help most to grasp; the first one that a model has.


class Person(Protocol):
    """An episode or a policy whose arm a person moves in the page."""

    @property
    def arm(self) -> "Teleoperation":
        """The arm that is commanded."""

    def hand_back(self) -> None:
        """Lets another policy act again."""


# What is to be done, by the name of what the viewer does, or with the person's episode.
Command = str | Callable[[Any], None]


class Page:
    """A server's page, and the browsers that show it; where a person plays, one of them controls.

    The first browser controls until it leaves or another one takes control; the commands of the others are refused.

    Attributes:
      server: of viser.
      gui: its panel.
      commands: in the order in which they were given, in threads of viser's.
    """

    def __init__(self, server: Any, *, exclusive: bool) -> None:
        """Begins with an empty page; `exclusive` says whether one browser controls, or all of them do."""
        self.server, self.gui, self.exclusive = server, server.gui, exclusive
        self.commands: queue.SimpleQueue[Command] = queue.SimpleQueue()
        self._clients: list[int] = []
        server.on_client_connect(self._connect)
        server.on_client_disconnect(self._disconnect)
        self.clear()

    @property
    def controlling(self) -> int | None:
        """Number of the browser that controls; None without a browser."""
        return next(iter(self._clients), None)

    def clear(self) -> None:
        """Removes panel and scene, and forgets the commands."""
        self.gui.reset()
        self.server.scene.reset()
        self.commands = queue.SimpleQueue()

    def accepts(self, event: Any) -> bool:
        """Returns whether an event comes from a browser that controls; tells the others."""
        if not self.exclusive or event.client_id == self.controlling:
            return True
        if event.client is not None:
            body = "Another browser controls the hand. Press 'Take control' to act from here."
            event.client.add_notification("Watching", body, auto_close_seconds=5.0)
        return False

    def putting(self, command: Command) -> Callable[[Any], Coroutine[Any, Any, None]]:
        """Returns a callback of viser's that gives a command."""

        # In viser's event loop, which keeps the order of events; its threads do not.
        async def put(event: Any) -> None:
            if self.accepts(event):
                self.commands.put(command)

        return put

    def guard(self, widget: Any) -> Any:
        """Lets only a browser that controls change a widget; returns the widget."""
        accepted = widget.value

        async def check(event: Any) -> None:
            nonlocal accepted
            if event.client_id is None or self.accepts(event):
                accepted = widget.value
            else:
                widget.value = accepted

        widget.on_update(check)
        return widget

    def add_button(self, label: str, command: Command, key: str | None = None, **options: Any) -> None:
        """Adds a button that gives a command, and a key that does."""
        self.gui.add_button(label, **options).on_click(self.putting(command))
        if key:
            self.add_key(label, key, command)

    def add_key(self, label: str, key: str, command: Command) -> None:
        """Adds a key that gives a command."""
        self.gui.add_command(label, hotkey=key).on_trigger(self.putting(command))

    def notify(self, title: str, body: str, *, color: str | None = None) -> None:
        """Shows a text for a while in all browsers."""
        for client in self.server.get_clients().values():
            client.add_notification(title, body, auto_close_seconds=_NOTICE, color=color)

    def move_cameras(self, physics: "mjcf.Physics", camera: int) -> None:
        """Moves the views of all browsers to one of the model's cameras."""
        view = self.server.initial_camera
        set_camera(self.server, physics, camera)
        for client in self.server.get_clients().values():
            with client.atomic():
                client.camera.position, client.camera.look_at = view.position, view.look_at
                client.camera.fov = view.fov

    async def _connect(self, client: Any) -> None:
        self._clients.append(client.client_id)

    async def _disconnect(self, client: Any) -> None:
        was_controlling = client.client_id == self.controlling
        if client.client_id in self._clients:
            self._clients.remove(client.client_id)
        if was_controlling and self.exclusive:
            self.commands.put("release")

    async def take_control(self, event: Any) -> None:
        """Gives the browser of an event control; a callback of viser's."""
        if event.client_id != self.controlling:
            self._clients.sort(key=lambda client_id: client_id != event.client_id)
            # Of what the browser held that has controlled until now.
            self.commands.put("release")


class HandPanel:
    """Buttons and keys that move the hand."""

    def __init__(self, page: Page, *, hands_back: bool) -> None:
        """Adds them to a page; `hands_back` says whether another policy acts until the person does."""
        self._page, gui = page, page.gui
        # Rows of two buttons, for those who have no keys.
        for row in zip(*[iter(MOVES)] * 2, strict=True):
            gui.add_button_group("", row).on_click(self._click)
        for label, (key, _, _) in MOVES.items():
            # Of the present size.
            page.add_key(label, key, functools.partial(self._nudge, label))
        page.add_button(
            "Open or close", lambda person: person.arm.grasp(not person.arm.is_closed), "space", hint="The fingers."
        )
        if hands_back:
            page.add_button("Hand back", lambda person: person.hand_back(), "B", hint="The policy acts again.")
        self._size = page.guard(gui.add_dropdown("Nudge", tuple(NUDGES), initial_value=list(NUDGES)[1]))
        take = gui.add_button("Take control", hint="Where several browsers show this page, one controls.")
        take.on_click(page.take_control)
        with gui.add_folder("Help", expand_by_default=False):
            gui.add_markdown(_HELP)

    async def _click(self, event: Any) -> None:
        if self._page.accepts(event) and event.target.value in MOVES:
            self._page.commands.put(functools.partial(self._nudge, event.target.value))

    def _nudge(self, label: str, person: Person) -> None:
        _, offset, turn = MOVES[label]
        length, angle = NUDGES.get(self._size.value, (0.0, 0.0))
        person.arm.nudge(length * np.array(offset), math.radians(angle) * np.array(turn))


class HandGizmo:
    """Arrows and rings at the commanded pose of the hand, and a ball at the hand, which can be dragged."""

    def __init__(self, page: Page, arm: "Teleoperation") -> None:
        """Adds them to the scene."""
        scene = page.server.scene
        self._page, self._is_dragged, self._is_waiting = page, False, False
        self._pose = self._offset = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
        self._arrows = scene.add_transform_controls("/hand/arrows", scale=0.2, depth_test=False, opacity=0.7)
        self._ball = scene.add_icosphere(
            "/hand/ball", radius=0.05, color=(255, 170, 0), opacity=0.35, cast_shadow=False, receive_shadow=False
        )
        self._arrows.on_update(self._move)
        self._ball.on_drag(self._drag)
        self.update(arm)

    def update(self, arm: "Teleoperation") -> None:
        """Moves them to the commanded pose and to the hand; not what is being dragged."""
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

    def _follow(self, person: Person) -> None:
        self._is_waiting = False
        person.arm.move_to(*self._pose)


class Stage:
    """The scene of a model in a page, with what moves the hand where a person plays, and a picture beside it."""

    def __init__(self, page: Page, physics: "mjcf.Physics", camera: str, person: Person | None = None) -> None:
        """Replaces the scene of the page by that of a model, seen through one of its cameras."""
        server = page.server
        server.scene.reset()
        server.scene.set_up_direction("+z")
        self._page = page
        self._scene = WebScene(server, physics, find_camera(physics, camera))
        self._gizmo = HandGizmo(page, person.arm) if person else None
        self._place = person.arm.hand[0] if person else np.zeros(3)
        page.move_cameras(physics, find_camera(physics, camera))
        self.update(physics, person)

    def update(self, physics: "mjcf.Physics", person: Person | None = None, *, follows: bool = False) -> None:
        """Shows the present state; `follows` moves the views with the hand."""
        self._scene.update(physics)
        if self._gizmo and person:
            self._gizmo.update(person.arm)
            place = person.arm.hand[0]
            if follows and not np.allclose(place, self._place, atol=1e-4):
                for client in self._page.server.get_clients().values():
                    # What it looks at moves with it.
                    client.camera.position = client.camera.position + (place - self._place)
            self._place = place

    def shows(self, physics: "mjcf.Physics") -> bool:
        """Returns whether a model's shapes and colours are those that are shown."""
        return self._scene.shows(physics)

    def release(self) -> None:
        """Ends what is being dragged."""
        if self._gizmo:
            self._gizmo.release()


class CameraPicture:
    """A picture of one of the model's cameras in the panel, such as the one at the wrist."""

    def __init__(self, page: Page, physics: "mjcf.Physics") -> None:
        """Adds it to the panel."""
        names = camera_names(physics)
        wrist = next((name for name in _WRISTS if name in names), NO_PICTURE)
        self._choice = page.guard(page.gui.add_dropdown("Picture", (NO_PICTURE, *names), initial_value=wrist))
        self._image = page.gui.add_image(np.zeros((*_PICTURE, 3), np.uint8), format="jpeg", visible=False)
        self._choice.on_update(page.putting("picture"))
        self._can_render, self._shown = True, 0.0
        self.update(physics)

    def offer(self, physics: "mjcf.Physics") -> None:
        """Offers the cameras of another model."""
        chosen = self._choice.value
        names = (NO_PICTURE, *camera_names(physics))
        self._choice.options = names
        self._choice.value = chosen if chosen in names else NO_PICTURE
        self.update(physics)

    @property
    def is_of_now(self) -> bool:
        """Whether the last `update` has shown a picture, or there is none to be shown."""
        return self._is_of_now or not self._can_render or self._choice.value == NO_PICTURE

    def update(self, physics: "mjcf.Physics") -> None:
        """Shows the present picture, unless the last one is new; none without a GL library."""
        now = time.monotonic()
        self._is_of_now = now - self._shown >= _PICTURE_EVERY
        if not self._is_of_now:
            return
        self._shown = now
        if self._can_render and self._choice.value in camera_names(physics):
            height, width = _PICTURE
            try:
                self._image.image = physics.render(height, width, camera_id=self._choice.value)
            except (ImportError, OSError, RuntimeError):
                self._can_render = False
        self._image.visible = self._can_render and self._choice.value != NO_PICTURE
