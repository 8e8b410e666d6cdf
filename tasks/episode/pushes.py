"""Pushes: in the middle of an episode the arm is displaced, or a completed task undone, and the policy has to go on.

A push takes no time: positions change at the start of a control step, and velocities there become zero.
"""

import copy
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite.entities.joints import addresses
from kitchen_suite.entities.parameters import task_parameter
from kitchen_suite.entities.scenes import Scene
from kitchen_suite.tasks.episode.draws import Draws
from kitchen_suite.tasks.episode.part import EpisodePart
from kitchen_suite.tasks.mdp import MDP
from kitchen_suite.tasks.simulation import Simulation
from kitchen_suite.tasks.variations.distributions import Bands, Choice, ParameterVariation
from kitchen_suite.tasks.variations.randomizer import Values
from kitchen_suite.types import Array

_ARM = 7  # Joints of the arm, without the fingers.
_WIDEST = 7  # Positions of a free joint, which has more than any other.

_STEP = "push/step"
_UNDOES = "push/undoes"
_WHICH = "push/which"
_OFFSETS = "push/joint_offsets"


def _either(name: str, distribution: Bands | Choice) -> ParameterVariation:
    """Returns a variation that is the same for training and for evaluation."""
    return ParameterVariation(name=name, group="push", seen=distribution, held_out=distribution)


# After 20 to 120 control steps, one in two undoes a completed task; all others, and those before which none has been
# completed, displace each joint of the arm by up to 0.3 rad.
PUSH = (
    _either(_STEP, Choice(np.arange(20.0, 121.0))),
    _either(_UNDOES, Choice(np.array([0.0, 1.0]))),
    _either(_WHICH, Bands([(0.0, 1.0)])),
    _either(_OFFSETS, Bands([(np.full(_ARM, -0.3), np.full(_ARM, 0.3))])),
)


PARAMETERS = (
    task_parameter(_STEP, "control steps"),
    task_parameter(_UNDOES, "0 or 1"),
    task_parameter(_WHICH, "1"),
    task_parameter(_OFFSETS, "rad", shape=(_ARM,), non_negative=False),
)


class Push(NamedTuple):
    """The push of an episode.

    Attributes:
      steps: `(...)`, control steps made so far.
      due: `(...)`, number of control steps after which it comes; 0 for no push.
      undoes: `(...)`, whether it undoes a completed task, if there is one, and does not displace the arm.
      which: `(...)`, in [0, 1], which of the completed tasks: the first ones for low numbers.
      offsets: `(..., 7)`, displacements of the arm's joints [rad].
      start: `(..., k)`, positions of the tasks' joints at the reset, task by task [rad, m, quaternion]; zeros
        follow where the number of joints differs between episodes.
    """

    steps: NDArray[np.int64]
    due: Array
    undoes: NDArray[np.bool_]
    which: Array
    offsets: Array
    start: Array

    @property
    def is_due(self) -> NDArray[np.bool_]:
        """Whether `(...)` it comes before the next control step."""
        return (self.due > 0) & (self.steps == np.floor(self.due))

    def stepped(self) -> Self:
        """Returns the push after one more control step."""
        return self._replace(steps=self.steps + 1)


class _Joints(NamedTuple):
    """Columns of some joints in qpos and in qvel."""

    qpos: NDArray[np.int64]
    qvel: NDArray[np.int64]

    def move(self, simulation: Simulation, where: NDArray[np.bool_], positions: Array) -> None:
        """Sets positions `(..., k)`, at rest, where a mask `(...)` is True."""
        for field, columns, values in (("qpos", self.qpos, positions), ("qvel", self.qvel, 0.0)):
            present = simulation.read(field, columns)
            simulation.write(field, columns, np.where(where[..., np.newaxis], values, present))


