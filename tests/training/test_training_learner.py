"""The learner, its agent, and evaluations."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from training_reference import BATCH, METADATA, SMALL, environments, learner

from kitchen_suite.gymnasium_env import CABINET_ID
from kitchen_suite.policies.trained import TrainedPolicy

pytestmark = pytest.mark.clients
DOMAINS = ["open_cabinet", "kitchen"]


@pytest.fixture(scope="module", params=DOMAINS)
def taught(request):
    """A learner that has learned from a batch, and its domain."""
    envs = environments(SMALL["num_envs"], domain=request.param)
    scale = {"action_scale": [0.1] * envs.single_action_space.shape[0]}
    known = learner(envs, domain=request.param, **scale)
    known.start(0)
    known.learn()
    yield known, request.param
    envs.close()


def parameters(module):
    return [parameter.detach().clone() for parameter in module.parameters()]


def test_an_exported_policy_does_what_the_agent_does_in_the_mean(taught, tmp_path):
    import torch

    from kitchen_suite.training import agent as agents

    known, _ = taught
    policy = agents.export(known.agent, METADATA)
    policy.save(tmp_path / "policy.npz")
    # Wide enough that some are clipped: the agent standardises by what it has seen.
    observations = np.random.default_rng(0).normal(scale=3, size=(200, policy.observation_size)).astype(np.float32)
    with torch.no_grad():
        _, outputs = known.agent.act(torch.as_tensor(observations), None, timestep=0, timesteps=0)
    expected = outputs["mean_actions"].numpy()
    assert np.abs(expected).max() > 1e-3
    np.testing.assert_allclose(policy(observations), expected, rtol=0, atol=1e-5)
    np.testing.assert_array_equal(TrainedPolicy.load(tmp_path / "policy.npz")(observations), policy(observations))


def test_exploration_begins_with_the_scales_of_the_actions():
    import torch

    envs = environments(SMALL["num_envs"])
    scale = [0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 2.0]
    fresh = learner(envs, action_scale=scale)
    envs.close()
    with torch.no_grad():
        _, outputs = fresh.agent.act(torch.zeros(2, 25), None, timestep=0, timesteps=0)
        policy = fresh.agent.models["policy"]
        np.testing.assert_allclose(policy.distribution(role="policy").stddev[0].numpy(), scale, rtol=1e-6)
        # The first actions are exploration alone.
        assert (outputs["mean_actions"][0].abs() < 0.05 * torch.tensor(scale)).all()


@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_exploration_is_correlated_between_steps_and_as_large_as_ever(correlation):
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
    # Being asked for the density of what was played is no step, but other environments begin anew.
    last = policy._noise._last.clone()
    with torch.no_grad():
        policy.act({"observations": observations, "taken_actions": played[-1][0]})
    assert torch.equal(policy._noise._last, last)
    with torch.no_grad():
        other, out = policy.act({"observations": observations[:7]})
    assert other.shape == (7, 8)
    begun = (other - out["mean_actions"]) / policy.scale
    assert abs(np.corrcoef(begun.flatten(), last[:7].flatten())[0, 1]) < 0.5
    # What an update compares densities with is the density of what was played.
    np.testing.assert_allclose(played[-1][1]["log_prob"].numpy(), again["log_prob"].numpy(), rtol=1e-5)


def test_what_has_hardly_moved_is_seen_when_it_does():
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

    # What is left to choose a device by itself now takes one that is not there.
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    envs = environments(SMALL["num_envs"])
    known = learner(envs)
    known.start(0)
    known.learn()
    envs.close()
    for module in known.agent.checkpoint_modules.values():
        if isinstance(module, torch.nn.Module):
            assert {tensor.device.type for tensor in module.state_dict().values()} == {"cpu"}


def test_a_batch_changes_policy_and_values_and_counts_its_steps(taught):
    known, _ = taught
    before, steps = [parameters(known.agent.models[name]) for name in ("policy", "value")], known.steps
    means = known.learn()
    assert known.steps == steps + BATCH
    for name, old in zip(("policy", "value"), before, strict=True):
        new = parameters(known.agent.models[name])
        assert any((one != other).any() for one, other in zip(old, new, strict=True))
        assert all(part.isfinite().all() for part in new)
    assert all(np.isfinite(value) for value in means.values())
    assert {"step/reward", "loss/policy loss", "loss/value loss", "policy/standard deviation"} <= means.keys()


def test_the_terms_sum_up_to_the_reward_also_where_episodes_end():
    from kitchen_suite.tasks.open_cabinet import reward as drawer_reward

    envs = environments(SMALL["num_envs"])
    # Actions wild enough that joints move too fast, which terminates episodes.
    known = learner(envs, action_scale=[0.5] * 7 + [2.0])
    known.start(0)
    means = known.learn()
    envs.close()
    terms = {name: means[f"step/reward/{name}"] for name in drawer_reward.TERMS}
    assert terms["termination"] < 0
    assert means["step/reward"] == pytest.approx(sum(terms.values()), abs=1e-6)


def test_episodes_start_spread_over_their_length():
    envs = environments(20)
    known = learner(envs, num_envs=20)
    known.start(0)
    # Twenty episodes of 700 steps: one every 35.
    assert sorted(envs._get_info()["episode_step"] % 35) == [34] * 20
    assert len(set(envs._get_info()["episode_step"])) == 20
    envs.close()


def test_a_seed_fixes_what_is_learned():
    import torch

    learned = []
    for seed in (3, 3, 4):
        envs = environments(SMALL["num_envs"])
        known = learner(envs, seed=seed)
        known.start(seed)
        known.learn()
        envs.close()
        learned.append(torch.cat([part.flatten() for part in parameters(known.agent.models["policy"])]))
    assert (learned[0] == learned[1]).all()
    assert (learned[0] != learned[2]).any()


def test_the_penalties_age_with_the_steps_learned_from():
    envs = environments(SMALL["num_envs"])
    known = learner(envs)
    known.steps = 8000 * SMALL["num_envs"]
    known.start(0)
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


def test_an_evaluation_is_the_same_whatever_was_evaluated_before():
    from kitchen_suite.training.evaluation import evaluate

    evaluated = environments(3, AutoresetMode.NEXT_STEP)
    once = evaluate(random_policy(), evaluated, [7, 8, 9])
    # As after many evaluations: the penalties of an environment grow with its life.
    evaluated.total_steps = np.full(3, 8000)
    again = evaluate(random_policy(), evaluated, [7, 8, 9])
    evaluated.close()
    assert set(once) == {f"episode/{name}" for name in ("success", "progress", "length", "return")}
    for name, values in once.items():
        assert values.shape == (3,)
        np.testing.assert_array_equal(values, again[name], name)
    assert len(set(once["episode/return"])) == 3


def test_an_evaluation_counts_each_episode_to_its_end_and_no_further():
    from kitchen_suite.training.evaluation import evaluate

    # Wild enough that joints move too fast, which terminates episodes at different times.
    policy, seeds = random_policy(scale=0.1), [5, 6, 7, 8]
    evaluated, single = environments(len(seeds), AutoresetMode.NEXT_STEP), gymnasium.make(CABINET_ID)
    measures = evaluate(policy, evaluated, seeds)
    evaluated.close()
    assert len(set(measures["episode/length"])) > 1
    assert measures["episode/length"].max() < 700
    for i, seed in enumerate(seeds):
        observation, _ = single.reset(seed=seed)
        total, terminated = 0.0, False
        while not terminated:
            observation, reward, terminated, *_, info = single.step(policy(observation))
            total += reward
        assert measures["episode/length"][i] == info["episode_step"]
        # Of sums of float32 in another order, which the physics carries on.
        assert measures["episode/return"][i] == pytest.approx(total, rel=1e-3)
        assert measures["episode/progress"][i] == pytest.approx(float(info["drawer_opening"]), abs=1e-4)


def test_values_learn_at_a_rate_of_their_own(monkeypatch):
    from kitchen_suite.training import agent as agents

    envs = environments(SMALL["num_envs"])
    known = learner(envs, learning_rate=1e-4, value_learning_rate=7e-3)
    rates, update = [], known.agent.update

    def watched(**times):
        rates.append([group["lr"] for group in known.agent.optimizer.param_groups])
        update(**times)

    monkeypatch.setattr(known.agent, "update", watched)
    known.start(0)
    for _ in range(3):
        known.learn()
    envs.close()
    assert [values for _, values in rates] == [7e-3] * 3
    # The policy's follows the divergence, so it has moved by then.
    assert rates[0][0] == 1e-4 != rates[-1][0]
    own = {id(parameter) for parameter in known.agent.models["value"].parameters()}
    assert {id(parameter) for parameter in agents.value_group(known.agent)["params"]} == own
