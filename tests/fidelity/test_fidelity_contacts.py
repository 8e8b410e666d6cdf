"""The contacts of the compiled model against the reference's, and why none can be missing or come in another order."""

import itertools

import mujoco
import numpy as np
import pytest
from dm_control import mjcf
from helpers.original import BODIES, colliding_geoms, reference_model, same_geoms
from helpers.sweeps import brief

from kitchen_suite.entities import build_kitchen_scene

FIELDS = ("dist", "pos", "frame", "includemargin", "friction", "solref", "solreffriction", "solimp", "dim")
# Corners of a box around the room that extends beyond its walls and below its floor [m].
ROOM = ((-2.0, -1.5, -0.2), (2.0, 2.0, 3.2))


@pytest.fixture(
    scope="module", params=[pytest.param(True, marks=pytest.mark.nightly), False], ids=["visuals", "no_visuals"]
)
def ours(request):
    return mjcf.Physics.from_mjcf_model(build_kitchen_scene(visuals=request.param).arena.mjcf_model).model.ptr


@pytest.fixture(scope="module")
def reference():
    return reference_model()


@pytest.mark.parametrize("count", brief([2_000, 10_000, 100_000], kept=[2_000], full=[10_000]))
def test_contacts_are_equal_and_in_the_same_order(ours, reference, count):
    partner = same_geoms(ours, reference)
    here, there = mujoco.MjData(ours), mujoco.MjData(reference)
    met_kettle, met_robot = set(), set()
    kettle, robot = (geoms_of(reference, entity) for entity in ("kettle", "franka"))
    for qpos in random_configurations(np.random.default_rng(count), reference, count):
        found = contacts(ours, here, qpos)
        expected = contacts(reference, there, qpos)
        assert [[partner[i] for i in pair] for pair in found.geom.tolist()] == expected.geom.tolist()
        for field in FIELDS:
            np.testing.assert_array_equal(getattr(found, field), getattr(expected, field), field)
        for pair in map(set, expected.geom.tolist()):
            met_kettle |= pair - kettle if pair & kettle else set()
            met_robot |= pair - robot if pair & robot else set()
    # The kettle met every geom, the robot most of those within reach.
    assert met_kettle == set(colliding_geoms(reference)) - kettle
    assert len(met_robot) > 40


def random_configurations(rng, model, count):
    """Joints in their ranges or a tenth of them beyond, the kettle anywhere, as often as not into something."""
    data = mujoco.MjData(model)
    low, high = model.jnt_range[:-1].T
    geoms = colliding_geoms(model)
    for _ in range(count):
        slack = rng.choice((0.0, 0.1)) * (high - low)
        data.qpos[:23] = rng.uniform(low - slack, high + slack)
        mujoco.mj_kinematics(model, data)
        somewhere = rng.uniform(*ROOM)
        by_something = data.geom_xpos[rng.choice(geoms)] + rng.normal(scale=0.2, size=3)
        data.qpos[23:26] = somewhere if rng.random() < 0.3 else by_something
        data.qpos[26:] = rng.normal(size=4)
        yield data.qpos.copy()


def contacts(model, data, qpos):
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_collision(model, data)
    return data.contact


def geoms_of(model, entity):
    """The colliding geoms of the reference's counterpart of one of our moving entities."""
    bodies = [model.body(there).id for here, there in BODIES.items() if here.startswith(entity)]
    return {i for i in colliding_geoms(model) if model.body_weldid[model.geom_bodyid[i]] in bodies}


def test_the_robots_base_and_first_link_are_apart_at_every_angle(ours):
    """The one pair of bodies that is left out of the search."""
    (signature,) = ours.exclude_signature
    pair = [ours.body(int(body)) for body in divmod(signature, 1 << 16)]
    assert [body.name for body in pair] == ["franka/link0", "franka/link1"]
    joint = ours.joint(int(pair[1].jntadr.item()))
    base, first = (next(i for i in colliding_geoms(ours) if ours.geom_bodyid[i] == body.id) for body in pair)
    data = mujoco.MjData(ours)
    step = 0.002
    gaps = []
    for angle in np.arange(-np.pi, np.pi, step):
        data.qpos[joint.qposadr] = angle
        mujoco.mj_kinematics(ours, data)
        gaps.append(mujoco.mj_geomDistance(ours, data, base, first, 1.0, None))
    # No point of the link is farther from the axis; between two angles it moves by half a step's arc at most.
    farthest = ours.geom_rbound[first] + np.linalg.norm(ours.geom_pos[first])
    assert min(gaps) - farthest * step / 2 > 0.0005
    assert ours.geom_margin[base] == ours.geom_margin[first] == 0


def test_what_the_floor_is_not_compared_with_is_far_above_it(ours):
    data = mujoco.MjData(ours)
    rng = np.random.default_rng(0)
    doors_and_knobs = [
        i for i in colliding_geoms(ours) if ours.body_weldid[ours.geom_bodyid[i]] and not ours.geom_contype[i]
    ]
    assert len(doors_and_knobs) == 25
    low, high = ours.jnt_range[:-1].T
    for _ in range(1_000):
        data.qpos[:23] = rng.uniform(low, high)
        mujoco.mj_kinematics(ours, data)
        assert np.min(data.geom_xpos[doors_and_knobs, 2] - ours.geom_rbound[doors_and_knobs]) > 1.0


def test_nothing_can_touch_both_halves_of_the_counter(ours):
    """Contacts come in the order of bodies, then geoms: with both halves in one body it could else be another one."""
    data = mujoco.MjData(ours)
    mujoco.mj_kinematics(ours, data)
    left, right = (
        [i for i in colliding_geoms(ours) if ours.geom_bodyid[i] == ours.body(f"counter/{side}").id]
        for side in ("left", "right")
    )
    assert len(left) + len(right) == 25
    gap = min(left_end(ours, data, i) for i in right) - max(right_end(ours, data, i) for i in left)
    assert gap > 0.98
    moving = [i for i in colliding_geoms(ours) if ours.body_weldid[ours.geom_bodyid[i]]]
    for i, j in itertools.product(moving, moving):
        if ours.geom_bodyid[i] == ours.geom_bodyid[j]:
            apart = np.linalg.norm(data.geom_xpos[i] - data.geom_xpos[j])
            assert apart + ours.geom_rbound[i] + ours.geom_rbound[j] < gap


def left_end(model, data, geom):
    return data.geom_xpos[geom, 0] - np.abs(data.geom_xmat[geom, :3]) @ model.geom_aabb[geom, 3:]


def right_end(model, data, geom):
    return data.geom_xpos[geom, 0] + np.abs(data.geom_xmat[geom, :3]) @ model.geom_aabb[geom, 3:]
