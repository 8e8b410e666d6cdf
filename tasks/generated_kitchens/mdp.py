"""The Markov decision process of generated kitchens: requests, success, reward, observation.

What differs from kitchen to kitchen is part of the state, so that one MDP steps episodes in many kitchens together.
"""

import dataclasses
import functools
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple, Self

import numpy as np
import tree
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.fixtures import Part
from kitchen_suite.entities.generated_kitchen import MAX_PARTS, GeneratedKitchen
from kitchen_suite.entities.scenes import Scene
from kitchen_suite.tasks import rotations
from kitchen_suite.tasks.completion_mdp import CompletionMDP
from kitchen_suite.tasks.generated_kitchens.slots import (
    NOISE,
    NOISE_SIZE,
    SLOT_SIZE,
    SlotReading,
    Slots,
    SlotSensors,
    hand_pose,
    measured,
    observed_positions,
    observed_slots,
    observed_velocities,
    single,
)
from kitchen_suite.tasks.goals import Progress
from kitchen_suite.tasks.orders import order_info
from kitchen_suite.tasks.rewards import CompletionStep, Shares, SharesStep, covered
from kitchen_suite.tasks.terms import Observation, Transition, end_to_end
from kitchen_suite.types import Array

OPEN = 0.75  # Opening from which a part counts as open or on, as a share.
CLOSED = 0.15  # Opening up to which a part counts as closed or off, as a share.


# Parts of the flat observation, which ends earlier where fewer slots are observed.
SLICES = end_to_end({"joint_positions": 9, "joint_velocities": 9, "hand_pose": 9, "slots": MAX_PARTS * SLOT_SIZE})
SIZE = SLICES["slots"].stop


def size(num_slots: int) -> int:
    """Returns the number of elements of an observation with a number of slots."""
    return SLICES["slots"].start + num_slots * SLOT_SIZE


# Greatest noise at a noise ratio of 1.
_ROBOT_AMPLITUDE = 0.1  # Of joint positions [rad, m] and velocities [rad/s, m/s].
_HANDLE_AMPLITUDE = 0.2  # Of handles [m].
_OPENING_AMPLITUDE = 0.5  # Of openings, as a share.

NOISE_SLICES = MappingProxyType(
    {"robot_noise": slice(0, NOISE["handles"].start), "object_noise": slice(NOISE["handles"].start, NOISE_SIZE)}
)


class SlotShaping(NamedTuple):
    """State of a dense reward.

    Attributes:
      initial_distances: `(..., K)`, of the hand from the handles at the reset [m].
      best_approach: `(..., K)`, greatest share of the way to the handle covered before the step.
      initial_openings: `(..., K)`, at the reset.
      best_progress: `(..., K)`, greatest share of the way to the goal covered before the step.
    """

    initial_distances: Array
    best_approach: Array
    initial_openings: Array
    best_progress: Array


