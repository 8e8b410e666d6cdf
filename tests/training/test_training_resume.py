"""Resuming of an interrupted training run, and its curves afterwards."""

import dataclasses
import itertools
import json
import os
import threading

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from helpers.training import BATCH, METADATA, SMALL, assert_same_state, environments, learner

from kitchen_suite.policies.perceptron import PerceptronPolicy
from kitchen_suite.tasks.open_cabinet import rewards as drawer_reward
from kitchen_suite.training.recipes import Schedule

pytestmark = pytest.mark.clients

# First of the seeds of evaluations during training.
FIRST_SEED = 500_000_000


@pytest.fixture
def description():
    from kitchen_suite.training.run import RunDescription

    return RunDescription(**METADATA, training_kwargs={}, hyperparameters={}, seed=0)


EVALUATION = {f"evaluation/{name}" for name in ("success", "progress", "length", "return")}
BATCHES = {f"step/reward/{name}" for name in drawer_reward.REWARDS["original"]} | {
    "step/reward",
    "loss/policy loss",
    "loss/value loss",
    "policy/standard deviation",
    "learning/learning rate",
    "time/steps_per_second",
    "time/update_milliseconds",
}


@pytest.fixture(scope="module")
def evaluation_environments():
    envs = environments(2, AutoresetMode.DISABLED)
    yield envs
    envs.close()


@pytest.fixture(scope="module")
def training_environments():
    envs = environments(SMALL["num_envs"])
    yield envs
    envs.close()


@pytest.fixture
def make_run(training_environments, evaluation_environments, tmp_path):
    """Returns a function that makes runs in one folder: each trains a new learner, and resumes the one before."""
    from kitchen_suite.training.run import SeedRun

    def make(batches, every=2, seed=0, episodes=2):
        schedule = Schedule(
            num_steps=batches * BATCH,
            eval_interval=every * BATCH,
            eval_episodes=episodes,
            target_success=2.0,
            patience=0,
            min_progress=0.0,
        )
        new = learner(training_environments, seed=seed, kl_target=0.01)
        run = SeedRun(tmp_path, seed, schedule, new, evaluation_environments, METADATA)
        return run, new

    return make


def trained(made):
    """Trains the learner of a run; returns both."""
    run, taught = made
    with run:
        if not run.stop_reason:
            taught.start(run.episode_seed)
        run.begin()
        while not run.stop_reason:
            run.record(taught.learn())
    return run, taught


def curves(folder):
    """Returns the curves as TensorBoard shows them: by name, values by step."""
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(folder), size_guidance={"scalars": 0}).Reload()
    return {name: {event.step: event.value for event in events.Scalars(name)} for name in events.Tags()["scalars"]}


def test_the_documented_curves_are_written(make_run, tmp_path):
    trained(make_run(4))
    found = curves(tmp_path / "seed_0")
    assert set(found) >= EVALUATION | BATCHES | {"time/minutes", "time/processor_minutes"}
    for name in EVALUATION | {"time/minutes", "time/processor_minutes"}:
        assert list(found[name]) == [0, 2 * BATCH, 4 * BATCH]
    for name in BATCHES:
        assert list(found[name]) == [batches * BATCH for batches in (1, 2, 3, 4)]
    assert all(np.isfinite(value) for curve in found.values() for value in curve.values())
    minutes = [*found["time/minutes"].values()]
    assert minutes == sorted(minutes)
    assert min(found["time/steps_per_second"].values()) > 0


@pytest.mark.parametrize(("successes", "num_played"), [([1, 0, 1, 0, 0], 5), ([0, 0, 1, 1, 1], 2)])
def test_where_few_of_the_first_episodes_succeed_the_others_are_not_played(
    make_run, monkeypatch, tmp_path, successes, num_played
):
    from kitchen_suite.training import run as training_run

    played = []

    def evaluate(controller, environments, seeds):
        played.extend(seeds)
        chosen = np.array([successes[seed - FIRST_SEED] for seed in seeds], float)
        return {f"episode/{name}": chosen for name in ("success", "progress", "length", "return")}

    monkeypatch.setattr(training_run, "evaluate", evaluate)
    # One evaluation, of the policy before the first step.
    trained(make_run(0, episodes=5))
    assert played == [*range(FIRST_SEED, FIRST_SEED + num_played)]
    assert curves(tmp_path / "seed_0")["evaluation/success"] == {0: pytest.approx(np.mean(successes[:num_played]))}


def test_episodes_that_end_in_training_have_curves(make_run, tmp_path):
    # Four environments, each at another of its 700 steps: two batches of 200 steps see two of them end.
    trained(make_run(25, every=100))
    found = curves(tmp_path / "seed_0")
    for name in ("success", "progress", "length"):
        assert 2 <= len(found[f"episode/{name}"]) <= 4
    assert set(found["episode/length"].values()) == {700.0}


