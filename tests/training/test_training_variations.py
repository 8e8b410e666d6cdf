"""Training in environments that vary."""

import pytest

pytestmark = pytest.mark.clients


@pytest.mark.parametrize(
    "flags", [["--variations=start,dynamics", "--variation_split=held_out"], []], ids=["on", "off"]
)
def test_training_is_in_environments_that_vary(flags, prepared):
    learner, evaluated = prepared(*flags)
    # Without flags, those that are evaluated in do not vary, and of those that are trained in the drawers alone.
    _, info = evaluated.reset(seed=0)
    assert ("variation_values" in info) == bool(flags)
    _, info = learner.environments.reset(seed=0)
    assert ("cabinet/door_left" in info["variation_values"]) == bool(flags)
    if flags:
        for environments in (learner.environments, evaluated):
            _, info = environments.reset(seed=0)
            assert environments.get_attr("variation_split")[0] == "held_out"
            assert "cabinet/door_left" in info["variation_values"]
            assert "cabinet/yaw" not in info["variation_values"]
