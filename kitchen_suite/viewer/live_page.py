"""The page of a server that runs: the browsers that show it, which of them controls, and the commands given there."""

import queue
from collections.abc import Callable, Coroutine
from typing import Any

import viser
from dm_control import mjcf

from kitchen_suite.viewer.scene import set_camera

_NOTICE = 6.0  # Time that a browser shows a text [s].

Command = Callable[[], None]
"""Something to do for an event; called by the program that shows the page, in its own thread."""


class LivePage:
    """A server's page, and the browsers that show it; where a person plays, one of them controls.

    The first browser controls until it leaves or another one takes control; the commands of the others are refused.

    Attributes:
      server: of viser.
      gui: its panel.
      commands: in the order in which they were given, in threads of viser's.
      on_release: command that is given when the browser is gone that has controlled until now.
    """

    def __init__(self, server: viser.ViserServer, *, exclusive: bool) -> None:
        """Begins with an empty page; `exclusive` says whether one browser controls, or all of them do."""
        self.server = server
        self.gui = server.gui
        self.exclusive = exclusive
        self.commands: queue.SimpleQueue[Command] = queue.SimpleQueue()
        self.on_release: Command = lambda: None
        self._clients: list[int] = []
        self._take_control: viser.GuiButtonHandle | None = None
        server.on_client_connect(self._connect)
        server.on_client_disconnect(self._disconnect)

    @property
    def controlling(self) -> int | None:
        """Number of the browser that controls; None without a browser."""
        return next(iter(self._clients), None)

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

    def add_button(self, label: str, command: Command, key: str | None = None, **options: Any) -> viser.GuiButtonHandle:
        """Adds a button that gives a command, and a key that does; returns the button."""
        button = self.gui.add_button(label, **options)
        button.on_click(self.putting(command))
        if key:
            self.add_key(label, key, command)
        return button

    def add_take_control(self) -> None:
        """Adds a button by which a browser takes control, shown while there are several."""
        hint = "Several browsers show this page; one controls."
        self._take_control = self.gui.add_button("Take control", hint=hint, visible=len(self._clients) > 1)
        self._take_control.on_click(self.take_control)

    def add_key(self, label: str, key: str, command: Command) -> None:
        """Adds a key that gives a command."""
        self.gui.add_command(label, hotkey=key).on_trigger(self.putting(command))

    def notify(self, title: str, body: str, *, color: str | None = None) -> None:
        """Shows a text for a while in all browsers."""
        for client in self.server.get_clients().values():
            client.add_notification(title, body, auto_close_seconds=_NOTICE, color=color)

    def move_cameras(self, physics: mjcf.Physics, camera: int) -> None:
        """Moves the views of all browsers to one of the model's cameras."""
        view = self.server.initial_camera
        set_camera(self.server, physics, camera)
        for client in self.server.get_clients().values():
            with client.atomic():
                client.camera.position, client.camera.look_at = view.position, view.look_at
                client.camera.fov = view.fov

    async def take_control(self, event: Any) -> None:
        """Gives the browser of an event control; a callback of viser's."""
        if event.client_id != self.controlling:
            self._clients.sort(key=lambda client_id: client_id != event.client_id)
            # Of what the browser held that has controlled until now.
            self.commands.put(self.on_release)

    async def _connect(self, client: viser.ClientHandle) -> None:
        self._clients.append(client.client_id)
        self._offer_control()

    async def _disconnect(self, client: viser.ClientHandle) -> None:
        was_controlling = client.client_id == self.controlling
        if client.client_id in self._clients:
            self._clients.remove(client.client_id)
            self._offer_control()
        if was_controlling and self.exclusive:
            self.commands.put(self.on_release)

    def _offer_control(self) -> None:
        if self._take_control:
            show_where(self._take_control, len(self._clients) > 1)


def show_where(widget: Any, condition: bool) -> None:
    """Shows a widget where a condition holds, and hides it where it does not."""
    # Browsers are sent what changes alone.
    if widget.visible != condition:
        widget.visible = condition
