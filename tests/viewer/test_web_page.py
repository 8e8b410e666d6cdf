"""Web pages hold the recordings of viser's, with what they share only once, and scenes what is drawn fast."""

import io
import math
from pathlib import Path

import msgspec
import numpy as np
import pytest
from dm_control import mjcf
from helpers import pages

from kitchen_suite.viewer.web_page import WebPage

pytestmark = pytest.mark.web

ABOUT = {"name": "episode 0", "instruction": "</script>", "timestep": 0.1}


@pytest.fixture(scope="module")
def recordings():
    """Two recordings of one scene with a mesh, of other motions."""
    from kitchen_suite.viewer.servers import silent_server

    found = []
    generator = np.random.default_rng(0)
    with silent_server() as server:
        server.scene.add_mesh_simple("/mesh", generator.normal(size=(999, 3)), np.arange(999).reshape(-1, 3))
        image = server.scene.add_image("/image", generator.integers(0, 255, (40, 40, 3), np.uint8), 1.0, 1.0)
        for motion in generator.normal(size=(2, 5, 3)):
            recording = server.get_scene_serializer()
            for position in motion:
                image.position = position
                recording.insert_sleep(0.1)
            found.append(recording.serialize())
    return found


@pytest.fixture(scope="module")
def page(recordings, tmp_path_factory):
    made = WebPage()
    for recording in recordings:
        made.add(recording, ABOUT)
    path = tmp_path_factory.mktemp("page") / "page.html"
    path.write_text(made.html("A <title> of [[page]]"), "utf-8")
    return path


def test_the_recordings_of_a_page_are_those_that_were_added(recordings, page):
    read = pages.read_page(page)
    for recording, episode in zip(recordings, read["episodes"], strict=True):
        assert pages.contents(pages.joined(read, episode)) == pages.contents(recording)


def test_episodes_share_large_messages(page):
    first, second = (set(episode["chunks"]) for episode in pages.read_page(page)["episodes"])
    assert first & second
    assert first != second


def test_a_page_asks_nothing_of_the_network(page):
    text = page.read_text("utf-8")
    assert "<title>A &lt;title&gt; of [[page]]</title>" in text
    assert "src=" not in text.replace("srcdoc=", "").partition('id="player-json"')[0]
    player = pages.script_json(text, "player-json")
    assert player.startswith("<!doctype html>")
    assert "</head>" in player


def test_text_of_an_episode_cannot_end_the_script(page):
    assert pages.read_page(page)["episodes"][0]["instruction"] == "</script>"


def test_numbers_that_are_not_finite_do_not_empty_a_page(recordings):
    made = WebPage()
    made.add(recordings[0], {**ABOUT, "rewards": [0.5, math.nan], "metrics": {"speed": [-math.inf, np.float64(1.0)]}})
    page = pages.script_json(made.html("page"), "page-json")
    (episode,) = page["episodes"]
    assert (episode["rewards"], episode["metrics"]) == ([0.5, None], {"speed": [None, 1.0]})


def test_a_silent_server_listens_to_no_port(capfd):
    from kitchen_suite.viewer.servers import silent_server

    before = listening()
    with silent_server():
        assert listening() == before
    assert capfd.readouterr() == ("", "")


def listening():
    """The sockets of this process that listen."""
    own = {path.resolve().name for path in Path("/proc/self/fd").iterdir()}
    rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    return [row[1] for row in rows if row[3] == "0A" and f"socket:[{row[9]}]" in own]


def test_recordings_are_messagepack(recordings):
    head, _ = pages.contents(recordings[0])
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(head)) == head


ROOM = """
<mujoco>
  <worldbody>
    <camera name="camera" pos="0 -3 1"/>
    <geom name="box" type="box" size="1 1 1" rgba="0.8 0.4 0.2 1"/>
    <geom name="pane" type="box" size="1 1 1" pos="3 0 0" rgba="0.8 0.4 0.2 0.5"/>
    <body name="moving" pos="0 0 2">
      <joint/>
      <geom type="capsule" size="0.1 0.5"/>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture(scope="module")
def meshes():
    """The glTF files of a scene by the names of their nodes."""
    from kitchen_suite.viewer.scene import Scene
    from kitchen_suite.viewer.servers import silent_server

    physics = mjcf.Physics.from_mjcf_model(mjcf.from_xml_string(ROOM))
    with silent_server() as server:
        Scene(server, physics, 0)
        head, _ = pages.contents(server.get_scene_serializer().serialize())
    messages = (message for _, message in head["messages"])
    return {message["name"]: message["props"]["glb_data"] for message in messages if "GlbMessage" in message["type"]}


def test_what_never_moves_has_its_colours_in_the_light(meshes):
    assert {*meshes} == {"/shapes/opaque", "/shapes/transparent", "/bodies/moving"}
    assert [b"KHR_materials_unlit" in glb for glb in meshes.values()] == [True, True, False]
    mesh = geometry(meshes["/shapes/opaque"])
    colours = mesh.visual.vertex_attributes["color"]
    # A hemisphere light of three.js: (sky + ground) / 2 + (sky - ground) / 2 * cosine, times intensity / pi.
    cosines = mesh.vertex_normals @ [-0.5, -0.8, 1.0] / math.sqrt(1.89)
    ground = ((90 / 255 + 0.055) / 1.055) ** 2.4
    light = 2.2 / math.pi * ((1 + ground) / 2 + (1 - ground) / 2 * cosines)
    np.testing.assert_allclose(colours[:, 0], 0.8 * 255 * light, atol=1.0)  # Rounded to whole numbers.
    assert (colours[:, 3] == 255).all()


def test_edges_are_sharp(meshes):
    box = geometry(meshes["/shapes/opaque"])
    assert len(box.vertices) == 24
    np.testing.assert_allclose(np.abs(box.vertex_normals).max(axis=1), 1.0)


def test_a_capsule_has_few_faces(meshes):
    assert len(geometry(meshes["/bodies/moving"]).faces) < 400


def geometry(glb):
    """The mesh of a glTF file."""
    import trimesh

    (mesh,) = trimesh.load_scene(io.BytesIO(glb), file_type="glb", process=False).geometry.values()
    return mesh


def test_a_page_shows_the_episodes_of_two_policies_in_turn(tmp_path):
    import dataclasses

    import kitchen_suite
    from kitchen_suite.evaluation.compare import PairedComparison
    from kitchen_suite.evaluation.side_by_side import add_to_page
    from kitchen_suite.viewer.episode_page import EpisodePage

    paths = [tmp_path / f"{name}.npz" for name in ("random", "zero")]
    for path in paths:
        kitchen_suite.evaluate(path.stem, num_episodes=2, max_episode_steps=2, num_envs=2, receipt=path)
    comparison = kitchen_suite.compare(*paths)
    (name,) = comparison.pairs
    (one, other), same = comparison.pairs[name]
    pairs = {name: [(dataclasses.replace(one, success=True), other), same]}
    differing = PairedComparison(first=comparison.first, second=comparison.second, pairs=pairs)
    with EpisodePage(tmp_path / "both.html", camera="overview").open() as watch:
        assert add_to_page(differing, watch, 10) == 1
    page = (tmp_path / "both.html").read_text(encoding="utf-8")
    seed = one.seed
    assert all(f"{each}, episode 0, seed {seed}" in page for each in ("random", "zero"))
    assert "episode 1, seed" not in page
