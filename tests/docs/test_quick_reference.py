"""Every id, argument, task, command, flag and page that the quick reference and llms.txt name exists."""

import re
import shlex

import gymnasium
import stand_ins
from docs_blocks import ROOT
from helpers.errors import refused

from kitchen_suite import commands, gymnasium_env, policies, suite
from kitchen_suite.datasets.formats import FORMATS

DOCS = ROOT / "docs"
PAGE = (DOCS / "guide" / "quick_reference.md").read_text(encoding="utf-8")
LIST = (DOCS / "llms.txt").read_text(encoding="utf-8")


def rows(heading):
    """The rows of the page's table with a heading: its cells, each as the words that are code there."""
    table = re.search(rf"^\| {heading} \|.*\n\|.*\n((?:\|.*\n)+)", PAGE, re.MULTILINE)[1]
    return [[re.findall(r"`([^`]+)`", cell) for cell in line.split(" | ")] for line in table.splitlines()]


def test_ids_and_tasks_exist_and_every_domain_is_there():
    assert set(re.findall(r"KitchenSuite/[\w-]+", PAGE + LIST)) <= gymnasium.registry.keys()
    tasks = {domains[0]: names for domains, _, names in rows("domain")}
    assert tasks.keys() == suite.TASKS_BY_DOMAIN.keys()
    assert all({*names} <= {*suite.TASKS_BY_DOMAIN[domain]} for domain, names in tasks.items())


def test_arguments_and_control_modes_exist():
    arguments = [name for names, _ in rows("argument") for name in names]
    kitchen = suite.DOMAINS["kitchen"]
    gymnasium_env.FrankaKitchenEnv.check_keywords(kitchen, arguments)
    with refused(TypeError, "'control_mod'"):
        gymnasium_env.FrankaKitchenEnv.check_keywords(kitchen, ["control_mod"])
    modes = next(values for names, values in rows("argument") if names == ["control_mode"])
    assert {*modes} == {*kitchen.resolve("task").control_modes}


def test_commands_flags_formats_and_policies_exist():
    spans = [shlex.split(span) for span in re.findall(r"`(kitchen-[^`]+)`", PAGE + LIST)]
    known = {f"kitchen-{name}": commands.find(name) for name in commands.NAMES}
    for name, *arguments in spans:
        assert name in {*known, "kitchen-suite"}
        if arguments:
            stand_ins.check_command(name, *arguments)
    flags = {flag for each in known.values() for flag in each.flags()}
    assert set(re.findall(r"--(\w+)", PAGE + LIST)) <= {*flags, "help"}
    ((_, *formats),) = [cells for _, cells in rows("task") if len(cells) > 2]
    assert {*formats} == {*FORMATS}
    named = re.search(r"^- `--policy`: (.*), `module:callable`", PAGE, re.MULTILINE)[1]
    assert set(re.findall(r"`(\w+)`", named)) <= policies.POLICIES.keys()


def test_the_benchmark_of_vla_eval_exists():
    module, name = re.search(r"`(\w+):(\w+Benchmark)`", PAGE).groups()
    (folder,) = re.findall(r"`docs/(plugins/\w+)`", PAGE)
    assert f"class {name}(" in (DOCS / folder / f"{module}.py").read_text(encoding="utf-8")
    configs = [path.read_text(encoding="utf-8") for path in (DOCS / folder).glob("*.yaml")]
    assert configs
    assert all(f"benchmark: {module}:{name}\n" in config for config in configs)


def test_the_list_names_pages_that_exist():
    links = re.findall(r"\]\(([\w/]+)\.html\)", LIST)
    assert len(links) == LIST.count("](") > 20
    missing = [link for link in links if not (DOCS / f"{link}.md").is_file()]
    assert missing == ["reference/commands"]  # Made for the site.
