"""`kitchen-rollout` in open_cabinet: actions without bounds, metrics of its own, penalties that grow with time."""

import numpy as np
import pytest
from helpers.episodes import assert_same_arrays, load_episode

from kitchen_suite import policies, suite
from kitchen_suite.commands import rollout
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.tasks.open_cabinet import rewards as drawer_reward

DOMAIN = "--domain_name=open_cabinet"
SHORT = (DOMAIN, "--max_episode_steps=20")


def test_the_table_reports_the_metrics_of_the_task(capsys):
    assert rollout.main([*SHORT, "--task_name=bottom_drawer", "--policy=zero", "--num_episodes=2"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("open_cabinet bottom_drawer, policy zero, variations none\n")
    heading = next(line for line in out.splitlines() if line.startswith("episode"))
    assert heading.split() == [
        "episode",
        "seed",
        "return",
        "steps",
        "seconds",
        "success",
        "success",
        "at",
        "any",
        "time",
        "drawer",
        "opening",
    ]
    summary = dict(line.split("  ", 1) for line in out.split("\n\n")[-1].splitlines())
    assert summary["success rate"].strip() == "0% (0 of 2)"
    assert abs(float(summary["mean drawer opening"])) < 1e-3


def test_random_actions_are_standard_normal_where_there_are_no_bounds():
    environment = suite.load("open_cabinet", "top_drawer", {"visuals": False})
    act = policies.find("random")(environment, np.random.default_rng(0))
    draws = np.array([act(environment.reset()) for _ in range(500)])
    # 4,000 draws: mean and variance within five standard errors.
    assert abs(draws.mean()) < 5 / np.sqrt(draws.size)
    assert abs(draws.var() - 1) < 5 * np.sqrt(2 / draws.size)


# Random actions overturn the arm's posture, so that the episode terminates.
@pytest.mark.full
@pytest.mark.parametrize(("policy", "steps", "terminates"), [("zero", 20, False), ("random", 4, True)])
def test_an_episode_file_holds_what_suite_load_returns_when_replayed(tmp_path, policy, steps, terminates):
    assert rollout.main([*SHORT, f"--policy={policy}", "--num_episodes=1", "--seed=4", f"--output={tmp_path}"]) == 0
    metadata, arrays = load_episode(tmp_path / "episode_000000.npz")
    assert metadata["results"]["success"] is False
    assert (metadata["seed"], metadata["steps"]) == (4, steps)
    assert arrays["action"].shape == (steps, 8)
    assert arrays["action"].dtype == np.float64
    environment = suite.load("open_cabinet", "top_drawer", {"random": 4, "visuals": False, "time_limit": 0.2})
    timesteps = [environment.reset(), *(environment.step(action) for action in arrays["action"])]
    np.testing.assert_array_equal(arrays["reward"], [timestep.reward for timestep in timesteps[1:]])
    assert [timestep.last() for timestep in timesteps] == [False] * steps + [True]
    assert timesteps[-1].discount == 1.0 - terminates
    assert arrays["termination"].tolist() == [False] * (steps - 1) + [terminates]
    assert arrays["truncation"].tolist() == [False] * (steps - 1) + [not terminates]
    assert metadata["total_reward"] == arrays["reward"].sum()
    assert metadata["results"] == environment.task.episode_metrics
    single = EpisodeSpec.from_json(metadata["recording"]).make_environment().unwrapped
    rows = [single.observations.split(row) for row in arrays["observation"]]
    for row, timestep in zip(rows, timesteps, strict=True):
        assert_same_arrays(row, timestep.observation)


def test_rewards_do_not_depend_on_what_was_played_before(tmp_path, monkeypatch):
    # An environment that has made this many steps applies the greater penalties.
    monkeypatch.setattr(drawer_reward, "LATE_STAGE", 12)
    assert rollout.main([*SHORT, "--num_episodes=3", f"--output={tmp_path / 'many'}"]) == 0
    assert rollout.main([*SHORT, "--num_episodes=1", "--seed=2", f"--output={tmp_path / 'one'}"]) == 0
    _, after = load_episode(tmp_path / "many" / "episode_000002.npz")
    _, alone = load_episode(tmp_path / "one" / "episode_000000.npz")
    assert_same_arrays(after, alone)
    # The stage matters within an episode.
    monkeypatch.setattr(drawer_reward, "LATE_STAGE", 10**6)
    assert rollout.main([*SHORT, "--num_episodes=1", "--seed=2", f"--output={tmp_path / 'early'}"]) == 0
    _, early = load_episode(tmp_path / "early" / "episode_000000.npz")
    np.testing.assert_array_equal(early["action"], alone["action"])
    np.testing.assert_array_equal(early["reward"][:11], alone["reward"][:11])
    assert (early["reward"][12:] != alone["reward"][12:]).all()


def test_task_kwargs_are_those_of_the_gymnasium_environment(tmp_path):
    # suite.load has no action_limit.
    arguments = [*SHORT, "--num_episodes=1", '--task_kwargs={"action_limit": 0.5}', f"--output={tmp_path}"]
    assert rollout.main(arguments) == 0
    metadata, arrays = load_episode(tmp_path / "episode_000000.npz")
    assert metadata["recording"]["task_kwargs"] == {"action_limit": 0.5}
    assert np.abs(arrays["action"]).max() == 0.5


def test_arguments_that_the_task_fixes_are_refused(capsys):
    assert rollout.main([*SHORT, '--task_kwargs={"drawer": "bottom"}']) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert "task 'top_drawer' fixes ['drawer']" in err
