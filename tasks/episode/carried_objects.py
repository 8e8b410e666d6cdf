"""How hard an object in the hand is pressed against other things: collisions of what is carried.

Forces are those of every physics step, from the history that MuJoCo keeps of its sensors. The functions compute with
any leading axes `(...)`: one environment has none, many have one.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.scenes import Scene
from kitchen_suite.tasks.episode.draws import Draws
from kitchen_suite.tasks.episode.part import MeasuringPart
from kitchen_suite.tasks.episode.sampled_sensors import SampledSensors
from kitchen_suite.tasks.simulation import Simulation
from kitchen_suite.tasks.terms import Transition
from kitchen_suite.types import Array

# Greatest number of contacts of an object, and of it with the hand, whose forces are summed: those of the greatest.
NUM_CONTACTS = 16

# Force from which on the hand touches an object [N]; far above what differences of sums are rounded by.
_TOUCH = 1e-6


class Carrying(NamedTuple):
    """The collisions of carried objects in an episode, up to the last control step.

    Attributes:
      peak_force: `(...)`, greatest contact force between an object that the hand touches and anything but the hand [N].
    """

    peak_force: Array


class CarriedObjects(MeasuringPart):
    """Measures how hard objects that the hand touches are pressed against others, by sensors that it adds."""

    name = "carried_objects"

    def __init__(self, scene: Scene, joints: Sequence[mjcf.Element | None], physics_steps: int) -> None:
        """Adds the sensors to a scene that is not yet compiled.

        Args:
          scene: with robot and objects.
          joints: of the objects, see `MDP.carried_joints`.
          physics_steps: in a control step.
        """
        super().__init__()
        self._sensors = SampledSensors(scene, physics_steps)
        hand = scene.robot.joints[scene.robot.arm_size - 1].parent
        of_contacts = {"data": "force", "num": NUM_CONTACTS, "reduce": "maxforce"}
        self._slots = len(joints)
        bodies = [joint.parent for joint in joints if joint is not None]
        self._contacts = [self._sensors.add("contact", subtree1=body, **of_contacts) for body in bodies]
        self._contacts += [self._sensors.add("contact", subtree1=body, subtree2=hand, **of_contacts) for body in bodies]

    def bind(self, physics: mjcf.Physics) -> None:
        # Forces are in the frame of the contact, whose normal comes first.
        places = self._sensors.places(physics, self._contacts)[::3].reshape(2, -1)
        # Empty slots read a place of their own, and count nothing.
        missing = places.shape[1] // (len(self._contacts) // 2) * self._slots - places.shape[1]
        self._columns = np.pad(places, ((0, 0), (0, missing))).ravel()
        self._counts = np.pad(np.ones(places.shape), ((0, 0), (0, missing))).ravel()

    def start(self, part: Any, simulation: Simulation, mdp_state: Any, draws: Draws) -> Carrying:
        return Carrying(np.array(0.0))

    def after(self, part: Carrying, simulation: Simulation, step: Transition, draws: Draws) -> Carrying:
        forces = collision_forces(self.reader.read(simulation))
        return Carrying(np.maximum(part.peak_force, np.maximum.reduce(forces, axis=-1)))

    def info(self, part: Carrying) -> dict[str, NDArray]:
        return {"peak_carried_contact_force": np.array(part.peak_force)}

    def read(self, simulation: Simulation) -> Array:
        """Returns the normal forces `(..., 2 k n m)` of contacts, see `collision_forces`."""
        return simulation.read("history", self._columns) * self._counts


def collision_forces(contacts: Array) -> Array:
    """Returns the contact forces on objects that the hand touches, those by the hand left out, `(..., k n)` [N].

    Args:
      contacts: `(..., 2 k n m)`, normal forces of `m` contacts in each of `n` physics steps: of each of `k` objects,
        then of each with the hand [N].
    """
    sums = np.add.reduce(contacts.reshape(*contacts.shape[:-1], 2, -1, NUM_CONTACTS), axis=-1)
    by_hand = sums[..., 1, :]
    # Differences of sums are rounded, and may be just below 0.
    others: Array = np.maximum(sums[..., 0, :] - by_hand, 0.0)
    return np.where(by_hand > _TOUCH, others, 0.0)
