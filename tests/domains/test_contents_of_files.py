"""Files that change numbers are kept by content: designs, and a user's own certificates."""

import copy
import json
import pickle
import shutil
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from helpers.errors import refused

from kitchen_suite import suite
from kitchen_suite.commands import evaluate, record, replay
from kitchen_suite.entities import arms
from kitchen_suite.entities.kitchen_designs import KitchenDesign
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.evaluation.plan import EvaluationPlan
from kitchen_suite.evaluation.receipt import Receipt
from kitchen_suite.policies import PolicyRef
from kitchen_suite.tasks.generated_kitchens import certificates
from kitchen_suite.versions import installed_versions

pytestmark = pytest.mark.usefixtures("folder")

ID = "KitchenSuite/Kitchens-v1"
EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples"
FIRST, SECOND = (KitchenDesign.drawn(number, "train") for number in (0, 1))


def write(path, design):
    path.write_text(json.dumps(design.to_json()), encoding="utf-8")


@pytest.fixture
def file(tmp_path):
    """A file of a design, which is another kitchen's once it has been read."""
    path = tmp_path / "kitchen.json"
    write(path, FIRST)
    return path


def parts_of(environment):
    return environment.task.scene.part_names


@pytest.mark.full
def test_a_specification_has_the_design_and_not_its_path(file):
    spec = EnvironmentSpec.make("kitchens", "any", {"design": str(file)})
    assert str(file) not in json.dumps(spec.as_json())
    write(file, SECOND)
    with spec.make_environment() as environment:
        assert environment.unwrapped.composer_task.scene.design.to_json() == FIRST.to_json()
    # One with another design is another specification.
    assert EnvironmentSpec.make("kitchens", "any", {"design": str(file)}) != spec
    assert EnvironmentSpec.make("kitchens", "any", {"design": 7}).task_kwargs == {"design": 7}


@pytest.mark.full
def test_copies_keep_the_design_that_was_read(file):
    single = gymnasium.make(ID, design=str(file)).unwrapped
    by_position = type(single)(file)
    loaded = suite.load("kitchens", "any", {"design": str(file), "visuals": False})
    for environment in (single, by_position):
        environment.reset(seed=0)
    loaded.reset()
    write(file, SECOND)
    for environment in (single, by_position):
        other = copy.deepcopy(environment)
        assert parts_of(other.environment) == parts_of(environment.environment)
        again = pickle.loads(pickle.dumps(environment))
        assert parts_of(again.environment) == parts_of(environment.environment)
    assert parts_of(copy.deepcopy(loaded)) == parts_of(loaded)
    assert FIRST.to_json() != SECOND.to_json()


@pytest.mark.full
def test_a_recording_of_another_design_is_not_continued(run, file):
    flags = ["--domain_name=kitchens", "--max_episode_steps=3", "--num_threads=1", "--output=runs"]
    design = f'--task_kwargs={{"design": "{file}"}}'
    assert run(record, *flags, design, "--num_episodes=1")[0] == 0
    write(file, SECOND)
    status, _, err = run(record, *flags, design, "--num_episodes=2")
    assert (status, "task_kwargs" in err) == (2, True)
    file.unlink()
    assert run(replay, "runs")[0] == 0


@pytest.mark.full
def test_an_evaluation_in_a_design_is_verified_where_its_file_is_not(run, file):
    flags = ["--domain_name=kitchens", "--policy=zero", "--num_episodes=1", "--max_episode_steps=3"]
    design = f'--task_kwargs={{"design": "{file}"}}'
    assert run(evaluate, *flags, design, "--receipt=a.npz", "--output=out")[0] == 0
    write(file, SECOND)
    assert run(evaluate, *flags, design, "--output=out", "--resume")[0] == 2
    file.unlink()
    status, out, _ = run(replay, "a.npz")
    assert (status, "design" in out.splitlines()[0]) == (0, True)


@pytest.mark.full
def test_a_receipt_names_no_file(run, file):
    flags = ["--domain_name=kitchens", "--policy=zero", "--num_episodes=1", "--max_episode_steps=3"]
    assert run(evaluate, *flags, "--receipt=a.npz")[0] == 0
    description = Receipt.read(Path("a.npz")).evaluation
    for condition in description["conditions"].values():
        condition["task_kwargs"]["design"] = str(file)
    with refused(ValueError, "depends on files"):
        EvaluationPlan.of(description)


