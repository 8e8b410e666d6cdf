"""The Gymnasium ids: one for each domain and one for each task, registered as soon as the package is imported."""

import re
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

from kitchen_suite import gymnasium_env, suite
from kitchen_suite.tasks import DEFAULT_TASKS

KETTLE = "KitchenSuite/Kettle-v1"
UNDISTURBED = "assert not {'dm_control', 'mujoco'} & sys.modules.keys()"


@pytest.mark.full
@pytest.mark.parametrize(
    "code",
    [
        f"import gymnasium, sys, kitchen_suite; {UNDISTURBED}; gymnasium.spec('{KETTLE}')",
        f"import kitchen_suite, sys, gymnasium; {UNDISTURBED}; gymnasium.spec('{KETTLE}')",
        f"import gymnasium; gymnasium.make('kitchen_suite:{KETTLE}')",
    ],
    ids=["gymnasium first", "suite first", "by prefix"],
)
def test_importing_the_suite_registers_the_ids_and_imports_no_dm_control(code):
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_every_task_has_an_id_of_its_own():
    assert gymnasium_env.TASK_IDS["kitchen", "bottom_burner"] == "KitchenSuite/BottomBurner-v1"
    assert list(gymnasium_env.TASK_IDS) == list(suite.ALL_TASKS)
    ids = [*gymnasium_env.IDS.values(), *gymnasium_env.TASK_IDS.values()]
    assert len(set(ids)) == len(ids)
    assert {name for name in gymnasium.registry if name.startswith("KitchenSuite/")} >= set(ids)


def test_the_pages_of_the_domains_list_every_id():
    docs = Path(__file__).resolve().parents[2] / "docs"
    pages = [docs / "guide" / "migrating.md", *(docs / "domains").glob("*.md")]
    listed = {name for page in pages for name in re.findall(r"KitchenSuite/[\w-]+-v1", page.read_text("utf-8"))}
    # A row of the kitchen's page has those from Random1 to Random7.
    listed |= {f"KitchenSuite/Random{number}-v1" for number in range(1, 8)}
    assert listed == {*gymnasium_env.IDS.values(), *gymnasium_env.TASK_IDS.values()}


@pytest.mark.full
def test_the_table_of_domains_agrees_with_the_tasks():
    kitchen, cabinet = suite.DOMAINS["kitchen"], suite.DOMAINS["open_cabinet"]
    assert kitchen.tasks["all"] == {"tasks_to_complete": DEFAULT_TASKS}
    # 22.4 s of 0.08 s, and 7 s of 0.01 s.
    assert (kitchen.episode_steps, cabinet.episode_steps) == (280, 700)
    assert suite.kitchen(visuals=False).step_limit == kitchen.episode_steps
    assert suite.open_cabinet(visuals=False).step_limit == cabinet.episode_steps


@pytest.mark.full
@pytest.mark.parametrize(
    ("domain", "task"), [("kitchen", "mixed"), ("open_cabinet", "bottom_drawer"), ("kitchens", "any_2")]
)
def test_an_environment_of_a_tasks_id_is_the_general_one_with_the_tasks_arguments(domain, task):
    task_id, general_id = gymnasium_env.TASK_IDS[domain, task], gymnasium_env.IDS[domain]
    arguments = suite.task_arguments(domain, task)
    one, other = gymnasium.make(task_id), gymnasium.make(general_id, **arguments)
    assert one.spec.max_episode_steps == other.spec.max_episode_steps == suite.DOMAINS[domain].episode_steps
    assert_equal(one, other)
    assert_equal(
        *(
            gymnasium.make_vec(name, 2, num_threads=1, **kwargs)
            for name, kwargs in ((task_id, {}), (general_id, arguments))
        )
    )


def assert_equal(one, other):
    assert one.action_space == other.action_space
    assert one.observation_space == other.observation_space
    assert data_equivalence(one.reset(seed=3), other.reset(seed=3), exact=True)
    action = np.full(one.action_space.shape, 0.01, np.float32)
    assert data_equivalence(one.step(action), other.step(action), exact=True)
