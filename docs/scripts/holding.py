"""Measures which objects fingers hold, and at what cost in speed; docs/results/holding.md has the tables.

python docs/scripts/holding.py holds   lifts each object, holds it for ten seconds and lets it go: results/holding.json
python docs/scripts/holding.py speed   rates of vectorised scenes with cans: results/holding_speed.json

A hand grasps the object from above, on a stand beside the robot, with `kitchen_suite.grasping.Grasp`; a vectorised
environment then makes the same actions, and must be bit-identical.
"""

import dataclasses
import functools
import itertools
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from dm_control import composer, mjcf
from dm_control.entities.props.primitive import Primitive
from experiment import RESULTS, in_processes, run_named, write_rows

from kitchen_suite import suite
from kitchen_suite.entities.objects import OBJECTS, GraspedObject
from kitchen_suite.entities.scenes import Scene
from kitchen_suite.grasping import CONTROL_MODE, GRASP, Grasp
from kitchen_suite.physics_names import EXACT, FAST, HOLDING_KEY
from kitchen_suite.tasks import rotations

# Half sizes [m]: a box, a cylinder, a narrow cylinder and a narrow box, all 10 cm high.
SHAPES: dict[str, dict[str, Any]] = {
    "box of 6 cm": {"geom_type": "box", "size": (0.03, 0.03, 0.05)},
    "cylinder of 6.6 cm": {"geom_type": "cylinder", "size": (0.033, 0.05)},
    "cylinder of 3 cm": {"geom_type": "cylinder", "size": (0.015, 0.05)},
    "box of 2.4 cm": {"geom_type": "box", "size": (0.05, 0.012, 0.05)},
}
MASSES = (0.05, 0.1, 0.2, 0.3)  # [kg].
SCENES = (
    ("kitchen", EXACT),
    ("kitchen", FAST),
    ("kitchens", EXACT),
    ("kitchens", FAST),
    ("microwave_table", EXACT),
    ("open_cabinet", EXACT),
)

# Places of the stand in the frame of the robot's base [m]: on its left, where nothing else is.
PLACES = {
    "kitchen": (0.2, 0.5, -0.02),
    "kitchens": (0.2, 0.5, -0.02),
    "microwave_table": (0.2, 0.45, 0.15),
    "open_cabinet": (0.2, 0.45, 0.15),
}
CLEARANCE = 1e-4  # Of the object above the stand at the start [m].

NUM_ENVS = 32
STEPS = 30  # Control steps of a round.
ROUNDS = 5


class Stand(composer.Entity):
    """A plate of 16 by 16 cm; its frame is at the centre of its top."""

    def _build(self) -> None:
        self._mjcf_root = mjcf.RootElement(model="stand")
        self._mjcf_root.worldbody.add("geom", name="plate", type="box", size=(0.08, 0.08, 0.02), pos=(0, 0, -0.02))

    @property
    def mjcf_model(self) -> mjcf.RootElement:
        return self._mjcf_root


def make_object(kind: str, mass: float | None, name: str = "object") -> tuple[composer.Entity, float]:
    """Returns an object with a mass [kg], its own where it is None, and the height of its frame above its base [m]."""
    if kind in SHAPES:
        made = Primitive(**SHAPES[kind], mass=mass, name=name)
        made.mjcf_model.worldbody.add("site", name=GRASP, pos=(0, 0, 0.015), quat=(0, 1, 0, 0))
        return made, SHAPES[kind]["size"][-1]
    own: GraspedObject = OBJECTS[kind](name=name)
    masses = [geom for geom in own.body.geom if geom.mass]
    factor = 1.0 if mass is None else mass / sum(geom.mass for geom in masses)
    for geom in masses:
        geom.mass *= factor
    return own, 0.0