@pytest.mark.full
def test_certified_tasks_of_a_users_own_certificate_are_in_the_specification(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    number = 3_000_000
    design = KitchenDesign.drawn(number, "train")
    with suite.load("kitchens", "any", {"design": number, "visuals": False}) as environment:
        tasks = environment.task.requests.tasks
    own = {"design": number, "certified": True}
    with refused(ValueError, "has no certificate"):
        EnvironmentSpec.make("kitchens", "any", own)
    path = certificates.default_path("train")
    path.parent.mkdir(parents=True)
    line = {
        "design": number,
        "digest": certificates.design_digest(design),
        "physics": "fast",
        "depth_mm": 0.0,
        "reached": {},
        "steps": {task: 10 if place == 0 else None for place, task in enumerate(tasks)},
    }
    path.write_text(json.dumps(line, separators=(",", ":")) + "\n", encoding="utf-8")
    spec = EnvironmentSpec.make("kitchens", "any", own)
    assert spec.task_kwargs["certified"] == [tasks[0]]
    # It does not depend on the cache any more.
    shutil.rmtree(tmp_path / "kitchen-suite")
    with spec.make_environment() as environment:
        assert environment.unwrapped.composer_task.requests.tasks == (tasks[0],)
    # The package's certificates are the same everywhere.
    shipped = EnvironmentSpec.make("kitchens", "any", {"design": 0, "certified": True})
    assert shipped.task_kwargs == {"design": 0, "certified": True}
    with refused(ValueError, "certified task"):
        EnvironmentSpec.make("kitchens", "any", {"certified": ["fly"]}).make_environment()


@pytest.mark.full
def test_a_state_is_of_one_kitchen(tmp_path):
    """Of two kitchens whose states have the same sizes."""
    plan = FIRST.to_json()
    other = copy.deepcopy(plan)
    other["counter_height"] = round(plan["counter_height"] - 0.005, 3)
    one, two = (suite.load("kitchens", "any", {"design": each, "visuals": False}) for each in (plan, other))
    for environment in (one, two):
        environment.reset()
    state = one.get_state()
    one.step(np.zeros(one.action_spec().shape))
    one.set_state(state)
    with refused(ValueError, "design"):
        two.set_state(state)


@pytest.mark.full
def test_a_recording_is_readable_that_has_a_path(run, file):
    """As those of earlier versions do."""
    flags = ["--domain_name=kitchens", "--max_episode_steps=3", "--num_threads=1", "--output=runs", "--num_episodes=1"]
    assert run(record, *flags)[0] == 0
    path = Path("runs", "recording.json")
    written = json.loads(path.read_text("utf-8"))
    written["task_kwargs"]["design"] = str(file)
    path.write_text(json.dumps(written), encoding="utf-8")
    assert Recording.open(Path("runs")).spec.task_kwargs["design"] == str(file)


def test_the_model_of_a_users_arm_is_in_the_specification_by_its_digest(monkeypatch):
    monkeypatch.syspath_prepend(EXAMPLES)
    kwargs = {"robot": "my_arm:MY_ARM", "control_mode": "ee_delta_pose"}
    environments = EnvironmentSpec.make("kitchen", "kettle", kwargs)
    spec = environments.episodes(PolicyRef.parse("zero"), seed=0)
    assert len(spec.versions["robot my_arm:MY_ARM"]) == 16
    assert environments.episodes(PolicyRef.parse("zero"), seed=0) == spec
    own = EnvironmentSpec.make("kitchen", "kettle", {}).episodes(PolicyRef.parse("zero"), seed=0)
    assert own.versions == installed_versions()
    # Another arm of the same name.
    my_arm = sys.modules["my_arm"]
    monkeypatch.setattr(my_arm, "MJCF", my_arm.MJCF.replace('damping="1"', 'damping="1.1"'))
    arms.model_digest.cache_clear()
    assert environments.episodes(PolicyRef.parse("zero"), seed=0) != spec
    arms.model_digest.cache_clear()
