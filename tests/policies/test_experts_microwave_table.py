"""The microwave table's expert opens the door from observations alone, from any start and layout, in every mode."""

import json

import numpy as np
import pytest
from helpers.episodes import successes
from helpers.sweeps import MODES, brief

from kitchen_suite import experts, suite
from kitchen_suite.commands import evaluate, record, replay
from kitchen_suite.gymnasium_env import FrankaMicrowaveTableEnv
from kitchen_suite.tasks import MicrowaveTableTask
from kitchen_suite.tasks.variations.distributions import SPLITS

CONTROL_MODES = MODES["microwave_table"]
STYLES = {
    "slow": "expert(speed=0.85)",
    "noisy": "expert(action_noise=0.001)",
    "jittered": "expert(jitter=0.02)",
}


def load(control_mode="joint_offset", **task_kwargs):
    return suite.load("microwave_table", "open", {"visuals": False, "control_mode": control_mode, **task_kwargs})


@pytest.mark.full
@pytest.mark.parametrize("mode", brief(CONTROL_MODES, kept=["ee_delta_position"]))
def test_the_door_is_opened_in_every_mode(mode):
    assert successes(load(mode), [201]) == 1


@pytest.mark.full
def test_the_observation_alone_is_enough_and_actions_are_within_bounds():
    env, expert = FrankaMicrowaveTableEnv(max_episode_steps=500), experts.MicrowaveExpert()
    observation, _ = env.reset(seed=202)
    expert.reset(np.random.default_rng(0))
    truncated = False
    while not truncated:
        action = expert.act(observation)
        assert env.action_space.contains(action)
        observation, _, _, truncated, info = env.step(action)
    assert info["is_success"]


@pytest.mark.full
@pytest.mark.parametrize("split", SPLITS)
def test_it_is_opened_where_start_and_layout_vary(split):
    assert successes(load(variations="start,layout", variation_split=split), [203, 204]) == 2


@pytest.mark.full
@pytest.mark.parametrize("style", STYLES)
def test_a_motion_style_still_opens_it(style):
    assert successes(load(), [205], STYLES[style]) == 1


@pytest.mark.full
def test_a_handle_that_slipped_out_is_taken_again():
    env = load(time_limit=12.0)
    env.random_state.seed(0)
    timestep, expert = env.reset(), experts.make(env.task)
    for step in range(1200):
        action = expert.act(np.concatenate([*timestep.observation.values()]))
        if 230 <= step < 300:  # The hand opens and moves back.
            action[:8] = 0.0, -0.05, 0.0, -0.05, 0.0, 0.0, 0.0, -1.0
        timestep = env.step(action)
        if step == 300:
            assert not env.task.state.is_success
            assert np.linalg.norm(env.task.state.handle_offset) > 0.1
    assert env.task.episode_metrics["success"]


@pytest.mark.full
def test_a_task_that_extends_the_microwaves_has_its_expert():
    class Ajar(MicrowaveTableTask):
        def reset_physics(self, physics, random_state):
            super().reset_physics(physics, random_state)
            physics.bind(self.scene.joints("microwave")).qpos = random_state.uniform(-0.2, 0.0)

    domain = suite.Domain(
        "ajar",
        scene=suite.DOMAINS["microwave_table"].scene,
        task=Ajar,
        tasks={"open": {}},
        env_id="Mine/Ajar-v1",
        episode_steps=500,
    )
    assert successes(domain.load(visuals=False), [206]) == 1


@pytest.mark.full
def test_its_episodes_are_recorded_replayed_and_evaluated(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    flags = ["--domain_name=microwave_table", "--policy=expert", "--num_episodes=2"]
    assert record.main([*flags, "--output=runs", "--num_threads=1"]) == 0
    assert replay.main(["runs"]) == 0
    assert evaluate.main([*flags, "--json=scores.json", "--num_threads=1"]) == 0
    assert json.loads((tmp_path / "scores.json").read_text())["success"] == 1.0


@pytest.mark.nightly
@pytest.mark.parametrize("variations", [None, "start,layout"])
@pytest.mark.parametrize("mode", CONTROL_MODES)
def test_a_hundred_seeds_in_every_mode(mode, variations):
    assert successes(load(mode, variations=variations), range(30_000, 30_100)) >= 97
