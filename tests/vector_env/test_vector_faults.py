"""The state of vectorised environments after divergence, interrupts, errors of MuJoCo, and `close`."""

import functools
import gc
import os
import signal
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from dm_control.rl import control
from helpers.comparisons import assert_same
from helpers.errors import refused
from helpers.open_cabinet import VARIED
from helpers.processes import open_process
from helpers.sweeps import brief
from helpers.vectors import batch, part
from mujoco.batch import SimulationError

from kitchen_suite.gymnasium_env import FrankaKitchenEnv, FrankaOpenCabinetEnv
from kitchen_suite.vector_env import FrankaKitchenVectorEnv, FrankaOpenCabinetVectorEnv

pytestmark = pytest.mark.full

SINGLES = {FrankaKitchenVectorEnv: FrankaKitchenEnv, FrankaOpenCabinetVectorEnv: FrankaOpenCabinetEnv}
# Settings with which resets and steps of the cabinet draw random numbers.
DRAWN = {FrankaKitchenVectorEnv: {}, FrankaOpenCabinetVectorEnv: {"variations": VARIED}}
# Every third step starts episodes.
SHORT = {"max_episode_steps": 3, "autoreset_mode": "SameStep"}

both = pytest.mark.parametrize("vector", SINGLES, ids=["kitchen", "cabinet"])


def actions_of(env):
    return np.full(env.action_space.shape, 0.01)


def started(vector, count=3, *, seed=4, **settings):
    """An environment after the first two steps of its episodes."""
    env = vector(count, num_threads=2, **DRAWN[vector], **settings)
    env.reset(seed=seed)
    for _ in range(2):
        env.step(actions_of(env))
    return env


DIVERGENCES = [("NextStep", "qvel", np.nan), ("SameStep", "qpos", 1e11), ("Disabled", "qvel", 1e11)]


@pytest.mark.parametrize(
    ("vector", "mode", "field", "value"),
    brief(
        [(vector, *case) for vector in SINGLES for case in DIVERGENCES],
        kept=[
            (FrankaKitchenVectorEnv, *DIVERGENCES[1]),
            *((FrankaOpenCabinetVectorEnv, *case) for case in DIVERGENCES),
        ],
    ),
)
@pytest.mark.filterwarnings("error")
def test_a_divergence_ends_its_episode_and_leaves_the_others_alone(vector, mode, field, value):
    env, twin = (started(vector, autoreset_mode=mode) for _ in range(2))
    getattr(batch(env), field)[1] = value
    observation, reward, terminated, truncated, info = env.step(actions_of(env))
    assert (reward[1], terminated.tolist(), truncated.tolist()) == (0.0, [False, True, False], [False] * 3)
    assert info.pop("physics_error").tolist() == info.pop("_physics_error").tolist() == [False, True, False]
    assert env.observation_space.contains(observation)
    assert all(np.isfinite(array[1]).all() for array in leaves(observation))
    # With `SameStep` the next episode has started; otherwise the last step counts for nothing.
    assert info["episode_step"].tolist() == [3, 0 if mode == "SameStep" else 2, 3]
    if mode == "SameStep":
        assert info.pop("final_obs")[1] in env.single_observation_space
        for key in ("_final_obs", "_final_info"):
            assert info.pop(key).tolist() == [False, True, False]
        info.pop("final_info")
    assert_others_go_on_as((observation, reward, terminated, truncated, info), twin.step(actions_of(env)))
    if mode == "Disabled":
        with refused(gymnasium.error.ResetNeeded, "environments [1]"):
            env.step(actions_of(env))
        observation, _ = env.reset(options={"reset_mask": np.array([False, True, False])})
        assert all(np.isfinite(array[1]).all() for array in leaves(observation))
    for steps in [0, 1] if mode == "NextStep" else [1, 2]:
        stepped = env.step(actions_of(env))
        assert "physics_error" not in stepped[4]
        assert stepped[4]["episode_step"][1] == steps
        assert_others_go_on_as(stepped, twin.step(actions_of(env)))


def leaves(value):
    return [leaf for inner in value.values() for leaf in leaves(inner)] if isinstance(value, dict) else [value]


def assert_others_go_on_as(ours, twins):
    observation, *numbers, info = ours
    twin_observation, *twin_numbers, twin_info = twins
    assert info.keys() == twin_info.keys()
    for i in (0, 2):
        assert_same(part(observation, i), part(twin_observation, i))
        assert [array[i] for array in numbers] == [array[i] for array in twin_numbers]
        assert_same(part(info, i), part(twin_info, i))


@both
def test_the_episode_after_a_divergence_is_the_one_that_the_single_environment_starts(vector):
    env, single = started(vector, count=1), SINGLES[vector](**DRAWN[vector])
    single.reset(seed=4)
    for _ in range(2):
        single.step(actions_of(single))
    batch(env).qvel[0] = single.environment.physics.data.qvel[:] = np.nan
    with pytest.raises(control.PhysicsError):
        single.step(actions_of(single))
    env.step(actions_of(env))
    # The next step of both is the reset.
    assert_same(part(env.step(actions_of(env))[0], 0), single.step(actions_of(single))[0])


