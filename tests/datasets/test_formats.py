"""Recordings in the files of other programs: every number survives, and their own loaders read them."""

import contextlib
import json
import subprocess
import sys
from pathlib import Path

import gymnasium
import h5py
import mujoco
import numpy as np
import pytest
from helpers.episodes import load_episode

from kitchen_suite.commands import convert, record
from kitchen_suite.environment.mjcf_values import greatest_difference
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.gymnasium_env.observations import OF_PICTURES

COUNT = 3
pytestmark = pytest.mark.full

KITCHEN = ["--num_threads=1", "--output=runs", f"--num_episodes={COUNT}", "--num_envs=2", "--seed=5"]
EXPERT = ["--policy=expert", "--task_name=complete", '--task_kwargs={"variations": null}']
SHORT = ["--policy=random", "--task_name=kettle", "--max_episode_steps=5"]
CABINET = ["--domain_name=open_cabinet", "--max_episode_steps=5"]
PICTURES = ['--task_kwargs={"obs_type": "pixels_agent_pos", "image_size": [16, 20], "render_quality": "fast"}']


@pytest.fixture
def make(run, folder):
    """Records episodes and converts them, in an empty folder; returns status, stdout and stderr of the conversion."""

    def make(name, *arguments):
        status, _, err = run(record, *KITCHEN, *arguments)
        assert (status, err) == (0, "")
        return run(convert, "runs", f"--format={name}", "--dataset=me/set", "--data_path=data")

    return make


def recorded(index):
    return load_episode(f"runs/episode_{index:06d}.npz")[1]


def states(arrays):
    return arrays["observation/observation"] if "observation/observation" in arrays else arrays["observation"]


@pytest.mark.parametrize("arguments", [EXPERT, CABINET], ids=["kitchen", "cabinet"])
def test_d4rl(make, run, arguments):
    status, out, err = make("d4rl", *arguments)
    assert (status, err) == (0, "")
    assert out == "dataset me/set of runs in data/me/set.hdf5\n"
    with h5py.File("data/me/set.hdf5") as file:
        rows = {name: file[name][:] for name in file if name != "infos"}
        state = file["infos/observations"][:] if "infos" in file else rows["observations"]
    ends = np.flatnonzero(rows["terminals"] | rows["timeouts"]) + 1
    assert len(ends) == COUNT
    for index, (start, end) in enumerate(zip([0, *ends[:-1]], ends, strict=True)):
        arrays = recorded(index)
        np.testing.assert_array_equal(state[start:end], states(arrays)[:-1])
        np.testing.assert_array_equal(rows["actions"][start:end], arrays["action"])
        np.testing.assert_array_equal(rows["rewards"][start:end], arrays["reward"])
        np.testing.assert_array_equal(rows["terminals"][start:end], arrays["termination"])
        np.testing.assert_array_equal(rows["next_observations"][start : end - 1], rows["observations"][start + 1 : end])
    if arguments is EXPERT:
        assert rows["observations"].shape[1] == 60
        # What reads D4RL's own files reads this one.
        status, out, err = run(convert, "data/me/set.hdf5", "--output=back")
        assert (status, err) == (0, ""), err
        _, back = load_episode("back/episode_000000.npz")
        for name, rows in recorded(0).items():
            if name.startswith("observation/desired_goal"):
                np.testing.assert_allclose(back[name][0], rows[0])


@pytest.mark.parametrize("arguments", [EXPERT, CABINET], ids=["kitchen", "cabinet"])
def test_ogbench(make, arguments):
    status, _, err = make("ogbench", *arguments)
    assert (status, err) == (0, "")
    with np.load("data/me/set.npz") as file:
        rows = dict(file)
    ends = np.flatnonzero(rows["terminals"]) + 1
    assert len(ends) == COUNT
    for index, (start, end) in enumerate(zip([0, *ends[:-1]], ends, strict=True)):
        arrays = recorded(index)
        np.testing.assert_array_equal(rows["observations"][start:end], states(arrays))
        np.testing.assert_array_equal(rows["actions"][start : end - 1], arrays["action"])
        np.testing.assert_array_equal(rows["rewards"][start + 1 : end], arrays["reward"])
        if arguments is EXPERT:
            found = np.hstack([rows["qpos"][start:end], rows["qvel"][start:end]])
            np.testing.assert_array_equal(found, arrays["physics_state"])
            # Noise is at most 0.1 of its unit, and the last element of qpos that of the kettle.
            np.testing.assert_allclose(rows["qpos"][start:end, :9], states(arrays)[:, :9], atol=0.02)
            np.testing.assert_allclose(rows["qvel"][start:end, :9], states(arrays)[:, 9:18], atol=0.02)


