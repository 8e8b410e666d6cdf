"""The GL library is chosen for the first image; where there is none, one clear error says what to do."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from helpers.errors import refused
from helpers.headless import run

from kitchen_suite import gymnasium_env, suite
from kitchen_suite.rendering import gl
from kitchen_suite.vector_env import FrankaOpenCabinetVectorEnv

# Ends without an exception, and with nothing on stderr, also at exit.
RENDERING = """
import gymnasium
from kitchen_suite import suite
environment = suite.load("open_cabinet", "top_drawer")
assert environment.physics.render(16, 16).std() > 5
env = gymnasium.make(
    "kitchen_suite.gymnasium_env:KitchenSuite/FrankaOpenCabinet-v1", render_mode="rgb_array", width=16, height=16
)
env.reset(seed=0)
assert env.render().std() > 5
"""

# Imports and steps; then each way to render ends in the same RuntimeError.
STEPPING = """
import gymnasium
from kitchen_suite import suite
environment = suite.load("open_cabinet", "top_drawer")
environment.reset()
environment.step([0.0] * 8)
make = dict(render_mode="rgb_array", width=16, height=16)
env = gymnasium.make("kitchen_suite.gymnasium_env:KitchenSuite/FrankaOpenCabinet-v1", **make)
env.reset(seed=0)
for render in (environment.physics.render, env.render):
    try:
        render()
    except RuntimeError as error:
        print(error)
"""


# Renders, then forks processes that use what it made, or make their own; prints what each raised, and how it ended. A
# call of EGL, which would never return with some drivers, ends them at once. Processes of `multiprocessing` end by
# `os._exit`. After `sys.exit` NVIDIA's driver ends what the first process has in common with them, and so that process.
FORKING = """
import os, signal, sys
from kitchen_suite.gymnasium_env import FrankaOpenCabinetEnv

class NoEGL:
    def __getattr__(self, name):
        print("EGL was called:", name, flush=True)
        os._exit(1)

def make(**arguments):
    env = FrankaOpenCabinetEnv(render_quality="fast", **arguments)
    env.reset(seed=0)
    return env

PIXELS, FILM = {"obs_type": "pixels", "image_size": (16, 16)}, {"render_mode": "rgb_array", "width": 16, "height": 16}
seen, film = make(**PIXELS), make(**FILM)
film.render()
for use in (lambda: seen.step([0.0] * 8), film.render, lambda: make(**PIXELS), lambda: make(**FILM).render()):
    if os.fork() == 0:
        signal.alarm(20)
        for module in {"dm_control._render.pyopengl.egl_renderer", "mujoco.egl"} & sys.modules.keys():
            sys.modules[module].EGL = NoEGL()
        try:
            use()
        except RuntimeError as error:
            print("fork" in str(error) and "'spawn'" in str(error), flush=True)
        seen.close()
        film.close()
        {end}(7)
    ended = os.waitstatus_to_exitcode(os.wait()[1])
    if "{end}" == "os._exit":
        print(ended, flush=True)
"""

# Other code opens a GL library; then a process is forked in which it does not work, as with NVIDIA's driver.
LOADED = """
import os, sys
os.environ["MUJOCO_GL"] = "egl"
import dm_control.mujoco
from kitchen_suite import suite
import mujoco.egl

def fail(*size):
    raise OSError("the driver does not work after a fork")

environment = suite.load("open_cabinet", "top_drawer")
if os.fork() == 0:
    mujoco.egl.GLContext = fail
    try:
        environment.physics.render(16, 16)
    except RuntimeError as error:
        print(error, flush=True)
    os._exit(7)
print(os.waitstatus_to_exitcode(os.wait()[1]), environment.physics.render(16, 16).std() > 5)
"""

# Gymnasium builds an environment in this process, for its spaces, and then starts others. With NVIDIA's driver none
# renders that was forked.
ASYNC = """
import signal
import gymnasium
from gymnasium.vector import AsyncVectorEnv

def make():
    signal.alarm(60)
    arguments = {"obs_type": "pixels", "image_size": (16, 16), "render_quality": "fast"}
    return gymnasium.make("kitchen_suite:KitchenSuite/FrankaOpenCabinet-v1", **arguments)

for context in ("spawn", "fork"):
    envs = AsyncVectorEnv([make], context=context)
    try:
        print(envs.reset(seed=0)[0].std() > 5)
    except RuntimeError as error:
        print(context == "fork" and "'spawn'" in str(error))
    envs.close()
make().reset(seed=0)
try:
    AsyncVectorEnv([make], context="fork").reset(seed=0)
except RuntimeError as error:
    print("fork" in str(error))
