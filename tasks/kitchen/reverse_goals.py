"""Goals that undo other goals of the kitchen: doors are closed, knobs and switch turned off, the kettle returned."""

from collections.abc import Mapping
from types import MappingProxyType

from kitchen_suite.tasks.goals import Goal
from kitchen_suite.tasks.kitchen.initial_state import initial_positions

# The task that each of these undoes.
REVERSES: Mapping[str, str] = MappingProxyType(
    {
        "close microwave": "microwave",
        "close slide cabinet": "slide cabinet",
        "close hinge cabinet": "hinge cabinet",
        "close left hinge cabinet": "left hinge cabinet",
        "turn off bottom burner": "bottom burner",
        "turn off top burner": "top burner",
        "turn off bottom right burner": "bottom right burner",
        "turn off top right burner": "top right burner",
        "turn off light switch": "light switch",
        "return kettle": "kettle",
    }
)

# Joints of those that look at fewer joints than the task that they undo.
_JOINTS = {"close hinge cabinet": ("right_hinge_cabinet",)}

_INSTRUCTIONS = {
    "close microwave": (
        "close the microwave door",
        "close the microwave",
        "push the door of the microwave shut",
        "swing the microwave door shut",
    ),
    "close slide cabinet": (
        "close the slide cabinet",
        "slide the cabinet door shut",
        "slide the door of the cabinet to the left",
        "push the sliding door of the cabinet shut",
    ),
    "close hinge cabinet": (
        "close the right door of the hinge cabinet",
        "close the hinge cabinet on its right side",
        "push the right door of the hinge cabinet shut",
        "swing the right door of the hinge cabinet shut",
    ),
    "close left hinge cabinet": (
        "close the left door of the hinge cabinet",
        "close the hinge cabinet on its left side",
        "push the left door of the hinge cabinet shut",
        "swing the left door of the hinge cabinet shut",
    ),
    "turn off light switch": (
        "turn off the light switch",
        "switch off the light",
        "flip the light switch on the hood back",
        "turn off the light above the stove",
    ),
    "return kettle": (
        "move the kettle back to the bottom left burner",
        "put the kettle back on the bottom left burner",
        "place the kettle on the bottom left burner",
        "return the kettle to the bottom left burner",
    ),
    **{
        f"turn off {place} burner": (
            f"turn off the {position} burner",
            f"switch off the {position} burner",
            f"turn the knob of the {position} burner back",
            f"put out the {position} burner of the stove",
        )
        for place, position in (
            ("bottom", "bottom left"),
            ("top", "top left"),
            ("bottom right", "bottom right"),
            ("top right", "top right"),
        )
    },
}


def reverse_goals(forward: Mapping[str, Goal]) -> dict[str, Goal]:
    """Returns the goals of `REVERSES`, given those that they undo: they start there and lead to the initial state."""
    return {task: _reverse(forward[undone], task) for task, undone in REVERSES.items()}


def _reverse(forward: Goal, task: str) -> Goal:
    joints = _JOINTS.get(task, forward.joints)
    # The last values of the forward goal are those of the joints that the reverse looks at.
    value = initial_positions(forward.prop, joints)
    return Goal(
        prop=forward.prop,
        joints=joints,
        value=value,
        start=forward.value[-len(value) :],
        handle=forward.handle,
        instructions=_INSTRUCTIONS[task],
    )
