"""The task of generated kitchens: requests, starts, rewards, ends, slots, noise, instructions, saved states."""

import itertools
import json

import gymnasium
import numpy as np
import pytest
from helpers.errors import refused

from kitchen_suite import suite
from kitchen_suite.commands import record, replay, rollout
from kitchen_suite.entities.fixtures import PART_KINDS
from kitchen_suite.entities.generated_kitchen import MAX_PARTS
from kitchen_suite.physics_names import FAST
from kitchen_suite.tasks.generated_kitchens import mdp
from kitchen_suite.tasks.generated_kitchens.mdp import CLOSED, OPEN, SIZE, SLICES
from kitchen_suite.tasks.generated_kitchens.requests import VERBS
from kitchen_suite.tasks.generated_kitchens.slots import NOISE_SIZE, SLOT_SIZE, SLOT_SLICES

# A kitchen with an oven, a hood, a kettle, drawers and doors, and one with a stove, drawers and doors.
ROWS = [
    {"side": "back", "level": "base", "distance": 0.05, "start": -0.5, "fixtures": [{"kind": "oven"}]},
    {"side": "back", "level": "wall", "distance": 0.57, "start": -0.5, "height": 2.164, "fixtures": [{"kind": "hood"}]},
    {
        "side": "right",
        "level": "base",
        "distance": 0.6,
        "start": -0.3,
        "fixtures": [{"kind": "drawers", "width": 0.45, "height": 0.31, "count": 2, "handle": "bar"}],
    },
    {
        "side": "left",
        "level": "tall",
        "distance": 0.9,
        "start": -0.2,
        "fixtures": [{"kind": "tall_door", "width": 0.4, "handle": "knob", "hinge": "left"}],
    },
]
MINE = {"counter_height": 1.6, "style": "navy", "kettle": True, "rows": ROWS}
DRAWERS = {"counter_height": 1.7, "style": "oak", "rows": ROWS[2:3]}
NO_NOISE = {"robot_noise_ratio": 0.0, "object_noise_ratio": 0.0}
TASKS = {
    "open": ("open drawers_1/drawer_1", "open drawers_1/drawer_2", "open tall_door_1/left_door"),
    "close": ("close drawers_1/drawer_1", "close drawers_1/drawer_2", "close tall_door_1/left_door"),
    "turn_on": (*(f"turn_on oven_1/knob_Joint_{k}" for k in (4, 3, 2, 1)), "turn_on hood_1/light_switch"),
    "turn_off": (*(f"turn_off oven_1/knob_Joint_{k}" for k in (4, 3, 2, 1)), "turn_off hood_1/light_switch"),
    "move_kettle": ("move_kettle kettle/handle",),
}
DRAWER, DOOR, SWITCH, KETTLE = 5, 7, 4, 8


def load(task="any", design=MINE, **arguments):
    return suite.load("kitchens", task, {"design": design, "visuals": False, "random": 0, **arguments})


def start(environment, *tasks):
    """Begins an episode that asks for some tasks; returns its first timestep."""
    task = environment.task
    task.follow(task.checked_reset({"requested_tasks": list(tasks)}))
    return environment.reset()


def move(environment, positions):
    """Moves joints by the number of their part [rad, m], and makes a control step."""
    scene, physics = environment.task.scene, environment.physics
    for k, position in positions.items():
        name, part = scene.parts[k]
        physics.bind(scene.props[name].mjcf_model.find("joint", part.joint)).qpos = position
    return environment.step(np.zeros(9))


def slots_of(timestep):
    """Returns the slots `(K, 21)` of an observation."""
    return timestep.observation["slots"].reshape(MAX_PARTS, SLOT_SIZE)


def test_the_parts_of_observation_slots_and_noise_are_end_to_end():
    for parts, size in ((SLICES, SIZE), (SLOT_SLICES, SLOT_SIZE)):
        stops = [part.stop for part in parts.values()]
        assert [part.start for part in parts.values()] == [0, *stops[:-1]]
        assert stops[-1] == size
    assert (SIZE, NOISE_SIZE) == (363, 82)


@pytest.mark.parametrize(
    ("task", "arguments", "name"),
    [
        ("open", {}, "kitchens_open"),
        ("open", {"reward": "dense"}, "kitchens_open_dense"),
        ("any", {}, "kitchens_open_close_turn_on_turn_off_move_kettle"),
    ],
)
def test_a_trained_policy_is_named_by_what_it_is_asked_for(task, arguments, name):
    assert load(task, **arguments).task.policy_inputs.names == (name,)