def test_the_learner_is_restored(make_run):
    first, before = trained(make_run(4))
    state = before.state()
    again, after = make_run(4)
    assert again.resumed
    assert (again.steps, again.best) == (4 * BATCH, first.best)
    assert_same_state(after.state(), state)
    # The divergence has changed the learning rate, which does not return to its initial value.
    rate = after.agent.optimizer.param_groups[0]["lr"]
    assert rate == before.agent.optimizer.param_groups[0]["lr"] != 1e-3
    # The optimiser's moments are restored, too.
    assert any(part["exp_avg"].any() for part in after.agent.optimizer.state_dict()["state"].values())
    assert after.agent.observation_scaler.current_count > 4 * BATCH


def test_an_exported_policy_is_the_same_after_resuming(make_run):
    from kitchen_suite.training.ppo import export_policy

    _, before = trained(make_run(2))
    _, after = make_run(2)
    observations = np.random.default_rng(0).normal(size=(20, 25))
    one, other = (export_policy(each.agent, METADATA)(observations) for each in (before, after))
    np.testing.assert_array_equal(one, other)


def test_the_learning_rate_continues_from_its_last_value(make_run, tmp_path):
    trained(make_run(4))
    trained(make_run(5))
    rates = [*curves(tmp_path / "seed_0")["learning/learning rate"].values()]
    # Each of the two epochs changes it by a factor of 1.5 at most.
    assert all(1 / 2.3 < new / old < 2.3 for old, new in itertools.pairwise(rates))


def test_curves_continue_in_the_same_folder_with_every_step_once(make_run, tmp_path):
    trained(make_run(5))
    before = curves(tmp_path / "seed_0")
    # As if interrupted before the last evaluation: batch 5 is learned again.
    os.remove(tmp_path / "seed_0" / f"checkpoint_{5 * BATCH:012d}.pt")
    trained(make_run(6))
    after = curves(tmp_path / "seed_0")
    assert list(after["step/reward"]) == [batches * BATCH for batches in range(1, 7)]
    assert list(after["evaluation/return"]) == [batches * BATCH for batches in (0, 2, 4, 6)]
    for name in ("evaluation/return", "step/reward"):
        for step in [step for step in before[name] if step <= 4 * BATCH]:
            assert after[name][step] == before[name][step]
    minutes = [*after["time/minutes"].values()]
    assert minutes == sorted(minutes)


def test_the_best_policy_survives_an_interrupt(make_run, tmp_path, monkeypatch):
    from kitchen_suite.training import run as training_run

    returns = iter([1.0, 3.0, 2.0, 2.5])
    monkeypatch.setattr(
        training_run,
        "evaluate",
        lambda *arguments: {
            f"episode/{name}": np.array([value])
            for name, value in {"success": 0.0, "progress": 0.0, "return": next(returns)}.items()
        },
    )
    trained(make_run(4))
    again, _ = trained(make_run(6))
    assert again.best == (0.0, 3.0)
    assert PerceptronPolicy.load(tmp_path / "policy.npz").metadata["training"]["steps"] == 2 * BATCH


def test_every_kept_checkpoint_is_readable(make_run, tmp_path):
    from kitchen_suite.training.run import load_checkpoint

    trained(make_run(10))
    folder = tmp_path / "seed_0"
    paths = sorted(folder.glob("checkpoint_*"))
    assert [path.name for path in paths] == [f"checkpoint_{batches * BATCH:012d}.pt" for batches in (6, 8, 10)]
    for path in reversed(paths):
        assert load_checkpoint(folder)["steps"] == int(path.stem.removeprefix("checkpoint_"))
        path.unlink()
    assert load_checkpoint(folder) is None


def test_two_runs_started_together_in_one_folder_are_not_both_let_in(description, tmp_path):
    barrier, outcomes, refusals = threading.Barrier(2), [], []

    def start(seed, folder):
        barrier.wait()
        try:
            dataclasses.replace(description, seed=seed).create(folder)
            outcomes.append(seed)
        except FileExistsError as error:
            refusals.append(str(error))

    for i in range(100):
        folder, outcomes[:] = tmp_path / str(i), []
        threads = [threading.Thread(target=start, args=(seed, folder)) for seed in (1, 2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert len(outcomes) == 1
        assert f"{folder} holds a training run already" in refusals.pop()
        assert json.loads((folder / "training.json").read_text())["seed"] == outcomes[0]
        assert os.listdir(folder) == ["training.json"]


BAD_DESCRIPTIONS = {
    "not JSON": "{",
    "deep": "[" * 100_000,
    "no object": "[1]",
    "nothing": "{}",
    "a number as a name": json.dumps({**METADATA, "domain_name": 3}),
    "no dict": json.dumps({**METADATA, "hyperparameters": [1]}),
    "no text": "\udcff",
}


@pytest.mark.parametrize("text", BAD_DESCRIPTIONS.values(), ids=BAD_DESCRIPTIONS)
def test_a_description_that_cannot_be_read_is_named_in_one_line(description, tmp_path, text):
    description.create(tmp_path)
    (tmp_path / "training.json").write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises((OSError, ValueError), match=r"^[^\n]*training\.json[^\n]*$"):
        description.resume(tmp_path)
