"""Designs of generated kitchens: the grammar's, those in JSON and their errors, and the scenes built from them."""

import collections
import copy
import json
import types

import msgspec
import mujoco
import numpy as np
import pytest
from dm_control import mjcf
from helpers.errors import ODD_VALUES, assert_is_short, refused

from kitchen_suite.entities import KitchenDesign, build_generated_kitchen, kitchen_designs
from kitchen_suite.entities.arms import make_robot
from kitchen_suite.entities.fixture_designs import (
    KINDS,
    BaseDoorsDesign,
    DrawersDesign,
    HingeCabinetDesign,
    HoodDesign,
    MicrowaveDesign,
    OvenDesign,
    SlideCabinetDesign,
    StoveDesign,
    TallDoorDesign,
    WallDoorsDesign,
    WallSlidingDesign,
)
from kitchen_suite.entities.fixtures import CLEARANCE, PANEL, BoxFixture
from kitchen_suite.entities.kitchen_designs import SPLITS
from kitchen_suite.entities.kitchen_styles import STYLES
from kitchen_suite.physics_names import FAST
from kitchen_suite.policies.experts.kitchen_skills import TIP

MINE = {
    "counter_height": 1.76,
    "style": "oak",
    "rows": [
        {
            "side": "back",
            "level": "base",
            "distance": 0.5,
            "start": -0.6,
            "fixtures": [
                {"kind": "drawers", "width": 0.6, "height": 0.31, "count": 2, "handle": "bar"},
                {"kind": "base_doors", "width": 0.5, "height": 0.45, "count": 1, "handle": "knob", "hinge": "left"},
            ],
        },
        {
            "side": "back",
            "level": "wall",
            "distance": 0.6,
            "start": -0.6,
            "height": 2.25,
            "fixtures": [{"kind": "wall_doors", "width": 0.6, "height": 0.4, "count": 2, "handle": "bar", "gap": 0.2}],
        },
    ],
}
ROW, WALL, FIXTURE = ("rows", 0), ("rows", 1), ("rows", 0, "fixtures", 0)
MISSING = object()


def changed(path, value):
    """Returns `MINE` with another value at a path, or without the key there."""
    design = copy.deepcopy(MINE)
    *parents, key = path
    part = design
    for each in parents:
        part = part[each]
    part[key] = value
    if value is MISSING:
        del part[key]
    return design


def drawn(count):
    """The first designs of each split."""
    return {split: [KitchenDesign.make(number, split) for number in range(count)] for split in SPLITS}


@pytest.mark.full
@pytest.mark.parametrize("count", [10, pytest.param(200, marks=pytest.mark.nightly)])
def test_drawn_designs_are_possible_when_they_are_read_from_json(count):
    # All of them: docs/experiments/kitchens.py designs.
    for split, kitchens in drawn(count).items():
        for kitchen in kitchens:
            read = KitchenDesign.make(json.loads(json.dumps(kitchen.to_json())), split)
            assert read == msgspec.structs.replace(kitchen, name="")


def test_the_arm_is_as_long_as_its_links():
    model = mjcf.Physics.from_mjcf_model(make_robot("franka", visuals=False).mjcf_model).named.model
    link = {number: model.body_pos[f"link{number}"] for number in range(1, 8)}
    upper, forearm = (np.linalg.norm(each) for each in (link[3] + link[4], link[5]))
    hand = np.hypot(np.linalg.norm(link[7]), np.linalg.norm(model.site_pos["end_effector"]))
    assert np.linalg.norm(link[1] + link[2]) == pytest.approx(kitchen_designs.SHOULDER)
    assert upper + forearm + hand + TIP == pytest.approx(kitchen_designs.REACH, abs=0.005)


def test_a_written_design_has_its_keys_in_one_order():
    written = {"counter_height": 1.76, "style": "oak", "kettle": False, "rows": MINE["rows"]}
    assert json.dumps(KitchenDesign.make(MINE, "train").to_json()) == json.dumps(written)


def test_numbers_of_numpy_and_read_only_mappings_are_read_as_json_is():
    design = changed((*FIXTURE, "width"), np.float32(0.5))
    design["rows"][0]["fixtures"][0]["count"] = np.int64(1)
    read = KitchenDesign.make(types.MappingProxyType(design), "train")
    assert read.rows[0].fixtures[0] == DrawersDesign(width=0.5, height=0.31, count=1, handle="bar")


@pytest.mark.full
def test_splits_share_no_sequence_of_fixtures():
    train, test = ({kitchen.sequence for kitchen in kitchens} for kitchens in drawn(1_000).values())
    assert not train & test
    # A quarter of the sequences is for tests.
    assert len(train) >= 200
    assert len(test) >= 150


