"""The experts in moved layouts: they observe the poses of objects and of the robot's base."""

import numpy as np
import pytest
from layout_episodes import KITCHEN_POSES, LayoutEpisodes, successes

from kitchen_suite import experts, suite
from kitchen_suite.policies.experts.kitchen_layout import ObservedLayout, needed_observables
from kitchen_suite.policies.experts.kitchen_skills import SKILLS
from kitchen_suite.tasks.varied import SPLITS


def policy_of(episodes):
    return experts.make_policy(episodes.environment, np.random.default_rng(0))


@pytest.fixture(scope="module")
def complete():
    return LayoutEpisodes("kitchen", "complete", extra_observables=KITCHEN_POSES)


@pytest.mark.parametrize("split", SPLITS)
def test_the_kitchens_expert_completes_its_tasks_in_drawn_layouts(complete, split):
    assert successes(complete, policy_of(complete), split, 3, seed=1)[0] == 3


@pytest.mark.slow
@pytest.mark.parametrize("split", SPLITS)
def test_the_kitchens_expert_completes_its_tasks_in_many_layouts(complete, split):
    assert successes(complete, policy_of(complete), split, 50, seed=11)[0] >= 40


@pytest.mark.slow
@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize("drawer", ["top", "bottom"])
def test_the_drawers_expert_opens_them_in_many_layouts(drawer, split):
    episodes = LayoutEpisodes("open_cabinet", f"{drawer}_drawer")
    assert successes(episodes, policy_of(episodes), split, 40, seed=11)[0] >= 38


def test_in_the_default_layout_the_poses_are_those_that_skills_are_made_for(complete):
    complete.values = {}
    observed = complete.environment.reset().observation
    layout = ObservedLayout(KITCHEN_POSES)
    extras = np.concatenate([observed[name] for name in complete.environment.task.extra_observables])
    assert layout.size == extras.size
    for task in SKILLS:
        np.testing.assert_allclose(layout.frame(task, extras).as_matrix(), np.eye(4), atol=1e-9)
    assert complete.play(policy_of(complete))["success"]


@pytest.mark.parametrize("burner", [1, 2])
def test_the_kettle_is_brought_from_the_right_burners_without_further_observables(burner):
    episodes = LayoutEpisodes("kitchen", "kettle")
    episodes.values = {"kettle/burner": burner}
    assert episodes.play(policy_of(episodes))["success"]


def test_without_poses_other_observables_change_nothing():
    plain, other = (
        suite.load("kitchen", "microwave", {"visuals": False, "random": 3, "extra_observables": names})
        for names in ((), ("franka/gripper_width", "microwave/handle_positions"))
    )
    policies = [experts.make_policy(env, np.random.default_rng(0)) for env in (plain, other)]
    timesteps = [plain.reset(), other.reset()]
    for _ in range(10):
        actions = [policy(timestep) for policy, timestep in zip(policies, timesteps, strict=True)]
        np.testing.assert_array_equal(*actions)
        timesteps = [plain.step(actions[0]), other.step(actions[1])]


def test_the_expert_says_which_observables_it_needs():
    varied = {"microwave/yaw", "hood/offset", "pedestal/offset", "kettle/burner", "kettle/mass"}
    expert = experts.KitchenExpert(["microwave", "kettle"], extra_observables=["microwave/pose"])
    with pytest.raises(ValueError, match=r"extra_observables \['franka/base_pose'\]"):
        expert.check_observes(varied)
    expert.check_observes({"microwave/yaw", "hood/offset"})
    experts.KitchenExpert(["kettle"]).check_observes({"microwave/offset", "kettle/burner"})
    experts.DrawerExpert("top").check_observes({"cabinet/offset", "cabinet/yaw"})
    assert needed_observables(list(SKILLS), varied) == ["franka/base_pose", "hood/pose", "microwave/pose"]


def test_a_task_out_of_reach_is_postponed():
    episodes = LayoutEpisodes(
        "kitchen", "all", tasks_to_complete=("microwave", "light switch"), extra_observables=KITCHEN_POSES
    )
    episodes.values = {"microwave/offset": [-0.4, 0.3, 0.0]}
    assert episodes.play(policy_of(episodes))["tasks_completed"].keys() == {"light switch"}


@pytest.mark.parametrize("control_mode", ["joint_position", "ee_delta_pose", "ee_delta_position"])
def test_the_expert_observes_the_layout_in_other_control_modes(control_mode):
    episodes = LayoutEpisodes("kitchen", "microwave", extra_observables=KITCHEN_POSES, control_mode=control_mode)
    episodes.values = {"microwave/offset": [-0.01, 0.01, 0.0], "pedestal/offset": [0.01, -0.01, 0.0]}
    assert episodes.play(policy_of(episodes))["success"]
