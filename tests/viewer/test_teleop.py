"""A person who plays in the page, through viser's protocol: alone, after a policy, with others, and after a crash."""

import contextlib
import dataclasses
import importlib.util
import itertools
import json
import re
import signal
import subprocess
import sys
import threading
import time

import gymnasium
import mink
import numpy as np
import pytest
from helpers.errors import refused
from helpers.viser_client import TIMEOUT, Browser

from kitchen_suite.commands.commands import record, replay, rollout, verify
from kitchen_suite.episodes.recording import RecordingFolder
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.policies import PolicyError
from kitchen_suite.settings import EpisodeSettings, ViewSettings
from kitchen_suite.viewer.intervention import InterventionWrapper, PageDevice
from kitchen_suite.viewer.live import UNSAVED, TeleoperatedEpisode
from kitchen_suite.viewer.viewer import PlayedPolicy, live_episode

KETTLE = {"domain_name": "kitchen", "task_name": "kettle"}


def spec_of(policy="teleop", steps=60, **settings):
    return EpisodeSpec.of(
        EpisodeSettings(**{**KETTLE, "policy": policy, "max_episode_steps": steps, **settings}), seeding="gymnasium"
    )


def started(spec=None, seed=3, **arguments):
    episode = TeleoperatedEpisode(spec or spec_of(), **arguments)
    episode.start(seed)
    return episode


def play(episode, steps):
    for _ in range(steps):
        episode.step()


def test_a_policy_acts_until_a_person_takes_over_and_hands_back(tmp_path):
    spec = spec_of("teleop(policy='expert(speed=0.2)')")
    episode = TeleoperatedEpisode(spec)
    episode.keep_in(tmp_path)
    episode.start(3)
    play(episode, 8)
    assert not episode.is_waiting
    assert "acts | the policy" in episode.report()
    episode.arm.nudge([0.0, 0.0, 0.03])
    play(episode, 6)
    assert "acts | you" in episode.report()
    episode.hand_back()
    assert not episode.is_waiting
    play(episode, 5)
    episode.save()
    arrays = RecordingFolder.open(tmp_path).load(3).arrays
    assert arrays["label/is_intervention"].tolist() == [False] * 8 + [True] * 6 + [False] * 5
    np.testing.assert_array_equal(arrays["label/teleop_action"], arrays["action"])
    assert arrays["action"].dtype == np.float32
    assert np.abs(arrays["action"][:8]).max() > 0.0
    assert replay.main([str(tmp_path)]) == 0


def test_after_going_back_the_person_acts_until_it_is_handed_back():
    episode = started(spec_of("teleop(policy='expert(speed=0.2)')"))
    play(episode, 9)
    episode.rewind(4)
    assert (episode.steps, episode.is_waiting) == (5, True)
    episode.hand_back()
    assert not episode.is_waiting


def test_the_fingers_are_as_they_were():
    episode = started()
    episode.arm.grasp(True)
    play(episode, 20)
    episode.rewind(3)
    assert episode.arm.is_closed
    episode.rewind(17)
    assert not episode.arm.is_closed


def test_time_stands_still_a_moment_after_the_hand_does():
    episode = started(spec_of(steps=300))
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


def test_a_crash_loses_nothing_but_the_last_second(tmp_path):
    first = started(unsaved=tmp_path / UNSAVED)
    first.arm.nudge([0.0, 0.0, 0.05])
    play(first, 20)
    first.keep()
    play(first, 5)
    # Another process goes on where the copy was made.
    second = started(unsaved=tmp_path / UNSAVED)
    assert second.steps == 20
    assert second.is_waiting
    for name, array in second.episode().arrays.items():
        np.testing.assert_array_equal(array, first.episode().arrays[name][: len(array)], name)
    assert started(seed=4, unsaved=tmp_path / UNSAVED).steps == 0
    second.discard()
    assert second.steps == started(unsaved=tmp_path / UNSAVED).steps == 0


