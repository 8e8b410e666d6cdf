"""Contact forces on a robot and on what it carries, summed contact by contact with `mj_contactForce`."""

import copy
import functools

import mujoco
import numpy as np
from dm_control import mjcf


def forces_by_hand(environment, data):
    """Returns the normal forces `(2,)` on the arm without the hand and on the hand [N], and the robot's contacts.

    A contact of two parts of the robot is one of its contacts, whose force does not count.
    """
    model = environment.physics.model.ptr
    of_robot, of_hand = _parts(environment)
    forces = np.zeros(2)
    wrench = np.zeros(6)
    count = 0
    for number, bodies in enumerate(model.geom_bodyid[np.reshape(data.contact.geom, (-1, 2))]):
        count += of_robot[bodies].any()
        if of_robot[bodies].sum() == 1:
            mujoco.mj_contactForce(model, data, number, wrench)
            forces[int(of_hand[bodies].any())] += wrench[0]
    return forces, count


def carried_by_hand(environment, data):
    """Returns the normal forces `(k,)` on objects that the hand touches, those by the hand left out [N], and contacts.

    These are the most that an object has.
    """
    physics = environment.physics
    model = physics.model.ptr
    _, of_hand = _parts(environment)
    joints = [joint for joint in environment.task.mdp.carried_joints(environment.task.scene) if joint is not None]
    objects = [_subtree(model, physics.bind(joint.parent).element_id) for joint in joints]
    # By others, and by the hand.
    forces = np.zeros((2, len(objects)))
    counts = np.zeros(len(objects), int)
    wrench = np.zeros(6)
    for number, bodies in enumerate(model.geom_bodyid[np.reshape(data.contact.geom, (-1, 2))]):
        for place, is_part in enumerate(objects):
            if is_part[bodies].any():
                mujoco.mj_contactForce(model, data, number, wrench)
                forces[int(of_hand[bodies].any()), place] += wrench[0]
                counts[place] += 1
    return np.where(forces[1] > 0.0, forces[0], 0.0), counts.max()


def step_by_hand(environment, action, forces_of=forces_by_hand):
    """Makes a control step; returns the forces `(k, n)` in each of its physics steps, and the most contacts in one.

    They are those of a copy of the physics that makes the same steps one by one. `forces_of` an environment and its
    data are forces `(k,)` and a number of contacts.
    """
    model, data = environment.physics.model.ptr, environment.physics.data.ptr
    copied = copy.copy(data)
    environment.step(action)
    copied.ctrl[:] = data.ctrl
    steps = []
    for number in range(environment.task.physics_steps_per_control_step):
        # Before the integration: when a tree falls asleep in it, MuJoCo evaluates the forces anew.
        mujoco.mj_forward(model, copied)
        steps.append(forces_of(environment, copied))
        # As dm_control steps: the first half of the first step has been made.
        (mujoco.mj_step if number else mujoco.mj_step2)(model, copied)
    np.testing.assert_array_equal(copied.qpos, data.qpos)
    forces, counts = zip(*steps, strict=True)
    return np.transpose(forces), max(counts)


@functools.lru_cache(maxsize=1)
def _parts(environment):
    """Returns which bodies are the robot's, and which the hand's, `(nbody,)`."""
    physics, robot = environment.physics, environment.task.robot
    base = physics.bind(mjcf.get_attachment_frame(robot.mjcf_model)).element_id
    last = physics.bind(robot.joints[robot.arm_size - 1].parent).element_id
    return tuple(_subtree(physics.model.ptr, root) for root in (base, last))


def _subtree(model, root):
    found = np.zeros(model.nbody, bool)
    found[root] = True
    for body in range(root + 1, model.nbody):
        found[body] = found[model.body_parentid[body]]
    return found
