"""Saved states and copies where objects sleep, of which MuJoCo keeps more than its state."""

import dataclasses

import numpy as np
import pytest
from dm_control.entities.props.primitive import Primitive
from helpers.copies import copies_of, played
from helpers.sweeps import walk

from kitchen_suite import entities, suite, tasks
from kitchen_suite.environment import Environment

CASES = {
    "kitchen, fast": ("kitchen", {"physics": "fast"}),
    "kitchen, asleep": ("kitchen", {"sleep": True}),
    "kitchens, fast": ("kitchens", {"physics": "fast"}),
    "pick_and_place, fast": ("pick_and_place", {"physics": "fast"}),
    "microwave_table, fast": ("microwave_table", {"physics": "fast", "control_mode": "joint_position"}),
}


def load(name):
    domain, options = CASES[name]
    return suite.load(domain, suite.default_task(domain), {"random": 0, "visuals": False, **options})


@pytest.mark.full
@pytest.mark.parametrize("name", CASES)
def test_what_sleeps_wakes_in_a_copy_as_in_the_original(name):
    """MuJoCo's solver starts from accelerations that were evaluated before objects fell asleep."""
    environment = load(name)
    actions = walk(environment.action_spec(), 50, seed=1)
    played(environment, actions[:40])
    asleep = environment.physics.data.ptr.tree_asleep >= 0
    assert asleep.any()
    every = {"original": environment, **copies_of(environment, other=played(load(name), -actions[:20]))}
    for number, action in enumerate(actions[40:]):
        for each in every.values():
            if number == 3:
                # All that sleep wake.
                each.physics.data.qvel[asleep[each.physics.model.dof_treeid]] = 0.1
            each.step(action)
        if number == 3:
            assert not (environment.physics.data.ptr.tree_asleep[asleep] >= 0).any()
        expected = environment.get_state()
        for kind, each in every.items():
            found = each.get_state()
            np.testing.assert_array_equal(found["physics"], expected["physics"], err_msg=f"{kind}, step {number}")
            np.testing.assert_array_equal(found["asleep"], expected["asleep"], err_msg=f"{kind}, step {number}")


@pytest.mark.full
def test_a_touch_sensor_of_a_sleeping_object_has_its_force_after_set_state():
    def build():
        scene = entities.build_microwave_table_scene(visuals=False)
        # Nothing holds the mug, so that it is asleep in the fast physics as it is.
        scene.arena.fast_physics = dataclasses.replace(scene.arena.fast_physics, holding_timestep=0.01)
        scene.use_physics("fast")
        mug = Primitive(geom_type="box", size=(0.04, 0.04, 0.04), mass=0.3, name="mug")
        site = mug.mjcf_model.worldbody.add("site", name="touch", type="sphere", size=(0.1,))
        mug.mjcf_model.sensor.add("touch", name="touch", site=site)
        scene.attach(mug, pos=(0.4, 0.3, 0.9), free=True)
        return Environment(tasks.MicrowaveTableTask(scene), random_state=0)

    first, second = build(), build()
    for environment in (first, second):
        environment.reset()
    for _ in range(200):
        first.step(np.zeros(first.action_spec().shape))
    model = first.physics.model
    tree = model.dof_treeid[int(model.body("mug/").dofadr[0])]
    assert first.physics.data.ptr.tree_asleep[tree] >= 0
    second.set_state(first.get_state())
    for environment in (first, second):
        assert environment.physics.named.data.sensordata["mug/touch"] == pytest.approx(0.3 * 9.81, rel=1e-3)
