"""The private names of composer: all of them listed, all of them there, and a clear error where one is missing."""

import ast
import inspect

import pytest

from kitchen_suite.environment import environment, mjcf_physics, observation_updater
from kitchen_suite.environment.private_names import PRIVATE_NAMES, check_private_names, names_of
from kitchen_suite.rendering import measuring


def test_the_table_lists_the_private_names_that_the_environment_uses():
    of_composer = set().union(*map(names_of, PRIVATE_NAMES))
    modules = (environment, mjcf_physics, observation_updater, measuring)
    nodes = [node for module in modules for node in ast.walk(ast.parse(inspect.getsource(module)))]
    accessed = {node.attr for node in nodes if isinstance(node, ast.Attribute)}
    overridden = {node.name for node in nodes if isinstance(node, ast.FunctionDef)}
    private = {name for name in accessed | overridden if name.startswith("_") and not name.startswith("__")}
    listed = {name for names in PRIVATE_NAMES.values() for name in names if name.startswith("_")}
    assert private & of_composer == listed


@pytest.mark.parametrize("path", PRIVATE_NAMES)
def test_every_class_has_names_of_its_own(path):
    assert set(PRIVATE_NAMES[path]) <= names_of(path)
    assert "_no_such_name" not in names_of(path)


@pytest.mark.parametrize(
    "path",
    [
        "dm_control.composer.environment:Environment",
        "dm_control.composer.environment:_NoSuchClass",
        "dm_control.composer.no_such_module:Environment",
    ],
)
def test_a_missing_name_is_an_error_that_says_which_dm_control_is_needed(path):
    with pytest.raises(ImportError, match=r"has no .*:\w+\._gone; kitchen_suite needs dm-control >= 1\.0\.50, < 1\.1"):
        check_private_names({path: ("_gone",)})