def test_all_may_diverge_at_once_and_again():
    env = started(FrankaOpenCabinetVectorEnv, autoreset_mode="SameStep")
    for _ in range(3):
        batch(env).qvel[:] = np.nan
        observation, reward, terminated, _, info = env.step(actions_of(env))
        assert (reward.tolist(), terminated.all(), info["physics_error"].all()) == ([0.0] * 3, True, True)
        assert np.isfinite(observation).all()
    assert not env.step(actions_of(env))[2].any()


def test_a_divergence_at_the_limit_does_not_end_the_next_episode():
    env = started(FrankaOpenCabinetVectorEnv, max_episode_steps=3, autoreset_mode="SameStep")
    batch(env).qvel[1] = np.nan
    _, _, terminated, truncated, _ = env.step(actions_of(env))
    assert (terminated.tolist(), truncated[[0, 2]].tolist()) == ([False, True, False], [True, True])
    *_, terminated, truncated, info = env.step(actions_of(env))
    assert not (terminated | truncated).any()
    assert info["episode_step"].tolist() == [1, 1, 1]


def interrupt(*args, **kwargs):
    raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("vector", "path"),
    [
        (FrankaKitchenVectorEnv, "_episodes._draws.noise"),
        (FrankaOpenCabinetVectorEnv, "_episodes._draws.uniform"),
        (FrankaOpenCabinetVectorEnv, "_episodes._draws.noise"),
        (FrankaOpenCabinetVectorEnv, "_episodes.batch.step"),
        (FrankaOpenCabinetVectorEnv, "_template_env.environment.start_episode"),
    ],
)
def test_after_an_interrupt_in_a_step_only_a_reset_of_all_helps(vector, path, monkeypatch):
    env = started(vector, **SHORT)
    with monkeypatch.context() as patched:
        patched.setattr(*target(env, path), interrupt)
        with pytest.raises(KeyboardInterrupt):
            env.step(actions_of(env))
    assert_only_a_reset_of_all_helps(env)


@pytest.mark.parametrize("options", [None, {"reset_mask": np.array([False, True, False])}], ids=["all", "one"])
@pytest.mark.parametrize("path", ["_episodes.batch.reset", "_template_env.environment.start_episode"])
def test_after_an_interrupt_in_a_reset_only_a_reset_of_all_helps(path, options, monkeypatch):
    env = started(FrankaOpenCabinetVectorEnv, **SHORT)
    with monkeypatch.context() as patched:
        patched.setattr(*target(env, path), interrupt)
        with pytest.raises(KeyboardInterrupt):
            env.reset(options=options)
    assert_only_a_reset_of_all_helps(env)


def test_after_a_draw_that_a_reset_refuses_only_a_reset_of_all_helps():
    frictions = iter([3.0, 3.0, 3.0, 3.0, np.nan])
    drawn = {"cabinet/drawer_top_friction": lambda *args, **kwargs: next(frictions, 3.0)}
    # The first draw is made while it is built.
    env = FrankaOpenCabinetVectorEnv(3, num_threads=1, variations=drawn)
    env.reset(seed=0)
    with refused(ValueError, "cabinet/drawer_top_friction"):
        env.reset(options={"reset_mask": np.array([False, True, False])})
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
        env.step(actions_of(env))
    env.reset(seed=0)
    assert env.step(actions_of(env))[4]["episode_step"].tolist() == [1, 1, 1]


def test_an_error_of_mujocos_in_one_simulation_reaches_the_caller_and_wants_a_reset(monkeypatch):
    env = started(FrankaOpenCabinetVectorEnv, **SHORT)
    step = batch(env).step

    def fails_in_one(ids, *args):
        step(np.array([0, 2]), *args)
        raise SimulationError(np.array([1]), "out of memory", 3)

    with monkeypatch.context() as patched:
        patched.setattr(batch(env), "step", fails_in_one)
        with pytest.raises(SimulationError, match="simulation 1: out of memory"):
            env.step(actions_of(env))
    assert_only_a_reset_of_all_helps(env)


def target(env, path):
    """The object to patch, and the name of its attribute."""
    *parents, name = path.split(".")
    for attribute in parents:
        env = getattr(env, attribute)
    return env, name


def assert_only_a_reset_of_all_helps(env):
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
        env.step(actions_of(env))
    with pytest.raises(gymnasium.error.ResetNeeded, match="all of them first"):
        env.reset(options={"reset_mask": np.array([True, False, False])})
    fresh = type(env)(3, num_threads=1, **SHORT, **DRAWN[type(env)])
    assert_same(env.reset(seed=8), fresh.reset(seed=8))
    for _ in range(4):
        assert_same(env.step(actions_of(env)), fresh.step(actions_of(env)))


