"""How commands end."""

import pytest

from kitchen_suite.cli import common


def perform(error):
    def work():
        raise error

    return common.perform(
        "kitchen-test", work, interrupted=lambda: "interrupted early", failures=(OSError,), misuses=(KeyError,)
    )


@pytest.mark.parametrize(
    ("error", "status", "words"),
    [
        (KeyboardInterrupt(), 130, "interrupted early"),
        (OSError("disk\nfull"), 1, "disk full"),
        (KeyError("lost"), 2, "'lost'"),
    ],
)
def test_what_ends_a_command_is_told_in_one_line(error, status, words, capsys):
    assert perform(error) == status
    assert capsys.readouterr().err == f"kitchen-test: {words}\n"


@pytest.mark.parametrize("error", [BrokenPipeError(), ZeroDivisionError()])
def test_what_is_not_the_commands_to_tell_goes_on(error, capsys):
    with pytest.raises(type(error)):
        perform(error)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(("given", "status"), [(None, 0), (1, 1)])
def test_work_may_give_a_status(given, status):
    assert common.perform("kitchen-test", lambda: given, interrupted=str, failures=()) == status