def test_copies_of_other_seeds_stay_and_those_of_what_was_rejected_do_not(tmp_path):
    first = started(seed=1, unsaved=tmp_path / UNSAVED)
    play(first, 5)
    first.keep()
    first.start(2)
    play(first, 3)
    first.keep()
    first.discard()
    first.start(1)
    assert first.steps == 5
    first.rewind(100)
    assert started(seed=1, unsaved=tmp_path / UNSAVED).steps == 0
    assert not (tmp_path / UNSAVED).exists()


def test_after_a_step_that_failed_the_episode_only_goes_back(monkeypatch, tmp_path):
    episode = TeleoperatedEpisode(spec_of())
    episode.keep_in(tmp_path / "mine")
    episode.start(0)
    play(episode, 4)
    environment = type(episode._rollout.environment)
    with monkeypatch.context() as patch:
        patch.setattr(environment, "step", lambda *arguments: 1 / 0)
        with refused(ZeroDivisionError, "division"):
            episode.step()
    for action in (episode.step, episode.finish):
        with refused(RuntimeError, "cannot go on"):
            action()
    with refused(ValueError, "was not completed"):
        episode.save()
    episode.rewind(1)
    play(episode, 2)
    episode.save()
    assert replay.main([str(tmp_path / "mine")]) == 0


def test_a_copy_that_does_not_play_again_is_named(tmp_path):
    first = started(unsaved=tmp_path / UNSAVED)
    first.arm.nudge([0.0, 0.0, 0.05])
    play(first, 5)
    first.keep()
    copies = RecordingFolder.open(tmp_path / UNSAVED)
    episode = copies.load(3)
    arrays = {**episode.arrays, "reward": episode.arrays["reward"] + 1.0}
    copies.save(dataclasses.replace(episode, arrays=arrays), copies.load_stats(3))
    with refused(OSError, UNSAVED, "remove it"):
        started(unsaved=tmp_path / UNSAVED)


def test_time_goes_on_while_the_hand_turns():
    episode = started(spec_of(steps=300))
    position, orientation = episode.arm.hand
    turned = mink.SO3(orientation) @ mink.SO3.exp(np.array([0.0, 0.0, 1.2]))
    episode.arm.move_to(position, turned.wxyz)
    while not episode.is_waiting:
        episode.step()
    _, found = episode.arm.hand
    assert np.linalg.norm((turned @ mink.SO3(found).inverse()).log()) < 0.1


def test_an_episode_goes_on_from_a_recorded_state(tmp_path):
    spec = spec_of("expert(speed=0.3)")
    with contextlib.closing(TeleoperatedEpisode(spec_of())) as episode:
        recorded = RecordingFolder.claim(tmp_path / "expert", spec)
        played = TeleoperatedEpisode(spec_of("teleop(policy='expert(speed=0.3)')"))
        played.start(0)
        play(played, 30)
        whole = played.episode()
        recorded.save(whole, stats_of(played, whole))
        episode.start_from(recorded.load(0), 12)
        assert (episode.steps, episode.is_waiting) == (12, True)
        episode.arm.nudge([0.0, 0.0, 0.02])
        play(episode, 4)
        arrays = episode.episode().arrays
        assert arrays["label/is_intervention"].tolist() == [False] * 12 + [True] * 4
        np.testing.assert_array_equal(
            arrays["observation/observation"][:13], whole.arrays["observation/observation"][:13]
        )
        with refused(ValueError, "30 control steps, not 31"):
            episode.start_from(whole, 31)
        changed = {**whole.arrays, "observation/observation": whole.arrays["observation/observation"] + 1.0}
        with refused(ValueError, "observation/observation differs"):
            episode.start_from(type(whole)(index=0, seed=0, arrays=changed))
    settings = ViewSettings(teleop=True, start_from=tmp_path / "expert", start_step=9, output=tmp_path / "mine")
    episode = live_episode(settings)
    assert (episode.spec.task_name, episode.steps) == ("kettle", 9)
    episode.arm.grasp(True)
    play(episode, 3)
    episode.save()
    assert replay.main([str(tmp_path / "mine")]) == 0


