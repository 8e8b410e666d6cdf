"""Measures frames per second by render quality, and what a frame consists of.

python docs/experiments/rendering.py                            the kitchen, beside the original's renderer
python docs/experiments/rendering.py --domain_name=open_cabinet

In every round each renderer draws frames, and the best of the rounds counts: other programs only slow down. It needs a
GL library, and the extra `pixels` for light meshes.
"""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import contextlib
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, cast

import mujoco
import numpy as np
from benchmark_cases import DOMAINS, BenchmarkDomain
from benchmark_tables import print_results
from experiment import make_parser, positive
from gymnasium.envs.mujoco.mujoco_rendering import MujocoRenderer
from numpy.typing import NDArray
from original import patched_kitchen_env
from tqdm import tqdm

from kitchen_suite.environment import Environment
from kitchen_suite.rendering import gl, quality

# Names of renderers.
ORIGINAL = "Gymnasium-Robotics"
HIGH = "high"
FAST = "fast, without light meshes"
LIGHT = "fast"

SIZES = (128, 480)  # Width and height of images [pixels].

SECONDS = 0.2  # Time that one measurement takes, at least one frame [s].

_HIDDEN = 5  # A geom group that is not drawn by default.

_FLAG, _GEOM = mujoco.mjtRndFlag, mujoco.mjtGeom

# What frames consist of, by name: flags of the scene, or types of geoms.
_FLAGS = {
    "shadows": (_FLAG.mjRND_SHADOW,),
    "reflections": (_FLAG.mjRND_REFLECTION,),
    "sky and haze": (_FLAG.mjRND_SKYBOX, _FLAG.mjRND_HAZE),
}
_GEOMS = {
    "meshes": (_GEOM.mjGEOM_MESH,),
    "cylinders, capsules, spheres": (_GEOM.mjGEOM_CYLINDER, _GEOM.mjGEOM_CAPSULE, _GEOM.mjGEOM_SPHERE),
    "boxes, floor": (_GEOM.mjGEOM_BOX, _GEOM.mjGEOM_PLANE),
}
CONTENTS = (*_FLAGS, *_GEOMS)


class FrameTimer:
    """Times the frames of one of Gymnasium's renderers, of which several may exist."""

    def __init__(self, renderer: MujocoRenderer) -> None:
        """Renders the first frame, for which the renderer makes its GL context."""
        self._renderer, self._model = renderer, renderer.model
        renderer.render("rgb_array")
        self._viewer = cast(Any, renderer.viewer)
        size = self._viewer.viewport.height, self._viewer.viewport.width
        self._rgb, self._depth = np.empty((*size, 3), np.uint8), np.empty(size, np.float32)

    @property
    def num_faces(self) -> int:
        """Number of faces of all meshes that are drawn."""
        drawn = (self._model.geom_type == _GEOM.mjGEOM_MESH) & (self._model.geom_group < 3)
        return int(self._model.mesh_facenum[self._model.geom_dataid[drawn]].sum())

    def picture(self) -> NDArray[np.uint8]:
        self._viewer.make_context_current()
        return cast(NDArray[np.uint8], self._renderer.render("rgb_array"))

    def frame(self) -> float:
        """Returns the mean time of an image [s]."""
        return self._mean(lambda: self._renderer.render("rgb_array"))

    def parts(self) -> dict[str, float]:
        """Returns the mean times of the calls of MuJoCo that make an image [s]."""
        view = self._viewer
        scene = view.model, view.data, view.vopt, view.pert, view.cam, mujoco.mjtCatBit.mjCAT_ALL, view.scn
        calls: dict[str, Callable[[], object]] = {
            "scene": lambda: mujoco.mjv_updateScene(*scene),
            "drawing": lambda: mujoco.mjr_render(view.viewport, view.scn, view.con),
            # Software may still draw when mjr_render has returned.
            "reading": lambda: mujoco.mjr_readPixels(self._rgb, self._depth, view.viewport, view.con),
        }
        times = dict.fromkeys(calls, 0.0)
        count = 0

        def frame() -> None:
            nonlocal count
            count += 1
            for name, call in calls.items():
                started = time.perf_counter()
                call()
                times[name] += time.perf_counter() - started

        self._mean(frame)
        return {name: seconds / count for name, seconds in times.items()}

    def close(self) -> None:
        """Frees the GL context, and before that what MuJoCo has in it, which would free the names of another one's."""
        self._viewer.make_context_current()
        self._viewer.con.free()
        self._renderer.close()

    def _mean(self, frame: Callable[[], object]) -> float:
        self._viewer.make_context_current()
        frame()  # Whatever ran before has emptied the processor's caches.
        count, started = 0, time.perf_counter()
        while (elapsed := time.perf_counter() - started) < SECONDS or not count:
            frame()
            count += 1
        return elapsed / count

    @contextlib.contextmanager
    def leaving_out(self, content: str) -> Iterator[None]:
        """Context in which images are without one of `CONTENTS`."""
        flags, groups = self._viewer.scn.flags.copy(), self._model.geom_group.copy()
        for flag in _FLAGS.get(content, ()):
            self._viewer.scn.flags[flag] = 0
        for kind in _GEOMS.get(content, ()):
            self._model.geom_group[self._model.geom_type == kind] = _HIDDEN
        try:
            yield
        finally:
            self._viewer.scn.flags[:], self._model.geom_group[:] = flags, groups


