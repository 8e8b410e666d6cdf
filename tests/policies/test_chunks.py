"""Policies of chunks: files, chunks, and the tasks that they act in."""

import contextlib
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from helpers.errors import refused

import kitchen_suite
from kitchen_suite import EnvironmentSpec, suite
from kitchen_suite.commands import rollout
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies import files as policy_files
from kitchen_suite.policies import load_policy
from kitchen_suite.policies.chunks import ChunkPolicy
from kitchen_suite.policies.files import shipped, shipped_as
from kitchen_suite.policies.networks import Block, Convolution, Linear, PictureEncoder, ResidualNetwork, Scales, silu

STATE, ACTION, CHUNK, WIDTH = 59, 9, 3, 6
TASKS = ["kettle", "microwave", "light switch"]
INPUTS = STATE + len(TASKS)
STATE_KEYS = ("franka/joint_positions", "franka/joint_velocities", "object_positions", "object_velocities")


def linear(generator, inputs, outputs):
    weight = 0.1 * generator.standard_normal((outputs, inputs), np.float32)
    return Linear(weight, generator.standard_normal(outputs, np.float32))


def network(generator, inputs, outputs, blocks=2):
    def block():
        norm = Linear(*generator.uniform(0.5, 1.5, (2, WIDTH)).astype(np.float32))
        return Block(norm, linear(generator, WIDTH, WIDTH), linear(generator, WIDTH, WIDTH))

    parts = tuple(block() for _ in range(blocks))
    return ResidualNetwork(linear(generator, inputs, WIDTH), parts, linear(generator, WIDTH, outputs))


def scales(inputs=INPUTS):
    generator = np.random.default_rng(9)
    return Scales(
        input_mean=generator.standard_normal(inputs, np.float32),
        input_deviation=np.full(inputs, 2.0, np.float32),
        action_mean=np.zeros(ACTION, np.float32),
        action_deviation=np.full(ACTION, 0.1, np.float32),
    )


def make(**changes):
    """Returns a policy with random weights."""
    metadata = {
        "domain_name": "kitchen",
        "task_name": "all",
        "task_kwargs": {},
        "algorithm": "bc",
        "chunk": CHUNK,
        "executed": 2,
        "state_size": STATE,
        "tasks": TASKS,
        **changes,
    }
    return ChunkPolicy(
        scales=scales(), network=network(np.random.default_rng(0), INPUTS, CHUNK * ACTION), metadata=metadata
    )


CAMERAS = ["workspace", "franka/hand"]
SEEING = {"state_size": 18, "state_elements": [*range(18)], "cameras": CAMERAS, "image_size": [9, 12]}


def make_seeing(**changes):
    """Returns a policy with random weights that takes pictures of two cameras, and the robot's part of the state."""
    generator, features = np.random.default_rng(0), 4

    def encoder():
        weight = 0.1 * generator.standard_normal((2, 3, 3, 3), np.float32)
        convolution = Convolution(weight, generator.standard_normal(2, np.float32))
        return PictureEncoder((convolution,), linear(generator, 2 * 5 * 6, features))

    blind = make()
    inputs = SEEING["state_size"] + len(TASKS)
    return ChunkPolicy(
        scales=scales(inputs),
        network=network(generator, inputs + 2 * features, CHUNK * ACTION),
        encoders=(encoder(), encoder()),
        metadata={**blind.metadata, **SEEING, **changes},
    )


@pytest.mark.full
def test_chunks_are_the_same_whatever_the_number_of_threads(tmp_path):
    program = (
        "import sys, numpy as np; from pathlib import Path; from kitchen_suite.policies import load_policy; "
        "policy = load_policy(Path(sys.argv[1])); inputs = np.random.default_rng(1).standard_normal(62); "
        "print(policy.predict(inputs).tobytes().hex())"
    )
    generator, width, size = np.random.default_rng(0), 256, CHUNK * ACTION

    def wide(inputs, outputs):
        def part(rows, columns):
            return Linear(generator.standard_normal((rows, columns), np.float32) / 16, np.zeros(rows, np.float32))

        norm = Linear(np.ones(width, np.float32), np.zeros(width, np.float32))
        block = Block(norm, part(width, width), part(width, width))
        return ResidualNetwork(part(width, inputs), (block, block), part(outputs, width))

    policy = ChunkPolicy(scales=scales(), network=wide(INPUTS, size), metadata=make().metadata)
    policy.save(tmp_path / "policy.npz")
    command = [sys.executable, "-c", program, str(tmp_path / "policy.npz")]
    chosen = {
        subprocess.run(
            command, env={**os.environ, "OPENBLAS_NUM_THREADS": str(count)}, check=True, capture_output=True, text=True
        ).stdout
        for count in (1, 2, 4)
    }
    assert len(chosen) == 1


