"""Training in environments that vary."""

from pathlib import Path

import pytest

from kitchen_suite.commands.commands import train
from kitchen_suite.settings import TrainSettings

pytestmark = pytest.mark.clients


@pytest.mark.parametrize(
    "flags", [["--variations=start,dynamics", "--variation_split=held_out"], []], ids=["on", "off"]
)
def test_training_is_in_environments_that_vary(flags, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    jobs = []
    monkeypatch.setattr("kitchen_suite.training.train_job.TrainJob.run", lambda job: jobs.append(job) or True)
    small = '--hyperparameters={"num_envs": 2, "hidden": [8], "rollouts": 4, "mini_batches": 1}'
    assert train.main(["--domain_name=open_cabinet", "--output=runs", "--eval_episodes=2", small, *flags]) == 0
    assert capsys.readouterr().err == ""
    (job,) = jobs
    # Without flags, those that are evaluated in do not vary, and of those that are trained in the drawers alone.
    _, info = job.evaluation_environments.reset(seed=0)
    assert ("variation_values" in info) == bool(flags)
    _, info = job.training.environments.reset(seed=0)
    assert ("cabinet/door_left" in info["variation_values"]) == bool(flags)
    if flags:
        for environments in (job.training.environments, job.evaluation_environments):
            _, info = environments.reset(seed=0)
            assert environments.get_attr("variation_split")[0] == "held_out"
            assert "cabinet/door_left" in info["variation_values"]
            assert "cabinet/yaw" not in info["variation_values"]


def test_settings_of_training_have_the_variations():
    settings = TrainSettings(output=Path("runs"), variations='{"cabinet/door_left": 0.1}', variation_split="seen")
    assert settings.environment_kwargs == {"variations": {"cabinet/door_left": 0.1}, "variation_split": "seen"}
