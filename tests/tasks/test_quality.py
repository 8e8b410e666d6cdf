"""`quality=True`: contact forces, disturbed objects, energy and the hand's path, in every domain and front end."""

import copy
import pickle
import runpy
from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import pytest
from dm_control import mjcf
from dm_control.entities.props.primitive import Primitive
from docs_scripts import load_script
from gymnasium.utils.env_checker import data_equivalence
from helpers.contacts import forces_by_hand
from helpers.errors import refused
from helpers.sweeps import brief, walk

from kitchen_suite import suite
from kitchen_suite.entities import build_kitchen_scene
from kitchen_suite.entities.generated_kitchen import MAX_PARTS
from kitchen_suite.environment import Environment
from kitchen_suite.tasks import KitchenTask
from kitchen_suite.tasks.episode import quality
from kitchen_suite.tasks.episode.quality import NUM_CONTACTS, TOLERANCES, Quality, QualityReading
from kitchen_suite.tasks.settings import Settings
from kitchen_suite.vector_env.generated_kitchens import GeneratedKitchenVectorEnv

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples"

TYPES = {
    "success_at_end": np.bool_,
    "steps_to_success": np.int64,
    "peak_contact_force": np.float64,
    "mean_contact_force": np.float64,
    "peak_arm_contact_force": np.float64,
    "mean_arm_contact_force": np.float64,
    "stray_contacts": np.int64,
    "objects_disturbed": np.int64,
    "energy": np.float64,
    "path_length": np.float64,
    "log_dimensionless_jerk": np.float64,
}
CARRIED = {"peak_carried_contact_force": np.float64}
DOMAINS = ("kitchen", "kitchens", "pick_and_place", "open_cabinet", "microwave_table")
FAST = ("kitchen", "kitchens", "pick_and_place", "microwave_table")
CASES = [*((domain, "exact") for domain in DOMAINS), *((domain, "fast") for domain in FAST)]


def make(domain, **options):
    return gymnasium.make(suite.DOMAINS[domain].env_id, **{"quality": True, **options})


def make_vec(domain, count=3, **options):
    options = {"num_threads": 1, "quality": True, **options}
    return gymnasium.make_vec(suite.DOMAINS[domain].env_id, count, vectorization_mode="vector_entry_point", **options)


def load(domain, **options):
    return suite.load(domain, suite.default_task(domain), {"random": 0, "quality": True, "visuals": False, **options})


def actions_of(env, steps, *leading):
    return walk(env.unwrapped.environment.action_spec(), steps, *leading).astype(np.float32)


def types_of(domain):
    """The types of the infos that quality adds in a domain, by name."""
    return TYPES | CARRIED if domain == "pick_and_place" else TYPES


def measures(infos):
    return {name: infos[name] for name in TYPES | CARRIED if name in infos}


def reading(steps=1, **parts):
    """A reading of one physics step without contacts, at rest."""
    zeros = {
        "contacts": np.zeros(4 * steps * NUM_CONTACTS),
        "torques": np.zeros(9 * steps),
        "displacements": np.zeros(9 * steps),
        "hand": np.zeros(3),
        "positions": np.zeros(4),
    }
    return QualityReading(**{**zeros, **parts})


def still():
    return Quality.initial(np.zeros(3), np.zeros(4), np.zeros(1, bool))


def along(path):
    """The quality of an episode whose hand begins at rest at the first of some positions `(n, 3)`."""
    current = Quality.initial(path[0], np.zeros(4), np.zeros(1, bool))
    for hand in path[1:]:
        current = current.after(reading(hand=hand))
    return current


@pytest.mark.full
@pytest.mark.parametrize(
    ("domain", "physics"), brief(CASES, [("kitchen", "fast"), ("open_cabinet", "exact"), ("kitchens", "fast")], CASES)
)
def test_single_equals_vectorised_to_the_bit(domain, physics):
    env, envs = make(domain, physics=physics), make_vec(domain, physics=physics)
    (_, infos), (_, many) = env.reset(seed=1), envs.reset(seed=0)
    actions = actions_of(env, 60, 3)
    for action in [None, *actions]:
        if action is not None:
            *_, infos = env.step(action[1])
            *_, many = envs.step(action)
        for name, dtype in types_of(domain).items():
            assert (infos[name].shape, infos[name].dtype) == ((), dtype)
            assert infos[name] == many[name][1], name
            assert many[f"_{name}"].all()
    assert infos["energy"] > 0.0
    assert infos["path_length"] > 0.0
    assert infos["log_dimensionless_jerk"] < -5.0