@pytest.mark.full
def test_every_kind_is_in_a_twentieth_of_the_kitchens():
    for kitchens in drawn(1_000).values():
        kinds = collections.Counter(
            kind for each in kitchens for kind in {placed.design.kind for placed in each.placed}
        )
        assert min(kinds[kind] for kind in KINDS) >= 50, kinds


def test_a_number_is_one_kitchen_in_each_split():
    found = drawn(50)
    for split, kitchens in found.items():
        assert KitchenDesign.drawn.__wrapped__(7, split) == kitchens[7]
        assert KitchenDesign.make("7", split) is KitchenDesign.make(kitchens[7], "train") is kitchens[7]
        assert kitchens[7].name == f"{split}/7"
    train, test = found.values()
    assert all(one != other for one, other in zip(train, test, strict=True))


def test_a_file_has_a_design(tmp_path):
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(MINE), encoding="utf-8")
    made = KitchenDesign.make(MINE, "test")
    assert KitchenDesign.make(path, "train") == KitchenDesign.make(str(path), "train") == made
    assert made.to_json() == {**MINE, "kettle": False}
    assert made.sequence == "back base: drawers base_doors; back wall: wall_doors"


OVEN = {"kind": "oven"}
WALL_DOORS = {"kind": "wall_doors", "width": 0.6, "height": 0.4, "count": 2, "handle": "bar"}
TOO_MANY = [{**MINE["rows"][0]["fixtures"][0], "width": 0.3, "height": 0.2, "count": 4}] * 5


@pytest.mark.parametrize(
    ("path", "value", "error", "message"),
    [
        (("counter_height",), 2.0, ValueError, "counter_height must be float <= 1.9, got 2.0"),
        (("counter_height",), "high", TypeError, "counter_height must be float, got 'high'"),
        (("counter_height",), MISSING, ValueError, "design: Object missing required field `counter_height`"),
        (("style",), "blue", ValueError, "style 'blue' does not exist"),
        (("kettle",), 1, TypeError, "kettle must be"),
        (("kettle",), True, ValueError, "kettle must be false in a kitchen without an oven"),
        (("name",), "train/7", ValueError, "key of design 'name' does not exist"),
        (("kettel",), True, ValueError, "key of design 'kettel' does not exist (did you mean 'kettle'?)"),
        ((None,), True, ValueError, "design is no JSON object ("),
        (("\ud800",), True, ValueError, "design is no JSON object ("),
        (("a - at `$.b",), True, ValueError, "key of design 'a - at `$.b' does not exist"),
        (("rows",), {}, TypeError, "rows must be array, got {}"),
        (("rows",), [], ValueError, "rows must have at least one fixture"),
        (ROW, 3, TypeError, "rows[0] must be object, got 3"),
        ((*ROW, "side"), "front", ValueError, "rows[0].side 'front' does not exist"),
        ((*ROW, "level"), "floor", ValueError, "rows[0].level 'floor' does not exist"),
        ((*ROW, "level"), "wall", ValueError, "rows[0]: must have a height if, and only if, its level is 'wall'"),
        ((*ROW, "distance"), -0.1, ValueError, "rows[0].distance must be float >= 0.0, got -0.1"),
        ((*ROW, "distance"), 0.0, ValueError, "rows[0].fixtures[0] stands where the robot does"),
        ((*ROW, "distanse"), 0.5, ValueError, "key of rows[0] 'distanse' does not exist (did you mean 'distance'?)"),
        ((*ROW, "start"), 0.9, ValueError, "rows[0].fixtures[0] (drawers) has drawer_1 out of reach: 1."),
        ((*ROW, "start"), 10**400, ValueError, "rows[0].start must be a number in range, got 1000"),
        ((*ROW, "start"), -1.6, ValueError, "rows[0].start must be float >= -1.5, got -1.6"),
        ((*ROW, "fixtures"), None, TypeError, "rows[0].fixtures must be array, got None"),
        ((*ROW, "fixtures"), [OVEN, OVEN], ValueError, "rows must not have more than one fixture of kind 'oven'"),
        ((*ROW, "fixtures"), TOO_MANY, ValueError, "rows must have at most 16 drawers, doors and knobs, got 22"),
        ((*WALL, "height"), 3.0, ValueError, "rows[1].height must be float <= 2.7, got 3.0"),
        ((*WALL, "height"), 1.7, ValueError, "rows[1].fixtures[0] (wall_doors) overlaps rows[0].fixtures["),
        (FIXTURE, "drawers", TypeError, "rows[0].fixtures[0] must be object, got 'drawers'"),
        ((*FIXTURE, "kind"), "drawer", ValueError, "'drawer' does not exist (did you mean 'drawers'?)"),
        ((*FIXTURE, "kind"), MISSING, ValueError, "rows[0].fixtures[0]: Object missing required field `kind`"),
        (FIXTURE, WALL_DOORS, ValueError, "rows[0]: kind of level 'base' 'wall_doors' does not exist"),
        ((*FIXTURE, "kind"), "oven", ValueError, "key of rows[0].fixtures[0] 'width' does not exist"),
        ((*FIXTURE, "width"), 0.2, ValueError, "rows[0].fixtures[0].width must be float >= 0.3, got 0.2"),
        ((*FIXTURE, "count"), 0, ValueError, "rows[0].fixtures[0].count must be int >= 1, got 0"),
        ((*FIXTURE, "handle"), "ring", ValueError, "rows[0].fixtures[0].handle 'ring' does not exist"),
        ((*FIXTURE, "hinge"), "left", ValueError, "key of rows[0].fixtures[0] 'hinge' does not exist"),
        ((*FIXTURE, "gap"), 2.0, ValueError, "rows[0].fixtures[0].gap must be float <= 1.0, got 2.0"),
        (("rows", 0, "fixtures", 1, "hinge"), "top", ValueError, "rows[0].fixtures[1].hinge 'top' does not exist"),
        (("rows", 0, "fixtures", 1, "hinge"), MISSING, ValueError, "rows[0].fixtures[1]: must have a hinge if"),
    ],
)
def test_an_impossible_design_is_refused_with_the_path_of_the_value(path, value, error, message):
    with refused(error, message) as raised:
        build_generated_kitchen(changed(path, value), visuals=False)
    assert_is_short(str(raised.value))


