"""Public programs for `env.unwrapped` of FrankaKitchen-v1 compute the same numbers here as in the original."""

import copy
import pickle

import gymnasium
import mujoco
import numpy as np
import pytest
import tree
from helpers.errors import refused
from helpers.original import original_environment, random_actions

from kitchen_suite.gymnasium_env import FrankaKitchenEnv
from kitchen_suite.gymnasium_env.original import NAMES

MICROWAVE = 22  # Element of qpos.
KETTLE = slice(23, 26)  # Elements of qpos and qvel.
ACTIONS = random_actions(np.random.default_rng(0), 40)


def summary(step):
    """Returns the results of a step, without lists whose order the original leaves to chance."""
    observation, reward, terminated, truncated, info = step
    return (
        observation["observation"],
        observation["achieved_goal"],
        reward,
        terminated,
        truncated,
        len(info["tasks_to_complete"]),
    )


def steps(env, count=5):
    return [summary(env.step(action)) for action in ACTIONS[:count]]


def log_states(env):
    """A recorder: positions and velocities without noise, beside the observations."""
    env.reset(seed=0)
    return [(*steps(env, 1), env.data.qpos.copy(), env.data.qvel.copy(), env.data.time) for _ in range(5)]


def hold_references(env):
    """A viewer: takes model and data before the first reset, and keeps them."""
    model, data = env.model, env.robot_env.data
    seen = []
    for seed in (1, None):
        env.reset(seed=seed)
        seen += [steps(env), data.qpos.copy(), data.ctrl.copy(), model.opt.timestep]
    data.qpos[MICROWAVE] = -0.4
    return seen, steps(env)


def open_microwave_with_forward(env):
    env.reset(seed=2)
    env.data.qpos[MICROWAVE] = -0.7
    mujoco.mj_forward(env.model, env.data)
    return steps(env), env.episode_task_completions


def open_microwave_without_forward(env):
    env.reset(seed=2)
    steps(env)
    env.data.qpos[MICROWAVE] = -0.7
    return steps(env), env.episode_task_completions


def throw_kettle(env):
    env.reset(seed=3)
    steps(env)
    env.data.qpos[KETTLE] += [0.0, 0.1, 0.3]
    env.data.qvel[KETTLE] = [0.2, 0.5, 1.0]
    return steps(env, 10)


def replay_states(env):
    """A renderer of demonstrations, which sets every state; then a policy goes on."""
    env.reset(seed=4)
    rng = np.random.default_rng(4)
    seen = []
    for _ in range(3):
        qpos = env.robot_env.init_qpos + rng.uniform(-0.05, 0.05, 30)
        env.robot_env.set_state(qpos, rng.normal(scale=0.1, size=29))
        seen += [env.robot_env.state_vector(), env.robot_env.get_body_com("microdoorroot").copy(), steps(env, 2)]
    return seen


def plan(env):
    """A planner: tries actions, and puts the state back."""
    env.reset(seed=5)
    steps(env)
    qpos, qvel = env.data.qpos.copy(), env.data.qvel.copy()
    seen = []
    for _ in range(2):
        env.robot_env.set_state(qpos, qvel)
        seen.append(steps(env))
    return seen


def start_elsewhere(env):
    env.robot_env.init_qpos[MICROWAVE] = -0.5
    first = env.reset(seed=6)[0]["observation"]
    env.robot_env.init_qpos = env.robot_env.init_qpos + np.eye(30)[19] * 0.2
    return first, steps(env), env.reset()[0]["observation"], steps(env), env.robot_env.init_qvel.copy()


def measure_distances(env):
    """A shaped reward from goals and positions."""
    env.reset(seed=7)
    elements = {"microwave": [22], "slide cabinet": [19], "kettle": range(23, 30)}
    return [
        (
            steps(env, 1),
            {task: np.linalg.norm(env.data.qpos[[*places]] - env.goal[task]) for task, places in elements.items()},
        )
        for _ in range(3)
    ]


