"""skrl wraps the kitchen by itself, single and as a vector, and trains in it."""

import gymnasium
import numpy as np
import pytest

pytestmark = [pytest.mark.clients, pytest.mark.usefixtures("one_thread")]

KITCHEN = "kitchen_suite.gymnasium_env:KitchenSuite/FrankaKitchen-v1"
EASY = {"tasks_to_complete": ["microwave", "kettle"], "goals": {"microwave": [-0.2]}}
# 59 numbers of the state, and 8 each of achieved and desired goals.
SIZE = 59 + 2 * 8


def vector(count, mode="vector_entry_point"):
    return gymnasium.make_vec(KITCHEN, num_envs=count, vectorization_mode=mode, goal_format="flat", **EASY)


def laid_out(observation):
    """As skrl lays observations out: by key in alphabetical order, in float32."""
    parts = [observation[key] for key in ("achieved_goal", "desired_goal", "observation")]
    return np.concatenate(parts, axis=-1).astype(np.float32)


def test_its_spaces_have_the_sizes_of_the_kitchen():
    from skrl.envs.wrappers.torch import wrap_env
    from skrl.utils.spaces.torch import compute_space_size

    for goal_format in ("dict", "flat"):
        environment = wrap_env(gymnasium.make(KITCHEN, goal_format=goal_format, **EASY), verbose=False)
        assert environment.num_envs == 1
        assert compute_space_size(environment.observation_space) == SIZE
        assert compute_space_size(environment.action_space) == 9
        assert environment.reset()[0].shape == (1, SIZE)
        environment.close()


@pytest.mark.parametrize("count", [1, 2])
def test_tensors_are_what_gymnasium_gives(count):
    import torch
    from skrl.envs.wrappers.torch import wrap_env

    seed, steps = 11, 10
    plain = gymnasium.make(KITCHEN, goal_format="flat", **EASY) if count == 1 else vector(count, "sync")
    wrapped = wrap_env(gymnasium.make(KITCHEN, goal_format="flat", **EASY) if count == 1 else vector(count))
    wrapped._seed = seed
    expected, got = plain.reset(seed=seed)[0], wrapped.reset()[0]
    generator = torch.Generator().manual_seed(0)
    for i in range(steps):
        assert np.array_equal(got.numpy(), laid_out(expected).reshape(count, SIZE))
        actions = 2 * torch.rand((count, 9), generator=generator) - 1
        got, reward, terminated, truncated, _ = wrapped.step(actions)
        expected, *_ = plain.step(actions.numpy().reshape(plain.action_space.shape))
        assert reward.tolist() == [[float(i == 0)]] * count
        assert not terminated.any()
        assert not truncated.any()
    for environment in (plain, wrapped):
        environment.close()


def test_ppo_trains(tmp_path):
    import torch
    from skrl.agents.torch.ppo import PPO
    from skrl.envs.wrappers.torch import wrap_env
    from skrl.memories.torch import RandomMemory
    from skrl.trainers.torch import SequentialTrainer
    from skrl.utils import set_seed
    from skrl.utils.model_instantiators.torch import deterministic_model, gaussian_model

    set_seed(0)
    environment = wrap_env(vector(2))
    spaces = {"observation_space": environment.observation_space, "action_space": environment.action_space}
    parts = ", ".join(f"OBSERVATIONS['{key}']" for key in environment.observation_space)
    network = [{"name": "net", "input": f"concatenate([{parts}])", "layers": [32], "activations": "elu"}]
    models = {
        "policy": gaussian_model(**spaces, network=network, output="ACTIONS"),
        "value": deterministic_model(**spaces, network=network, output="ONE"),
    }
    experiment = {"directory": str(tmp_path), "write_interval": 0, "checkpoint_interval": 0}
    agent = PPO(
        models=models,
        memory=RandomMemory(memory_size=50, num_envs=2),
        cfg={"rollouts": 50, "learning_epochs": 2, "experiment": experiment},
        **spaces,
    )
    # Its networks take shape with the first input.
    models["policy"].act({"observations": torch.zeros(1, SIZE)})
    before = [parameter.detach().clone() for parameter in models["policy"].parameters()]
    trainer = {"timesteps": 100, "headless": True, "disable_progressbar": True, "close_environment_at_exit": False}
    SequentialTrainer(env=environment, agents=agent, cfg=trainer).train()
    environment.close()
    after = [*models["policy"].parameters()]
    assert not all((old == new).all() for old, new in zip(before, after, strict=True))
    assert all(parameter.isfinite().all() for parameter in after)


@pytest.mark.rendering
def test_a_vector_is_rendered():
    from skrl.envs.wrappers.torch import wrap_env

    environment = wrap_env(
        gymnasium.make_vec(KITCHEN, 2, num_threads=1, goal_format="flat", render_mode="rgb_array", width=32, height=24)
    )
    environment.reset()
    assert [image.shape for image in environment.render()] == [(24, 32, 3)] * 2
    environment.close()
