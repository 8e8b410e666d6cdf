"""Requests of an episode: which objects it asks to be put on or in which places, or taken out of them."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.entities.generated_kitchen import MAX_PARTS
from kitchen_suite.entities.object_layouts import MAX_OBJECTS
from kitchen_suite.entities.pick_and_place import PickAndPlaceKitchen
from kitchen_suite.tasks.orders import REQUESTED, REQUESTED_ORDER, TaskDraw, checked_order, order_of, sequence_of
from kitchen_suite.tasks.pick_and_place.mdp import Request
from kitchen_suite.tasks.requests import Requests

_CONTAINERS = frozenset({"drawer", "cabinet", "microwave"})

# Verbs of tasks, and the kinds of places that they are for.
VERBS: Mapping[str, frozenset[str]] = {
    "put_on": frozenset({"burner", "tray"}),
    "put_in": _CONTAINERS,
    "take_out": _CONTAINERS,
    "open_and_put_in": _CONTAINERS,
}


class ObjectTask(NamedTuple):
    """A task of an object.

    Attributes:
      verb: one of `VERBS`.
      number: index of the object in the layout.
      goal: index of the place where it is to be.
      origin: index of the place in which it is at the start; -1 where it stands on a worktop.
    """

    verb: str
    number: int
    goal: int
    origin: int

    @property
    def closed(self) -> bool:
        """Whether the place has to be opened first."""
        return self.verb == "open_and_put_in"


def tasks_of(scene: PickAndPlaceKitchen, verbs: Sequence[str]) -> dict[str, ObjectTask]:
    """Returns the tasks of some verbs in a kitchen by name, such as `put_in can drawers_1/drawer_1`."""
    worktops = [number for number, place in enumerate(scene.places) if place.kind == "worktop"]
    found = {}
    for verb in verbs:
        for number, name in enumerate(scene.layout.names):
            for index, place in enumerate(scene.places):
                if place.kind not in VERBS[verb]:
                    continue
                if verb != "take_out":
                    found[f"{verb} {name} {place.name}"] = ObjectTask(verb, number, index, -1)
                elif worktops:
                    found[f"{verb} {name} {place.name}"] = ObjectTask(verb, number, worktops[0], index)
    return found


class ObjectRequests(Requests):
    """What episodes ask for: drawn at a reset among the objects that the task's verbs are for, unless named.

    Each object is asked for once at most.

    Attributes:
      tasks: names of the tasks that episodes may ask for, such as `put_on mug tray`.
      counts: how many objects an episode asks for.
      request: of the episode that starts.
    """

    options = (REQUESTED,)

    def __init__(
        self, scene: PickAndPlaceKitchen, verbs: Sequence[str], count: object, allowed: Collection[str] | None = None
    ) -> None:
        """Collects the tasks of some verbs in a kitchen, all or those allowed."""
        self._scene = scene
        everything = tasks_of(scene, verbs)
        self._tasks = {name: task for name, task in everything.items() if allowed is None or name in allowed}
        self.tasks = tuple(self._tasks)
        if not self.tasks:
            kinds = ", ".join(sorted({place.kind for place in scene.places}))
            nothing = "nothing" if allowed is None else "nothing certified"
            where = f"kitchen {scene.design.name or 'of this design'}"
            raise ValueError(f"{where} has {nothing} to {' or '.join(verbs)}: its places are {kinds}")
        self._by_object: dict[int, list[ObjectTask]] = {}
        for task in self._tasks.values():
            self._by_object.setdefault(task.number, []).append(task)
        self.counts = TaskDraw.make(count, len(self._by_object))
        self._weights = np.isin(np.arange(MAX_OBJECTS), list(self._by_object)).astype(np.float64)
        # Before the first reset.
        self._request([self._by_object[number][0] for number in sorted(self._by_object)[: self.counts.most]])

    def checked(self, options: Mapping[str, Any]) -> tuple[str, ...] | None:
        if options.get(REQUESTED) is None:
            return None
        names = checks.unique_names(options[REQUESTED], REQUESTED)
        tasks = tuple(checks.choice(name, self.tasks, REQUESTED) for name in names)
        if len({self._tasks[task].number for task in tasks}) < len(tasks):
            raise ValueError(f"{REQUESTED} must not ask for the same object twice, got {checks.shown(names)}")
        return tasks

    def draw(self, random_state: np.random.RandomState, request: tuple[str, ...] | None) -> None:
        order = self.counts.draw(random_state, self._weights)
        which = random_state.random_sample(MAX_OBJECTS)
        if request is not None:
            self._request([self._tasks[name] for name in request])
            return
        chosen = []
        for number in sequence_of(order):
            tasks = self._by_object[number]
            chosen.append(tasks[int(which[number] * len(tasks))])
        self._request(chosen)

    def _request(self, tasks: Sequence[ObjectTask]) -> None:
        """Asks for tasks of different objects, in their sequence."""
        goal = np.zeros(MAX_OBJECTS, np.int64)
        origin = np.full(MAX_OBJECTS, -1)
        closed = np.zeros(MAX_OBJECTS, bool)
        part_order = np.full(MAX_PARTS, -1)
        # A place is closed at the start only where nothing asks for it to be open.
        is_open = {index for task in tasks if not task.closed for index in (task.goal, task.origin)}
        for task in tasks:
            goal[task.number] = task.goal
            origin[task.number] = task.origin
            closed[task.number] = task.closed
            if task.closed and task.goal not in is_open:
                for name in self._scene.places[task.goal].parts:
                    part_order[self._scene.part_names.index(name)] = 0
        order = order_of([task.number for task in tasks], MAX_OBJECTS)
        self.request = Request(order, goal, origin, closed, _numbered(part_order))

    def recorded(self, arrays: Mapping[str, NDArray]) -> dict[str, Any]:
        fields = ("goal_places", "start_places", "starts_closed")
        found = [arrays.get(f"info/{name}") for name in (REQUESTED_ORDER, *fields)]
        if any(each is None for each in found):
            return {}
        order, goal, origin, closed = (each[0] for each in found if each is not None)
        order = checked_order(order, MAX_OBJECTS, f"recorded {REQUESTED_ORDER}")
        if any(each.shape != order.shape for each in (goal, origin, closed)):
            raise ValueError(f"recorded goal_places must be those of {MAX_OBJECTS} objects, got {checks.shown(goal)}")
        return {REQUESTED: self.names(order, goal, origin, closed)}

    def names(
        self, order: NDArray[np.int64], goal: NDArray[np.int64], origin: NDArray[np.int64], closed: NDArray[np.bool_]
    ) -> list[str]:
        """Returns the tasks that a request asks for, in their sequence; arrays `(O,)` as in `Request`.

        Raises a ValueError for what is no task of this kitchen.
        """
        by_task = {(task.number, task.goal, task.origin, task.closed): name for name, task in self._tasks.items()}
        keys = [(k, int(goal[k]), int(origin[k]), bool(closed[k])) for k in sequence_of(order)]
        if unknown := [key for key in keys if key not in by_task]:
            raise ValueError(f"recorded goal_places ask for no tasks of this kitchen: {checks.shown(unknown)}")
        return [by_task[key] for key in keys]

    def task(self, name: str) -> ObjectTask:
        """Returns a task by its name."""
        return self._tasks[name]


def _numbered(order: NDArray[np.int64]) -> NDArray[np.int64]:
    """Returns an order in which those that are not -1 have places of their own, in turn."""
    return order_of(np.flatnonzero(order >= 0), order.size)
