"""The task of the kitchens domain: open, close, turn on, turn off and move parts of a generated kitchen."""

import functools
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from dm_control import mjcf
from dm_control.composer.observation import observable
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.entities.assets import Array
from kitchen_suite.entities.fixtures import Part
from kitchen_suite.entities.generated_kitchen import MAX_PARTS, GeneratedKitchen
from kitchen_suite.entities.kitchen_plans import Placed
from kitchen_suite.tasks.control_modes.modes import make_mode, split_options
from kitchen_suite.tasks.kitchen.action import CONTROL_MODES, CONTROL_TIMESTEP
from kitchen_suite.tasks.kitchen.goals import INITIAL_QPOS
from kitchen_suite.tasks.kitchen.requests import REQUESTED, REQUESTED_ORDER, TaskDraw, checked_order, in_order, order_of
from kitchen_suite.tasks.kitchen.reward import CONTINUING, REWARDS
from kitchen_suite.tasks.kitchens.certificates import certificate_of
from kitchen_suite.tasks.kitchens.mdp import PARTS, KitchensMDP, KitchensState, SlotSensors, noise_scale, size
from kitchen_suite.tasks.observables import joined
from kitchen_suite.tasks.pushes import PUSH
from kitchen_suite.tasks.task import Completions, Highlighting, Metrics, PolicyInputs, ResetRequests, SuiteTask
from kitchen_suite.tasks.variations import appearance
from kitchen_suite.tasks.variations.distributions import ParameterVariation, around, one_of

VARIED: tuple[ParameterVariation, ...] = (
    around("franka/joint_offset", "start", seen=0.05, held_out=0.1),
    around("franka/gain_scale", "dynamics", seen=0.1, held_out=0.2),
    around("franka/damping_scale", "dynamics", seen=0.1, held_out=0.2),
    around("fixtures/damping_scale", "dynamics", seen=0.3, held_out=0.5),
    around("fixtures/friction_scale", "dynamics", seen=0.3, held_out=0.5),
    one_of("sensing/action_delay", "sensing", seen=(0.0, 1.0), held_out=(1.0,)),
    *appearance.cameras("overview", "left", "right", "franka/wrist", "franka/hand"),
    *PUSH,
)

HOME = INITIAL_QPOS[:9]  # Positions of the robot's joints at the start [rad, m].
RESET_NOISE = 0.05  # Greatest noise on the positions of the arm's joints at the start [rad].

# Verbs of tasks: whether they begin with the part open or on, and the kinds of parts that they are for.
VERBS: Mapping[str, tuple[bool, frozenset[str]]] = {
    "open": (False, frozenset({"drawer", "door", "sliding door"})),
    "close": (True, frozenset({"drawer", "door", "sliding door"})),
    "turn_on": (False, frozenset({"knob", "switch"})),
    "turn_off": (True, frozenset({"knob", "switch"})),
    "move_kettle": (False, frozenset({"kettle"})),
}

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