@dataclasses.dataclass(frozen=True)
class Pusher:
    """Pushes robot and objects of a compiled scene.

    Attributes:
      arm: the arm's joints.
      low: `(k,)`, lower ends of their ranges [rad].
      high: `(k,)`, upper ends [rad].
      tasks: joints of each of `n` tasks that can be undone.
      complete: returns which of these `(..., n)` are complete in a state of the MDP.
      spare: number of zeros after the positions of these joints in `Push.start`.
    """

    arm: _Joints
    low: Array
    high: Array
    tasks: Sequence[_Joints]
    complete: Callable[[Any], NDArray[np.bool_]]
    spare: int = 0

    @classmethod
    def make(cls, physics: mjcf.Physics, scene: Scene, mdp: MDP) -> Self:
        """Looks up joints in a compiled scene; those of its robot begin with the arm's."""
        arm = scene.robot.joints[: scene.robot.arm_size]
        low, high = np.array(physics.bind(arm).range).T
        tasks = [_Joints(*addresses(physics, joints)) for joints in mdp.task_joints(scene)]
        # Where props differ between episodes stepped together, each place may hold a free joint.
        spare = max(mdp.object_slots * _WIDEST - sum(joints.qpos.size for joints in tasks), 0)
        return cls(_Joints(*addresses(physics, arm)), low, high, tasks, mdp.complete, spare)

    def start(self, values: Mapping[str, Array], simulation: Simulation) -> Push:
        """Returns the push of an episode that starts with values of parameters."""
        own = {parameter.name: values.get(parameter.name, np.zeros(parameter.type.shape)) for parameter in PARAMETERS}
        starts = [simulation.read("qpos", joints.qpos) for joints in self.tasks]
        return Push(
            steps=np.array(0),
            due=own[_STEP],
            undoes=own[_UNDOES] > 0.5,
            which=own[_WHICH],
            offsets=own[_OFFSETS],
            start=np.concatenate([*starts, np.zeros(self.spare)]),
        )

    def push(self, simulation: Simulation, push: Push, state: Any) -> Push:
        """Makes the pushes that are due before a control step from a state of the MDP; returns the push after it."""
        if push.is_due.any():
            self.move(simulation, push, self.complete(state))
        return push.stepped()

    def move(self, simulation: Simulation, push: Push, complete: NDArray[np.bool_]) -> None:
        """Moves what pushes that are due move, given which tasks `(..., n)` are complete."""
        is_due = push.is_due
        undoes = self._undo(simulation, push, is_due & push.undoes, complete)
        positions = simulation.read("qpos", self.arm.qpos) + push.offsets[..., : self.low.size]
        self.arm.move(simulation, is_due & ~undoes, np.clip(positions, self.low, self.high))
        simulation.evaluate()

    def _undo(
        self, simulation: Simulation, push: Push, where: NDArray[np.bool_], complete: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        """Undoes one completed task where a mask `(...)` is True; returns where there was one."""
        if not self.tasks:
            return np.zeros_like(where)
        count = complete.sum(axis=-1)
        number = np.minimum(np.floor(push.which * count), count - 1)
        chosen = complete & (complete.cumsum(axis=-1) - 1 == number[..., np.newaxis]) & where[..., np.newaxis]
        sizes = [joints.qpos.size for joints in self.tasks]
        *starts, _ = np.split(push.start, np.cumsum(sizes), axis=-1)
        for place, (joints, start) in enumerate(zip(self.tasks, starts, strict=True)):
            joints.move(simulation, chosen[..., place], start)
        return where & (count > 0)


class PushMaker(Protocol):
    """Makes the pushes of episodes."""

    def push(self, simulation: Any, push: Push, state: Any) -> Push:
        """Makes the pushes that are due before a control step from a state of the MDP; returns the push after it."""


class Pushes(EpisodePart):
    """The pushes of a task's episodes.

    Attributes:
      pusher: of the compiled scene; from `bind` on.
    """

    name = "push"
    parameters = PARAMETERS
    pusher: Pusher

    def __init__(self, scene: Scene, mdp: MDP) -> None:
        """Takes the scene, and the MDP, which knows the joints of tasks that can be undone."""
        self._scene = scene
        self._mdp = mdp

    def bind(self, physics: mjcf.Physics) -> None:
        self.pusher = Pusher.make(physics, self._scene, self._mdp)
        self._maker: PushMaker = self.pusher

    def made_by(self, maker: PushMaker) -> Self:
        """Returns the part with pushes of several models, which another maker makes."""
        part = copy.copy(self)
        part._maker = maker  # noqa: SLF001
        return part

    def draw(self, values: Values, simulation: Simulation, draws: Draws) -> Push:
        return self.pusher.start(values, simulation)

    def before(self, part: Push, simulation: Simulation, mdp_state: Any, ctrl: Array) -> tuple[Push, Array]:
        # After control has read the physics: only a single simulation is evaluated anew, a batch as it steps.
        return self._maker.push(simulation, part, mdp_state), ctrl
