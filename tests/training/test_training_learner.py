"""The learner, its agent, and evaluations."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from training_reference import BATCH, METADATA, SMALL, environments, learner

from kitchen_suite.gymnasium_env import OPEN_CABINET_ID
from kitchen_suite.policies.trained import TrainedPolicy

pytestmark = pytest.mark.clients
DOMAINS = ["open_cabinet", "kitchen"]


@pytest.fixture(scope="module", params=DOMAINS)
def trained(request):
    """A learner that has learned from a batch."""
    envs = environments(SMALL["num_envs"], domain=request.param)
    scale = {"action_scale": [0.1] * envs.single_action_space.shape[0]}
    taught = learner(envs, domain=request.param, **scale)
    taught.start(0)
    taught.learn()
    yield taught
    envs.close()


def parameters(module):
    return [parameter.detach().clone() for parameter in module.parameters()]


def test_an_exported_policy_returns_the_agents_mean_actions(trained, tmp_path):
    import torch

    from kitchen_suite.training.agent import export_policy

    policy = export_policy(trained.agent, METADATA)
    policy.save(tmp_path / "policy.npz")
    # Wide enough that some are clipped after standardisation.
    observations = np.random.default_rng(0).normal(scale=3, size=(200, policy.observation_size)).astype(np.float32)
    with torch.no_grad():
        _, outputs = trained.agent.act(torch.as_tensor(observations), None, timestep=0, timesteps=0)
    expected = outputs["mean_actions"].numpy()
    assert np.abs(expected).max() > 1e-3
    np.testing.assert_allclose(policy(observations), expected, rtol=0, atol=1e-5)
    np.testing.assert_array_equal(TrainedPolicy.load(tmp_path / "policy.npz")(observations), policy(observations))


def test_initial_exploration_has_the_scales_of_the_actions():
    import torch

    envs = environments(SMALL["num_envs"])
    scale = [0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 2.0]
    fresh = learner(envs, action_scale=scale)
    envs.close()
    with torch.no_grad():
        _, outputs = fresh.agent.act(torch.zeros(2, 25), None, timestep=0, timesteps=0)
        policy = fresh.agent.models["policy"]
        np.testing.assert_allclose(policy.distribution(role="policy").stddev[0].numpy(), scale, rtol=1e-6)
        # The first actions are almost pure exploration.
        assert (outputs["mean_actions"][0].abs() < 0.05 * torch.tensor(scale)).all()


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_exploration_is_correlated_between_steps_with_constant_deviation(correlation):
    import torch

    envs = environments(SMALL["num_envs"])
    fresh = learner(envs, noise_correlation=correlation, exploration=0.5)
    envs.close()
    torch.manual_seed(0)
    policy, observations = fresh.agent.models["policy"], torch.zeros(1000, 25)
    with torch.no_grad():
        played = [policy.act({"observations": observations}) for _ in range(50)]
        noise = torch.stack([(actions - out["mean_actions"]) / policy.scale for actions, out in played]).numpy()
        _, again = policy.act({"observations": observations, "taken_actions": played[-1][0]})
    np.testing.assert_allclose(noise.std(axis=(1, 2)), 0.5, atol=0.03)
    for lag in (1, 5):
        products = noise[lag:] * noise[:-lag]
        np.testing.assert_allclose(products.mean() / 0.25, correlation**lag, atol=0.02)
    # Environments and joints are independent of each other.
    assert abs(np.corrcoef(noise[-1], rowvar=False) - np.eye(8)).max() < 0.15
    # The density of actions taken does not advance the noise, but another number of environments restarts it.
    last = policy._noise._last.clone()
    with torch.no_grad():
        policy.act({"observations": observations, "taken_actions": played[-1][0]})
    assert torch.equal(policy._noise._last, last)
    with torch.no_grad():
        other, out = policy.act({"observations": observations[:7]})
    assert other.shape == (7, 8)
    restarted = (other - out["mean_actions"]) / policy.scale
    assert abs(np.corrcoef(restarted.flatten(), last[:7].flatten())[0, 1]) < 0.5
    # The densities that an update starts from are those of the actions taken.
    np.testing.assert_allclose(played[-1][1]["log_prob"].numpy(), again["log_prob"].numpy(), rtol=1e-5)


def test_a_change_of_an_almost_constant_observation_is_not_clipped():
    import torch

    envs = environments(SMALL["num_envs"])
    scaler = learner(envs, standardisation_epsilon=0.05).agent.checkpoint_modules["observation_preprocessor"]
    envs.close()
    scaler(torch.zeros(100_000, 25), train=True)
    deviation = float(scaler.running_variance[0].sqrt()) + 0.05
    np.testing.assert_allclose(scaler(torch.full((1, 25), 0.4))[0].numpy(), 0.4 / deviation, rtol=1e-4)
    np.testing.assert_allclose(scaler(torch.full((1, 25), -4.0))[0].numpy(), -10)


def test_training_stays_on_the_cpu_where_there_is_a_gpu(monkeypatch):
    import torch

    # A module without a given device would now choose one that does not exist.
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    envs = environments(SMALL["num_envs"])
    taught = learner(envs)
    taught.start(0)
    taught.learn()
    envs.close()
    for module in taught.agent.checkpoint_modules.values():
        if isinstance(module, torch.nn.Module):
            assert {tensor.device.type for tensor in module.state_dict().values()} == {"cpu"}


def test_a_batch_changes_policy_and_values_and_counts_its_steps(trained):
    before, steps = [parameters(trained.agent.models[name]) for name in ("policy", "value")], trained.steps
    means = trained.learn()
    assert trained.steps == steps + BATCH
    for name, old in zip(("policy", "value"), before, strict=True):
        new = parameters(trained.agent.models[name])
        assert any((one != other).any() for one, other in zip(old, new, strict=True))
        assert all(part.isfinite().all() for part in new)
    assert all(np.isfinite(value) for value in means.values())
    assert {"step/reward", "loss/policy loss", "loss/value loss", "policy/standard deviation"} <= means.keys()


def test_the_terms_sum_up_to_the_reward_even_where_episodes_end():
    from kitchen_suite.tasks.open_cabinet import reward as drawer_reward

    envs = environments(SMALL["num_envs"])
    # Actions wild enough that joints move too fast, which terminates episodes.
    taught = learner(envs, action_scale=[0.5] * 7 + [2.0])
    taught.start(0)
    means = taught.learn()
    envs.close()
    terms = {name: means[f"step/reward/{name}"] for name in drawer_reward.TERMS}
    assert terms["termination"] < 0
    assert means["step/reward"] == pytest.approx(sum(terms.values()), abs=1e-6)


def test_episodes_start_at_evenly_spread_times():
    envs = environments(20)
    taught = learner(envs, num_envs=20)
    taught.start(0)
    # Twenty episodes of 700 steps: one starts every 35 steps.
    assert sorted(envs._get_info()["episode_step"] % 35) == [34] * 20
    assert len(set(envs._get_info()["episode_step"])) == 20
    envs.close()


def test_a_seed_determines_the_learned_policy():
    import torch

    policies = []
    for seed in (3, 3, 4):
        envs = environments(SMALL["num_envs"])
        taught = learner(envs, seed=seed)
        taught.start(seed)
        taught.learn()
        envs.close()
        policies.append(torch.cat([part.flatten() for part in parameters(taught.agent.models["policy"])]))
    assert (policies[0] == policies[1]).all()
    assert (policies[0] != policies[2]).any()


def test_the_penalties_grow_with_the_steps_learned_from():
    envs = environments(SMALL["num_envs"])
    taught = learner(envs)
    taught.steps = 8000 * SMALL["num_envs"]
    taught.start(0)
    assert (envs.total_steps == 8000 + 700).all()
    envs.close()


def random_policy(scale=0.02):
    generator = np.random.default_rng(0)
    return TrainedPolicy(
        mean=np.zeros(25, np.float32),
        deviation=np.ones(25, np.float32),
        clip=5.0,
        weights=(generator.normal(size=(8, 25)).astype(np.float32),),
        biases=(np.zeros(8, np.float32),),
        action_scale=np.full(8, scale, np.float32),
        metadata=METADATA,
    )


def test_an_evaluation_does_not_depend_on_earlier_ones():
    from kitchen_suite.training.evaluation import evaluate

    evaluated = environments(3, AutoresetMode.DISABLED)
    first = evaluate(random_policy(), evaluated, [7, 8, 9])
    # As after many evaluations: the penalties of an environment grow with its steps.
    evaluated.total_steps = np.full(3, 8000)
    again = evaluate(random_policy(), evaluated, [7, 8, 9])
    evaluated.close()
    assert set(first) == {f"episode/{name}" for name in ("success", "progress", "length", "return")}
    for name, values in first.items():
        assert values.shape == (3,)
        np.testing.assert_array_equal(values, again[name], name)
    assert len(set(first["episode/return"])) == 3


def test_an_evaluation_counts_each_episode_to_its_end_and_no_further():
    from kitchen_suite.training.evaluation import evaluate

    # Wild enough that joints move too fast, which terminates episodes at different times.
    policy, seeds = random_policy(scale=0.1), [5, 6, 7, 8]
    evaluated, single = environments(len(seeds), AutoresetMode.DISABLED), gymnasium.make(OPEN_CABINET_ID)
    metrics = evaluate(policy, evaluated, seeds)
    evaluated.close()
    assert len(set(metrics["episode/length"])) > 1
    assert metrics["episode/length"].max() < 700
    for i, seed in enumerate(seeds):
        observation, _ = single.reset(seed=seed)
        total, terminated = 0.0, False
        while not terminated:
            observation, reward, terminated, *_, info = single.step(policy(observation))
            total += reward
        assert metrics["episode/length"][i] == info["episode_step"]
        # Float32 sums in another order, whose difference grows in the physics.
        assert metrics["episode/return"][i] == pytest.approx(total, rel=1e-3)
        assert metrics["episode/progress"][i] == pytest.approx(float(info["drawer_opening"]), abs=1e-4)


def test_an_episode_whose_physics_diverges_counts_as_a_failure(monkeypatch):
    from kitchen_suite.training.evaluation import evaluate

    evaluated = environments(2, AutoresetMode.DISABLED)
    step = type(evaluated).step

    def diverge(self, actions):
        observations, rewards, terminations, truncations, infos = step(self, actions)
        diverged = np.full(2, True)
        return observations, rewards, terminations | diverged, truncations, infos | {"physics_error": diverged}

    monkeypatch.setattr(type(evaluated), "step", diverge)
    metrics = evaluate(random_policy(), evaluated, [1, 2])
    evaluated.close()
    assert set(metrics) == {f"episode/{name}" for name in ("success", "progress", "length", "return")}
    for values in metrics.values():
        np.testing.assert_array_equal(values, [0, 0])


def test_the_value_network_has_its_own_learning_rate(monkeypatch):
    from kitchen_suite.training.agent import value_group

    envs = environments(SMALL["num_envs"])
    taught = learner(envs, learning_rate=1e-4, value_learning_rate=7e-3)
    rates, update = [], taught.agent.update

    def recorded(**times):
        rates.append([group["lr"] for group in taught.agent.optimizer.param_groups])
        update(**times)

    monkeypatch.setattr(taught.agent, "update", recorded)
    taught.start(0)
    for _ in range(3):
        taught.learn()
    envs.close()
    assert [values for _, values in rates] == [7e-3] * 3
    # The policy's is adapted to the divergence, so it has changed by then.
    assert rates[0][0] == 1e-4 != rates[-1][0]
    own = {id(parameter) for parameter in taught.agent.models["value"].parameters()}
    assert {id(parameter) for parameter in value_group(taught.agent)["params"]} == own
