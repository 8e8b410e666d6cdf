"""Small environments and learners for the tests of training, which run in seconds."""

import gymnasium
from gymnasium.vector import AutoresetMode

from kitchen_suite.gymnasium_env import KITCHEN_ID, OPEN_CABINET_ID

SMALL = {"num_envs": 4, "rollouts": 16, "hidden": [8], "mini_batches": 2, "learning_epochs": 2}
BATCH = 64
METADATA = {"domain_name": "open_cabinet", "task_name": "top_drawer", "task_kwargs": {}}
KITCHEN = {"tasks_to_complete": ["kettle"], "goal_format": "flat", "info_format": "arrays"}


def environments(count, mode=AutoresetMode.SAME_STEP, domain="open_cabinet", **settings):
    """Returns vectorised environments as a training run makes them."""
    name, own = {"open_cabinet": (OPEN_CABINET_ID, {}), "kitchen": (KITCHEN_ID, KITCHEN)}[domain]
    arguments = {"num_threads": 1, "autoreset_mode": mode, **own, **settings}
    return gymnasium.make_vec(name, count, vectorization_mode="vector_entry_point", **arguments)


def learner(envs, seed=0, domain="open_cabinet", initial_policy=None, **changes):
    """Returns a new learner in the environments."""
    import torch

    from kitchen_suite.training.ppo import PPOHyperparameters, PPOLearner

    # As in a training run.
    torch.set_num_threads(1)
    return PPOLearner(envs, PPOHyperparameters.for_domain(domain, {**SMALL, **changes}), seed, initial_policy)


def assert_same_state(one, other):
    """Asserts equality of the states of two learners: tensors, numbers and strings in dicts and lists."""
    import torch

    assert type(one) is type(other)
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for name, value in one.items():
            assert_same_state(value, other[name])
    elif isinstance(one, list | tuple):
        assert len(one) == len(other)
        for value, same in zip(one, other, strict=True):
            assert_same_state(value, same)
    elif isinstance(one, torch.Tensor):
        assert one.dtype == other.dtype
        assert torch.equal(one, other)
    else:
        assert one == other
