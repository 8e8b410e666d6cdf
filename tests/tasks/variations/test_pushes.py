"""Pushes: when they come, what they move, and that single and vectorised episodes have the same."""

import dataclasses

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from helpers.sweeps import brief

from kitchen_suite import suite
from kitchen_suite.entities.joints import addresses
from kitchen_suite.gymnasium_env.generated_kitchens import GeneratedKitchenEnv
from kitchen_suite.tasks import GOALS
from kitchen_suite.tasks.episode.pushes import PUSH, Push, Pusher, _Joints
from kitchen_suite.tasks.simulation import PhysicsSimulation

ARM = slice(0, 7)
# The second joint starts at the lower end of its range.
OFFSETS = [0.05, 0.1, 0.1, -0.15, 0.2, 0.25, -0.3]

# Doors and kettle count as done where they start, so that a push can undo them.
EASY = {"tasks_to_complete": ["microwave", "kettle"], "threshold": 3.0, "terminate_on_tasks_completed": False}


def load(domain="kitchen", push=None, random=0, **options):
    task = next(iter(suite.DOMAINS[domain].tasks))
    variations = {f"push/{name}": value for name, value in (push or {}).items()} or ["push"]
    return suite.load(domain, task, {"random": random, "visuals": False, "variations": variations, **options})


def before_physics(environment, action, step):
    """Makes control steps; returns all positions and velocities at the start of the last one, before its physics."""
    physics, seen, write = environment.physics, [], PhysicsSimulation.write

    def recording(self, field, columns, values):
        if field == "ctrl":
            seen.append((np.array(physics.data.qpos), np.array(physics.data.qvel)))
        write(self, field, columns, values)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(PhysicsSimulation, "write", recording)
        for _ in range(step):
            environment.step(action)
    return seen[-1]


def positions_before_physics(environment, action, step):
    return before_physics(environment, action, step)[0]


class Arrays:
    """A simulation whose fields are arrays."""

    def __init__(self, *axes):
        self.fields = {"qpos": np.full((*axes, 6), 0.5), "qvel": np.full((*axes, 6), 2.0)}
        self.evaluations = 0

    def read(self, field, columns):
        return self.fields[field][..., columns]

    def write(self, field, columns, values):
        self.fields[field][..., columns] = values

    def evaluate(self):
        self.evaluations += 1


# Two joints of an arm, and three tasks with one, two and one joint.
PUSHER = Pusher(
    arm=_Joints(np.array([0, 1]), np.array([0, 1])),
    low=np.array([-1.0, -0.2]),
    high=np.array([0.6, 1.0]),
    tasks=[_Joints(np.array(columns), np.array(columns)) for columns in ([2], [3, 4], [5])],
    complete=lambda state: state,
)
STARTS = np.array([0.1, 0.2, 0.3, 0.4])


def push_of(rows, *, steps=1, due=1.0, undoes=True, which=0.0, offsets=0.0):
    values = {"steps": steps, "due": due, "undoes": undoes, "which": which}
    return Push(
        **{name: np.broadcast_to(value, rows) for name, value in values.items()},
        offsets=np.broadcast_to(offsets, (rows, 7)),
        start=np.broadcast_to(STARTS, (rows, 4)),
    )


@pytest.mark.parametrize(
    ("which", "expected"),
    [
        # Of none, of the third alone, of the second and the third, and of all three tasks that are complete.
        (0.0, [None, 2, 1, 0]),
        (0.3, [None, 2, 1, 0]),
        (0.5, [None, 2, 2, 1]),
        (0.7, [None, 2, 2, 2]),
        (1.0, [None, 2, 2, 2]),
    ],
)
def test_low_numbers_undo_the_first_of_the_completed_tasks(which, expected):
    complete = np.array([[False, False, False], [False, False, True], [False, True, True], [True, True, True]])
    simulation = Arrays(4)
    push = push_of(4, which=which)
    with np.errstate(divide="raise", invalid="raise"):
        after = PUSHER.push(simulation, push, complete)
    for row, place in enumerate(expected):
        positions, velocities = np.full(6, 0.5), np.full(6, 2.0)
        if place is None:
            # The arm instead, at rest.
            velocities[:2] = 0.0
        else:
            columns = PUSHER.tasks[place].qpos
            positions[columns] = STARTS[columns - 2]
            velocities[columns] = 0.0
        np.testing.assert_array_equal(simulation.fields["qpos"][row], positions)
        np.testing.assert_array_equal(simulation.fields["qvel"][row], velocities)
    np.testing.assert_array_equal(after.steps, 2)
    assert simulation.evaluations == 1