@pytest.mark.parametrize(
    ("design", "error", "message"),
    [
        (-1, ValueError, "design must be"),
        (1.5, TypeError, "design must be"),
        (None, TypeError, "design must be"),
        ([MINE], TypeError, "design must be"),
        ("no_such.json", ValueError, "or a file with one: no such file: 'no_such.json'"),
        ("-7", ValueError, "no such file: '-7'"),
        ("", ValueError, "a file with one: "),
    ],
)
def test_what_is_no_design_is_refused(design, error, message):
    with refused(error, message) as raised:
        KitchenDesign.make(design, "train")
    assert_is_short(str(raised.value))


@pytest.mark.parametrize("name", ODD_VALUES)
def test_odd_designs_are_refused_in_one_line(name):
    for design in (ODD_VALUES[name], changed(FIXTURE, ODD_VALUES[name]), changed(("rows",), ODD_VALUES[name])):
        with pytest.raises((TypeError, ValueError)) as raised:
            KitchenDesign.make(design, "train")
        assert_is_short(str(raised.value))


def test_a_file_that_is_no_json_and_an_unknown_split_are_refused(tmp_path):
    path = tmp_path / "mine.json"
    path.write_text("{'rows': []}", encoding="utf-8")
    with refused(ValueError, "mine.json does not hold a design (JSONDecodeError: "):
        KitchenDesign.make(path, "train")
    path.write_bytes(b"\xff")
    with refused(ValueError, "mine.json does not hold a design (UnicodeDecodeError: "):
        KitchenDesign.make(path, "train")
    with refused(ValueError, "split 'val' does not exist", "'test'"):
        KitchenDesign.make(7, "val")


def compiled(design, *, visuals):
    """Compiles a kitchen in the physics of its domain."""
    scene = build_generated_kitchen(design, visuals=visuals)
    scene.use_physics(FAST)
    return scene, mjcf.Physics.from_mjcf_model(scene.arena.mjcf_model)


@pytest.mark.full
def test_flat_drawers_and_rows_beyond_the_back_wall_can_be_built():
    flat = {"kind": "drawers", "width": 0.4, "height": 0.16, "count": 4, "handle": "bar"}
    compiled(changed(FIXTURE, flat), visuals=True)
    door = {"kind": "wall_doors", "width": 0.4, "height": 0.3, "count": 1, "handle": "bar", "hinge": "right"}
    sides = [
        {"side": "back", "level": "wall", "distance": 0.25, "start": 0.0, "height": 2.3, "fixtures": [door]},
        {"side": "left", "level": "wall", "distance": 0.1, "start": 0.8, "height": 1.9, "fixtures": [door]},
    ]
    compiled({**MINE, "rows": sides}, visuals=True)


def test_a_design_that_was_not_read_is_checked():
    design = KitchenDesign.make(MINE, "train")
    assert KitchenDesign.make(design, "train") == design
    with refused(ValueError, "rows must have at least one fixture"):
        KitchenDesign.make(msgspec.structs.replace(design, rows=()), "train")