@pytest.fixture
def policy():
    return make()


def kitchen(task_name="complete", **task_kwargs):
    return suite.load("kitchen", task_name, task_kwargs={"random": 0, "visuals": False, **task_kwargs})


def test_a_saved_policy_is_loaded_unchanged(policy, tmp_path):
    policy.save(tmp_path / "policy.npz")
    loaded = load_policy(tmp_path / "policy.npz")
    assert type(loaded) is type(policy)
    assert policy.metadata.items() <= loaded.metadata.items()
    inputs = np.random.default_rng(1).standard_normal(INPUTS)
    one, other = (each.predict(inputs) for each in (policy, loaded))
    assert one.shape == (CHUNK, ACTION)
    np.testing.assert_array_equal(one, other)


def test_predictions_depend_on_inputs_alone(policy):
    inputs = np.random.default_rng(1).standard_normal((2, INPUTS))
    first, again, other = (policy.predict(each) for each in (inputs[0], inputs[0], inputs[1]))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


def test_only_the_first_actions_of_a_chunk_are_applied(policy, monkeypatch):
    environment, predicted = kitchen(tasks_to_complete=TASKS), []
    predict = type(policy).predict

    def spy(self, inputs, pictures):
        predicted.append(predict(self, inputs, pictures))
        return predicted[-1]

    monkeypatch.setattr(type(policy), "predict", spy)
    act, timestep, actions = policy.episode(environment.task), environment.reset(), []
    for _ in range(5):
        actions.append(act(timestep))
        timestep = environment.step(actions[-1])
    np.testing.assert_array_equal(actions, np.concatenate([chunk[:2] for chunk in predicted])[:5])
    # A new episode begins with a new chunk.
    act(environment.reset())
    assert len(predicted) == 4


@pytest.mark.full
@pytest.mark.parametrize(
    ("task_name", "arguments", "asked"),
    [
        ("kettle", {}, [1, 0, 0]),
        ("all", {"tasks_to_complete": ["light switch", "kettle"]}, [1, 0, 1]),
        ("random_1", {"tasks_to_complete": TASKS}, None),
    ],
)
@pytest.mark.parametrize("flat", [False, True])
def test_inputs_are_the_state_and_the_tasks_asked(task_name, arguments, asked, flat):
    environment = suite.load(
        "kitchen",
        task_name,
        task_kwargs={"random": 0, "visuals": False, **arguments},
        environment_kwargs={"flat_observation": flat},
    )
    timestep = environment.reset()
    inputs = environment.task.policy_inputs.state_and_requests(timestep.observation, TASKS)
    asked = asked or [float(task in environment.task.requested_tasks) for task in TASKS]
    np.testing.assert_array_equal(inputs[STATE:], asked)
    state = np.concatenate([np.ravel(array) for array in timestep.observation.values()])[:STATE]
    np.testing.assert_array_equal(inputs[:STATE], state)
    without = environment.task.policy_inputs.state_and_requests(timestep.observation, [])
    np.testing.assert_array_equal(without, state)


@pytest.mark.full
def test_a_policy_acts_in_tasks_that_ask_for_some_of_its_own_and_in_no_others():
    policy = make()
    policy.check_fits(kitchen("kettle").task)
    with refused(ValueError, "slide cabinet", "kitchen all"):
        policy.check_fits(kitchen("complete").task)
    free = ChunkPolicy(
        scales=scales(STATE),
        network=network(np.random.default_rng(0), STATE, CHUNK * ACTION),
        metadata={**policy.metadata, "tasks": []},
    )
    free.check_fits(kitchen("all").task)
    cabinet = suite.load("open_cabinet", "top_drawer", {"visuals": False}).task
    with refused(ValueError, "59", "25"):
        make_nine_actions(free).check_fits(cabinet)
    with refused(ValueError, "59", "9", "25", "8"):
        free.check_fits(cabinet)
    free.check_fits(kitchen("all", control_mode="joint_position").task)
    positions = free.with_metadata({**free.metadata, "task_kwargs": {"control_mode": "joint_position"}})
    with refused(ValueError, "'joint_position'", "'joint_velocity'"):
        positions.check_fits(kitchen("all").task)


