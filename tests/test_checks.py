"""Checks of arguments: messages about values of any kind, and hints."""

import numpy as np
import pytest
from helpers.errors import ODD_VALUES, assert_is_short, refused

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


@pytest.mark.parametrize("check", CHECKS.values(), ids=CHECKS)
def test_an_error_about_a_value_of_any_size_depth_and_repr_takes_one_short_line(check):
    for value in ODD_VALUES.values():
        with pytest.raises((TypeError, ValueError)) as raised:
            check(value)
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


# Of each check: the call, the error, and what its message shows.
REFUSED = {
    "a choice that is misspelt": (
        lambda: checks.choice("ketle", ["kettle", "microwave"], "task"),
        ValueError,
        ["task", "'ketle'", "did you mean 'kettle'", "'microwave'"],
    ),
    "a choice of another type": (lambda: checks.choice(3, ["kettle"], "task"), TypeError, ["task", "3"]),
    "an unknown keyword": (
        lambda: checks.keywords(["thresold"], ["threshold"], what="argument"),
        TypeError,
        ["argument", "'thresold'", "'threshold'"],
    ),
    "a negative number": (lambda: checks.number(-1, "speed"), ValueError, ["speed", "-1", "non-negative"]),
    "zero for a positive number": (
        lambda: checks.number(0, "speed", positive=True),
        ValueError,
        ["speed", "0", "positive"],
    ),
    "NaN": (lambda: checks.number(np.nan, "speed"), ValueError, ["speed", "finite", "nan"]),
    "an infinite number": (lambda: checks.number(np.inf, "speed"), ValueError, ["speed", "finite", "inf"]),
    "an int beyond all floats": (lambda: checks.number(10**400, "speed"), ValueError, ["speed", "finite"]),
    "a number above its maximum": (
        lambda: checks.number(1e155, "speed", maximum=10.0),
        ValueError,
        ["speed", "10", "1e+155"],
    ),
    "a bool for a number": (lambda: checks.number(True, "speed"), TypeError, ["speed", "True"]),
    "a string for a number": (lambda: checks.number("fast", "speed"), TypeError, ["speed", "'fast'"]),
    "an integer below its minimum": (
        lambda: checks.integer(0, "width", minimum=1),
        ValueError,
        ["width", "at least 1", "0"],
    ),
    "an integer above its maximum": (
        lambda: checks.integer(6, "width", minimum=1, maximum=5),
        ValueError,
        ["width", "at most 5", "6"],
    ),
    "a bool for an integer": (lambda: checks.integer(True, "width", minimum=1), TypeError, ["width", "True"]),
    "a float for an integer": (lambda: checks.integer(2.0, "width", minimum=1), TypeError, ["width", "2.0"]),
    "an int for a bool": (lambda: checks.boolean(1, "visuals"), TypeError, ["visuals", "True or False", "1"]),
    "None for a bool": (lambda: checks.boolean(None, "visuals"), TypeError, ["visuals", "None"]),
    "a misspelt option": (
        lambda: checks.reset_options({"reset_mas": 1, "low": 0}, ["reset_mask"]),
        ValueError,
        ["option", "'reset_mas'", "'reset_mask'"],
    ),
    "an option that is no string": (lambda: checks.reset_options({3: 1}, ["state"]), TypeError, ["option", "3"]),
    "options that are no dict": (lambda: checks.reset_options(3, ["state"]), TypeError, ["options", "3"]),
    "a string for names": (lambda: checks.unique_names("kettle", "tasks"), TypeError, ["tasks", "'kettle'"]),
    "a set of names, which has no order": (lambda: checks.unique_names({"kettle"}, "tasks"), TypeError, ["tasks"]),
    "an int for names": (lambda: checks.unique_names(7, "tasks"), TypeError, ["tasks", "7"]),
    "no names": (lambda: checks.unique_names([], "tasks"), ValueError, ["tasks", "empty"]),
    "a name twice": (
        lambda: checks.unique_names(["kettle", "kettle"], "tasks"),
        ValueError,
        ["tasks", "'kettle'", "more than once"],
    ),
    "a vector of another size": (
        lambda: checks.vector(np.zeros(8), 9, "action"),
        ValueError,
        ["action", "(9,)", "(8,)"],
    ),
    "a matrix for a vector": (
        lambda: checks.vector(np.zeros((1, 9)), 9, "action"),
        ValueError,
        ["action", "(9,)", "(1, 9)"],
    ),
    "a number for a vector": (lambda: checks.vector(-0.4, 1, "goal"), ValueError, ["goal", "(1,)", "()", "-0.4"]),
    "a list of parts that differ": (
        lambda: checks.vector([[1.0], [2.0, 3.0]], 2, "goal"),
        ValueError,
        ["goal", "array"],
    ),
    "NaN in a vector": (lambda: checks.vector([0.0, np.nan], 2, "action"), ValueError, ["action", "finite", "nan"]),
    "inf in a vector": (lambda: checks.vector([0.0, -np.inf], 2, "action"), ValueError, ["action", "finite", "inf"]),
    "strings in a vector": (lambda: checks.vector(["up"] * 2, 2, "action"), TypeError, ["action", "numbers"]),
    "bools in a vector": (lambda: checks.vector([True] * 2, 2, "action"), TypeError, ["action", "numbers"]),
    "complex numbers in a vector": (lambda: checks.vector([1j] * 2, 2, "action"), TypeError, ["action", "numbers"]),
    "masked entries in a vector": (
        lambda: checks.vector(np.ma.array([0.0, 1.0], mask=[False, True]), 2, "action"),
        ValueError,
        ["action", "masked", "filled"],
    ),
    "a list of arrays with masked entries": (
        lambda: checks.array_of([np.ma.array([0.0, 1.0], mask=[False, True])] * 2, "actions"),
        ValueError,
        ["actions", "masked", "filled"],
    ),
    "None for a vector": (lambda: checks.vector(None, 2, "action"), TypeError, ["action", "None"]),
}


@pytest.mark.parametrize(("check", "error", "shown"), REFUSED.values(), ids=REFUSED)
def test_a_value_that_is_refused_is_named_with_what_is_allowed(check, error, shown):
    with refused(error, *shown):
        check()


def test_values_at_the_limits_are_taken():
    assert checks.number(10, "speed", maximum=10.0) == 10.0
    assert checks.number(np.float32(0.0), "speed") == 0.0
    assert checks.integer(np.int64(1), "width", minimum=1, maximum=5) == 1
    assert checks.integer(5, "width", minimum=1, maximum=5) == 5
    assert checks.unique_names((), "tasks", minimum=0) == ()
