"""The command line on the cabinet, whose actions have no bounds and whose results are its own."""

import json

import numpy as np

from kitchen_suite import policies, suite
from kitchen_suite.cli import rollout

SHORT = ("--domain_name=open_cabinet", "--time_limit=0.2")


def test_the_table_reports_what_the_cabinet_reports(capsys):
    assert rollout.main([*SHORT, "--task_name=bottom_drawer", "--policy=zero", "--num_episodes=2"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("open_cabinet bottom_drawer, policy zero\n")
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


def test_an_episode_is_written_and_plays_again(tmp_path):
    assert rollout.main([*SHORT, "--policy=zero", "--num_episodes=1", "--seed=4", f"--output={tmp_path}"]) == 0
    with np.load(tmp_path / "episode_000000.npz") as episode:
        arrays = dict(episode)
    metadata = json.loads(str(arrays.pop("metadata")))
    assert metadata["results"]["success"] is False
    assert arrays["action"].shape == (20, 8)
    environment = suite.load("open_cabinet", "top_drawer", {"random": 4, "visuals": False, "time_limit": 0.2})
    timesteps = [environment.reset(), *(environment.step(action) for action in arrays["action"])]
    for key in timesteps[0].observation:
        rows = [timestep.observation[key] for timestep in timesteps]
        np.testing.assert_array_equal(arrays[f"observation/{key}"], rows)
