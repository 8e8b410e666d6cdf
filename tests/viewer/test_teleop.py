"""A person who plays in the page, through viser's protocol: alone, after a policy, and with others."""

import contextlib
import dataclasses
import itertools
import subprocess
import sys
import time
import types

import gymnasium
import mink
import numpy as np
import pytest
from helpers.episodes import limited_files, load_episode
from helpers.errors import refused
from helpers.processes import wait_until
from helpers.viser_client import TIMEOUT, Browser

from kitchen_suite.commands import replay, rollout
from kitchen_suite.episodes.episode import Episode
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.viewer.live_episode import Choice
from kitchen_suite.viewer.teleoperation import Collection, SeedTakenError, persons_episode

KETTLE = Choice(domain_name="kitchen", task_name="kettle", max_episode_steps=60)


SLOWLY = "expert(speed=0.2)"


def made(**choice):
    """An episode of the kettle that has not been started."""
    return persons_episode(dataclasses.replace(KETTLE, **choice), render_quality="fast")


def started(policy=None, seed=3, steps=60):
    episode = made(policy=policy, max_episode_steps=steps)
    episode.start(seed)
    return episode


def save(episode, folder):
    return Collection(folder, episode.spec).save(episode)


def play(episode, steps):
    for _ in range(steps):
        episode.step()


@pytest.mark.full
def test_a_policy_acts_until_a_person_takes_over_and_hands_back(tmp_path):
    episode = started(SLOWLY)
    play(episode, 8)
    assert not episode.is_waiting
    assert "the policy acts" in episode.headline()
    episode.arm.nudge([0.0, 0.0, 0.03])
    play(episode, 6)
    assert "you act" in episode.headline()
    episode.hand_back()
    assert not episode.is_waiting
    play(episode, 5)
    save(episode, tmp_path)
    arrays = Recording.open(tmp_path).load(3).arrays
    assert arrays["label/is_intervention"].tolist() == [False] * 8 + [True] * 6 + [False] * 5
    np.testing.assert_array_equal(arrays["label/teleop_action"], arrays["action"])
    assert arrays["action"].dtype == np.float32
    assert np.abs(arrays["action"][:8]).max() > 0.0
    assert replay.main([str(tmp_path)]) == 0


@pytest.mark.full
def test_after_going_back_the_person_acts_until_it_is_handed_back():
    episode = started(SLOWLY)
    play(episode, 9)
    episode.rewind(4)
    assert (episode.steps, episode.is_waiting) == (5, True)
    episode.hand_back()
    assert not episode.is_waiting


@pytest.mark.full
def test_the_fingers_are_as_they_were():
    episode = started()
    episode.arm.grasp(True)
    play(episode, 20)
    episode.rewind(3)
    assert episode.arm.is_closed
    episode.rewind(17)
    assert not episode.arm.is_closed


def test_time_stands_still_a_moment_after_the_hand_does():
    episode = started(steps=300)
    episode.arm.nudge([0.0, 0.0, 0.05])
    while not episode.is_waiting:
        episode.step()
    assert 5 < episode.steps < 25
    assert abs(episode.arm.hand[0][2] - episode.arm.command[0][2]) < 0.005
    # The smallest nudge is made to its end as well.
    episode.arm.nudge([0.0, 0.0, 0.01])
    while not episode.is_waiting:
        episode.step()
    assert abs(episode.arm.hand[0][2] - episode.arm.command[0][2]) < 0.004
    # Nudges add up, whatever the hand still lacks of the last one.
    before = episode.arm.command[0][2]
    episode.arm.nudge([0.0, 0.0, 0.01])
    assert not episode.is_waiting
    assert episode.arm.command[0][2] == pytest.approx(before + 0.01)
    steps = episode.steps
    episode.arm.grasp(True)
    while not episode.is_waiting:
        episode.step()
    assert episode.steps - steps > 5
    assert episode.arm.fingers.max() < 0.005