@pytest.mark.full
def test_fewer_slots_are_the_first_ones():
    full, few = load("any_2"), load("any_2", num_slots=2)
    observed = []
    for environment in (full, few):
        environment.reset()
        observed.append(environment.step(np.full(9, 0.1)).observation)
    assert few.task.requested_tasks == full.task.requested_tasks
    assert few.observation_spec()["slots"].shape == (2 * SLOT_SIZE,)
    assert observed[1].keys() == observed[0].keys()
    for key, value in observed[1].items():
        np.testing.assert_array_equal(value, observed[0][key][: value.size])
    assert few.task.policy_inputs.size == mdp.size(2) == sum(value.size for value in observed[1].values()) < SIZE


@pytest.mark.full
def test_what_is_requested_has_a_slot():
    with refused(ValueError, "num_slots must be at least 4, the parts that are requested, got 3"):
        load("any_4", num_slots=3)
    with refused(ValueError, "num_slots must be at most 16"):
        load(num_slots=17)
    requests = load(num_slots=1).task.requests
    with refused(ValueError, "num_slots must be at least 2"):
        requests.checked({"requested_tasks": ["turn_on hood_1/light_switch", "open tall_door_1/left_door"]})


@pytest.mark.full
@pytest.mark.parametrize("verb", VERBS)
def test_a_task_is_for_the_parts_of_its_kinds(verb):
    environment = load(verb)
    assert environment.task.requests.tasks == TASKS[verb]
    assert environment.physics.timestep() == pytest.approx(0.08 / 6)
    assert environment.task.scene.physics == FAST
    seen = set()
    for _ in range(20):
        environment.reset()
        (task,) = environment.task.requested_tasks
        seen.add(task)
    # The least likely outcome is five tasks of which one is not drawn in 20 episodes, 0.8^20 = 1 %; the seed is fixed.
    assert seen == set(TASKS[verb])


@pytest.mark.full
def test_any_asks_for_every_task_and_sets_for_as_many():
    assert set(load().task.requests.tasks) == {task for tasks in TASKS.values() for task in tasks}
    for count in (2, 4):
        environment = load(f"any_{count}")
        for _ in range(5):
            environment.reset()
            names = environment.task.requested_tasks
            parts = {name.split()[1] for name in names}
            assert len(names) == len(parts) == count
            # What is not asked for has no goal.
            assert not environment.task.state.goal[environment.task.state.order < 0].any()
            assert environment.task.instruction.count(", then ") == count - 1


@pytest.mark.parametrize(
    ("task", "options", "error", "message"),
    [
        ("any", "open drawers_1/drawer_1", TypeError, "requested_tasks must be"),
        ("any", ["open drawers_2/drawer_1"], ValueError, "(did you mean 'open drawers_1/drawer_1'?)"),
        ("open", ["close drawers_1/drawer_1"], ValueError, "'close drawers_1/drawer_1' does not exist"),
        (
            "any",
            [f"{verb} drawers_1/drawer_1" for verb in ("open", "close")],
            ValueError,
            "must not ask to open and to",
        ),
        ("any", ["open drawers_1/drawer_1"] * 2, ValueError, "requested_tasks"),
        ("any", [], ValueError, "requested_tasks"),
    ],
)
def test_a_wrong_request_is_refused(task, options, error, message):
    env = gymnasium.make("KitchenSuite/Kitchens-v1", **suite.task_arguments("kitchens", task), design=MINE)
    with refused(error, message):
        env.reset(options={"requested_tasks": options})


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"verbs": ("open", "push")}, ValueError, "verb 'push' does not exist"),
        ({"verbs": ()}, ValueError, "verbs is empty; name at least one"),
        ({"verbs": "open"}, TypeError, "verbs must be"),
        ({"verbs": ("turn_on",), "design": DRAWERS}, ValueError, "has nothing to turn_on: it has drawer"),
        ({"tasks_per_episode": 3, "design": DRAWERS}, ValueError, "tasks_per_episode is 3, but there are 2"),
        ({"reward": "sparser"}, ValueError, "reward 'sparser' does not exist"),
        ({"robot_noise_ratio": -1}, ValueError, "robot_noise_ratio"),
        ({"object_noise_ratio": "much"}, TypeError, "object_noise_ratio"),
        ({"split": "val"}, ValueError, "split 'val' does not exist"),
        ({"certified": 1}, TypeError, "certified"),
    ],
)
def test_wrong_arguments_are_refused(arguments, error, message):
    with refused(error, message):
        gymnasium.make("KitchenSuite/Kitchens-v1", **{"design": MINE, **arguments})