def test_ogbenchs_validation_is_a_tenth(make):
    assert make("ogbench", *SHORT, "--num_episodes=20")[0] == 0
    counts = [np.load(f"data/me/{name}.npz")["terminals"].sum() for name in ("set", "set-val")]
    assert counts == [18, 2]


@pytest.mark.parametrize("arguments", [EXPERT, CABINET], ids=["kitchen", "cabinet"])
def test_robomimic(make, arguments):
    status, _, err = make("robomimic", *arguments)
    assert (status, err) == (0, "")
    with h5py.File("data/me/set.hdf5") as file:
        data = file["data"]
        assert data.attrs["total"] == sum(len(recorded(index)["reward"]) for index in range(COUNT))
        args = json.loads(data.attrs["env_args"])
        env = gymnasium.make(args["env_name"], **args["env_kwargs"])
        spec = Recording.open(Path("runs")).spec
        inner = suite_env(env)
        assert str(inner.composer_task) == str(suite_env(spec.make_environment()).composer_task)
        for index in range(COUNT):
            arrays, group = recorded(index), data[f"demo_{index}"]
            names = {name: name.removeprefix("observation/").replace("/", "_").replace(" ", "_") for name in arrays}
            for name, key in names.items():
                if name.startswith("observation"):
                    np.testing.assert_array_equal(group[f"obs/{key}"][:], arrays[name][:-1])
                    np.testing.assert_array_equal(group[f"next_obs/{key}"][:], arrays[name][1:])
            for name, key in {"actions": "action", "rewards": "reward", "terminations": "termination"}.items():
                np.testing.assert_array_equal(group[name][:], arrays[key])
            np.testing.assert_array_equal(group["dones"][:], arrays["termination"] | arrays["truncation"])
            assert group.attrs["num_samples"] == len(arrays["reward"]) == len(group["states"])
            timestep = inner.environment.control_timestep()
            times = timestep * np.arange(len(arrays["reward"]))
            np.testing.assert_allclose(group["states"][:, 0], times, rtol=0, atol=1e-12)
            np.testing.assert_array_equal(group["states"][:, 1:], arrays["physics_state"][:-1])


VARIED = ["--policy=random", "--max_episode_steps=5", '--task_kwargs={"variations": ["layout", "dynamics"]}']
MODELS = {
    "kitchen": [*VARIED, "--task_name=kettle"],
    "cabinet": [*VARIED, "--domain_name=open_cabinet"],
    "pictures": [*SHORT, *PICTURES],
    "kitchens": ["--policy=random", "--max_episode_steps=5", "--domain_name=kitchens"],
    "pick_and_place": ["--policy=random", "--max_episode_steps=5", "--domain_name=pick_and_place"],
}


