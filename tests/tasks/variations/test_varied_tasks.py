"""Variations: what is drawn at resets, in which order, and how it reaches the physics, the noise and the action."""

import mujoco
import numpy as np
import pytest
from dm_control.composer.variation import distributions
from helpers.errors import refused
from helpers.sweeps import groups_of

from kitchen_suite import suite
from kitchen_suite.entities import build_microwave_table_scene
from kitchen_suite.environment import Environment
from kitchen_suite.tasks import GOALS
from kitchen_suite.tasks.microwave_table.task import MicrowaveTableTask
from kitchen_suite.tasks.variations.distributions import GROUPS, Bands, around, between, one_of

pytestmark = pytest.mark.full


def load(domain="kitchen", task=None, random=0, **options):
    task = task or next(iter(suite.DOMAINS[domain].tasks))
    return suite.load(domain, task, {"random": random, "visuals": False, **options})


def model_arrays(environment):
    model = environment.physics.model.ptr
    arrays = {name: getattr(model, name) for name in dir(model) if name[0] != "_"}
    return {name: np.array(value) for name, value in arrays.items() if isinstance(value, np.ndarray)}


def qpos(environment, joints):
    return np.array(environment.physics.bind(joints).qpos)


@pytest.mark.parametrize(
    ("name", "value", "beyond"),
    [
        ("kettle/pose", [0.4, 0.1, 0.2], [0.51, 0.1, 0.2]),
        ("hinge_cabinet/doors", [-0.6, 0.9], [-0.6, 1.01]),
    ],
)
def test_distributions_of_ones_own_may_leave_those_of_the_groups(name, value, beyond):
    environment, default = load(task="kettle", variations={name: value}), load(task="kettle")
    environment.reset()
    default.reset()
    prop = environment.task.scene.props[name.partition("/")[0]]
    joints = default.task.scene.props[name.partition("/")[0]].joints
    moved = qpos(environment, prop.joints)[: len(value)] - qpos(default, joints)[: len(value)]
    count = 2
    np.testing.assert_allclose(moved[:count], value[:count], atol=1e-12)
    with refused(ValueError, f"variation's {name} must be within"):
        load(task="kettle", variations={name: beyond})


@pytest.mark.parametrize("domain", suite.DOMAINS)
def test_each_group_varies_what_it_names(domain):
    for group in groups_of(domain):
        task = load(domain, variations=group).task
        assert {varied.group for varied in task.variations.by_name.values()} == {group}
        listed = [varied.name for varied in task.varied if varied.name in task.variations.by_name]
        assert list(task.variations.randomizer.names) == listed


@pytest.mark.parametrize(
    ("domain", "expected"),
    [
        (
            "kitchen",
            {"microwave/yaw": 0.3, "kettle/mass": 0.88, "camera/workspace_fovy": 51, "oven/knobs": [0.0] * 4},
        ),
        ("open_cabinet", {"cabinet/drawer_top_friction": 3.0, "franka/pad_friction": 1.5, "cabinet/offset": [0.0] * 3}),
        ("microwave_table", {"microwave/yaw": -np.pi / 2, "franka/gain_scale": 1.0, "camera/overview_fovy": 40.0}),
        ("kitchens", {"franka/joint_offset": [0.0] * 7, "franka/gain_scale": 1.0, "sensing/action_delay": 0.0}),
        (
            "pick_and_place",
            {"objects/displacement": [0.0] * 15, "objects/mass_scale": 1.0, "objects/friction_scale": 1.0},
        ),
    ],
)
def test_default_values_are_read_from_the_model_and_within_the_ranges(domain, expected):
    variations = load(domain, variations=groups_of(domain)).task.variations
    assert {name: variations.randomizer.defaults[name].tolist() for name in expected} == expected
    for name, (low, high) in variations.ranges.items():
        default = variations.randomizer.defaults[name]
        assert (low <= default).all()
        assert (default <= high).all()
        assert (low < high).any()


def test_a_variation_is_about_what_the_model_has():
    scene = build_microwave_table_scene(visuals=False)
    scene.arena.mjcf_model.find("camera", "overview").fovy = 30.0
    task = MicrowaveTableTask(scene, variations="camera")
    Environment(task, time_limit=1.0, random_state=0)
    low, high = task.variations.ranges["camera/overview_fovy"]
    assert (low, high) == (26.0, 34.0)


def test_a_group_without_parameters_is_refused():
    class StartTask(MicrowaveTableTask):
        varied = tuple(each for each in MicrowaveTableTask.varied if each.group in ("start", "camera"))

    with pytest.raises(ValueError, match=r"'layout' match no parameter of this task; those that do are .*'start'"):
        StartTask(build_microwave_table_scene(visuals=False), variations=["camera", "layout"])


