"""Episodes with objects in files: recordings repeat, receipts hold, designs and layouts are kept by content."""

import json

import numpy as np
import pytest
from helpers.errors import refused
from helpers.object_kitchen import ARGUMENTS, DESIGN, LAYOUT, load, put, start, support

import kitchen_suite
from kitchen_suite.commands import record, replay, rollout
from kitchen_suite.entities import KitchenDesign, ObjectLayout
from kitchen_suite.episodes.spec import EnvironmentSpec

DOMAIN = ["--domain_name=pick_and_place", "--task_name=any_2"]


def test_a_specification_has_design_and_layout_as_json(tmp_path):
    file = tmp_path / "mine.json"
    file.write_text(json.dumps(DESIGN), encoding="utf-8")
    layout = ObjectLayout.make(LAYOUT, KitchenDesign.make(DESIGN, "train"))
    spec = EnvironmentSpec.make("pick_and_place", "any", {"design": str(file), "objects": layout})
    file.unlink()
    assert json.loads(json.dumps(spec.as_json()))["task_kwargs"]["objects"] == LAYOUT
    with spec.make_environment() as environment:
        scene = environment.unwrapped.composer_task.scene
        assert scene.layout == layout
        assert scene.design == KitchenDesign.make(DESIGN, "train")


@pytest.mark.full
@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    "arguments",
    [
        {"design": 7},
        {"design": 1, "split": "test", "reward": "dense", "control_mode": "ee_delta_pose", "num_slots": 2},
        {**ARGUMENTS, "physics": "exact", "reward": "dense_gain"},
    ],
    ids=["train", "test", "own"],
)
def test_the_commands_play_record_and_replay_it(arguments, capsys):
    given = [*DOMAIN, f"--task_kwargs={json.dumps(arguments)}", "--max_episode_steps=5", "--variations=start,dynamics"]
    assert rollout.main([*given, "--num_episodes=1", "--output=rolled"]) == 0
    assert record.main([*given, "--num_episodes=3", "--output=runs", "--num_threads=1"]) == 0
    for output in ("rolled", "runs"):
        capsys.readouterr()
        assert replay.main([output]) == 0
        assert "episodes are equal" in capsys.readouterr().out


@pytest.mark.full
@pytest.mark.usefixtures("folder")
def test_a_receipt_holds_and_an_altered_one_is_refused():
    kwargs = {"task_kwargs": ARGUMENTS, "num_episodes": 3, "max_episode_steps": 5}
    evaluation = kitchen_suite.evaluate(
        "random", domain_name="pick_and_place", task_name="any_2", receipt="mine.npz", **kwargs
    )
    assert evaluation.scores["success"] == 0.0
    assert kitchen_suite.replay("mine.npz").verdict == "equal"
    with np.load("mine.npz") as arrays:
        altered = {name: arrays[name] for name in arrays}
    name = next(name for name, array in altered.items() if array.dtype.kind == "f" and array.size > 100)
    altered[name] = altered[name] * 0.5
    np.savez("altered.npz", **altered)
    with refused(OSError, "it was changed"):
        kitchen_suite.replay("altered.npz")


@pytest.mark.full
def test_a_push_puts_an_object_back_where_it_began():
    push = {"push/step": 8.0, "push/undoes": 1.0, "push/which": 0.0, "push/joint_offsets": [0.0] * 7}
    environment = load("any_2", variations=push)
    start(environment, "put_on can tray", "put_on mug stove_1/burner_1")
    begun = environment.task.state.poses[0].copy()
    put(environment, 0, support(environment, "tray"))
    within = []
    for _ in range(10):
        environment.step(np.zeros(9))
        within.append(bool(environment.task.state.progress.within[0]))
    assert any(within[:7])
    assert not within[-1]
    np.testing.assert_allclose(environment.task.state.poses[0, :3], begun[:3], atol=0.01)


def test_a_command_refuses_an_impossible_layout_in_one_line(refusal):
    wrong = {"design": DESIGN, "objects": {**LAYOUT, "places": ["sink"]}}
    error = refusal(rollout, "--domain_name=pick_and_place", f"--task_kwargs={json.dumps(wrong)}")
    assert "place of objects 'sink' does not exist" in error
    with refused(ValueError, "place of objects 'sink' does not exist"):
        load(objects=wrong["objects"])
