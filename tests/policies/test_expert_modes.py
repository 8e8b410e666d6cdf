"""The scripted experts complete their tasks in every control mode, from observations alone."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.episodes import play, successes
from helpers.sweeps import brief, brief_named

from kitchen_suite import experts, policies, suite
from kitchen_suite.commands import record
from kitchen_suite.entities import KITCHEN_FRANKA, KitchenArena
from kitchen_suite.gymnasium_env import FrankaKitchenEnv, FrankaOpenCabinetEnv
from kitchen_suite.policies.experts.encoders import ENCODERS, make_encoder
from kitchen_suite.policies.experts.kinematics import ARM, ArmKinematics
from kitchen_suite.policies.experts.kitchen_skills import FIXED_SKILLS
from kitchen_suite.policies.experts.skills import ArcMove, HandOrientation
from kitchen_suite.tasks import DEFAULT_TASKS, GOALS
from kitchen_suite.tasks.control_modes.registry import OFFSET_MODES
from kitchen_suite.tasks.kitchen.control_modes import CONTROL_MODES
from kitchen_suite.tasks.kitchen.goals import INITIAL_QPOS

# Those that are not the default, which other tests cover.
KITCHEN_MODES = [mode for mode in CONTROL_MODES if mode != "joint_velocity"]
CABINET_MODES = [mode for mode in OFFSET_MODES if mode != "joint_offset"]
SINGLE_TASKS = [task.replace(" ", "_") for task in DEFAULT_TASKS]
FURTHER_TASKS = [task.replace(" ", "_") for task in GOALS if task not in DEFAULT_TASKS]
DRAWERS = ("top_drawer", "bottom_drawer")

# Rounding to single precision may leave a bound by this fraction of it.
ROUNDING = 1e-6


def load(domain, task, mode, **task_kwargs):
    return suite.load(domain, task, {"visuals": False, "control_mode": mode, **task_kwargs})


def test_every_control_mode_has_an_encoder():
    assert {*CONTROL_MODES.values(), *OFFSET_MODES.values()} == set(ENCODERS)


@pytest.mark.parametrize("modes", [CONTROL_MODES, OFFSET_MODES], ids=["kitchen", "open_cabinet"])
def test_a_mode_is_built_again_from_its_settings(modes):
    for name, mode in modes.items():
        settings = mode().settings
        assert mode().name == name
        assert mode(**settings).settings == settings


def once_per_mode(tasks, modes):
    """All pairs; in every run each mode with one of the tasks, which take turns."""
    return brief(itertools.product(tasks, modes), kept=zip(itertools.cycle(tasks), modes))


@pytest.mark.full
@pytest.mark.parametrize("mode", brief(KITCHEN_MODES, ["joint_delta", "ee_pose"]))
def test_parts_of_generated_kitchens_are_moved(mode):
    """In postures and orientations of the hand that the mode can keep to."""
    environment = load("kitchens", "any", mode, design=0, split="test")
    # A hand that cannot turn cannot swing all doors.
    swung = "open" if mode != "ee_delta_position" else "close"
    for task in ("turn_on oven_1/knob_Joint_4", f"{swung} hinge_cabinet_1/right_hinge_cabinet"):
        environment.task.follow(environment.task.checked_reset({"requested_tasks": [task]}))
        play(environment, policies.find("expert"), 101)
        assert environment.task.episode_metrics["success"], task


@pytest.mark.full
@pytest.mark.parametrize(("task", "mode"), once_per_mode(["complete", "bottom_burner", "hinge_cabinet"], KITCHEN_MODES))
def test_kitchen_tasks_are_completed(task, mode):
    environment = load("kitchen", task, mode)
    actions = play(environment, policies.find("expert"), 101)
    assert environment.task.episode_metrics["success"], environment.task.episode_metrics
    spec = environment.action_spec()
    margin = ROUNDING * np.maximum(np.abs(spec.minimum), np.abs(spec.maximum))
    assert np.all((spec.minimum - margin <= actions) & (actions <= spec.maximum + margin))


@pytest.mark.full
@pytest.mark.parametrize(
    ("task", "mode"),
    brief(
        itertools.product(FURTHER_TASKS, ["joint_delta", "ee_delta_pose"]),
        kept=[("close_microwave", "joint_delta"), ("return_kettle", "ee_delta_pose")],
    ),
)
def test_further_tasks_are_completed(task, mode):
    assert successes(load("kitchen", task, mode), [101]) == 1


@pytest.mark.full
@pytest.mark.parametrize(("task", "mode"), once_per_mode(DRAWERS, CABINET_MODES))
def test_drawers_are_opened(task, mode):
    assert successes(load("open_cabinet", task, mode), [201]) == 1


SETTINGS = {
    "hand frame": ("ee_delta_pose", {"frame": "hand"}),
    "hand frame, position": ("ee_delta_position", {"frame": "hand"}),
    "slow hand": ("ee_delta_pose", {"linear_speed": 0.15, "angular_speed": 0.5}),
    "fast hand": ("ee_delta_position", {"linear_speed": 1.0}),
    "slow joints": ("joint_delta", {"joint_speed": 0.4}),
    "position targets from true positions": ("joint_position", {"feedback": "true"}),
    "ten times the noise": ("ee_pose", {"robot_noise_ratio": 0.1, "object_noise_ratio": 0.005}),
}


@pytest.mark.full
@pytest.mark.parametrize(
    ("mode", "settings"),
    brief_named(SETTINGS, kept=["hand frame", "slow joints", "position targets from true positions"]),
)
def test_the_expert_takes_the_settings_of_the_control_mode(mode, settings):
    assert successes(load("kitchen", "microwave", mode, **settings), [102]) == 1


# Action noise by mode: for `complete`, and for the drawers.
NOISE = {
    "joint_position": (0.03, 0.001),
    "joint_delta": (0.2, 0.2),
    "ee_delta_position": (0.4, 0.05),
    "ee_delta_pose": (0.4, 0.05),
    "ee_pose": (0.01, 0.0002),
}


@pytest.mark.full
@pytest.mark.parametrize(("mode", "noise"), brief(NOISE.items(), kept=[("ee_pose", NOISE["ee_pose"])]))
def test_motion_styles_hold_in_every_mode(mode, noise):
    policy = f"expert(speed=0.9, action_noise={noise[0]}, jitter=0.01)"
    assert successes(load("kitchen", "kettle", mode), [103, 104], policy) == 2


def run(environment, expert, observe):
    """Plays an episode of a Gymnasium environment; returns whether it was a success."""
    observation, _ = environment.reset(seed=105)
    expert.reset(np.random.default_rng(0))
    terminated = truncated = False
    while not terminated and not truncated:
        action = expert.act(observe(observation))
        assert environment.action_space.contains(action)
        observation, _, terminated, truncated, info = environment.step(action)
    return info["is_success"]


@pytest.mark.full
@pytest.mark.parametrize("mode", brief(KITCHEN_MODES, kept=["joint_position", "ee_delta_pose"]))
def test_observations_alone_are_enough_in_the_kitchen(mode):
    environment = FrankaKitchenEnv(tasks_to_complete=["light switch"], max_episode_steps=280, control_mode=mode)
    expert = experts.KitchenExpert(["light switch"], control_mode=mode)
    assert run(environment, expert, lambda observation: observation["observation"])


@pytest.mark.full
@pytest.mark.parametrize("mode", brief(CABINET_MODES, kept=["ee_pose"]))
def test_observations_alone_are_enough_at_the_cabinet(mode):
    environment = FrankaOpenCabinetEnv(drawer="top", max_episode_steps=700, control_mode=mode)
    assert run(environment, experts.DrawerExpert("top", control_mode=mode), lambda observation: observation)


def test_fixed_skills_keep_the_orientation_of_the_reset():
    rotation = ArmKinematics(KitchenArena, KITCHEN_FRANKA).forward(INITIAL_QPOS[ARM]).rotation()
    for task in DEFAULT_TASKS:
        for move in FIXED_SKILLS[task].moves:
            if isinstance(move, ArcMove):
                assert move.hand_rotation_ratio == 0.0
            else:
                assert np.linalg.norm((move.orientation.rotation.inverse() @ rotation).log()) < 1e-3
    same = HandOrientation.from_rotation(rotation).rotation
    np.testing.assert_allclose(same.as_matrix(), rotation.as_matrix(), atol=1e-12)


@pytest.mark.full
def test_many_episodes_are_recorded_at_once_in_another_mode(tmp_path, capsys):
    arguments = ["--policy=expert", "--task_name=kettle", "--num_episodes=3", "--num_envs=2", f"--output={tmp_path}"]
    assert record.main([*arguments, '--task_kwargs={"control_mode": "ee_delta_pose"}']) == 0
    assert "success rate          100% (3 of 3)" in capsys.readouterr().out


REJECTED = {
    "did you mean 'ee_pose'": lambda: experts.KitchenExpert(["kettle"], control_mode="ee_poses"),
    "frame is an argument of control_mode ee_delta_position and ee_delta_pose": lambda: experts.KitchenExpert(
        ["kettle"], control_mode="ee_pose", frame="hand"
    ),
    "did you mean 'linear_speed'": lambda: experts.DrawerExpert("top", control_mode="ee_delta_pose", liner_speed=1.0),
    "velocity_scale must be finite and positive": lambda: experts.KitchenExpert(["kettle"], velocity_scale=0.0),
    "cannot act in control_mode 'mine', only in joint_velocity": lambda: make_encoder(
        SimpleNamespace(name="mine"), None
    ),
}


@pytest.mark.parametrize("message", REJECTED)
def test_bad_control_modes_are_rejected(message):
    with pytest.raises((TypeError, ValueError), match=message):
        REJECTED[message]()


@pytest.mark.nightly
@pytest.mark.parametrize("mode", KITCHEN_MODES)
@pytest.mark.parametrize("task", [*SINGLE_TASKS, "complete"])
def test_a_hundred_unseen_seeds_in_every_mode(task, mode):
    assert successes(load("kitchen", task, mode), range(30_000, 30_100)) >= 95


@pytest.mark.nightly
@pytest.mark.parametrize("mode", CABINET_MODES)
@pytest.mark.parametrize("task", DRAWERS)
def test_a_hundred_unseen_starts_in_every_mode(task, mode):
    assert successes(load("open_cabinet", task, mode), range(30_000, 30_100)) >= 95


@pytest.mark.nightly
@pytest.mark.parametrize(("mode", "noise"), NOISE.items(), ids=NOISE)
@pytest.mark.parametrize("task", ["complete", *DRAWERS])
def test_demanding_noise_in_every_mode(task, mode, noise):
    domain = "kitchen" if task == "complete" else "open_cabinet"
    policy = f"expert(action_noise={noise[domain == 'open_cabinet']}, jitter=0.01)"
    assert successes(load(domain, task, mode), range(31_000, 31_020), policy) >= 18