@pytest.mark.parametrize("domain", suite.DOMAINS)
def test_the_same_seed_draws_the_same_and_another_one_does_not(domain):
    first, same, other = (load(domain, random=seed, variations=groups_of(domain)) for seed in (3, 3, 4))
    for environment in (first, same, other):
        environment.reset()
    values = [environment.task.variations.values for environment in (first, same, other)]
    np.testing.assert_equal(values[0], values[1])
    # Others have few values, or those of the default where a task is asked.
    continuous = [name for name, varied in first.task.variations.by_name.items() if isinstance(varied.seen, Bands)]
    different = [name for name in continuous if not np.array_equal(values[0][name], values[2][name])]
    assert set(continuous) - set(different) <= {"tasks/done", "slide_cabinet/door"}
    np.testing.assert_equal(model_arrays(first), model_arrays(same))


def test_values_come_after_the_start_pose_and_before_the_noise():
    environment = load("open_cabinet", variations=["dynamics"], observation_noise={"handle_offset": 0.01})
    environment.reset()
    random = np.random.RandomState(0)
    random.uniform(-0.125, 0.125, 9)
    for name, varied in environment.task.variations.by_name.items():
        np.testing.assert_array_equal(environment.task.variations.values[name], varied.seen(random_state=random))
    noise = random.uniform(-1, 1, environment.task.mdp.noise_draws) * environment.task.mdp.noise_scale
    np.testing.assert_array_equal(environment.task.state.noise, noise)


def test_layouts_are_drawn_again_from_a_stream_of_their_own():
    environment = load(task="all", variations=["layout"], variation_split="held_out")
    random, refusals = np.random.RandomState(0), 0
    for _ in range(6):
        environment.reset()
        refusals += int(environment.task.variations.info["layout_refusals"])
        for varied in environment.task.variations.by_name.values():
            varied.held_out(random_state=random)
        # One further number seeds the redraws, however many there are; the noise follows.
        random.randint(2**31)
        noise = random.uniform(-1, 1, environment.task.mdp.noise_draws) * environment.task.mdp.noise_scale
        np.testing.assert_array_equal(environment.task.state.noise, noise)
    assert refusals


def test_values_given_back_leave_the_stream_as_it_was():
    environment = load(variations=GROUPS)
    first = environment.reset()
    values, stream = environment.task.variations.values, environment.random_state.get_state(legacy=False)
    again = load(variations=GROUPS)
    again.task.follow(again.task.checked_reset({"variation_values": values}))
    second = again.reset()
    np.testing.assert_equal(again.task.variations.values, values)
    np.testing.assert_equal(again.random_state.get_state(legacy=False), stream)
    np.testing.assert_equal(dict(second.observation), dict(first.observation))
    np.testing.assert_equal(model_arrays(again), model_arrays(environment))
    # A request is for one reset.
    again.reset()
    environment.reset()
    np.testing.assert_equal(again.task.variations.values, environment.task.variations.values)
    assert again.task.variations.values["kettle/mass"] != values["kettle/mass"]


def test_a_request_may_name_what_varies():
    environment = load(task="microwave", variations=GROUPS)
    plain = load(task="microwave", variations=GROUPS)
    environment.task.follow(environment.task.checked_reset({"variation": ["kettle/mass", "sensing"]}))
    environment.reset()
    plain.reset()
    drawn, named = plain.task.variations.values, environment.task.variations.values
    varied = {"kettle/mass", "sensing/robot_noise", "sensing/object_noise", "sensing/action_delay"}
    for name, value in named.items():
        expected = drawn[name] if name in varied else environment.task.variations.randomizer.defaults[name]
        np.testing.assert_array_equal(value, expected)
    assert qpos(environment, environment.task.robot.joints)[0] == 0.148388023


@pytest.mark.parametrize("group", ["start", "dynamics"])
def test_default_values_are_the_default_scene(group):
    environment, plain = load(variations=[group]), load()
    environment.reset()
    assert environment.physics.data.qpos.any()
    defaults = environment.task.variations.randomizer.defaults
    environment.task.follow(environment.task.checked_reset({"variation_values": defaults}))
    environment.reset()
    plain.reset()
    np.testing.assert_equal(model_arrays(environment), model_arrays(plain))
    np.testing.assert_array_equal(environment.physics.data.qpos, plain.physics.data.qpos)


