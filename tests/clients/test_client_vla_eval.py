"""vla-eval itself: episodes by its configs, observations, errors, the model server.

Needs the distribution in docs/plugins/vla_eval_kitchen, in an environment such as .ci/run makes.
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from docs_blocks import ROOT
from helpers.errors import assert_is_short, refused

import kitchen_suite
from kitchen_suite import suite
from kitchen_suite.commands import record
from kitchen_suite.episodes.recording import Recording

pytestmark = pytest.mark.vla_eval

PLUGIN = ROOT / "docs" / "plugins" / "vla_eval_kitchen"
PICTURES = {"obs_type": "pixels_agent_pos", "image_size": [24, 32], "render_quality": "fast"}


@pytest.fixture
def evaluate(folder):
    """Plays episodes of a config against a server in this process; returns vla-eval's aggregate."""

    def evaluate(server, name="state", **overrides):
        from vla_eval import api

        (result,) = api.evaluate(server, PLUGIN / f"{name}.yaml", output_dir=folder, benchmark_overrides=overrides)
        return result

    return evaluate


@pytest.fixture
def benchmark():
    """Builds the benchmark in an episode of its first task."""
    from vla_eval.recording import NullEpisodeRecorder
    from vla_eval_kitchen import KitchenSuiteBenchmark

    made = []

    def benchmark(**params):
        made.append(KitchenSuiteBenchmark(**params))
        made[-1]._recorder = NullEpisodeRecorder()
        (task, *_) = made[-1].get_tasks()
        return made[-1], {**task, "episode_idx": 0}

    yield benchmark
    for each in made:
        each.cleanup()


def server(policy):
    from vla_eval_kitchen_server import SuitePolicyServer

    return SuitePolicyServer(policy)


def rows_of(folder, index):
    """The recorded steps of an episode of vla-eval's only task."""
    (path,) = folder.rglob(f"task0000_ep{index:04}_*.jsonl")
    return [json.loads(line) for line in path.read_text("utf-8").splitlines()]


@pytest.mark.parametrize(
    ("policy", "task"), [("trained", "kettle"), ("trained", "random_2"), ("random", "kettle"), ("expert", "random_2")]
)
def test_episodes_are_those_of_kitchen_record(evaluate, run, folder, policy, task):
    result = evaluate(server(policy), episodes_per_task=2, params={"tasks": [task], "seed": 7, "max_episode_steps": 60})
    assert result["num_errors"] == 0
    flags = [f"--policy={policy}", f"--task_name={task}", "--seed=7", "--num_episodes=2", "--max_episode_steps=60"]
    assert run(record, *flags, "--output=runs")[0] == 0
    recording = Recording.open(Path("runs"))
    (found,) = result["tasks"]
    for episode, index in zip(found["episodes"], recording.indices, strict=True):
        arrays = recording.load(index).arrays
        assert episode["steps"] == len(arrays["reward"])
        assert episode["metrics"]["success"] == recording.load_summary(index).metrics["success"]
        rows = rows_of(folder, episode["episode_id"])
        np.testing.assert_array_equal([row["action"] for row in rows], arrays["action"])
        np.testing.assert_array_equal([row["reward"] for row in rows], arrays["reward"])
        np.testing.assert_array_equal([row["state"] for row in rows], arrays["observation/observation"][1:, :18])


MEMORY = """
import numpy as np

class Chunks:
    def __init__(self):
        self.waiting = []

    def reset(self):
        self.waiting = []

    def __call__(self, timestep):
        if not self.waiting:
            seen = timestep.observation["franka/joint_positions"]
            self.waiting = [0.3 * np.sin(9.0 * seen + number) for number in range(8)]
        return self.waiting.pop(0)

chunks = Chunks()
"""


