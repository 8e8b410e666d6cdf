"""A simulation that diverges ends its episode as an error ends that of the single environment, in every autoreset mode.

Velocities of some environments become NaN between two control steps: at random, several at once, in the first step of
an episode and in the one that would truncate it. The single environments then raise a PhysicsError, and their next
steps start the next episodes.
"""

import numpy as np
import pytest
from dm_control.rl.control import PhysicsError
from gymnasium.vector import AutoresetMode
from helpers.open_cabinet import VARIED
from helpers.sweeps import brief

from kitchen_suite.gymnasium_env import FrankaKitchenEnv, FrankaMicrowaveTableEnv, FrankaOpenCabinetEnv
from kitchen_suite.gymnasium_env.generated_kitchens import GeneratedKitchenEnv
from kitchen_suite.vector_env import FrankaKitchenVectorEnv, FrankaMicrowaveTableVectorEnv, FrankaOpenCabinetVectorEnv
from kitchen_suite.vector_env.generated_kitchens import GeneratedKitchenVectorEnv

COUNT, SEED, LIMIT = 4, 30, 5

# Of the joints of the robot, which come first in every model.
JOINTS = np.arange(3)

# Two environments of the first kitchen, whose simulations are in one batch.
KITCHENS = (0, 3, 0, 7)
NOISE = {"handle_offset": 0.01, "joint_positions": 0.02}

# Settings with which all that an episode holds differs from step to step, and draws random numbers.
DOMAINS = {
    "kitchen": (
        FrankaKitchenEnv,
        FrankaKitchenVectorEnv,
        {
            "tasks_per_episode": 2,
            "reward": "dense",
            "variations": ["start", "dynamics", "sensing"],
            "extra_observables": ["franka/end_effector_pose"],
            "quality": True,
        },
    ),
    "open_cabinet": (
        FrankaOpenCabinetEnv,
        FrankaOpenCabinetVectorEnv,
        {"variations": VARIED, "observation_noise": NOISE},
    ),
    "microwave_table": (FrankaMicrowaveTableEnv, FrankaMicrowaveTableVectorEnv, {"variations": ["start", "layout"]}),
    "kitchens": (
        GeneratedKitchenEnv,
        GeneratedKitchenVectorEnv,
        {"variations": ["start", "push"], "reward": "dense", "control_mode": "ee_delta_pose"},
    ),
}

CASES = [(domain, mode.value, seeds) for domain in DOMAINS for mode in AutoresetMode for seeds in (False, True)]


class Twin:
    """A single environment that is played as a row of a vectorised one."""

    def __init__(self, env):
        self.env, self.steps = env, 0
        self.has_diverged = False

    def start(self, **arguments):
        """Starts the next episode: after an error by a step, as its users do."""
        restarts = self.has_diverged and not arguments
        self.last = self.env.step(self.action)[::4] if restarts else self.env.reset(**arguments)
        self.steps, self.has_diverged = 0, False
        return self.last

    def step(self, action, diverges):
        """Returns what a step returns; after an error, the last observation and infos that there were before."""
        self.action = action
        if diverges:
            self.env.unwrapped.environment.physics.data.qvel[JOINTS] = np.nan
            with pytest.raises(PhysicsError):
                self.env.step(action)
            self.has_diverged = True
            observation, infos = self.last
            return observation, 0.0, True, False, infos
        observation, *numbers, infos = self.env.step(action)
        self.last, self.steps = (observation, infos), self.steps + 1
        return observation, *numbers, infos


def row(value, i):
    """Returns what environment `i` has of nested arrays with a leading axis, without masks."""
    if isinstance(value, dict):
        return {key: row(part, i) for key, part in value.items() if not key.startswith("_")}
    return value[i]


def assert_row(observations, infos, i, expected):
    observation, single_infos = expected
    np.testing.assert_equal(row(observations, i), observation)
    np.testing.assert_equal(row(infos, i), single_infos)


def make(domain, mode, episode_seeds):
    """Returns a vectorised environment, and a single one for each of its rows."""
    single, vector, settings = DOMAINS[domain]
    settings = {"max_episode_steps": LIMIT, **settings}
    designs = [{"design": design} if domain == "kitchens" else {} for design in KITCHENS]
    each = {"design": KITCHENS} if domain == "kitchens" else {}
    env = vector(COUNT, num_threads=1, autoreset_mode=mode, episode_seeds=episode_seeds, **each, **settings)
    stride = COUNT if episode_seeds else False
    return env, [Twin(single(episode_seeds=stride, **design, **settings)) for design in designs]


def inject(env, rows):
    """Makes the next step of some simulations diverge."""
    simulation = env._episodes.simulation
    velocities = np.array(simulation.read("qvel", JOINTS))
    velocities[rows] = np.nan
    simulation.write("qvel", JOINTS, velocities)