@pytest.mark.full
def test_kitchens_of_several_designs_have_the_quality_of_each_alone():
    designs = [3, 5, 8]
    envs = GeneratedKitchenVectorEnv(3, design=designs, num_threads=1, quality=True)
    alone = [make("kitchens", design=design) for design in designs]
    envs.reset(seed=0)
    for i, env in enumerate(alone):
        env.reset(seed=i)
    for action in actions_of(alone[0], 30, 3):
        *_, many = envs.step(action)
        for i, env in enumerate(alone):
            *_, infos = env.step(action[i])
            assert measures(infos) == {name: many[name][i] for name in TYPES}


@pytest.mark.full
@pytest.mark.parametrize("domain", brief(DOMAINS, ["kitchen", "open_cabinet"], DOMAINS))
def test_quality_changes_no_other_number_and_adds_nothing_where_it_is_off(domain):
    on, off = make(domain), make(domain, quality=False)
    plain = gymnasium.make(suite.DOMAINS[domain].env_id)
    for env in (on, off, plain):
        env.reset(seed=0)
    for action in actions_of(on, 10):
        with_quality, without, default = (env.step(action) for env in (on, off, plain))
        assert data_equivalence(without, default, exact=True)
        assert data_equivalence(with_quality[:4], without[:4], exact=True)
        assert with_quality[4].keys() - without[4].keys() == types_of(domain).keys()
        assert not without[4].keys() - with_quality[4].keys()
        one, other = (env.unwrapped.physics_state for env in (on, off))
        np.testing.assert_array_equal(one, other)
    sizes = [mujoco.mj_sizeModel(env.unwrapped.environment.physics.model.ptr) for env in (on, off, plain)]
    assert sizes[0] > sizes[1] == sizes[2]
    states = [env.unwrapped.get_state() for env in (on, off, plain)]
    assert data_equivalence(states[1], states[2], exact=True)
    assert "quality" in states[0]["task"]
    assert "quality" not in states[1]["task"]
    assert off.unwrapped.composer_task.quality == {}
    assert off.unwrapped.composer_task.disturbed_objects == []


@pytest.mark.full
@pytest.mark.parametrize("domain", brief(DOMAINS, ["kitchen"], DOMAINS))
def test_states_and_copies_continue_the_numbers(domain):
    env = make(domain).unwrapped
    env.reset(seed=0)
    actions = actions_of(env, 30)
    for action in actions[:20]:
        env.step(action)
    state, copied = env.get_state(), copy.deepcopy(env)
    other = make(domain).unwrapped
    other.reset(seed=5)
    other.set_state(state)
    for action in actions[20:]:
        expected = measures(env.step(action)[4])
        assert measures(copied.step(action)[4]) == expected
        assert measures(other.step(action)[4]) == expected
    without = make(domain, quality=False).unwrapped
    without.reset(seed=0)
    with refused(ValueError, "quality"):
        without.set_state(state)


def test_an_environment_of_dm_control_and_its_pickle_have_the_quality():
    environment = load("microwave_table")
    environment.reset()
    actions = walk(environment.action_spec(), 20)
    for action in actions[:10]:
        environment.step(action)
    pickled = pickle.loads(pickle.dumps(environment))
    for action in actions[10:]:
        environment.step(action)
        pickled.step(action)
    assert environment.task.quality == pickled.task.quality
    assert environment.task.quality.keys() == TYPES.keys()
    assert all(type(value) in (bool, int, float) for value in environment.task.quality.values())


