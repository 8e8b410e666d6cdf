"""Names and arguments of what stands for devices of robosuite and LeRobot, against these packages as installed.

They are read and not imported: both bring packages that nothing else here needs. Without these,
`pip install --no-deps --ignore-requires-python robosuite lerobot` installs them.
"""

import ast
import importlib.util
from pathlib import Path

import pytest

pytestmark = pytest.mark.devices

ROOT = Path(__file__).resolve().parents[2] / "kitchen_suite"


def class_of(path, name):
    """The definition of a class in a file."""
    tree = ast.parse(path.read_text("utf-8"))
    return next(node for node in tree.body if isinstance(node, ast.ClassDef) and node.name == name)


def installed(package, path):
    spec = importlib.util.find_spec(package)
    assert spec, f"{package} is not installed"
    return Path(spec.submodule_search_locations[0]) / path


def methods(definition):
    """Names of arguments, and how many have defaults, by method; and whether it is a property."""
    return {
        node.name: (
            [argument.arg for argument in node.args.args],
            len(node.args.defaults),
            any(ast.unparse(each) == "property" for each in node.decorator_list),
        )
        for node in definition.body
        if isinstance(node, ast.FunctionDef)
    }


def abstract(definition):
    return {
        node.name
        for node in definition.body
        if isinstance(node, ast.FunctionDef) and any("abstract" in ast.unparse(each) for each in node.decorator_list)
    }


def keys_returned(definition, method):
    """Keywords of the `dict(...)`, or keys of the `{...}`, that a method returns."""
    function = next(node for node in definition.body if isinstance(node, ast.FunctionDef) and node.name == method)
    value = next(node.value for node in ast.walk(function) if isinstance(node, ast.Return))
    if isinstance(value, ast.Call):
        return {keyword.arg for keyword in value.keywords}
    return {key.value for key in value.keys}


def test_a_page_is_a_device_of_robosuites():
    base = class_of(installed("robosuite", "devices/device.py"), "Device")
    keyboard = class_of(installed("robosuite", "devices/keyboard.py"), "Keyboard")
    own = class_of(ROOT / "viewer" / "intervention.py", "PageDevice")
    assert abstract(base) == {"start_control", "get_controller_state"}
    for name in (*abstract(base), "_postprocess_device_outputs"):
        assert methods(own)[name] == methods(keyboard)[name]
    arguments, _, _ = methods(keyboard)["__init__"]
    assert methods(own)["__init__"][0][: len(arguments)] == arguments
    assert keys_returned(own, "get_controller_state") == keys_returned(keyboard, "get_controller_state")


def test_a_page_is_a_teleoperator_of_lerobots():
    base = class_of(installed("lerobot", "teleoperators/teleoperator.py"), "Teleoperator")
    keyboard = class_of(installed("lerobot", "teleoperators/keyboard/teleop_keyboard.py"), "KeyboardEndEffectorTeleop")
    own = class_of(ROOT / "lerobot" / "teleoperator.py", "BrowserTeleop")
    assert len(abstract(base)) == 10
    for name in abstract(base):
        assert methods(own)[name] == methods(base)[name]
    assert methods(own)["get_teleop_events"] == methods(keyboard)["get_teleop_events"]
    names = {node.value for node in ast.walk(own) if isinstance(node, ast.Constant)}
    assert {"delta_x", "delta_y", "delta_z", "gripper"} <= names
    events = {node.attr for node in ast.walk(own) if isinstance(node, ast.Attribute)}
    known = class_of(installed("lerobot", "teleoperators/utils.py"), "TeleopEvents")
    constants = {node.targets[0].id for node in known.body if isinstance(node, ast.Assign)}
    assert {"IS_INTERVENTION", "TERMINATE_EPISODE", "SUCCESS", "RERECORD_EPISODE"} <= events & constants