def original_renderer(size: int) -> MujocoRenderer:
    """Builds the renderer of the original kitchen; `size` is width and height of the images [pixels]."""
    with patched_kitchen_env() as kitchen_env:
        original = kitchen_env.KitchenEnv(render_mode="rgb_array", width=size, height=size)
        original.reset(seed=0)
    return cast(MujocoRenderer, original.robot_env.mujoco_renderer)


def build_renderers(domain: BenchmarkDomain, size: int) -> dict[str, MujocoRenderer]:
    """Builds renderers by name; the first is the denominator of every ratio.

    They are those of the suite's environments, camera `overview`, without the extra `pixels` none of light meshes, and
    before them the original's in the kitchen. `size` is width and height of the images [pixels].
    """
    without_light = domain.load(render_quality="high")
    # No geom counts as visual, so that no mesh is replaced; the next reset compiles the model again.
    quality.set_render_quality(without_light.task.root_entity.mjcf_model, "fast", lambda geom: False)
    environments = {HIGH: domain.load(render_quality="high"), FAST: without_light}
    if not quality.missing_packages():
        environments[LIGHT] = domain.load(render_quality="fast")
    original = {ORIGINAL: original_renderer(size)} if domain is DOMAINS["kitchen"] else {}
    return {**original, **{name: _renderer(environment, size) for name, environment in environments.items()}}


def _renderer(environment: Environment, size: int) -> MujocoRenderer:
    environment.reset()
    physics = environment.physics
    return MujocoRenderer(physics.model.ptr, physics.data.ptr, width=size, height=size, camera_name="overview")


def measure(domain: BenchmarkDomain, rounds: int) -> list[dict[str, Any]]:
    """Measures all renderers in every round; returns the results for each of `SIZES`."""
    return [_measure_size(size, build_renderers(domain, size), rounds) for size in SIZES]


def _measure_size(size: int, renderers: Mapping[str, MujocoRenderer], rounds: int) -> dict[str, Any]:
    contents = CONTENTS if size == SIZES[0] else ()
    timers = {name: FrameTimer(renderer) for name, renderer in renderers.items()}
    try:
        measured = [
            {name: _round(timer, contents) for name, timer in timers.items()}
            for _ in tqdm(range(rounds), f"{size} pixels", disable=None)
        ]
        faces = {name: timer.num_faces for name, timer in timers.items()}
    finally:
        for timer in timers.values():
            timer.close()
    best = {name: {key: min(each[name][key] for each in measured) for key in measured[0][name]} for name in timers}
    first = best[next(iter(timers))]
    results = {}
    for name, times in best.items():
        ratio, parts = first["frame"] / times["frame"], {key: times[key] for key in times if key not in contents}
        saved = {content: times["frame"] - times[content] for content in contents}
        results[name] = {"ratio": ratio, "num_faces": faces[name], "times": parts, "contents": saved}
    return {"size": size, "renderers": results}


def _round(timer: FrameTimer, contents: Sequence[str]) -> dict[str, float]:
    """Returns the times of a frame, of its parts, and of frames without some contents [s]."""
    without = {}
    for content in contents:
        with timer.leaving_out(content):
            without[content] = timer.frame()
    return {"frame": timer.frame(), **timer.parts(), **without}


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the command."""
    parser = make_parser(__doc__)
    parser.add_argument("--domain_name", choices=DOMAINS, default="kitchen")
    parser.add_argument("--rounds", type=positive, default=9, help="rounds that count")
    parser.add_argument("--json", action="store_true", help="print JSON in place of tables")
    options = parser.parse_args(arguments)
    gl.prepare(rendering=True)
    results = {"results": measure(DOMAINS[options.domain_name], options.rounds)}
    print_results(parser, options, "rendering", results)


if __name__ == "__main__":
    main()