class GeneratedKitchenState(NamedTuple):
    """State of an episode after a control step.

    Attributes:
      noise: `(..., 82)`, noise of the present observation, by the parts of `NOISE_SLICES`.
      positions: `(..., 9)`, of the robot's joints, without noise [rad, m].
      velocities: `(..., 9)`, of these [rad/s, m/s].
      target: `(..., 9)`, last targets of its actuators [rad, m].
      hand: `(..., 12)`, position of the hand [m] and its rotation matrix, row by row.
      handles: `(..., K, 9)`, positions of the handles [m], directions into the fixtures, and along the bars.
      openings: `(..., K)`, how far parts are open, on, or moved, as a share.
      goal: `(..., K)`, opening that is asked for, 0 or 1.
      order: `(..., K)`, place of each requested part, from 0, and -1 for the others.
      progress: completion of the parts.
      slots: the parts of the kitchen.
      terms: `(...)` each, the terms of the last step's reward by name.
      shaping: state of a dense reward; None for the sparse one.
    """

    noise: Array
    positions: Array
    velocities: Array
    target: Array
    hand: Array
    handles: Array
    openings: Array
    goal: Array
    order: NDArray[np.int64]
    progress: Progress
    slots: Slots
    terms: dict[str, Array]
    shaping: SlotShaping | None = None

    def as_dict(self) -> dict[str, Any]:
        """Returns the state as nested dicts of fresh arrays, without the kitchen's slots and what is None."""
        fields = {name: part for name, part in self._asdict().items() if name != "slots" and part is not None}
        nested = {name: part._asdict() for name, part in fields.items() if isinstance(part, Progress | SlotShaping)}
        arrays: dict[str, Any] = tree.map_structure(np.array, {**fields, **nested})
        return arrays

    @classmethod
    def from_dict(cls, arrays: Mapping[str, Any], slots: Slots) -> Self:
        """Returns the state that `as_dict` returned as nested dicts, among which there may be others."""
        parts = {name: arrays[name] for name in cls._fields if name in arrays}
        if "shaping" in parts:
            parts["shaping"] = SlotShaping(**parts["shaping"])
        return cls(**{**parts, "progress": Progress(**parts["progress"]), "slots": slots})

    @property
    def completions(self) -> NDArray[np.bool_]:
        """`(..., K)`, parts whose task the last step completed."""
        return self.progress.completions

    @property
    def requested(self) -> NDArray[np.bool_]:
        """`(..., K)`, parts of which the episode asks something."""
        return self.order >= 0

    @property
    def hand_distances(self) -> Array:
        """`(..., K)`, of the hand from the handles [m]."""
        offsets = self.handles[..., :3] - self.hand[..., np.newaxis, :3]
        return np.sqrt(rotations.squared_length(offsets))

    def goal_progress(self, shaping: SlotShaping) -> Array:
        """Returns the fraction `(..., K)` of the way to the goal that the parts have covered, requested or not."""
        return covered(np.abs(self.goal - self.openings), np.abs(self.goal - shaping.initial_openings))


class GeneratedKitchenTransition(Transition[GeneratedKitchenState], CompletionStep, SharesStep):
    """A control step in a generated kitchen."""

    @property
    def completions(self) -> NDArray[np.bool_]:
        """`(..., K)`, parts whose task the step completed."""
        return self.after.completions

    @functools.cached_property
    def shares(self) -> Shares:
        """How far each requested part has come, before and after the step; for dense rewards alone."""
        before, after = self.before, self.after
        assert before.shaping is not None, "only a dense reward has a state"
        assert after.shaping is not None, "only a dense reward has a state"
        requested = after.requested
        shares = Shares(
            approach=after.shaping.best_approach,
            previous_approach=before.shaping.best_approach,
            progress=after.goal_progress(after.shaping),
            previous_progress=before.shaping.best_progress,
            is_relabelled=np.zeros(requested.shape, bool),
            completed=after.progress.completed,
            previously_completed=before.progress.completed,
        )
        return Shares(*(np.where(requested, part, np.zeros((), part.dtype)) for part in shares))