@pytest.mark.full
def test_a_policy_may_take_some_elements_of_the_state():
    elements = [*range(58), 60]
    policy = make(state_elements=elements)
    # The state, here of 62 elements, and which tasks are asked.
    inputs = np.arange(62.0 + len(TASKS))
    np.testing.assert_array_equal(policy.select(inputs), [*elements, 62, 63, 64])
    np.testing.assert_array_equal(make().select(inputs), inputs)
    # The handle comes after the 59 numbers.
    policy.check_fits(kitchen("kettle", extra_observables=["microwave/handle_positions"]).task)
    with pytest.raises(ValueError, match="the policy maps 61 observed numbers"):
        policy.check_fits(kitchen("kettle").task)


POSE = [1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0]


def observing(**changes):
    """Returns a policy that observes two poses beside the 59 numbers, in an order of its own."""
    names = ("microwave/pose", "franka/base_pose")
    metadata = make().metadata | {
        "state_size": STATE + 14,
        "extra_observables": dict.fromkeys(names, 7),
        "layout": dict.fromkeys(names, POSE),
        **changes,
    }
    inputs = INPUTS + 14
    parts = {"scales": scales(inputs), "network": network(np.random.default_rng(0), inputs, CHUNK * ACTION)}
    return ChunkPolicy(**parts, metadata=metadata)


@pytest.mark.full
@pytest.mark.parametrize("extras", [[], ["microwave/pose"], ["hood/pose", "microwave/pose", "franka/base_pose"]])
def test_a_policy_finds_its_extra_observables_among_those_of_a_task(extras, monkeypatch):
    environment, policy, seen = kitchen("kettle", extra_observables=extras), observing(), []
    predict = ChunkPolicy.predict
    monkeypatch.setattr(ChunkPolicy, "predict", lambda self, *args: seen.append(args[0]) or predict(self, *args))
    timestep = environment.reset()
    policy.episode(environment.task)(timestep)
    state = np.concatenate([np.ravel(timestep.observation[key]) for key in STATE_KEYS])
    poses = [timestep.observation.get(name, POSE) for name in ("microwave/pose", "franka/base_pose")]
    np.testing.assert_array_equal(seen[0], [*state, *poses[0], *poses[1], 1, 0, 0])
    assert policy.missing_observables(environment.task) == []


@pytest.mark.full
def test_a_policy_must_observe_its_extra_observables_where_layouts_vary():
    task = kitchen("kettle", variations="layout", extra_observables=["microwave/pose"]).task
    assert observing().missing_observables(task) == ["franka/base_pose"]
    with refused(ValueError, "franka/base_pose", "kitchen all"):
        observing().check_fits(task)
    # Without values in the default layout, it must observe them in any.
    free = observing(layout={"franka/base_pose": POSE})
    assert free.missing_observables(kitchen("kettle").task) == ["microwave/pose"]


@pytest.mark.parametrize(
    "changes",
    [{"layout": {"franka/base_pose": POSE[1:]}}, {"layout": {"kettle": POSE}}, {"extra_observables": {"kettle": "7"}}],
)
def test_metadata_on_extra_observables_is_checked(changes):
    with pytest.raises(ValueError, match=r"layout|extra_observables"):
        observing(**changes)


def make_nine_actions(policy):
    """Returns a policy with the eight actions of the cabinet."""
    size = ACTION - 1
    ones = np.ones(size, np.float32)
    changed = policy.scales._replace(action_mean=ones, action_deviation=ones)
    smaller = network(np.random.default_rng(0), STATE, CHUNK * size)
    return ChunkPolicy(scales=changed, network=smaller, metadata=policy.metadata)


@pytest.mark.full
def test_the_commands_play_such_policies(tmp_path, capsys):
    make().save(tmp_path / "policy.npz")
    path = str(tmp_path / "policy.npz")
    flags = ["--task_name=kettle", "--num_episodes=1", "--max_episode_steps=5"]
    assert rollout.main([f"--policy=trained(file={path!r})", *flags]) == 0
    assert "episodes              1" in capsys.readouterr().out


@pytest.mark.full
def test_an_episode_does_not_begin_with_the_rest_of_the_last_ones_chunk(tmp_path):
    policy = make()
    policy.save(tmp_path / "policy.npz")
    # Two actions of each chunk are applied, so that one is left over.
    spec = EnvironmentSpec.make("kitchen", "kettle", {"variations": ["start"]}, 5)
    with contextlib.closing(spec.make_environment()) as environment:
        inputs = suite_env(environment).composer_task.policy_inputs
        starts = [environment.reset(seed=seed)[0] for seed in range(5)]
        first = [policy.predict(inputs.state_and_requests(start, TASKS).ravel())[0] for start in starts]
    digests = []
    for num_envs in (1, 2, 5):
        played = {
            each.seed: each for each in kitchen_suite.play(spec, tmp_path / "policy.npz", range(5), num_envs=num_envs)
        }
        episodes = [played[seed] for seed in range(5)]
        np.testing.assert_array_equal([episode.arrays["action"][0] for episode in episodes], first)
        digests.append([episode.digest for episode in episodes])
    assert digests == [digests[0]] * 3


