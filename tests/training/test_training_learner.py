"""The learner, its agent, and evaluations."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from helpers.training import BATCH, METADATA, SMALL, environments, learner

from kitchen_suite.gymnasium_env import OPEN_CABINET_ID
from kitchen_suite.policies.perceptron import PerceptronPolicy

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

    from kitchen_suite.training.ppo import export_policy

    policy = export_policy(trained.agent, METADATA)
    policy.save(tmp_path / "policy.npz")
    # Wide enough that some are clipped after standardisation.
    observations = np.random.default_rng(0).normal(scale=3, size=(200, policy.observation_size)).astype(np.float32)
    agent = trained.agent
    with torch.no_grad():
        outputs = agent.policy.network(agent.observation_scaler(torch.as_tensor(observations)))
        expected = (outputs * agent.policy.scale).numpy()
    assert np.abs(expected).max() > 1e-3
    np.testing.assert_allclose(policy(observations), expected, rtol=0, atol=1e-5)
    np.testing.assert_array_equal(PerceptronPolicy.load(tmp_path / "policy.npz")(observations), policy(observations))


def test_initial_exploration_has_the_scales_of_the_actions():
    import torch

    from kitchen_suite.training.ppo import Actor

    envs = environments(SMALL["num_envs"])
    scale = [0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 2.0]
    fresh = learner(envs, action_scale=scale)
    envs.close()
    policy = fresh.agent.policy
    actions = Actor(fresh.agent, 0.9, 0).explore(torch.zeros(4000, 25))
    np.testing.assert_allclose((actions * policy.scale).std(dim=0).numpy(), scale, rtol=0.1)
    # The first actions are almost pure exploration.
    with torch.no_grad():
        assert (policy.network(fresh.agent.observation_scaler(torch.zeros(2, 25))).abs() < 0.05).all()


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_exploration_is_correlated_between_steps_with_constant_deviation(correlation):
    import torch

    from kitchen_suite.training.ppo import Actor

    envs = environments(SMALL["num_envs"])
    agent = learner(envs, noise_correlation=correlation, exploration=0.5).agent
    envs.close()
    actor, observations = Actor(agent, correlation, 0), torch.zeros(1000, 25)
    with torch.no_grad():
        means = agent.policy.network(observations)
    played = [actor.explore(observations) for _ in range(50)]
    noise = torch.stack([actions - means for actions in played]).numpy()
    np.testing.assert_allclose(noise.std(axis=(1, 2)), 0.5, atol=0.03)
    for lag in (1, 5):
        products = noise[lag:] * noise[:-lag]
        np.testing.assert_allclose(products.mean() / 0.25, correlation**lag, atol=0.02)
    # Environments and joints are independent of each other.
    assert abs(np.corrcoef(noise[-1], rowvar=False) - np.eye(8)).max() < 0.15
    # Another number of environments restarts the noise.
    restarted = actor.explore(observations[:7]) - means[:7]
    assert restarted.shape == (7, 8)
    assert abs(np.corrcoef(restarted.flatten(), noise[-1, :7].flatten())[0, 1]) < 0.5
    # The densities are those of normal distributions.
    with torch.no_grad():
        densities = agent.policy.log_densities(observations, played[-1])
    normal = torch.distributions.Normal(means, 0.5).log_prob(played[-1]).sum(dim=-1)
    np.testing.assert_allclose(densities.numpy(), normal.numpy() + 4 * np.log(2 * np.pi), rtol=1e-4, atol=1e-4)


def test_an_actor_keeps_the_policy_that_it_has_copied():
    import torch

    from kitchen_suite.training.ppo import Actor

    envs = environments(SMALL["num_envs"])
    agent = learner(envs).agent
    envs.close()
    observations = torch.ones(3, 25)
    early, late = Actor(agent, 0.0, 0), Actor(agent, 0.0, 0)
    with torch.no_grad():
        agent.policy.network[-1].bias += 5.0
    late.refresh()
    np.testing.assert_allclose(late.explore(observations) - early.explore(observations), 5.0, atol=1e-5)


def test_a_change_of_an_almost_constant_observation_is_not_clipped():
    import torch

    envs = environments(SMALL["num_envs"])
    scaler = learner(envs, standardisation_epsilon=0.05).agent.observation_scaler
    envs.close()
    scaler.update(torch.zeros(100_000, 25))
    deviation = float(scaler.running_variance[0].sqrt()) + 0.05
    np.testing.assert_allclose(scaler(torch.full((1, 25), 0.4))[0].numpy(), 0.4 / deviation, rtol=1e-4)
    np.testing.assert_allclose(scaler(torch.full((1, 25), -4.0))[0].numpy(), -10)


def test_a_batch_changes_policy_and_values_and_counts_its_steps(trained):
    before, steps = [parameters(trained.agent.networks[name]) for name in ("policy", "value")], trained.steps
    means = trained.learn()
    assert trained.steps == steps + BATCH
    for name, old in zip(("policy", "value"), before, strict=True):
        new = parameters(trained.agent.networks[name])
        assert any((one != other).any() for one, other in zip(old, new, strict=True))
        assert all(part.isfinite().all() for part in new)
    assert all(np.isfinite(value) for value in means.values())
    assert {"step/reward", "loss/policy loss", "loss/value loss", "policy/standard deviation"} <= means.keys()


def test_the_terms_sum_up_to_the_reward_even_where_episodes_end():
    from kitchen_suite.tasks.open_cabinet import rewards as drawer_reward

    envs = environments(SMALL["num_envs"])
    # Actions wild enough that joints move too fast, which terminates episodes.
    taught = learner(envs, action_scale=[0.5] * 7 + [2.0])
    taught.start(0)
    means = taught.learn()
    envs.close()
    terms = {name: means[f"step/reward/{name}"] for name in drawer_reward.REWARDS["original"]}
    assert terms["termination"] < 0
    assert means["step/reward"] == pytest.approx(sum(terms.values()), abs=1e-6)


def test_episodes_start_at_evenly_spread_times():
    envs = environments(20)
    taught = learner(envs, num_envs=20)
    taught.start(0)
    # Twenty episodes of 700 steps: one starts every 35 steps, the first of them now.
    *_, infos = envs.step(np.zeros(envs.action_space.shape))
    assert sorted(infos["episode_step"]) == [*range(0, 700, 35)]
    envs.close()


def test_a_seed_determines_the_learned_policy():
    import torch

    policies = []
    for seed in (3, 3, 4):
        envs = environments(SMALL["num_envs"])
        taught = learner(envs, seed=seed)
        taught.start(seed)
        # Later batches are collected while the networks change.
        for _ in range(3):
            taught.learn()
        envs.close()
        policies.append(torch.cat([part.flatten() for part in parameters(taught.agent.policy)]))
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
    return PerceptronPolicy(
        mean=np.zeros(25, np.float32),
        deviation=np.ones(25, np.float32),
        clip=5.0,
        weights=(generator.normal(size=(8, 25)).astype(np.float32),),
        biases=(np.zeros(8, np.float32),),
        action_scale=np.full(8, scale, np.float32),
        metadata=METADATA,
    )


def test_an_evaluation_does_not_depend_on_earlier_ones():
    from kitchen_suite.training.ppo import NetworkController
    from kitchen_suite.training.run import evaluate

    evaluated = environments(3, AutoresetMode.DISABLED)
    first = evaluate(NetworkController(random_policy(), evaluated), evaluated, [7, 8, 9])
    # As after many evaluations: the penalties of an environment grow with its steps.
    evaluated.total_steps = np.full(3, 8000)
    again = evaluate(NetworkController(random_policy(), evaluated), evaluated, [7, 8, 9])
    evaluated.close()
    assert set(first) == {f"episode/{name}" for name in ("success", "progress", "length", "return")}
    for name, values in first.items():
        assert values.shape == (3,)
        np.testing.assert_array_equal(values, again[name], name)
    assert len(set(first["episode/return"])) == 3


def test_an_evaluation_counts_each_episode_to_its_end_and_no_further():
    from kitchen_suite.training.ppo import NetworkController
    from kitchen_suite.training.run import evaluate

    # Wild enough that joints move too fast, which terminates episodes at different times.
    policy, seeds = random_policy(scale=0.1), [5, 6, 7, 8]
    evaluated, single = environments(len(seeds), AutoresetMode.DISABLED), gymnasium.make(OPEN_CABINET_ID)
    metrics = evaluate(NetworkController(policy, evaluated), evaluated, seeds)
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
    from kitchen_suite.training.ppo import NetworkController
    from kitchen_suite.training.run import evaluate

    evaluated = environments(2, AutoresetMode.DISABLED)
    step = type(evaluated).step_some

    def diverge(self, actions, mask):
        observations, rewards, terminations, truncations, infos = step(self, actions, mask)
        diverged = np.full(2, True)
        return observations, rewards, terminations | diverged, truncations, infos | {"physics_error": diverged}

    monkeypatch.setattr(type(evaluated), "step_some", diverge)
    metrics = evaluate(NetworkController(random_policy(), evaluated), evaluated, [1, 2])
    evaluated.close()
    assert set(metrics) == {f"episode/{name}" for name in ("success", "progress", "length", "return")}
    for values in metrics.values():
        np.testing.assert_array_equal(values, [0, 0])


def test_the_value_network_has_its_own_learning_rate():
    envs = environments(SMALL["num_envs"])
    taught, rates = learner(envs, learning_rate=1e-4, value_learning_rate=7e-3), []
    taught.agent.optimizer.register_step_pre_hook(
        lambda optimizer, *_: rates.append([group["lr"] for group in optimizer.param_groups])
    )
    taught.start(0)
    for _ in range(3):
        taught.learn()
    envs.close()
    first_steps = rates[:: SMALL["learning_epochs"] * SMALL["mini_batches"]]
    assert len(first_steps) == 3
    assert [values for _, values in first_steps] == [7e-3] * 3
    # The policy's is adapted to the divergence, so it has changed by then.
    assert first_steps[0][0] == 1e-4 != first_steps[-1][0]
    policy, value = ({id(part) for part in network.parameters()} for network in taught.agent.networks.values())
    assert [{id(part) for part in group["params"]} for group in taught.agent.optimizer.param_groups] == [policy, value]


def reference_advantages(rewards, values, terminated, ended, last_values, discount, gae_lambda):
    """Returns the advantages of one environment, each the sum of discounted errors up to the end of its episode."""
    count, result = len(rewards), np.zeros(len(rewards))
    following = [*values[1:], None]
    for start in range(count):
        factor = 1.0
        for step in range(start, count):
            if terminated[step]:
                after = 0.0
            else:
                after = last_values[step] if ended[step] or step == count - 1 else following[step]
            result[start] += factor * (rewards[step] + discount * after - values[step])
            factor *= discount * gae_lambda
            if ended[step]:
                break
    return result


def test_advantages_are_the_sums_of_discounted_errors_up_to_the_ends_of_episodes():
    import torch

    from kitchen_suite.training.ppo import advantages

    generator, count = np.random.default_rng(0), 12
    rewards, values, last_values = generator.normal(size=(3, count, 2))
    ended = generator.random((count, 2)) < 0.5
    terminated = ended & (generator.random((count, 2)) < 0.5)
    assert (ended & ~terminated).any()
    assert terminated.any()
    # As the agent has it: the value after a truncation is added to the reward, that after the batch is the last one.
    bootstrapped = rewards + 0.9 * last_values * (ended & ~terminated)
    found = advantages(
        torch.tensor(bootstrapped),
        torch.tensor(np.concatenate([values, last_values[-1:]])),
        torch.tensor(ended),
        discount=0.9,
        gae_lambda=0.8,
    )
    for i in range(2):
        expected = reference_advantages(
            *(array[:, i] for array in (rewards, values, terminated, ended, last_values)), 0.9, 0.8
        )
        np.testing.assert_allclose(found[:, i].numpy(), expected, atol=1e-6)


def test_a_truncated_episode_is_worth_the_value_of_its_last_observation():
    import torch

    envs = environments(SMALL["num_envs"], max_episode_steps=5)
    taught = learner(envs, reward_scale=0.5)
    taught.start(0)
    seen, step = [], envs.step

    def recorded(actions):
        result = step(actions)
        seen.append((result[1], result[4]))
        return result

    envs.step = recorded
    update, learned = taught.agent.update, []
    taught.agent.update = lambda batch, **options: learned.append(batch) or update(batch, **options)
    taught.learn()
    del envs.step
    envs.close()
    # The first of the two batches that have been collected.
    (batch,), seen = learned, seen[: BATCH // SMALL["num_envs"]]
    samples = taught.agent.samples(batch)
    truncations = [(t, i) for t, (_, infos) in enumerate(seen) for i in np.flatnonzero(infos.get("_final_obs", []))]
    assert len(truncations) == BATCH // 5 or len(truncations) > 8
    assert [tuple(place) for place in batch.truncated.nonzero().tolist()] == truncations
    for (t, i), observation in zip(truncations, batch.last_observations[batch.truncated], strict=True):
        np.testing.assert_array_equal(observation, seen[t][1]["final_obs"][i].astype(np.float32))
    np.testing.assert_allclose(batch.rewards, 0.5 * np.array([rewards for rewards, _ in seen]), rtol=1e-6)
    assert len(samples.actions) == BATCH
    assert torch.isfinite(samples.returns).all()


def test_a_learner_finds_the_action_that_is_rewarded():
    import torch

    from kitchen_suite.training.ppo import Actor, Agent, Batch, PPOHyperparameters

    torch.manual_seed(0)
    config = PPOHyperparameters(
        num_envs=64, rollouts=8, mini_batches=4, hidden=(16,), action_scale=(2.0,), noise_correlation=0.0, kl_target=0.0
    )
    agent = Agent(1, gymnasium.spaces.Box(-5, 5, (1,)), config)
    actor, batch = Actor(agent, 0.0, 0), Batch(8, 64, 1, 1)
    for _ in range(60):
        batch.observations.uniform_(-1, 1)
        batch.next_observations.uniform_(-1, 1)
        for step in range(8):
            batch.actions[step] = actor.explore(batch.observations[step])
        batch.rewards.copy_(-(batch.actions - batch.observations).square().squeeze(-1))
        batch.ended.fill_(True)
        agent.update(batch)
        actor.refresh()
    observations = torch.linspace(-1, 1, 21)[:, None]
    with torch.no_grad():
        errors = agent.policy.network(agent.observation_scaler(observations)) - observations
    assert errors.abs().mean() < 0.15


@pytest.mark.parametrize("averaging", [0.0, 0.75])
def test_the_exported_policy_has_averaged_weights(averaging):
    envs = environments(SMALL["num_envs"])
    taught, expected = learner(envs, averaging=averaging), None
    taught.start(0)
    for _ in range(3):
        taught.learn()
        present = taught.agent.policy.network[0].weight.detach().numpy().copy()
        # The average begins with the first update.
        expected = present if expected is None else averaging * expected + (1 - averaging) * present
    envs.close()
    np.testing.assert_allclose(taught.export(METADATA).weights[0], expected, rtol=1e-5, atol=1e-7)
    assert (np.abs(expected - present).max() > 1e-6) == (averaging > 0)