@pytest.mark.full
def test_after_a_step_that_failed_the_episode_only_goes_back(monkeypatch, tmp_path):
    episode = started(seed=0)
    play(episode, 4)
    environment = type(episode._rollout.environment)
    with monkeypatch.context() as patch:
        patch.setattr(environment, "step", lambda *arguments: 1 / 0)
        with refused(ZeroDivisionError, "division"):
            episode.step()
    with refused(RuntimeError, "cannot go on"):
        episode.step()
    with refused(ValueError, "was not completed"):
        save(episode, tmp_path / "mine")
    episode.rewind(1)
    play(episode, 2)
    save(episode, tmp_path / "mine")
    assert replay.main([str(tmp_path / "mine")]) == 0


def test_time_goes_on_while_the_hand_turns():
    episode = started(steps=300)
    position, orientation = episode.arm.hand
    turned = mink.SO3(orientation) @ mink.SO3.exp(np.array([0.0, 0.0, 1.2]))
    episode.arm.move_to(position, turned.wxyz)
    while not episode.is_waiting:
        episode.step()
    _, found = episode.arm.hand
    assert np.linalg.norm((turned @ mink.SO3(found).inverse()).log()) < 0.1


@pytest.mark.full
def test_a_person_takes_over_from_policies_of_time_steps_alone(monkeypatch):
    module = types.ModuleType("watching")
    module.act = lambda observation: np.zeros(9)
    monkeypatch.setitem(sys.modules, "watching", module)
    with refused(ValueError, "time steps"):
        started("gym:watching:act")
    with refused(ValueError, "'moon'"):
        started("moon")


def recorded_by(policy, folder, steps):
    """A recording of one episode that a policy has begun, and this episode."""
    episode = started(policy, seed=0)
    play(episode, steps)
    recording = Recording.claim(folder, dataclasses.replace(episode.spec, policy=policy))
    recording.append(episode.result())
    return recording, recording.load(0)


@pytest.mark.full
def test_an_episode_goes_on_from_a_recorded_state(tmp_path):
    recording, whole = recorded_by("expert(speed=0.3)", tmp_path / "expert", 30)
    episode = persons_episode(KETTLE, recording.spec, render_quality="fast")
    episode.start_from(whole, 12)
    assert (episode.spec.policy, episode.steps, episode.is_waiting) == ("teleop", 12, True)
    episode.arm.nudge([0.0, 0.0, 0.02])
    play(episode, 4)
    arrays = episode.result().arrays
    assert arrays["label/is_intervention"].tolist() == [False] * 12 + [True] * 4
    np.testing.assert_array_equal(arrays["observation/observation"][:13], whole.arrays["observation/observation"][:13])
    save(episode, tmp_path / "mine")
    assert replay.main([str(tmp_path / "mine")]) == 0
    with refused(ValueError, "30 control steps, not 31"):
        episode.start_from(whole, 31)
    changed = {**whole.arrays, "observation/observation": whole.arrays["observation/observation"] + 1.0}
    with refused(ValueError, "observation/observation differs"):
        episode.start_from(Episode(index=0, seed=0, arrays=changed))


@pytest.mark.full
def test_a_rollouts_episode_goes_on(tmp_path):
    """Its seeds start random streams in another way, and its actions are float64."""
    flags = ["--policy=random", "--task_name=kettle", "--num_episodes=1", "--max_episode_steps=6", "--seed=4"]
    assert rollout.main([f"--output={tmp_path / 'runs'}", *flags]) == 0
    recording = Recording.open(tmp_path / "runs")
    episode = persons_episode(KETTLE, recording.spec, render_quality="fast")
    episode.start_from(recording.load(0))
    assert (episode.steps, episode.seed) == (6, 4)
    episode.arm.nudge([0.0, 0.0, 0.02])
    play(episode, 3)
    save(episode, tmp_path / "mine")
    assert replay.main([str(tmp_path / "mine")]) == 0