def test_parts_to_be_closed_or_turned_off_begin_open_or_on_with_what_follows_them():
    environment = load(**NO_NOISE)
    start(environment, "close drawers_1/drawer_2", "turn_off hood_1/light_switch", "turn_off oven_1/knob_Joint_4")
    openings = environment.task.state.openings
    np.testing.assert_allclose(openings[:9], [1, 0, 0, 0, 1, 0, 1, 0, 0], atol=1e-9)
    physics, props = environment.physics, environment.task.scene.props
    lamp = physics.bind(props["hood_1"].mjcf_model.find("joint", "light_joint")).qpos
    burner = physics.bind(props["oven_1"].mjcf_model.find("joint", "top_left_burner")).qpos
    np.testing.assert_allclose(lamp, -0.69 / 14, atol=2e-4)
    np.testing.assert_allclose(burner, -0.88 / 174, atol=2e-4)
    # It stays there, at rest.
    for _ in range(10):
        environment.step(np.zeros(9))
    np.testing.assert_allclose(environment.task.state.openings[:9], openings[:9], atol=0.02)
    start(environment, "open drawers_1/drawer_2")
    np.testing.assert_allclose(environment.task.state.openings[:9], 0.0, atol=1e-9)


def test_the_start_pose_has_noise_on_the_arm_alone():
    environment = load()
    poses = []
    for _ in range(20):
        environment.reset()
        poses.append(environment.physics.bind(environment.task.robot.joints).qpos.copy())
    spread = np.ptp(poses, axis=0)
    # Of 0.1 rad at most, which 20 draws leave unfilled by a third at most.
    assert (spread[:7] > 0.065).all()
    assert (spread[:7] <= 0.1).all()
    np.testing.assert_array_equal(spread[7:], 0.0)


@pytest.mark.parametrize(("reward", "continues"), [("sparse", False), ("dense", True), ("dense_gain", False)])
def test_an_episode_ends_once_everything_has_been_completed(reward, continues):
    environment = load("any_2", reward=reward)
    start(environment, "open drawers_1/drawer_1", "turn_on hood_1/light_switch")
    rewards = [move(environment, {DRAWER: 0.2 * (OPEN - 0.05)}).reward, move(environment, {DRAWER: 0.2}).reward]
    metrics = environment.task.episode_metrics
    assert metrics == {"success": False, "tasks_completed": {"open drawers_1/drawer_1": 2}}
    timestep = move(environment, {SWITCH: -0.69})
    rewards.append(timestep.reward)
    assert environment.task.episode_metrics["success"]
    assert environment.task.episode_metrics["tasks_completed"] == {
        "turn_on hood_1/light_switch": 3,
        "open drawers_1/drawer_1": 2,
    }
    assert timestep.last() != continues
    assert timestep.discount == (1.0 if continues else 0.0)
    if reward == "sparse":
        assert rewards == [0.0, 1.0, 1.0]
    elif reward == "dense_gain":
        # The potentials of both tasks, from 0 to 1.
        assert sum(rewards) == pytest.approx(2.0)
    else:
        assert 0.5 < rewards[0] < rewards[1] < rewards[2] == pytest.approx(2.0)


def test_closing_counts_below_its_share_and_what_is_not_asked_for_never():
    environment = load()
    start(environment, "close tall_door_1/left_door")
    assert move(environment, {DOOR: -0.9 * (CLOSED + 0.05), DRAWER: 0.2}).reward == 0.0
    assert not environment.task.state.progress.completed.any()
    timestep = move(environment, {DOOR: -0.9 * (CLOSED - 0.05)})
    assert (timestep.reward, timestep.discount) == (1.0, 0.0)


def test_what_has_been_undone_or_was_not_asked_for_is_not_complete():
    environment = load()
    start(environment, "open drawers_1/drawer_1", "turn_on hood_1/light_switch")
    found = []
    for opening in (0.2, 0.0):
        move(environment, {DRAWER: opening, DRAWER + 1: 0.2})
        found.append(np.flatnonzero(environment.task.mdp.complete(environment.task.state)).tolist())
    assert found == [[DRAWER], []]


