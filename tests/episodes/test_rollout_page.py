"""Web pages that the commands write."""

import importlib.util
import os
import sys

import numpy as np
import pytest
from helpers import pages
from helpers.episodes import assert_same_arrays, load_episode

from kitchen_suite import installation
from kitchen_suite.commands import evaluate, play, record, replay, rollout

TIMESTEP = 0.08  # Of the kitchen [s]
SHORT = ("--max_episode_steps=3",)


@pytest.mark.ray
def test_workers_make_no_page(folder, refusal):
    assert "web page" in refusal(rollout, "--web=page.html", "--workers=2")


@pytest.mark.parametrize("name", ["page.txt", "nowhere/page.html", "page"])
def test_a_page_that_cannot_be_written_is_refused(folder, refusal, name):
    assert f"--web={name}" in refusal(rollout, f"--web={name}")


def test_a_page_without_the_extra_names_what_to_install(folder, refusal, monkeypatch):
    find_spec = importlib.util.find_spec
    monkeypatch.setattr(
        "importlib.util.find_spec", lambda name, *rest: None if name == "viser" else find_spec(name, *rest)
    )
    for name in ("episode_page", "scene", "servers"):
        monkeypatch.delitem(sys.modules, f"kitchen_suite.viewer.{name}", raising=False)
    assert installation.install_command("web") in refusal(rollout, "--web=page.html")


@pytest.mark.web
def test_a_page_shows_every_control_step_of_the_first_episodes(folder, capsys):
    arguments = ["--num_episodes=3", "--web_episodes=2", "--task_name=kettle", *SHORT]
    assert rollout.main([*arguments, "--web=page.html"]) == 0
    assert "\nweb page page.html, 1." in capsys.readouterr().out
    page = pages.read_page(folder / "page.html")
    assert [episode["name"] for episode in page["episodes"]] == ["episode 0, seed 0", "episode 1, seed 1"]
    for episode in page["episodes"]:
        (part,) = episode["parts"]
        assert len(part["rewards"]) == len(part["returns"]) == len(part["metrics"]["success"]) == 4
        assert (part["label"], part["tasks"]) == ("", [["kettle", None]])
        assert episode["instruction"] == "move the kettle to the top left burner"
        head, _ = pages.contents(pages.joined(page, episode))
        times = sorted({round(time, 6) for time, _ in head["messages"]})
        np.testing.assert_allclose(times, TIMESTEP * np.arange(4))
        assert head["durationSeconds"] == pytest.approx(3 * TIMESTEP + 1.0)
    assert os.listdir(folder) == ["page.html"]


@pytest.mark.web
def test_a_page_changes_no_number(folder):
    for name, further in (("without", ()), ("with", ("--web=page.html",))):
        assert rollout.main(["--num_episodes=1", f"--output={name}", *SHORT, *further]) == 0
    first, second = (load_episode(next((folder / name).glob("episode_*.npz")))[1] for name in ("without", "with"))
    assert_same_arrays(first, second)


@pytest.mark.web
def test_the_camera_is_set_from_the_start(folder):
    assert rollout.main(["--num_episodes=1", "--web=page.html", *SHORT]) == 0
    page = pages.read_page(folder / "page.html")
    head, _ = pages.contents(pages.joined(page, page["episodes"][0]))
    camera = {message["type"]: message for time, message in head["messages"] if "SetCamera" in message["type"]}
    position, look_at = camera["SetCameraPositionMessage"]["position"], camera["SetCameraLookAtMessage"]["look_at"]
    assert position != look_at
    assert all(message["initial"] for message in camera.values())


@pytest.mark.web
def test_tasks_are_shown_with_the_control_step_of_their_completion(folder):
    assert rollout.main(["--num_episodes=1", "--policy=expert", "--task_name=kettle", "--web=page.html"]) == 0
    (episode,) = pages.read_page(folder / "page.html")["episodes"]
    (part,) = episode["parts"]
    ((name, step),) = part["tasks"]
    assert name == "kettle"
    assert part["rewards"].index(1.0) == step == len(part["rewards"]) - 1
    assert part["metrics"]["success"] == [False] * step + [True]


