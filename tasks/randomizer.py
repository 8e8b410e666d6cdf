"""Draws parameters of a scene at resets, and sets them."""

from collections.abc import Iterable, Mapping

import mujoco
import numpy as np
from dm_control import mjcf
from dm_control.composer import variation
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.entities.parameters import Parameter
from kitchen_suite.tasks import variations
from kitchen_suite.tasks.variations import Variation

# Fields of MuJoCo's model that `mj_setConst` computes from masses, inertias and poses.
DERIVED_FIELDS = (
    "body_subtreemass",
    "body_invweight0",
    "dof_invweight0",
    "dof_M0",
    "tendon_length0",
    "tendon_invweight0",
    "actuator_length0",
    "actuator_acc0",
)


class Randomizer:
    """Draws the wanted parameters and sets them in a physics; with none wanted, it draws and sets nothing.

    Attributes:
      values: present values of the wanted parameters by name; before the first reset, those of the built scene.
    """

    values: Mapping[str, NDArray[np.float64]]

    def __init__(
        self, parameters: Mapping[str, Parameter], wanted: Mapping[str, Variation], *, owner: str = "randomization"
    ) -> None:
        """Selects the wanted parameters; `bind` must be called before anything is set.

        Args:
          parameters: all that the scene offers, by name, in the order in which values are drawn.
          wanted: variations by name; None leaves a parameter as it was built.
          owner: of the parameters' names, for messages.

        Raises:
          TypeError: a constant is not made of real numbers.
          ValueError: there is no such parameter, or a constant has the wrong shape or is out of range.
        """
        for name in wanted:
            checks.choice(name, parameters.keys(), f"{owner}'s parameter")
        self._parameters = {name: each for name, each in parameters.items() if wanted.get(name) is not None}
        self._variations = {name: wanted[name] for name in self._parameters}
        self._quantities = {name: parameter.quantity for name, parameter in self._parameters.items()}
        self._owner = owner
        self.values = {}
        variations.check_constants(self._variations, self._quantities, owner)

    @property
    def model_fields(self) -> tuple[str, ...]:
        """Fields of MuJoCo's model that the physics of an episode depends on and a reset may change."""
        quantities = [quantity for quantity in self._quantities.values() if not quantity.visual]
        derived = DERIVED_FIELDS if any(quantity.derived for quantity in quantities) else ()
        return _union((*(quantity.model_fields for quantity in quantities), derived))

    @property
    def visual_fields(self) -> tuple[str, ...]:
        """Further fields of MuJoCo's model that a reset may change, on which only images depend."""
        return _union(quantity.model_fields for quantity in self._quantities.values() if quantity.visual)

    def bind(self, physics: mjcf.Physics) -> None:
        """Makes `set` change a physics, which must have the values of the built scene."""
        self._physics = physics
        is_derived = any(quantity.derived for quantity in self._quantities.values())
        self._scratch = mujoco.MjData(physics.model.ptr) if is_derived else None
        self.values = {name: parameter.get(physics) for name, parameter in self._parameters.items()}

    def draw(self, random_state: np.random.RandomState) -> dict[str, NDArray[np.float64]]:
        """Returns new values, drawn in the order of the parameters; sets nothing.

        Raises:
          TypeError: a variation returned something else than real numbers.
          ValueError: it returned the wrong shape, or numbers that are out of range.
        """
        drawn = {name: variation.evaluate(each, random_state=random_state) for name, each in self._variations.items()}
        return self.checked(drawn)

    def checked(self, values: Mapping[str, NDArray]) -> dict[str, NDArray[np.float64]]:
        """Returns values of the wanted parameters that `set` accepts; raises as `draw`."""
        return variations.checked(values, self._quantities, self._owner)

    def set(self, values: Mapping[str, NDArray[np.float64]]) -> None:
        """Sets checked values of all wanted parameters, and updates the kinematics."""
        if not self._parameters:
            return
        self.values = {name: np.array(value, np.float64) for name, value in values.items()}
        for name, value in self.values.items():
            self._parameters[name].set(self._physics, value)
        model = self._physics.model.ptr
        if self._scratch:
            # `mj_setConst` moves the data that it computes with to the model's default pose.
            mujoco.mj_setConst(model, self._scratch)
        mujoco.mj_kinematics(model, self._physics.data.ptr)


def _union(groups: Iterable[Iterable[str]]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(field for group in groups for field in group))