@pytest.mark.full
def test_the_commands_add_the_observables_that_a_policy_needs(tmp_path, capsys):
    observing().save(tmp_path / "policy.npz")
    path = str(tmp_path / "policy.npz")
    flags = ["--task_name=kettle", "--variations=layout", "--num_episodes=1", "--max_episode_steps=5"]
    assert rollout.main([f"--policy=trained(file={path!r})", f"--output={tmp_path / 'runs'}", *flags]) == 0
    assert "episodes              1" in capsys.readouterr().out
    kwargs = Recording.open(tmp_path / "runs").spec.task_kwargs
    assert kwargs["extra_observables"] == ["microwave/pose", "franka/base_pose"]


@pytest.mark.parametrize(
    ("changes", "shown"),
    [
        ({"executed": 4}, ("executed", "4", "3")),
        ({"chunk": 0}, ("chunk",)),
        ({"chunk": 4}, ()),
        ({"state_size": "59"}, ("state_size",)),
        ({"state_elements": [0]}, ("state_elements", "[0]")),
        ({"state_elements": [*range(58, -1, -1)]}, ("state_elements", "[58")),
        ({"tasks": TASKS[:2]}, ("62", "61")),
        ({"tasks": [3, 4, 5]}, ("tasks",)),
        ({"algorithm": "flow"}, ("algorithm",)),
    ],
    ids=str,
)
def test_metadata_that_do_not_fit_are_refused(changes, shown, tmp_path):
    policy, path = make(), tmp_path / "policy.npz"
    object.__setattr__(policy, "metadata", {**policy.metadata, **changes})
    policy.save(path)
    with refused(ValueError, "policy.npz", *shown):
        load_policy(path)


@pytest.mark.parametrize(
    ("change", "shown"),
    [
        (lambda arrays: arrays.pop("input_mean"), ["input_mean"]),
        (lambda arrays: arrays.update(more=np.ones(2, np.float32)), ["more"]),
        (lambda arrays: arrays.update({"network.output.bias": np.ones(27)}), ["float32"]),
        (lambda arrays: arrays["network.output.bias"].fill(np.nan), ["finite"]),
        (lambda arrays: arrays["input_deviation"].fill(0), ["positive"]),
        (lambda arrays: arrays.update({"network.blocks.0.norm.bias": np.ones(2, np.float32)}), ["shapes"]),
    ],
)
def test_arrays_that_do_not_fit_are_refused(change, shown):
    policy = make()
    arrays = {name: array.copy() for name, array in policy.arrays.items()}
    change(arrays)
    with refused(ValueError, *shown):
        ChunkPolicy.from_arrays(arrays, policy.metadata)


def test_silu_of_large_values():
    values = np.array([-1e30, -100.0, 0.0, 100.0, 1e30], np.float32)
    with np.errstate(all="raise", under="ignore"):
        np.testing.assert_allclose(silu(values), [0.0, 0.0, 0.0, 100.0, 1e30], atol=1e-30)