@pytest.mark.parametrize(
    "count", [pytest.param(60, marks=pytest.mark.full), pytest.param(1_000, marks=pytest.mark.nightly)]
)
def test_forces_are_those_of_single_contacts_summed_by_hand(count):
    """In random states, of which as many have contacts, one physics step after each."""
    environment = load("kitchen", control_timestep=0.002)
    environment.reset()
    task, physics = environment.task, environment.physics
    model, data, generator = physics.model.ptr, physics.data.ptr, np.random.default_rng(0)
    low, high = task.robot.joint_limits
    columns = physics.bind(task.robot.joints).qposadr
    compared = []
    while len(compared) < count:
        mujoco.mj_resetData(model, data)
        data.qpos[:] = model.qpos0
        data.qpos[columns] = generator.uniform(low, high)
        data.qvel[:] = generator.normal(scale=0.5, size=model.nv)
        mujoco.mj_step(model, data)
        forces = quality.contact_forces(task.meter.read(task.simulation).contacts)[..., 0]
        expected, count_of_robot = forces_by_hand(environment, data)
        if count_of_robot <= NUM_CONTACTS:
            np.testing.assert_allclose(forces, expected, rtol=1e-9, atol=1e-6)
            if any(expected):
                compared.append(expected)
    # Many of the states have contacts of each kind.
    assert (np.count_nonzero(compared, axis=0) > 0.1 * count).all()


def test_contacts_of_the_robot_with_itself_do_not_count():
    contacts = np.zeros((4, 2, NUM_CONTACTS))
    contacts[0, :, :3] = [[5.0, 7.0, 11.0], [5.0, 7.0, 0.0]]  # Of the robot.
    contacts[1, :, :2] = [[7.0, 11.0], [7.0, 0.0]]  # Of the hand.
    contacts[2, :, :1] = 7.0  # Of the robot with itself.
    contacts[3, :, :1] = 7.0  # Of the hand with the robot.
    np.testing.assert_array_equal(quality.contact_forces(contacts.ravel()), [[5.0, 5.0], [11.0, 0.0]])


def test_peaks_means_and_stray_contacts_follow_from_the_forces_of_physics_steps():
    current = still()
    of_steps = (
        ((0.0, 0.0), (2.0, 4.0)),
        ((6.0, 0.0), (0.0, 1.0)),
        ((0.0, 0.0), (0.0, 0.0)),
        ((0.0, 2.0), (0.0, 0.0)),
    )
    means = []
    for arm, hand in of_steps:
        contacts = np.zeros((4, 2, NUM_CONTACTS))
        contacts[0, :, 0] = np.add(arm, hand)
        contacts[1, :, 0] = hand
        current = current.after(reading(steps=2, contacts=contacts.ravel()))
        means.append(current.info()["mean_contact_force"])
    infos = current.info()
    assert means == [3.0, 1.75, pytest.approx(7.0 / 6.0), 0.875]
    assert infos["peak_contact_force"] == 4.0
    assert infos["peak_arm_contact_force"] == 6.0
    assert infos["mean_arm_contact_force"] == 1.0
    assert infos["stray_contacts"] == 2


def displaced(environment, joint, by):
    """Objects disturbed once a joint has been moved from its start by a fraction of its tolerance; whether it is asked.

    In a new episode, which may ask for another joint.
    """
    task, physics = environment.task, environment.physics
    environment.reset()
    asked = {each.full_identifier for each in task.mdp.requested_joints(task.scene, task.state)}
    model, data = physics.model.ptr, physics.data.ptr
    element = model.joint(joint)
    kind = ("free", "ball", "slide", "hinge")[int(element.type[0])]
    data.qpos[int(element.qposadr[0])] += by * TOLERANCES[kind]
    after = task.episode.parts["quality"].after(task.meter.read(task.simulation))
    return after.info()["objects_disturbed"], joint in asked


@pytest.mark.full
@pytest.mark.parametrize("domain", brief(DOMAINS, ["kitchen", "open_cabinet"], DOMAINS))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_an_object_is_disturbed_beyond_its_tolerance_unless_it_is_asked_for(domain, sign):
    environment = load(domain)
    environment.reset()
    meter = environment.task.meter
    names = [name for name in meter.objects if name]
    assert len({*names}) == len(names) > 0
    for name in names:
        count, _ = displaced(environment, name, 0.999 * sign)
        assert count == 0
        count, is_asked = displaced(environment, name, 1.001 * sign)
        assert count == (not is_asked)


