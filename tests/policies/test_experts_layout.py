"""The experts in moved layouts: they observe the poses of objects and of the robot's base."""

import numpy as np
import pytest
from helpers.episodes import play_expert
from helpers.errors import refused

from kitchen_suite import experts, suite
from kitchen_suite.policies.experts.kitchen import ObservedLayout, needed_observables
from kitchen_suite.policies.experts.kitchen_skills import SKILLS
from kitchen_suite.tasks import DEFAULT_TASKS
from kitchen_suite.tasks.requests import Reset
from kitchen_suite.tasks.variations.distributions import SPLITS
from kitchen_suite.tasks.variations.variations import VariationRequest

pytestmark = pytest.mark.full

KITCHEN_POSES = (
    "franka/base_pose",
    "microwave/pose",
    "slide_cabinet/pose",
    "hinge_cabinet/pose",
    "hood/pose",
    "oven/pose",
)


def load(task_name, variations="layout", domain="kitchen", **options):
    return suite.load(domain, task_name, {"visuals": False, "variations": variations, **options})


def successes(environment, count):
    return sum(play_expert(environment)["success"] for _ in range(count))


def complete(split, seed):
    return load("complete", random=seed, variation_split=split, extra_observables=KITCHEN_POSES)


@pytest.mark.parametrize("split", SPLITS)
def test_the_kitchens_expert_completes_its_tasks_in_drawn_layouts(split):
    assert successes(complete(split, seed=1), 2) == 2


@pytest.mark.nightly
@pytest.mark.parametrize("split", SPLITS)
def test_the_kitchens_expert_completes_its_tasks_in_many_layouts(split):
    assert successes(complete(split, seed=11), 50) >= 40


@pytest.mark.nightly
@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize("drawer", ["top", "bottom"])
def test_the_drawers_expert_opens_them_in_many_layouts(drawer, split):
    environment = load(f"{drawer}_drawer", domain="open_cabinet", random=11, variation_split=split)
    assert successes(environment, 40) >= 38


def test_in_the_default_layout_the_poses_are_those_that_skills_are_made_for():
    environment = complete("seen", seed=0)
    environment.task.follow(environment.task.checked_reset({"variation": []}))
    observed = environment.reset().observation
    layout = ObservedLayout(KITCHEN_POSES)
    extras = np.concatenate([observed[name] for name in environment.task.extra_observables])
    assert layout.size == extras.size
    for task in SKILLS:
        np.testing.assert_allclose(layout.frame(task, extras).as_matrix(), np.eye(4), atol=1e-9)
    environment.task.follow(environment.task.checked_reset({"variation": []}))
    assert play_expert(environment)["success"]


@pytest.mark.parametrize("burner", [1, 2])
def test_the_kettle_is_brought_from_the_right_burners_without_further_observables(burner):
    assert play_expert(load("kettle", {"kettle/burner": burner}, random=0))["success"]


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
    with refused(ValueError, "extra_observables", "['franka/base_pose']"):
        expert.check_observes(varied)
    expert.check_observes({"microwave/yaw", "hood/offset"})
    experts.KitchenExpert(["kettle"]).check_observes({"microwave/offset", "kettle/burner"})
    experts.DrawerExpert("top").check_observes({"cabinet/offset", "cabinet/yaw"})
    assert needed_observables(DEFAULT_TASKS, varied) == ["franka/base_pose", "hood/pose", "microwave/pose"]


def test_a_task_out_of_reach_is_postponed():
    tasks = ("microwave", "light switch")
    environment = load("all", random=0, tasks_to_complete=tasks, extra_observables=KITCHEN_POSES)
    # Farther away than any layout that is drawn.
    far = {"microwave/offset": np.array([-0.4, 0.3, 0.0])}
    excluded = frozenset(environment.task.variations.by_name)
    environment.task.follow(Reset(VariationRequest(excluded=excluded, values=far)))
    assert play_expert(environment)["tasks_completed"].keys() == {"light switch"}


@pytest.mark.parametrize("control_mode", ["joint_position", "ee_delta_pose", "ee_delta_position"])
def test_the_expert_observes_the_layout_in_other_control_modes(control_mode):
    moved = {"microwave/offset": [-0.01, 0.01, 0.0], "pedestal/offset": [0.01, -0.01, 0.0]}
    options = {"random": 0, "extra_observables": KITCHEN_POSES, "control_mode": control_mode}
    assert play_expert(load("microwave", moved, **options))["success"]
