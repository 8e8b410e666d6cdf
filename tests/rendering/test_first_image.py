"""No GL library is opened before the first image, and then it works in any order of imports, without a display."""

import ctypes.util
import itertools
from pathlib import Path

import pytest
from helpers.headless import run

from kitchen_suite import suite

needs_maps = pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="only Linux lists the mapped libraries")

# Prints a line for each use of the suite that opened a library, and one at the end.
WATCHED = """
import contextlib, io, re
LIBRARY = re.compile(r"/lib(EGL|GL|OSMesa|OpenGL|glfw|LLVM|gallium)[^/]*$|_dri\\\\.so")

def opened():
    return {line.split()[-1] for line in open("/proc/self/maps") if LIBRARY.search(line.strip())}

for use in USES:
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        exec(use)
    if opened():
        print(use, opened())
        break
else:
    print("nothing is open")
"""

FRONT_ENDS = (
    "import kitchen_suite, gymnasium",
    "from kitchen_suite import suite, entities, tasks, environment, gymnasium_env, vector_env, policies",
    "from kitchen_suite import experts",
    "environment = suite.load(DOMAIN, suite.default_task(DOMAIN)); environment.reset()",
    "environment.step(environment.action_spec().generate_value())",
    "env = gymnasium.make('kitchen_suite:' + suite.DOMAINS[DOMAIN].env_id); env.reset(seed=0)",
    "env.step(env.action_space.sample())",
    "with_images = dict(obs_type='pixels', render_mode='rgb_array')",
    "seen = gymnasium.make('kitchen_suite:' + suite.DOMAINS[DOMAIN].env_id, **with_images)",
    "vector = gymnasium.make_vec('kitchen_suite:' + suite.DOMAINS[DOMAIN].env_id, num_envs=2)",
    "vector.reset(seed=0)",
    "vector.step(vector.action_space.sample()); vector.close(); env.close(); seen.close()",
)

COMMANDS = (
    "from kitchen_suite.commands import find",
    "find('rollout').main(['--list'])",
    "find('rollout').main(['--num_episodes=1', '--max_episode_steps=3'])",
    "find('record').main(['--num_episodes=1', '--max_episode_steps=3', '--output=' + FOLDER + '/episodes'])",
    "find('replay').main([FOLDER + '/episodes'])",
    "find('play').main(['--novideo', '--num_episodes=1', '--max_episode_steps=3'])",
    "find('evaluate').main(['--num_episodes=1', '--policy=zero'])",
    "find('doctor').main([])",
)


def watched(uses, **values):
    given = "".join(f"{name} = {value!r}\n" for name, value in {"USES": uses, **values}.items())
    return given + WATCHED


@pytest.mark.full
@needs_maps
@pytest.mark.parametrize(
    ("domain", "variables"), [*((domain, {}) for domain in suite.DOMAINS), ("open_cabinet", {"MUJOCO_GL": "egl"})]
)
def test_front_ends_open_no_gl_library(domain, variables):
    assert run(watched(FRONT_ENDS, DOMAIN=domain), **variables)[:2] == (0, "nothing is open\n")


@needs_maps
@pytest.mark.full
def test_commands_open_no_gl_library(tmp_path):
    status, out, err = run(watched(COMMANDS, FOLDER=str(tmp_path)))
    assert (status, out) == (0, "nothing is open\n"), err


@pytest.mark.full
@needs_maps
@pytest.mark.rendering
def test_the_first_image_opens_one():
    uses = (*FRONT_ENDS[:4], "environment.physics.render(16, 16)")
    status, out, _ = run(watched(uses, DOMAIN="open_cabinet"))
    assert status == 0
    assert out.startswith("environment.physics.render")


# Orders of imports that every run plays; a full run plays the others.
EVERY_RUN = [("dm_control", "suite", "gymnasium"), ("gymnasium", "suite", "dm_control")]
IMPORTS = {
    "suite": "from kitchen_suite import suite",
    "gymnasium": "import gymnasium, kitchen_suite.gymnasium_env",
    "dm_control": "from dm_control import suite as others; import mujoco",
}