def choose_tasks(env):
    """A curriculum: only some tasks are rewarded in the rest of the episode."""
    env.reset(seed=8)
    env.tasks_to_complete = {"kettle", "light switch"}
    env.data.qpos[MICROWAVE] = -0.75
    unrewarded = steps(env, 2)
    env.tasks_to_complete = env.tasks_to_complete | {"microwave"}
    rewarded = steps(env, 2)
    left = set(env.tasks_to_complete)
    env.reset()
    return unrewarded, rewarded, left, set(env.tasks_to_complete), env.step_task_completions


def change_physics(env):
    """Domain randomization: gravity, damping, mass and gains."""
    env.reset(seed=9)
    model, kettle = env.robot_env.model, env.robot_env.model_names.body_name2id["kettleroot"]
    model.opt.gravity[:] = [0.3, 0.0, -5.0]
    model.dof_damping[MICROWAVE] *= 0.1
    model.body_mass[kettle] *= 2.0
    model.actuator_gainprm[:, 0] *= 0.9
    return steps(env, 10)


def push(env):
    """Perturbations, as viewers apply them."""
    env.reset(seed=10)
    env.data.xfrc_applied[env.robot_env.model_names.body_name2id["kettleroot"], :3] = [0.0, 3.0, 20.0]
    env.data.qfrc_applied[MICROWAVE] = -3.0
    return steps(env, 10)


def control_joints(env):
    """A controller of its own, at the rate of the physics."""
    env.reset(seed=11)
    robot = env.robot_env
    low, high = robot.robot_pos_bound[:9].T
    for _ in range(3):
        robot.do_simulation(np.clip(env.data.qpos[:9] + 0.1, low, high), robot.frame_skip)
    return env.data.qpos.copy(), env.data.qvel.copy(), robot.dt, steps(env)


def follow_hand(env):
    """Inverse kinematics from Jacobians, and places of objects by their names."""
    env.reset(seed=12)
    seen = [steps(env)]
    mujoco.mj_forward(env.model, env.data)
    names, jacobian = env.robot_env.model_names, np.zeros((3, env.model.nv))
    mujoco.mj_jacSite(env.model, env.data, jacobian, None, names.site_name2id["end_effector"])
    seen.append(jacobian)
    hand = (env.data.body("panda0_leftfinger").xpos + env.data.body("panda0_rightfinger").xpos) / 2.0
    seen += [hand, env.data.joint("kettle").qpos.copy()]
    seen += [env.data.site(names.site_name2id[name]).xpos.copy() for name in ("end_effector", "microhandle_site")]
    seen += [env.data.xpos[names.body_name2id[name]].copy() for name in ("panda0_link7", "slidelink", "kettle")]
    seen.append(env.data.joint(names.joint_name2id["slide_cabinet"]).qpos.copy())
    return seen


def move_by_name(env):
    """Sets joints by the names of tasks, as programs do that take images of goals."""
    env.reset(seed=13)
    for name, position in (("microwave", -0.7), ("slide_cabinet", 0.3), ("knob_Joint_2", -0.8)):
        env.data.joint(name).qpos = position
    env.data.joint("kettle").qpos[:3] += 0.02
    env.data.actuator("r_gripper_finger_joint").ctrl = 0.03
    env.model.joint("microwave").damping = 0.0
    env.model.jnt("light_switch").range[:] = [-0.5, 0.0]
    env.model.body("kettleroot").mass *= 2
    return steps(env, 10)


def observe_set_states(env):
    """Starts from states of a dataset, and observes them in the only way that the original has."""
    env.reset(seed=14)
    seen = []
    for opening in (-0.3, -0.6):
        qpos = env.robot_env.init_qpos.copy()
        qpos[MICROWAVE] = opening
        env.robot_env.set_state(qpos, np.full(29, 0.1))
        observation = env._get_obs(env.robot_env._get_obs())
        seen += [observation, env.robot_env._last_robot_qpos.copy(), steps(env, 2)]
    return seen


def track_setpoints(env):
    """Makes the next action start from the last setpoint, not from the observed positions."""
    env.reset(seed=15)
    seen = []
    for _ in range(3):
        seen.append(steps(env, 1))
        env.robot_env._last_robot_qpos = np.clip(env.data.ctrl, env.data.qpos[:9] - 0.1, env.data.qpos[:9] + 0.1)
    return seen


