"""The page in loops of other programs: a Gymnasium wrapper with the infos of gym-hil."""

import contextlib
import queue
import time
from typing import Any, SupportsFloat

import dm_env
import gymnasium
import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks, installation
from kitchen_suite.closing import closed_on_error
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.installation import EXTRA_PACKAGES
from kitchen_suite.viewer.hand import HandPanel
from kitchen_suite.viewer.live_page import LivePage
from kitchen_suite.viewer.servers import address_of, local_server, new_token
from kitchen_suite.viewer.stage import Stage

_CAMERA = "overview"  # Through which a person looks at first.


class InterventionWrapper(gymnasium.Wrapper):
    """Lets a person in a browser take over from whatever acts in an environment of the suite, and hand back.

    A command in the page takes over: `step` then makes the person's actions in place of those that it is given, in real
    time, until *Give back to the policy*. Infos have, as gym-hil's: `is_intervention`, whether the person acted, and
    `teleop_action`, the action that was made.

    Attributes:
      address: of the page.
    """

    def __init__(self, env: gymnasium.Env, port: int = 8080, *, token: bool = True) -> None:
        """Serves the page, at `address`, at a port of this machine.

        With a `token`, which the address has, other users of the machine are refused. Raises an ImportError without the
        extra `experts`.
        """
        installation.installed(EXTRA_PACKAGES["experts"], "InterventionWrapper", "experts")
        from kitchen_suite.policies.experts.teleoperation import TeleoperatedPolicy

        super().__init__(env)
        self._inner = suite_env(env)
        self._closing = closing = contextlib.ExitStack()
        self._given: NDArray[np.float32] = np.zeros(0, np.float32)
        self._policy = TeleoperatedPolicy(self._inner.composer_task, lambda timestep: self._given)
        secret = new_token() if checks.boolean(token, "token") else ""
        with closed_on_error([closing]):
            server = closing.enter_context(local_server(port, secret))
            self.address = address_of(port, secret)
            self._page = LivePage(server, exclusive=True)
            self._hand = HandPanel(self._page, lambda: self._policy)
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
        self._carry_out(wait=0.0)
        # Where the person acts, until the next step is due.
        while self._policy.is_persons and (left := self._due - time.monotonic()) > 0.0:
            self._carry_out(wait=left)
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
            self._stage = Stage(self._page, physics, _CAMERA, self._policy)
        self._stage.update(physics)
        self._hand.update()

    def _carry_out(self, *, wait: float) -> None:
        """Carries out the commands that have been given; waits for one for some time [s] if there is none."""
        commands = self._page.commands
        with contextlib.suppress(queue.Empty):
            command = commands.get(timeout=wait) if wait > 0.0 else commands.get_nowait()
            while True:
                # A command that cannot be carried out, such as a pose that no arm reaches, is none.
                with contextlib.suppress(ValueError):
                    command()
                command = commands.get_nowait()
