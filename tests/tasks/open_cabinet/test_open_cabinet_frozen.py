"""The physics that the open_cabinet domain is frozen with.

Policies do not carry over from one physics to another: a change of any number here means a new version of the
environment's id, not a new number in this file.
"""

import mujoco
import numpy as np
import pytest

from kitchen_suite import suite
from kitchen_suite.tasks.control_modes.joints import DEFAULT_POSE

# Mass [kg], principal moments of inertia [kg m^2].
BODIES = {
    "franka/link0": (0.629769, 0.004304650123430995, 0.0038798390919025393, 0.0031305107846664577),
    "franka/link1": (4.970684, 0.7071370144886014, 0.7034354292338572, 0.008524556277543102),
    "franka/link2": (0.646926, 0.031032642565176665, 0.028300106936833876, 0.002734250497989519),
    "franka/link3": (3.228604, 0.04150138828861057, 0.04147925727066558, 0.0012463544407238258),
    "franka/link4": (3.587895, 0.03495964042412708, 0.028148276242039784, 0.010620083333833187),
    "franka/link5": (1.225946, 0.036762538266730434, 0.028853091260661566, 0.008034370472607995),
    "franka/link6": (1.666555, 0.005842761226567756, 0.004310373704197246, 0.0015978650692349983),
    "franka/link7": (0.735522, 0.012734492874724498, 0.01010547714435624, 0.004518029980919319),
    "franka/hand": (0.73, 0.0025, 0.0017, 0.001),
    "franka/left_finger": (0.015, 2.375e-06, 2.375e-06, 7.5e-07),
    "franka/right_finger": (0.015, 2.375e-06, 2.375e-06, 7.5e-07),
    "cabinet/drawer_top": (2.0, 0.16374412900597235, 0.10858485768019796, 0.06386396821825568),
    "cabinet/drawer_bottom": (2.0, 0.16374412900597235, 0.10858485768019796, 0.06386396821825568),
    "cabinet/door_left": (3.0, 0.05470925, 0.01984025, 0.035069),
    "cabinet/door_right": (3.0, 0.05470925, 0.01984025, 0.035069),
}
# Range, damping, armature, dry friction.
JOINTS = {
    "franka/joint1": (-2.8973, 2.8973, 1.0, 0.1, 0.0),
    "franka/joint2": (-1.7628, 1.7628, 1.0, 0.1, 0.0),
    "franka/joint3": (-2.8973, 2.8973, 1.0, 0.1, 0.0),
    "franka/joint4": (-3.0718, -0.0698, 1.0, 0.1, 0.0),
    "franka/joint5": (-2.8973, 2.8973, 1.0, 0.1, 0.0),
    "franka/joint6": (-0.0175, 3.7525, 1.0, 0.1, 0.0),
    "franka/joint7": (-2.8973, 2.8973, 1.0, 0.1, 0.0),
    "franka/finger_joint1": (0.0, 0.04, 5.0, 0.1, 0.0),
    "franka/finger_joint2": (0.0, 0.04, 5.0, 0.1, 0.0),
    "cabinet/drawer_top_joint": (0.0, 0.4, 15.0, 0.0, 3.0),
    "cabinet/drawer_bottom_joint": (0.0, 0.4, 15.0, 0.0, 3.0),
    "cabinet/door_left_joint": (0.0, 1.5707963267948966, 1.0, 0.0, 0.5),
    "cabinet/door_right_joint": (0.0, 1.5707963267948966, 1.0, 0.0, 0.5),
}
# Gain, velocity gain, greatest force.
ACTUATORS = [(4500, 450, 87)] * 2 + [(3500, 350, 87)] * 2 + [(2000, 200, 12)] * 3 + [(1000, 100, 100)] * 2
# Half sizes, sliding friction, contact dimension.
COLLIDING = {
    **{f"franka/{side}_finger_pad": (0.0105, 0.005, 0.0095, 1.5, 4) for side in ("left", "right")},
    **{f"franka/{side}_finger_shank": (0.0105, 0.0055, 0.0175, 1.5, 4) for side in ("left", "right")},
    **{f"cabinet/drawer_{drawer}_handle_bar": (0.006, 0.075, 0.0, 1.0, 3) for drawer in ("top", "bottom")},
    **{f"cabinet/drawer_{drawer}_front": (0.01, 0.377, 0.097, 1.0, 3) for drawer in ("top", "bottom")},
}
# Joints after a second in which the actions of `test_where_fixed_actions_lead` are made from the default pose.
END = [
    0.21419416,
    -0.43327497,
    -0.07593443,
    -2.96413649,
    -0.09657824,
    3.28089639,
    -0.60688084,
    0.02796387,
    0.02828014,
    0.20788601,
    0.10788601,
    0.50414257,
    0.70414257,
]