def test_a_rollouts_episode_goes_on(tmp_path):
    """Its seeds start random streams in another way, and its actions are float64."""
    flags = ["--policy=random", "--task_name=kettle", "--num_episodes=1", "--max_episode_steps=6", "--seed=4"]
    assert rollout.main([f"--output={tmp_path / 'runs'}", *flags]) == 0
    episode = live_episode(ViewSettings(teleop=True, start_from=tmp_path / "runs", output=tmp_path / "mine"))
    assert (episode.steps, episode.seed) == (6, 4)
    episode.arm.nudge([0.0, 0.0, 0.02])
    play(episode, 3)
    episode.save()
    assert replay.main([str(tmp_path / "mine")]) == 0


def test_what_the_viewer_saves_is_a_recording_of_kitchen_record(tmp_path, capsys):
    episode = live_episode(ViewSettings(teleop=True, task_name="kettle", output=tmp_path / "mine"))
    episode.arm.nudge([0.0, 0.0, 0.02])
    play(episode, 3)
    assert not episode.save()
    assert "saved last | seed 0: the task was not done" in episode.report()
    capsys.readouterr()
    flags = ["--policy=teleop", "--task_name=kettle", "--max_episode_steps=2000", "--num_episodes=1"]
    status = record.main([*flags, f"--output={tmp_path / 'mine'}"])
    # Without the extra `web` nobody can play, though nobody has to.
    if importlib.util.find_spec("viser"):
        assert status == 0
        assert "1 of them there already" in capsys.readouterr().out
    else:
        assert status == 2
        assert "needs mjviser and viser" in capsys.readouterr().err


def stats_of(live, episode):
    from kitchen_suite.episodes.episode import EpisodeStats

    return EpisodeStats.of(episode, live._environment.task.records.metrics(episode.last_info))


def test_an_episode_may_be_forbidden_to_go_back():
    episode = started(spec_of("teleop(rewind=False)"))
    play(episode, 2)
    for action in (lambda: episode.rewind(1), episode.discard):
        with refused(ValueError, "rewind=False"):
            action()


def test_a_finished_episode_lasts_to_its_end():
    episode = started()
    episode.arm.nudge([0.0, 0.0, 0.02])
    play(episode, 5)
    episode.finish()
    assert episode.is_finished
    assert episode.steps == 60
    policy = PlayedPolicy(episode.episode())
    for action in episode.episode().arrays["action"]:
        np.testing.assert_array_equal(policy(None), action)
        assert policy.labels["is_intervention"]
    with refused(PolicyError, "60 control steps"):
        policy(None)


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
    flags = ["--teleop", "--task_name=kettle", f"--output={tmp_path / 'mine'}", f"--port={port}"]
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
    flags = ["--teleop", "--task_name=kettle", f"--port={port}"]
    with running("view", *flags) as process, browsing_of(process, port) as browser:
        browser.press("Up")
        browser.wait(lambda: browser.number("control step") > 3)
        browser.read(1.5)
        browser.click("Reset")
        browser.wait(lambda: browser.number("control step") == 0)
        # Another policy, from which the person takes over.
        browser.set("Take over from", "expert")
        browser.click("Load")
        browser.wait(lambda: "acts | the policy" in browser.report())
        browser.press("Up")
        browser.wait(lambda: "acts | you" in browser.report())
        browser.press("Hand back")
        browser.wait(lambda: "acts | the policy" in browser.report())


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