@pytest.mark.parametrize("name", ["Chunks", "chunks"])
def test_a_policy_forgets_its_chunk_where_an_episode_starts(evaluate, run, folder, write_policies, name):
    write_policies(MEMORY)
    policy = f"my_policies:{name}"
    evaluate(server(policy), episodes_per_task=3, params={"tasks": ["kettle"], "seed": 7, "max_episode_steps": 5})
    flags = [f"--policy={policy}", "--task_name=kettle", "--seed=7", "--num_episodes=3", "--max_episode_steps=5"]
    assert run(record, *flags, "--output=runs")[0] == 0
    for index, episode in enumerate(Recording.open(Path("runs"))):
        actions = [row["action"] for row in rows_of(folder, index)]
        np.testing.assert_array_equal(actions, episode.arrays["action"])


@pytest.mark.parametrize("domain", suite.DOMAINS)
def test_tasks_of_every_domain_are_played(evaluate, domain):
    tasks = [*suite.TASKS_BY_DOMAIN[domain]][:2]
    params = {"domain_name": domain, "tasks": tasks}
    result = evaluate(server("random"), episodes_per_task=1, max_steps=2, params=params)
    assert [each["task"] for each in result["tasks"]] == sorted(tasks)
    assert (result["num_errors"], result["mean_success"]) == (0, 0.0)
    assert {episode["steps"] for each in result["tasks"] for episode in each["episodes"]} == {2}


def test_a_protocol_has_the_episodes_of_kitchen_evaluate(evaluate, benchmark):
    params = {"domain_name": "kitchen", "protocol": "diffusion-policy", "max_episode_steps": 60}
    (found,) = evaluate(server("expert"), "unseen_kitchens", episodes_per_task=2, params=params)["tasks"]
    evaluation = kitchen_suite.evaluate("expert", protocol="diffusion-policy", num_episodes=2, max_episode_steps=60)
    expected = evaluation.results[found["task"]]
    assert [each["metrics"]["progress"] for each in found["episodes"]] == [each.progress for each in expected]
    made, _ = benchmark(domain_name="kitchens", protocol="unseen-kitchens")
    tasks = made.get_tasks()
    assert [each["name"] for each in tasks] == [f"kitchen {design}" for design in range(100)]
    assert {each["seed"] for each in tasks} == {400_000_000}
    arguments = json.loads(tasks[7]["environment"])["task_kwargs"]
    assert (arguments["design"], arguments["split"], arguments["certified"]) == (7, "test", True)


def test_all_tasks_are_the_default(benchmark):
    made, task = benchmark(domain_name="open_cabinet")
    assert [each["name"] for each in made.get_tasks()] == ["top_drawer", "bottom_drawer"]
    assert made.get_metadata() == {"max_steps": 700}
    assert (task["suite"], task["seed"]) == ("open_cabinet", 0)


def test_observations_have_the_keys_of_model_servers(benchmark):
    made, task = benchmark(tasks=["random_2"])
    observation = made.make_obs(made.reset(task), task)
    assert {key: np.shape(value) for key, value in observation.items()} == {
        "state": (18,),
        "environment_state": (41 + 7,),
        "task_description": (),
    }
    assert observation["task_description"] == made._inner.instruction
    assert {name: (each.dims, each.format) for name, each in made.get_observation_spec().items()} == {
        "state": (18, "raw"),
        "environment_state": (48, "raw"),
        "language": (0, "language"),
    }
    (action,) = made.get_action_spec().values()
    assert (action.dims, action.format) == (9, "joint_velocity")


