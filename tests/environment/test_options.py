"""Edits of MuJoCo's options in a running environment: they act in the next step, as in MuJoCo's own."""

import copy

import mujoco
import numpy as np
import pytest

from kitchen_suite import suite

EDITS = {
    "noslip_iterations": 10,
    "solver": mujoco.mjtSolver.mjSOL_PGS,
    "cone": mujoco.mjtCone.mjCONE_PYRAMIDAL,
    "jacobian": mujoco.mjtJacobian.mjJAC_SPARSE,
    "impratio": 5.0,
    "timestep": 0.001,
    "viscosity": 0.5,
    "gravity": (0.0, 0.0, -3.0),
    "disableflags": mujoco.mjtDisableBit.mjDSBL_WARMSTART,
    "enableflags": mujoco.mjtEnableBit.mjENBL_ENERGY,
}


@pytest.mark.parametrize("physics", ["exact", "fast"])
@pytest.mark.parametrize("name", EDITS)
def test_an_edited_option_acts_in_the_next_step_as_in_mujocos_own(name, physics):
    environment = suite.load(
        "microwave_table", suite.default_task("microwave_table"), {"random": 0, "visuals": False, "physics": physics}
    )
    environment.reset()
    action = np.zeros(environment.action_spec().shape)
    for _ in range(3):
        environment.step(action)
    model, data = environment.physics.model.ptr, environment.physics.data.ptr
    environment.physics.model.opt.gravity[:] = EDITS["gravity"] if name == "gravity" else model.opt.gravity
    if name != "gravity":
        setattr(environment.physics.model.opt, name, EDITS[name])
    expected_model, expected = copy.deepcopy(model), copy.deepcopy(data)
    environment.step(action)
    # The targets of the step, from the same observation.
    expected.ctrl[:] = data.ctrl
    steps = environment.task.physics_steps_per_control_step
    mujoco.mj_step(expected_model, expected, steps)
    np.testing.assert_array_equal(data.qpos, expected.qpos)
    np.testing.assert_array_equal(data.qvel, expected.qvel)
    # Another step and another reset, with the option as it now is.
    environment.step(action)
    environment.reset()
    assert np.isfinite(environment.step(action).reward)


def test_every_option_is_watched():
    task = suite.default_task("microwave_table")
    environment = suite.load("microwave_table", task, {"random": 0, "visuals": False})
    environment.reset()
    physics = environment.physics
    option = physics.model.ptr.opt
    names = [name for name in dir(mujoco.MjOption) if not name.startswith("_")]
    assert len(names) > 20
    for name in names:
        before, value = physics._options.raw, getattr(option, name)
        if isinstance(value, np.ndarray):
            value[-1] += 1.0
        else:
            setattr(option, name, value + 1)
        assert physics._options.raw != before, name
