"""A program of a user, which .ci/run checks by mypy and pyright; its types are known by import and by attribute."""

from typing import assert_type

import kitchen_suite
from kitchen_suite import entities, suite
from kitchen_suite.domains.domain import Domain
from kitchen_suite.entities import Scene
from kitchen_suite.environment import Environment, Physics
from kitchen_suite.experts import KitchenExpert
from kitchen_suite.gymnasium_env import FrankaKitchenEnv, SuiteEnv
from kitchen_suite.tasks import KitchenTask, SuiteTask
from kitchen_suite.vector_env import FrankaKitchenVectorEnv


class MyTask(KitchenTask):
    """A task of a user's own."""


by_attribute = kitchen_suite.tasks.KitchenTask
by_import = KitchenTask
assert_type(by_attribute(entities.build_kitchen_scene()), KitchenTask)
assert_type(MyTask(kitchen_suite.entities.build_kitchen_scene()).scene, Scene)

environment = kitchen_suite.load("kitchen", "kettle")
assert_type(environment, Environment)
assert_type(environment.task, SuiteTask)
assert_type(environment.physics, Physics)
assert_type(suite.DOMAINS["kitchen"], Domain)

single = FrankaKitchenEnv(tasks_to_complete=["kettle"])
assert_type(single.environment, Environment)
assert_type(single.composer_task, SuiteTask)
several: list[SuiteEnv] = [single, kitchen_suite.gymnasium_env.FrankaKitchenEnv()]
assert_type(kitchen_suite.vector_env.FrankaKitchenVectorEnv(2), FrankaKitchenVectorEnv)
assert_type(kitchen_suite.experts.KitchenExpert(["kettle"]), KitchenExpert)
