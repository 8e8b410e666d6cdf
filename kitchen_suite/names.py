"""Names that several packages share: of the kitchen's tasks, kinds of physics, classes, and packages of extras."""

from typing import NamedTuple

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

EXACT, FAST = PHYSICS = ("exact", "fast")
"""Names of the ways in which a scene is simulated; the first is the default."""

# Greatest number of parts in the name of a recorded array, such as the three of `info/reward/approach`.
MAX_NAME_PARTS = 8


class EnvironmentClasses(NamedTuple):
    """Entry points `module:name` of the classes of Gymnasium environments, single and vectorised."""

    single: str
    vector: str


ANY_ENVIRONMENT = EnvironmentClasses(
    single="kitchen_suite.gymnasium_env.base:SuiteEnv",
    vector="kitchen_suite.vector_env.base:SuiteVectorEnv",
)
"""Those for tasks of any domain."""

KITCHEN_ENVIRONMENT = EnvironmentClasses(
    single="kitchen_suite.gymnasium_env.kitchen:FrankaKitchenEnv",
    vector="kitchen_suite.vector_env.kitchen:FrankaKitchenVectorEnv",
)

OPEN_CABINET_ENVIRONMENT = EnvironmentClasses(
    single="kitchen_suite.gymnasium_env.open_cabinet:FrankaOpenCabinetEnv",
    vector="kitchen_suite.vector_env.open_cabinet:FrankaOpenCabinetVectorEnv",
)

MICROWAVE_TABLE_ENVIRONMENT = EnvironmentClasses(
    single="kitchen_suite.gymnasium_env.microwave_table:FrankaMicrowaveTableEnv",
    vector="kitchen_suite.vector_env.microwave_table:FrankaMicrowaveTableVectorEnv",
)

GENERATED_KITCHEN_ENVIRONMENT = EnvironmentClasses(
    single="kitchen_suite.gymnasium_env.generated_kitchens:GeneratedKitchenEnv",
    vector="kitchen_suite.vector_env.generated_kitchens:GeneratedKitchenVectorEnv",
)

# Packages that an extra installs, by the name of the extra, of which an error says that they are missing.
EXTRA_PACKAGES = {"experts": ("daqp", "mink"), "remote": ("msgpack", "websockets")}