def test_start_moves_joints_and_what_is_coupled_to_them():
    values = {
        "franka/joint_offset": np.full(7, 0.05),
        "oven/knobs": (-0.1, -0.2, 0.0, -0.3),
        "hood/switch": -0.14,
        "microwave/door": -0.2,
        "kettle/pose": (0.01, -0.02, 0.1),
        "tasks/done": (0, 0, 0, 1, 0, 1, 0),
    }
    environment, plain = load(task="kettle", variations=values), load(task="kettle")
    environment.reset()
    plain.reset()
    props = environment.task.scene.props
    plain_props = plain.task.scene.props

    def moved(name):
        return qpos(environment, props[name].joints) - qpos(plain, plain_props[name].joints)

    arm = qpos(environment, environment.task.robot.joints) - qpos(plain, plain.task.robot.joints)
    np.testing.assert_allclose(arm, [0.05] * 7 + [0, 0])
    np.testing.assert_allclose(moved("oven")[::2], values["oven/knobs"])
    np.testing.assert_allclose(moved("oven")[1::2] * 174, values["oven/knobs"])
    np.testing.assert_allclose(moved("hood") * (1, 14), [-0.14, -0.14])
    np.testing.assert_allclose(moved("kettle")[:3], (0.01, -0.02, 0.0), atol=1e-12)
    quaternions = [qpos(each, each.task.scene.props["kettle"].joints)[3:] for each in (plain, environment)]
    turn = np.zeros(3)
    mujoco.mju_subQuat(turn, quaternions[1] / np.linalg.norm(quaternions[1]), quaternions[0])
    np.testing.assert_allclose(np.linalg.norm(turn), 0.1, atol=1e-6)
    # What is done overrides a displacement.
    np.testing.assert_allclose(qpos(environment, props["microwave"].joints), GOALS["microwave"].value)
    np.testing.assert_allclose(qpos(environment, props["slide_cabinet"].joints), GOALS["slide cabinet"].value)


def test_asked_tasks_are_not_done_and_not_nearly_done_at_the_start():
    for split in ("seen", "held_out"):
        environment = load(task="all", variations=["start"], variation_split=split)
        for _ in range(30):
            environment.reset()
            task = environment.task
            assert (task.task_distances >= 1.2 * task.threshold).all()
    # The door of the slide cabinet would be within 1.2 times the threshold: its displacement is the default.
    assert not environment.task.variations.values["slide_cabinet/door"]
    assert environment.task.variations.values["microwave/door"]
    environment = load(task="kettle", variations=["start"])
    environment.reset()
    assert environment.task.variations.values["slide_cabinet/door"]


def test_the_door_on_the_table_does_not_start_nearly_open():
    environment = load("microwave_table", threshold=0.5, variations=["start"], variation_split="held_out")
    for _ in range(5):
        environment.reset()
        # The door's goal is -0.75 rad; held-out values would be within 1.2 thresholds of it.
        assert not environment.task.variations.values["microwave/door"]
        assert not environment.task.episode_metrics["success"]


def test_dynamics_change_the_model():
    values = {
        "kitchen/friction_scale": 0.9,
        "franka/gain_scale": 0.95,
        "oven/damping_scale": 1.2,
        "hood/friction_scale": 0.8,
        "kettle/mass": 1.1,
    }
    environment, plain = load(variations=values), load()
    for each in (environment, plain):
        # Twice: nothing accumulates.
        each.reset()
        each.reset()
    here, there = (each.physics.bind for each in (environment, plain))
    scene, built = environment.task.scene, plain.task.scene
    ratio = environment.physics.model.geom_friction[:, 0] / plain.physics.model.geom_friction[:, 0]
    np.testing.assert_allclose(ratio[environment.physics.model.geom_contype[:] == 1], 0.9)
    np.testing.assert_array_equal(
        here(scene.robot.actuators[:7]).gainprm[:, 0], 0.95 * there(built.robot.actuators[:7]).gainprm[:, 0]
    )
    np.testing.assert_array_equal(
        here(scene.robot.actuators[:7]).biasprm[:, 1], 0.95 * there(built.robot.actuators[:7]).biasprm[:, 1]
    )
    knobs = [each.props["oven"].joints[::2] for each in (scene, built)]
    np.testing.assert_array_equal(here(knobs[0]).damping, 1.2 * there(knobs[1]).damping)
    switch = [each.props["hood"].joints[0] for each in (scene, built)]
    assert here(switch[0]).frictionloss == 0.8 * there(switch[1]).frictionloss
    kettle = [each.props["kettle"].mjcf_model.find("body", "kettle") for each in (scene, built)]
    assert here(kettle[0]).mass == 1.1
    np.testing.assert_allclose(here(kettle[0]).inertia, 1.1 / 0.88 * there(kettle[1]).inertia)
    subtree = [each.physics.model.body_subtreemass[0] for each in (environment, plain)]
    np.testing.assert_allclose(subtree[0] - subtree[1], 0.22)


