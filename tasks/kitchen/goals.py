"""The seven goals of the kitchen's props."""

from collections.abc import Mapping
from types import MappingProxyType

from kitchen_suite.tasks.goals import Goal
from kitchen_suite.tasks.instructions import OPEN_MICROWAVE

# Distance below which a task counts as complete, over all joints of the task together [rad, m]; as in the reference.
THRESHOLD = 0.3

# The values are those of gymnasium-robotics 1.4.2.
GOALS: Mapping[str, Goal] = MappingProxyType(
    {
        "bottom burner": Goal(
            prop="oven",
            joints=("knob_Joint_2", "bottom_left_burner"),
            value=(-0.88, -0.01),
            handle="knob_2",
            instructions=(
                "turn on the bottom left burner",
                "switch on the bottom left burner",
                "turn the knob of the bottom left burner",
                "light the bottom left burner of the stove",
            ),
        ),
        "top burner": Goal(
            prop="oven",
            joints=("knob_Joint_4", "top_left_burner"),
            value=(-0.92, -0.01),
            handle="knob_4",
            instructions=(
                "turn on the top left burner",
                "switch on the top left burner",
                "turn the knob of the top left burner",
                "light the top left burner of the stove",
            ),
        ),
        "light switch": Goal(
            prop="hood",
            value=(-0.69, -0.05),
            instructions=(
                "turn on the light switch",
                "switch on the light",
                "flip the light switch on the hood",
                "turn on the light above the stove",
            ),
        ),
        "slide cabinet": Goal(
            prop="slide_cabinet",
            value=(0.37,),
            instructions=(
                "open the slide cabinet",
                "slide the cabinet door open",
                "slide the door of the cabinet to the right",
                "push the sliding door of the cabinet open",
            ),
        ),
        "hinge cabinet": Goal(
            prop="hinge_cabinet",
            value=(0.0, 1.45),
            handle="right_handle",
            instructions=(
                "open the right door of the hinge cabinet",
                "open the hinge cabinet on its right side",
                "pull the right door of the hinge cabinet open",
                "swing the right door of the hinge cabinet open",
            ),
        ),
        "microwave": Goal(
            prop="microwave",
            value=(-0.75,),
            instructions=OPEN_MICROWAVE,
        ),
        "kettle": Goal(
            prop="kettle",
            value=(-0.23, 0.75, 1.62, 0.99, 0.0, 0.0, -0.06),
            instructions=(
                "move the kettle to the top left burner",
                "put the kettle on the top left burner",
                "place the kettle on the top left burner",
                "bring the kettle over to the top left burner",
            ),
        ),
    }
)
