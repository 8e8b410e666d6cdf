"""Success and goals in publications on the Franka kitchen, as functions of the 30 positions that they observe.

A state `(..., 30)` has the positions of the robot's 9 joints, then of the objects' 21: knob and burner of the bottom
right, bottom left, top right and top left burner (9 to 16), light switch and light (17, 18), slide cabinet (19), left
and right door of the hinge cabinet (20, 21), microwave (22), position and quaternion of the kettle (23 to 29) [rad, m].
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

States = NDArray[np.float64]

STATE = np.r_[0:9, 18:39]  # The state among the 59 numbers that the kitchen observes with the Franka.

# Positions of the robot's joints in the goals of GAS; `D_utils/kitchen_utils.py` of qortmdgh4141/GAS, line 43.
GAS_ROBOT = (
    *(-2.4308119, -1.4440080, 1.0221981, -1.7869282, 0.18872257, 1.6170777, 1.2863032),
    *(0.025421469, 0.0074267522),
)

# Number of last states in BESO's goal; `beso/envs/franka_kitchen/goals.py` of intuitive-robots/beso, lines 82 to 93.
BESO_FRAMES = 2

# Control steps from start to goal, and to the end; `docs/api/world.md` of stable-worldmodel, lines 95 to 105.
GOAL_OFFSET, GOAL_STEPS = 30, 50

# Distance of all positions of objects from those of a goal at which it is reached.
_GOAL_DISTANCE = 0.1
_OBJECTS = slice(9, 30)

# Columns of the objects of D4RL's tasks.
COLUMNS: Mapping[str, slice] = MappingProxyType(
    {
        "bottom burner": slice(11, 13),
        "top burner": slice(15, 17),
        "light switch": slice(17, 19),
        "slide cabinet": slice(19, 20),
        "hinge cabinet": slice(20, 22),
        "microwave": slice(22, 23),
        "kettle": slice(23, 30),
    }
)


def goal_state(goals: Mapping[str, ArrayLike], robot: ArrayLike) -> States:
    """Returns the goal `(30,)` that goal-conditioned policies of D4RL's kitchen are given.

    `goals` are of D4RL's tasks, such as the `desired_goal` of an observation; the other objects are at 0, as in D4RL.
    `robot` `(9,)` are positions of its joints: 0 in D4RL, `GAS_ROBOT` for GAS, those of the first recorded observation
    for HIQL.
    """
    goal = np.zeros(30)
    goal[:9] = robot
    for task, value in goals.items():
        goal[COLUMNS[task]] = value
    return goal


def last_frames(states: States, completed: Sequence[str], generator: np.random.Generator) -> dict[str, Any] | None:
    """Returns the options of a reset that ask for what a demonstration did: its tasks, and its last states.

    None is returned if it completed no tasks. `states` are `(T + 1, 30)`; `generator` is not drawn from.
    """
    if not completed:
        return None
    return {"requested_tasks": [*completed], "goal_states": states[-BESO_FRAMES:].tolist()}


def later_state(states: States, completed: Sequence[str], generator: np.random.Generator) -> dict[str, Any] | None:
    """Returns the options of a reset that start in a state of an episode, and ask for the one `GOAL_OFFSET` later.

    The start is drawn from all `states` `(T + 1, 30)` in which the goal is not yet reached; None is returned if nothing
    moves far enough. `completed` is not used.
    """
    starts, goals = states[:-GOAL_OFFSET], states[GOAL_OFFSET:]
    firsts = np.flatnonzero(_distances(starts, goals) > _GOAL_DISTANCE)
    if not firsts.size:
        return None
    first = generator.choice(firsts)
    return {"start_state": starts[first].tolist(), "goal_states": goals[[first]].tolist()}


def goal_reached(states: States, goals: States) -> bool:
    """Returns whether in some state `(T, 30)` after the first all objects are where the last goal `(k, 30)` has them.

    The Euclidean distance of their 21 positions is at most 0.1.
    """
    return bool((_distances(states[1:], goals[-1]) <= _GOAL_DISTANCE).any())


def holds_at_start(options: Mapping[str, Any]) -> bool:
    """Returns whether the last goal state of a reset's options is reached where they have the episode start."""
    if not {"start_state", "goal_states"} <= options.keys():
        return False
    start, goal = np.array(options["start_state"]), np.array(options["goal_states"][-1])
    return bool(_distances(start, goal) <= _GOAL_DISTANCE)


def _distances(states: States, goals: States) -> NDArray[np.float64]:
    distances: NDArray[np.float64] = np.linalg.norm(states[..., _OBJECTS] - goals[..., _OBJECTS], axis=-1)
    return distances