def test_sensing_scales_the_noise():
    environment, plain = (
        load(variations=wanted) for wanted in ({"sensing/robot_noise": 3.0, "sensing/object_noise": 0.5}, None)
    )
    action = np.zeros(9)
    for each in (environment, plain):
        each.reset()
    for _ in range(3):
        np.testing.assert_allclose(environment.task.state.noise[:18], 3.0 * plain.task.state.noise[:18], rtol=1e-15)
        np.testing.assert_array_equal(environment.task.state.noise[18:], 0.5 * plain.task.state.noise[18:])
        for each in (environment, plain):
            each.step(action)


@pytest.mark.parametrize(
    ("domain", "control_mode"),
    [("kitchen", "joint_velocity"), ("kitchen", "ee_delta_pose"), ("open_cabinet", "joint_delta")],
)
def test_a_delayed_action_reaches_the_actuators_a_step_late(domain, control_mode):
    delayed, plain = (
        load(domain, variations=wanted, control_mode=control_mode) for wanted in ({"sensing/action_delay": 1.0}, None)
    )
    for each in (delayed, plain):
        each.reset()
    start = qpos(delayed, delayed.task.robot.joints)
    columns = delayed.task.mdp.sensors.ctrl
    spec = delayed.action_spec()
    actions = np.random.RandomState(1).uniform(-0.5, 0.5, (4, *spec.shape))
    targets = []
    for action in actions:
        delayed.step(action)
        applied = np.array(delayed.physics.data.ctrl[columns])
        np.testing.assert_array_equal(applied, targets[-1] if targets else start)
        targets.append(delayed.task.episode.parts["sensing"].target)
    plain.step(actions[0])
    np.testing.assert_array_equal(plain.physics.data.ctrl[columns], targets[0])


def test_states_hold_the_variation():
    environment, other = load(variations=GROUPS, random=1), load(variations=GROUPS, random=2)
    environment.reset()
    other.reset()
    action = np.full(9, 0.3)
    environment.step(action)
    state = environment.get_state()
    assert state["task"]["variation_values"].keys() == environment.task.variations.values.keys()
    other.set_state(state)
    np.testing.assert_equal(other.task.variations.values, environment.task.variations.values)
    np.testing.assert_equal(model_arrays(other), model_arrays(environment))
    for _ in range(3):
        first, second = environment.step(action), other.step(action)
        np.testing.assert_equal(dict(first.observation), dict(second.observation))
    broken = {**state, "task": {**state["task"], "variation_values": {}}}
    with refused(ValueError, "variation_values"):
        other.set_state(broken)


def test_composer_variations_and_json_are_distributions():
    wanted = {"kettle/mass": {"uniform": [0.5, 0.7]}, "microwave/door": distributions.Uniform(-0.1, 0.0)}
    environment = load(variations=wanted)
    masses = []
    for _ in range(20):
        environment.reset()
        values = environment.task.variations.values
        assert list(values) == ["microwave/door", "kettle/mass"]
        assert -0.1 <= values["microwave/door"] <= 0.0
        masses.append(float(values["kettle/mass"]))
    assert 0.5 <= min(masses) < 0.55 < 0.65 < max(masses) <= 0.7


def test_draws_beyond_the_range_are_moved_to_its_end():
    environment = load(variations={"kettle/mass": {"normal": [1.5, 10.0]}})
    masses = []
    for _ in range(10):
        environment.reset()
        masses.append(float(environment.task.variations.values["kettle/mass"]))
    assert {min(masses), max(masses)} == {0.4, 1.5}


@pytest.mark.parametrize(
    ("task", "displacement", "angle"), [("left_hinge_cabinet", -0.7, -0.7), ("close_left_hinge_cabinet", 0.7, -0.55)]
)
def test_doors_may_start_further_open_than_groups_draw(task, displacement, angle):
    environment = load(task=task, variations={"hinge_cabinet/doors": [displacement, 0.0]})
    environment.reset()
    (joint,) = GOALS[task.replace("_", " ")].joints_in(environment.task.scene)
    np.testing.assert_allclose(environment.physics.bind(joint).qpos, angle, atol=0.01)
    drawn = load(task=task, variations=["start"])
    for _ in range(20):
        drawn.reset()
        assert -0.15 <= drawn.task.variations.values["hinge_cabinet/doors"][0] <= 0.0