def read_ranges(env):
    robot = env.robot_env
    config = (robot.robot_pos_bound, robot.robot_vel_bound, robot.robot_pos_noise_amp, robot.robot_vel_noise_amp)
    sizes = env.model.nq, env.model.nv, env.model.nu, env.model.opt.timestep, robot.dt, robot.frame_skip
    return env.model.jnt_range.copy(), env.model.actuator_ctrlrange.copy(), config, sizes, robot.robot_noise_ratio


PROGRAMS = (
    log_states,
    hold_references,
    open_microwave_with_forward,
    open_microwave_without_forward,
    throw_kettle,
    replay_states,
    plan,
    start_elsewhere,
    measure_distances,
    choose_tasks,
    change_physics,
    push,
    control_joints,
    follow_hand,
    move_by_name,
    observe_set_states,
    track_setpoints,
    read_ranges,
)


def assert_equal(one, other):
    tree.map_structure(np.testing.assert_array_equal, one, other)


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: program.__name__)
def test_a_program_for_the_original_computes_the_same_numbers(program):
    with original_environment() as original:
        expected = program(original)
    assert_equal(program(FrankaKitchenEnv()), expected)


@pytest.mark.full
@pytest.mark.parametrize(
    "options", [{}, {"physics": "fast"}, {"control_mode": "ee_delta_pose"}, {"variations": ["layout"]}]
)
def test_data_that_is_only_read_changes_no_number(options):
    one, other = FrankaKitchenEnv(**options), FrankaKitchenEnv(**options)
    assert other.data.qpos.shape == (30,)
    assert_equal(one.reset(seed=0), other.reset(seed=0))
    actions = random_actions(np.random.default_rng(0), 60)[:, : one.action_space.shape[0]]
    for action in actions:
        assert_equal(one.step(action), other.step(action))


def test_derived_quantities_are_those_of_the_present_state():
    """The original leaves them as they were before the last physics step; after `mj_forward` both are equal."""
    ours = FrankaKitchenEnv()
    here = ours.data
    with original_environment() as original:
        there, names = original.data, original.robot_env.model_names
        bodies = [
            (number, names.body_name2id[name]) for name, number in ours.robot_env.model_names.body_name2id.items()
        ]
        ours.reset(seed=0)
        original.reset(seed=0)
        touched = 0
        for action in ACTIONS:
            ours.step(action)
            original.step(action)
            np.testing.assert_array_equal(here.qacc_warmstart, there.qacc_warmstart)
            warm_start = there.qacc_warmstart.copy()
            mujoco.mj_forward(original.model, there)
            mujoco.mj_rnePostConstraint(original.model, there)
            there.qacc_warmstart[:] = warm_start
            for field in ("qacc", "qfrc_constraint", "qfrc_actuator", "actuator_force"):
                np.testing.assert_array_equal(getattr(here, field), getattr(there, field), field)
            for i, j in bodies:
                np.testing.assert_array_equal(here.xpos[i], there.xpos[j])
                np.testing.assert_array_equal(here.cfrc_ext[i], there.cfrc_ext[j])
            touched += np.abs(here.cfrc_ext).max() > 0.1
        assert touched > 10


def test_joints_have_the_originals_order_and_names():
    ours = FrankaKitchenEnv()
    names = ours.robot_env.model_names
    with original_environment() as original:
        expected = original.robot_env.model_names
        assert names.joint_name2id == expected.joint_name2id
        assert names.joint_names == expected.joint_names
        assert names.actuator_name2id == expected.actuator_name2id
        for kind in ("body", "site"):
            assert set(getattr(names, f"{kind}_names")) == set(NAMES[kind]) <= set(getattr(expected, f"{kind}_names"))
        mujoco.mj_forward(original.model, original.data)
        ours.robot_env.set_state(original.data.qpos, original.data.qvel)
        for kind in ("body", "site"):
            for name, number in getattr(names, f"{kind}_name2id").items():
                here, there = getattr(ours.data, kind)(name), getattr(original.data, kind)(name)
                assert here.id == getattr(ours.model, kind)(NAMES[kind][name]).id == number
                np.testing.assert_array_equal(here.xpos, there.xpos, name)
                np.testing.assert_array_equal(here.xmat, there.xmat, name)


# What `gymnasium.Env` itself has may be assigned as there.
OF_GYMNASIUM = {name for name in dir(gymnasium.Env) if not name.startswith("_")} | {"action_space", "observation_space"}