@pytest.fixture(scope="module")
def env():
    return suite.load("open_cabinet", "top_drawer", {"random": 0, "visuals": False, "gripper": "deterministic"})


@pytest.fixture
def model(env):
    return env.physics.model.ptr


def close(actual, expected):
    np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-12)


def test_options(env, model):
    option = model.opt
    assert (option.timestep, env.control_timestep(), env.step_limit) == (0.005, 0.01, 700)
    assert option.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    assert option.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    assert option.solver == mujoco.mjtSolver.mjSOL_NEWTON
    limits = (option.iterations, option.ls_iterations, option.noslip_iterations, option.ccd_iterations)
    assert limits == (100, 50, 0, 35)
    close((option.impratio, option.tolerance, option.ls_tolerance, option.ccd_tolerance), (10, 1e-8, 0.01, 1e-6))
    close(option.gravity, (0, 0, -9.81))
    assert (option.density, option.viscosity, *option.wind) == (0, 0, 0, 0, 0)
    assert (option.disableflags, option.enableflags, option.disableactuator) == (0, 0, 0)


def test_masses_and_inertias(model):
    massive = {model.body(i).name for i in range(model.nbody) if model.body_mass[i]}
    assert massive == set(BODIES)
    for name, numbers in BODIES.items():
        body = model.body(name)
        close((*body.mass, *body.inertia), numbers)


def test_joints(model):
    assert [model.joint(i).name for i in range(model.njnt)] == list(JOINTS)
    for name, numbers in JOINTS.items():
        joint = model.joint(name)
        close((*joint.range, *joint.damping, *joint.armature, *joint.frictionloss), numbers)
        assert (joint.limited.item(), joint.stiffness.item()) == (1, 0)
    close(model.dof_solimp[9:], [[0.99, 0.999, 0.001, 0.5, 2]] * 4)
    close(model.dof_solref, [[0.02, 1]] * 13)
    close(model.jnt_solimp, [[0.9, 0.95, 0.001, 0.5, 2]] * 13)
    close(model.jnt_solref, [[0.02, 1]] * 13)


def test_actuators(model):
    gain, velocity_gain, force = np.transpose(ACTUATORS)
    zeros = np.zeros(9)
    close(model.actuator_gainprm[:, :3], np.transpose([gain, zeros, zeros]))
    close(model.actuator_biasprm[:, :3], -np.transpose([zeros, gain, velocity_gain]))
    close(model.actuator_forcerange, np.transpose([-force, force]))
    close(model.actuator_ctrlrange, model.jnt_range[:9])


def test_contacts(model):
    for name, numbers in COLLIDING.items():
        geom = model.geom(name)
        close((*geom.size, geom.friction[0], *geom.condim), numbers)
        close(geom.friction[1:], (0.005, 0.0001))
        own = (1, 0) if name.startswith("franka") else (0, 1)
        assert (geom.contype.item(), geom.conaffinity.item(), geom.priority.item()) == (*own, 0)
    close(model.geom_solref, [[0.02, 1]] * model.ngeom)
    close(model.geom_solimp, [[0.9, 0.95, 0.001, 0.5, 2]] * model.ngeom)
    close((model.geom_margin, model.geom_gap), np.zeros((2, model.ngeom)))


def test_where_fixed_actions_lead(env):
    # Depends on poses of bodies, joints and centres of mass, which the tables above leave out.
    env.reset()
    with env.physics.reset_context():
        env.physics.data.qpos[:] = [*DEFAULT_POSE, 0.2, 0.1, 0.5, 0.7]
        env.physics.data.ctrl[:] = DEFAULT_POSE
        env.physics.data.qvel[9:] = 0.2
    for step in range(100):
        env.step(0.1 * np.sin(0.1 * step + np.arange(8)))
    np.testing.assert_allclose(env.physics.data.qpos, END, rtol=0, atol=1e-5)
