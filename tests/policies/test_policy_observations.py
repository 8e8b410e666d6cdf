"""Policies get the observations that the `obs_type` shows, and the sentence of the task."""

import itertools
import json
import sys
import types
from pathlib import Path

import numpy as np
import pytest
from helpers.sweeps import OBSERVED, brief, once_per_observation_type

from kitchen_suite import suite
from kitchen_suite.commands import record, rollout

CAMERA = {"image_size": [8, 8], "render_quality": "fast"}


class Policy:
    """A user's policy, which keeps what it is given.

    Attributes:
      instruction: the task's sentence, which the commands assign.
    """

    def __init__(self, size):
        self.instruction, self.action = "", np.zeros(size)
        self.seen, self.sentences = [], []

    def __call__(self, timestep):
        self.seen.append(timestep.observation)
        self.sentences.append(self.instruction)
        return self.action


@pytest.fixture
def play(folder, run, monkeypatch):
    """Plays two short episodes by a policy of a user's own; returns the policy and the first recorded observations."""
    numbers = itertools.count()

    def play(command, domain, *, status=0, obs_type=None, policy=None, task_kwargs=None):
        size = 8 if domain in ("open_cabinet", "microwave_table") else 9
        act = Policy(size) if policy is None else policy
        monkeypatch.setitem(sys.modules, "module_of_a_user", types.SimpleNamespace(act=act))
        kwargs = {} if obs_type is None else {"obs_type": obs_type}
        if "pixels" in (obs_type or ""):
            kwargs |= CAMERA
        output = Path(f"runs{next(numbers)}")
        flags = [f"--domain_name={domain}", "--policy=module_of_a_user:act", f"--output={output}", "--num_episodes=2"]
        flags += ["--max_episode_steps=2", f"--task_kwargs={json.dumps({**kwargs, **(task_kwargs or {})})}"]
        found, _, error = run(command, *flags)
        assert found == status, error
        if status:
            return error
        with np.load(next(output.glob("*.npz"))) as arrays:
            recorded = {name: arrays[name][0] for name in arrays if name.startswith("observation")}
        return act, recorded

    return play


@pytest.mark.full
@pytest.mark.rendering
@pytest.mark.parametrize(("domain", "obs_type"), brief(OBSERVED, once_per_observation_type()))
@pytest.mark.parametrize("command", brief([record, rollout], [record]))
def test_a_policy_sees_what_the_observation_type_shows(play, command, domain, obs_type):
    act, recorded = play(command, domain, obs_type=obs_type)
    for seen in act.seen:
        assert sum(np.size(value) for value in seen.values()) == sum(value.size for value in recorded.values())
        assert {np.asarray(value).ndim for value in seen.values()} <= {1, 3}


@pytest.mark.full
@pytest.mark.parametrize("domain", suite.DOMAINS)
def test_by_default_a_policy_sees_the_suites_own_observation(play, domain):
    act, _ = play(record, domain)
    own = suite.load(domain, suite.default_task(domain), {"visuals": False}).reset().observation
    assert all([*seen] == [*own] for seen in act.seen)


@pytest.mark.full
@pytest.mark.rendering
def test_requests_are_shown_and_extra_observables_of_the_robot(play):
    extras = {"tasks_per_episode": 2, "extra_observables": ["franka/end_effector_pose"]}
    act, _ = play(record, "kitchen", obs_type="pixels_agent_pos", task_kwargs=extras)
    robot = ["franka/joint_positions", "franka/joint_velocities", "franka/end_effector_pose"]
    assert {*act.seen[0]} == {*robot, "requested_tasks", "workspace"}


@pytest.mark.full
@pytest.mark.rendering
def test_a_policy_that_needs_more_is_told_how(play):
    def act(timestep):
        return np.zeros(9) * timestep.observation["object_positions"].sum()

    error = play(rollout, "kitchen", obs_type="pixels_agent_pos", policy=act, status=2)
    assert "KeyError" in error
    # The remedies that the error names.
    assert "obs_type" in error
    assert "privileged = True" in error
    act.privileged = True
    play(rollout, "kitchen", obs_type="pixels_agent_pos", policy=act)
    del act.privileged
    play(rollout, "kitchen", obs_type="pixels_environment_state_agent_pos", policy=act)


@pytest.mark.full
@pytest.mark.rendering
def test_the_suites_own_policies_act_as_they_do_with_states(folder, run):
    for name, kwargs in (("numbers", {}), ("images", {"obs_type": "pixels_agent_pos", **CAMERA})):
        flags = [f"--output={name}", "--policy=trained", "--num_episodes=1", "--max_episode_steps=3"]
        assert run(record, *flags, "--task_name=kettle", f"--task_kwargs={json.dumps(kwargs)}")[0] == 0
    numbers, images = (np.load(next(Path(name).glob("*.npz")))["action"] for name in ("numbers", "images"))
    np.testing.assert_array_equal(numbers, images)


@pytest.mark.full
@pytest.mark.parametrize("domain", suite.DOMAINS)
@pytest.mark.parametrize("command", [record, rollout])
def test_a_policy_is_given_the_sentence_of_its_task(play, command, domain):
    # Generated kitchens ask for another part in each episode.
    act, _ = play(command, domain)
    recorded = [json.loads(str(np.load(path)["metadata"])) for path in sorted(Path("runs0").glob("*.npz"))]
    assert sorted(act.sentences) == sorted(each["instruction"] for each in recorded for _ in range(2))
    assert all(act.sentences)