def public(environment):
    return {name for name in dir(environment) if not name.startswith("_")} - OF_GYMNASIUM


def test_every_attribute_of_the_original_exists_or_names_the_way():
    ours = FrankaKitchenEnv(render_mode="rgb_array")
    with original_environment() as original:
        assert all(hasattr(ours, name) for name in public(original))
        for name in public(original.robot_env):
            if not hasattr(ours.robot_env, name):
                with refused(AttributeError, f"'{name}'", "env.unwrapped.environment.physics", "get_state()"):
                    getattr(ours.robot_env, name)


def test_no_assignment_is_ignored():
    ours = FrankaKitchenEnv()
    ours.reset(seed=0)
    acting = {"tasks_to_complete", "init_qpos"}
    with original_environment() as original:
        for here, there in ((ours, original), (ours.robot_env, original.robot_env)):
            values = {name for name in public(there) if not callable(getattr(there, name))}
            for name in values - acting - {"robot_env", "render_mode"}:
                with refused(AttributeError, name):
                    setattr(here, name, -1.5)
    with refused(AttributeError, "goal", "goals="):
        ours.goal = {}
    with refused(TypeError, "goals="):
        ours.goal["kettle"] = np.zeros(7)
    with refused(ValueError, "read-only"):
        ours.goal["kettle"][0] = 0.0
    with refused(AttributeError, "'remove'", "tasks_to_complete ="):
        ours.tasks_to_complete.remove("kettle")


@pytest.mark.full
def test_the_ways_that_errors_name_work():
    ours = FrankaKitchenEnv(goals={"kettle": np.zeros(7)}, object_noise_ratio=0.0, robot_noise_ratio=0.0, visuals=True)
    observation, _ = ours.reset(seed=0)
    np.testing.assert_array_equal(ours.goal["kettle"], np.zeros(7))
    assert ours.object_noise_ratio == ours.robot_env.robot_noise_ratio == 0.0
    np.testing.assert_array_equal(observation["observation"][:9], ours.data.qpos[:9])
    assert ours.mujoco_renderer.model is ours.model
    assert ours.environment.physics.data.ptr is ours.data
    start = ours.init_qpos.copy()
    start[MICROWAVE] = -0.2
    observation, _ = ours.reset(options={"start_state": start})
    assert observation["achieved_goal"]["microwave"] == -0.2
    state = ours.get_state()
    ours.step(ACTIONS[0])
    ours.set_state(state)
    np.testing.assert_array_equal(ours.data.qpos, start)


@pytest.mark.parametrize("name", ["sim", "viewer", "datta", "_obs_dict", "get_env_state", "__no_such__"])
def test_an_attribute_that_is_missing_is_an_attribute_error(name):
    ours = FrankaKitchenEnv()
    assert not hasattr(ours, name)
    assert not hasattr(ours.robot_env, name)
    assert getattr(ours, name, 7) == 7
    with refused(AttributeError, f"'{name}'") as raised:
        getattr(ours, name)
    assert raised.value.name == name
    if not name.startswith("__"):
        assert "env.unwrapped.environment.physics" in str(raised.value)


@pytest.mark.full
def test_an_attribute_may_be_assigned_the_value_it_has():
    ours = FrankaKitchenEnv(render_mode="rgb_array")
    ours.robot_env.render_mode = "rgb_array"
    ours.terminate_on_tasks_completed = True
    ours.robot_env.data = ours.data
    assert ours.robot_env.render_mode == "rgb_array"


def test_near_names_are_suggested():
    ours = FrankaKitchenEnv()
    for owner, wrong, right in (
        (ours, "robot_envs", "robot_env"),
        (ours, "datta", "data"),
        (ours.robot_env, "set_stat", "set_state"),
    ):
        with refused(AttributeError, f"'{wrong}'", f"'{right}'"):
            getattr(owner, wrong)


@pytest.mark.full
def test_a_renderer_needs_a_scene_with_visuals():
    ours = FrankaKitchenEnv()
    assert not hasattr(ours.robot_env, "mujoco_renderer")
    with refused(AttributeError, "render_mode='rgb_array'", "visuals=True"):
        _ = ours.robot_env.mujoco_renderer


