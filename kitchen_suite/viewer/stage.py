"""A model as a live page shows it: its scene, the hand to be moved in it, and the image of a camera beside it."""

import time

import numpy as np
from dm_control import mjcf

from kitchen_suite.rendering.cameras import camera_names, find_camera
from kitchen_suite.viewer.hand import HandGizmo, Person
from kitchen_suite.viewer.live_page import LivePage
from kitchen_suite.viewer.scene import Scene

# Images of a camera of the model beside the scene: none, or one of this height and width.
_NO_IMAGE = "none"
_IMAGE_SIZE = (150, 200)  # [pixels]
_IMAGE_EVERY = 0.24  # Least time between two of them [s], for browsers that draw slowly.

_FOLLOWED = 1e-4  # Distance [m] from which views follow the hand.

_WRISTS = ("franka/wrist", "franka/hand")  # Cameras whose images help most to grasp; the first one that a model has.


class Stage:
    """The scene of a model in a page, with what moves the hand where a person plays."""

    def __init__(self, page: LivePage, physics: mjcf.Physics, camera: str, person: Person | None = None) -> None:
        """Replaces the scene of the page by that of a model, seen through one of its cameras."""
        server = page.server
        server.scene.reset()
        server.scene.set_up_direction("+z")
        self._page = page
        self._person = person
        self._scene = Scene(server, physics, find_camera(physics, camera))
        self._gizmo = HandGizmo(page, person) if person else None
        self._place = person.arm.hand[0] if person else np.zeros(3)
        self._moved = np.zeros(3)
        page.move_cameras(physics, find_camera(physics, camera))

    def update(self, physics: mjcf.Physics) -> None:
        """Shows the current state."""
        self._scene.update(physics)
        if self._gizmo and self._person:
            self._gizmo.update()
            place = self._person.arm.hand[0]
            self._moved = place - self._place
            self._place = place

    def follow(self) -> None:
        """Moves the views of all browsers as the last update has moved the hand."""
        if np.abs(self._moved).max() > _FOLLOWED:
            for client in self._page.server.get_clients().values():
                # What it looks at moves with it.
                client.camera.position = client.camera.position + self._moved

    def shows(self, physics: mjcf.Physics) -> bool:
        """Returns whether a model's shapes and colours are those that are shown."""
        return self._scene.shows(physics)

    def release(self) -> None:
        """Ends what is being dragged."""
        if self._gizmo:
            self._gizmo.release()


class CameraImage:
    """An image of one of the model's cameras in the panel, such as the one at the wrist."""

    def __init__(self, page: LivePage, physics: mjcf.Physics) -> None:
        """Adds it to the panel."""
        names = camera_names(physics)
        wrist = next((name for name in _WRISTS if name in names), _NO_IMAGE)
        self._choice = page.guard(page.gui.add_dropdown("Picture", (_NO_IMAGE, *names), initial_value=wrist))
        self._image = page.gui.add_image(np.zeros((*_IMAGE_SIZE, 3), np.uint8), format="jpeg", visible=False)
        # Chosen anew, it is shown with the next state.
        self._choice.on_update(page.putting(lambda: None))
        self._can_render = True
        self._shown = 0.0
        self.update(physics)

    def offer(self, physics: mjcf.Physics) -> None:
        """Offers the cameras of another model."""
        chosen = self._choice.value
        names = (_NO_IMAGE, *camera_names(physics))
        self._choice.options = names
        self._choice.value = chosen if chosen in names else _NO_IMAGE
        self.update(physics)

    @property
    def is_of_now(self) -> bool:
        """Whether the last `update` has shown an image, or there is none to be shown."""
        return self._is_of_now or not self._can_render or self._choice.value == _NO_IMAGE

    def update(self, physics: mjcf.Physics) -> None:
        """Shows the current image, unless the last one is new; none without a GL library."""
        now = time.monotonic()
        self._is_of_now = now - self._shown >= _IMAGE_EVERY
        if not self._is_of_now:
            return
        self._shown = now
        if self._can_render and self._choice.value in camera_names(physics):
            height, width = _IMAGE_SIZE
            try:
                self._image.image = physics.render(height, width, camera_id=self._choice.value)
            except (ImportError, OSError, RuntimeError):
                self._can_render = False
        self._image.visible = self._can_render and self._choice.value != _NO_IMAGE
