"""Variations of sensing and acting: factors of the observation noise, and a delay of the action."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.entities.parameters import Parameter, Quantity

ACTION_DELAY = "sensing/action_delay"

# No field of the physics has these values; the task reads them.
_SCALE = Quantity(read=lambda *_: 1.0, write=lambda *_: None, model_fields=(), non_negative=True)
_DELAY = Quantity(read=lambda *_: 0.0, write=lambda *_: None, model_fields=(), non_negative=True)


class Sensing(NamedTuple):
    """Variation of sensing in episodes; `()` stands for none.

    Attributes:
      noise: `(..., k)`, factors of the draws of the observation noise.
      delay: `(...)`, whether targets reach the actuators one control step late.
      target: `(..., 9)`, targets of the last control step; before the first, the positions at the reset [rad, m].
    """

    noise: NDArray[np.float64]
    delay: NDArray[np.bool_]
    target: NDArray[np.float64]


def sensing_parameters(noise_parts: Mapping[str, slice]) -> tuple[Parameter, ...]:
    """Returns factors of parts of the observation noise, and whether actions are delayed by a control step, 0 or 1."""
    scales = tuple(Parameter(name=f"sensing/{part}", unit="1", quantity=_SCALE, elements=()) for part in noise_parts)
    return (*scales, Parameter(name=ACTION_DELAY, unit="control steps", quantity=_DELAY, elements=()))


def start(
    values: Mapping[str, NDArray[np.float64]],
    noise_parts: Mapping[str, slice],
    noise_draws: int,
    positions: NDArray[np.float64],
) -> Sensing | tuple[()]:
    """Returns the sensing of an episode.

    Args:
      values: of the parameters that vary, by name.
      noise_parts: slices of the draws of the noise, by the last part of the parameter's name.
      noise_draws: number of these draws.
      positions: `(9,)`, of the robot's joints at the reset [rad, m].
    """
    if not any(name.startswith("sensing/") for name in values):
        return ()
    noise = np.ones(noise_draws)
    for part, elements in noise_parts.items():
        noise[elements] = values.get(f"sensing/{part}", 1.0)
    return Sensing(noise, np.array(values.get(ACTION_DELAY, 0.0) > 0.5), positions)


def scaled(sensing: Sensing | tuple[()], draws: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the draws `(..., k)` of the noise, scaled."""
    return draws * sensing.noise if isinstance(sensing, Sensing) else draws


def applied(
    sensing: Sensing | tuple[()], target: NDArray[np.float64]
) -> tuple[NDArray[np.float64], Sensing | tuple[()]]:
    """Returns the targets `(..., 9)` that reach the actuators in a control step, and the sensing after it."""
    if not isinstance(sensing, Sensing):
        return target, sensing
    delayed = np.where(sensing.delay[..., np.newaxis], sensing.target, target)
    return delayed, sensing._replace(target=target)