@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=pytest.mark.rendering) if case == "pictures" else case for case in MODELS]
)
def test_robomimics_model_compiles_without_files_to_that_of_the_recorded_states(make, case):
    assert make("robomimic", *MODELS[case])[0] == 0
    with h5py.File("data/me/set.hdf5") as file:
        data = file["data"]
        args = json.loads(data.attrs["env_args"])
        given = {name: value for name, value in args["env_kwargs"].items() if name not in OF_PICTURES}
        with contextlib.closing(gymnasium.make(args["env_name"], **given)) as env:
            for index in range(COUNT):
                group = data[f"demo_{index}"]
                # As robomimic's `reset_to` for robosuite.
                model = mujoco.MjModel.from_xml_string(group.attrs["model_file"])
                simulation = mujoco.MjData(model)
                assert group["states"].shape[1] == 1 + model.nq + model.nv
                env.reset(seed=int(group.attrs["seed"]))
                physics = suite_env(env).environment.physics
                assert greatest_difference(model, physics.model.ptr, physical=True).value < 1e-9
                # The last state is that before the last step.
                for state, action in zip(group["states"], group["actions"], strict=True):
                    simulation.time, simulation.qpos, simulation.qvel = state[0], *np.split(state[1:], [model.nq])
                    mujoco.mj_forward(model, simulation)
                    np.testing.assert_allclose(simulation.xpos, physics.data.xpos, rtol=0, atol=1e-9)
                    env.step(action)


@pytest.mark.parametrize("arguments", [SHORT, CABINET], ids=["kitchen", "cabinet"])
def test_gymnasium_makes_the_recorded_environment_of_robomimics_arguments_alone(make, arguments):
    assert make("robomimic", *arguments)[0] == 0
    with h5py.File("data/me/set.hdf5") as file:
        args = json.loads(file["data"].attrs["env_args"])
        actions, seed = file["data/demo_0/actions"][:], int(file["data/demo_0"].attrs["seed"])
    program = (
        "import gymnasium, json, sys\n"
        "args, actions, seed = json.loads(sys.stdin.read())\n"
        "env = gymnasium.make(args['env_name'], **args['env_kwargs'])\n"
        "env.reset(seed=seed)\n"
        "ends = [env.step(action)[2:4] for action in actions]\n"
        "print(json.dumps([[bool(end) for end in each] for each in ends]))\n"
    )
    given = json.dumps([args, actions.tolist(), seed])
    ended = subprocess.run([sys.executable, "-c", program], input=given, capture_output=True, text=True, check=True)
    arrays = recorded(0)
    np.testing.assert_array_equal(
        json.loads(ended.stdout), np.column_stack([arrays["termination"], arrays["truncation"]])
    )


@pytest.mark.rendering
def test_pictures_survive(make):
    status, _, err = make("robomimic", *SHORT, *PICTURES)
    assert (status, err) == (0, "")
    arrays = {key: rows for key, rows in recorded(1).items() if rows.ndim == 4}
    assert arrays
    for key, rows in arrays.items():
        with h5py.File("data/me/set.hdf5") as file:
            found = file[f"data/demo_1/obs/{key.removeprefix('observation/').replace('/', '_')}"][:]
        np.testing.assert_array_equal(found, rows[:-1])


@pytest.mark.clients
def test_ogbenchs_own_loader_reads_it(make):
    from ogbench.utils import load_dataset

    assert make("ogbench", *EXPERT)[0] == 0
    dataset = load_dataset("data/me/set.npz", ob_dtype=np.float64, add_info=True)
    arrays = [recorded(index) for index in range(COUNT)]
    np.testing.assert_array_equal(dataset["observations"], np.concatenate([states(each)[:-1] for each in arrays]))
    np.testing.assert_array_equal(dataset["next_observations"], np.concatenate([states(each)[1:] for each in arrays]))
    np.testing.assert_array_equal(dataset["actions"], np.concatenate([each["action"] for each in arrays]))
    assert dataset["qpos"].shape == (len(dataset["actions"]), 30)


def test_goals_are_those_of_the_requested_tasks(make):
    assert make("d4rl", "--policy=random", "--task_name=random_4", "--max_episode_steps=3")[0] == 0
    with h5py.File("data/me/set.hdf5") as file:
        goals, requested = file["observations"][::3, 30:], file["infos/requested_tasks"][::3]
    assert len(np.unique(requested, axis=0)) > 1
    tasks = EnvironmentSpec.make("kitchen", "random_4", {}).argument("tasks_to_complete")
    microwave = 30 - 8  # Its joint is before the seven of the kettle.
    np.testing.assert_allclose(goals[:, microwave], -0.75 * requested[:, tasks.index("microwave")])
