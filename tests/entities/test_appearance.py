"""Colours, textures, lights and cameras change images as they should, and nothing else."""

import functools

import numpy as np
import pytest
from dm_control import mjcf
from helpers.errors import refused

from kitchen_suite.entities import build_kitchen_scene, build_open_cabinet_scene
from kitchen_suite.entities.assets import is_visual
from kitchen_suite.entities.scenes import build_microwave_table_scene
from kitchen_suite.rendering.quality import set_render_quality

pytestmark = pytest.mark.full

SCENES = {
    "kitchen": build_kitchen_scene,
    "open_cabinet": build_open_cabinet_scene,
    "microwave_table": build_microwave_table_scene,
}
CAMERAS = ("overview", "left", "workspace", "franka/hand")
SIZE = (96, 128)


class Room:
    """A compiled scene with its parameters."""

    def __init__(self, name, *, visuals=True, prepared=True, quality="fast"):
        scene = SCENES[name](visuals=visuals)
        if prepared:
            scene.prepare_appearance()
        root = scene.arena.mjcf_model
        set_render_quality(root, quality, is_visual)
        self.surfaces = scene.arena.surfaces
        self.physics = mjcf.Physics.from_mjcf_model(root)
        self.model = self.physics.model.ptr
        self.parameters = {parameter.name: parameter for parameter in scene.arena.parameters}
        fields = {field for parameter in self.parameters.values() for field in parameter.type.model_fields}
        self.built = {field: getattr(self.model, field).copy() for field in fields}
        names = {self.physics.model.id2name(i, "camera") for i in range(self.model.ncam)}
        self.cameras = [camera for camera in CAMERAS if camera in names]

    def restore(self):
        for field, values in self.built.items():
            getattr(self.model, field)[:] = values
        self.physics.forward()

    def set(self, **values):
        """Sets values of parameters in the scene as it was built."""
        self.restore()
        for name, value in values.items():
            parameter = self.parameters[name]
            parameter.set(self.physics, parameter.type.checked(value, name))
        self.physics.forward()

    def changed_fields(self):
        return {field for field, values in self.built.items() if (getattr(self.model, field) != values).any()}

    def picture(self, camera="overview"):
        return self.physics.render(*SIZE, camera_id=camera)

    def pictures(self):
        return np.stack([self.picture(camera) for camera in self.cameras])

    def masks(self, surface):
        """Returns which pixels of `pictures` show a surface."""
        materials = [self.physics.model.id2name(i, "material") for i in range(self.model.nmat)]
        own = [i for i, name in enumerate(materials) if name in surface.materials]
        geoms = set(np.flatnonzero(np.isin(self.built["geom_matid"], own)))
        geoms |= {self.physics.model.name2id(name, "geom") for name in surface.geoms}
        segmentations = [self.physics.render(*SIZE, camera_id=camera, segmentation=True) for camera in self.cameras]
        return np.isin(np.stack(segmentations)[..., 0], list(geoms))


@functools.cache
def compiled(name, **options):
    """Returns a room that other tests of the process have changed."""
    return Room(name, **options)


@pytest.fixture(params=SCENES)
def room(request):
    return compiled(request.param)


@pytest.fixture
def kitchen():
    return compiled("kitchen")


@pytest.mark.parametrize("visuals", [True, False])
@pytest.mark.parametrize("name", SCENES)
def test_defaults_leave_the_model_as_it_is(name, visuals):
    room = compiled(name, visuals=visuals)
    room.restore()
    for parameter in room.parameters.values():
        value = parameter.get(room.physics)
        assert value.shape == parameter.type.shape
        parameter.set(room.physics, parameter.type.checked(value, parameter.name))
    assert not room.changed_fields()


@pytest.mark.parametrize("name", SCENES)
def test_scenes_without_visuals_offer_the_same_parameters_and_values(name):
    with_visuals, without = compiled(name), compiled(name, visuals=False)
    with_visuals.restore()
    without.restore()
    assert list(with_visuals.parameters) == list(without.parameters)
    for key, parameter in with_visuals.parameters.items():
        other = without.parameters[key]
        assert parameter.type.visual == other.type.visual
        assert parameter.type.shape == other.type.shape
        np.testing.assert_allclose(other.get(without.physics), parameter.get(with_visuals.physics), rtol=1e-7)


def test_without_visuals_colours_and_textures_have_nothing_to_change():
    room = compiled("kitchen", visuals=False)
    room.set(**{"cabinets/color": (0.9, 0.1, 0.1), "cabinets/texture": 1.0, "franka/color": (0.1, 0.1, 0.1)})
    assert not room.changed_fields()
    assert not room.model.nmat


def test_surfaces_have_the_colours_that_were_built(room):
    for surface in room.surfaces:
        color = room.parameters[f"{surface.prefix}color"]
        for material in (*surface.materials, *surface.variants):
            np.testing.assert_array_equal(
                room.physics.named.model.mat_rgba[material], np.float32([*surface.color, 1]), material
            )
        for geom in surface.geoms:
            built = np.float32(surface.color) * np.float32(surface.shades.get(geom, 1.0))
            np.testing.assert_array_equal(room.physics.named.model.geom_rgba[geom][:3], built, geom)
        np.testing.assert_array_equal(color.get(room.physics), surface.color)


def test_values_can_be_read_back(room):
    for surface in room.surfaces:
        name = f"{surface.prefix}color"
        room.set(**{name: (0.2, 0.4, 0.6)})
        np.testing.assert_array_equal(room.parameters[name].get(room.physics), np.float32([0.2, 0.4, 0.6]))
        for number in range(len(surface.textures) + 1) if surface.textures else ():
            room.set(**{f"{surface.prefix}texture": number})
            assert room.parameters[f"{surface.prefix}texture"].get(room.physics) == number


