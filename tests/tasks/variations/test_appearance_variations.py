"""The tables of appearance and cameras fit the scenes, and episodes do not depend on them."""

import dataclasses
import functools

import numpy as np
import pytest
from helpers.sweeps import groups_of

from kitchen_suite import suite
from kitchen_suite.entities import build_kitchen_scene, build_microwave_table_scene, build_open_cabinet_scene
from kitchen_suite.rendering.cameras import camera_names
from kitchen_suite.tasks.variations.distributions import SPLITS

SCENES = {
    "kitchen": build_kitchen_scene,
    "open_cabinet": build_open_cabinet_scene,
    "microwave_table": build_microwave_table_scene,
}
# Control steps.
STEPS = 5


def prepared(build, visuals):
    scene = build(visuals=visuals)
    scene.prepare_appearance()
    return scene


def environment(domain, **options):
    scene = functools.partial(prepared, SCENES[domain])
    return dataclasses.replace(suite.DOMAINS[domain], scene=scene).load(random=0, render_quality="fast", **options)


def table(environment):
    """Returns what the groups of appearance and cameras vary."""
    return [row for row in environment.task.varied if row.group in ("appearance", "camera")]


def parameters(environment):
    """Returns the parameters of the arena on which only pictures depend, by name."""
    offered = environment.task.scene.arena.parameters
    return {parameter.name: parameter for parameter in offered if parameter.type.visual}


@pytest.mark.full
@pytest.mark.parametrize("domain", SCENES)
def test_tables_vary_all_that_the_arena_offers_from_its_built_values(domain):
    env = environment(domain, visuals=False)
    env.reset()
    offered, varied = parameters(env), table(env)
    names = [each.name for each in varied]
    assert len(set(names)) == len(names)
    # Observers' cameras are those of the reference.
    assert set(offered) - set(names) == {name for name in offered if "_cap_" in name}
    for each in varied:
        bound = each.about(offered[each.name].get(env.physics))
        for split in SPLITS:
            drawn = bound.distribution(split)(random_state=np.random.RandomState(0))
            offered[each.name].type.checked(drawn, each.name)


@pytest.mark.full
@pytest.mark.parametrize("domain", SCENES)
def test_held_out_values_are_not_seen(domain):
    env, random_state = environment(domain, visuals=False), np.random.RandomState(0)
    env.reset()
    offered = parameters(env)
    for row in table(env):
        each = row.about(offered[row.name].get(env.physics))
        seen, held_out = (
            [tuple(np.atleast_1d(each.distribution(split)(random_state=random_state))) for _ in range(300)]
            for split in SPLITS
        )
        assert not set(seen) & set(held_out), each.name
        if each.name.endswith("texture"):
            # Every texture that the surface offers is drawn.
            assert sorted({number for (number,) in seen + held_out}) == list(range(1 + int(each.held_out.high))), (
                each.name
            )


@pytest.mark.full
@pytest.mark.parametrize("domain", SCENES)
def test_trajectories_do_not_depend_on_appearance_and_cameras(domain):
    plain = suite.load(domain, suite.default_task(domain), {"random": 0, "visuals": False})
    varied = environment(domain)
    plain.reset()
    varied.reset()
    offered, random_state = parameters(varied), np.random.RandomState(1)
    for each in table(varied):
        default = offered[each.name].get(varied.physics)
        offered[each.name].set(varied.physics, each.about(default).held_out(random_state=random_state))
    for _ in range(STEPS):
        action = random_state.uniform(-1, 1, plain.action_spec().shape)
        plain.step(action)
        varied.step(action)
        np.testing.assert_array_equal(varied.physics.data.qpos, plain.physics.data.qpos)
        np.testing.assert_array_equal(varied.physics.data.qvel, plain.physics.data.qvel)


@pytest.mark.full
@pytest.mark.rendering
@pytest.mark.parametrize("domain", SCENES)
def test_held_out_views_show_something_else_in_full_light(domain):
    env = environment(domain)
    env.reset()
    offered, random_state = parameters(env), np.random.RandomState(2)
    cameras = [name for name in camera_names(env.physics) if not name.endswith("_cap")]
    before = [env.physics.render(64, 64, camera_id=name).astype(float) for name in cameras]
    for each in table(env):
        default = offered[each.name].get(env.physics)
        offered[each.name].set(env.physics, each.about(default).held_out(random_state=random_state))
    env.physics.forward()
    for name, old in zip(cameras, before, strict=True):
        new = env.physics.render(64, 64, camera_id=name)
        assert np.abs(new - old).mean() > 10, name
        # Neither black nor white.
        assert 25 < new.mean() < 230, name
        assert new.std() > 15, name


@pytest.mark.full
@pytest.mark.parametrize("domain", suite.DOMAINS)
def test_defaults_are_the_same_numbers_with_and_without_visuals(domain):
    groups = groups_of(domain)
    seen, unseen = (
        suite.load(domain, suite.default_task(domain), {"visuals": visuals, "variations": groups, "random": 0}).task
        for visuals in (True, False)
    )
    defaults = unseen.variations.randomizer.defaults
    assert seen.variations.randomizer.defaults.keys() == defaults.keys()
    for name, value in seen.variations.randomizer.defaults.items():
        assert value.dtype == np.float64, name
        np.testing.assert_array_equal(value, defaults[name], name)
        for one, other in zip(seen.variations.ranges[name], unseen.variations.ranges[name], strict=True):
            np.testing.assert_array_equal(one, other, name)


@pytest.mark.parametrize("visuals", [True, False])
def test_a_colour_that_is_left_out_is_the_one_of_the_table_not_its_single_precision(visuals):
    environment = suite.load("open_cabinet", "top_drawer", {"visuals": visuals, "variations": "appearance"})
    environment.task.follow(environment.task.checked_reset({"variation": []}))
    environment.reset()
    values = environment.task.variations.values
    for surface in environment.task.root_entity.surfaces:
        np.testing.assert_array_equal(values[f"{surface.prefix}color"], surface.color)
    assert values["walls/color"].tolist() == [0.88, 0.86, 0.82]


@pytest.mark.full
@pytest.mark.parametrize("domain", ["kitchen", "open_cabinet", "microwave_table"])
def test_default_appearance_is_written_to_the_bit_as_it_was_built(domain):
    environment = suite.load(domain, suite.default_task(domain), {"variations": "appearance"})
    model = environment.physics.model
    fields = ("mat_rgba", "geom_rgba", "geom_matid", "light_diffuse", "light_specular", "light_ambient", "light_dir")
    built = {name: getattr(model, name).copy() for name in fields}
    environment.task.follow(environment.task.checked_reset({"variation": []}))
    environment.reset()
    for name, before in built.items():
        np.testing.assert_array_equal(getattr(environment.physics.model, name), before, name)
