"""Free objects: the physics that holds them, the hand that proves it, and the energy that random actions give them."""

import dataclasses

import gymnasium
import numpy as np
import pytest
from dm_control import mjcf
from dm_control.entities.props.primitive import Primitive
from docs_scripts import load_script
from helpers.errors import refused

from kitchen_suite import grasping, suite
from kitchen_suite.commands import find
from kitchen_suite.energy import check_energy
from kitchen_suite.entities import (
    build_generated_kitchen,
    build_kitchen_scene,
    build_microwave_table_scene,
    build_open_cabinet_scene,
    scenes,
)
from kitchen_suite.entities.scenes import HOLDING_OPTIONS, FastPhysics
from kitchen_suite.tasks import KitchenTask, MicrowaveTableTask

SCENES = (
    (build_kitchen_scene, "exact"),
    (build_kitchen_scene, "fast"),
    (build_generated_kitchen, "exact"),
    (build_generated_kitchen, "fast"),
    (build_microwave_table_scene, "exact"),
    (build_microwave_table_scene, "fast"),
    (build_open_cabinet_scene, "exact"),
)


def mug(**options):
    shape = {"geom_type": "cylinder", "size": (0.035, 0.05), "mass": 0.3, "name": "mug"}
    return Primitive(**{**shape, **options})


def options_of(scene):
    option = scene.arena.mjcf_model.option
    return option.timestep, option.cone, option.noslip_iterations, option.integrator


def build(domain, physics, **arguments):
    """The environment of the page's mug, whose actions are poses of the hand."""
    environment = domain.load(
        random=0, visuals=False, time_limit=None, physics=physics, control_mode=grasping.CONTROL_MODE, **arguments
    )
    environment.reset()
    return environment


@pytest.fixture
def domain():
    return load_script("examples/mug").MUG_KITCHEN


@pytest.mark.parametrize(("builder", "physics"), SCENES)
def test_scenes_without_free_objects_keep_their_options(builder, physics):
    scene, alone = builder(visuals=False), builder(visuals=False)
    for each in (scene, alone):
        each.use_physics(physics)
    scene.hold_free_objects()
    assert scene.free_objects == []
    assert scene.arena.mjcf_model.to_xml_string() == alone.arena.mjcf_model.to_xml_string()
    assert "holding" not in scene.info


@pytest.mark.parametrize(
    ("physics", "expected", "named"),
    [
        ("exact", (0.002, "elliptic", 3, None), "2 ms, elliptic, noslip 3"),
        ("fast", (0.008, "elliptic", 3, "implicitfast"), "8 ms, elliptic, noslip 3"),
    ],
)
def test_a_free_object_chooses_the_options_that_hold_it_and_infos_name_them(domain, physics, expected, named):
    with domain.load(random=0, visuals=False, physics=physics) as environment:
        assert options_of(environment.task.scene) == expected
        assert environment.physics.model.opt.noslip_iterations == 3
        assert environment.task.physics_steps_per_control_step == round(0.08 / expected[0])
        assert environment.task.scene.free_objects == ["mug"]
    suite.register(domain)
    try:
        single = gymnasium.make(domain.env_id, physics=physics)
        many = gymnasium.make_vec(domain.env_id, num_envs=2, physics=physics)
        assert single.reset(seed=0)[1]["holding"] == named
        assert many.reset(seed=0)[1]["holding"].tolist() == [named] * 2
        single.close()
        many.close()
    finally:
        del suite._domains[domain.name]
        for env_id in {domain.env_id, *domain.task_ids.values()}:
            del gymnasium.registry[env_id]


def test_objects_that_do_not_go_through_the_scene_count_as_well():
    scene = build_kitchen_scene(visuals=False)
    scene.arena.add_free_entity(mug())
    KitchenTask(scene)
    assert scene.free_objects == ["mug"]
    assert options_of(scene)[2] == HOLDING_OPTIONS["noslip_iterations"]


def test_options_of_a_users_own_stay():
    scene = build_kitchen_scene(visuals=False)
    scene.attach(mug(), pos=(-0.6, 0.0, 1.651), free=True)
    scene.arena.mjcf_model.option.set_attributes(noslip_iterations=7, cone="pyramidal")
    KitchenTask(scene)
    assert options_of(scene)[1:3] == ("pyramidal", 7)
    assert scene.info == {"holding": "2 ms, pyramidal, noslip 7"}