def test_a_push_comes_once_and_only_where_there_is_one():
    # The step of a push need not be whole; 0 is none.
    due = np.array([0.0, 2.0, 2.7, 3.0])
    simulation, push = Arrays(4), push_of(4, steps=0, due=due, undoes=False, offsets=[0.3, -0.9, 0, 0, 0, 0, 0])
    pushed = np.zeros(4, int)
    for _ in range(5):
        simulation.fields["qpos"][:] = 0.5
        with np.errstate(divide="raise", invalid="raise"):
            push = PUSHER.push(simulation, push, np.full((4, 3), True))
        moved = (simulation.fields["qpos"] != 0.5).any(axis=-1)
        # Within the ranges of the joints.
        np.testing.assert_array_equal(simulation.fields["qpos"][moved, :2], np.tile([0.6, -0.2], (moved.sum(), 1)))
        np.testing.assert_array_equal(simulation.fields["qpos"][:, 2:], 0.5)
        pushed += moved
    np.testing.assert_array_equal(pushed, [0, 1, 1, 1])
    # What nothing has moved need not be computed anew.
    assert simulation.evaluations == 2


@pytest.mark.parametrize("undoes", [0.0, 1.0])
def test_a_push_starts_with_the_values_of_its_parameters(undoes):
    values = {"push/step": np.array(30.0), "push/undoes": np.array(undoes), "push/which": np.array(0.25)}
    push = PUSHER.start({**values, "another": np.array(1.0)}, Arrays())
    assert (push.steps, push.due, push.undoes, push.which) == (0, 30.0, bool(undoes), 0.25)
    # Parameters that do not vary are 0.
    np.testing.assert_array_equal(push.offsets, np.zeros(7))
    np.testing.assert_array_equal(push.start, [0.5] * 4)


def test_what_the_group_draws():
    seen = {parameter.name: parameter.seen for parameter in PUSH}
    assert seen.keys() == {"push/step", "push/undoes", "push/which", "push/joint_offsets"}
    np.testing.assert_array_equal(seen["push/step"].values, np.linspace(20, 120, 101))
    np.testing.assert_array_equal(seen["push/undoes"].values, [0, 1])
    np.testing.assert_array_equal(seen["push/which"].intervals, [[0, 1]])
    np.testing.assert_array_equal(seen["push/joint_offsets"].intervals, [[[-0.3] * 7, [0.3] * 7]])
    assert all(parameter.held_out is parameter.seen for parameter in PUSH)


def test_without_tasks_to_undo_the_arm_is_displaced():
    simulation = Arrays(1)
    pusher = dataclasses.replace(PUSHER, tasks=[], complete=lambda state: np.zeros(0, bool))
    push = push_of(1, offsets=0.05)
    pusher.push(simulation, push, None)
    np.testing.assert_allclose(simulation.fields["qpos"][0, :2], 0.55)


@pytest.mark.full
@pytest.mark.parametrize("domain", brief(suite.DOMAINS, ["kitchen"], full=suite.DOMAINS))
def test_the_arm_is_displaced_at_the_start_of_one_control_step(domain):
    pushed, plain = load(domain, {"step": 2, "joint_offsets": OFFSETS}), load(domain, {"step": 0})
    for environment in (pushed, plain):
        environment.reset()
    action = np.zeros(pushed.action_spec().shape)
    columns = pushed.physics.bind(pushed.task.robot.joints).qposadr
    for _ in range(2):
        before = [positions_before_physics(environment, action, 1) for environment in (pushed, plain)]
        np.testing.assert_array_equal(*before)
    (moved, velocities), (unmoved, others) = (before_physics(environment, action, 1) for environment in (pushed, plain))
    moved, unmoved = moved[columns], unmoved[columns]
    # What is displaced is at rest there.
    moving = pushed.physics.bind(pushed.task.robot.joints).dofadr
    np.testing.assert_array_equal(velocities[moving][ARM], 0.0)
    assert others[moving][ARM].any()
    np.testing.assert_allclose(moved[ARM] - unmoved[ARM], OFFSETS, atol=1e-12)
    np.testing.assert_array_equal(moved[7:], unmoved[7:])
    # Only once.
    velocity = np.abs(positions_before_physics(pushed, action, 2)[columns][ARM] - moved[ARM])
    assert velocity.max() < 0.3


