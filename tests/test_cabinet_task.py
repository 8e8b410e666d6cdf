"""The open_cabinet task as an agent meets it: observations and rewards recomputed, ends, seeds, chance."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kitchen_suite import suite
from kitchen_suite.tasks.open_cabinet import DEFAULT_POSE

LOW = np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973, 0.0])
HIGH = np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973, 0.04])
# A pose in which the hand is around the top handle.
AT_HANDLE = np.array([0.0, 0.06, 0.0, -1.91, 0.0, 3.54, -0.785, 0.02, 0.02])
TERMS = ["approach", "orientation", "grasp", "opening", "straddling", "effort", "termination"]


def load(task="top_drawer", **options):
    return suite.load("open_cabinet", task, {"random": 0, "visuals": False, **options})


def flat(timestep):
    return np.concatenate(list(timestep.observation.values()))


def robot_names():
    return [*(f"franka/joint{i}" for i in range(1, 8)), "franka/finger_joint1", "franka/finger_joint2"]


class Recomputed:
    """Observation and reward from MuJoCo's arrays by name, by other means than the task's."""

    def __init__(self, physics, drawer, change, life):
        named = physics.named.data
        joints = robot_names()
        self.q, self.v = named.qpos[joints], named.qvel[joints]
        self.tcp = named.site_xpos["franka/gripper"].copy()
        self.handle = named.site_xpos[f"cabinet/drawer_{drawer}_handle"].copy()
        self.tcp_turn = Rotation.from_matrix(named.site_xmat["franka/gripper"].reshape(3, 3))
        self.handle_turn = Rotation.from_matrix(named.site_xmat[f"cabinet/drawer_{drawer}_handle"].reshape(3, 3))
        self.pads = [named.geom_xpos[f"franka/{side}_finger_pad"][2] for side in ("left", "right")]
        self.open = named.qpos[f"cabinet/drawer_{drawer}_joint"].item()
        self.speed = named.qvel[f"cabinet/drawer_{drawer}_joint"].item()
        self.gripper = named.ctrl["franka/finger_joint1"].item()
        self.change, self.life = change, life
        self.distance = np.sqrt(((self.handle - self.tcp) ** 2).sum())

    @property
    def observation(self):
        handle, tcp = self.handle_turn.as_quat(canonical=True), self.tcp_turn.as_quat()
        tcp = tcp if handle @ tcp >= 0 else -tcp
        scaled = 2 * (self.q[:8] - LOW) / (HIGH - LOW) - 1
        parts = [scaled, self.v[:8] / 2, self.handle - self.tcp, handle - tcp, [self.open], [self.speed]]
        return np.clip(np.concatenate(parts), -5, 5)

    @property
    def terminates(self):
        return self.tcp[0] - self.handle[0] < -0.03 or abs(self.v).max() > 5

    @property
    def terms(self):
        opened = min(max(self.open, 0), 1)
        opening = 0 if opened > 0 and self.distance > 0.03 else 20 * (np.exp(opened) - 1)
        angle = (self.handle_turn * self.tcp_turn.inv()).magnitude()
        action, velocity = (1e-3, 0) if self.life < 8000 else (2e-3, 2e-7)
        return {
            "approach": 10 * (1 - np.tanh(self.distance / 0.1)),
            "orientation": 1 if opening > 0 else np.cos(angle),
            "grasp": (100 if self.distance < 0.025 else -20) * (0.04 - self.gripper),
            "opening": opening,
            "straddling": min(self.pads[0] - self.handle[2], 0) + min(self.handle[2] - self.pads[1], 0),
            "effort": -action * (self.change**2).sum() - velocity * (self.v[:8] ** 2).sum(),
            "termination": -10 if self.terminates else 0,
        }


def random_state(physics, random):
    """Puts the robot anywhere, or about the handle; the drawers too."""
    near = random.random() < 0.7
    spread = random.choice([0.01, 0.05, 0.3])
    pose = AT_HANDLE + spread * random.normal(size=9) if near else random.uniform([*LOW, 0], [*HIGH, 0.04])
    with physics.reset_context():
        physics.named.data.qpos[robot_names()] = np.clip(pose, [*LOW, 0], [*HIGH, 0.04])
        # Open so little that the hand is still at the handle, or a good deal, or closed.
        physics.data.qpos[9:11] = random.choice([0.0, 0.01, 0.2], 2) * random.random(2)
        physics.data.qvel[:] = random.choice([0.1, 1.0]) * random.normal(size=13)


@pytest.mark.parametrize("drawer", ["top", "bottom"])
def test_observation_and_reward_recomputed_at_a_thousand_random_states(drawer):
    env = load(f"{drawer}_drawer")
    random, seen = np.random.default_rng(0), []
    for _ in range(1000):
        env.reset()
        life = int(random.integers(0, 16_000))
        actions = 0.3 * random.normal(size=(2, 8))
        env.task.set_state({**env.task.get_state(), "life_steps": life, "previous_action": actions[0]})
        random_state(env.physics, random)
        timestep = env.step(actions[1])
        expected = Recomputed(env.physics, drawer, actions[1] - actions[0], life)
        np.testing.assert_allclose(flat(timestep), expected.observation, rtol=0, atol=1e-6)
        assert list(env.task.reward_terms) == TERMS
        for name, term in expected.terms.items():
            assert abs(env.task.reward_terms[name] - term) < 1e-6, name
        assert abs(timestep.reward - sum(expected.terms.values())) < 1e-6
        assert timestep.last() == expected.terminates
        assert timestep.discount == 1 - expected.terminates
        assert env.task.drawer_opening == expected.open
        seen.append(expected)
    if drawer == "top":
        # Every branch has been taken.
        assert {each.terms["grasp"] for each in seen} == {0.0, 4.0, -0.8}
        assert {each.terms["opening"] > 0 for each in seen} == {True, False}
        assert any(each.open > 0.02 and each.terms["opening"] == 0 for each in seen)
        assert any(abs(each.v).max() > 5 for each in seen)
        assert any(abs(each.v).max() < 5 and each.terminates for each in seen)
    assert any(each.terms["straddling"] < -1e-3 for each in seen)


def test_the_parts_of_the_observation():
    timestep = load().reset()
    sizes = {name: values.shape for name, values in timestep.observation.items()}
    assert list(sizes.items()) == [
        ("joint_positions", (8,)),
        ("joint_velocities", (8,)),
        ("handle_offset", (3,)),
        ("handle_orientation_offset", (4,)),
        ("drawer_position", (1,)),
        ("drawer_velocity", (1,)),
    ]
    assert all(values.dtype == np.float32 for values in timestep.observation.values())


def test_a_flat_observation_is_the_parts_laid_end_to_end():
    options = {"random": 3, "visuals": False}
    parts = suite.load("open_cabinet", "top_drawer", options)
    whole = suite.load("open_cabinet", "top_drawer", options, environment_kwargs={"flat_observation": True})
    for action in (None, np.full(8, 0.01), np.zeros(8)):
        steps = [env.reset() if action is None else env.step(action) for env in (parts, whole)]
        np.testing.assert_array_equal(steps[1].observation["observations"], flat(steps[0]))
    spec = whole.observation_spec()["observations"]
    assert (spec.shape, spec.dtype) == ((25,), np.float32)


def test_how_an_episode_starts():
    env = load()
    starts = []
    for _ in range(300):
        env.reset()
        data = env.physics.data
        starts.append(data.qpos[:9].copy())
        np.testing.assert_array_equal(data.qpos[9:], 0)
        np.testing.assert_array_equal(data.qvel, 0)
        np.testing.assert_array_equal(data.ctrl, starts[-1])
        assert env.task.reward_terms == dict.fromkeys(TERMS, 0.0)
        np.testing.assert_array_equal(env.task.get_state()["previous_action"], 0)
    noise = np.array(starts) - DEFAULT_POSE
    assert (abs(noise) <= 0.125).all()
    # The extremes of 300 draws from U(-0.125, 0.125).
    assert (noise[:, :7].max(axis=0) > 0.12).all()
    assert (noise[:, :7].min(axis=0) < -0.12).all()
    # Fingers are clipped: half of them start fully open.
    fingers = np.array(starts)[:, 7:]
    assert ((fingers >= 0) & (fingers <= 0.04)).all()
    assert 0.4 < (fingers == 0.04).mean() < 0.6


def test_an_episode_lasts_seven_seconds():
    env = load()
    timestep, steps = env.reset(), 0
    while not timestep.last():
        timestep, steps = env.step(np.zeros(8)), steps + 1
    assert (steps, timestep.discount) == (700, 1.0)
    assert env.control_timestep() == 0.01
    assert env.physics.timestep() == 0.005


def test_an_action_is_an_offset_from_where_the_joints_are():
    env = load(gripper="deterministic")
    env.reset()
    for action in (np.linspace(-0.1, 0.1, 8), np.full(8, 1e6), np.full(8, -1e6)):
        before = env.physics.data.qpos[:7].copy()
        env.task.before_step(env.physics, action, env.random_state)
        np.testing.assert_array_equal(env.physics.data.ctrl[:7], np.clip(before + action[:7], LOW[:7], HIGH[:7]))
        np.testing.assert_array_equal(env.physics.data.ctrl[7:], 0.0 if action[7] > 0 else 0.04)


@pytest.mark.parametrize("action", [-2.0, 0.0, 0.7, 3.0])
def test_the_gripper_closes_as_often_as_its_action_says(action):
    env = load()
    env.reset()
    closed, draws = 0, 20_000
    for _ in range(draws):
        env.task.before_step(env.physics, np.append(np.zeros(7), action), env.random_state)
        left, right = env.physics.data.ctrl[7:]
        assert left == right
        assert left in (0.0, 0.04)
        closed += left == 0.0
    probability = 1 / (1 + np.exp(-action))
    assert abs(closed / draws - probability) < 5 * np.sqrt(probability * (1 - probability) / draws)


def episode(env, steps=60, seed=5):
    random = np.random.default_rng(seed)
    timesteps = [env.reset(), *(env.step(0.05 * random.normal(size=8)) for _ in range(steps))]
    return np.array([flat(timestep) for timestep in timesteps]), [timestep.reward for timestep in timesteps]


def test_the_same_seed_gives_the_same_episodes():
    one, same, other = load(random=7), load(random=7), load(random=8)
    for _ in range(2):
        mine, equal, different = episode(one), episode(same), episode(other)
        np.testing.assert_array_equal(mine[0], equal[0])
        assert mine[1] == equal[1]
        assert abs(mine[0] - different[0]).max() > 0.01


def test_the_gripper_draws_from_the_environments_random_state():
    env = load()
    env.reset()
    assert env.task.random is env.random_state
    expected = np.random.RandomState()
    expected.set_state(env.random_state.get_state())
    for _ in range(20):
        env.step(np.zeros(8))
        assert env.physics.data.ctrl[8] == (0.0 if expected.uniform() < 0.5 else 0.04)


def test_a_deterministic_gripper_draws_nothing():
    env = load(gripper="deterministic")
    env.reset()
    before = env.random_state.get_state()[1:3]
    for _ in range(5):
        env.step(np.append(np.zeros(7), 1.0))
        np.testing.assert_array_equal(env.physics.data.ctrl[7:], 0.0)
    after = env.random_state.get_state()[1:3]
    np.testing.assert_array_equal(before[0], after[0])
    assert before[1] == after[1]


def test_penalties_grow_at_step_8000_of_life_and_resets_do_not_restart_the_count():
    env = load()
    action, efforts = np.full(8, 0.02), []
    env.reset()
    while env.task.life_steps < 8_004:
        # The action alternates, so that its change is the same in every step but an episode's first.
        action = -action
        timestep = env.step(action)
        if timestep.first():
            continue
        velocity = env.physics.data.qvel[:8]
        efforts.append((env.task.reward_terms["effort"], (velocity**2).sum(), env.task.life_steps))
    by_life = {life: (effort, squares) for effort, squares, life in efforts}
    assert len(by_life) == 8_004
    change = 8 * 0.04**2
    for life in (7_999, 8_000):
        np.testing.assert_allclose(by_life[life][0], -1e-3 * change, rtol=1e-12)
    for life in (8_001, 8_004):
        np.testing.assert_allclose(by_life[life][0], -2e-3 * change - 2e-7 * by_life[life][1], rtol=1e-12)


def test_reaching_through_the_handle_ends_the_episode():
    env = load()
    env.reset()
    with env.physics.reset_context():
        # 4 cm further in than the handle, above it.
        env.physics.named.data.qpos[robot_names()] = [0, 0.25, 0, -1.5, 0, 3.3, -0.785, 0, 0]
    tcp, handle = (
        env.physics.named.data.site_xpos[name][0] for name in ("franka/gripper", "cabinet/drawer_top_handle")
    )
    assert tcp < handle - 0.03
    timestep = env.step(np.zeros(8))
    assert timestep.last()
    assert timestep.discount == 0.0
    assert env.task.reward_terms["termination"] == -10.0
    assert env.step(np.zeros(8)).first()


@pytest.mark.parametrize("joint", range(9))
def test_a_joint_that_moves_too_fast_ends_the_episode(joint):
    env = load()
    env.reset()
    env.physics.named.data.qpos[["franka/finger_joint1", "franka/finger_joint2"]] = 0.02
    env.physics.data.qvel[joint] = 40.0
    env.physics.forward()
    timestep = env.step(np.zeros(8))
    assert abs(env.physics.data.qvel[joint]) > 5
    assert timestep.last()
    assert timestep.discount == 0.0


def test_success_ends_nothing():
    env = load()
    env.reset()
    with env.physics.reset_context():
        env.physics.named.data.qpos["cabinet/drawer_top_joint"] = 0.31
        # The hand is drawn back with the handle.
        env.physics.named.data.qpos[robot_names()] = [0, -1.03, 0, -2.8, 0, 3.34, -0.785, 0.04, 0.04]
    timestep = env.step(np.append(np.zeros(7), -50.0))
    assert env.task.is_success
    assert timestep.mid()
    assert env.task.drawer_opening == pytest.approx(0.31, abs=1e-6)
    env.physics.named.data.qpos["cabinet/drawer_top_joint"] = 0.25
    env.step(np.append(np.zeros(7), -50.0))
    results = env.task.episode_results
    assert (results["success"], results["success_at_any_time"]) == (False, True)
    assert results["drawer_opening"] == env.task.drawer_opening < 0.3
    env.reset()
    assert not env.task.episode_results["success_at_any_time"]


def test_noise_is_off_unless_asked_for_and_is_then_clipped_too():
    clean, noisy = load(), load(observation_noise={"handle_offset": 0.02, "drawer_velocity": 10.0})
    assert all(shown.corruptor is None for shown in clean.task.observables.values() if shown.enabled)
    clean.reset()
    errors = []
    for _ in range(400):
        observation = noisy.reset().observation
        true = Recomputed(noisy.physics, "top", np.zeros(8), 0).observation
        errors.append(np.concatenate(list(observation.values())) - true)
    errors = np.array(errors)
    assert abs(errors[:, :16]).max() < 1e-6
    assert 0.019 < abs(errors[:, 16:19]).max() <= 0.02 + 1e-6
    # Velocity is 0 at rest; noise of up to 10 is cut at 5.
    assert abs(errors[:, 24]).max() == 5
    assert 0.4 < (abs(errors[:, 24]) == 5).mean() < 0.6


def test_any_corruptor_of_composers_can_be_set():
    env = load()
    env.task.observables["drawer_position"].corruptor = lambda value, random_state: value + 1
    observation = env.reset().observation["drawer_position"]
    assert observation == 1.0
    assert observation.dtype == np.float32


def test_the_reward_sees_no_noise():
    quiet, noisy = load(gripper="deterministic"), load(gripper="deterministic", observation_noise={"handle_offset": 1})
    for env in (quiet, noisy):
        env.reset()
    mujoco.mj_copyData(noisy.physics.data.ptr, quiet.physics.model.ptr, quiet.physics.data.ptr)
    assert quiet.step(np.zeros(8)).reward == noisy.step(np.zeros(8)).reward


def test_visualising_the_reward_colours_the_handle_of_an_open_drawer():
    env = suite.load("open_cabinet", "top_drawer", {"random": 0}, visualize_reward=True)
    env.reset()
    bar = env.physics.bind(env.task.scene.cabinet.mjcf_model.find("geom", "drawer_top_handle_bar_visual"))
    plain = np.array(bar.rgba)
    env.physics.named.data.qpos["cabinet/drawer_top_joint"] = 0.35
    env.step(np.zeros(8))
    np.testing.assert_allclose(bar.rgba, [0.25, 0.75, 0.3, 1.0], rtol=1e-6)
    env.reset()
    np.testing.assert_array_equal(bar.rgba, plain)
