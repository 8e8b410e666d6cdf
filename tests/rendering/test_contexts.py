"""GL contexts are freed quietly, whoever drops them, and do not pile up."""

import pytest
from helpers.headless import run
from helpers.sweeps import brief

pytestmark = pytest.mark.rendering

MADE = """
import gc, threading
import gymnasium
from kitchen_suite import suite

def make():
    environment = suite.load("open_cabinet", "top_drawer")
    env = gymnasium.make(
        "kitchen_suite:KitchenSuite/FrankaOpenCabinet-v1", render_mode="rgb_array", width=16, height=16,
        obs_type="pixels", image_size=(16, 16), render_quality="fast",
    )
    env.reset(seed=0)
    assert environment.physics.render(16, 16).std() > 5 and env.render().std() > 5
    return environment, env

def in_a_thread(function):
    thread = threading.Thread(target=function)
    thread.start()
    thread.join()
"""

ENDS = {
    "at exit": "kept = make()",
    "in a cycle at exit": "kept = [make()]; kept.append(kept)",
    "in another thread": "made = [make()]\nin_a_thread(lambda: (made.clear(), gc.collect()))",
    "made in another thread": "made = []\nin_a_thread(lambda: made.append(make()))\nmade.clear(); gc.collect()",
    "made in another thread, at exit": "made = []\nin_a_thread(lambda: made.append(make()))",
    "in another thread, and others made": (
        "made = [make()]\nin_a_thread(lambda: (made.clear(), gc.collect()))\nin_a_thread(make)\nmake()"
    ),
    "closed in another thread": "_, env = make()\nin_a_thread(env.close)\nenv.render()",
    "in the middle of an image": (
        "made, environment = [make()], suite.load('open_cabinet', 'top_drawer')\n"
        "kept = environment.physics\n"
        "first = kept.render(16, 16)\n"
        "kept.render(16, 16, scene_callback=lambda *_: (made.clear(), gc.collect()))\n"
        "assert (kept.render(16, 16) == first).all()"
    ),
}


EVERY_RUN = ("at exit", "in another thread", "in the middle of an image")


@pytest.mark.full
@pytest.mark.parametrize("end", brief(ENDS, EVERY_RUN, [end for end in ENDS if end not in EVERY_RUN]))
def test_dropped_environments_are_quiet(end):
    assert run(MADE + ENDS[end]) == (0, "", "")


@pytest.mark.nightly
@pytest.mark.parametrize("drop", ["env.close()", "del env, environment", "in_a_thread(lambda: made.clear())"])
def test_contexts_do_not_pile_up(drop):
    """Two hundred cycles of two contexts each; their framebuffers and textures alone take 5 MiB."""
    code = f"""{MADE}
import resource
for index in range(200):
    made = [make()]
    environment, env = made[0] if "made" not in {drop!r} else (None, None)
    if {drop!r}.startswith("del"):
        made.clear()
    {drop}
    gc.collect()
    if index == 50:
        early = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - early < 100 * 1024)
"""
    assert run(code, timeout=1800) == (0, "True\n", "")
