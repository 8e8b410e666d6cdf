"""LeRobot itself: types of environments, and datasets written and read. Needs the extra `lerobot`."""

import contextlib
import json
import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.episodes import load_episode
from helpers.errors import refused

from kitchen_suite.commands import convert, record
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.lerobot.observations import LeRobotObservations
from kitchen_suite.suite import DOMAINS

pytestmark = [pytest.mark.lerobot, pytest.mark.usefixtures("folder")]

ROOT = Path("data/me/kettle")
RECORD = ["--num_threads=1", "--output=runs", "--num_envs=2", "--seed=5", "--max_episode_steps=5", "--num_episodes=3"]
DATASET = ["runs", "--format=lerobot", "--dataset=me/kettle", "--data_path=data"]
STATES = "--obs_type=environment_state_agent_pos"
PICTURES = '"obs_type": "pixels_agent_pos", "image_size": [32, 40], "render_quality": "fast"'


@pytest.fixture
def kettle(run):
    """A dataset of three kettles; returns `run`."""
    assert run(record, *RECORD, STATES, "--task_name=kettle")[0] == 0
    status, out, err = run(convert, *DATASET)
    assert (status, err) == (0, "")
    assert out == f"dataset me/kettle of runs in {os.getcwd()}/{ROOT}\n"
    return run


def load(root=ROOT):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    return LeRobotDataset("me/kettle", root=root, video_backend="pyav")


def config(domain, **settings):
    from lerobot.envs.configs import EnvConfig

    import kitchen_suite.lerobot.configs  # noqa: F401

    return EnvConfig.get_choice_class(domain)(**settings)


@pytest.mark.parametrize("domain", [*DOMAINS])
def test_every_domain_is_a_type_of_environment(domain):
    from lerobot.envs import make_env
    from lerobot.envs.utils import env_to_policy_features, preprocess_observation

    cfg = config(domain, max_episode_steps=4, render_mode=None)
    assert pickle.loads(pickle.dumps(cfg)) == cfg
    ((name, tasks),) = make_env(cfg, n_envs=2).items()
    assert (name, [*tasks]) == (domain, [0])
    environments = tasks[0]
    assert cfg.fps == environments.metadata["render_fps"]
    observation = preprocess_observation(environments.reset(seed=[1, 2], options={"lerobot_new_rollout": True})[0])
    features = env_to_policy_features(cfg)
    assert features.pop("action").shape == environments.single_action_space.shape
    assert {key: (2, *feature.shape) for key, feature in features.items()} == {
        key: tuple(tensor.shape) for key, tensor in observation.items()
    }
    environments.close()


def test_flags_reach_the_environment():
    cfg = config(
        "kitchen",
        task="kettle,microwave",
        control_mode="ee_delta_pose",
        variations="start",
        variation_split="held_out",
        extra_observables=["kettle/pose"],
        task_kwargs={"linear_speed": 0.2},
        max_episode_steps=7,
        render_mode=None,
    )
    environments = cfg.create_envs(1)["kitchen"]
    assert [each.call("task")[0] for each in environments.values()] == [
        "move the kettle to the top left burner",
        "open the microwave door",
    ]
    assert environments[0].call("_max_episode_steps") == (7,)
    assert environments[0].call("variation_split") == ("held_out",)
    assert cfg.features["environment_state"].shape == (41 + 7,)
    assert cfg.features["action"].shape == (7,)


@pytest.mark.parametrize(
    ("settings", "shown"),
    [
        ({"task": "ketle"}, ["'kettle'"]),
        ({"task": "kettle,random_2"}, ["random_2"]),
        ({"obs_type": "state"}, ["obs_type", "'environment_state_agent_pos'"]),
        ({"task_kwargs": {"obs_type": "state"}}, ["obs_type", "task_kwargs"]),
        ({"cameras": ["overview"]}, ["obs_type"]),
    ],
)
def test_bad_settings_are_refused(settings, shown):
    with refused(ValueError, *shown):
        config("kitchen", **settings)


def test_the_function_of_an_env_hub():
    from kitchen_suite.lerobot import make_env

    ((name, tasks),) = make_env(n_envs=1, use_async_envs=True, cfg=None).items()
    assert (name, len(tasks)) == ("kitchen", 1)
    tasks[0].close()
    ((name, tasks),) = make_env(1, False, config("open_cabinet", task="top_drawer")).items()
    assert name == "open_cabinet"
    tasks[0].close()


