"""The page as a teleoperator of LeRobot, of type `kitchen_browser`."""

import dataclasses
from typing import Any

from lerobot.teleoperators.config import TeleoperatorConfig
from lerobot.teleoperators.teleoperator import Teleoperator
from lerobot.teleoperators.utils import TeleopEvents

from kitchen_suite import checks
from kitchen_suite.viewer.intervention import PageDevice


@TeleoperatorConfig.register_subclass("kitchen_browser")
@dataclasses.dataclass(kw_only=True)
class BrowserTeleopConfig(TeleoperatorConfig):
    """Settings of the page.

    Attributes:
      port: of the page, on this machine alone.
      step: displacement that an action of 1 stands for [m]; by default that of gym-hil.
    """

    port: int = 8080
    step: float = 0.025


class BrowserTeleop(Teleoperator):
    """Buttons and keys in a browser, with the actions of LeRobot's `keyboard_ee`: no X11, and no further device.

    An action has `delta_x`, `delta_y` and `delta_z`, from -1 to 1, and `gripper`: 0 closes, 1 stays, 2 opens.
    """

    config_class = BrowserTeleopConfig
    name = "kitchen_browser"

    def __init__(self, config: BrowserTeleopConfig) -> None:
        """Takes the settings; `connect` serves the page."""
        super().__init__(config)
        checks.number(config.step, "step", positive=True)
        self._config = config
        self._device: PageDevice | None = None
        self._is_closed = self._moved = self._wants_reset = False

    @property
    def action_features(self) -> dict:
        return {"delta_x": float, "delta_y": float, "delta_z": float, "gripper": float}

    @property
    def feedback_features(self) -> dict:
        return {}

    @property
    def is_connected(self) -> bool:
        return self._device is not None

    @property
    def is_calibrated(self) -> bool:
        return True

    def connect(self, calibrate: bool = True) -> None:
        self._device = PageDevice(port=self._config.port)
        self._is_closed = self._moved = self._wants_reset = False

    def calibrate(self) -> None:
        """Does nothing: there is nothing to calibrate."""

    def configure(self) -> None:
        """Does nothing: all settings are in the configuration."""

    def get_action(self) -> dict[str, Any]:
        state = self._connected().get_controller_state()
        deltas = (state["dpos"] / self._config.step).clip(-1.0, 1.0).tolist()
        is_closed = bool(state["grasp"])
        gripper = 1.0 if is_closed == self._is_closed else 0.0 if is_closed else 2.0
        self._is_closed = is_closed
        if state["reset"]:
            self._wants_reset = True
            self._connected().wants_reset = False
        self._moved = any(deltas) or gripper != 1.0
        return {**dict(zip(("delta_x", "delta_y", "delta_z"), deltas, strict=True)), "gripper": gripper}

    def get_teleop_events(self) -> dict[str, Any]:
        """Returns whether the last action was a person's, and, once, whether the episode is to be recorded again.

        That an episode has succeeded the environment says, not the page.
        """
        self._connected()
        wants_reset, self._wants_reset = self._wants_reset, False
        return {
            TeleopEvents.IS_INTERVENTION: self._moved,
            TeleopEvents.TERMINATE_EPISODE: wants_reset,
            TeleopEvents.SUCCESS: False,
            TeleopEvents.RERECORD_EPISODE: wants_reset,
        }

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Does nothing: a page has no motors."""

    def disconnect(self) -> None:
        self._connected().close()
        self._device = None

    def _connected(self) -> PageDevice:
        if self._device is None:
            raise ConnectionError("the page is not served: call connect() first")
        return self._device
