"""Properties of every command: its flags and its help."""

import dataclasses
import importlib.metadata
import re

import pytest
from help_text import flag_lines

import kitchen_suite
from kitchen_suite import checks
from kitchen_suite.cli import benchmark, convert, evaluate, export, play, record, replay, rollout, train, view
from kitchen_suite.cli.options import OPTIONS

MODULES = (benchmark, convert, evaluate, export, play, record, replay, rollout, train, view)
COMMANDS = {command.COMMAND.name: command.COMMAND for command in MODULES}


def test_bounds_are_those_of_the_environments():
    assert OPTIONS["num_envs"].maximum == OPTIONS["eval_episodes"].maximum == checks.MAX_ENVS
    assert OPTIONS["num_threads"].maximum == checks.MAX_THREADS


def test_all_commands_are_tested_here():
    scripts = importlib.metadata.entry_points(group="console_scripts")
    installed = {script.name: script.load() for script in scripts if script.value.startswith("kitchen_suite.")}
    assert installed == {name: tested.console_main for name, tested in COMMANDS.items()}


def flags_of(tested):
    """Names of a command's flags."""
    names = {field.name for field in dataclasses.fields(tested.settings)} - {tested.positional}
    return names | {"help", "version"}


@pytest.mark.parametrize("name", COMMANDS)
@pytest.mark.parametrize("flag", ["--help", "-h", "-?", "--helpshort", "--helpfull"])
def test_help_lists_every_flag_in_the_order_and_words_of_the_options(name, flag, capsys):
    tested = COMMANDS[name]
    assert tested.main([flag]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert out.startswith(f"{tested.description}\nFlags:\n")
    assert f"\n  {name}" in tested.description
    assert len(out.splitlines()) <= 60
    lines = flag_lines(out)
    assert list(lines) == [option for option in OPTIONS if option in flags_of(tested)]
    for option, text in lines.items():
        # The same in every command, but for the default.
        unset = {field.name: field.metadata.get("unset") for field in dataclasses.fields(tested.settings)}.get(option)
        unset = re.escape(f" Default: {unset or OPTIONS[option].unset}.")
        endings = ("", r" Default: [^ ]+\.", unset, r" Required\.")
        assert any(re.fullmatch(re.escape(OPTIONS[option].help) + ending, text) for ending in endings), text


@pytest.mark.parametrize("name", COMMANDS)
def test_version_is_that_of_the_package(name, capsys):
    assert COMMANDS[name].main(["--version"]) == 0
    assert capsys.readouterr() == (f"{name} {kitchen_suite.__version__}\n", "")


@pytest.mark.parametrize("name", COMMANDS)
def test_an_unknown_flag_gets_one_line_with_the_nearest_and_status_2(name, capsys):
    flag = next(option for option in OPTIONS if option in flags_of(COMMANDS[name]) and len(option) > 5)
    assert COMMANDS[name].main([f"--{flag[:-1]}=1"]) == 2
    assert capsys.readouterr() == (
        "",
        f"{name}: there is no flag --{flag[:-1]} (did you mean --{flag}?); --help lists all\n",
    )


@pytest.mark.parametrize("name", COMMANDS)
def test_an_argument_too_many_gets_one_line_and_status_2(name, capsys):
    tested = COMMANDS[name]
    assert tested.main(["one", "two"]) == 2
    extra = "two" if tested.positional else "one"
    assert capsys.readouterr() == ("", f"{name}: unexpected argument '{extra}': all others are flags, see --help\n")


REQUIRED_SETTINGS = {
    "kitchen-record": "--output",
    "kitchen-replay": "source",
    "kitchen-train": "--output",
    "kitchen-export": "--output",
}


@pytest.mark.parametrize("name", REQUIRED_SETTINGS)
def test_a_missing_argument_gets_one_line_and_status_2(name, capsys):
    assert COMMANDS[name].main([]) == 2
    argument = REQUIRED_SETTINGS[name]
    option = OPTIONS[argument.removeprefix("--")]
    assert capsys.readouterr() == ("", f"{name}: {argument} is missing: {option.help}\n")


def test_options_are_the_settings_of_all_commands():
    used = {field.name for tested in COMMANDS.values() for field in dataclasses.fields(tested.settings)}
    assert used | {"help", "version"} == OPTIONS.keys()


@pytest.mark.parametrize("name", OPTIONS)
def test_the_help_of_an_option_is_one_or_two_sentences(name):
    assert re.fullmatch(r"[A-Za-z][^\n]*[.]", OPTIONS[name].help)
    assert len(OPTIONS[name].help) <= 220


@pytest.mark.parametrize("name", COMMANDS)
def test_a_reader_who_leaves_before_the_help_is_no_usage_error(name, monkeypatch):
    def leave(*args):
        raise BrokenPipeError

    monkeypatch.setattr("builtins.print", leave)
    with pytest.raises(BrokenPipeError):
        COMMANDS[name].main(["--help"])
