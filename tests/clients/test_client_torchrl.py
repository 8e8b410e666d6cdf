"""TorchRL's GymEnv accepts the kitchen's id, and returns the same values as Gymnasium."""

import gymnasium
import numpy as np
import pytest

from kitchen_suite.suite import DOMAINS

pytestmark = pytest.mark.clients

KITCHEN = "kitchen_suite.gymnasium_env:KitchenSuite/FrankaKitchen-v1"
STEPS = 30


@pytest.fixture(params=["dict", "flat"])
def goal_format(request):
    return request.param


def rollout(environment, seed, steps=STEPS):
    import torch

    torch.manual_seed(0)
    environment.set_seed(seed)
    return environment.rollout(steps)


def test_the_specs_fit_what_comes(goal_format):
    from torchrl.envs import GymEnv
    from torchrl.envs.utils import check_env_specs

    environment = GymEnv(KITCHEN, goal_format=goal_format)
    # Raises an AssertionError where a rollout differs from the specs.
    check_env_specs(environment)
    assert environment.action_spec.shape == (9,)
    assert environment.observation_spec["observation"].shape == (59,)
    assert environment.action_spec.is_in(environment.action_spec.rand())
    environment.close()


def test_the_same_seed_gives_the_same_rollout(goal_format):
    from torchrl.envs import GymEnv

    environment, other = (GymEnv(KITCHEN, goal_format=goal_format) for _ in range(2))
    first = rollout(environment, 3)
    assert first.shape == (STEPS,)
    assert (first == rollout(environment, 3)).all()
    assert (first == rollout(other, 3)).all()
    assert not (first["observation"] == rollout(other, 4)["observation"]).all()
    for each in (environment, other):
        each.close()


def test_a_rollout_is_what_gymnasium_gives(goal_format):
    from torchrl.envs import GymWrapper

    environment = GymWrapper(gymnasium.make(KITCHEN, goal_format=goal_format))
    plain = gymnasium.make(KITCHEN, goal_format=goal_format)
    got = rollout(environment, 2**31)
    # Seeding is a reset of its own; the rollout starts with the next one.
    plain.reset(seed=2**31)
    observation, _ = plain.reset()
    for i in range(STEPS):
        assert np.array_equal(got["observation"][i].numpy(), observation["observation"])
        observation, reward, *_ = plain.step(got["action"][i].numpy())
        assert got["next", "reward"][i].item() == reward
        achieved = got["next", "achieved_goal"][i]
        if goal_format == "dict":
            assert {*achieved.keys()} == {*observation["achieved_goal"]}
            assert all(np.array_equal(achieved[task].numpy(), x) for task, x in observation["achieved_goal"].items())
        else:
            assert np.array_equal(achieved.numpy(), observation["achieved_goal"])
    for each in (environment, plain):
        each.close()


def test_an_episode_is_truncated_after_280_steps():
    from torchrl.envs import GymEnv

    environment = GymEnv(KITCHEN)
    episode = rollout(environment, 0, steps=300)
    assert episode.shape == (280,)
    assert episode["next", "truncated"].ravel().tolist() == [False] * 279 + [True]
    assert not episode["next", "terminated"].any()
    environment.close()


def test_infos_of_fixed_shape_can_be_read_too():
    from torchrl.envs import GymEnv

    environment = GymEnv(
        KITCHEN, info_format="arrays", tasks_to_complete=["microwave", "kettle"], goals={"microwave": [-0.2]}
    ).auto_register_info_dict()
    got = rollout(environment, 0, steps=3)["next"]
    assert got["reward"].ravel().tolist() == [1.0, 0.0, 0.0]
    assert got["step_task_completions_mask"].tolist() == [[True, False], [False, False], [False, False]]
    assert got["completion_steps"].tolist() == [[1, -1]] * 3
    assert got["episode_step"].ravel().tolist() == [1, 2, 3]
    environment.close()


def test_many_environments_are_stepped_by_processes(goal_format):
    from torchrl.envs import GymEnv

    # Without "arrays" it raises an AttributeError: it reads the infos of such environments, and cannot read lists.
    environment = GymEnv(KITCHEN, num_envs=2, goal_format=goal_format, info_format="arrays")
    got = environment.rollout(3)
    assert got.shape == (2, 3)
    assert got["observation"].shape == (2, 3, 59)
    assert got["next", "episode_step"].reshape(2, 3).tolist() == [[1, 2, 3]] * 2
    environment.close()


# Arguments with which a vector's infos can be read and its actions are bounded.
READABLE = {"kitchen": {"info_format": "arrays"}, "open_cabinet": {"action_limit": 1.0}}
# TorchRL reads the infos of `SameStep`; it fails where they hold strings, as in the kitchen's, with Gymnasium's own
# vectors as well.
MODES = [(domain, "Disabled") for domain in DOMAINS] + [
    (name, "SameStep") for name in ("open_cabinet", "microwave_table")
]


@pytest.mark.parametrize(("domain", "mode"), MODES)
def test_a_vector_is_wrapped_as_gymnasiums_own(domain, mode):
    import torch
    from torchrl.envs import GymWrapper
    from torchrl.envs.utils import check_env_specs

    env_id = DOMAINS[domain].env_id
    options = {"max_episode_steps": 5, **READABLE.get(domain, {})}
    vectors = [
        gymnasium.make_vec(env_id, 2, autoreset_mode=mode, num_threads=1, **options),
        gymnasium.make_vec(env_id, 2, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **options),
    ]
    rollouts = []
    for vector in vectors:
        environment = GymWrapper(vector)
        environment.set_seed(0)
        torch.manual_seed(0)
        rollouts.append(environment.rollout(12, break_when_any_done=False))
    for key in ("observation", ("next", "observation"), ("next", "reward"), ("next", "done")):
        assert torch.equal(rollouts[0][key], rollouts[1][key]), key
    assert rollouts[0]["next", "done"].sum() >= 4
    check_env_specs(GymWrapper(gymnasium.make_vec(env_id, 2, autoreset_mode=mode, num_threads=1, **options)))
    for vector in vectors:
        vector.close()


def test_the_mode_that_it_does_not_support_is_refused_by_name():
    from torchrl.envs import GymWrapper

    with pytest.raises(RuntimeError, match=r"SAME_STEP or DISABLED"):
        GymWrapper(gymnasium.make_vec(KITCHEN, 2, num_threads=1))
