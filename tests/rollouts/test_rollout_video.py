"""Videos of `kitchen-rollout`, and the choice of the GL library that renders them."""

import contextlib
import os

import imageio.v2 as imageio
import imageio_ffmpeg
import numpy as np
import pytest
from episode_files import assert_same_arrays, load_episode

from kitchen_suite.cli import rollout
from kitchen_suite.rendering import gl, video


def read(path):
    with contextlib.closing(imageio.get_reader(path)) as reader:
        return reader.get_meta_data(), np.stack(list(reader.iter_data()))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def film(*arguments):
    size = ("--width=96", "--height=70")
    return rollout.main(["--video=film.mp4", "--max_episode_steps=3", *size, *arguments])


@pytest.mark.rendering
def test_a_video_shows_every_time_step_at_its_true_speed(folder):
    assert film("--num_episodes=2") == 0
    about, frames = read("film.mp4")
    assert about["fps"] == 12.5
    # Two episodes of three control steps, each with its start.
    assert frames.shape == (2 * (3 + 1), 70, 96, 3)
    assert (frames.std(axis=(1, 2, 3)) > 20).all()
    assert os.listdir(folder) == ["film.mp4"]


@pytest.mark.rendering
def test_more_frames_than_control_steps_make_one_frame_for_each_step(folder):
    assert film("--num_episodes=1", "--video_fps=1e9") == 0
    about, frames = read("film.mp4")
    assert about["fps"] == 12.5
    assert len(frames) == 4


@pytest.mark.slow
@pytest.mark.rendering
def test_the_camera_may_be_a_name_or_a_number(folder):
    views = []
    for camera in ("left", "3", "right"):
        assert film("--num_episodes=1", "--max_episode_steps=1", f"--camera={camera}") == 0
        views.append(read("film.mp4")[1])
    np.testing.assert_array_equal(views[0], views[1])
    assert np.abs(views[0].astype(float) - views[2]).mean() > 10


@pytest.mark.rendering
def test_a_video_that_is_not_finished_leaves_the_one_before(folder, capsys):
    folder.joinpath("film.mp4").write_bytes(b"before")
    folder.joinpath("stopping.py").write_text("def act(timestep):\n    raise KeyboardInterrupt\n")
    assert film("--policy=stopping:act") == 130
    assert capsys.readouterr().err == "kitchen-rollout: interrupted after 0 of 3 episodes\n"
    assert folder.joinpath("film.mp4").read_bytes() == b"before"
    assert not [name for name in os.listdir(folder) if name.startswith(".")]


@pytest.mark.rendering
def test_filming_changes_nothing(folder, capsys):
    assert film("--num_episodes=1", "--output=filmed", "--visualize_reward") == 0
    assert rollout.main(["--max_episode_steps=3", "--num_episodes=1", "--output=unseen"]) == 0
    (one, filmed), (other, unseen) = (load_episode(f"{name}/episode_000000.npz") for name in ("filmed", "unseen"))
    assert_same_arrays(filmed, unseen)
    assert one.pop("seconds") > 0 < other.pop("seconds")
    assert one == other


@pytest.mark.rendering
def test_a_size_beyond_the_model_is_refused(folder, capsys):
    assert rollout.main(["--video=film.mp4", "--width=4000"]) == 2
    assert capsys.readouterr() == (
        "",
        "kitchen-rollout: a video of 4000 x 480 pixels is too large: the model's offscreen buffer has 1920 x 1440\n",
    )


@pytest.mark.parametrize("count", [1, 3])
def test_an_incomplete_video_is_an_error_and_leaves_no_file(folder, monkeypatch, count):
    monkeypatch.setattr(imageio_ffmpeg, "count_frames_and_secs", lambda path: (count, 0.0))
    with pytest.raises(OSError, match=f"wrote {count} of 2 frames"):
        write_two_frames(folder / "film.mp4")
    assert os.listdir(folder) == []


def write_two_frames(path):
    with video.open_video(path, width=32, height=32, frames_per_second=10.0) as add:
        for _ in range(2):
            add(np.zeros((32, 32, 3), np.uint8))


def test_a_failing_ffmpeg_is_an_os_error(folder):
    with pytest.raises(OSError, match="ffmpeg"):
        write_two_frames(folder / "film.nothing")
    assert os.listdir(folder) == []


@pytest.mark.parametrize(("working", "chosen"), [({"egl", "osmesa"}, "egl"), ({"osmesa"}, "osmesa")])
def test_the_first_gl_library_that_works_is_chosen(monkeypatch, working, chosen):
    # Set first, so that the old value comes back whatever the code under test does.
    monkeypatch.setenv("MUJOCO_GL", "unset")
    monkeypatch.delenv("MUJOCO_GL")
    monkeypatch.setattr(gl, "_can_render", lambda library: library in working)
    gl.prepare(rendering=True)
    assert os.environ["MUJOCO_GL"] == chosen


def test_where_no_gl_library_works_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "unset")
    monkeypatch.delenv("MUJOCO_GL")
    monkeypatch.setattr(gl, "_can_render", lambda library: False)
    with pytest.raises(OSError, match=r"MUJOCO_GL=egl or osmesa: install a GL library .*libosmesa6"):
        gl.prepare(rendering=True)


def test_a_gl_library_that_the_user_named_is_the_only_one_tried(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    monkeypatch.setattr(gl, "_can_render", lambda library: library != "glfw")
    with pytest.raises(OSError, match="MUJOCO_GL=glfw:"):
        gl.prepare(rendering=True)