GARBAGE = (
    b"",
    b"\xff" * 50,
    b"\x81\xa4type\xa4Evil",
    {"type": "GuiUpdateMessage", "uuid": "none", "updates": {"value": 1}},
    {"type": "CommandTriggerMessage", "uuid": 7},
    {"type": "TransformControlsUpdateMessage", "name": "/hand/arrows", "wxyz": ["a"], "position": {}, "owner": ""},
    {
        "type": "TransformControlsUpdateMessage",
        "name": "/nothing",
        "wxyz": [1, 0, 0, 0],
        "position": [0, 0, 0],
        "owner": 3,
    },
)


@pytest.mark.web
def test_garbage_breaks_nothing(viewer, port):
    with browsing(port) as good:
        good.press("Up")
        for garbage in GARBAGE:
            with contextlib.closing(Browser(port)) as bad, contextlib.suppress(Exception):
                bad._socket.send(garbage) if isinstance(garbage, bytes) else bad.send(garbage)
                bad.read(0.2)
        # From the browser that controls, in the right form.
        for position in ([np.nan] * 3, [np.inf, 0.0, 0.0], [1e300] * 3):
            good.move([float(value) for value in position])
        good.move([-0.3, 0.3, 2.2], wxyz=(0.0, 0.0, 0.0, 0.0))
        for label, value in {"Nudge": "huge", "Speed": "light", "Camera": "moon", "Seed": -5}.items():
            good.set(label, value)
        steps = good.number("control step")
        good.press("Up")
        good.wait(lambda: good.number("control step") > steps + 3)
        assert "Error" not in good.report()
    assert viewer.poll() is None


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
def test_a_viewer_that_was_killed_goes_on_where_it_was(port, tmp_path):
    flags = ["--teleop", "--task_name=kettle", f"--output={tmp_path / 'mine'}", f"--port={port}"]
    with running("view", *flags) as process:
        process.stdout.readline()
        with browsing(port) as browser:
            while browser.number("control step") <= 40:
                keep_moving(browser, 1.0)
            steps = browser.number("control step")
            process.send_signal(signal.SIGKILL)
            process.wait()
    with running("view", *flags) as process:
        process.stdout.readline()
        with browsing(port) as browser:
            # The copy is at most a second old: 12.5 control steps, and one that was under way.
            assert browser.number("control step") >= steps - 14
            browser.press("Save")
            browser.wait(lambda: "episodes saved | 1" in browser.report())
    assert replay.main([str(tmp_path / "mine")]) == 0
    assert not (tmp_path / "mine" / UNSAVED).exists()


def person(port, moves, episodes, after=lambda browser: None):
    """Plays episodes in the page in a thread, each by some keys, and finishes them."""

    def act():
        with contextlib.closing(connected(port)) as browser:
            for number in range(episodes):
                browser.wait(lambda: browser.keys.get("Finish") and "control step | 0 of" in browser.report())
                before = browser.keys["Finish"]
                for move in moves:
                    browser.press(move)
                browser.wait(lambda: browser.number("control step") > 3)
                after(browser)
                browser.press("Finish")
                if number + 1 < episodes:
                    browser.wait(lambda before=before: browser.keys["Finish"] != before)

    thread = threading.Thread(target=act, daemon=True)
    thread.start()
    return thread


def connected(port):
    for _ in range(600):
        with contextlib.suppress(OSError):
            return Browser(port)
        time.sleep(0.2)
    pytest.fail("no page")


