"""Layouts: parameters that move furniture, robot and kettle, and the check of clearance and reach."""

import mujoco
import numpy as np
import pytest
from dm_control import mjcf
from helpers.errors import refused

from kitchen_suite import suite
from kitchen_suite.entities import KitchenArena, Microwave, build_kitchen_scene
from kitchen_suite.entities import props as burners
from kitchen_suite.tasks.kitchen.goals import GOALS
from kitchen_suite.tasks.variations.distributions import SPLITS
from kitchen_suite.tasks.variations.layouts import LayoutCheck

TASKS = {"kitchen": "all", "open_cabinet": "top_drawer", "microwave_table": "open"}


class Layouts:
    """A task whose layout is set, also to what no episode starts in."""

    def __init__(self, domain, task_name):
        options = {"visuals": False, "random": 0, "variations": ["layout"]}
        self.environment = suite.load(domain, task_name, options)
        self.task = self.environment.task
        self.task.follow(self.task.checked_reset({"variation": []}))
        self.environment.reset()
        self.physics, self.check = self.environment.physics, self.task.variations._layout_check
        self._start = self.physics.data.qpos.copy()

    @property
    def parameters(self):
        return {parameter.name: parameter for parameter in self.task.scene.parameters}

    def set(self, values):
        """Sets the default layout with some other values, all objects at their start; returns the physics."""
        self.physics.data.qpos[:] = self._start
        self.task.variations.randomizer.set({**self.task.variations.randomizer.defaults, **values})
        return self.physics


@pytest.fixture(scope="module")
def kitchen():
    return Layouts("kitchen", "all")


def frame_of(layouts, name):
    scene = layouts.task.scene
    entity = scene.robot if name == "pedestal" else scene.props[name]
    return layouts.physics.bind(mjcf.get_attachment_frame(entity.mjcf_model))


def excess(layouts):
    data = mujoco.MjData(layouts.physics.model.ptr)
    data.qpos[:] = layouts.physics.data.qpos
    mujoco.mj_kinematics(layouts.physics.model.ptr, data)
    return layouts.check._clearance.excess(data)


@pytest.mark.parametrize("domain", TASKS)
def test_a_scene_offers_every_parameter_of_its_layout(domain):
    layouts = Layouts(domain, TASKS[domain])
    for varied in layouts.task.variations.by_name.values():
        parameter = layouts.parameters[varied.name]
        assert varied.group == "layout"
        for split in SPLITS:
            for seed in range(20):
                value = varied.distribution(split)(random_state=np.random.RandomState(seed))
                np.testing.assert_array_equal(parameter.type.checked(value, varied.name), value)


@pytest.mark.full
def test_parameters_do_not_depend_on_visuals():
    scenes = (build_kitchen_scene(visuals=visuals) for visuals in (True, False))
    with_visuals, without = ([(each.name, each.unit) for each in scene.parameters] for scene in scenes)
    assert with_visuals == without


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
    oven = kitchen.task.scene.props["oven"].mjcf_model
    bodies = [oven.find("body", f"{name}_burner") for name in burners.BURNERS]
    at = np.array([kitchen.physics.bind(body).xpos for body in bodies])
    np.testing.assert_allclose((at - at[0])[:, :2], burners.BURNER_DISPLACEMENTS[:, :2], atol=1e-9)


def test_the_kettle_stands_on_the_burner_that_was_set(kitchen):
    joint = kitchen.task.scene.props["kettle"].joints[0]
    start = kitchen.set({}).bind(joint).qpos.copy()
    for burner, displacement in enumerate(burners.BURNER_DISPLACEMENTS):
        moved = kitchen.set({"kettle/burner": burner}).bind(joint).qpos
        np.testing.assert_allclose(moved - start, [*displacement, 0, 0, 0, 0], atol=1e-12)
        assert kitchen.parameters["kettle/burner"].get(kitchen.physics) == burner
    # On the last burner it would be at its goal; no distribution draws that one.
    assert np.linalg.norm(moved - GOALS["kettle"].value) < 0.3
    assert kitchen.task.variations.ranges["kettle/burner"][1] < 3


@pytest.mark.parametrize("value", [4, -1, 0.5, np.nan])
def test_a_burner_that_does_not_exist_is_refused(kitchen, value):
    with refused(ValueError, "kettle/burner"):
        kitchen.parameters["kettle/burner"].type.checked(value, "kettle/burner")


def test_an_object_that_is_not_in_a_scene_has_no_layout():
    assert not [parameter.name for parameter in Microwave().parameters if is_of_layout(parameter)]
    assert [parameter.name for parameter in KitchenArena().parameters if is_of_layout(parameter)] == ["pedestal/offset"]


def is_of_layout(parameter):
    return bool({"body_pos", "body_quat"} & {*parameter.type.model_fields})


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
    layouts = Layouts("kitchen", "kettle")
    assert layouts.check.accepts(layouts.set({"hinge_cabinet/offset": [0.0, 0.0, 0.3]}))


def test_a_handle_out_of_reach_in_the_default_layout_is_refused_at_once(kitchen):
    scene = kitchen.task.scene
    check = LayoutCheck(scene, [scene.arena.mjcf_model.find("site", "kettle"), *scene.props["microwave"].handles])
    kitchen.set({"microwave/offset": [-1.0, 0.0, 0.0]})
    with refused(ValueError, "microwave/handle"):
        check.bind(kitchen.physics)


def test_a_check_changes_nothing(kitchen):
    physics = kitchen.set({"microwave/offset": [0.02, 0.0, 0.0]})
    physics.forward()
    state, poses = physics.get_state().copy(), physics.data.xpos.copy()
    assert kitchen.check.accepts(physics)
    np.testing.assert_array_equal(physics.get_state(), state)
    np.testing.assert_array_equal(physics.data.xpos, poses)