def test_joints_stay_within_their_ranges():
    environment = load(push={"step": 1, "joint_offsets": {"choice": [[0.3] * 7]}})
    environment.reset()
    joints = environment.physics.bind(environment.task.robot.joints[:7])
    high = np.array(joints.range)[:, 1]
    environment.physics.data.qpos[ARM] = high - 0.1
    environment.step(np.zeros(9))
    np.testing.assert_array_equal(positions_before_physics(environment, np.zeros(9), 1)[ARM], high)


@pytest.mark.parametrize(
    ("which", "undone"), [(0.0, "microwave"), (0.49, "microwave"), (0.51, "kettle"), (1.0, "kettle")]
)
def test_one_of_the_completed_tasks_is_undone(which, undone):
    environment = load(push={"step": 2, "undoes": 1, "which": which, "joint_offsets": OFFSETS}, **EASY)
    environment.reset()
    task, physics = environment.task, environment.physics
    columns = {name: addresses(physics, GOALS[name].joints_in(task.scene))[0] for name in task.goals}
    start = np.array(physics.data.qpos)
    physics.data.qpos[columns["microwave"]] = -0.4
    physics.data.qpos[columns["kettle"][:2]] += 0.1
    for _ in range(2):
        environment.step(np.zeros(9))
    assert task.episode_task_completions == ["microwave", "kettle"]
    arm = np.array(physics.data.qpos[ARM])
    qpos = positions_before_physics(environment, np.zeros(9), 1)
    for name, indices in columns.items():
        assert np.array_equal(qpos[indices], start[indices]) == (name == undone)
    np.testing.assert_array_equal(qpos[ARM], arm)


# A generated kitchen with knobs, which burners follow, a switch, doors and a kettle.
WITH_ALL_KINDS = 3
VERBS = ("open", "turn_on", "move_kettle")


def opened(environment):
    """Moves all parts of a generated kitchen to where they are open, or on; returns columns in qpos by part."""
    task, physics = environment.task, environment.physics
    columns = [addresses(physics, joints)[0] for joints in task.mdp.task_joints(task.scene)]
    for slot, ((_, part), indices) in enumerate(zip(task.scene.parts, columns, strict=True)):
        if part.joint is None:
            # The kettle's target lies in the direction of the burner behind it.
            physics.data.qpos[indices[:3]] += part.opened * task.state.slots.into[slot]
        else:
            physics.data.qpos[indices] = [part.opened, part.opened * part.ratio][: indices.size]
    return columns


@pytest.mark.full
@pytest.mark.parametrize("physics", ["exact", "fast"])
def test_a_completed_part_of_a_generated_kitchen_is_undone(physics):
    push = {"push/step": 2, "push/undoes": 1, "push/joint_offsets": OFFSETS}
    environment = GeneratedKitchenEnv(
        WITH_ALL_KINDS, verbs=VERBS, physics=physics, reward="dense", variations=push
    ).environment
    parts = {}
    for seed in range(16):
        environment.random_state = seed
        environment.reset()
        task, start = environment.task, np.array(environment.physics.data.qpos)
        (asked,) = np.flatnonzero(task.state.requested)
        columns = opened(environment)
        for _ in range(2):
            environment.step(np.zeros(9))
        assert task.state.progress.completed[asked]
        before = np.array(environment.physics.data.qpos)
        qpos = positions_before_physics(environment, np.zeros(9), 1)
        np.testing.assert_array_equal(qpos[columns[asked]], start[columns[asked]])
        others = np.setdiff1d(np.arange(qpos.size), columns[asked])
        # Neither the arm nor any other part.
        np.testing.assert_array_equal(qpos[others], before[others])
        assert not task.state.progress.within[asked]
        parts[task.scene.parts[asked][1].kind] = columns[asked].size
    assert parts == {"knob": 2, "switch": 2, "door": 1, "kettle": 7}


