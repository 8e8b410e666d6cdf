"""A page of viser's, driven through its protocol; needs the extra `web`."""

import contextlib
import re
import time

import pytest

TIMEOUT = 120.0  # [s], on a machine with other work
MAX_WINDOWS = 10_000  # Windows of messages, some 25 in a second.

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (1.0, 1.0, 1.0),
    "fov": 1.0,
    "near": 0.01,
    "far": 100.0,
    "image_height": 10,
    "image_width": 10,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}


class Browser:
    """A page's copy of the panel: values of widgets by their labels, and the text."""

    def __init__(self, port, token=""):
        import viser
        from websockets.sync.client import connect

        address = f"ws://localhost:{port}/{token}"
        self._socket = connect(
            address, subprotocols=[f"viser-v{viser.__version__}"], origin=f"http://localhost:{port}", max_size=None
        )
        self.widgets, self.text, self.nodes, self.options, self.keys = {}, {}, set(), {}, {}
        self.notifications, self.windows = [], 0
        self.send(CAMERA)

    def close(self):
        self._socket.close()

    def set(self, label, value):
        """Sets a widget, or clicks a button."""
        self.wait(lambda: label in self.widgets)
        self.send({"type": "GuiUpdateMessage", "uuid": self.widgets[label], "updates": {"value": value}})

    def click(self, label):
        """Clicks a button."""
        self.set(label, True)

    def press(self, label):
        """Presses the key of a command of some label."""
        self.wait(lambda: label in self.keys)
        self.send({"type": "CommandTriggerMessage", "uuid": self.keys[label]})

    def move(self, position, *, name="/hand/arrows", wxyz=(1.0, 0.0, 0.0, 0.0), ends=True):
        """Drags the arrows of transform controls to a pose, and lets them go."""
        self.send({"type": "TransformControlsDragStartMessage", "name": name, "owner": ""})
        pose = {"wxyz": [*wxyz], "position": [*position]}
        self.send({"type": "TransformControlsUpdateMessage", "name": name, "owner": "", **pose})
        if ends:
            self.send({"type": "TransformControlsDragEndMessage", "name": name, "owner": ""})

    def read(self, seconds):
        """Receives messages for some time."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            with contextlib.suppress(TimeoutError):
                self._receive(left)

    def wait(self, condition):
        """Receives messages until a condition holds."""
        for _ in range(MAX_WINDOWS):
            if condition():
                return
            self._receive(TIMEOUT)
        pytest.fail(self.report())

    def number(self, name):
        """Returns a number of the report."""
        return int(re.search(rf"{name} \| (\d+)", self.report())[1])

    def report(self):
        return "\n".join(str(text) for text in self.text.values())

    def _receive(self, timeout):
        for message in messages(self._socket.recv(timeout=timeout)):
            self._take(message)
        self.windows += 1

    def _take(self, message):
        kind = message["type"]
        if kind == "GuiMarkdownMessage":
            self.text[message["uuid"]] = message["props"]["_markdown"]
        elif kind.startswith("Gui") and "label" in message.get("props", {}):
            self.widgets[message["props"]["label"]] = message["uuid"]
        elif kind == "GuiUpdateMessage" and "_markdown" in message["updates"]:
            self.text[message["uuid"]] = message["updates"]["_markdown"]
        elif kind == "GuiUpdateMessage" and "options" in message["updates"]:
            self.options[message["uuid"]] = [*message["updates"]["options"]]
        elif kind == "RegisterCommandMessage":
            self.keys[message["props"]["label"]] = message["uuid"]
        elif kind == "NotificationShowMessage":
            self.notifications.append(message["props"]["body"])
        elif kind in ("BatchedGlbMessage", "GlbMessage"):
            self.nodes.add(message["name"])

    def send(self, message):
        import msgspec

        self._socket.send(msgspec.msgpack.encode(message))


def messages(received):
    """The messages of a window that the server has sent."""
    import msgspec
    import zstandard

    size = int.from_bytes(received[8:16], "little")
    return msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(received[16 : 16 + size]))["messages"]
