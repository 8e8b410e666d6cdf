"""`--control_timestep` of the commands: it travels in specifications, and is named in what they write."""

import json

import gymnasium
import numpy as np
import pytest
from helpers.episodes import load_episode
from helpers.errors import refused

from kitchen_suite import suite
from kitchen_suite.commands import evaluate, record, replay, rollout
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.training.demonstrations import check_same

STEPS = {"kitchen": 0.04, "kitchens": 0.04, "open_cabinet": 0.025, "microwave_table": 0.025}
SHORT = ["--max_episode_steps=4", "--num_episodes=2"]


def flags(domain):
    return [f"--domain_name={domain}", f"--control_timestep={STEPS[domain]}", *SHORT]


@pytest.mark.full
@pytest.mark.parametrize("command", [record, rollout])
@pytest.mark.parametrize("domain", STEPS)
def test_recordings_name_it_and_can_be_replayed(tmp_path, capsys, command, domain):
    assert command.main([*flags(domain), f"--output={tmp_path}"]) == 0
    assert f"control steps of {STEPS[domain]:g} s" in capsys.readouterr().out.partition("\n")[0]
    spec = json.loads((tmp_path / "recording.json").read_text("utf-8"))
    assert spec["task_kwargs"]["control_timestep"] == STEPS[domain]
    for index in range(2):
        _, arrays = load_episode(tmp_path / f"episode_{index:06d}.npz")
        named = arrays["info/control_timestep"]
        np.testing.assert_array_equal(named, np.full(arrays["reward"].size + 1, STEPS[domain]))
    assert replay.main([str(tmp_path)]) == 0


@pytest.mark.full
def test_a_recording_is_the_episode_of_the_environment(tmp_path):
    assert record.main([*flags("kitchen"), f"--output={tmp_path}", "--seed=3"]) == 0
    env = gymnasium.make(suite.DOMAINS["kitchen"].task_ids["complete"], control_timestep=0.04)
    _, arrays = load_episode(tmp_path / "episode_000000.npz")
    observations = [env.reset(seed=3)[0], *(env.step(action)[0] for action in arrays["action"])]
    expected = [each["observation"] for each in observations]
    np.testing.assert_array_equal(arrays["observation/observation"], expected)


@pytest.mark.full
def test_by_default_nothing_is_named(tmp_path):
    assert record.main([*SHORT, f"--output={tmp_path}"]) == 0
    assert "control_timestep" not in (tmp_path / "recording.json").read_text("utf-8")
    assert "info/control_timestep" not in load_episode(tmp_path / "episode_000000.npz")[1]


@pytest.mark.full
def test_results_of_an_evaluation_name_it(tmp_path):
    results = tmp_path / "results.json"
    assert evaluate.main([*flags("kitchen"), f"--json={results}"]) == 0
    assert json.loads(results.read_text("utf-8"))["task_kwargs"]["control_timestep"] == 0.04


@pytest.mark.parametrize("flag", ["--control_timestep=0.041", "--control_timestep=-1", "--control_timestep=soon"])
def test_bad_values_end_with_status_2(tmp_path, capsys, flag):
    assert rollout.main([*SHORT, flag]) == 2
    assert "control_timestep" in capsys.readouterr().err


@pytest.mark.full
def test_it_may_be_among_the_task_kwargs_but_not_twice_with_different_values(tmp_path, capsys):
    given = '--task_kwargs={"control_timestep": 0.04}'
    assert record.main([*SHORT, given, f"--output={tmp_path / 'one'}"]) == 0
    assert record.main([*flags("kitchen"), f"--output={tmp_path / 'other'}"]) == 0
    one, other = (load_episode(tmp_path / name / "episode_000001.npz")[1] for name in ("one", "other"))
    np.testing.assert_array_equal(one["observation/observation"], other["observation/observation"])
    assert rollout.main([*SHORT, given, "--control_timestep=0.02"]) == 2
    assert "control_timestep" in capsys.readouterr().err


@pytest.mark.full
@pytest.mark.parametrize("domain", STEPS)
def test_demonstrations_of_other_control_steps_are_refused(tmp_path, domain):
    default = suite.load(domain, suite.default_task(domain), {"visuals": False}).control_timestep()
    names = suite.DOMAINS[domain].control_options
    specs = [EnvironmentSpec.make(domain, None, kwargs) for kwargs in ({}, {"control_timestep": default})]
    check_same(tmp_path, *specs, names)
    changed = EnvironmentSpec.make(domain, None, {"control_timestep": STEPS[domain]})
    with refused(ValueError, "control_timestep", f"{STEPS[domain]:g}", f"{default:g}"):
        check_same(tmp_path, changed, specs[0], names)