@pytest.mark.rendering
def test_programs_film_with_gymnasiums_renderer():
    ours = FrankaKitchenEnv(render_mode="rgb_array", width=64, height=48)
    ours.reset(seed=0)
    image = ours.robot_env.mujoco_renderer.render("rgb_array")
    assert image.shape == (48, 64, 3)
    np.testing.assert_array_equal(image, ours.render())
    ours.data.qpos[MICROWAVE] = -1.5
    mujoco.mj_forward(ours.model, ours.data)
    assert (ours.robot_env.render() != image).any()


@pytest.mark.parametrize("make_copy", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_copies_keep_what_a_program_wrote(make_copy):
    ours = FrankaKitchenEnv()
    ours.reset(seed=0)
    ours.data.qpos[MICROWAVE] = -0.6
    ours.tasks_to_complete = ["kettle"]
    ours.robot_env.init_qpos[MICROWAVE] = -0.3
    other = make_copy(ours)
    assert other.data is not ours.data
    assert other.tasks_to_complete == {"kettle"}
    assert_equal(steps(other), steps(ours))
    assert_equal(other.reset()[0], ours.reset()[0])
    assert other.data.qpos[MICROWAVE] == -0.3


@pytest.mark.full
def test_what_is_read_can_be_copied_and_sent_to_processes():
    ours = FrankaKitchenEnv(tasks_to_complete=["microwave", "kettle"])
    ours.reset(seed=0)
    for make_copy in (copy.copy, copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))):
        assert_equal(make_copy(ours.goal), dict(ours.goal))
        assert make_copy(ours.tasks_to_complete) == ours.tasks_to_complete
    # A copy of one's own may be changed.
    copy.deepcopy(ours.goal)["kettle"][0] = 0.0
    assert [*pickle.loads(pickle.dumps(ours.tasks_to_complete))] == ["microwave", "kettle"]


@pytest.mark.parametrize(
    ("write", "error", "shown"),
    [
        (lambda env: setattr(env, "init_qpos", np.zeros(29)), ValueError, ("init_qpos", "(30,)")),
        (lambda env: setattr(env, "tasks_to_complete", {"kettel"}), ValueError, ("kettel", "kettle")),
        (lambda env: setattr(env, "tasks_to_complete", "kettle"), TypeError, ("tasks_to_complete", "kettle")),
        (lambda env: env.robot_env.set_state(np.zeros(30), np.zeros(30)), ValueError, ("qvel", "(29,)")),
        (lambda env: env.robot_env.set_state(np.full(30, np.nan), np.zeros(29)), ValueError, ("qpos", "nan")),
        (lambda env: env.robot_env.do_simulation(np.zeros(8), 1), ValueError, ("ctrl", "(9,)")),
    ],
)
def test_bad_writes_change_nothing(write, error, shown):
    ours = FrankaKitchenEnv()
    ours.reset(seed=0)
    before = ours.robot_env.state_vector()
    with refused(error, *shown):
        write(ours)
    np.testing.assert_array_equal(ours.robot_env.state_vector(), before)
    assert len(ours.tasks_to_complete) == 7


@pytest.mark.full
@pytest.mark.parametrize("name", ["data", "model", "goal", "robot_env", "tasks_to_complete"])
def test_vectors_name_the_way_to_attributes_of_single_environments(name):
    envs = gymnasium.make_vec("kitchen_suite:KitchenSuite/FrankaKitchen-v1", 2, tasks_to_complete=["kettle"])
    for read in (envs.get_attr, envs.call):
        with refused(AttributeError, f"'{name}'", "vectorization_mode='sync'"):
            read(name)
    with refused(AttributeError, "'set_state'"):
        envs.call("set_state", np.zeros(30), np.zeros(29))


def test_gymnasiums_own_vectors_have_them():
    envs = gymnasium.make_vec(
        "kitchen_suite:KitchenSuite/FrankaKitchen-v1", 2, vectorization_mode="sync", tasks_to_complete=["kettle"]
    )
    envs.reset(seed=0)
    assert [data.qpos.shape for data in envs.get_attr("data")] == [(30,), (30,)]
    assert envs.get_attr("tasks_to_complete") == ({"kettle"}, {"kettle"})
    envs.close()