@pytest.mark.full
def test_what_has_been_disturbed_stays_so_and_has_a_name():
    environment = load("kitchen")
    environment.reset()
    task, data = environment.task, environment.physics.data.ptr
    column = environment.physics.model.ptr.joint("slide_cabinet/slide_cabinet").qposadr[0]
    data.qpos[column] = 0.2
    environment.step(np.zeros(9))
    assert task.disturbed_objects == []
    environment = suite.load("kitchen", "kettle", {"random": 0, "quality": True, "visuals": False})
    environment.reset()
    task, data = environment.task, environment.physics.data.ptr
    data.qpos[column] = 0.2
    environment.step(np.zeros(9))
    data.qpos[column] = 0.0
    environment.step(np.zeros(9))
    assert task.disturbed_objects == ["slide_cabinet/slide_cabinet"]
    assert task.quality["objects_disturbed"] == 1
    environment.reset()
    assert task.quality["objects_disturbed"] == 0


def test_objects_are_those_that_move_without_what_follows_them():
    kitchen = {name.partition("/")[2] for name in load("kitchen").task.meter.objects}
    knobs = {f"knob_Joint_{number}" for number in range(1, 5)}
    doors = {"slide_cabinet", "left_hinge_cabinet", "right_hinge_cabinet", "microwave"}
    assert kitchen == {*knobs, *doors, "light_switch", ""}


def test_kitchens_keep_a_place_for_each_part_that_any_of_them_may_have():
    for design in (3, 5):
        objects = load("kitchens", design=design).task.meter.objects
        assert len(objects) == MAX_PARTS
        assert "" in objects


@pytest.fixture
def lever(monkeypatch):
    """The example of a domain, registered, whose infos name one term of the reward alone."""
    module = load_script("examples/my_domain")

    def info(mdp, state):
        return {"pushed": np.array(state.terms["push"]), "is_success": np.abs(state.angle[..., 0]) > module.PUSHED}

    monkeypatch.setattr(module.LeverMDP, "info", info)
    suite.register(module.LEVER)
    yield module.LEVER
    del suite._domains[module.LEVER.name]
    for env_id in {module.LEVER.env_id, *module.LEVER.task_ids.values()}:
        del gymnasium.registry[env_id]


def test_infos_may_name_a_term_of_the_reward_while_success_is_kept(lever):
    env, plain = (gymnasium.make(lever.env_id, quality=quality) for quality in (True, False))
    envs = gymnasium.make_vec(lever.env_id, 2, num_threads=1, quality=True)
    envs.reset(seed=0)
    for each in (env, plain):
        each.reset(seed=0)
        *_, info = each.step(np.zeros(8, np.float32))
        assert not info["is_success"]
    *_, many = envs.step(np.zeros((2, 8), np.float32))
    assert env.unwrapped.environment.task.reward_terms["push"] == many["pushed"][0] > 0.0
    infos = []
    for each in (env, plain):
        each.unwrapped.environment.physics.named.data.qpos["lever/hinge"] = 1.0
        *_, info = each.step(np.zeros(8, np.float32))
        infos.append(info)
    assert infos[0]["pushed"] == infos[1]["pushed"] > 1.0
    assert (infos[0]["steps_to_success"], infos[0]["success_at_end"]) == (2, True)


def test_an_object_of_a_user_counts_in_single_and_vectorised_environments():
    mug = runpy.run_path(str(EXAMPLES / "mug.py"))["MUG_KITCHEN"]
    environment = mug.load(**mug.tasks["lift"], random=0, visuals=False, quality=True)
    environment.reset()
    assert environment.task.meter.objects[-1] == "mug/"
    column = environment.physics.bind(
        mjcf.get_frame_freejoint(environment.task.scene.attached["mug"].mjcf_model)
    ).qposadr
    positions = environment.physics.data.ptr.qpos[int(column) : int(column) + 7]
    # It may turn about its axis.
    positions[3:] = [np.cos(1.0), 0.0, 0.0, np.sin(1.0)]
    environment.step(np.zeros(9))
    assert environment.task.disturbed_objects == []
    positions[1] += 0.05
    environment.step(np.zeros(9))
    assert environment.task.disturbed_objects == ["mug/"]


def test_a_ball_may_turn_as_far_as_a_hinge():
    angle = TOLERANCES["hinge"]
    turned = np.array([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)])
    assert TOLERANCES["ball"] == pytest.approx(np.linalg.norm(turned - [1.0, 0.0, 0.0, 0.0]))


