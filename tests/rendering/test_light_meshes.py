"""Light meshes of `render_quality="fast"`: visual meshes alone, kept in a cache folder that may be in any state."""

import multiprocessing
import re
import subprocess
import sys
import warnings

import numpy as np
import pytest
from dm_control import composer, mjcf
from helpers.sweeps import brief

from kitchen_suite import entities, suite
from kitchen_suite.entities.assets import asset_dir, is_visual
from kitchen_suite.installation import install_command
from kitchen_suite.rendering import quality as light_meshes
from kitchen_suite.rendering.quality import set_render_quality

pytestmark = pytest.mark.full

VISUAL = asset_dir() / "franka_assets" / "meshes" / "visual"
# Greatest number of faces of a light mesh.
MAX_FACES = 1_400
LARGE = (*(f"link{number}" for number in range(8)), "hand")


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """An empty cache folder."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "kitchen-suite" / "light-meshes"


def stl():
    return (VISUAL / "hand.stl").read_bytes()


def num_faces(contents):
    return int.from_bytes(contents[80:84], "little")


def vertices(contents):
    """Corners of all faces of a binary STL file: `(n, 3)`."""
    face = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    return np.frombuffer(contents[84:], face)["corners"].reshape(-1, 3)


def mesh_faces(quality, domain="kitchen", task="kettle", **options):
    """Numbers of faces of all meshes of a task by name."""
    environment = suite.load(domain, task, {"random": 0, "render_quality": quality, **options})
    model = environment.physics.model
    return {model.id2name(i, "mesh"): int(model.mesh_facenum[i]) for i in range(model.nmesh)}


@pytest.mark.parametrize(
    ("domain", "task"),
    brief([("kitchen", "kettle"), ("open_cabinet", "top_drawer")], kept=[("open_cabinet", "top_drawer")]),
)
def test_the_nine_large_visual_meshes_are_light_and_all_others_as_they_were(domain, task):
    high, fast = (mesh_faces(quality, domain, task) for quality in ("high", "fast"))
    light = {f"franka/{part}_visual" for part in LARGE}
    assert sum(high[name] for name in light) > 130_000
    assert all(800 <= fast[name] <= MAX_FACES for name in light)
    assert {name: count for name, count in high.items() if name not in light} == {
        name: count for name, count in fast.items() if name not in light
    }


def test_shapes_change_by_a_millimetre_at_most():
    for part in LARGE:
        path = VISUAL / f"{part}.stl"
        large, light = (
            vertices(contents) for contents in (path.read_bytes(), light_meshes.light_stl(path.read_bytes()))
        )
        # The bounds of a mesh change by as much as its outermost points do.
        np.testing.assert_allclose(light.min(axis=0), large.min(axis=0), atol=1e-3)
        np.testing.assert_allclose(light.max(axis=0), large.max(axis=0), atol=1e-3)


def test_a_light_mesh_is_made_once(cache, monkeypatch):
    made = light_meshes.light_stl(stl())
    (file,) = cache.iterdir()
    assert 800 <= num_faces(made) <= MAX_FACES
    monkeypatch.setattr("trimesh.load_mesh", pytest.fail)
    assert light_meshes.light_stl(stl()) == made
    assert [*cache.iterdir()] == [file]


@pytest.mark.parametrize("damage", ["truncated", "flipped", "empty", "other", "folder"])
def test_a_damaged_file_is_made_again(damage, cache):
    made = light_meshes.light_stl(stl())
    (file,) = cache.iterdir()
    intact = file.read_bytes()
    if damage == "folder":
        file.unlink()
        file.mkdir()
    elif damage == "other":
        np.savez(file, stl=np.zeros(100, np.uint8), metadata=np.array("{}"))
    else:
        middle = len(intact) // 2
        flipped = intact[:middle] + bytes([intact[middle] ^ 255]) + intact[middle + 1 :]
        file.write_bytes({"truncated": intact[:middle], "flipped": flipped, "empty": b""}[damage])
    assert light_meshes.light_stl(stl()) == made
    if damage != "folder":  # In whose place no file can be put.
        assert file.read_bytes() == intact


def test_files_of_other_meshes_or_settings_are_not_used(cache, monkeypatch):
    first = light_meshes.light_stl(stl())
    other = light_meshes.light_stl((VISUAL / "link7.stl").read_bytes())
    assert other != first
    monkeypatch.setattr(light_meshes, "MAX_FACES", 900)
    assert num_faces(light_meshes.light_stl(stl())) <= 900
    monkeypatch.setattr("importlib.metadata.version", lambda package: "0.0")
    light_meshes.light_stl(stl())
    assert len([*cache.iterdir()]) == 4


@pytest.mark.parametrize("where", brief(["/dev/null/cache", "/proc/cache"], kept=["/proc/cache"]))
def test_without_a_folder_that_can_be_written_to_meshes_are_light_all_the_same(where, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", where)
    assert mesh_faces("fast")["franka/hand_visual"] <= MAX_FACES


def test_without_a_home_meshes_are_light_all_the_same(monkeypatch):
    def no_home():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(light_meshes.Path, "home", no_home)
    assert num_faces(light_meshes.light_stl(stl())) <= MAX_FACES


def test_a_relative_cache_folder_is_ignored(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path))
    light_meshes.light_stl(stl())
    assert len([*(tmp_path / ".cache" / "kitchen-suite" / "light-meshes").iterdir()]) == 1


def test_several_processes_may_make_the_same_mesh_at_once(cache):
    with multiprocessing.get_context("spawn").Pool(3) as pool:
        results = pool.map(light_meshes.light_stl, [stl()] * 6, chunksize=1)
    assert len(set(results)) == 1
    (file,) = cache.iterdir()
    assert light_meshes.light_stl(stl()) == results[0]
    assert file.suffix == ".npz"


def test_a_mesh_that_also_collides_stays_as_it_is():
    arena, robot = composer.Arena(), entities.make_robot("franka")
    arena.attach(robot)
    mesh = robot.mjcf_model.find("mesh", "hand_visual")
    robot.mjcf_model.find("body", "link7").add("geom", dclass="link", mesh=mesh, mass=0)
    set_render_quality(arena.mjcf_model, "fast", is_visual)
    physics = mjcf.Physics.from_mjcf_model(arena.mjcf_model)
    model = physics.model
    assert model.mesh_facenum[model.name2id("franka/hand_visual", "mesh")] > MAX_FACES
    assert model.mesh_facenum[model.name2id("franka/link7_visual", "mesh")] <= MAX_FACES


def test_without_the_extra_meshes_stay_and_a_warning_names_it(monkeypatch):
    monkeypatch.setattr(light_meshes, "PACKAGES", ("fast-simplification", "no-such-package"))
    with pytest.warns(UserWarning, match=rf"no-such-package: {re.escape(install_command('pixels'))}"):
        faces = mesh_faces("fast")
    assert faces == mesh_faces("high")


def test_without_visuals_nothing_is_missed(monkeypatch, cache):
    monkeypatch.setattr(light_meshes, "PACKAGES", ("no-such-package",))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mesh_faces("fast", visuals=False)
        mesh_faces("high")
    assert not cache.exists()


def test_the_packages_of_the_extra_are_imported_only_to_make_meshes():
    suite.load("open_cabinet", "top_drawer", {"render_quality": "fast"})
    code = (
        "import sys; from kitchen_suite import suite\n"
        "suite.load('open_cabinet', 'top_drawer', {'render_quality': 'fast'})\n"
        "assert not {'trimesh', 'fast_simplification'} & sys.modules.keys()"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_files_that_are_not_binary_stl_are_not_large():
    assert light_meshes.is_large(stl())
    for contents in (b"", b"solid text\n" * 1000, stl()[:-1], stl() + b"\0"):
        assert not light_meshes.is_large(contents)
