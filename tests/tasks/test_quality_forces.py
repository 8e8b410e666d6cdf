"""Contact forces of `quality=True` against `mj_contactForce`, physics step by physics step, whatever sleeps."""

import copy
import pickle

import gymnasium
import mujoco
import numpy as np
import pytest
from dm_control import mjcf
from helpers.sweeps import brief

from kitchen_suite import suite
from kitchen_suite.tasks.episode import quality

# Task and scale of random actions by domain.
TASKS = {
    "kitchen": ("all", 1.0),
    "kitchens": ("any_2", 1.0),
    "microwave_table": ("open", 0.05),
    "open_cabinet": ("top_drawer", 0.05),
}
CASES = [
    (domain, physics)
    for domain in TASKS
    for physics in ("exact", "fast")
    if (domain, physics) != ("open_cabinet", "fast")
]
# Control steps of a case: together 10,000.
STEPS = -(-10_000 // len(CASES))
# Control steps for which random actions point the same way, so that the arm reaches furniture and itself.
HELD = 50
TOLERANCE = 1e-9  # [N]


class ByHand:
    """Makes the physics steps of an environment again, and sums the normal forces of contacts after each."""

    def __init__(self, environment):
        self._environment = environment
        self._model = environment.physics.model.ptr
        self._before = mujoco.MjData(self._model)
        robot, bind = environment.task.robot, environment.physics.bind
        base = bind(mjcf.get_attachment_frame(robot.mjcf_model)).element_id
        hand = bind(robot.joints[robot.arm_size - 1].parent).element_id
        self._of_robot, self._of_hand = self._subtree(base), self._subtree(hand)

    def _subtree(self, root):
        found = {root}
        for body in range(root + 1, self._model.nbody):
            if self._model.body_parentid[body] in found:
                found.add(body)
        return found

    def step(self, action):
        """Makes a control step; returns forces on the arm without the hand, and on the hand, `(2, n)` [N]."""
        physics, model, data = self._environment.physics, self._model, self._before
        mujoco.mj_copyData(data, model, physics.data.ptr)
        timestep = self._environment.step(action)
        data.ctrl[:] = physics.data.ctrl
        forces = []
        for _ in range(self._environment.task.physics_steps_per_control_step):
            mujoco.mj_step(model, data)
            forces.append(self._forces(data))
        np.testing.assert_array_equal(data.qpos, physics.data.qpos)
        if timestep.last():
            self._environment.reset()
        return np.transpose(forces)

    def _forces(self, data):
        sums, force = [0.0, 0.0], np.zeros(6)
        for number in range(data.ncon):
            bodies = {int(self._model.geom_bodyid[geom]) for geom in data.contact[number].geom}
            if bodies & self._of_robot and not bodies <= self._of_robot:
                mujoco.mj_contactForce(self._model, data, number, force)
                sums[bool(bodies & self._of_hand)] += force[0]
        return sums


def load(domain, physics, seed=0):
    task = {"random": seed, "visuals": False, "quality": True, "physics": physics, "time_limit": None}
    environment = suite.load(domain, TASKS[domain][0], task)
    environment.reset()
    return environment


def actions_of(environment, domain, count, seed=0):
    generator, shape = np.random.default_rng(seed), environment.action_spec().shape
    chosen = generator.uniform(-1.0, 1.0, (-(-count // HELD), *shape)) * TASKS[domain][1]
    return np.repeat(chosen, HELD, axis=0)[:count]


def measured(environment):
    """Forces on the arm without the hand, and on the hand, in the physics steps of the last control step."""
    task = environment.task
    return quality.contact_forces(task.meter.read(task.simulation).contacts)


def check(domain, physics, steps, seed):
    environment = load(domain, physics, seed)
    by_hand = ByHand(environment)
    touching = np.zeros(2, int)
    for action in actions_of(environment, domain, steps, seed):
        expected = by_hand.step(action)
        forces = measured(environment)
        assert (forces >= 0.0).all()
        np.testing.assert_allclose(forces, expected, rtol=0.0, atol=TOLERANCE)
        touching += (expected > 0.0).any(axis=1)
    return touching


@pytest.mark.full
@pytest.mark.parametrize(("domain", "physics"), brief(CASES, [("kitchen", "fast")], CASES))
def test_forces_are_those_of_single_contacts_whatever_sleeps(domain, physics):
    assert check(domain, physics, 600, seed=0).sum() > 10


@pytest.mark.nightly
@pytest.mark.parametrize(("domain", "physics"), CASES)
def test_forces_of_ten_thousand_control_steps_are_those_of_single_contacts(domain, physics):
    assert check(domain, physics, STEPS, seed=1).sum() > 50


def test_a_contact_of_the_arm_with_its_own_hand_counts_for_nothing_while_objects_sleep():
    environment = load("kitchen", "fast")
    by_hand, found = ByHand(environment), 0
    physics, robot = environment.physics, environment.task.robot
    bodies = {physics.bind(body).element_id for body in robot.mjcf_model.find_all("body")}
    model = physics.model.ptr
    for action in actions_of(environment, "kitchen", 150):
        expected = by_hand.step(action)
        data = physics.data.ptr
        pairs = [{int(model.geom_bodyid[geom]) for geom in data.contact[i].geom} for i in range(data.ncon)]
        if (data.tree_asleep >= 0).any() and any(pair <= bodies for pair in pairs):
            found += 1
        np.testing.assert_allclose(measured(environment), expected, rtol=0.0, atol=TOLERANCE)
    # The robot has touched itself while something slept.
    assert found


@pytest.mark.full
@pytest.mark.parametrize("domain", ["microwave_table", "kitchen", "kitchens"])
def test_copies_in_fast_physics_have_the_forces_of_the_original(domain):
    """Up to rounding, since MuJoCo's state lacks what it has computed of objects before they fell asleep."""
    environment = load(domain, "fast")
    actions = actions_of(environment, domain, 240)
    for start in range(0, 240, 60):
        for action in actions[start : start + 55]:
            environment.step(action)
        others = [copy.deepcopy(environment), pickle.loads(pickle.dumps(environment)), load(domain, "fast", seed=7)]
        others[-1].set_state(environment.get_state())
        for each in (environment, *others):
            each.step(actions[start + 55])
            assert min(value for key, value in each.task.quality.items() if "force" in key) >= 0.0
        for other in others:
            np.testing.assert_allclose(measured(other), measured(environment), rtol=1e-9, atol=1e-6)
            assert other.task.quality == pytest.approx(environment.task.quality, rel=1e-9, abs=1e-6)
        for action in actions[start + 56 : start + 60]:
            environment.step(action)


@pytest.mark.full
@pytest.mark.parametrize("env_id", ["FrankaMicrowaveTable-v1", "FrankaKitchen-v1", "Kitchens-v1"])
def test_vectorised_forces_in_fast_physics_are_those_of_single_environments(env_id):
    options = {"physics": "fast", "quality": True}
    many = gymnasium.make_vec(
        f"kitchen_suite:KitchenSuite/{env_id}", 3, vectorization_mode="vector_entry_point", **options
    )
    single = gymnasium.make(f"kitchen_suite:KitchenSuite/{env_id}", **options).unwrapped
    many.reset(seed=4)
    single.reset(seed=5)
    scale = 0.05 if "Table" in env_id else 1.0
    generator = np.random.default_rng(0)
    for _ in range(4):
        action = generator.uniform(-scale, scale, many.action_space.shape)
        for _ in range(30):
            infos = many.step(action)[4]
            info = single.step(action[1])[4]
            for key in ("peak_arm_contact_force", "mean_arm_contact_force", "peak_contact_force", "mean_contact_force"):
                assert infos[key][1] == info[key] >= 0.0
