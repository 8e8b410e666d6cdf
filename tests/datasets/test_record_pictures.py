"""Recordings that hold the pictures of several cameras: written, replayed, read back from Minari datasets."""

import json
import os
from pathlib import Path

import h5py
import minari
import numpy as np
import pytest
from helpers.episodes import load_episode

from kitchen_suite.commands import convert, record, replay, rollout
from kitchen_suite.episodes.episode import flatten

pytestmark = [pytest.mark.rendering, pytest.mark.full, pytest.mark.usefixtures("folder")]

PIXELS = {
    "obs_type": "pixels_agent_pos",
    "cameras": ["overview", "franka/hand"],
    "image_size": [40, 48],
    "render_quality": "fast",
}
SHORT = ["--num_episodes=2", "--max_episode_steps=4", "--task_name=kettle"]
ID = "kitchen-suite/pictures-v0"


def record_pictures(*arguments, **options):
    kwargs = f"--task_kwargs={json.dumps({**PIXELS, **options})}"
    return record.main(["--output=runs", "--num_envs=2", "--num_threads=1", *SHORT, kwargs, *arguments])


def test_minari_reads_back_the_pictures_of_all_cameras():
    assert record_pictures(depth=True, extra_observables=["franka/gripper_width"]) == 0
    assert convert.main(["runs", f"--dataset={ID}"]) == 0
    dataset = minari.load_dataset(ID)
    environment = dataset.recover_environment()
    assert environment.observation_space == dataset.observation_space
    for index, episode in enumerate(dataset.iterate_episodes()):
        _, arrays = load_episode(f"runs/episode_{index:06d}.npz")
        assert arrays["observation/pixels/franka_hand"].shape == (5, 40, 48, 3)
        assert arrays["observation/pixels/overview"].dtype == np.uint8
        assert arrays["observation/depth/overview"].shape == (5, 40, 48, 1)
        assert arrays["observation/agent_pos"].shape == (5, 19)
        read = flatten(episode.observations, "observation")
        assert read.keys() == {name for name in arrays if name.startswith("observation")}
        for name, array in read.items():
            np.testing.assert_array_equal(array, arrays[name])
        observation, _ = environment.reset(seed=index)
        for step, action in enumerate(episode.actions, start=1):
            observation, *_ = environment.step(action)
            np.testing.assert_array_equal(observation["pixels"]["overview"], read["observation/pixels/overview"][step])
    with h5py.File(f"datasets/{ID}/data/main_data.hdf5") as file:
        pictures = file["episode_0/observations/pixels/overview"]
        assert pictures.id.get_storage_size() < 0.6 * pictures.nbytes
    environment.close()


WITH_STATE = {"obs_type": "pixels_environment_state_agent_pos", "extra_observables": ["kettle/pose"]}


@pytest.mark.parametrize("options", [{}, WITH_STATE], ids=["pictures", "pictures and state"])
def test_pictures_are_replayed_to_the_bit(capsys, options):
    assert record_pictures(**options) == 0
    capsys.readouterr()
    assert replay.main(["runs"]) == 0
    assert "2 of 2 episodes are equal" in capsys.readouterr().out


def test_the_render_quality_is_recorded_where_none_is_named():
    pixels = {"obs_type": "pixels", "image_size": [8, 8]}
    command = ["--output=runs", "--max_episode_steps=1", "--num_episodes=1", "--num_envs=1"]
    assert record.main([*command, f"--task_kwargs={json.dumps(pixels)}"]) == 0
    assert json.loads(Path("runs/recording.json").read_text())["task_kwargs"]["render_quality"] == "high"


def test_a_changed_picture_is_found(capsys):
    assert record_pictures() == 0
    file = "runs/episode_000001.npz"
    with np.load(file) as arrays:
        changed = dict(arrays)
    changed["observation/pixels/overview"][2, 0, 0, 0] ^= 255
    np.savez_compressed(file, **changed)
    capsys.readouterr()
    assert replay.main(["runs", "--episodes=1"]) == 3
    assert "0 of 1 episodes are equal" in capsys.readouterr().out


def test_the_expert_acts_on_the_state_whatever_is_recorded():
    assert record_pictures("--policy=expert") == 0
    _, seen = load_episode("runs/episode_000000.npz")
    assert record.main(["--output=states", "--policy=expert", *SHORT]) == 0
    _, blind = load_episode("states/episode_000000.npz")
    np.testing.assert_array_equal(seen["action"], blind["action"])
    np.testing.assert_array_equal(seen["observation/agent_pos"], blind["observation/observation"][:, :18])


def test_a_rollout_shows_pictures_to_a_policy_and_keeps_them(tmp_path):
    code = """
import numpy as np

def act(timestep):
    assert timestep.observation["overview"].shape == (40, 48, 3)
    assert "object_positions" not in timestep.observation
    return np.full(9, timestep.observation["overview"].mean() / 255)
"""
    (tmp_path / "my_pictures_policy.py").write_text(code)
    kwargs = f"--task_kwargs={json.dumps(PIXELS)}"
    assert rollout.main([*SHORT, "--policy=my_pictures_policy:act", kwargs, "--output=episodes"]) == 0
    _, arrays = load_episode("episodes/episode_000000.npz")
    expected = [picture.mean() / 255 for picture in arrays["observation/pixels/overview"][:-1]]
    np.testing.assert_array_equal(arrays["action"][:, 0], expected)


def test_episodes_that_could_not_be_read_again_are_refused(capsys):
    assert record_pictures("--max_episode_steps=280", image_size=[960, 1280]) == 2
    error = capsys.readouterr().err
    assert "more than the 512 MiB of an episode's file: choose a smaller image_size" in error
    assert not os.path.exists("runs")


def test_bad_pictures_are_one_line(capsys):
    assert record_pictures(cameras=["overvew"]) == 2
    error = capsys.readouterr().err
    assert "camera 'overvew' does not exist (did you mean 'overview'?)" in error
    assert error.count("\n") == 1