def in_world(scene: Scene, place: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Returns a place in the frame of the robot's base in the world [m], and the orientation of the base."""
    physics = mjcf.Physics.from_mjcf_model(scene.arena.mjcf_model)
    base = physics.bind(mjcf.get_attachment_frame(scene.robot.mjcf_model))
    orientation = base.xquat / np.linalg.norm(base.xquat)
    return base.xpos + rotations.rotated(orientation, np.array(place)), orientation


@functools.cache
def domain_with_object(name: str) -> suite.Domain:
    """Returns one of the suite's domains with a stand and objects, registered as `holding_<name>`."""
    original = suite.DOMAINS[name]
    base = original.resolve("task")

    class HoldingTask(base):  # type: ignore[misc, valid-type]
        """A task in whose scene are a stand and, on it, an object; further ones are in a row above the first."""

        def __init__(self, scene: Scene, *, kind: str = "can", mass: float | None = None, count: int = 1, **options):
            place, orientation = in_world(scene, PLACES[name])
            scene.attach(Stand(), pos=place)
            for number in range(count):
                made, height = make_object(kind, mass, "object" if number == 0 else f"object_{number}")
                above = np.array([0.0, 0.0, height + CLEARANCE + 0.15 * number])
                scene.attach(made, pos=place + above, quat=orientation, free=True)
            super().__init__(scene, **options)

    changes = {"name": f"holding_{name}", "task": HoldingTask, "env_id": f"Holding/{name.title()}-v1", "task_id": ""}
    task = original.default_task
    made = dataclasses.replace(
        original, **changes, tasks={task: dict(original.tasks[task])}, benchmark_tasks=(), expert=None, undirected=None
    )
    suite.register(made)
    return made


def measure_holds() -> None:
    """Measures each object with each mass in each scene."""
    kinds = [*itertools.product(SHAPES, MASSES), *itertools.product(OBJECTS, (None, *MASSES))]
    cases = [(*scene, *kind) for scene in SCENES for kind in kinds]
    rows = []
    for row in in_processes(measure_hold, cases, chunksize=len(kinds)):
        rows.append(row)
        print(row, flush=True)
    write_rows(RESULTS / "holding.json", rows)


def measure_hold(case: tuple[str, str, str, float | None]) -> dict[str, Any]:
    """Plays a grasp in a single environment, and its actions in a vectorised one."""
    name, physics, kind, mass = case
    domain = domain_with_object(name)
    options = {"kind": kind, "mass": mass, "physics": physics, "control_mode": CONTROL_MODE}
    task = domain.tasks[domain.default_task]
    single = domain.env_class(domain=domain.name, visuals=False, **task, **options)
    many = domain.vector_env_class(2, domain=domain.name, num_threads=1, visuals=False, **task, **options)
    _, info = single.reset(seed=0)
    many.reset(seed=0)
    identical = True
    grasp = Grasp(single.environment, "object")
    for action in grasp.actions():
        single.step(action)
        many.step(np.stack([action, action]))
        identical &= np.array_equal(single.physics_state, many.physics_state[0])
    held = grasp.result()
    single.close()
    many.close()
    return {
        **{"domain": name, "physics": physics, "kind": kind, "mass": mass, "options": info[HOLDING_KEY]},
        **{key: round(value, 6) for key, value in dataclasses.asdict(held).items()},
        **{"held": not held.fault, "identical": bool(identical)},
    }


def measure_speed() -> None:
    """Measures control steps a second of vectorised scenes with three cans, on one thread, in turn."""
    rows = []
    for name in ("kitchen", "kitchens"):
        domain = domain_with_object(name)
        task = domain.tasks[domain.default_task]
        cases = [(True, EXACT), (True, FAST), (False, EXACT), (False, FAST)]
        made = []
        for with_cans, physics in cases:
            of = domain if with_cans else suite.DOMAINS[name]
            cans = {"count": 3} if with_cans else {}
            options = {"num_threads": 1, "visuals": False, "physics": physics, **task, **cans}
            made.append(of.vector_env_class(NUM_ENVS, domain=of.name, **options))
        rates = np.array([[_rate(each, number) for each in made] for number in range(ROUNDS + 1)])[1:]
        for case, rate in zip(cases, np.median(rates, axis=0), strict=True):
            rows.append({"domain": name, "cans": 3 if case[0] else 0, "physics": case[1], "rate": round(float(rate))})
        for each in made:
            each.close()
    write_rows(RESULTS / "holding_speed.json", rows)


def _rate(environments: Any, seed: int) -> float:
    """Returns control steps a second with random actions."""
    environments.reset(seed=seed)
    actions = list(_random_actions(environments, seed))
    start = time.perf_counter()
    for action in actions:
        environments.step(action)
    return NUM_ENVS * len(actions) / (time.perf_counter() - start)


def _random_actions(environments: Any, seed: int) -> Iterator[np.ndarray]:
    generator = np.random.default_rng(seed)
    for _ in range(STEPS):
        yield generator.uniform(-1.0, 1.0, environments.action_space.shape)


if __name__ == "__main__":
    run_named(__doc__, {"holds": measure_holds, "speed": measure_speed})