LOOP = """
import os
import numpy as np
from kitchen_suite.vector_env import FrankaOpenCabinetVectorEnv

env = FrankaOpenCabinetVectorEnv(64, num_threads=3, max_episode_steps=20)
env.reset(seed=0)
actions = np.zeros(env.action_space.shape)
try:
    env.step(actions)
    print("ready", flush=True)
    while True:
        env.step(actions)
except KeyboardInterrupt:
    env.reset(seed=0)
    assert env.step(actions)[4]["episode_step"].tolist() == [1] * 64
    print("works on", flush=True)
    raise
"""


def test_a_real_interrupt_ends_a_loop_of_steps_and_the_environments_work_on():
    process = open_process([sys.executable, "-c", LOOP])
    try:
        assert process.stdout.readline() == "ready\n"
        process.send_signal(signal.SIGINT)
        written, complaint = process.communicate(timeout=120)
    finally:
        process.kill()
        process.wait()
    assert (process.returncode, written) == (-signal.SIGINT, "works on\n"), complaint
    assert complaint.endswith("KeyboardInterrupt\n")


def threads():
    gc.collect()
    return set(os.listdir("/proc/self/task"))


def test_threads_are_as_many_as_asked_for_and_go_with_the_environment():
    before = threads()
    env = started(FrankaOpenCabinetVectorEnv)
    # The caller's is one of the two.
    assert len(threads() - before) == 1
    del env
    assert not threads() - before


def test_threads_end_when_it_is_closed():
    before = threads()
    env = started(FrankaOpenCabinetVectorEnv)
    env.close()
    assert not threads() - before


def test_no_threads_are_left_of_one_that_could_not_be_built():
    before = threads()
    with refused(ValueError, "max_episode_steps"):
        FrankaOpenCabinetVectorEnv(3, num_threads=4, max_episode_steps=0)
    assert not threads() - before


@both
def test_it_may_be_closed_twice_and_before_its_first_reset(vector):
    for env in (vector(2), started(vector)):
        env.close()
        env.close()
        assert env.closed


@pytest.mark.parametrize("arguments", [{"num_envs": 0}, {"tasks_to_complete": ["ketle"]}, {}])
def test_what_could_not_be_built_has_nothing_to_close(arguments, monkeypatch):
    def fail(*args, **kwargs):
        raise ValueError("no batch")

    # The last of what is built.
    monkeypatch.setattr("kitchen_suite.vector_env.base.BatchPictures", fail)
    env = FrankaKitchenVectorEnv.__new__(FrankaKitchenVectorEnv)
    with pytest.raises(ValueError):  # noqa: PT011
        env.__init__(**arguments)
    assert env.closed
    env.close()


@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_process_is_told_so_and_does_not_hang():
    env = started(FrankaKitchenVectorEnv)
    child = os.fork()
    if child == 0:
        try:
            env.step(actions_of(env))
        except RuntimeError as error:
            os._exit(7 if "fork" in str(error) else 8)
        os._exit(9)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
    env.step(actions_of(env))


FORKS = """
import os, signal, sys
from kitchen_suite.vector_env import FrankaKitchenVectorEnv, FrankaOpenCabinetVectorEnv

ends = {"close": lambda envs: envs.pop().close(), "del": list.clear, "exit": lambda envs: None}
for vector in (FrankaKitchenVectorEnv, FrankaOpenCabinetVectorEnv):
    envs = [vector(2, num_threads=2)]
    envs[0].reset(seed=0)
    for name, end in ends.items():
        if os.fork() == 0:
            signal.alarm(10)
            end(envs)
            sys.exit(7)
        print(vector.__name__, name, os.waitstatus_to_exitcode(os.wait()[1]))
    envs[0].step(envs[0].action_space.sample())
"""


def test_a_forked_process_that_closes_or_drops_it_or_exits_does_not_hang():
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", FORKS], capture_output=True, text=True, check=True)
    assert [line.split()[-1] for line in done.stdout.splitlines()] == ["7"] * 6, done.stdout


@both
def test_a_closed_environment_raises(vector):
    env = started(vector)
    env.close()
    for use in (env.reset, lambda: env.step(actions_of(env))):
        with pytest.raises(gymnasium.error.ClosedEnvironmentError):
            use()


@both
def test_what_reads_the_episodes_of_a_closed_environment_raises(vector):
    env = started(vector)
    names = ("physics_state", "present_observation", "present_numbers", "np_random", "np_random_seed", "instruction")
    uses = [functools.partial(getattr, env, name) for name in names]
    uses += [env.reset_statistics, lambda: env.get_attr("np_random_seed")]
    for use in uses:
        use()
    env.close()
    for use in uses:
        with pytest.raises(gymnasium.error.ClosedEnvironmentError):
            use()