class PartRequests(ResetRequests):
    """The parts that episodes ask for: drawn at a reset among those that the task's verbs are for, unless named.

    Attributes:
      tasks: names of the tasks that episodes may ask for, such as `open drawers_1/drawer_2`.
      order: `(K,)`, place of each requested part in the episode that starts, from 0, and -1 for the others.
      goal: `(K,)`, opening that is asked for, 0 or 1; 0 for the others.
    """

    options = (REQUESTED,)

    def __init__(
        self,
        scene: GeneratedKitchen,
        verbs: Sequence[str],
        count: object,
        num_slots: int = MAX_PARTS,
        allowed: Collection[str] | None = None,
    ) -> None:
        """Collects the tasks of some verbs in a kitchen, all or those allowed; episodes ask for at most `num_slots`."""
        self._num_slots = num_slots
        self._slots: dict[str, tuple[int, bool]] = {}
        for k, (name, (_, part)) in enumerate(zip(scene.part_names, scene.parts, strict=True)):
            for verb in verbs:
                begins_open, kinds = VERBS[verb]
                task = f"{verb} {name}"
                if part.kind in kinds and (allowed is None or task in allowed):
                    self._slots[task] = k, not begins_open
        self.tasks = tuple(self._slots)
        if not self.tasks:
            parts = ", ".join(sorted({part.kind for _, part in scene.parts}))
            nothing = "nothing" if allowed is None else "nothing certified"
            raise ValueError(
                f"kitchen {scene.design.name or 'of this design'} has {nothing} to {' or '.join(verbs)}: it has {parts}"
            )
        # The first task of each part.
        slots = {k: (k, opens) for k, opens in reversed(self._slots.values())}
        self._draw = TaskDraw.make(count, len(slots))
        self._check_count(self._draw.most)
        self._weights = np.isin(np.arange(MAX_PARTS), list(slots)).astype(np.float64)
        # Whether a part may be asked to be open, and to be closed.
        self._directions = np.zeros((2, MAX_PARTS), bool)
        for k, opens in self._slots.values():
            self._directions[int(opens), k] = True
        self._next: tuple[str, ...] | None = None
        # Before the first reset.
        self._request([slots[k] for k in sorted(slots)[: self._draw.most]])

    def checked(self, options: Mapping[str, Any]) -> tuple[str, ...] | None:
        if options.get(REQUESTED) is None:
            return None
        names = checks.unique_names(options[REQUESTED], REQUESTED)
        tasks = tuple(checks.choice(name, self.tasks, REQUESTED) for name in names)
        self._check_count(len(tasks))
        if len({self._slots[task][0] for task in tasks}) < len(tasks):
            raise ValueError(f"{REQUESTED} must not ask to open and to close the same part, got {checks.shown(names)}")
        return tasks

    def _check_count(self, count: int) -> None:
        if count > self._num_slots:
            raise ValueError(f"num_slots must be at least {count}, the parts that are requested, got {self._num_slots}")

    def follow(self, request: tuple[str, ...] | None) -> None:
        self._next = request

    def draw(self, random_state: np.random.RandomState) -> None:
        order = self._draw.draw(random_state, self._weights)
        opens = np.where(random_state.random_sample(MAX_PARTS) < 0.5, self._directions[1], ~self._directions[0])
        self.order, self.goal = order, ((order >= 0) & opens).astype(np.float64)
        if self._next is not None:
            self._request([self._slots[task] for task in self._next])
        self._next = None

    def _request(self, slots: Sequence[tuple[int, bool]]) -> None:
        """Asks for parts, each to be open or closed, in their sequence."""
        self.order = order_of([k for k, _ in slots], MAX_PARTS)
        self.goal = np.zeros(MAX_PARTS)
        for k, opens in slots:
            self.goal[k] = opens

    def recorded(self, arrays: Mapping[str, NDArray]) -> dict[str, Any]:
        orders, goals = arrays.get(f"info/{REQUESTED_ORDER}"), arrays.get("info/goal_openings")
        if orders is None or goals is None:
            return {}
        order, slots = checked_order(orders[0], MAX_PARTS, f"recorded {REQUESTED_ORDER}"), self._slots.values()
        if goals.shape[1:] != order.shape or any((k, bool(goals[0, k])) not in slots for k in in_order(order)):
            raise ValueError(f"recorded goal_openings ask for no tasks of this kitchen: {checks.shown(goals[0])}")
        return {REQUESTED: self.names(order, goals[0])}

    def names(self, order: NDArray[np.int64], goal: Array) -> list[str]:
        """Returns the tasks that an order `(K,)` with goals `(K,)` asks for, in their sequence."""
        by_slot = {slot: task for task, slot in self._slots.items()}
        return [by_slot[k, bool(goal[k])] for k in in_order(order)]