def test_progress_is_the_share_of_the_way_from_the_start_to_the_goal():
    environment = load("close", reward="dense")
    start(environment, "close tall_door_1/left_door")
    for opening in (0.9, 0.5, 0.25):
        move(environment, {DOOR: -0.9 * opening})
        assert environment.task.reward_terms["progress"] == pytest.approx(0.75 * (1.0 - opening))


def test_the_joints_of_what_is_requested_are_known():
    environment = load("any_2")
    start(environment, "open drawers_1/drawer_1", "turn_on hood_1/light_switch")
    task = environment.task
    joints = task.mdp.requested_joints(task.scene, task.state)
    assert {joint.full_identifier for joint in joints} == {"drawers_1/drawer_1", "hood_1/light_switch"}


@pytest.mark.full
def test_the_kettle_is_moved_once_it_is_on_the_back_burner():
    environment = load("move_kettle", **NO_NOISE)
    timestep = environment.reset()
    handle = slots_of(timestep)[0, SLOT_SLICES["position"]]
    physics = environment.physics
    (free,) = environment.task.scene.props["kettle"].joints
    physics.bind(free).qpos[:2] += (0.0, 0.4 * (OPEN + 0.05))
    timestep = environment.step(np.zeros(9))
    assert (timestep.reward, timestep.discount) == (1.0, 0.0)
    slot = slots_of(timestep)[0]
    assert slot[SLOT_SLICES["opening"]] == pytest.approx(OPEN + 0.05, abs=0.01)
    np.testing.assert_allclose(slot[SLOT_SLICES["position"]] - handle, (0, 0.32, 0), atol=0.01)


@pytest.mark.full
@pytest.mark.parametrize("reward", ["sparse", "dense", "dense_gain"])
def test_the_terms_of_a_reward_sum_to_it(reward):
    environment = load("any_4", reward=reward)
    environment.reset()
    rng = np.random.default_rng(0)
    for k in range(8):
        timestep = move(environment, {k: environment.task.scene.parts[k][1].opened * rng.random()})
        assert timestep.reward == pytest.approx(sum(environment.task.reward_terms.values()))
        infos = environment.task.mdp.info(environment.task.state)
        terms = {name for name in infos if name.startswith("reward/")}
        expected = set() if reward == "sparse" else {f"reward/{name}" for name in environment.task.reward_terms}
        assert terms == expected


def test_slots_begin_with_the_requested_parts_in_their_order():
    environment = load("any_2", **NO_NOISE)
    timestep = start(environment, "turn_on hood_1/light_switch", "close drawers_1/drawer_2")
    slots, parts = slots_of(timestep), [part for _, part in environment.task.scene.parts]
    order = [SWITCH, DRAWER + 1, *(k for k in range(len(parts)) if k not in (SWITCH, DRAWER + 1))]
    kinds = [PART_KINDS[row.argmax()] for row in slots[: len(parts), SLOT_SLICES["kind"]]]
    assert kinds == [parts[k].kind for k in order]
    np.testing.assert_array_equal(slots[:, SLOT_SLICES["requested"]].ravel(), [1, 1, *[0] * 14])
    np.testing.assert_array_equal(slots[:2, SLOT_SLICES["goal"]].ravel(), [1, 0])
    np.testing.assert_allclose(slots[:3, SLOT_SLICES["opening"]].ravel(), [0, 1, 0], atol=1e-6)
    np.testing.assert_array_equal(slots[len(parts) :], 0.0)
    info = environment.task.mdp.info(environment.task.state)
    assert info["requested_order"].tolist() == [-1, -1, -1, -1, 0, -1, 1, *[-1] * 9]


