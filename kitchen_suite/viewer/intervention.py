"""The page in loops of other programs: a Gymnasium wrapper with gym-hil's infos, a device with robosuite's methods."""

import contextlib
import queue
import time
from typing import Any, SupportsFloat

import dm_env
import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.names import EXTRA_PACKAGES
from kitchen_suite.rendering.viser_servers import check_extra, local_server
from kitchen_suite.viewer.page import FIRST_CAMERA, HandPanel, Page, Stage


class InterventionWrapper(gymnasium.Wrapper):
    """Lets a person in a browser take over from whatever acts in an environment of the suite, and hand back.

    A command in the page takes over: `step` then makes the person's actions in place of those that it is given, in real
    time, until *Hand back*. Infos have, as gym-hil's: `is_intervention`, whether the person acted, and `teleop_action`,
    the action that was made.
    """

    def __init__(self, env: gymnasium.Env, port: int = 8080) -> None:
        """Serves the page at a port of this machine; raises an ImportError without the extras `web` and `experts`."""
        _check_extras("InterventionWrapper")
        from kitchen_suite.policies.experts.teleoperation import TeleoperatedPolicy

        super().__init__(env)
        self._inner, self._closing = suite_env(env), contextlib.ExitStack()
        self._given: NDArray[np.float32] = np.zeros(0, np.float32)
        self._policy = TeleoperatedPolicy(self._inner.composer_task, lambda timestep: self._given)
        self._page = Page(self._closing.enter_context(local_server(port, "kitchen-suite")), exclusive=True)
        HandPanel(self._page, hands_back=True)
        self._stage: Stage | None = None
        self._timestep: dm_env.TimeStep | None = None
        self._due = 0.0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        result = super().reset(seed=seed, options=options)
        self._timestep = dm_env.restart(self._inner.present_observation)
        self._policy.observe(self._timestep)
        self._policy.hand_back()
        self._show()
        return result

    def step(self, action: Any) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        assert self._timestep is not None
        self._given = np.asarray(action, np.float32)
        _carry_out(self._page, self._policy, wait=0.0)
        # Where the person acts, until the next step is due.
        while self._policy.is_persons and (left := self._due - time.monotonic()) > 0.0:
            _carry_out(self._page, self._policy, wait=left)
        self._due = time.monotonic() + self._inner.environment.control_timestep()
        if self._page.controlling is None and self._policy.is_persons:
            self._policy.hand_back()
        assert isinstance(self.action_space, gymnasium.spaces.Box)
        made = np.clip(self._policy(self._timestep), self.action_space.low, self.action_space.high)
        observation, reward, termination, truncation, info = super().step(made)
        self._timestep = dm_env.transition(float(reward), self._inner.present_observation)
        self._policy.observe(self._timestep)
        self._show()
        return observation, reward, termination, truncation, {**info, **self._policy.labels, "teleop_action": made}

    def close(self) -> None:
        self._closing.close()
        super().close()

    def _show(self) -> None:
        physics = self._inner.environment.physics
        if self._stage is None or not self._stage.shows(physics):
            self._stage = Stage(self._page, physics, FIRST_CAMERA, self._policy)
        self._stage.update(physics, self._policy)