@pytest.mark.rendering
@pytest.mark.parametrize(
    ("config", "task", "beginning", "size"),
    [("pixels", "microwave", "open the microwave door", 9), ("unseen_pick_and_place", "kitchen 0", "put the", 7)],
)
def test_pictures_are_by_camera_in_the_order_of_the_config(evaluate, config, task, beginning, size):
    from vla_eval.model_servers.predict import PredictModelServer

    class Witness(PredictModelServer):
        def predict(self, obs, ctx):
            self.seen = obs
            return {"actions": np.zeros(size)}

    witness = Witness()
    result = evaluate(witness, config, episodes_per_task=1, max_tasks=1, max_steps=2)
    assert (result["num_errors"], result["tasks"][0]["task"]) == (0, task)
    assert witness.seen["task_description"].startswith(beginning)
    assert {*witness.seen} == {"images", "state", "task_description"}
    assert [*witness.seen["images"]] == ["workspace", "franka_hand"]
    for picture in witness.seen["images"].values():
        assert (picture.shape, picture.dtype) == ((128, 128, 3), np.uint8)
        assert picture.std() > 10


@pytest.mark.rendering
def test_servers_of_the_suite_act_beside_pictures(evaluate, folder):
    overrides = {"episodes_per_task": 1, "recording": {"record_video": True}}
    result = evaluate(server("trained"), params={"tasks": ["kettle"], "task_kwargs": PICTURES}, **overrides)
    assert (result["num_errors"], result["mean_success"], result["mean_progress"]) == (0, 1.0, 1.0)
    (film,) = folder.rglob("*.mp4")
    assert film.stat().st_size > 1000


BAD_PARAMS = {
    "domain": ({"domain_name": "kitchn"}, "'kitchen'"),
    "task": ({"tasks": ["kettl"]}, "'kettle'"),
    "task of another domain": ({"tasks": ["top_drawer"]}, "'open_cabinet'"),
    "no tasks": ({"tasks": []}, "tasks is empty"),
    "one task": ({"tasks": "kettle"}, "tasks must be a sequence"),
    "seed": ({"seed": -1}, "seed must be at least 0"),
    "argument": ({"task_kwargs": {"contrl_mode": "ee_pose"}}, "'contrl_mode'"),
    "value": ({"task_kwargs": {"control_mode": "ee_pos"}}, "'ee_pos' does not exist"),
    "observations": ({"task_kwargs": {"obs_type": "state"}}, "environment_state_agent_pos"),
    "protocol": ({"protocol": "d4rll"}, "'d4rl'"),
    "protocol and seed": ({"protocol": "d4rl", "seed": 1}, "seed of its own"),
    "protocol with goals": ({"protocol": "beso"}, "goals from a recording"),
    "protocol with scores": ({"protocol": "clean"}, "vla-eval does not report"),
    "value of the protocol": ({"protocol": "d4rl", "task_kwargs": {"robot_noise_ratio": -1}}, "robot_noise_ratio"),
}


@pytest.mark.parametrize(("params", "shown"), BAD_PARAMS.values(), ids=BAD_PARAMS)
def test_bad_params_are_refused_in_one_line(params, shown):
    from vla_eval_kitchen import KitchenSuiteBenchmark

    with refused((TypeError, ValueError), shown) as raised:
        KitchenSuiteBenchmark(**params)
    assert_is_short(str(raised.value))


BAD_ACTIONS = {
    "shape": ({"actions": np.zeros(7)}, "(7,)"),
    "a chunk": ({"actions": np.zeros((5, 9))}, "(5, 9)"),
    "NaN": ({"actions": np.full(9, np.nan)}, "actions must be finite"),
    "none": ({"action": np.zeros(9)}, "no 'actions'"),
}


@pytest.mark.parametrize(("action", "shown"), BAD_ACTIONS.values(), ids=BAD_ACTIONS)
def test_bad_actions_are_refused_in_one_line(benchmark, action, shown):
    made, task = benchmark(tasks=["kettle"])
    made.reset(task)
    with refused(ValueError, shown) as raised:
        made.step(action)
    assert_is_short(str(raised.value))


def test_the_server_names_what_is_wrong_in_one_line():
    command = [sys.executable, "-m", "vla_eval_kitchen_server", "--args.policy=traind"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("vla_eval_kitchen_server: policy 'traind' does not exist (did you mean 'trained'?)")
    assert done.stderr.count("\n") == 1