@pytest.mark.full
def test_objects_may_be_held_by_other_constraints_than_those_of_joints():
    scene = build_kitchen_scene()
    mug = Primitive(geom_type="cylinder", size=(0.035, 0.05), name="mug")
    frame = scene.attach(mug, pos=(-0.65, -0.35, 1.9), free=True)
    scene.arena.mjcf_model.equality.add("weld", body1=frame)
    task = KitchenTask(scene)
    task.configure(Settings(quality=True))
    with Environment(task) as environment:
        environment.reset()
        assert "mug/" in task.meter.objects


def test_another_arm_is_measured():
    arm = runpy.run_path(str(EXAMPLES / "my_arm.py"))["MY_ARM"]
    environment = load("kitchen", robot=arm, control_mode="ee_delta_pose")
    environment.reset()
    for _ in range(3):
        environment.step(np.full(environment.action_spec().shape, 0.5))
    assert environment.task.quality["energy"] > 0.0
    assert environment.task.quality["path_length"] > 0.0


def test_energy_is_the_integral_of_torque_times_velocity():
    """Of a torque and a velocity that are sines of time: the integral of their product's magnitude is T / 2."""
    timestep, steps, count = 0.01, 10, 100
    current = still()
    for number in range(count):
        times = (number * steps + np.arange(steps)) * timestep
        sines = np.repeat(np.sin(np.pi * times)[np.newaxis], 9, axis=0)
        current = current.after(reading(steps, torques=sines.ravel(), displacements=timestep * sines.ravel()))
    assert current.info()["energy"] == pytest.approx(9 * timestep * steps * count / 2)


def test_energy_of_a_falling_arm_is_that_of_its_actuators():
    environment = load("kitchen", control_timestep=0.002)
    environment.reset()
    physics, expected = environment.physics, 0.0
    for action in walk(environment.action_spec(), 20):
        data = physics.data.ptr
        before, velocities = data.time, data.actuator_velocity.copy()
        environment.step(action)
        assert data.time == pytest.approx(before + 0.002)
        # The actuators' forces are those of the physics step; velocities have gone on.
        expected += np.abs(data.actuator_force * velocities * 0.002).sum()
    assert environment.task.quality["energy"] == pytest.approx(expected)
    assert expected > 0.0


def test_path_length_is_that_of_a_circle():
    angles = np.linspace(0.0, 2.0 * np.pi, 201)
    circle = 0.3 * np.stack([np.cos(angles), np.sin(angles), np.zeros(201)], axis=-1)
    assert along(circle).info()["path_length"] == pytest.approx(200 * 2.0 * 0.3 * np.sin(np.pi / 200))


@pytest.mark.parametrize("length", [0.01, 2.0])
@pytest.mark.parametrize("steps", [200, 2_000])
def test_jerk_of_a_minimum_jerk_movement_is_known(steps, length):
    """From rest to rest along x(t) = 10 t^3 - 15 t^4 + 6 t^5 it is -ln(720 / 1.875^2), whatever its size and time."""
    times = np.linspace(0.0, 1.0, steps + 1)
    path = np.outer(10 * times**3 - 15 * times**4 + 6 * times**5, [0.0, 0.6 * length, 0.8 * length])
    expected = -np.log(720.0 / 1.875**2)
    # The jerk jumps at the start, where a difference spans steps before and after: an error of the order of a step.
    assert along(path).info()["log_dimensionless_jerk"] == pytest.approx(expected, abs=8.0 / steps)


def test_a_jerkier_movement_has_less_and_a_hand_at_rest_has_0():
    times = np.linspace(0.0, 1.0, 201)
    smooth = np.outer(10 * times**3 - 15 * times**4 + 6 * times**5, [1.0, 0.0, 0.0])
    shaken = smooth + 0.002 * np.sin(40.0 * np.pi * times)[:, np.newaxis]
    assert along(shaken).log_dimensionless_jerk < along(smooth).log_dimensionless_jerk
    assert along(np.ones((5, 3))).info()["log_dimensionless_jerk"] == 0.0
    assert still().info()["log_dimensionless_jerk"] == 0.0


def test_a_bad_argument_is_refused():
    with refused(TypeError, "quality", "yes"):
        load("kitchen", quality="yes")
    with refused(ValueError, "quality", "control_timestep"):
        suite.load("kitchen", "kettle", {"quality": True}, {"n_sub_steps": 20})
    # The remedy that it names.
    environment = suite.load("kitchen", "kettle", {"quality": True, "control_timestep": 0.04, "visuals": False})
    assert environment.task.quality["energy"] == 0.0
