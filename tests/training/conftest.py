"""A training as kitchen-train prepares it."""

import json

import pytest

from kitchen_suite.commands import train
from kitchen_suite.vector_env import SuiteVectorEnv

SMALL = {"num_envs": 2, "hidden": [8], "rollouts": 4, "mini_batches": 1}


@pytest.fixture
def prepared(capsys, monkeypatch, tmp_path):
    """Returns a function that prepares a training by flags; it returns learner and evaluations, or the error.

    Of the evaluations it returns the environments; the learner has its own, and the run is described in its folder.
    """
    # Test modules are collected where there is no PyTorch too.
    from kitchen_suite.training import ppo, run

    monkeypatch.chdir(tmp_path)
    found = []

    def keep(folder, description, schedule, environments, make_learner, **options):
        for seed_run in run.seed_runs(folder, description, schedule, environments, make_learner, **options):
            found.append((seed_run.learner, environments))
            return
            yield

    monkeypatch.setattr(ppo, "seed_runs", keep)
    # They are looked at after the command has ended.
    monkeypatch.setattr(SuiteVectorEnv, "close", lambda self: None)

    def prepared(*flags, status=0):
        small = f"--hyperparameters={json.dumps(SMALL)}"
        assert train.main(["--domain_name=open_cabinet", "--output=runs", "--eval_episodes=2", small, *flags]) == status
        error = capsys.readouterr().err
        assert (error == "") == (status == 0)
        return found[-1] if status == 0 else error

    return prepared