@pytest.mark.full
def test_a_person_plays_goes_back_and_saves(tmp_path):
    episode = started(seed=5)
    mine = Collection(tmp_path / "mine", episode.spec)
    assert episode.is_waiting
    with refused(ValueError, "nothing to save"):
        mine.save(episode)
    episode.arm.nudge([0.0, 0.0, 0.05])
    assert not episode.is_waiting
    play(episode, 25)
    episode.rewind(13)
    assert episode.is_waiting, "until the person goes on"
    assert "control step | 12 of 60" in episode.report()
    episode.arm.grasp(True)
    episode.step()
    assert "fingers | closed" in episode.report()
    assert not mine.save(episode)
    assert mine.numbers() == {"episodes saved": "1", "saved last": "seed 5: the task was not done"}
    with refused(ValueError, "an episode of seed 5 has been saved already"):
        mine.save(episode)
    # The next viewer goes on with the next seed.
    assert Collection(tmp_path / "mine", episode.spec).next_seed(5) == 6
    episode.start(3)
    episode.arm.nudge([0.02, 0.0, 0.0])
    episode.step()
    mine.save(episode)
    recording = Recording.open(tmp_path / "mine")
    assert (recording.indices, recording.spec.policy) == ([3, 5], "teleop")
    arrays = recording.load(5).arrays
    assert arrays["label/is_intervention"].all()
    np.testing.assert_array_equal(arrays["label/teleop_action"], arrays["action"])
    assert replay.main([str(tmp_path / "mine")]) == 0


@pytest.mark.full
def test_a_folder_is_for_episodes_of_one_task(tmp_path):
    mine = Collection(tmp_path / "mine", made().spec)
    with refused(ValueError, "policy"):
        mine.check(made(policy="expert").spec)
    assert made(policy="expert").spec.policy == "teleop(policy='expert')"


@pytest.mark.full
def test_of_two_that_save_one_seed_none_overwrites_the_other(tmp_path):
    """In one folder, as two viewers do."""
    one, other = started(seed=5), started(seed=5)
    first, second = (Collection(tmp_path / "mine", each.spec) for each in (one, other))
    for episode, direction in ((one, 0.05), (other, -0.05)):
        episode.arm.nudge([0.0, 0.0, direction])
        play(episode, 4)
    first.save(one)
    with refused(SeedTakenError, "seed 5 has been saved already", "unsaved_000005_"):
        second.save(other)
    assert second.next_seed(5) == 6
    recording = Recording.open(tmp_path / "mine")
    assert recording.indices == [5]
    np.testing.assert_array_equal(recording.load(5).arrays["action"], one.result().arrays["action"])
    # Nothing of the other one is lost.
    (aside,) = (tmp_path / "mine").glob("unsaved_*.npz")
    np.testing.assert_array_equal(load_episode(aside)[1]["action"], other.result().arrays["action"])
    assert replay.main([str(tmp_path / "mine")]) == 0


@pytest.mark.full
def test_a_full_disk_loses_nothing(tmp_path):
    episode = started(seed=5)
    mine = Collection(tmp_path / "mine", episode.spec)
    episode.arm.nudge([0.0, 0.0, 0.05])
    play(episode, 4)
    with limited_files(1024), refused(OSError):
        mine.save(episode)
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["recording.json"]
    mine.save(episode)
    assert Recording.open(tmp_path / "mine").indices == [5]


