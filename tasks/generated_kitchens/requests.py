"""Requests of an episode in a generated kitchen: which parts it asks to open, close, turn on, turn off or move."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.entities.fixtures import Part
from kitchen_suite.entities.generated_kitchen import MAX_PARTS, GeneratedKitchen
from kitchen_suite.tasks.orders import REQUESTED, REQUESTED_ORDER, TaskDraw, checked_order, order_of, sequence_of
from kitchen_suite.tasks.requests import Requests
from kitchen_suite.types import Array

# Verbs of tasks: whether they begin with the part open or on, and the kinds of parts that they are for.
VERBS: Mapping[str, tuple[bool, frozenset[str]]] = {
    "open": (False, frozenset({"drawer", "door", "sliding door"})),
    "close": (True, frozenset({"drawer", "door", "sliding door"})),
    "turn_on": (False, frozenset({"knob", "switch"})),
    "turn_off": (True, frozenset({"knob", "switch"})),
    "move_kettle": (False, frozenset({"kettle"})),
}


def verb_of(part: Part, opens: bool) -> str:
    """Returns the verb of the task to open a part or turn it on, or else to close it or turn it off."""
    return next(verb for verb, (begins_open, kinds) in VERBS.items() if part.kind in kinds and begins_open != opens)


class PartRequests(Requests):
    """The parts that episodes ask for: drawn at a reset among those that the task's verbs are for, unless named.

    Attributes:
      tasks: names of the tasks that episodes may ask for, such as `open drawers_1/drawer_2`.
      counts: how many parts an episode asks for.
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
        self.counts = TaskDraw.make(count, len(slots))
        self._check_count(self.counts.most)
        self._weights = np.isin(np.arange(MAX_PARTS), list(slots)).astype(np.float64)
        # Whether a part may be asked to be open, and to be closed.
        self._directions = np.zeros((2, MAX_PARTS), bool)
        for k, opens in self._slots.values():
            self._directions[int(opens), k] = True
        # Before the first reset.
        self._request([slots[k] for k in sorted(slots)[: self.counts.most]])

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

    def draw(self, random_state: np.random.RandomState, request: tuple[str, ...] | None) -> None:
        order = self.counts.draw(random_state, self._weights)
        opens = np.where(random_state.random_sample(MAX_PARTS) < 0.5, self._directions[1], ~self._directions[0])
        self.order = order
        self.goal = ((order >= 0) & opens).astype(np.float64)
        if request is not None:
            self._request([self._slots[task] for task in request])

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
        if goals.shape[1:] != order.shape or any((k, bool(goals[0, k])) not in slots for k in sequence_of(order)):
            raise ValueError(f"recorded goal_openings ask for no tasks of this kitchen: {checks.shown(goals[0])}")
        return {REQUESTED: self.names(order, goals[0])}

    def names(self, order: NDArray[np.int64], goal: Array) -> list[str]:
        """Returns the tasks that an order `(K,)` with goals `(K,)` asks for, in their sequence."""
        by_slot = {slot: task for task, slot in self._slots.items()}
        return [by_slot[k, bool(goal[k])] for k in sequence_of(order)]