def test_physics_that_holds_no_object_is_refused_with_the_reason():
    scene = build_microwave_table_scene(visuals=False)
    scene.use_physics("fast")
    scene.attach(mug(), pos=(0.4, 0.3, 0.9), free=True)
    with refused(ValueError, "'mug'", "0.01 s are too long", "physics='exact'", "holding_timestep"):
        MicrowaveTableTask(scene)
    scene.arena.fast_physics = dataclasses.replace(scene.arena.fast_physics, holding_timestep=0.005)
    MicrowaveTableTask(scene)
    assert options_of(scene)[:3] == (0.005, "elliptic", 3)
    fixed = build_microwave_table_scene(visuals=False)
    fixed.use_physics("fast")
    fixed.attach(mug(), pos=(0.4, 0.3, 0.9))
    MicrowaveTableTask(fixed)
    assert options_of(fixed)[:3] == (0.01, "elliptic", None)
    assert FastPhysics(timestep=0.01).holding_timestep is None


@pytest.mark.parametrize("physics", ["exact", "fast"])
def test_the_mug_of_the_page_is_lifted_held_for_ten_seconds_and_let_go(domain, physics):
    with build(domain, physics) as environment:
        place = environment.physics.named.data.xpos["mug/"].copy()
        held = grasping.Grasp(environment, "mug").play(environment)
        assert held.fault == ""
        assert held.miss < 1e-3
        assert held.lifted == pytest.approx(0.15, abs=0.005)
        # Measured: 0.02 mm.
        assert held.drift < 1e-3
        assert np.linalg.norm(environment.physics.named.data.xpos["mug/"] - place) < 0.01
        hand = environment.physics.bind(environment.task.robot.end_effector).xpos
        assert hand[2] > place[2] + 0.1


def test_without_the_options_the_mug_slips_and_the_fault_says_what_to_change(domain):
    with build(domain, "exact") as environment:
        environment.physics.model.opt.noslip_iterations = 0
        held = grasping.Grasp(environment, "mug").play(environment)
    assert held.drift > grasping.MAX_DRIFT
    assert "noslip_iterations" in held.fault
    assert str(held).startswith("not held: it moves by ")


@pytest.mark.full
def test_other_faults_say_what_to_change(domain):
    heavy = {"body_mass": ("mug/", 5.0), "words": "make it lighter"}
    with build(domain, "exact") as environment:
        environment.physics.named.model.body_mass[heavy["body_mass"][0]] = heavy["body_mass"][1]
        held = grasping.Grasp(environment, "mug").play(environment)
        assert not held.lifted > 0.1
        assert heavy["words"] in held.fault
    with build(domain, "exact") as environment:
        joint = mjcf.get_frame_freejoint(environment.task.scene.attached["mug"].mjcf_model)
        environment.physics.bind(joint).qpos[:3] = (-1.5, 0.0, 1.65)
        environment.physics.forward()
        held = grasping.Grasp(environment, "mug").play(environment)
        assert held.miss > 0.5
        assert "within reach" in held.fault
    with build(domain, "exact") as environment, refused(ValueError, "no free object 'kettle'", "['mug']"):
        grasping.Grasp(environment, "kettle")


@pytest.mark.full
def test_the_doctor_grasps_the_objects_of_a_domain(run, monkeypatch, domain):
    monkeypatch.setattr(suite, "_domains", {**suite.DOMAINS, domain.name: domain})
    monkeypatch.setattr(suite, "DOMAINS", suite._domains)
    status, out, err = run(find("doctor"), "--domain_name=mug_kitchen")
    assert (status, err) == (0, "")
    for physics, options in (("exact", "2 ms"), ("fast", "8 ms")):
        assert f"{physics:<8} {options}, elliptic, noslip 3\n" in out
        assert f"{physics:<8} mug: held: lifted by 148.7 mm" in out
    status, out, err = run(find("doctor"), "--domain_name=microwave_table")
    assert status == 2
    assert "no free object with a grasp site" in err
    monkeypatch.setattr(scenes, "HOLDING_OPTIONS", {**HOLDING_OPTIONS, "noslip_iterations": 0})
    status, out, err = run(find("doctor"), "--domain_name=mug_kitchen")
    assert status == 1
    assert "exact    mug: not held: it moves by " in out


def test_what_random_actions_throw_is_refused_with_what_to_change(domain):
    class Tight(KitchenTask):
        """A spring presses a ball against the counter, as none of the suite's scenes does."""

        def __init__(self, scene, **options):
            ball = Primitive(geom_type="sphere", size=(0.03,), mass=0.01, solref=(-1e6, -1), name="ball")
            scene.attach(ball, pos=(-0.6, 0.0, 1.61), free=True)
            super().__init__(scene, **options)

    thrown = dataclasses.replace(domain, name="thrown", task=Tight, env_id="Mine/Thrown-v1")
    with refused(ValueError, "'ball/'", "J/kg", "mm inside 'counter/left_slab'", "start it free"):
        suite.register(thrown)
    assert "thrown" not in suite.DOMAINS
    assert "Mine/Thrown-v1" not in gymnasium.registry
    for physics in ("exact", "fast"):
        with domain.load(random=0, visuals=False, physics=physics) as environment:
            check_energy(environment)