@pytest.mark.parametrize("shape", [(5, 6), (6, 5), (1, 2)])
@pytest.mark.parametrize("size", [1, 3, 5])
def test_a_convolution_is_the_rectified_sum_of_weighted_neighbours_of_every_second_pixel(shape, size):
    generator = np.random.default_rng(0)
    values = generator.standard_normal((2, *shape), np.float32)
    layer = Convolution(
        generator.standard_normal((3, 2, size, size), np.float32), generator.standard_normal(3, np.float32)
    )
    expected = np.zeros((3, (shape[0] + 1) // 2, (shape[1] + 1) // 2))
    for n, row, column in np.ndindex(*expected.shape):
        total = float(layer.bias[n])
        for m, i, j in np.ndindex(2, size, size):
            y, x = 2 * row + i - size // 2, 2 * column + j - size // 2
            if 0 <= y < shape[0] and 0 <= x < shape[1]:
                total += float(layer.weight[n, m, i, j]) * float(values[m, y, x])
        expected[n, row, column] = max(total, 0.0)
    np.testing.assert_allclose(layer(values), expected, rtol=1e-4, atol=1e-5)


def test_a_policy_that_sees_is_loaded_unchanged(tmp_path):
    policy, path = make_seeing(), tmp_path / "policy.npz"
    policy.save(path)
    loaded, pictures = load_policy(path), np.random.default_rng(1).integers(0, 256, (2, 9, 12, 3), np.uint8)
    actions = [each.predict(np.ones(18 + len(TASKS)), pictures) for each in (policy, loaded)]
    np.testing.assert_array_equal(*actions)
    other = policy.predict(np.ones(18 + len(TASKS)), 255 - pictures)
    assert np.abs(other - actions[0]).max() > 1e-4


@pytest.mark.full
@pytest.mark.rendering
def test_a_policy_that_sees_takes_the_pictures_and_the_robots_part_of_the_state(monkeypatch):
    policy, seen = make_seeing(), []
    monkeypatch.setattr(
        ChunkPolicy, "predict", lambda self, *arguments: seen.append(arguments) or np.zeros((CHUNK, ACTION))
    )
    with suite.load("kitchen", "kettle", {"cameras": CAMERAS, "image_size": [9, 12]}) as environment:
        timestep = environment.reset()
        policy.episode(environment.task)(timestep)
    ((inputs, pictures),) = seen
    robot = [timestep.observation[f"franka/joint_{kind}"] for kind in ("positions", "velocities")]
    np.testing.assert_array_equal(inputs, np.concatenate([*robot, [1.0, 0.0, 0.0]]))
    for picture, camera in zip(pictures, CAMERAS, strict=True):
        np.testing.assert_array_equal(picture, timestep.observation[camera])


@pytest.mark.full
@pytest.mark.parametrize(
    "arguments", [{}, {"cameras": CAMERAS[:1], "image_size": [9, 12]}, {"cameras": CAMERAS, "image_size": [12, 9]}]
)
def test_pictures_of_other_cameras_or_sizes_are_refused(arguments):
    environment = suite.load("kitchen", "kettle", {"visuals": bool(arguments), **arguments})
    with refused(ValueError, "pictures of", "12x9"):
        make_seeing().check_fits(environment.task)


@pytest.mark.parametrize(
    ("changes", "shown"),
    [
        ({"cameras": CAMERAS[:1]}, ["encoders"]),
        ({"cameras": "workspace"}, ["cameras"]),
        ({"image_size": [9]}, ["image_size"]),
        ({"image_size": [9, 15]}, ["size"]),
        ({"image_size": None}, ["image_size"]),
    ],
    ids=str,
)
def test_metadata_on_cameras_are_checked(changes, shown):
    with refused(ValueError, *shown):
        make_seeing(**changes)


@pytest.mark.parametrize(
    ("change", "shown"),
    [
        (lambda arrays: arrays.pop("encoders.1.output.bias"), ["encoders.1.output.bias"]),
        (lambda arrays: arrays.update({"encoders.0.extra": np.ones(2, np.float32)}), ["encoders.0.extra"]),
        (lambda arrays: arrays["encoders.0.output.bias"].fill(np.inf), ["finite"]),
        (
            lambda arrays: arrays.update({"encoders.0.convolutions.0.weight": np.ones((2, 3, 3, 2), np.float32)}),
            ["(2, 3, 3, 2)"],
        ),
        (
            lambda arrays: arrays.update({"encoders.0.convolutions.0.weight": np.ones((2, 3, 2, 2), np.float32)}),
            ["size of 2"],
        ),
        (lambda arrays: arrays.update({"encoders.0.output.weight": np.ones(60, np.float32)}), ["(60,)"]),
    ],
)
def test_arrays_of_encoders_that_do_not_fit_are_refused(change, shown):
    policy = make_seeing()
    arrays = {name: array.copy() for name, array in policy.arrays.items()}
    change(arrays)
    with refused(ValueError, *shown):
        ChunkPolicy.from_arrays(arrays, policy.metadata)


@pytest.mark.full
def test_where_pictures_are_observed_the_policy_that_comes_with_the_package_sees(monkeypatch, tmp_path):
    kitchen_file = shipped_as("kitchen")
    monkeypatch.setattr(policy_files, "SHIPPED", tmp_path)
    make_seeing().save(tmp_path / "pixels.npz")
    shutil.copy(kitchen_file, tmp_path)
    for arguments, name in (
        ({"cameras": CAMERAS, "image_size": [9, 12]}, "pixels"),
        ({"cameras": [*CAMERAS, "overview"], "image_size": [9, 12]}, "pixels"),
        ({"cameras": CAMERAS, "image_size": [12, 9]}, "kitchen"),
        ({"cameras": CAMERAS[:1], "image_size": [9, 12]}, "kitchen"),
        ({"visuals": False}, "kitchen"),
    ):
        with suite.load("kitchen", "all", arguments) as environment:
            assert shipped(environment.task).stem == name