@pytest.mark.full
@pytest.mark.parametrize("domain", suite.DOMAINS)
def test_what_may_be_completed_may_be_undone(domain):
    task = load(domain).task
    joints, complete = task.mdp.task_joints(task.scene), task.mdp.complete(task.state)
    assert complete.shape[-1] >= len(joints)
    assert (complete.size > 0) == (len(joints) > 0)
    assert bool(joints) == (domain in ("kitchen", "kitchens", "pick_and_place"))


@pytest.mark.full
def test_the_arm_is_displaced_where_nothing_has_been_completed():
    environment = load(push={"step": 1, "undoes": 1, "joint_offsets": OFFSETS})
    environment.reset()
    environment.step(np.zeros(9))
    before = np.array(environment.physics.data.qpos[ARM])
    np.testing.assert_allclose(positions_before_physics(environment, np.zeros(9), 1)[ARM] - before, OFFSETS, atol=1e-12)


def test_the_group_draws_from_the_episodes_stream():
    environment, same = load(random=3), load(random=3)
    drawn = []
    for _ in range(60):
        values = [each.task.variations.values for each in (environment, same) if each.reset() is not None]
        assert data_equivalence(*values, exact=True)
        drawn.append(values[0])
    steps = np.array([values["push/step"] for values in drawn])
    assert 20 <= steps.min() < 25
    assert 115 < steps.max() <= 120
    assert len(np.unique(steps)) > 30
    assert {float(values["push/undoes"]) for values in drawn} == {0.0, 1.0}
    offsets = np.array([values["push/joint_offsets"] for values in drawn])
    assert 0.28 < np.abs(offsets).max() <= 0.3
    assert not np.array_equal(offsets[0], offsets[1])


@pytest.mark.full
@pytest.mark.parametrize(
    ("domain", "settings"),
    [
        pytest.param("kitchen", {}, marks=pytest.mark.full),
        ("kitchen", {"physics": "fast", "reward": "dense_gain", **EASY}),
        pytest.param("kitchen", {"control_mode": "ee_delta_pose", **EASY}, marks=pytest.mark.full),
        pytest.param("open_cabinet", {}, marks=pytest.mark.full),
        ("microwave_table", {"control_mode": "ee_delta_pose"}),
    ],
)
def test_vectorised_episodes_have_the_pushes_of_single_ones(domain, settings):
    push = {
        "push/step": {"choice": [1, 2, 3, 4]},
        "push/undoes": {"choice": [0, 1]},
        "push/which": {"uniform": [0, 1]},
        "push/joint_offsets": {"uniform": [-0.3, 0.3]},
    }
    options = {"variations": push, "max_episode_steps": 7, **settings}
    env_id, same_step = suite.DOMAINS[domain].env_id, gymnasium.vector.AutoresetMode.SAME_STEP
    ours = gymnasium.make_vec(env_id, 3, vectorization_mode="vector_entry_point", autoreset_mode=same_step, **options)
    kwargs = {"vector_kwargs": {"autoreset_mode": same_step}, **options}
    theirs = gymnasium.make_vec(env_id, 3, vectorization_mode="sync", **kwargs)
    assert data_equivalence(ours.reset(seed=5), theirs.reset(seed=5), exact=True)
    for step in range(16):
        actions = np.random.default_rng(step).uniform(-0.05, 0.05, ours.action_space.shape)
        assert data_equivalence(ours.step(actions), theirs.step(actions), exact=True)


@pytest.mark.full
@pytest.mark.parametrize("saved_after", [1, 4])
def test_a_saved_state_holds_the_push(saved_after):
    push = {"step": 3, "undoes": 0, "joint_offsets": OFFSETS}
    environment, other = load(push=push), load(push=push, random=1)
    environment.reset()
    other.reset()
    for _ in range(saved_after):
        environment.step(np.zeros(9))
    other.set_state(environment.get_state())
    for _ in range(4):
        steps = environment.step(np.zeros(9)), other.step(np.zeros(9))
        for key, value in steps[0].observation.items():
            np.testing.assert_array_equal(value, steps[1].observation[key])