def test_the_observation_is_that_of_the_physics():
    environment = load("any", **NO_NOISE)
    start(environment, "open drawers_1/drawer_1")
    scene, physics = environment.task.scene, environment.physics
    for action in np.random.default_rng(1).uniform(-1, 1, (5, 9)):
        environment.step(action)
    jointed = {k: part for k, (_, part) in enumerate(scene.parts) if part.joint}
    timestep = move(environment, {k: 0.5 * part.opened for k, part in jointed.items()})
    # Positions of bodies are those before the last physics step.
    physics.forward()
    robot, hand = physics.bind(scene.robot.joints), physics.bind(scene.robot.end_effector)
    base = np.array([0.0, 0.0, 1.8])
    expected = {
        "joint_positions": robot.qpos,
        "joint_velocities": robot.qvel,
        "hand_pose": [*(hand.xpos - base), *hand.xmat[[0, 3, 6]], *hand.xmat[[1, 4, 7]]],
    }
    for name, values in expected.items():
        np.testing.assert_allclose(timestep.observation[name], values, atol=1e-5)
    assert list(timestep.observation) == list(SLICES)
    first = DRAWER
    order = [first, *(k for k in range(len(scene.parts)) if k != first)]
    for slot, k in zip(slots_of(timestep), order, strict=False):
        name, part = scene.parts[k]
        site = physics.bind(scene.props[name].mjcf_model.find("site", part.handle))
        np.testing.assert_allclose(slot[SLOT_SLICES["position"]], site.xpos - base, atol=1e-5)
        np.testing.assert_allclose(slot[SLOT_SLICES["offset"]], site.xpos - hand.xpos, atol=1e-5)
        if k in jointed:
            joint = physics.bind(scene.props[name].mjcf_model.find("joint", part.joint))
            np.testing.assert_allclose(slot[SLOT_SLICES["opening"]], joint.qpos / part.opened, atol=1e-5)
        if name.startswith(("drawers", "tall_door")):
            frame = site.xmat.reshape(3, 3)
            np.testing.assert_allclose(slot[SLOT_SLICES["into"]], frame[:, 2], atol=1e-5)
            along = slot[SLOT_SLICES["along"]]
            # In either sense.
            np.testing.assert_allclose(along * np.sign(along @ frame[:, 1]), frame[:, 1], atol=1e-5)


def test_noise_is_on_joints_handles_and_openings_and_within_its_bounds():
    quiet, noisy = load(**NO_NOISE), load(robot_noise_ratio=0.01, object_noise_ratio=0.02)
    differences = []
    for _ in range(20):
        one, other = (start(each, "open drawers_1/drawer_1").observation for each in (quiet, noisy))
        differences.append({name: other[name] - one[name] for name in SLICES})
    slots = np.array([each["slots"].reshape(MAX_PARTS, SLOT_SIZE) for each in differences])
    joints = np.array([np.append(each["joint_positions"], each["joint_velocities"]) for each in differences])
    assert 0.0009 < np.abs(joints).max() <= 0.0010001
    assert 0.0035 < np.abs(slots[:, :9, SLOT_SLICES["position"]]).max() <= 0.0040001
    np.testing.assert_allclose(slots[..., SLOT_SLICES["position"]], slots[..., SLOT_SLICES["offset"]], atol=1e-6)
    assert 0.009 < np.abs(slots[:, :9, SLOT_SLICES["opening"]]).max() <= 0.0100001
    for name in ("kind", "into", "along", "goal", "requested"):
        np.testing.assert_array_equal(slots[..., SLOT_SLICES[name]], 0.0)
    np.testing.assert_array_equal(slots[:, 9:], 0.0)
    np.testing.assert_array_equal([each["hand_pose"] for each in differences], 0.0)
    before = noisy.task.state.noise
    noisy.step(np.zeros(9))
    noise = noisy.task.state.noise
    assert (np.abs(noise) <= noisy.task.mdp.noise_scale).all()
    assert (noise[before != 0.0] != before[before != 0.0]).all()


@pytest.mark.parametrize("number", range(12))
def test_every_task_of_a_kitchen_has_four_phrases_of_its_own(number):
    environment = load(design=number)
    task, phrases = environment.task, []
    for k, opens in itertools.product(range(len(task.scene.parts)), (False, True)):
        order = np.where(np.arange(MAX_PARTS) == k, 0, -1)
        kind = task.scene.parts[k][1].kind
        if opens or kind != "kettle":
            instructions = task.instructions_of(order, np.full(MAX_PARTS, float(opens)))
            assert len(set(instructions)) == len(instructions) >= 4
            phrases += instructions
    assert len(set(phrases)) == len(phrases)


