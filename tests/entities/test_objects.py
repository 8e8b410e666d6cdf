"""The objects that a hand picks up: sizes and masses of real ones, grasps, parameters."""

import mujoco
import numpy as np
import pytest
from dm_control import composer, mjcf

from kitchen_suite import entities, grasping, suite
from kitchen_suite.entities.objects import OBJECTS
from kitchen_suite.tasks import KitchenTask

# Mass [kg], greatest width beside a handle and height [m] by the sources in the module.
REAL = {
    "can": (0.349, 0.066, 0.101),
    "carton": (0.187, 0.110, 0.089),
    "mug": (0.118, 0.080, 0.082),
    "bottle": (0.2044, 0.054, 0.150),
}
OPENING = 0.08  # Of the gripper [m].


def attached(kind, **options):
    scene = entities.build_kitchen_scene(visuals=False)
    made = OBJECTS[kind](**options)
    scene.attach(made, pos=(-0.6, 0.0, 1.6011), free=True)
    KitchenTask(scene)
    return scene, made, mjcf.Physics.from_mjcf_model(scene.arena.mjcf_model)


@pytest.mark.parametrize("kind", OBJECTS)
def test_an_object_has_size_and_mass_of_a_real_one(kind):
    made = OBJECTS[kind](visuals=False)
    physics = mjcf.Physics.from_mjcf_model(made.mjcf_model)
    mass, width, height = REAL[kind]
    assert physics.bind(made.body).mass == pytest.approx(mass, rel=1e-3)
    geoms = [geom for geom in made.body.geom if not geom.name.startswith("handle")]
    corners = []
    for geom in physics.bind(geoms).element_id:
        centre, half = physics.model.geom_aabb[geom, :3], physics.model.geom_aabb[geom, 3:]
        rotation = physics.data.geom_xmat[geom].reshape(3, 3)
        offset = np.abs(rotation) @ half
        middle = physics.data.geom_xpos[geom] + rotation @ centre
        corners += [middle - offset, middle + offset]
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    assert low[2] == pytest.approx(0.0, abs=1e-6)
    assert high[2] == pytest.approx(height, abs=1e-3)
    assert (high - low)[:2].max() == pytest.approx(width, abs=2e-3)
    assert physics.bind(made.centre).xpos[2] == pytest.approx(height / 2, abs=0.03)


@pytest.mark.parametrize("kind", OBJECTS)
def test_what_the_fingers_close_on_fits_between_them(kind):
    made = OBJECTS[kind](visuals=False)
    physics = mjcf.Physics.from_mjcf_model(made.mjcf_model)
    site = physics.bind(made.grasps[0])
    axes = site.xmat.reshape(3, 3)
    # From above.
    np.testing.assert_allclose(axes[:, 2], (0, 0, -1), atol=1e-6)
    tip = site.xpos + 0.04 * axes[:, 2]
    widths = []
    for side in (-1.0, 1.0):
        start = tip + side * 0.2 * axes[:, 1]
        distance = _ray(physics, start, -side * axes[:, 1])
        widths.append(0.2 - distance)
    assert 0.01 < sum(widths) < OPENING


def _ray(physics, start, direction):
    return mujoco.mj_ray(physics.model.ptr, physics.data.ptr, start, direction, None, 1, -1, np.zeros(1, np.int32))


def test_an_object_has_its_joint_from_the_arena_and_another_name():
    mug = entities.Mug(name="cup")
    assert mug.joints == ()
    assert mug.parameters == ()
    arena = composer.Arena()
    arena.add_free_entity(mug)
    physics = mjcf.Physics.from_mjcf_model(arena.mjcf_model)
    assert mug.observables.joint_positions(physics).shape == (7,)
    assert [parameter.name for parameter in mug.parameters] == ["cup/pose", "cup/mass", "cup/friction"]


@pytest.mark.parametrize("kind", OBJECTS)
def test_its_parameters_act(kind):
    scene, made, physics = attached(kind)
    own = {parameter.name: parameter for parameter in scene.parameters if parameter.name.startswith(f"{kind}/")}
    assert own[f"{kind}/mass"].get(physics) == pytest.approx(REAL[kind][0], rel=1e-3)
    inertia = physics.bind(made.body).inertia.copy()
    own[f"{kind}/mass"].set(physics, np.array(0.5))
    assert physics.bind(made.body).mass == 0.5
    np.testing.assert_allclose(physics.bind(made.body).inertia, inertia * 0.5 / REAL[kind][0], rtol=1e-3)
    assert own[f"{kind}/friction"].get(physics) == 0.8
    own[f"{kind}/friction"].set(physics, np.array(0.4))
    moved = physics.bind([geom for geom in made.body.geom if physics.bind(geom).contype]).friction[:, 0]
    assert (moved == 0.4).all()
    before = physics.bind(made.joints[0]).qpos.copy()
    own[f"{kind}/pose"].set(physics, np.array([0.01, 0.02, 0.0]))
    np.testing.assert_allclose(physics.bind(made.joints[0]).qpos - before, [0.01, 0.02, 0, 0, 0, 0, 0], atol=1e-12)


@pytest.mark.parametrize("kind", OBJECTS)
def test_with_and_without_visuals_its_physics_is_the_same(kind):
    models = []
    for visuals in (True, False):
        made = OBJECTS[kind](visuals=visuals)
        arena = composer.Arena()
        arena.add_free_entity(made)
        models.append(mjcf.Physics.from_mjcf_model(arena.mjcf_model))
    rich, lean = models
    assert rich.model.ngeom > lean.model.ngeom
    name = f"{kind}/{kind}"
    for field in ("body_mass", "body_inertia", "body_ipos", "body_iquat"):
        np.testing.assert_array_equal(
            getattr(rich.named.model, field)[name], getattr(lean.named.model, field)[name], err_msg=field
        )


@pytest.mark.full
@pytest.mark.parametrize("physics", ["exact", "fast"])
@pytest.mark.parametrize("kind", OBJECTS)
def test_an_object_on_the_counter_is_lifted_held_and_let_go(kind, physics):
    class Task(KitchenTask):
        def __init__(self, scene, **options):
            scene.attach(OBJECTS[kind](visuals=False), pos=(-0.6, 0.0, 1.6011), free=True)
            super().__init__(scene, **options)

    domain = suite.Domain(
        "objects",
        scene=entities.build_kitchen_scene,
        task=Task,
        tasks={"one": {}},
        env_id="Mine/Objects-v1",
        episode_steps=280,
    )
    with domain.load(
        random=0, visuals=False, time_limit=None, physics=physics, control_mode=grasping.CONTROL_MODE
    ) as environment:
        environment.reset()
        assert grasping.Grasp(environment, kind).play(environment).fault == ""