@pytest.mark.web
def test_a_person_records_and_is_scored_like_any_policy(port, tmp_path, monkeypatch, capfd):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    policy = f"--policy=teleop(port={port})"
    flags = [policy, "--task_name=kettle", "--max_episode_steps=40"]
    thread = person(port, ["Up", "Forward"], 2)
    command = ["record", *flags, f"--output={tmp_path / 'mine'}", "--num_episodes=2"]
    output = run(command)
    thread.join(TIMEOUT)
    assert "2 episodes" in output
    assert replay.main([str(tmp_path / "mine")]) == 0
    arrays = RecordingFolder.open(tmp_path / "mine").load(1).arrays
    assert len(arrays["reward"]) == 40
    assert arrays["label/is_intervention"].all()

    files = [f"--json={tmp_path / 'score.json'}", f"--receipt={tmp_path / 'receipt.npz'}"]
    # With one that goes back.
    thread = person(port, ["Up"], 2, after=lambda browser: browser.press("Back 1 s"))
    run(["evaluate", *flags, *files, "--num_episodes=2"])
    thread.join(TIMEOUT)
    score = json.loads((tmp_path / "score.json").read_text())
    assert (score["policy"], score["success"]) == (f"teleop(port={port})", 0.0)
    assert verify.main([str(tmp_path / "receipt.npz")]) == 0

    thread = person(port, ["Up"], 1)
    output = run(["rollout", *flags, "--num_episodes=1"])
    thread.join(TIMEOUT)
    assert re.search(r"^\s*0\s+0\s", output, re.MULTILINE)
    # Nothing is left to go on with.
    assert not [*(tmp_path / "cache" / "kitchen-suite").glob("teleop/*")]


def run(command):
    done = subprocess.run(
        [sys.executable, "-m", "kitchen_suite", *command], capture_output=True, text=True, timeout=TIMEOUT
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.web
def test_a_person_takes_over_from_what_acts_in_an_environment(port):
    env = InterventionWrapper(gymnasium.make("KitchenSuite/FrankaKitchen-v1", tasks_to_complete=["kettle"]), port)
    env.reset(seed=0)
    zeros = np.zeros(9, np.float32)
    *_, info = env.step(zeros)
    assert info["is_intervention"] is False
    with contextlib.closing(Browser(port)) as browser:
        browser.press("Up")
        wait_until(lambda: not env._page.commands.empty())
        start = time.monotonic()
        for _ in range(6):
            *_, info = env.step(zeros)
            assert info["is_intervention"] is True
        assert np.abs(info["teleop_action"]).max() > 0.0
        assert time.monotonic() - start > 4 * 0.08
        browser.press("Hand back")
        wait_until(lambda: not env._page.commands.empty())
        *_, info = env.step(zeros)
    assert info["is_intervention"] is False
    np.testing.assert_array_equal(info["teleop_action"], zeros)
    env.close()


@pytest.mark.web
def test_a_device_has_what_robosuites_devices_return(port):
    device = PageDevice(port=port, pos_sensitivity=2.0)
    device.start_control()
    with contextlib.closing(Browser(port)) as browser:
        for label in ("Up", "Up", "Yaw left", "Open or close"):
            browser.press(label)
        browser.click("Reset")
        time.sleep(1.0)
        state = device.get_controller_state()
    np.testing.assert_allclose(state["dpos"], [0.0, 0.0, 0.04])
    # As `input2action` of robosuite reads it: elements 1, 0, 2, and the last one the other way.
    np.testing.assert_allclose(state["raw_drotation"], [0.0, 0.0, -np.deg2rad(5.0)])
    np.testing.assert_allclose(state["rotation"][0, 0], np.cos(np.deg2rad(5.0)))
    assert [state[name] for name in ("grasp", "reset", "base_mode")] == [1, 1, 0]
    np.testing.assert_array_equal(device.get_controller_state()["dpos"], np.zeros(3))
    device.start_control()
    assert device.get_controller_state()["reset"] == 0
    device.close()


@pytest.mark.web
def test_a_class_of_robosuites_is_made_and_reset_as_one(port):
    class Device:
        def __init__(self, env):
            self.robots = env

        def _reset_internal_state(self):
            self.active_robot = 0

    class Browser(PageDevice, Device):
        pass

    device = Browser("robots", port=port)
    device.start_control()
    assert (device.robots, device.env, device.active_robot) == ("robots", "robots", 0)
    device.close()


def wait_until(condition):
    for _ in range(200):
        if condition():
            return
        time.sleep(0.05)
    pytest.fail("nothing came")