def test_words_tell_many_cabinets_and_those_above_one_another_apart():
    door = {"kind": "wall_doors", "width": 0.3, "height": 0.3, "count": 1, "handle": "bar", "hinge": "left"}
    row = {"side": "back", "level": "wall", "distance": 0.55, "start": -0.45, "fixtures": [door] * 3}
    rows = [{**row, "height": height} for height in (1.5, 1.85, 2.2)]
    many = load("open", {"counter_height": 1.7, "style": "oak", "rows": rows}).task
    sentences = [many.instructions_of(np.arange(9) - k, np.ones(9))[0] for k in range(9)]
    assert len({sentence.partition(",")[0] for sentence in sentences}) == 9
    two = [{**row, "fixtures": [door], "height": height} for height in (2.2, 1.85)]
    above = load("open", {"counter_height": 1.7, "style": "oak", "rows": two}).task
    start_words = [above.instructions_of(order, np.ones(2))[0] for order in np.array([[0, -1], [-1, 0]])]
    assert start_words == ["open the door of the upper wall cabinet", "open the door of the lower wall cabinet"]


def test_instructions_say_what_is_asked_for():
    environment = load("any_2")
    start(environment, "open drawers_1/drawer_2", "turn_off oven_1/knob_Joint_2")
    expected = "open the bottom drawer of the cabinet, then turn off the lower left knob of the oven"
    assert environment.task.instruction == expected
    start(environment, "move_kettle kettle/handle", "close tall_door_1/left_door")
    assert environment.task.instruction == "move the kettle to the back burner, then close the door of the tall cabinet"


@pytest.mark.full
@pytest.mark.parametrize("reward", ["sparse", "dense"])
def test_a_state_continues_to_the_bit(reward):
    arguments = {"design": MINE, "reward": reward, **suite.task_arguments("kitchens", "any_2")}
    one, other = (gymnasium.make("KitchenSuite/Kitchens-v1", **arguments) for _ in range(2))
    one.reset(seed=3)
    other.reset(seed=4)
    one.step(np.full(9, 0.5))
    other.unwrapped.set_state(one.unwrapped.get_state())
    assert one.unwrapped.composer_task.requested_tasks == other.unwrapped.composer_task.requested_tasks
    for action in np.random.default_rng(0).uniform(-1, 1, (5, 9)):
        (first, *signals, info), (second, *others, twin) = one.step(action), other.step(action)
        np.testing.assert_array_equal(first, second)
        assert signals == others
        assert info.keys() == twin.keys()
        for name, value in info.items():
            np.testing.assert_array_equal(value, twin[name], name)


def test_requests_are_recorded_and_asked_for_again():
    environment = load("any_4")
    environment.reset()
    names = environment.task.requested_tasks
    infos = environment.task.mdp.info(environment.task.state)
    arrays = {f"info/{name}": infos[name][np.newaxis] for name in ("requested_order", "goal_openings")}
    options = environment.task.requests.recorded(arrays)
    assert options == {"requested_tasks": names}
    start(environment, *options["requested_tasks"])
    assert environment.task.requested_tasks == names
    assert environment.task.requests.recorded({}) == {}
    orders, goals = arrays.values()
    for wrong in ((orders[:, :0], goals), (orders * 0, goals), (orders, goals[:, :0]), (orders, 1 - goals)):
        with pytest.raises(ValueError, match="recorded "):
            environment.task.requests.recorded(dict(zip(arrays, wrong, strict=True)))


@pytest.mark.full
def test_the_commands_play_record_and_replay_it(folder, capsys):
    (folder / "mine.json").write_text(json.dumps(MINE), encoding="utf-8")
    domain = ["--domain_name=kitchens", "--task_name=any_2", "--max_episode_steps=5", "--variations=start,dynamics"]
    for design in ('{"design": "mine.json"}', '{"design": 3, "split": "test"}'):
        arguments = [*domain, f"--task_kwargs={design}"]
        name = str(len(design))
        assert rollout.main([*arguments, "--num_episodes=1", f"--output=rolled_{name}"]) == 0
        assert record.main([*arguments, "--num_episodes=3", f"--output=runs_{name}", "--num_threads=1"]) == 0
        for output in ("rolled", "runs"):
            capsys.readouterr()
            assert replay.main([f"{output}_{name}"]) == 0
            assert "episodes are equal" in capsys.readouterr().out


def test_a_command_refuses_an_impossible_design_in_one_line(folder, refusal):
    (folder / "mine.json").write_text(json.dumps({**MINE, "style": "blue"}), encoding="utf-8")
    error = refusal(rollout, "--domain_name=kitchens", '--task_kwargs={"design": "mine.json"}')
    assert "style 'blue' does not exist" in error