@contextlib.contextmanager
def running(*flags):
    """A command as a process, which is killed at the end."""
    command = [sys.executable, "-m", "kitchen_suite", *map(str, flags)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        yield process
        process.kill()


@contextlib.contextmanager
def browsing(port, count=1):
    """Browsers, of which the first one controls."""
    with contextlib.ExitStack() as stack:
        browsers = []
        for _ in range(count):
            browsers.append(stack.enter_context(contextlib.closing(Browser(port))))
            browsers[-1].wait(lambda browser=browsers[-1]: "Up" in browser.keys and "control step" in browser.report())
        yield browsers if count > 1 else browsers[0]


@contextlib.contextmanager
def browsing_of(process, port):
    """A browser of a viewer that starts."""
    process.stdout.readline()
    with browsing(port) as browser:
        yield browser


@pytest.fixture
def viewer(port, tmp_path):
    """A viewer in which a person plays, and its folder."""
    flags = ["--teleop", "--task_name=kettle", f"--output={tmp_path / 'mine'}", f"--port={port}", "--no_token"]
    with running("view", *flags) as process:
        process.stdout.readline()
        yield process


@pytest.mark.web
def test_one_browser_controls_and_another_can_take_control(viewer, port):
    with browsing(port, 2) as (one, other):
        other.press("Up")
        other.wait(lambda: other.notifications)
        assert "Another browser controls" in other.notifications[0]
        other.set("Speed", "4x")
        other.move([9.0, 9.0, 9.0])
        other.read(0.5)
        assert other.number("control step") == 0
        one.press("Up")
        one.wait(lambda: one.number("control step") > 0)
        other.click("Take control")
        other.press("Open or close")
        other.wait(lambda: "fingers | closed" in other.report())
        one.press("Open or close")
        one.wait(lambda: one.notifications)
        assert "fingers | closed" in one.report()


@pytest.mark.web
def test_the_first_control_step_comes_in_one_message(viewer, port):
    with browsing(port) as browser:
        browser.read(1.0)  # What is sent at first.
        before = browser.windows
        browser.press("Up")
        browser.wait(lambda: browser.number("control step") > 0)
        assert browser.windows == before + 1


@pytest.mark.web
def test_a_reset_starts_the_episode_anew(port):
    flags = ["--teleop", "--task_name=kettle", f"--port={port}", "--no_token"]
    with running("view", *flags) as process, browsing_of(process, port) as browser:
        browser.press("Up")
        browser.wait(lambda: browser.number("control step") > 3)
        browser.read(1.5)
        browser.click("Reset")
        browser.wait(lambda: browser.number("control step") == 0)
        # Another policy, from which the person takes over.
        browser.set("Take over from", "expert")
        browser.click("Load")
        browser.wait(lambda: "the policy acts" in browser.report())
        browser.press("Up")
        browser.wait(lambda: "you act" in browser.report())
        browser.press("Give back to the policy")
        browser.wait(lambda: "the policy acts" in browser.report())


@pytest.mark.web
def test_time_stands_still_when_the_browser_is_gone_that_controls(viewer, port):
    with browsing(port, 2) as (one, other):
        one.move([-0.3, 0.3, 2.3], ends=False)
        one.wait(lambda: one.number("control step") > 3)
        one.close()
        other.read(1.0)
        steps = other.number("control step")
        other.read(1.0)
        assert other.number("control step") == steps
        # The other one controls now, and nothing has been lost.
        other.press("Down")
        other.wait(lambda: other.number("control step") > steps)


def keep_moving(browser, seconds):
    """Moves the hand up and down for some time."""
    end = time.monotonic() + seconds
    for move in itertools.cycle(["Up", "Down"]):
        browser.press(move)
        browser.read(0.3)
        if time.monotonic() > end:
            return


@pytest.mark.web
def test_a_slow_browser_holds_up_nobody(viewer, port):
    with browsing(port, 2) as (good, slow):
        slow._socket.recv(timeout=TIMEOUT)  # And nothing any more.
        good.press("Up")
        good.wait(lambda: good.number("control step") > 1)
        start, first = time.monotonic(), good.number("control step")
        keep_moving(good, 4.0)
        assert good.number("control step") - first > 0.5 * (time.monotonic() - start) / 0.08


@pytest.mark.web
def test_a_person_takes_over_from_what_acts_in_an_environment(port):
    from kitchen_suite.viewer.intervention import InterventionWrapper

    env = InterventionWrapper(gymnasium.make("KitchenSuite/FrankaKitchen-v1", tasks_to_complete=["kettle"]), port)
    token = env.address.rpartition("/")[2]
    assert len(token) >= 32
    env.reset(seed=0)
    zeros = np.zeros(9, np.float32)
    *_, info = env.step(zeros)
    assert info["is_intervention"] is False
    with contextlib.closing(Browser(port, token)) as browser:
        browser.press("Up")
        wait_until(lambda: not env._page.commands.empty())
        start = time.monotonic()
        for _ in range(6):
            *_, info = env.step(zeros)
            assert info["is_intervention"] is True
        assert np.abs(info["teleop_action"]).max() > 0.0
        assert time.monotonic() - start > 4 * 0.08
        browser.press("Give back to the policy")
        wait_until(lambda: not env._page.commands.empty())
        *_, info = env.step(zeros)
    assert info["is_intervention"] is False
    np.testing.assert_array_equal(info["teleop_action"], zeros)
    env.close()
