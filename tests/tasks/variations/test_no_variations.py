"""`variations="none"` and its equals in all front ends: nothing varies."""

import json

import gymnasium
import numpy as np
import pytest

from kitchen_suite import EnvironmentSpec, suite
from kitchen_suite.commands import evaluate, record

ENV_ID = "kitchen_suite.gymnasium_env:KitchenSuite/FrankaOpenCabinet-v1"
NONE = {"none": "none", "None": None, "a list": [], "a tuple": (), "a dict": {}}
FAST = ["--num_episodes=1", "--max_episode_steps=2", "--policy=zero"]


@pytest.mark.full
@pytest.mark.parametrize("variations", NONE.values(), ids=NONE)
def test_none_varies_nothing(variations):
    environment = suite.load("open_cabinet", "top_drawer", {"variations": variations, "visuals": False})
    assert not environment.task.variations.by_name
    single = gymnasium.make(ENV_ID, variations=variations)
    many = gymnasium.make_vec(ENV_ID, 1, vectorization_mode="vector_entry_point", variations=variations)
    plain = gymnasium.make(ENV_ID)
    expected, infos = plain.reset(seed=3)
    for made in (single, many):
        observation, own = made.reset(seed=3)
        np.testing.assert_array_equal(np.ravel(observation), expected)
        assert {*own} - {f"_{name}" for name in own} == {*infos}
        made.close()
    assert EnvironmentSpec.make("open_cabinet", None, {"variations": variations}).variations == "variations none"


@pytest.mark.parametrize("variations", ["", "null", ["none"], ["start", "none"]])
def test_a_refused_name_says_how_nothing_varies(variations):
    with pytest.raises(ValueError, match=r"does not exist; .*; where nothing varies, write variations='none'$"):
        suite.load("open_cabinet", "top_drawer", {"variations": variations, "visuals": False})
    environment = suite.load("open_cabinet", "top_drawer", {"variations": "none", "visuals": False})
    assert not environment.task.variations.by_name


@pytest.mark.full
@pytest.mark.usefixtures("folder")
def test_none_replaces_the_variations_of_a_protocol_on_the_command_line(run, tmp_path):
    for value in ("", "null"):
        status, _, err = run(evaluate, *FAST, f"--variations={value}")
        assert (status, err.count("\n")) == (2, 1)
        assert "where nothing varies, write variations='none'" in err
    status, out, _ = run(evaluate, *FAST, "--variations=none", "--json=a.json")
    assert status == 0
    assert "protocol default, variations none: 1 episode" in out
    assert "variations 'none', not ['start']" in out
    assert json.loads((tmp_path / "a.json").read_text("utf-8"))["task_kwargs"] == {"variations": []}
    assert run(record, *FAST, "--variations=none", "--output=runs")[0] == 0
    assert json.loads((tmp_path / "runs" / "recording.json").read_text("utf-8"))["task_kwargs"] == {"variations": []}