@pytest.mark.parametrize("value", [-1, 5, 0.5, np.nan])
def test_a_texture_that_does_not_exist_is_refused(kitchen, value):
    quantity = kitchen.parameters["floor/texture"].type
    with refused(ValueError, "floor/texture", "0", "4"):
        quantity.checked(value, "floor/texture")


@pytest.mark.rendering
@pytest.mark.parametrize("quality", ["fast", "high"])
def test_textures_change_images_only_when_they_are_chosen(quality):
    room = compiled("microwave_table", quality=quality)
    room.restore()
    before = compiled("microwave_table", prepared=False, quality=quality).picture()
    np.testing.assert_array_equal(room.picture(), before)
    room.set(**{"table/texture": 1, "walls/color": (0.2, 0.2, 0.2)})
    assert np.abs(room.picture() - before.astype(float)).mean() > 5


@pytest.mark.rendering
def test_a_colour_changes_its_surface_and_nothing_else(room):
    room.restore()
    before = room.pictures().astype(float)
    for surface in room.surfaces:
        mask = room.masks(surface)
        if not mask.any():
            # Inside the closed drawers.
            assert surface.prefix == "cabinet/tray_"
            continue
        room.set(**{f"{surface.prefix}color": 0.5 * np.multiply(surface.color, (1, 0.5, 0.5))})
        after = room.pictures()
        ratio = after[mask].mean(axis=0) / before[mask].mean(axis=0)
        assert ratio[0] < 0.9, surface.prefix
        assert (ratio[1:] < 0.9 * ratio[0]).all(), surface.prefix
        if surface.prefix != "microwave/":  # Seen through the glass of the door as well.
            np.testing.assert_array_equal(after[~mask], before[~mask])


@pytest.mark.rendering
def test_a_texture_changes_its_surface_and_nothing_else(room):
    room.restore()
    before = room.pictures()
    for surface in room.surfaces:
        mask = room.masks(surface)
        shown = [before[mask]]
        for number in range(1, len(surface.textures) + 1):
            room.set(**{f"{surface.prefix}texture": number})
            after = room.pictures()
            np.testing.assert_array_equal(after[~mask], before[~mask])
            assert all((after[mask] != other).any() for other in shown), (surface.prefix, number)
            shown.append(after[mask])


@pytest.mark.rendering
def test_lights(room):
    def channels(**values):
        room.set(**values)
        return room.pictures().reshape(-1, 3).mean(axis=0)

    built = channels()
    assert (channels(**{"light/brightness": 0.7}) < built).all()
    assert (channels(**{"light/ambient": 0.1}) > built).all()
    warm = channels(**{"light/warmth": 0.2}) - built
    assert warm[0] > 0 > warm[2]
    assert abs(warm[1]) < 0.1
    assert (channels(**{"light/rotation": (0, 0, 0.5)}) != built).any()


def test_brightness_of_the_hob_light_changes_that_light_only(kitchen):
    kitchen.set(**{"oven/hob_light_brightness": 0.5})
    hob = kitchen.physics.model.name2id("oven/hob_light", "light")
    factors = kitchen.model.light_diffuse / kitchen.built["light_diffuse"]
    np.testing.assert_allclose(factors[hob], 0.5)
    np.testing.assert_array_equal(np.delete(factors, hob, axis=0), 1)


def test_light_turns_about_the_vertical(kitchen):
    kitchen.set(**{"light/rotation": (0, 0, np.pi / 2)})
    x, y, z = kitchen.built["light_dir"].T
    arena = [kitchen.physics.model.name2id(name, "light") for name in ("from_left", "from_right")]
    np.testing.assert_allclose(kitchen.model.light_dir[arena], np.stack([-y, x, z], axis=1)[arena], atol=1e-12)


def test_cameras_move_and_turn(room):
    for i in range(room.model.ncam):
        camera = room.physics.model.id2name(i, "camera")
        prefix = f"{camera}_camera_" if "/" in camera else f"camera/{camera}_"
        room.restore()
        frame = room.physics.named.data.cam_xmat[camera].reshape(3, 3).copy()
        room.set(**{f"{prefix}rotation": (0, 0.1, 0), f"{prefix}offset": (0.1, 0.2, 0.3), f"{prefix}fovy": 33})
        # A positive rotation about y, which is up, turns the view, -z, to the left, -x.
        turned = frame.T @ room.physics.named.data.cam_xmat[camera].reshape(3, 3)
        np.testing.assert_allclose(turned @ [0, 0, -1], [-np.sin(0.1), 0, -np.cos(0.1)], atol=1e-9)
        np.testing.assert_allclose(room.model.cam_pos[i] - room.built["cam_pos"][i], (0.1, 0.2, 0.3), atol=1e-12)
        assert room.model.cam_fovy[i] == 33
        assert room.changed_fields() == {"cam_pos", "cam_quat", "cam_fovy"}
        others = np.arange(room.model.ncam) != i
        np.testing.assert_array_equal(room.model.cam_pos[others], room.built["cam_pos"][others])


@pytest.mark.rendering
def test_a_camera_that_moves_sees_another_image(kitchen):
    kitchen.restore()
    before = kitchen.picture("workspace")
    for name, value in (("offset", (0.02, 0, 0)), ("rotation", (0, 0, 0.02)), ("fovy", 49)):
        kitchen.set(**{f"camera/workspace_{name}": value})
        assert (kitchen.picture("workspace") != before).mean() > 0.05, name


def test_surfaces_exist_in_their_scenes(room):
    for surface in room.surfaces:
        for name in (*surface.materials, *surface.variants):
            assert room.physics.model.name2id(name, "material") >= 0
        for name in surface.geoms:
            assert room.physics.model.name2id(name, "geom") >= 0