@pytest.mark.web
def test_replays_have_pages(folder):
    assert record.main(["--output=runs", "--num_episodes=3", *SHORT]) == 0
    assert replay.main(["runs", "--episodes=0,2", "--web=page.html"]) == 0
    names = [episode["name"] for episode in pages.read_page(folder / "page.html")["episodes"]]
    assert names == ["episode 0, seed 0", "episode 2, seed 2"]


@pytest.mark.web
def test_a_page_replaces_the_default_video_of_a_trained_policy(folder):
    assert play.main(["--num_episodes=1", "--web=page.html", *SHORT]) == 0
    (episode,) = pages.read_page(folder / "page.html")["episodes"]
    assert len(episode["parts"][0]["metrics"]["drawer_opening"]) == 4
    assert os.listdir(folder) == ["page.html"]


@pytest.mark.web
def test_an_evaluation_shows_the_first_episodes_of_each_condition(folder, capsys):
    arguments = [
        "--domain_name=microwave_table",
        "--protocol=shift",
        "--num_episodes=2",
        "--web_episodes=1",
        "--num_envs=2",
        "--seed=5",
    ]
    assert evaluate.main([*arguments, "--web=page.html", *SHORT]) == 0
    names = [episode["name"] for episode in pages.read_page(folder / "page.html")["episodes"]]
    assert len(set(names)) == len(names) > 1
    assert all(name.endswith(", episode 0, seed 5") for name in names)


@pytest.mark.web
def test_an_unknown_camera_of_an_evaluation_is_refused_before_the_first_episode(folder, capsys):
    assert evaluate.main(["--num_episodes=1", "--web=page.html", "--camera=moon"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "camera" in err
    assert "overview" in err


@pytest.mark.web
def test_an_interrupt_keeps_the_page_until_then(folder, monkeypatch, capsys):
    from kitchen_suite.gymnasium_env.base import SuiteEnv

    step, steps = SuiteEnv.step, []

    def interrupted(self, action):
        steps.append(action)
        if len(steps) == 5:
            raise KeyboardInterrupt
        return step(self, action)

    monkeypatch.setattr(SuiteEnv, "step", interrupted)
    assert rollout.main(["--num_episodes=3", "--web=page.html", *SHORT]) == 130
    assert "web page page.html ends early, in episode 2" in capsys.readouterr().out
    lengths = [len(episode["parts"][0]["rewards"]) for episode in pages.read_page(folder / "page.html")["episodes"]]
    assert lengths == [4, 2]


@pytest.mark.web
def test_layouts_that_vary_are_shown(folder):
    """Objects stand where each episode's variations put them, and meshes are still shared."""
    assert rollout.main(["--num_episodes=2", "--variations=layout", "--web=page.html", *SHORT]) == 0
    page = pages.read_page(folder / "page.html")
    first, second = page["episodes"]
    assert len({*first["chunks"]} & {*second["chunks"]}) > 10
    positions = [fixed_positions(page, episode) for episode in page["episodes"]]
    assert positions[0].keys() == positions[1].keys()
    assert any(positions[0][name] != positions[1][name] for name in positions[0])


def fixed_positions(page, episode):
    """The positions of bodies that no joint moves, by name."""
    head, _ = pages.contents(pages.joined(page, episode))
    messages = [message for _, message in head["messages"] if message["type"] == "SetPositionMessage"]
    return {message["name"]: message["position"] for message in messages}


@pytest.mark.web
@pytest.mark.parametrize("domain", ["kitchen", "open_cabinet", "microwave_table", "kitchens"])
def test_a_page_of_a_long_episode_is_small(folder, domain):
    arguments = [f"--domain_name={domain}", "--num_episodes=1", "--max_episode_steps=280", "--web=page.html"]
    assert rollout.main(arguments) == 0
    assert (folder / "page.html").stat().st_size <= 10e6
