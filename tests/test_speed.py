"""The compiled model steps faster than the reference's."""

import statistics
import time

import mujoco
import numpy as np
import pytest
from dm_control import mjcf
from reference import reference_model

from kitchen_suite.entities import build_kitchen
from kitchen_suite.tasks.kitchen_start import INITIAL_QPOS
from kitchen_suite.tasks.velocity_control import position_target

STEPS = 280


@pytest.mark.slow
@pytest.mark.parametrize(("visuals", "least"), [(False, 1.4), (True, 1.25)], ids=["no_visuals", "visuals"])
def test_bare_steps_are_faster_than_the_references(visuals, least):
    """Rounds are interleaved, and timed in the process's own seconds: machines are shared and noisy."""
    ours = mjcf.Physics.from_mjcf_model(build_kitchen(visuals=visuals).arena.mjcf_model).model.ptr
    ratios = []
    for seed in range(9):
        actions = np.random.default_rng(seed).uniform(-1.0, 1.0, (STEPS, 9))
        there, here = (seconds(model, actions) for model in (reference_model(), ours))
        ratios.append(there / here)
    print(f"{statistics.median(ratios):.2f} times as fast, {min(ratios):.2f} to {max(ratios):.2f}")
    assert statistics.median(ratios) > least


def seconds(model, actions):
    """What an episode of bare physics steps takes, controls computed as the task does."""
    data = mujoco.MjData(model)
    data.qpos[:] = INITIAL_QPOS
    start = time.process_time()
    for action in actions:
        data.ctrl[:] = position_target(data.qpos[:9], action, velocity_scale=2.0, timestep=0.08)
        mujoco.mj_step(model, data, 40)
    return time.process_time() - start
