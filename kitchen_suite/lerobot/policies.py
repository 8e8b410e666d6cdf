"""LeRobot's policies in the suite's episodes: `kitchen_suite.evaluate(LeRobotPolicy(path), takes="observation")`.

It needs the extra `lerobot`.
"""

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from lerobot.configs.policies import PreTrainedConfig
from lerobot.envs.utils import preprocess_observation
from lerobot.policies.factory import get_policy_class, make_pre_post_processors
from numpy.typing import NDArray

from kitchen_suite.lerobot.observations import AGENT_POS, ENVIRONMENT_STATE, PIXELS, environment_keys

_IMAGES = "observation.images."


class LeRobotPolicy:
    """A policy of LeRobot, which takes observations of one of the `obs_type`s that LeRobot has.

    Its queue of actions is that of an episode. The copies that act in other environments share its weights.

    Attributes:
      instruction: the task's sentence, for policies that read it.
    """

    def __init__(self, path: str | Path, *, device: str = "cpu") -> None:
        """Reads a policy and its processors.

        Args:
          path: a folder `pretrained_model` of a checkpoint, or a repository of the Hub.
          device: on which it acts, such as `cuda`.
        """
        config = PreTrainedConfig.from_pretrained(path)
        config.pretrained_path = Path(path)
        config.device = device
        self.instruction = ""
        self._policy = get_policy_class(config.type).from_pretrained(path, config=config).eval()
        self._before, self._after = make_pre_post_processors(
            policy_cfg=config,
            pretrained_path=str(path),
            preprocessor_overrides={"device_processor": {"device": device}},
        )

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        weights = [*self._policy.parameters(), *self._policy.buffers()]
        # What is in the memo is not copied.
        memo |= {id(weight): weight for weight in weights}
        copied = copy.copy(self)
        memo[id(self)] = copied
        vars(copied).update({name: copy.deepcopy(value, memo) for name, value in vars(self).items()})
        return copied

    def reset(self) -> None:
        """Forgets the last episode."""
        self._policy.reset()
        self._before.reset()
        self._after.reset()

    @torch.no_grad()
    def __call__(self, observation: Mapping[str, Any]) -> NDArray[np.float32]:
        """Returns the action for an observation of one environment."""
        batch = preprocess_observation(self._laid_out(observation))
        batch["task"] = [self.instruction]
        action = self._after(self._policy.select_action(self._before(batch)))
        return action.squeeze(0).cpu().numpy()

    def _laid_out(self, observation: Mapping[str, Any]) -> dict[str, Any]:
        """Returns an observation as LeRobot's environments have it; see `LeRobotObservations`."""
        laid_out: dict[str, Any] = {AGENT_POS: observation[AGENT_POS]}
        if vectors := [observation[key] for key in environment_keys(observation)]:
            laid_out[ENVIRONMENT_STATE] = np.concatenate(vectors)
        if PIXELS in observation:
            pixels = observation[PIXELS]
            if not isinstance(pixels, Mapping):
                # The suite does not name the camera where there is one.
                (camera,) = self._policy.config.image_features
                pixels = {camera.removeprefix(_IMAGES): pixels}
            laid_out[PIXELS] = dict(pixels)
        return laid_out