@pytest.fixture
def act(tmp_path):
    """The folder of an action-chunking transformer with random weights, which plays three of its four actions."""
    import torch
    from lerobot.configs.types import FeatureType, PolicyFeature
    from lerobot.policies.act.configuration_act import ACTConfig
    from lerobot.policies.act.modeling_act import ACTPolicy
    from lerobot.policies.factory import make_pre_post_processors

    inputs = {"observation.state": (FeatureType.STATE, 18), "observation.environment_state": (FeatureType.ENV, 41)}
    settings = ACTConfig(
        input_features={name: PolicyFeature(kind, (size,)) for name, (kind, size) in inputs.items()},
        output_features={"action": PolicyFeature(FeatureType.ACTION, (9,))},
        chunk_size=4,
        n_action_steps=3,
        dim_model=16,
        n_heads=2,
        dim_feedforward=16,
        n_encoder_layers=1,
        use_vae=False,
        device="cpu",
    )
    torch.manual_seed(0)
    sizes = {**{name: size for name, (_, size) in inputs.items()}, "action": 9}
    statistics = {name: {"mean": torch.zeros(size), "std": torch.full((size,), 0.1)} for name, size in sizes.items()}
    folder = tmp_path / "act"
    policy = ACTPolicy(settings)
    policy.save_pretrained(folder)
    for processor in make_pre_post_processors(settings, dataset_stats=statistics):
        processor.save_pretrained(folder)
    return folder


@pytest.mark.parametrize("num_envs", [1, 2, 5])
def test_a_policy_of_lerobot_acts_in_the_suites_episodes_as_in_lerobots(act, num_envs):
    import torch
    from lerobot.envs.utils import preprocess_observation
    from lerobot.policies.act.modeling_act import ACTPolicy
    from lerobot.policies.factory import make_pre_post_processors

    import kitchen_suite
    from kitchen_suite.lerobot.policies import LeRobotPolicy

    spec = kitchen_suite.EnvironmentSpec.make("kitchen", "kettle", {"obs_type": "environment_state_agent_pos"}, 5)
    played = kitchen_suite.play(spec, LeRobotPolicy(act), range(5), takes="observation", num_envs=num_envs)
    found = {episode.seed: episode.arrays["action"] for episode in played}
    policy = ACTPolicy.from_pretrained(act)
    before, after = make_pre_post_processors(policy.config, pretrained_path=str(act))
    environments = config("kitchen", task="kettle", max_episode_steps=5, render_mode=None).create_envs(1)["kitchen"][0]
    for seed in range(5):
        policy.reset()
        observation, _ = environments.reset(seed=[seed])
        for action in found[seed]:
            with torch.no_grad():
                chosen = after(policy.select_action(before(preprocess_observation(observation)))).numpy()
            np.testing.assert_array_equal(action, chosen[0])
            observation, *_ = environments.step(chosen)
    environments.close()
    assert not np.array_equal(found[0], found[1])


def test_copies_of_a_policy_of_lerobot_share_weights_and_no_queue(act):
    import copy

    from kitchen_suite.lerobot.policies import LeRobotPolicy

    policy = LeRobotPolicy(act)
    other = copy.deepcopy(policy)
    observation = {"agent_pos": np.zeros(18), "environment_state": np.zeros(41)}
    moved = {"agent_pos": np.ones(18), "environment_state": np.ones(41)}
    first = policy(observation)
    np.testing.assert_array_equal(other(observation), first)
    # The rest of the chunk, whatever is observed; and after a reset the first action of a new one.
    np.testing.assert_array_equal(policy(moved), other(observation))
    policy.reset()
    assert not np.array_equal(policy(moved), first)
    own, others = ([*each._policy.parameters()] for each in (policy, other))
    assert all(one is another for one, another in zip(own, others, strict=True))


def test_lerobot_reads_what_was_recorded(kettle):
    dataset = load()
    assert (dataset.fps, dataset.num_episodes, dataset.meta.robot_type) == (12, 3, "franka")
    assert dataset.features["observation.state"]["names"][0] == "franka/joint_positions[0]"
    for index in range(3):
        _, arrays = load_episode(f"runs/episode_{index:06d}.npz")
        rows = [dataset[i] for i in range(index * 5, index * 5 + 5)]
        assert {row["task"] for row in rows} == {"move the kettle to the top left burner"}
        for column, name in {
            "observation.state": "observation/agent_pos",
            "observation.environment_state": "observation/environment_state",
            "action": "action",
        }.items():
            expected = arrays[name][:5].astype(np.float32)
            np.testing.assert_array_equal([row[column].numpy() for row in rows], expected, column)
        assert [bool(row["next.done"]) for row in rows] == [False] * 4 + [True]


