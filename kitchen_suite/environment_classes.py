"""Entry points of the classes of the Gymnasium environments, by the kind of task.

They are strings, which domains and tasks name without importing the classes.
"""

from typing import NamedTuple


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

PICK_AND_PLACE_ENVIRONMENT = EnvironmentClasses(
    single="kitchen_suite.gymnasium_env.pick_and_place:PickAndPlaceEnv",
    vector="kitchen_suite.vector_env.pick_and_place:PickAndPlaceVectorEnv",
)
