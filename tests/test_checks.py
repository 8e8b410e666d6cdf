"""Checks of arguments: messages about values of any kind, and hints."""

import numpy as np
import pytest
from helpers.errors import ODD_VALUES, assert_is_short

from kitchen_suite import checks

# Each refuses every odd value.
CHECKS = {
    "choice": lambda value: checks.choice(value, ["kettle"], "task"),
    "keywords": lambda value: checks.keywords([value], ["shape"], what="argument"),
    "number": lambda value: checks.number(value, "threshold"),
    "integer": lambda value: checks.integer(value, "width", minimum=1, maximum=5),
    "boolean": lambda value: checks.boolean(value, "visuals"),
    "reset_options": lambda value: checks.reset_options([value], ["state"]),
    "unique_names": lambda value: checks.unique_names({"kettle": value}, "tasks_to_complete"),
    "vector": lambda value: checks.vector(value, 9, "action"),
    "matching": lambda value: checks.matching(value, {"physics": 0.0}, "state"),
    "matching of a part": lambda value: checks.matching({"physics": value}, {"physics": np.zeros(9)}, "state"),
}


@pytest.mark.parametrize("value", ODD_VALUES.values(), ids=ODD_VALUES)
@pytest.mark.parametrize("check", CHECKS)
def test_an_error_about_a_value_of_any_size_depth_and_repr_takes_one_short_line(check, value):
    with pytest.raises((TypeError, ValueError)) as raised:
        CHECKS[check](value)
    assert_is_short(str(raised.value))


@pytest.mark.parametrize("value", [0.25, "kettle", [0.1] * 9, {"kettle/mass": {"uniform": [0, 1]}}, ("a",), None, {1}])
def test_a_small_value_is_shown_whole(value):
    assert checks.shown(value) == repr(value)


@pytest.mark.parametrize("text", ["x" * 300, "\0" * 150, "\0" * 300])
def test_a_text_is_short_also_with_its_escapes(text):
    assert len(checks.shortened(text, 200)) <= 200


HINTS = {
    "seed": ("random", ["sleep", "success", "random"]),
    "horizon": (None, ["horizontal", "task"]),
    "wrist": ("franka/wrist", ["right", "franka/wrist"]),
    "burner": ("bottom burner", ["kettle", "bottom burner"]),
    "threshhold": ("threshold", ["reward", "threshold"]),
    "toaster": (None, ["kettle", "light switch"]),
}


@pytest.mark.parametrize("value", HINTS)
def test_a_hint_knows_synonyms_and_the_ends_of_names(value):
    meant, choices = HINTS[value]
    assert checks.nearest(value, choices) == meant


def test_a_number_above_its_maximum_is_refused_and_the_maximum_is_not():
    assert checks.number(10, "speed", maximum=10.0) == 10.0
    with pytest.raises(ValueError, match="speed must be at most 10, got 1e\\+155"):
        checks.number(1e155, "speed", maximum=10.0)