@pytest.mark.parametrize(
    ("options", "error", "shown"),
    [
        ({"variations": "strat"}, ValueError, ["'start'"]),
        ({"variations": 3}, TypeError, ["variations"]),
        ({"variations": {"kettle/mas": 1.0}}, ValueError, ["'kettle/mass'"]),
        ({"variations": {"kettle/mass": 7.0}}, ValueError, ["kettle/mass", "0.4", "1.5", "7.0"]),
        ({"variations": {"hinge_cabinet/doors": [-0.9, 0.0]}}, ValueError, ["hinge_cabinet/doors", "-0.8", "-0.9"]),
        ({"variations": {"kettle/pose": [0.0, 0.0]}}, ValueError, ["kettle/pose", "(3,)"]),
        ({"variations": "start", "variation_split": "test"}, ValueError, ["variation_split", "'test'"]),
    ],
)
def test_bad_variations_are_refused(options, error, shown):
    with refused(error, *shown):
        load(**options)


@pytest.mark.parametrize(
    ("names", "values", "error", "shown"),
    [
        (["layout"], None, ValueError, ["'layout'"]),
        (None, {"microwave/door": -0.1}, ValueError, ["variation_values", "'microwave/door'"]),
        (None, {"kettle/mass": 3.0}, ValueError, ["within 0.4 and 1.5"]),
        (None, {"kettle": {"mass": "heavy"}}, TypeError, ["kettle/mass"]),
        (None, [("kettle/mass", 1.0)], TypeError, ["variation_values"]),
    ],
)
def test_bad_requests_are_refused(names, values, error, shown):
    task = load(variations="dynamics").task
    with refused(error, *shown):
        task.variations.request(names, values)


@pytest.mark.parametrize("split", ["seen", "held_out"])
@pytest.mark.parametrize("domain", suite.DOMAINS)
def test_draws_fill_their_range_and_are_independent(domain, split):
    task = load(domain, variations=groups_of(domain), variation_split=split).task
    random = np.random.RandomState(0)
    count = 2000
    drawn = [task.variations.randomizer.draw(random) for _ in range(count)]
    columns = {}
    for name, varied in task.variations.by_name.items():
        values = np.array([each[name] for each in drawn])
        distribution = varied.distribution(split)
        width = distribution.high - distribution.low
        assert (values >= distribution.low).all()
        assert (values <= distribution.high).all()
        # Each end is reached to a hundredth of the width, which 2,000 draws miss once in 10^8 times.
        assert (values.min(axis=0) <= distribution.low + 0.01 * width).all(), name
        assert (values.max(axis=0) >= distribution.high - 0.01 * width).all(), name
        flat = values.reshape(count, -1)
        columns |= {f"{name} {i}": flat[:, i] for i in range(flat.shape[1]) if np.ptp(flat[:, i])}
    correlations = np.corrcoef(np.array([*columns.values()]))
    owners = np.array([column.partition(" ")[0] for column in columns])
    # Six standard deviations of the correlation of independent numbers; there are up to 10^4 pairs. The channels of a
    # colour may depend on each other.
    assert np.abs(correlations[owners[:, np.newaxis] != owners]).max() < 6 / np.sqrt(count)


def test_distributions_of_tables():
    random = np.random.RandomState(0)
    half = around("a", "start", seen=(0.1, 0.0), held_out=(0.3, 0.0)).about(np.array([1.0, 0.0]))
    seen, held_out = (np.array([each(random_state=random) for _ in range(500)]) for each in (half.seen, half.held_out))
    assert (np.abs(seen[:, 0] - 1) <= 0.1).all()
    assert ((np.abs(held_out[:, 0] - 1) >= 0.1) & (np.abs(held_out[:, 0] - 1) <= 0.3)).all()
    assert {*np.sign(held_out[:, 0] - 1)} == {-1, 1}
    assert not seen[:, 1].any()
    assert not held_out[:, 1].any()
    door = between("a", "start", seen=(0.0, 0.2), held_out=[(0.2, 0.3)])
    assert door.range(np.array(0.1)) == (0.0, 0.3)
    assert door.range(np.array(-0.1)) == (-0.1, 0.3)
    places = one_of("a", "start", seen=(0.0, 1.0), held_out=(2.0,))
    assert {float(places.seen(random_state=random)) for _ in range(50)} == {0.0, 1.0}
    assert places.held_out(random_state=random) == 2.0