"""


@pytest.mark.full
@pytest.mark.rendering
@pytest.mark.parametrize(
    ("end", "printed"),
    [("os._exit", ["True", "7"]), pytest.param("sys.exit", ["True"], marks=pytest.mark.full)],
)
def test_rendering_in_a_forked_process_is_an_error_and_does_not_hang(end, printed):
    status, out, _ = run(FORKING.replace("{end}", end))
    assert out.split() == printed * 4
    assert status == 0 or end == "sys.exit"


@pytest.mark.full
@pytest.mark.rendering
def test_a_driver_that_does_not_work_after_a_fork_is_told_from_a_missing_one():
    status, out, _ = run(LOADED)
    message, *rest = out.splitlines()
    assert "forked from has loaded it; start processes with the method 'spawn' or 'forkserver'" in message
    assert (status, rest) == (0, ["7 True"])


@pytest.mark.rendering
@pytest.mark.full
def test_gymnasiums_processes_see_pictures_unless_the_first_process_has_rendered():
    status, out, _ = run(ASYNC)
    assert (status, out.split()) == (0, ["True"] * 3)


@pytest.mark.full
@pytest.mark.rendering
def test_any_thread_renders_an_environment_and_frees_what_another_made():
    env = gymnasium_env.FrankaOpenCabinetEnv(render_mode="rgb_array", width=16, height=16, render_quality="fast")
    env.reset(seed=0)
    physics = env.environment.physics
    for render, free in ((env.render, env.close), (lambda: physics.render(16, 16, "overview"), physics.free_context)):
        before = render()
        for step in (render, free, render):
            with ThreadPoolExecutor(1) as pool:
                seen = pool.submit(step).result()
            assert step is free or (seen == before).all()
        np.testing.assert_array_equal(render(), before)
        free()


@pytest.mark.full
@pytest.mark.rendering
def test_rendering_without_mujoco_gl_works_and_leaves_stderr_empty():
    assert run(RENDERING) == (0, "", "")


@pytest.mark.full
def test_a_gl_library_that_cannot_be_loaded_fails_at_rendering_and_not_at_import():
    status, out, err = run(STEPPING, MUJOCO_GL="egl", __EGL_VENDOR_LIBRARY_FILENAMES="/nothing")
    assert (status, err) == (0, "")
    advice = "nothing can be rendered here with MUJOCO_GL=egl: install a GL library (Debian: libegl1 libgl1-mesa-dri"
    assert [line.startswith(advice) for line in out.splitlines()] == [True, True]


@pytest.fixture
def headless(monkeypatch):
    """A process without a display, in which `MUJOCO_GL` is unset and no GL library is installed."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    # Set first, so that the old value comes back whatever the code under test does.
    monkeypatch.setenv("MUJOCO_GL", "unset")
    monkeypatch.delenv("MUJOCO_GL")
    monkeypatch.setattr(gl, "installed_library", lambda: None)
    monkeypatch.setattr(gl, "_library", None)


@pytest.mark.full
@pytest.mark.parametrize("renders", ["suite", "gymnasium", "vector"])
def test_without_any_gl_library_rendering_raises_the_commands_sentence(headless, renders):
    environment = make(renders)
    render = environment.physics.render if renders == "suite" else environment.render
    with pytest.raises(RuntimeError, match=r"MUJOCO_GL=egl or osmesa: install a GL library .*libosmesa6"):
        render()


def test_an_empty_mujoco_gl_is_an_unset_one(headless, monkeypatch):
    environment = make("suite")
    monkeypatch.setenv("MUJOCO_GL", "")
    monkeypatch.setattr(gl, "can_render", lambda library: library == "osmesa")
    assert gl.find_library() == "osmesa"
    with pytest.raises(RuntimeError, match="with MUJOCO_GL=egl or osmesa: install"):
        environment.physics.render()


@pytest.mark.full
@pytest.mark.parametrize("value", ["off", "disable"])
def test_rendering_that_was_switched_off_is_no_missing_library(headless, monkeypatch, value):
    environment = make("suite")
    monkeypatch.setenv("MUJOCO_GL", value)
    message = f"^rendering is disabled by MUJOCO_GL={value}"
    with pytest.raises(OSError, match=message):
        gl.find_library()
    with pytest.raises(RuntimeError, match=message):
        environment.physics.render()


def test_a_misspelt_library_gets_the_nearest_and_a_list(headless, monkeypatch):
    environment = make("suite")
    monkeypatch.setenv("MUJOCO_GL", "elg")
    message = r"MUJOCO_GL 'elg' does not exist \(did you mean 'egl'\?\); choose from \['disable', 'egl', "
    with pytest.raises(OSError, match=message):
        gl.find_library()
    with pytest.raises(RuntimeError, match=message):
        environment.physics.render()


def make(kind):
    if kind == "suite":
        return suite.load("open_cabinet", "top_drawer")
    if kind == "gymnasium":
        return gymnasium_env.FrankaOpenCabinetEnv(render_mode="rgb_array")
    environment = FrankaOpenCabinetVectorEnv(1, render_mode="rgb_array")
    environment.reset(seed=0)
    return environment


def test_a_window_without_a_display_is_an_error_and_does_not_end_the_process(headless):
    with refused(RuntimeError, "render_mode", "'human'"):
        gymnasium_env.FrankaOpenCabinetEnv(render_mode="human")
