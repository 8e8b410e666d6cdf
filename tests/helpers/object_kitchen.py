"""A kitchen of one's own with objects: a place of each kind of verb, and two objects of one kind."""

import numpy as np

from kitchen_suite import suite

DESIGN = {
    "counter_height": 1.7,
    "style": "oak",
    "rows": [
        {
            "side": "back",
            "level": "base",
            "distance": 0.5,
            "start": -0.6,
            "fixtures": [
                {"kind": "stove", "width": 0.6, "height": 0.5, "count": 2},
                {"kind": "drawers", "width": 0.6, "height": 0.5, "count": 2, "handle": "bar"},
            ],
        },
        {
            "side": "back",
            "level": "wall",
            "distance": 0.75,
            "start": -0.5,
            "height": 2.3,
            "fixtures": [
                {"kind": "wall_doors", "width": 0.6, "height": 0.4, "count": 1, "handle": "bar", "hinge": "left"}
            ],
        },
    ],
}
# The tray stands at the left of the stove's top, the objects on that of the drawers.
LAYOUT = {
    "objects": [
        {"kind": "can", "position": [0.12, 0.6, 1.701], "yaw": 0.0},
        {"kind": "mug", "position": [0.3, 0.6, 1.701], "yaw": -1.5},
        {"kind": "can", "position": [0.47, 0.6, 1.701], "yaw": 0.5},
    ],
    "tray": [-0.2, 0.66, 1.7, 0.0],
    "places": [
        *("tray", "stove_1/burner_1", "drawers_1/drawer_1", "drawers_1/drawer_2"),
        *("wall_doors_1/inside", "drawers_1/worktop"),
    ],
}
ARGUMENTS = {"design": DESIGN, "objects": LAYOUT}
NO_NOISE = {"robot_noise_ratio": 0.0, "object_noise_ratio": 0.0}


def load(task="any", **arguments):
    """Loads a task in this kitchen, without what is only in images."""
    return suite.load("pick_and_place", task, {**ARGUMENTS, "visuals": False, "random": 0, **arguments})


def start(environment, *tasks):
    """Begins an episode that asks for some tasks; returns its first timestep."""
    task = environment.task
    task.follow(task.checked_reset({"requested_tasks": list(tasks)}))
    return environment.reset()


def put(environment, number, position):
    """Puts an object upright and at rest somewhere, its base at a position [m]; of no effect before the next step."""
    bound = environment.physics.bind(environment.task.scene.objects[number].joints[0])
    bound.qpos = (*position, 1.0, 0.0, 0.0, 0.0)
    bound.qvel = 0.0


def set_part(environment, name, position):
    """Moves the joint of a part [rad, m]; of no effect before the next step."""
    environment.physics.bind(environment.task.scene.joint_of(name)).qpos = position


def support(environment, place):
    """Returns the middle of a place's support, where it is now, `(3,)` [m]."""
    state = environment.task.state
    index = environment.task.scene.layout.places.index(place)
    return state.items.supports(state.shifts)[index]


def rest(environment, steps=5):
    """Makes control steps without motion of the robot; returns the last timestep."""
    for _ in range(steps):
        timestep = environment.step(np.zeros(9))
        if timestep.last():
            break
    return timestep
