"""Quality in evaluations, recordings and commands: measures, clean success, the protocol `clean`."""

import dataclasses
import json

import gymnasium
import numpy as np
import pytest
from helpers.sweeps import brief

import kitchen_suite
from kitchen_suite import EnvironmentSpec, suite
from kitchen_suite.commands import evaluate as evaluate_command
from kitchen_suite.commands import record, replay, rollout
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.evaluation import quality, text
from kitchen_suite.evaluation.quality import CLEAN_SUCCESS, INFOS
from kitchen_suite.evaluation.scores import EpisodeResult, score_episodes
from kitchen_suite.policies import PolicyRef

SHORT = {"num_episodes": 2, "num_envs": 2, "num_threads": 1, "max_episode_steps": 4}
KITCHEN = EnvironmentSpec.make("kitchen", "random_4", {"quality": True, "variations": ["start"]}, 4)
MEASURES = set(quality.measured(KITCHEN))


def measures(success, **others):
    infos = {**{name: np.array(0.0) for name in MEASURES}, "is_success": np.array(True), **others}
    return quality.measures(KITCHEN, success, infos)


def test_clean_success_needs_success_nothing_disturbed_and_little_force_on_the_arm():
    assert measures(True)[CLEAN_SUCCESS]
    assert measures(True, peak_arm_contact_force=np.array(10.0))[CLEAN_SUCCESS]
    # The hand may press as hard as it likes.
    assert measures(True, peak_contact_force=np.array(1e6))[CLEAN_SUCCESS]
    assert not measures(False)[CLEAN_SUCCESS]
    assert not measures(True, objects_disturbed=np.array(1))[CLEAN_SUCCESS]
    above = np.array(np.nextafter(10.0, np.inf))
    assert not measures(True, peak_arm_contact_force=above)[CLEAN_SUCCESS]


def test_intervals_of_measures_end_at_zero_but_that_of_the_logarithm():
    results = [
        EpisodeResult(
            condition="all",
            episode=number,
            seed=number,
            success=True,
            progress=1.0,
            control_steps=9,
            measures=dict.fromkeys(INFOS, float(number)),
        )
        for number in range(2)
    ]
    intervals = score_episodes(results)["intervals"]
    # The quantile of Student's t for one degree of freedom is 12.706205.
    low = pytest.approx(0.5 - 12.706205 / 2, abs=1e-5)
    assert {name: intervals[name][0] for name in INFOS} == {
        "objects_disturbed": 0.0,
        "stray_contacts": 0.0,
        "peak_arm_contact_force": 0.0,
        "peak_contact_force": 0.0,
        "mean_contact_force": 0.0,
        "energy": 0.0,
        "path_length": 0.0,
        "log_dimensionless_jerk": low,
    }


@pytest.mark.full
@pytest.mark.parametrize("domain", brief(suite.DOMAINS, ["kitchen", "pick_and_place"], suite.DOMAINS))
def test_every_domain_is_scored_by_the_protocol_clean(domain):
    evaluation = kitchen_suite.evaluate("random", protocol="clean", domain_name=domain, **SHORT)
    names = set(quality.measured(evaluation.plan.first))
    assert evaluation.scores.keys() >= names >= MEASURES
    assert evaluation.scores["intervals"].keys() >= names
    assert evaluation.scores["energy"] > 0.0
    assert names - MEASURES == suite.DOMAINS[domain].measures.keys()


@pytest.mark.full
def test_quality_adds_measures_to_other_scores_and_replaces_nothing_of_the_protocol():
    plain = kitchen_suite.evaluate("random", **SHORT)
    measured = kitchen_suite.evaluate("random", quality=True, **SHORT)
    assert not plain.scores.keys() & MEASURES
    assert {name: value for name, value in measured.scores.items() if name in plain.scores and name != "intervals"} == {
        name: value for name, value in plain.scores.items() if name != "intervals"
    }
    assert measured.plan.replaced == plain.plan.replaced == ["num_episodes", "max_episode_steps"]
    for one in measured.results["random_4"]:
        assert one.measures.keys() == MEASURES
    without = kitchen_suite.evaluate("random", protocol="clean", task_kwargs={"quality": False}, **SHORT)
    assert "conditions" in without.plan.replaced