def varied():
    """Returns numbers of the split train that have every kind of fixture between them."""
    numbers, missing = [], set(KINDS)
    for number in range(100):
        kinds = {each.design.kind for each in KitchenDesign.make(number, "train").placed}
        if kinds & missing:
            numbers.append(number)
            missing -= kinds
    assert not missing
    return numbers


@pytest.mark.full
@pytest.mark.parametrize("design", varied())
def test_visuals_do_not_change_the_physics_and_parts_begin_at_rest(design):
    one, other = (compiled(design, visuals=visuals) for visuals in (False, True))
    assert (one[1].model.nmat, other[1].model.nmat > 0) == (0, True)
    for scene, physics in (one, other):
        joints = physics.bind([joint for joint in scene.object_joints if joint.tag == "joint"])
        mujoco.mj_step(physics.model.ptr, physics.data.ptr, 40)
        np.testing.assert_allclose(joints.qpos, 0.0, atol=0.001)
        # The arm moves, and all parts are pushed open or shut.
        physics.data.ctrl[:] = 0.3
        joints.qfrc_applied = 5.0
        mujoco.mj_step(physics.model.ptr, physics.data.ptr, 200)
        assert np.abs(joints.qpos).max() > 0.1
    np.testing.assert_array_equal(one[1].data.qpos, other[1].data.qpos)


FIXTURES = [
    DrawersDesign(width=0.5, height=0.4, count=1, handle="bar"),
    DrawersDesign(width=0.5, height=0.4, count=2, handle="knob"),
    BaseDoorsDesign(width=0.5, height=0.4, count=1, handle="bar", hinge="left"),
    BaseDoorsDesign(width=0.5, height=0.4, count=1, handle="knob", hinge="right"),
    BaseDoorsDesign(width=0.5, height=0.4, count=2, handle="knob"),
    StoveDesign(width=0.5, height=0.4, count=1),
    StoveDesign(width=0.5, height=0.4, count=2),
    WallDoorsDesign(width=0.5, height=0.4, count=1, handle="bar", hinge="left"),
    WallDoorsDesign(width=0.5, height=0.4, count=1, handle="knob", hinge="right"),
    WallDoorsDesign(width=0.5, height=0.4, count=2, handle="knob"),
    WallSlidingDesign(width=0.5, height=0.4, handle="bar", hinge="left"),
    WallSlidingDesign(width=0.5, height=0.4, handle="knob", hinge="right"),
    TallDoorDesign(width=0.5, handle="bar", hinge="left"),
    TallDoorDesign(width=0.5, handle="knob", hinge="right"),
    OvenDesign(),
    HoodDesign(),
    HingeCabinetDesign(),
    SlideCabinetDesign(),
    MicrowaveDesign(),
]


def test_every_kind_of_fixture_is_built_alone():
    assert {design.kind for design in FIXTURES} == set(KINDS)


@pytest.mark.parametrize("design", FIXTURES, ids=lambda design: design.kind)
def test_a_fixture_alone_has_its_parts_within_its_extent(design):
    prop, parts = design.build(STYLES["sage"], visuals=True, name="alone")
    extent = design.extent
    physics = mjcf.Physics.from_mjcf_model(prop.mjcf_model)
    assert len({part.words for part in parts}) == len(parts) > 0
    for part in parts:
        joint = prop.mjcf_model.find("joint", part.joint)
        handle = prop.mjcf_model.find("site", part.handle)
        low, high = physics.bind(joint).range
        assert low <= part.opened <= high
        x, y, z = physics.bind(handle).xpos + design.origin
        assert extent.low[0] < x < extent.high[0]
        assert extent.low[2] < z < extent.high[2]
        if isinstance(prop, BoxFixture) and part.kind != "knob":
            np.testing.assert_allclose(y, -CLEARANCE, atol=2 * PANEL)
            frame = physics.bind(handle).xmat.reshape(3, 3)
            np.testing.assert_allclose(frame[:, 2], (0, 1, 0), atol=1e-9)
            np.testing.assert_allclose(
                np.abs(frame[:, 1]), (part.kind == "drawer", 0, part.kind != "drawer"), atol=1e-9
            )
    if isinstance(prop, BoxFixture):
        fixed = physics.bind([geom for geom in prop.mjcf_model.find_all("geom") if geom.parent.name == "carcass"])
        boxes = fixed.type == mujoco.mjtGeom.mjGEOM_BOX
        centre, half = fixed.xpos[boxes], fixed.size[boxes]
        assert (np.subtract(extent.low, 1e-9) <= (centre - half).min(axis=0)).all()
        assert ((centre + half).max(axis=0) <= np.add(extent.high, 1e-9)).all()