CASES = {
    "states": ["--task_name=kettle"],
    "tasks drawn": ["--task_name=random_2"],
    "variations": ["--task_name=kettle", "--variations=start,dynamics,sensing", "--control_mode=joint_delta"],
    "dense reward of another domain": ["--domain_name=open_cabinet"],
    "pictures of one camera": ["--domain_name=microwave_table", f"--task_kwargs={{{PICTURES}}}"],
    "pictures of two cameras": [
        "--domain_name=microwave_table",
        f'--task_kwargs={{{PICTURES}, "cameras": ["overview", "franka/hand"]}}',
    ],
}


@pytest.mark.parametrize(
    "arguments",
    [pytest.param(case, marks=pytest.mark.rendering if "pic" in name else (), id=name) for name, case in CASES.items()],
)
def test_a_dataset_holds_the_columns_of_every_episode(run, arguments):
    obs_type = [] if any("obs_type" in argument for argument in arguments) else [STATES]
    assert run(record, *RECORD, *obs_type, *arguments)[0] == 0
    status, _, err = run(convert, *DATASET)
    assert (status, err) == (0, "")
    dataset, recording = load(), Recording.open(Path("runs"))
    rows = dataset.hf_dataset.with_format("numpy")
    with contextlib.closing(recording.spec.make_environment()) as environment:
        observations = LeRobotObservations(suite_env(environment))
        for index in recording.indices:
            bounds = dataset.meta.episodes[index]
            found = rows[bounds["dataset_from_index"] : bounds["dataset_to_index"]]
            for name, expected in observations.columns(recording.load(index)).items():
                np.testing.assert_array_equal(np.asarray(found[name]).reshape(expected.shape), expected, name)
    about = json.loads((ROOT / "meta/kitchen_suite.json").read_text())
    assert about["recording"] == recording.spec.as_json()
    assert [episode["seed"] for episode in about["episodes"]] == [5, 6, 7]


def test_a_dataset_that_is_there_is_never_touched(kettle):
    before = {path: path.stat().st_mtime_ns for path in ROOT.rglob("*")}
    for dataset, message in {
        "me/kettle": "exists already, and is never replaced",
        "kettle": "'kettle' is no name of a dataset, such as me/kettle",
        "me/../kettle": "is no name of a dataset",
    }.items():
        status, out, err = kettle(convert, *DATASET, f"--dataset={dataset}")
        assert (status, out, err.count("\n")) == (2, "", 1)
        assert message in err
    assert {path: path.stat().st_mtime_ns for path in ROOT.rglob("*")} == before


def test_an_interrupt_leaves_no_dataset_and_the_same_command_makes_it(run, monkeypatch):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    def interrupt(self):
        raise KeyboardInterrupt

    assert run(record, *RECORD, STATES, "--task_name=kettle")[0] == 0
    with monkeypatch.context() as patch:
        patch.setattr(LeRobotDataset, "save_episode", interrupt)
        assert run(convert, *DATASET)[0] == 130
    assert not os.path.exists("data")
    assert run(convert, *DATASET)[0] == 0
    assert load().num_episodes == 3


def test_lerobots_own_commands_find_the_package():
    """In a new interpreter, by the path that the flag `--env.discover_packages_path` names."""
    code = (
        "from lerobot.configs.parser import load_plugin\n"
        "from lerobot.envs import EnvConfig\n"
        "load_plugin('kitchen_suite.lerobot')\n"
        "print(*EnvConfig.get_known_choices())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert DOMAINS.keys() <= {*done.stdout.split()}, done.stderr


def test_the_distribution_for_lerobot_registers_every_domain_by_its_name_alone():
    code = (
        "from lerobot.envs import EnvConfig\n"
        "from lerobot.utils.import_utils import register_third_party_plugins\n"
        "register_third_party_plugins()\n"
        "print(*EnvConfig.get_known_choices())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert DOMAINS.keys() <= {*done.stdout.split()}, done.stderr