class KitchensTask(SuiteTask):
    """Open, close, turn on, turn off or move parts of a generated kitchen.

    Start: the robot in its initial pose, with noise U(-0.05, 0.05) rad on the arm's joints; everything closed and off,
      but for parts that the episode asks to close or to turn off.
    Reward: 1 for each task that a step completes; or a dense one, as in the kitchen.
    End: discount 0 once all tasks that the episode asks for have been completed, with the sparse reward.
    Observations: 363 numbers, fewer with `num_slots`, in four parts, in single precision, with noise: joints, the pose
      of the hand, and slots of parts, the requested ones first; see `mdp.PARTS` and `mdp.SLOT_PARTS`.

    Attributes:
      requests: the parts that episodes ask for.
    """

    scene: GeneratedKitchen
    mdp: KitchensMDP
    requests: PartRequests

    domain_name = "kitchens"
    control_modes = CONTROL_MODES
    varied = VARIED

    def __init__(
        self,
        scene: GeneratedKitchen,
        *,
        verbs: Sequence[str] = ("open",),
        tasks_per_episode: int | Sequence[int] = 1,
        certified: bool = False,
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
          verbs: keys of `VERBS`; an episode asks for parts of these.
          tasks_per_episode: number of parts that an episode asks for, or a pair of the least and greatest number.
          certified: whether episodes ask only for what the scripted expert has completed by joint velocities in `fast`
            physics, as the kitchen's certificate says.
          num_slots: number of slots that are observed, and greatest number of parts that an episode may ask for.
            Requested parts come first, so with few slots a policy sees little of a kitchen but what it is asked for.
          reward: `sparse`, or `dense` or `dense_gain` as in the kitchen.
          robot_noise_ratio: scale of the noise of the robot's joints; 0 for none. The default is at most 1 mrad.
          object_noise_ratio: scale of the noise of handles and openings; 0 for none. The default is at most 2 mm, and
            0.5 % of an opening.
          control_mode: meaning of the action, one of the kitchen's.
          **options: those of `SuiteTask`, and arguments of the control mode, as of `KitchenTask`.

        Raises:
          TypeError: an argument of the wrong type.
          ValueError: an unknown or repeated name, a kitchen without parts for the verbs, or a number out of range.
        """
        control, observables = split_options(options, self.control_modes)
        names = tuple(checks.choice(verb, VERBS, "verb") for verb in checks.unique_names(verbs, "verbs"))
        mdp = KitchensMDP(
            sensors=SlotSensors(scene),
            action_mode=make_mode(control_mode, self.control_modes, control),
            rewards=self.with_extra_rewards(REWARDS[checks.choice(reward, REWARDS, "reward")]),
            noise_scale=noise_scale(
                robot_ratio=checks.number(robot_noise_ratio, "robot_noise_ratio"),
                object_ratio=checks.number(object_noise_ratio, "object_noise_ratio"),
            ),
            num_slots=checks.integer(num_slots, "num_slots", minimum=1, maximum=MAX_PARTS),
            is_dense=reward != "sparse",
            terminates_when_complete=reward not in CONTINUING,
        )
        super().__init__(scene, mdp, **observables)
        self._parts = scene.parts
        self._names = scene.part_names
        self._words = part_words(scene)
        allowed = certificate_of(scene.design).certified if checks.boolean(certified, "certified") else None
        self.requests = PartRequests(scene, names, tasks_per_episode, mdp.num_slots, allowed)
        handles = [scene.props[name].mjcf_model.find("site", part.handle) for name, part in scene.parts]
        self.vary(handles=handles, home=HOME)
        parts = {name: observable.Generic(functools.partial(self._part, part)) for name, part in PARTS.items()}
        for part in parts.values():
            part.enabled = True
        self.observed = joined(parts, self.extra_observables)
        state_size = size(mdp.num_slots) + self.extra_size
        self.policy_inputs = PolicyInputs(names=(type(self).__name__,), state_size=state_size)
        self.set_timesteps(control_timestep=CONTROL_TIMESTEP, physics_timestep=scene.physics_timestep)

    def __repr__(self) -> str:
        design = self.scene.design.name or "own"
        return f"{type(self).__name__}(design={design!r}, tasks={list(self.requests.tasks)})"

    @property
    def instructions(self) -> tuple[str, ...]:
        order, goal = (self.state.order, self.state.goal) if self.state else (self.requests.order, self.requests.goal)
        return self.instructions_of(order, goal)

    def instructions_of(self, order: NDArray[np.int64], goal: Array) -> tuple[str, ...]:
        """Returns the instructions of an episode that asks for goals `(K,)` in an order `(K,)`; empty for nothing."""
        each = [self._sentences(k, bool(goal[k])) for k in in_order(order)]
        return tuple(", then ".join(sentences) for sentences in zip(*each, strict=True))

    def _sentences(self, k: int, opens: bool) -> tuple[str, ...]:
        return tuple(sentence.format(self._words[k]) for sentence in _SENTENCES[_verb(self._parts[k][1], opens)])

    @property
    def requested_tasks(self) -> list[str]:
        """Tasks that the episode asks for, in their order."""
        return self.requests.names(self.state.order, self.state.goal)

    def metrics(self, infos: Mapping[str, Any]) -> Metrics:
        """Returns whether everything requested was completed, and the control step of each completion."""
        completed = self.completions_in(infos).steps_by_task
        return {
            "success": all(step is not None for step in completed.values()),
            "tasks_completed": {name: step for name, step in completed.items() if step is not None},
        }

    def progress_in(self, infos: Mapping[str, Any]) -> NDArray[np.int64]:
        """Returns the number of completed tasks."""
        return (infos["completion_steps"] > 0).sum(axis=-1)

    def completions_in(self, infos: Mapping[str, Any]) -> Completions:
        slots, goal = np.flatnonzero(infos[f"{REQUESTED}_mask"]), infos["goal_openings"]
        tasks = tuple(f"{_verb(self._parts[k][1], bool(goal[k]))} {self._names[k]}" for k in slots)
        return Completions(tasks, np.full(len(tasks), True), infos["completion_steps"][slots])

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

    def initial_state(self, draws: Array) -> KitchensState:
        return self.mdp.with_request(super().initial_state(draws), self.requests.order, self.requests.goal)

    def saved_state(self) -> dict[str, Any]:
        return self.state.as_dict()

    def restore_state(self, state: Mapping[str, Any]) -> None:
        self.set_mdp_state(KitchensState.from_dict(state, self.state.slots))

    def publish(self, physics: mjcf.Physics | None) -> None:
        """Updates the observation and, given a physics, the colours."""
        self._observation = self.mdp.observation(self._simulation, self.state)
        if self._visualize_reward and physics is not None:
            within = self.state.progress.within[: len(self._parts)]
            self._highlighting.update(within.tolist())

    def _part(self, part: slice, physics: mjcf.Physics) -> NDArray[np.float32]:
        return self._observation[part]


def _verb(part: Part, opens: bool) -> str:
    """Returns the verb of the task to open a part or turn it on, or else to close it or turn it off."""
    return next(verb for verb, (begins_open, kinds) in VERBS.items() if part.kind in kinds and begins_open != opens)


def part_words(scene: GeneratedKitchen) -> tuple[str, ...]:
    """Returns every part of a kitchen in words, such as `top drawer of the left cabinet`."""
    placed = {each.name: each for each in scene.design.placed}
    words = []
    for name, part in scene.parts:
        is_alone = part.kind in ("kettle", "switch")
        words.append(part.words if is_alone else f"{part.words} of the {_words(placed[name], scene.design.placed)}")
    return tuple(words)


_ORDINALS = (
    *("first ", "second ", "third ", "fourth ", "fifth ", "sixth ", "seventh ", "eighth "),
    *("ninth ", "tenth ", "eleventh ", "twelfth ", "thirteenth ", "fourteenth ", "fifteenth ", "sixteenth "),
)


def _words(one: Placed, placed: Sequence[Placed]) -> str:
    """Returns a fixture in words, with its place among those called the same unless it is the only one."""
    words = one.design.words
    same = [each for each in placed if each.design.words == words]
    same.sort(key=lambda each: np.arctan2(each.position[0], each.position[1]))
    places = {1: ("",), 2: ("left ", "right "), 3: ("left ", "middle ", "right ")}.get(len(same), _ORDINALS)
    azimuths = [np.arctan2(each.position[0], each.position[1]) for each in same]
    if (np.diff(azimuths) < 0.01).any():  # One is above another.
        same.sort(key=lambda each: each.position[2])
        places = ("lower ", "upper ") if len(same) == 2 else _ORDINALS
    return f"{places[same.index(one)]}{words}"