@pytest.mark.full
def test_measures_are_those_of_the_episode_that_its_seed_plays_alone():
    evaluation = kitchen_suite.evaluate("random", quality=True, seed=3, **SHORT)
    for episode in kitchen_suite.play(KITCHEN, "random", seeds=[3, 4]):
        assert episode.arrays["info/energy"].shape == (5,)
        assert episode.arrays["info/energy"][0] == 0.0
        assert (np.diff(episode.arrays["info/energy"]) > 0.0).all()
        own = evaluation.results["random_4"][episode.index].measures
        infos = MEASURES - {CLEAN_SUCCESS}
        assert {name: own[name] for name in infos} == {name: float(episode.last_info[name]) for name in infos}


@pytest.mark.full
def test_a_receipt_with_quality_is_checked(run, folder):
    flags = ["--policy=random", "--num_episodes=2", "--max_episode_steps=3", "--num_threads=1"]
    status, output, _ = run(evaluate_command, "--quality", *flags, "--receipt=r.npz", "--json=r.json")
    assert status == 0
    assert "clean success" in output
    assert json.loads((folder / "r.json").read_text("utf-8")).keys() >= MEASURES
    status, output, _ = run(replay, "r.npz", "--num_threads=1")
    assert status == 0
    assert "all numbers are equal" in output


@pytest.mark.full
@pytest.mark.parametrize("domain", brief(suite.DOMAINS, ["microwave_table"], suite.DOMAINS))
def test_recordings_keep_the_quality_and_replay(domain, run, folder):
    flags = [f"--domain_name={domain}", "--num_episodes=1", "--max_episode_steps=3", "--quality", "--num_threads=1"]
    assert run(record, "--output=episodes", *flags)[0] == 0
    arrays = Recording.open(folder / "episodes").load(0).arrays
    for name in MEASURES - {CLEAN_SUCCESS}:
        assert arrays[f"info/{name}"].shape == (4,)
    assert run(replay, "episodes")[0] == 0


def test_a_rollout_with_quality_writes_it(run, folder):
    flags = ["--domain_name=microwave_table", "--num_episodes=1", "--max_episode_steps=3", "--output=episodes"]
    assert run(rollout, "--quality", *flags)[0] == 0
    assert "info/energy" in Recording.open(folder / "episodes").load(0).arrays


def test_a_specification_without_quality_measures_nothing():
    spec = EnvironmentSpec.make("kitchen", "kettle", {}).episodes(PolicyRef.parse("zero"), seed=0)
    assert quality.measured(spec) == ()


def test_objects_that_are_dropped_and_collide_are_measured_where_there_are_objects():
    spec = EnvironmentSpec.make("pick_and_place", "put_on", {"quality": True}, 4)
    names = quality.measured(spec)
    assert set(names) == MEASURES | {"objects_dropped", "peak_carried_contact_force"}
    infos = {**{name: np.array(0.0) for name in names}, "objects_dropped": np.array(2)}
    assert quality.measures(spec, True, infos)["objects_dropped"] == 2.0


@pytest.mark.full
def test_a_registered_domain_has_measures_of_its_own():
    """Of a domain derived from another one, and one more: a mean in a unit, not a rate, cut off at its least value."""
    original = suite.DOMAINS["pick_and_place"]
    own = dataclasses.replace(
        original,
        name="tidy_up",
        env_id="Own/TidyUp-v1",
        env=None,
        vector_env=None,
        measures={**original.measures, "episode_step": 0.0},
    )
    suite.register(own)
    try:
        evaluation = kitchen_suite.evaluate("random", domain_name="tidy_up", quality=True, **SHORT)
        names = quality.measured(evaluation.plan.first)
    finally:
        del suite._domains[own.name]
        for env_id in {own.env_id, *own.task_ids.values()}:
            del gymnasium.registry[env_id]
    assert names[-3:] == ("objects_dropped", "peak_carried_contact_force", "episode_step")
    assert evaluation.scores["episode_step"] == 4.0
    assert evaluation.scores["objects_dropped"] == 0.0


def test_measures_are_no_rates_in_tables():
    assert text.value_text("peak_carried_contact_force", 12.5) == "12.5"
    assert text.value_text("clean_success", 0.125) == "12.5 %"
