"""Layouts: parameters that move furniture, robot and kettle, and the check of clearance and reach."""

import mujoco
import numpy as np
import pytest
from dm_control import mjcf
from layout_episodes import LayoutEpisodes, scene_parameters, table

from kitchen_suite.entities import KitchenArena, Microwave, build_kitchen_scene
from kitchen_suite.entities.props import burners
from kitchen_suite.tasks.kitchen.goals import GOALS
from kitchen_suite.tasks.layouts import clearance
from kitchen_suite.tasks.layouts.check import LayoutCheck
from kitchen_suite.tasks.varied import SPLITS

TASKS = {"kitchen": "all", "open_cabinet": "top_drawer", "microwave_table": "open"}


@pytest.fixture(scope="module")
def kitchen():
    return LayoutEpisodes("kitchen", "all")


def frame_of(episodes, name):
    scene = episodes.environment.task.scene
    entity = scene.robot if name == "pedestal" else scene.props[name]
    return episodes.physics.bind(mjcf.get_attachment_frame(entity.mjcf_model))


def excess(episodes):
    data = mujoco.MjData(episodes.physics.model.ptr)
    data.qpos[:] = episodes.physics.data.qpos
    mujoco.mj_kinematics(episodes.physics.model.ptr, data)
    return episodes.check._clearance.excess(data)


@pytest.mark.parametrize("domain", TASKS)
def test_a_scene_offers_every_parameter_of_its_layout_and_is_built_with_the_default(domain):
    episodes = LayoutEpisodes(domain, TASKS[domain])
    for varied in episodes.table:
        parameter = episodes.parameters[varied.name]
        assert varied.group == "layout"
        assert parameter.quantity.shape == varied.default.shape
        np.testing.assert_allclose(parameter.get(episodes.set({})), varied.default, atol=1e-12, err_msg=varied.name)
        for split in SPLITS:
            for seed in range(20):
                value = varied.distribution(split)(random_state=np.random.RandomState(seed))
                np.testing.assert_array_equal(parameter.quantity.checked(value, varied.name), value)


def test_parameters_do_not_depend_on_visuals():
    with_visuals, without = (scene_parameters(build_kitchen_scene(visuals=visuals)) for visuals in (True, False))
    for varied in table("kitchen"):
        assert with_visuals[varied.name].unit == without[varied.name].unit
    assert list(with_visuals) == list(without)


@pytest.mark.parametrize("name", ["pedestal", "microwave", "slide_cabinet", "hinge_cabinet", "hood"])
def test_an_offset_moves_an_object_in_the_world(kitchen, name):
    offset = np.array([0.02, -0.03, 0.04])
    kitchen.set({})
    kitchen.physics.forward()
    before = frame_of(kitchen, name).xpos.copy()
    kitchen.set({f"{name}/offset": offset})
    kitchen.physics.forward()
    np.testing.assert_allclose(frame_of(kitchen, name).xpos - before, offset, atol=1e-12)


def test_the_yaw_turns_the_microwave_about_the_vertical(kitchen):
    kitchen.set({"microwave/yaw": 0.5})
    kitchen.physics.forward()
    np.testing.assert_allclose(frame_of(kitchen, "microwave").xquat, [np.cos(0.25), 0, 0, np.sin(0.25)], atol=1e-12)


def test_the_burners_are_those_of_the_oven(kitchen):
    kitchen.set({})
    kitchen.physics.forward()
    oven = kitchen.environment.task.scene.props["oven"].mjcf_model
    bodies = [oven.find("body", f"{name}_burner") for name in burners.BURNERS]
    at = np.array([kitchen.physics.bind(body).xpos for body in bodies])
    np.testing.assert_allclose((at - at[0])[:, :2], burners.DISPLACEMENTS[:, :2], atol=1e-9)


def test_the_kettle_stands_on_the_burner_that_was_set(kitchen):
    joint = kitchen.environment.task.scene.props["kettle"].joints[0]
    start = kitchen.set({}).bind(joint).qpos.copy()
    for burner, displacement in enumerate(burners.DISPLACEMENTS):
        moved = kitchen.set({"kettle/burner": burner}).bind(joint).qpos
        np.testing.assert_allclose(moved - start, [*displacement, 0, 0, 0, 0], atol=1e-12)
        assert kitchen.parameters["kettle/burner"].get(kitchen.physics) == burner
    # On the last burner it would be at its goal; no distribution draws that one.
    assert np.linalg.norm(moved - GOALS["kettle"].value) < 0.3
    varied = next(each for each in kitchen.table if each.name == "kettle/burner")
    assert varied.high < 3


@pytest.mark.parametrize("value", [4, -1, 0.5, np.nan])
def test_a_burner_that_does_not_exist_is_refused(kitchen, value):
    with pytest.raises(ValueError, match="kettle/burner must"):
        kitchen.parameters["kettle/burner"].quantity.checked(value, "kettle/burner")


