"""Videos of `kitchen-rollout`, and the choice of the GL library that renders them."""

import contextlib
import os
import re
from pathlib import Path

import imageio.v2 as imageio
import imageio_ffmpeg
import numpy as np
import pytest
from helpers.episodes import assert_same_arrays, load_episode
from helpers.sweeps import brief

from kitchen_suite.commands import rollout
from kitchen_suite.episodes import video
from kitchen_suite.rendering import gl

pytestmark = pytest.mark.full


def read(path):
    with contextlib.closing(imageio.get_reader(path)) as reader:
        return reader.get_meta_data(), np.stack(list(reader.iter_data()))


def film(*arguments):
    size = ("--width=96", "--height=70")
    return rollout.main(["--video=film.mp4", "--max_episode_steps=3", *size, *arguments])


@pytest.mark.rendering
def test_a_video_shows_every_time_step_at_its_true_speed(folder):
    assert film("--num_episodes=3", "--video_episodes=2") == 0
    about, frames = read("film.mp4")
    assert about["fps"] == 12.5
    # Two episodes of three control steps, each with its start.
    assert frames.shape == (2 * (3 + 1), 70, 96, 3)
    assert (frames.std(axis=(1, 2, 3)) > 20).all()
    assert os.listdir(folder) == ["film.mp4"]


@pytest.mark.rendering
def test_more_frames_than_control_steps_make_one_frame_for_each_step(folder):
    assert film("--num_episodes=1", "--video_fps=1e4") == 0
    about, frames = read("film.mp4")
    assert about["fps"] == 12.5
    assert len(frames) == 4


@pytest.mark.nightly
@pytest.mark.rendering
def test_the_camera_may_be_a_name_or_a_number(folder):
    views = []
    for camera in ("left", "3", "right"):
        assert film("--num_episodes=1", "--max_episode_steps=1", f"--camera={camera}") == 0
        views.append(read("film.mp4")[1])
    np.testing.assert_array_equal(views[0], views[1])
    assert np.abs(views[0].astype(float) - views[2]).mean() > 10


STOPPING = """
steps = 0
def act(timestep):
    global steps
    steps += 1
    if steps == 2:
        raise {error}
    return 9 * [0.0]
"""


@pytest.mark.rendering
@pytest.mark.parametrize(
    ("error", "status"),
    brief([("KeyboardInterrupt", 130), ("ValueError('bad')", 2)], kept=[("KeyboardInterrupt", 130)]),
)
def test_an_interrupt_or_error_keeps_the_film_until_then(folder, capsys, error, status):
    # A module of its own for each case: a process imports a module once.
    folder.joinpath(f"stopping_{status}.py").write_text(STOPPING.format(error=error))
    assert film(f"--policy=stopping_{status}:act") == status
    out, err = capsys.readouterr()
    assert len(read("film.mp4")[1]) == 2
    assert out.splitlines()[-1] == "video film.mp4 ends early, after 2 frames"
    assert err.count("\n") == 1
    assert not [name for name in os.listdir(folder) if name.startswith(".")]


def test_an_error_before_the_first_frame_leaves_the_film_of_before(folder):
    folder.joinpath("film.mp4").write_bytes(b"before")
    with pytest.raises(KeyboardInterrupt), video.open_video(Path("film.mp4"), **TINY):
        raise KeyboardInterrupt
    assert folder.joinpath("film.mp4").read_bytes() == b"before"
    assert os.listdir(folder) == ["film.mp4"]


@pytest.mark.rendering
def test_by_default_one_episode_is_filmed_and_its_length_is_told_before(folder, capsys):
    assert film("--num_episodes=2", "--camera=3") == 0
    assert len(read("film.mp4")[1]) == 3 + 1
    _, _, announcement, *_ = capsys.readouterr().out.splitlines()
    assert re.fullmatch(r"filming 1 episode: at most 4 frames, about \d+ s", announcement)


def test_the_error_of_a_camera_number_lists_the_numbers(folder, capsys):
    assert film("--camera=99") == 2
    assert "camera 99 does not exist; choose from 0 (left_cap), 1 (right_cap), 2 (overview)" in capsys.readouterr().err


@pytest.mark.rendering
def test_filming_changes_nothing(folder, capsys):
    assert film("--num_episodes=1", "--output=filmed", "--visualize_reward") == 0
    assert rollout.main(["--max_episode_steps=3", "--num_episodes=1", "--output=unseen"]) == 0
    (one, filmed), (other, unseen) = (load_episode(f"{name}/episode_000000.npz") for name in ("filmed", "unseen"))
    assert_same_arrays(filmed, unseen)
    assert one.pop("seconds") > 0 < other.pop("seconds")
    assert one == other


def test_a_size_beyond_the_model_is_refused_at_once(folder, capsys):
    assert rollout.main(["--video=film.mp4", "--width=4000"]) == 2
    assert capsys.readouterr() == (
        "",
        "kitchen-rollout: flag --width=4000: 4000 is not an integer in the range [2, 1920]\n",
    )


@pytest.mark.parametrize("count", [1, 3])
def test_an_incomplete_video_is_an_error_and_leaves_no_file(folder, monkeypatch, count):
    monkeypatch.setattr(imageio_ffmpeg, "count_frames_and_secs", lambda path: (count, 0.0))
    with pytest.raises(OSError, match=f"wrote {count} of 2 frames"):
        write_two_frames(folder / "film.mp4")
    assert os.listdir(folder) == []


def test_a_relative_name_with_a_colon_is_a_file(folder):
    write_two_frames(Path("a:b.mp4"))
    assert len(read("a:b.mp4")[1]) == 2


TINY = {"width": 32, "height": 32, "frames_per_second": 10.0}


def write_two_frames(path):
    with video.open_video(path, **TINY) as add:
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
    monkeypatch.setattr(gl, "_library", None)
    monkeypatch.setattr(gl, "can_render", lambda library: library in working)
    gl.prepare(rendering=True)
    assert gl.choose() == chosen
    assert "MUJOCO_GL" not in os.environ


def test_where_no_gl_library_works_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "unset")
    monkeypatch.delenv("MUJOCO_GL")
    monkeypatch.setattr(gl, "can_render", lambda library: False)
    with pytest.raises(OSError, match=r"MUJOCO_GL=egl or osmesa: install a GL library .*libosmesa6"):
        gl.prepare(rendering=True)


def test_a_gl_library_that_the_user_named_is_the_only_one_tried(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    monkeypatch.setattr(gl, "can_render", lambda library: library != "glfw")
    with pytest.raises(OSError, match="MUJOCO_GL=glfw:"):
        gl.prepare(rendering=True)
