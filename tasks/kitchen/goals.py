"""The seven goals of the kitchen's props."""

from collections.abc import Mapping
from types import MappingProxyType

from kitchen_suite.tasks.goals import Goal

# Distance below which a task counts as complete, over all joints of the task together [rad, m]; as in the reference.
THRESHOLD = 0.3

# The values are those of gymnasium-robotics 1.4.2.
GOALS: Mapping[str, Goal] = MappingProxyType(
    {
        "bottom burner": Goal(
            description="turn the knob of the bottom left burner",
            prop="oven",
            joints=("knob_Joint_2", "bottom_left_burner"),
            value=(-0.88, -0.01),
        ),
        "top burner": Goal(
            description="turn the knob of the top left burner",
            prop="oven",
            joints=("knob_Joint_4", "top_left_burner"),
            value=(-0.92, -0.01),
        ),
        "light switch": Goal(
            description="turn the light switch on the hood",
            prop="hood",
            value=(-0.69, -0.05),
        ),
        "slide cabinet": Goal(
            description="slide the cabinet's door open to the right",
            prop="slide_cabinet",
            value=(0.37,),
        ),
        "hinge cabinet": Goal(
            description="open the right door of the hinge cabinet, the left one stays shut",
            prop="hinge_cabinet",
            value=(0.0, 1.45),
        ),
        "microwave": Goal(
            description="open the microwave's door",
            prop="microwave",
            value=(-0.75,),
        ),
        "kettle": Goal(
            description="move the kettle to the top left burner",
            prop="kettle",
            value=(-0.23, 0.75, 1.62, 0.99, 0.0, 0.0, -0.06),
        ),
    }
)
