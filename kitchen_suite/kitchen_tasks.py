"""Names of the kitchen's tasks: those of FrankaKitchen-v1, others, and sets of them."""

# The seven of FrankaKitchen-v1, in its order.
DEFAULT_TASKS = ("bottom burner", "top burner", "light switch", "slide cabinet", "hinge cabinet", "microwave", "kettle")

# Those that put a prop back, each with the task that it undoes.
REVERSES = {
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

FURTHER_TASKS = ("bottom right burner", "top right burner", "left hinge cabinet", *REVERSES)

# Sets of D4RL. `complete` and `partial` are two data sets of demonstrations for the same four goals.
TASK_SETS = {
    "complete": ("microwave", "kettle", "light switch", "slide cabinet"),
    "partial": ("microwave", "kettle", "light switch", "slide cabinet"),
    "mixed": ("microwave", "kettle", "bottom burner", "light switch"),
    "all": DEFAULT_TASKS,
}
