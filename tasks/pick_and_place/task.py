"""The task of the pick_and_place domain: put objects on or in places of a generated kitchen, or take them out."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.entities.generated_kitchen import MAX_PARTS
from kitchen_suite.entities.object_layouts import MAX_OBJECTS
from kitchen_suite.entities.pick_and_place import PickAndPlaceKitchen
from kitchen_suite.environment_classes import PICK_AND_PLACE_ENVIRONMENT
from kitchen_suite.tasks.control_modes.registry import make_mode, split_options
from kitchen_suite.tasks.generated_kitchens.certificates import design_digest
from kitchen_suite.tasks.generated_kitchens.task import HOME, RESET_NOISE
from kitchen_suite.tasks.highlighting import Highlighting
from kitchen_suite.tasks.kitchen.control_modes import CONTROL_MODES, CONTROL_TIMESTEP
from kitchen_suite.tasks.pick_and_place.certificates import certified_tasks
from kitchen_suite.tasks.pick_and_place.items import ItemSensors
from kitchen_suite.tasks.pick_and_place.mdp import PickAndPlaceMDP, PickAndPlaceState, noise_scale
from kitchen_suite.tasks.pick_and_place.metrics import ObjectRecords
from kitchen_suite.tasks.pick_and_place.requests import VERBS, ObjectRequests, tasks_of
from kitchen_suite.tasks.pick_and_place.rewards import REWARDS
from kitchen_suite.tasks.pick_and_place.variations import VARIED
from kitchen_suite.tasks.policy_inputs import PolicyInputs
from kitchen_suite.tasks.rewards import CONTINUING
from kitchen_suite.tasks.task import SuiteTask
from kitchen_suite.types import Array

# Greatest noise of objects at the start, along x and y [m] and about the vertical [rad].
OBJECT_NOISE, OBJECT_TURN = 0.01, 0.2

_SPOT_DEPTH = 0.1  # Distance of an object in a cabinet from the cabinet's front [m].
_BESIDE = 0.13  # Distance of objects from each other that are in one place at the start [m].
_ABOVE = 0.001  # Height above its support at which an object starts [m].

_SENTENCES = {
    "put_on": (
        "put the {0} on the {1}",
        "place the {0} on the {1}",
        "set the {0} down on the {1}",
        "move the {0} to the {1}",
    ),
    "put_in": (
        "put the {0} into the {1}",
        "place the {0} in the {1}",
        "put the {0} away in the {1}",
        "move the {0} into the {1}",
    ),
    "take_out": (
        "take the {0} out of the {2} and put it on the {1}",
        "move the {0} from the {2} to the {1}",
        "get the {0} out of the {2} and set it down on the {1}",
        "remove the {0} from the {2} and leave it on the {1}",
    ),
    "open_and_put_in": (
        "open the {1} and put the {0} into it",
        "open the {1} and place the {0} inside",
        "put the {0} into the closed {1}",
        "open the {1} and put the {0} away in it",
    ),
}


class PickAndPlaceTask(SuiteTask):
    """Put objects on or in places of a generated kitchen, or take them out.

    Start: the robot as in generated kitchens; objects on worktops, or in the place that they are taken out of, with
      noise U(-1, 1) cm and U(-0.2, 0.2) rad; drawers and doors of the places that are asked for stand wide open, those
      of `open_and_put_in` and all others are closed.
    Success: the object's middle is in the box of its place, at most 3 cm/s fast, and the fingers have let it go.
    Reward: 1 for each object that a step has put where it was asked for; or a dense one.
    End: discount 0 once all that the episode asks for has been completed, with the sparse reward.
    Observations: 619 numbers, fewer with `num_slots`, in six parts, in single precision, with noise: joints, the pose
      of the hand, objects, requested ones first, places, and slots of parts; see `mdp.SLICES`.

    Attributes:
      requests: what episodes ask for.
    """

    scene: PickAndPlaceKitchen
    mdp: PickAndPlaceMDP
    requests: ObjectRequests

    default_control_timestep = CONTROL_TIMESTEP
    domain_name = "pick_and_place"
    environment_classes = PICK_AND_PLACE_ENVIRONMENT
    control_modes = CONTROL_MODES
    varied = VARIED

    def __init__(
        self,
        scene: PickAndPlaceKitchen,
        *,
        verbs: Sequence[str] = ("put_on",),
        tasks_per_episode: int | Sequence[int] = 1,
        certified: bool | Sequence[str] = False,
        num_slots: int = MAX_PARTS,
        reward: str = "sparse",
        robot_noise_ratio: float = 0.01,
        object_noise_ratio: float = 0.01,
        control_mode: str = "joint_velocity",
        **options: Any,
    ) -> None:
        """Sets the task up in a kitchen.

        Args:
          scene: the kitchen; each task needs a scene of its own.
          verbs: what is done with the objects that an episode asks for: any of `put_on`, `put_in`, `take_out` and
            `open_and_put_in`.
          tasks_per_episode: number of objects that an episode asks for, or a pair of the least and greatest number.
          certified: whether episodes ask only for what the scripted expert has completed by joint velocities in `fast`
            physics, as the kitchen's certificate says; or only for tasks of these names, such as `put_on mug tray`.
          num_slots: number of slots of parts that are observed; those that have to be opened come first.
          reward: `sparse`, `dense` or `dense_gain`; see docs/domains/pick_and_place.md.
          robot_noise_ratio: scale of the noise of the robot's joints; 0 for none. The default is at most 1 mrad.
          object_noise_ratio: scale of the noise of objects, handles and openings; 0 for none. The default is at most
            2 mm, and 0.5 % of an opening.
          control_mode: meaning of the action: a name in `control_modes`; see docs/guide/control_modes.md.
          **options: those of `SuiteTask`, and arguments of the control mode, as in `KitchenTask`.

        Raises:
          TypeError: an argument of the wrong type.
          ValueError: an unknown or repeated name, a kitchen without places for the verbs, or a number out of range.
        """
        control, observables = split_options(options, self.control_modes)
        names = tuple(checks.choice(verb, VERBS, "verb") for verb in checks.unique_names(verbs, "verbs"))
        robot_ratio = checks.number(robot_noise_ratio, "robot_noise_ratio")
        object_ratio = checks.number(object_noise_ratio, "object_noise_ratio")
        mdp = PickAndPlaceMDP(
            sensors=ItemSensors(scene),
            action_mode=make_mode(control_mode, self.control_modes, control),
            rewards=REWARDS[checks.choice(reward, REWARDS, "reward")],
            noise_scale=noise_scale(robot_ratio=robot_ratio, object_ratio=object_ratio),
            num_slots=checks.integer(num_slots, "num_slots", minimum=1, maximum=MAX_PARTS),
            is_dense=reward != "sparse",
            terminate_on_tasks_completed=reward not in CONTINUING,
        )
        super().__init__(scene, mdp, **observables)
        self.requests = ObjectRequests(scene, names, tasks_per_episode, _allowed(scene, certified))
        self._definition = {
            "verbs": names,
            "tasks_per_episode": self.requests.counts,
            "certified": self.requests.tasks,
            "num_slots": mdp.num_slots,
            "reward": reward,
            "robot_noise_ratio": robot_ratio,
            "object_noise_ratio": object_ratio,
        }
        self._policy_name = "_".join(("pick_and_place", *names, *(() if reward == "sparse" else (reward,))))
        self.vary(handles=[grasp for thing in scene.objects for grasp in thing.grasps[:1]], home=HOME)

    def __repr__(self) -> str:
        design = self.scene.design.name or "own"
        return f"{type(self).__name__}(design={design!r}, tasks={list(self.requests.tasks)})"

    @property
    def instructions(self) -> tuple[str, ...]:
        return self.instructions_of(self.state.request if self.state else self.requests.request)

    def instructions_of(self, request: Any) -> tuple[str, ...]:
        """Returns the instructions of an episode with a `Request` of arrays `(O,)`; empty for nothing."""
        names = self.requests.names(request.order, request.goal, request.origin, request.closed)
        each = [self._sentences(name) for name in names]
        return tuple(", then ".join(sentences) for sentences in zip(*each, strict=True))

    def _sentences(self, name: str) -> tuple[str, ...]:
        """Returns the instructions of a task."""
        task, places = self.requests.task(name), self.scene.places
        words = self.scene.object_words[task.number], places[task.goal].words, places[task.origin].words
        return tuple(sentence.format(*words) for sentence in _SENTENCES[task.verb])

    @property
    def requested_tasks(self) -> list[str]:
        """Tasks that the episode asks for, in their order."""
        request = self.state.request
        return self.requests.names(request.order, request.goal, request.origin, request.closed)

    def make_records(self) -> ObjectRecords:
        return ObjectRecords(self)

    def make_policy_inputs(self, state_size: int) -> PolicyInputs:
        return PolicyInputs(names=(self._policy_name,), state_size=state_size)

    def bind(self, physics: mjcf.Physics) -> None:
        self._columns = physics.bind(self.robot.joints).qposadr
        self._poses = [int(physics.bind(thing.joints[0]).qposadr) for thing in self.scene.objects]
        # Of each place, the columns in qpos of its parts' joints, and their positions when they stand wide open.
        self._opened = [
            [self._wide_open(physics, self.scene.joint_of(name)) for name in place.parts] for place in self.scene.places
        ]
        geoms = [list(thing.mjcf_model.find_all("geom")) for thing in self.scene.objects]
        self._highlighting = Highlighting(physics, geoms)

    def _wide_open(self, physics: mjcf.Physics, joint: mjcf.Element) -> tuple[int, float]:
        bound = physics.bind(joint)
        low, high = bound.range
        return int(bound.qposadr), float(high if abs(high) > abs(low) else low)

    def reset_physics(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        data, request = physics.data, self.requests.request
        pose = HOME + np.append(random_state.uniform(-RESET_NOISE, RESET_NOISE, 7), (0.0, 0.0))
        noise = random_state.uniform(-1.0, 1.0, (MAX_OBJECTS, 3)) * (OBJECT_NOISE, OBJECT_NOISE, OBJECT_TURN)
        data.qpos[self._columns] = pose
        for positions in self._opened:
            for column, _ in positions:
                data.qpos[column] = 0.0
        for index in self._open_places(request):
            for column, opened in self._opened[index]:
                data.qpos[column] = opened
        for number, column in enumerate(self._poses):
            position, yaw = self._start(number, request)
            turned = yaw + noise[number, 2]
            data.qpos[column : column + 2] = position[:2] + noise[number, :2]
            data.qpos[column + 2] = position[2]
            data.qpos[column + 3 : column + 7] = np.cos(turned / 2), 0.0, 0.0, np.sin(turned / 2)
        data.qvel[:] = 0.0
        data.ctrl[:] = 0.0

    def _open_places(self, request: Any) -> set[int]:
        """Returns the places that stand open at the start."""
        asked = request.order >= 0
        goals = {int(goal) for goal in request.goal[asked & ~request.closed]}
        return goals | {int(origin) for origin in request.origin[asked] if origin >= 0}

    def _start(self, number: int, request: Any) -> tuple[Array, float]:
        """Returns the position of an object at the start, and its yaw, without noise [m, rad]."""
        origin = int(request.origin[number])
        if origin < 0:
            placed = self.scene.layout.objects[number]
            return np.array(placed.position), placed.yaw
        place = self.scene.places[origin]
        into = self.scene.into(place)
        along = np.array([into[1], -into[0], 0.0])
        spot = place.centre
        half_depth = float(np.abs(into @ np.subtract(place.high, place.low))) / 2
        # Those that are taken out of one place stand side by side.
        same = np.flatnonzero(request.origin == origin).tolist()
        spot = spot + along * _BESIDE * (same.index(number) - (len(same) - 1) / 2)
        if place.moves:
            spot = spot - into * abs(self._opened[origin][0][1])
        else:
            spot = spot + into * (_SPOT_DEPTH - half_depth)
        return np.append(spot[:2], spot[2] + _ABOVE), float(np.arctan2(-into[1], -into[0]))

    def initial_state(self, draws: Array) -> PickAndPlaceState:
        return self.mdp.with_request(super().initial_state(draws), self.requests.request)

    def state_definition(self) -> dict[str, Any]:
        return {**super().state_definition(), **self._definition}

    def saved_state(self) -> dict[str, Any]:
        # Other kitchens may have states of the same sizes.
        return {**self.state.as_dict(), "design": design_digest(self.scene.design)}

    def restore_state(self, state: Mapping[str, Any]) -> None:
        self.set_mdp_state(PickAndPlaceState.from_dict(state, self.state.slots, self.state.items))

    def publish(self, physics: mjcf.Physics | None) -> None:
        """Updates the colours."""
        if self._visualize_reward:
            within: NDArray[np.bool_] = self.state.progress.within[: len(self.scene.objects)]
            self._highlighting.update(within.tolist())


def _allowed(scene: PickAndPlaceKitchen, certified: bool | Sequence[str]) -> Collection[str] | None:
    """Returns the tasks that episodes may ask for; None for all."""
    if isinstance(certified, bool | np.bool_):
        return certified_tasks(scene.design, scene.layout) if certified else None
    known = tasks_of(scene, [*VERBS])
    return [checks.choice(name, known, "certified task") for name in checks.unique_names(certified, "certified")]