# Images of the suite, of dm_control and of MuJoCo alone, each twice, since all share a thread.
IMAGES = """
import os, sys
variable = os.environ.get("MUJOCO_GL")
environment = suite.load("open_cabinet", "top_drawer")
ours = environment.physics
env = gymnasium.make("kitchen_suite:KitchenSuite/FrankaOpenCabinet-v1", render_mode="rgb_array", width=16, height=16)
env.reset(seed=0)
theirs = others.load("cartpole", "swingup").physics
data = mujoco.MjData(theirs.model.ptr)
mujoco.mj_forward(theirs.model.ptr, data)
renderer = mujoco.Renderer(theirs.model.ptr, 16, 16)
renderer.update_scene(data, "fixed")
images = [lambda: ours.render(16, 16), env.render, lambda: theirs.render(16, 16), renderer.render]
first, second = ([image() for image in images] for _ in range(2))
assert all(image.std() > 5 for image in first)
assert all((one == other).all() for one, other in zip(first, second))
assert os.environ.get("MUJOCO_GL") == variable
renderer.close()
env.close()
theirs.free()
"""


@pytest.mark.full
@pytest.mark.rendering
@pytest.mark.parametrize(
    "order",
    [
        pytest.param(order, marks=() if order in EVERY_RUN else pytest.mark.full)
        for order in itertools.permutations(IMPORTS)
    ],
    ids=" ".join,
)
def test_any_order_of_imports_renders_without_a_display(order):
    code = "\n".join(("import warnings; warnings.simplefilter('ignore')", *(IMPORTS[name] for name in order)))
    assert run(f"{code}\n{IMAGES}") == (0, "", "")


@pytest.mark.full
@pytest.mark.rendering
@pytest.mark.skipif(ctypes.util.find_library("OSMesa") is None, reason="needs libosmesa6")
def test_osmesa_renders_beside_dm_control_as_well():
    code = "\n".join((*IMPORTS.values(), IMAGES))
    assert run(code, MUJOCO_GL="osmesa") == (0, "", "")


@pytest.mark.full
@pytest.mark.rendering
def test_environments_of_others_keep_their_contexts():
    code = """
import gymnasium
from kitchen_suite import suite
others = gymnasium.make("InvertedPendulum-v5", render_mode="rgb_array", width=32, height=32)
others.reset(seed=0)
before = others.render()
environment = suite.load("open_cabinet", "top_drawer")
ours = environment.physics
first = ours.render(16, 16)
assert (others.render() == before).all() and before.std() > 5
assert (ours.render(16, 16) == first).all()
"""
    status, _, err = run(code, MUJOCO_GL="egl")
    assert status == 0, err


# Renders, and where that fails follows the advice of the error.
ADVISED = """
import os
from kitchen_suite import suite
environment = suite.load("open_cabinet", "top_drawer")
try:
    environment.physics.render(16, 16)
except RuntimeError as error:
    print(error)
    assert "unset" in str(error) or "choose from" in str(error)
    del os.environ["MUJOCO_GL"]
assert environment.physics.render(16, 16).std() > 5
"""


@pytest.mark.full
@pytest.mark.rendering
@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("", ""),
        ("glfw", "MUJOCO_GL=glfw: it needs a display"),
        ("enabled", "MUJOCO_GL=glfw: it needs a display"),
        ("disable", "rendering is disabled by MUJOCO_GL=disable: unset it"),
        ("0", "rendering is disabled by MUJOCO_GL=0: unset it"),
        ("elg", "MUJOCO_GL 'elg' does not exist (did you mean 'egl'?)"),
    ],
)
def test_a_value_of_mujoco_gl_that_cannot_work_is_told_with_what_helps(value, message):
    status, out, err = run(ADVISED, MUJOCO_GL=value)
    assert (status, err) == (0, "")
    assert message in out
    assert bool(message) == bool(out)
