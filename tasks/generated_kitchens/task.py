"""The task of the kitchens domain: open, close, turn on, turn off and move parts of a generated kitchen."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.entities.fixtures import Part
from kitchen_suite.entities.generated_kitchen import MAX_PARTS, GeneratedKitchen
from kitchen_suite.entities.kitchen_plans import fixture_words
from kitchen_suite.environment_classes import GENERATED_KITCHEN_ENVIRONMENT
from kitchen_suite.tasks.control_modes.registry import make_mode, split_options
from kitchen_suite.tasks.generated_kitchens.certificates import certificate_of, design_digest
from kitchen_suite.tasks.generated_kitchens.mdp import (
    GeneratedKitchenMDP,
    GeneratedKitchenState,
    noise_scale,
)
from kitchen_suite.tasks.generated_kitchens.metrics import PartRecords
from kitchen_suite.tasks.generated_kitchens.requests import VERBS, PartRequests, verb_of
from kitchen_suite.tasks.generated_kitchens.slots import SlotSensors
from kitchen_suite.tasks.generated_kitchens.variations import VARIED
from kitchen_suite.tasks.highlighting import Highlighting
from kitchen_suite.tasks.kitchen.control_modes import CONTROL_MODES, CONTROL_TIMESTEP
from kitchen_suite.tasks.kitchen.goals import INITIAL_QPOS
from kitchen_suite.tasks.orders import sequence_of
from kitchen_suite.tasks.policy_inputs import PolicyInputs
from kitchen_suite.tasks.rewards import CONTINUING, DENSE, REWARDS
from kitchen_suite.tasks.task import SuiteTask
from kitchen_suite.types import Array

HOME = INITIAL_QPOS[:9]  # Positions of the robot's joints at the start [rad, m].
RESET_NOISE = 0.05  # Greatest noise on the positions of the arm's joints at the start [rad].

_SENTENCES = {
    "open": ("open the {}", "pull open the {}", "get the {} open", "open up the {}"),
    "close": ("close the {}", "shut the {}", "push the {} shut", "get the {} closed"),
    "turn_on": ("turn on the {}", "switch on the {}", "set the {} to on", "turn the {} on"),
    "turn_off": ("turn off the {}", "switch off the {}", "set the {} to off", "turn the {} off"),
    "move_kettle": (
        "move the kettle to the back burner",
        "push the kettle to the burner behind it",
        "put the kettle on the back burner",
        "bring the kettle to the back burner",
    ),
}


class GeneratedKitchenTask(SuiteTask):
    """Open, close, turn on, turn off or move parts of a generated kitchen.

    Start: the robot in its initial pose, with noise U(-0.05, 0.05) rad on the arm's joints; everything closed and off,
      but for parts that the episode asks to close or to turn off.
    Reward: 1 for each task that a step completes; or a dense one, as in the kitchen.
    End: discount 0 once all tasks that the episode asks for have been completed, with the sparse reward.
    Observations: 363 numbers, fewer with `num_slots`, in four parts, in single precision, with noise: joints, the pose
      of the hand, and slots of parts, the requested ones first; see `mdp.SLICES` and `slots.SLOT_SLICES`.

    Attributes:
      requests: the parts that episodes ask for.
    """

    scene: GeneratedKitchen
    mdp: GeneratedKitchenMDP
    requests: PartRequests

    default_control_timestep = CONTROL_TIMESTEP
    domain_name = "kitchens"
    environment_classes = GENERATED_KITCHEN_ENVIRONMENT
    control_modes = CONTROL_MODES
    varied = VARIED

    def __init__(
        self,
        scene: GeneratedKitchen,
        *,
        verbs: Sequence[str] = ("open",),
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
          verbs: what is done to the parts that an episode asks for: any of `open`, `close`, `turn_on`, `turn_off` and
            `move_kettle`.
          tasks_per_episode: number of parts that an episode asks for, or a pair of the least and greatest number.
          certified: whether episodes ask only for what the scripted expert has completed by joint velocities in `fast`
            physics, as the kitchen's certificate says; or only for tasks of these names, such as
            `open drawers_1/drawer_2`.
          num_slots: number of slots that are observed, and greatest number of parts that an episode may ask for.
            Requested parts come first, so with few slots a policy sees little of a kitchen but what it is asked for.
          reward: `sparse`, `dense` or `dense_gain`, as in the kitchen; see docs/domains/kitchen.md.
          robot_noise_ratio: scale of the noise of the robot's joints; 0 for none. The default is at most 1 mrad.
          object_noise_ratio: scale of the noise of handles and openings; 0 for none. The default is at most 2 mm, and
            0.5 % of an opening.
          control_mode: meaning of the action: a name in `control_modes`; see docs/guide/control_modes.md.
          **options: those of `SuiteTask`, and arguments of the control mode, as in `KitchenTask`.

        Raises:
          TypeError: an argument of the wrong type.
          ValueError: an unknown or repeated name, a kitchen without parts for the verbs, or a number out of range.
        """
        control, observables = split_options(options, self.control_modes)
        names = tuple(checks.choice(verb, VERBS, "verb") for verb in checks.unique_names(verbs, "verbs"))
        robot_ratio = checks.number(robot_noise_ratio, "robot_noise_ratio")
        object_ratio = checks.number(object_noise_ratio, "object_noise_ratio")
        mdp = GeneratedKitchenMDP(
            sensors=SlotSensors(scene),
            action_mode=make_mode(control_mode, self.control_modes, control),
            rewards=REWARDS[checks.choice(reward, REWARDS, "reward")],
            noise_scale=noise_scale(robot_ratio=robot_ratio, object_ratio=object_ratio),
            num_slots=checks.integer(num_slots, "num_slots", minimum=1, maximum=MAX_PARTS),
            is_dense=reward in DENSE,
            terminate_on_tasks_completed=reward not in CONTINUING,
        )
        super().__init__(scene, mdp, **observables)
        self._parts = scene.parts
        self._names = scene.part_names
        self._words = part_words(scene)
        allowed = _allowed(scene, certified)
        self.requests = PartRequests(scene, names, tasks_per_episode, mdp.num_slots, allowed)
        self._definition = {
            "verbs": names,
            "tasks_per_episode": self.requests.counts,
            "certified": self.requests.tasks,
            "num_slots": mdp.num_slots,
            "reward": reward,
            "robot_noise_ratio": robot_ratio,
            "object_noise_ratio": object_ratio,
        }
        self._policy_name = "_".join(("kitchens", *names, *(() if reward == "sparse" else (reward,))))
        handles = [scene.props[name].mjcf_model.find("site", part.handle) for name, part in scene.parts]
        self.vary(handles=handles, home=HOME)

    def __repr__(self) -> str:
        design = self.scene.design.name or "own"
        return f"{type(self).__name__}(design={design!r}, tasks={list(self.requests.tasks)})"

    @property
    def instructions(self) -> tuple[str, ...]:
        order, goal = (self.state.order, self.state.goal) if self.state else (self.requests.order, self.requests.goal)
        return self.instructions_of(order, goal)

    def instructions_of(self, order: NDArray[np.int64], goal: Array) -> tuple[str, ...]:
        """Returns the instructions of an episode that asks for goals `(K,)` in an order `(K,)`; empty for nothing."""
        each = [self._sentences(k, bool(goal[k])) for k in sequence_of(order)]
        return tuple(", then ".join(sentences) for sentences in zip(*each, strict=True))

    def _sentences(self, k: int, opens: bool) -> tuple[str, ...]:
        return tuple(sentence.format(self._words[k]) for sentence in _SENTENCES[verb_of(self._parts[k][1], opens)])

    @property
    def requested_tasks(self) -> list[str]:
        """Tasks that the episode asks for, in their order."""
        return self.requests.names(self.state.order, self.state.goal)

    def make_records(self) -> PartRecords:
        return PartRecords(self)

    def make_policy_inputs(self, state_size: int) -> PolicyInputs:
        return PolicyInputs(names=(self._policy_name,), state_size=state_size)

    def bind(self, physics: mjcf.Physics) -> None:
        self._columns = physics.bind(self.robot.joints).qposadr
        self._starts = [self._start_of(physics, name, part) for name, part in self._parts]
        self._highlighting = Highlighting(physics, [self._geoms(name, part) for name, part in self._parts])

    def _start_of(self, physics: mjcf.Physics, name: str, part: Part) -> tuple[list[int], list[float]]:
        """Returns the columns in qpos of a part's joint and of those that follow it, and their positions when open."""
        if part.joint is None:
            return [], []
        joints = [part.joint, part.follower] if part.follower else [part.joint]
        model = self.scene.props[name].mjcf_model
        columns = [int(physics.bind(model.find("joint", joint)).qposadr) for joint in joints]
        return columns, [part.opened, part.opened * part.ratio][: len(columns)]

    def _geoms(self, name: str, part: Part) -> list[mjcf.Element]:
        model = self.scene.props[name].mjcf_model
        body = model.find("joint", part.joint).parent if part.joint else model.worldbody
        return list(body.find_all("geom"))

    def reset_physics(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        data = physics.data
        pose = HOME + np.append(random_state.uniform(-RESET_NOISE, RESET_NOISE, 7), (0.0, 0.0))
        data.qpos[self._columns] = pose
        for k, (columns, positions) in enumerate(self._starts):
            is_open = self.requests.order[k] >= 0 and not self.requests.goal[k]
            data.qpos[columns] = positions if is_open else 0.0
        data.qvel[:] = 0.0
        data.ctrl[:] = 0.0

    def initial_state(self, draws: Array) -> GeneratedKitchenState:
        return self.mdp.with_request(super().initial_state(draws), self.requests.order, self.requests.goal)

    def state_definition(self) -> dict[str, Any]:
        return {**super().state_definition(), **self._definition}

    def saved_state(self) -> dict[str, Any]:
        # Other kitchens may have states of the same sizes.
        return {**self.state.as_dict(), "design": design_digest(self.scene.design)}

    def restore_state(self, state: Mapping[str, Any]) -> None:
        self.set_mdp_state(GeneratedKitchenState.from_dict(state, self.state.slots))

    def publish(self, physics: mjcf.Physics | None) -> None:
        """Updates the colours."""
        if self._visualize_reward:
            within = self.state.progress.within[: len(self._parts)]
            self._highlighting.update(within.tolist())


def _allowed(scene: GeneratedKitchen, certified: bool | Sequence[str]) -> Collection[str] | None:
    """Returns the tasks that episodes may ask for; None for all."""
    if isinstance(certified, bool | np.bool_):
        return certificate_of(scene.design).certified if certified else None
    all_tasks = [f"{verb} {name}" for name in scene.part_names for verb in VERBS]
    return [checks.choice(name, all_tasks, "certified task") for name in checks.unique_names(certified, "certified")]


def part_words(scene: GeneratedKitchen) -> tuple[str, ...]:
    """Returns every part of a kitchen in words, such as `top drawer of the left cabinet`."""
    placed = {each.name: each for each in scene.design.placed}
    words = []
    for name, part in scene.parts:
        is_alone = part.kind in ("kettle", "switch")
        words.append(
            part.words if is_alone else f"{part.words} of the {fixture_words(placed[name], scene.design.placed)}"
        )
    return tuple(words)