class PageDevice:
    """Buttons and keys in a browser as an input device, with the methods of robosuite's `Device`; for any simulator.

    A class that is derived from this one and from `robosuite.devices.Device` is a device of robosuite's.

    Attributes:
      wants_reset: whether another episode is wanted; whoever has heard it sets it back.
    """

    def __init__(self, env: Any = None, pos_sensitivity: float = 1.0, rot_sensitivity: float = 1.0, port: int = 8080):
        """Serves the page at a port of this machine; raises an ImportError without the extras `web` and `experts`.

        Args:
          env: of robosuite; unused without its `Device`.
          pos_sensitivity: factor of displacements.
          rot_sensitivity: factor of turns.
          port: of the page.
        """
        _check_extras("PageDevice")
        if self._is_robosuites:
            super().__init__(env)  # type: ignore[call-arg]
        self.env, self._closing = env, contextlib.ExitStack()
        self._position = checks.number(pos_sensitivity, "pos_sensitivity", positive=True)
        self._rotation = checks.number(rot_sensitivity, "rot_sensitivity", positive=True)
        self.arm, self.wants_reset = _Commanded(), False
        self._page = Page(self._closing.enter_context(local_server(port, "kitchen-suite")), exclusive=True)
        HandPanel(self._page, hands_back=False)
        self._page.add_button("Reset", lambda device: device.request_reset(), hint="Starts another episode.")

    def start_control(self) -> None:
        """Forgets what has been commanded, for a new episode."""
        _carry_out(self._page, self, wait=0.0)
        self.arm, self.wants_reset = _Commanded(), False
        if self._is_robosuites:
            self._reset_internal_state()  # type: ignore[attr-defined]

    @property
    def _is_robosuites(self) -> bool:
        """Whether this is of a class that is derived from robosuite's `Device` as well."""
        return hasattr(self, "_reset_internal_state")

    def get_controller_state(self) -> dict[str, Any]:
        """Returns what has been commanded since the last call.

        By name: `dpos`, a displacement `(3,)` [m]; `rotation`, of all turns since `start_control`, a matrix `(3, 3)`;
        `raw_drotation`, the new turn `(3,)` [rad] in robosuite's order and signs: about y, about x, and about z the
        other way; `grasp`, whether the fingers are closed, 0 or 1; `reset`, whether another episode is wanted, 0 or 1;
        `base_mode`, always 0.
        """
        _carry_out(self._page, self, wait=0.0)
        offset, turn = self.arm.taken()
        return {
            "dpos": self._position * offset,
            "rotation": self.arm.rotation.as_matrix(),
            "raw_drotation": self._rotation * turn[[1, 0, 2]] * (1.0, 1.0, -1.0),
            "grasp": int(self.arm.is_closed),
            "reset": int(self.wants_reset),
            "base_mode": 0,
        }

    def close(self) -> None:
        """Ends the page."""
        self._closing.close()

    def request_reset(self) -> None:
        """Says that another episode is wanted."""
        self.wants_reset = True

    def hand_back(self) -> None:
        """Does nothing: nobody else acts."""

    def _postprocess_device_outputs(
        self, dpos: NDArray[np.float64], drotation: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns displacement and turn as robosuite's controllers take them, within -1 and 1.

        0.05 m and 0.5 rad are 1: the largest action of its OSC_POSE controller by default.
        """
        return np.clip(dpos / 0.05, -1.0, 1.0), np.clip(drotation / 0.5, -1.0, 1.0)


class _Commanded:
    """Stands for an arm: sums up nudges, with the `rotation` of all turns; `is_closed` if the fingers are to close."""

    def __init__(self) -> None:
        import mink

        self._exponential = mink.SO3.exp
        self.is_closed, self.rotation = False, mink.SO3.identity()
        self._offset, self._turn = np.zeros(3), np.zeros(3)

    def nudge(self, offset: ArrayLike, turn: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """Adds a displacement `(3,)` [m] and a turn `(3,)` [rad]."""
        moved, turned = np.asarray(offset, float), np.asarray(turn, float)
        self._offset, self._turn = self._offset + moved, self._turn + turned
        self.rotation = self._exponential(turned) @ self.rotation

    def grasp(self, close: bool) -> None:
        """Closes the fingers, or opens them."""
        self.is_closed = close

    def taken(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Returns displacement and turn since the last call."""
        taken = self._offset, self._turn
        self._offset, self._turn = np.zeros(3), np.zeros(3)
        return taken


def _check_extras(what: str) -> None:
    """Raises an ImportError unless the extras `web` and `experts` are installed."""
    check_extra(what)
    checks.installed(EXTRA_PACKAGES["experts"], what, "experts")


def _carry_out(page: Page, person: Any, *, wait: float) -> None:
    """Carries out the commands that have been given; waits for one for some time [s] if there is none."""
    with contextlib.suppress(queue.Empty):
        command = page.commands.get(timeout=wait) if wait > 0.0 else page.commands.get_nowait()
        while True:
            # A command that cannot be carried out, such as a pose that no arm reaches, is none.
            with contextlib.suppress(ValueError):
                if callable(command):
                    command(person)
            command = page.commands.get_nowait()