@dataclasses.dataclass(frozen=True, kw_only=True)
class GeneratedKitchenMDP(CompletionMDP[SlotReading, GeneratedKitchenState]):
    """Settings of a task in generated kitchens, and the mathematics of an episode under them.

    Attributes:
      sensors: of robot and parts.
      noise_scale: `(82,)`, greatest noise of joints, handles and openings.
      num_slots: number of slots that are observed.
    """

    sensors: SlotSensors
    noise_scale: Array
    num_slots: int = MAX_PARTS

    object_slots = MAX_PARTS

    @property
    def noise_draws(self) -> int:
        return NOISE_SIZE

    @property
    def noise_parts(self) -> Mapping[str, slice]:
        return NOISE_SLICES

    def initial_state(self, reading: SlotReading, draws: Array) -> GeneratedKitchenState:
        """Returns the state before the first step of an episode that asks for nothing; see `with_request`."""
        zeros, slots = np.zeros(MAX_PARTS), self.sensors.slots
        state = GeneratedKitchenState(
            noise=self.noise_scale * draws,
            target=reading.positions,
            goal=zeros,
            order=np.full(MAX_PARTS, -1),
            progress=Progress.initial((MAX_PARTS,)),
            slots=slots,
            terms=self.no_reward(()),
            **measured(slots, reading),
        )
        shaping = SlotShaping(state.hand_distances, zeros, state.openings, zeros)
        return state._replace(shaping=shaping) if self.is_dense else state

    def with_request(
        self, state: GeneratedKitchenState, order: NDArray[np.int64], goal: Array
    ) -> GeneratedKitchenState:
        """Returns the state before the first step of an episode that asks for goals `(K,)` of parts in an order."""
        return state._replace(order=order, goal=goal, progress=Progress.of_request(order))

    def transition(
        self, state: GeneratedKitchenState, *, action: Array, target: Array, reading: SlotReading, draws: Array
    ) -> GeneratedKitchenTransition:
        after = state._replace(
            noise=self.noise_scale * draws, target=target, terms={}, **measured(state.slots, reading)
        )
        within = self.within(after.openings, after.goal) & state.requested
        after = after._replace(progress=state.progress.update(within, remove_task_when_completed=True))
        if self.is_dense:
            assert state.shaping is not None, "only a dense reward has a state"
            approach = covered(after.hand_distances, state.shaping.initial_distances)
            shaping = state.shaping._replace(
                best_approach=np.maximum(state.shaping.best_approach, approach),
                best_progress=np.maximum(state.shaping.best_progress, after.goal_progress(state.shaping)),
            )
            after = after._replace(shaping=shaping)
        return GeneratedKitchenTransition(state, action, target, after)

    @staticmethod
    def within(openings: Array, goal: Array) -> NDArray[np.bool_]:
        """Returns which parts `(..., K)` are where a goal asks them to be."""
        return np.where(goal > 0.5, openings >= OPEN, openings <= CLOSED)

    @functools.cached_property
    def observations(self) -> Mapping[str, Observation]:
        """Joints, hand, and slots of parts, those of requested ones first; in single precision, with their noise."""
        return {
            "joint_positions": single(observed_positions, of_robot=True),
            "joint_velocities": single(observed_velocities, of_robot=True),
            "hand_pose": single(hand_pose),
            "slots": single(lambda state: observed_slots(state, state.order, state.goal, self.num_slots)),
        }

    def task_joints(self, scene: Scene) -> list[tuple[mjcf.Element, ...]]:
        assert isinstance(scene, GeneratedKitchen), "sensors and slots are of such a kitchen"
        return [(*_joints_of(scene, name, part), *_followers_of(scene, name, part)) for name, part in scene.parts]

    def requested_joints(self, scene: Scene, state: GeneratedKitchenState) -> list[mjcf.Element]:
        assert isinstance(scene, GeneratedKitchen), "sensors and slots are of such a kitchen"
        asked = zip(scene.parts, state.requested.tolist(), strict=False)
        return [joint for (name, part), is_asked in asked if is_asked for joint in _joints_of(scene, name, part)]

    def info(self, state: GeneratedKitchenState) -> dict[str, NDArray]:
        """Returns the infos on the parts: fresh arrays, `(...)` or, in the order of the design, `(..., K)`."""
        return {
            "openings": state.openings.copy(),
            **order_info(state.order),
            "goal_openings": state.goal.copy(),
            "completion_steps": state.progress.completion_steps.copy(),
            "is_success": np.array(self.all_completed(state)),
            **self.reward_info(state),
        }


def noise_scale(*, robot_ratio: float, object_ratio: float) -> Array:
    """Returns the greatest noise `(82,)` of joints, handles and openings, each in its unit."""
    scale = np.full(NOISE_SIZE, robot_ratio * _ROBOT_AMPLITUDE)
    scale[NOISE["handles"]] = object_ratio * _HANDLE_AMPLITUDE
    scale[NOISE["openings"]] = object_ratio * _OPENING_AMPLITUDE
    return scale


def _joints_of(scene: GeneratedKitchen, name: str, part: Part) -> tuple[mjcf.Element, ...]:
    """Returns the joint of a part of a prop of some name; a part without a joint of its own is the free prop."""
    prop = scene.props[name]
    return prop.joints if part.joint is None else (prop.mjcf_model.find("joint", part.joint),)


def _followers_of(scene: GeneratedKitchen, name: str, part: Part) -> tuple[mjcf.Element, ...]:
    """Returns the joints that follow that of a part of a prop of some name."""
    return () if part.follower is None else (scene.props[name].mjcf_model.find("joint", part.follower),)