def test_an_object_that_is_not_in_a_scene_has_no_layout():
    assert Microwave().parameters == ()
    assert [parameter.name for parameter in KitchenArena().parameters] == ["pedestal/offset"]


def test_all_excluded_contacts_are_between_parts_of_the_robot():
    scene = build_kitchen_scene(visuals=False)
    model = mjcf.Physics.from_mjcf_model(scene.arena.mjcf_model).model.ptr
    assert model.nexclude
    for signature in model.exclude_signature:
        for body in (signature >> 16, signature & 0xFFFF):
            assert model.body(body).name.startswith("franka/")


def test_the_default_layout_is_accepted(kitchen):
    assert kitchen.check.accepts(kitchen.set({}))
    assert excess(kitchen) == 0.0


REFUSED = {
    "microwave in the kettle": {"microwave/offset": [0.15, -0.2, 0.0]},
    "microwave in the wall": {"microwave/offset": [-0.3, 0.0, 0.0]},
    "microwave in the counter": {"microwave/offset": [0.0, 0.0, -0.02]},
    "cabinet in the hood": {"slide_cabinet/offset": [0.0, 0.0, -0.01]},
    "cabinets in each other": {"slide_cabinet/offset": [-0.05, 0, 0.02], "hinge_cabinet/offset": [0.05, 0, 0.02]},
    "hood in a cabinet": {"hood/offset": [0.0, 0.0, 0.01]},
    "pedestal in the oven": {"pedestal/offset": [0.0, 0.01, 0.0]},
    "cabinet out of reach": {"hinge_cabinet/offset": [0.0, 0.0, 0.3]},
    "robot too far away": {"pedestal/offset": [0.0, -0.2, 0.0]},
}


@pytest.mark.parametrize("values", REFUSED.values(), ids=REFUSED)
def test_layouts_that_cannot_be_used_are_refused(kitchen, values):
    assert not kitchen.check.accepts(kitchen.set(values))


def test_a_cabinet_may_follow_a_hood_that_is_lowered(kitchen):
    assert kitchen.check.accepts(
        kitchen.set({"hood/offset": [0.0, 0.0, -0.02], "slide_cabinet/offset": [0.0, 0.0, -0.01]})
    )


def test_only_the_handles_that_are_asked_for_must_be_in_reach():
    episodes = LayoutEpisodes("kitchen", "kettle")
    assert episodes.check.accepts(episodes.set({"hinge_cabinet/offset": [0.0, 0.0, 0.3]}))


def test_a_handle_out_of_reach_in_the_default_layout_is_refused_at_once(kitchen):
    scene = kitchen.environment.task.scene
    check = LayoutCheck(scene, [scene.arena.mjcf_model.find("site", "kettle"), *scene.props["microwave"].handles])
    kitchen.set({"microwave/offset": [-1.0, 0.0, 0.0]})
    with pytest.raises(ValueError, match="cannot reach microwave/handle in the default layout"):
        check.bind(kitchen.physics)


def test_a_check_changes_nothing(kitchen):
    physics = kitchen.set({"microwave/offset": [0.02, 0.0, 0.0]})
    physics.forward()
    state, poses = physics.get_state().copy(), physics.data.xpos.copy()
    assert kitchen.check.accepts(physics)
    np.testing.assert_array_equal(physics.get_state(), state)
    np.testing.assert_array_equal(physics.data.xpos, poses)


def assert_nothing_is_deeper_than_by_default(episodes, split, count):
    """Measures all pairs of colliding geoms of different entities, without the check's own filters."""
    model, scene = episodes.physics.model.ptr, episodes.environment.task.scene
    owner = np.array([model.body(body).name.partition("/")[0] for body in model.geom_bodyid])
    owner[owner == "pedestal"] = scene.robot.mjcf_model.model
    geoms = [
        geom
        for geom in range(model.ngeom)
        if (model.geom_contype[geom] or model.geom_conaffinity[geom]) and model.geom_rbound[geom]
    ]
    pairs = [(one, other) for one in geoms for other in geoms if one < other and owner[one] != owner[other]]
    data = mujoco.MjData(model)

    def depths():
        data.qpos[:] = episodes.physics.data.qpos
        mujoco.mj_kinematics(model, data)
        return np.array([max(-mujoco.mj_geomDistance(model, data, *pair, 0.001, None), 0.0) for pair in pairs])

    episodes.set({})
    default, random_state = depths(), np.random.RandomState(3)
    for _ in range(count):
        values, _ = episodes.draw(split, random_state)
        episodes.set(values)
        assert (depths() - default).max() <= clearance.TOLERANCE, values


@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize("domain", TASKS)
def test_in_accepted_layouts_nothing_is_deeper_than_by_default(domain, split):
    assert_nothing_is_deeper_than_by_default(LayoutEpisodes(domain, TASKS[domain]), split, 3)


@pytest.mark.slow
@pytest.mark.parametrize("split", SPLITS)
def test_in_many_accepted_layouts_nothing_is_deeper_than_by_default(kitchen, split):
    assert_nothing_is_deeper_than_by_default(kitchen, split, 300)
