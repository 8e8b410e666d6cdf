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
    ground, red = ((np.array([90 / 255, 0.8]) + 0.055) / 1.055) ** 2.4
    light = 2.8 / math.pi * ((1 + ground) / 2 + (1 - ground) / 2 * cosines)
    np.testing.assert_allclose(colours[:, 0], red * 255 * light, atol=2.0)  # Rounded to whole numbers, twice.
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


BESIDE = """
<mujoco>
  <worldbody>
    <camera name="front" pos="0 -3 1" xyaxes="1 0 0 0 0 1"/>
    <camera name="back" pos="0 3 1" xyaxes="-1 0 0 0 0 1"/>
    <geom name="floor" type="plane" size="5 5 0.1" material="tiles"/>
    <geom name="wall" type="box" size="1 0.1 1" pos="0.5 0 0"/>
    <body name="moving" pos="0 0 2">
      <joint type="slide"/>
      <geom type="box" size="0.1 0.1 0.1"/>
    </body>
  </worldbody>
  <asset>
    <texture name="tiles" type="2d" builtin="checker" rgb1="1 1 1" rgb2="0 0 0" width="8" height="8"/>
    <material name="tiles" texture="tiles" texuniform="true"/>
  </asset>
</mujoco>
"""


# With the camera in front, the first scene is on the side of smaller x.
@pytest.mark.parametrize(("camera", "side"), [(0, 1.0), (1, -1.0)])
def test_two_scenes_stand_next_to_each_other_on_floors_that_meet(camera, side):
    from kitchen_suite.viewer.episode_page import SceneRecorder

    physics = [mjcf.Physics.from_mjcf_model(mjcf.from_xml_string(BESIDE)) for _ in range(2)]
    with SceneRecorder() as recorder:
        recorder.start(physics, camera, ("mine", "yours"))
        physics[1].data.qpos[:] = 0.5
        physics[1].forward()
        recorder.add_frame(physics, 0.1)
        head, _ = pages.contents(recorder.finish(1.0))
    messages = [(round(time, 6), message) for time, message in head["messages"]]
    frames = {message["name"]: message for _, message in messages if "FrameMessage" in message["type"]}
    assert {*frames} >= {"/scene_0", "/scene_1"}
    places = {message["name"]: message["position"] for _, message in messages if "SetPosition" in message["type"]}
    # The wall is 2 m wide, and 0.5 m from the other one.
    assert tuple(places["/scene_1"]) == (2.5 * side, 0.0, 0.0)
    assert tuple(places.get("/scene_0", (0.0, 0.0, 0.0))) == (0.0, 0.0, 0.0)
    glb = {message["name"]: message["props"]["glb_data"] for _, message in messages if "GlbMessage" in message["type"]}
    floors = [geometry(glb[f"/scene_{number}/surfaces/0"]).bounds[:, 0] for number in range(2)]
    meeting = (1.75, 1.75 - 2.5) if side > 0 else (-0.75, -0.75 + 2.5)
    assert [floor[1 if (number == 0) == (side > 0) else 0] for number, floor in enumerate(floors)] == list(meeting)
    assert [floor[0 if (number == 0) == (side > 0) else 1] for number, floor in enumerate(floors)] == [
        -5.0 * side,
        5.0 * side,
    ]
    labels = {message["name"]: message["props"]["text"] for _, message in messages if "LabelMessage" in message["type"]}
    assert labels == {"/scene_0/label": "mine", "/scene_1/label": "yours"}
    moved = {
        message["name"]: tuple(message["position"])
        for time, message in messages
        if time == 0.1 and "SetPosition" in message["type"]
    }
    assert moved["/scene_1/bodies/moving"] == (0.0, 0.0, 2.5)
    assert moved.get("/scene_0/bodies/moving", (0.0, 0.0, 2.0)) == (0.0, 0.0, 2.0)
    # The view is of the middle between both.
    camera_messages = {message["type"]: message for _, message in messages if "SetCamera" in message["type"]}
    assert camera_messages["SetCameraLookAtMessage"]["look_at"][0] == pytest.approx(1.25 * side)
    assert camera_messages["SetCameraPositionMessage"]["position"][0] == pytest.approx(1.25 * side)


def test_a_page_shows_the_episodes_of_two_policies_at_once(tmp_path):
    import dataclasses

    import kitchen_suite
    from kitchen_suite.evaluation.compare import PairedComparison
    from kitchen_suite.evaluation.side_by_side import add_to_page
    from kitchen_suite.viewer.episode_page import EpisodePage

    paths = [tmp_path / f"{name}.npz" for name in ("random", "zero")]
    for path, steps in zip(paths, (2, 2), strict=True):
        kitchen_suite.evaluate(path.stem, num_episodes=2, max_episode_steps=steps, num_envs=2, receipt=path)
    comparison = kitchen_suite.compare(*paths)
    (name,) = comparison.pairs
    (one, other), same = comparison.pairs[name]
    pairs = {name: [(dataclasses.replace(one, success=True), other), same]}
    differing = PairedComparison(first=comparison.first, second=comparison.second, pairs=pairs)
    page = EpisodePage(tmp_path / "both.html", camera="overview")
    with page.open_side_by_side(("random", "zero")) as add:
        assert add_to_page(differing, add, 10) == 1
    (episode,) = pages.read_page(tmp_path / "both.html")["episodes"]
    assert episode["name"] == f"episode 0, seed {one.seed}"
    assert [part["label"] for part in episode["parts"]] == ["random", "zero"]
    assert [len(part["rewards"]) for part in episode["parts"]] == [3, 3]


def test_the_episode_that_ends_first_stands_still(tmp_path):
    from kitchen_suite import EnvironmentSpec
    from kitchen_suite.episodes.episode import EpisodeBuffer
    from kitchen_suite.gymnasium_env.base import suite_env
    from kitchen_suite.viewer.episode_page import EpisodePage

    def steps(count):
        env = EnvironmentSpec.make("microwave_table", "open", {}, 9).make_environment(visuals=True)
        observation, info = env.reset(seed=0)
        buffer = EpisodeBuffer(observation, info, suite_env(env).physics_state, "")
        yield buffer, suite_env(env).environment
        for _ in range(count):
            buffer.step(env, np.full(8, 0.5, np.float32))
            yield buffer, suite_env(env).environment

    def both():
        first, second = [*steps(0)], steps(3)
        yield from ((first[0], each) for each in second)

    page = EpisodePage(tmp_path / "both.html", camera="overview")
    with page.open_side_by_side(("still", "moving")) as add:
        add("one", both())
    read = pages.read_page(tmp_path / "both.html")
    (episode,) = read["episodes"]
    assert [len(part["rewards"]) for part in episode["parts"]] == [1, 4]
    head, _ = pages.contents(pages.joined(read, episode))
    assert head["durationSeconds"] == pytest.approx(3 * episode["timestep"] + 1.0)