def play(domain, mode, episode_seeds, least, seed=0):
    """Compares all steps until a number of divergences, among them some in each step of an episode.

    Returns the step of its episode in which each one came.
    """
    env, twins = make(domain, mode, episode_seeds)
    random, found, ended = np.random.default_rng(seed), [], np.zeros(COUNT, bool)
    observations, infos = env.reset(seed=SEED)
    for i, twin in enumerate(twins):
        assert_row(observations, infos, i, twin.start(seed=SEED + i))
    while len(found) < least or len({*found}) < LIMIT:
        if mode == "Disabled" and ended.any():
            observations, infos = env.reset(options={"reset_mask": ended})
            for i in np.flatnonzero(ended):
                assert_row(observations, infos, i, twins[i].start())
            ended = np.zeros(COUNT, bool)
        actions = random.uniform(-0.3, 0.3, env.action_space.shape).astype(np.float32)
        diverges = (random.random(COUNT) < 0.2) & ~ended
        inject(env, diverges)
        found += [twin.steps for twin, chosen in zip(twins, diverges, strict=True) if chosen]
        observations, rewards, terminated, truncated, infos = env.step(actions)
        errors = infos.pop("physics_error", np.zeros(COUNT, bool))
        assert errors.tolist() == infos.pop("_physics_error", errors).tolist() == diverges.tolist()
        final, final_infos = infos.pop("final_obs", None), infos.pop("final_info", None)
        assert (final is not None) == (mode == "SameStep" and bool((terminated | truncated).any()))
        for i, twin in enumerate(twins):
            if mode == "NextStep" and ended[i]:
                assert (rewards[i], terminated[i], truncated[i]) == (0.0, False, False)
                assert_row(observations, infos, i, twin.start())
                continue
            observation, *numbers, single_infos = twin.step(actions[i], diverges[i])
            assert [rewards[i], terminated[i], truncated[i]] == numbers
            if mode == "SameStep" and (terminated[i] or truncated[i]):
                np.testing.assert_equal(final[i], observation)
                np.testing.assert_equal(row(final_infos, i), single_infos)
                observation, single_infos = twin.start()
            assert_row(observations, infos, i, (observation, single_infos))
        ended = (terminated | truncated) if mode != "SameStep" else np.zeros(COUNT, bool)
        if episode_seeds:
            assert env.np_random_seed == tuple(twin.env.np_random_seed for twin in twins)
    env.close()
    return found


@pytest.mark.full
@pytest.mark.parametrize(
    ("domain", "mode", "episode_seeds"),
    brief(
        CASES,
        kept=[("open_cabinet", "NextStep", True), ("open_cabinet", "SameStep", False)],
        full=[
            ("kitchens", "NextStep", True),
            ("kitchen", "SameStep", True),
            ("microwave_table", "Disabled", False),
            ("kitchen", "Disabled", True),
        ],
    ),
)
def test_an_episode_that_diverges_is_one_episode_with_a_last_step_of_its_own(domain, mode, episode_seeds):
    # Also in the first step of an episode, and in the one that would truncate it.
    assert {*play(domain, mode, episode_seeds, 10)} == {*range(LIMIT)}


@pytest.mark.nightly
@pytest.mark.parametrize(("domain", "mode", "episode_seeds"), CASES)
def test_of_a_thousand_divergences_each_ends_one_episode_as_in_single_environments(domain, mode, episode_seeds):
    assert len(play(domain, mode, episode_seeds, 42, seed=1)) >= 42


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_the_seed_of_an_episode_that_diverges_is_used_once(mode):
    env = FrankaOpenCabinetVectorEnv(2, num_threads=1, autoreset_mode=mode, episode_seeds=True)
    env.reset(seed=0)
    actions = np.zeros(env.action_space.shape)
    env.step(actions)
    inject(env, [0])
    *_, infos = env.step(actions)
    assert infos["physics_error"].tolist() == [True, False]
    # With `SameStep` the next episode has started.
    assert env.np_random_seed == ((2, 1) if mode == "SameStep" else (0, 1))
    if mode == "Disabled":
        env.reset(options={"reset_mask": np.array([True, False])})
    for _ in range(2):
        env.step(actions)
        assert env.np_random_seed == (2, 1)
    inject(env, [0])
    env.step(actions)
    if mode == "Disabled":
        env.reset(options={"reset_mask": np.array([True, False])})
    env.step(actions)
    assert env.np_random_seed == (4, 1)


def test_the_final_observation_and_info_of_an_episode_that_diverges_are_its_own():
    env = FrankaOpenCabinetVectorEnv(2, num_threads=1, autoreset_mode="SameStep")
    env.reset(seed=0)
    actions = np.full(env.action_space.shape, 0.01)
    for _ in range(5):
        last, *_ = env.step(actions)
    inject(env, [0])
    observations, *_, infos = env.step(actions)
    np.testing.assert_array_equal(infos["final_obs"][0], last[0])
    assert infos["final_info"]["episode_step"].tolist() == [5, 0]
    assert infos["episode_step"].tolist() == [0, 6]
    assert not np.array_equal(observations[0], last[0])


def test_what_is_read_of_an_episode_that_diverged_is_its_last_step():
    env = FrankaKitchenVectorEnv(2, num_threads=1, autoreset_mode="Disabled")
    env.reset(seed=0)
    actions = np.full(env.action_space.shape, 0.1)
    env.step(actions)
    before, states = env.present_observation, env.physics_state
    inject(env, [1])
    env.step(actions)
    np.testing.assert_equal(row(env.present_observation, 1), row(before, 1))
    np.testing.assert_array_equal(env.physics_state[1], states[1])
