"""Stable-Baselines3 learns in the kitchen as it is: PPO, and SAC with hindsight relabelling."""

import csv

import gymnasium
import numpy as np
import pytest
from helpers.errors import refused
from helpers.sweeps import OBSERVED, brief, once_per_observation_type

from kitchen_suite.suite import DOMAINS

pytestmark = [pytest.mark.clients, pytest.mark.usefixtures("one_thread")]

KITCHEN = "kitchen_suite.gymnasium_env:KitchenSuite/FrankaKitchen-v1"
STEPS, EPISODE = 2000, 280
THRESHOLD = 0.01
# The microwave's goal lies within its threshold from the start: it pays in the first step and never again. The kettle
# stays off its goal, but moves by more than its threshold where a random policy hits it.
EASY = {"tasks_to_complete": ["microwave", "kettle"], "goals": {"microwave": [0.0]}, "threshold": THRESHOLD}
# Arguments with which the actions of a domain are bounded.
BOUNDED = {"open_cabinet": {"action_limit": 1.0}}
GOALS = {"microwave": slice(0, 1), "kettle": slice(1, 8)}


def make(**options):
    return gymnasium.make(KITCHEN, goal_format="flat", **{**EASY, **options})


# Actions must be bounded.
@pytest.mark.rendering
@pytest.mark.parametrize(("domain", "obs_type"), brief(OBSERVED, once_per_observation_type()))
def test_its_checker_takes_every_observation_type(domain, obs_type):
    from stable_baselines3.common.env_checker import check_env

    pictures = {"image_size": (36, 36), "render_quality": "fast"} if "pixels" in obs_type else {}
    goals = {"goal_format": "flat"} if obs_type == "goal" else {}
    environment = gymnasium.make(
        DOMAINS[domain].env_id, obs_type=obs_type, **BOUNDED.get(domain, {}), **pictures, **goals
    )
    check_env(environment.unwrapped)
    environment.close()


@pytest.mark.parametrize("info_format", ["lists", "arrays"])
def test_its_checker_has_nothing_to_say(info_format, recwarn):
    from stable_baselines3.common.env_checker import check_env

    # Unwrapped: it looks for `compute_reward` on what it is given, and Gymnasium's wrappers pass no attributes on.
    environment = make(info_format=info_format).unwrapped
    check_env(environment)
    assert [str(warning.message) for warning in recwarn if "stable_baselines3" in warning.filename] == []
    environment.close()


def test_ppo_learns_for_1000_steps_and_comes_back_from_disk(tmp_path):
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env

    environments = make_vec_env(KITCHEN, n_envs=2, seed=0, env_kwargs={"goal_format": "flat", **EASY})
    model = PPO("MultiInputPolicy", environments, n_steps=500, batch_size=250, n_epochs=2, seed=0, device="cpu")
    before = weights(model)
    model.learn(1000)
    assert model.num_timesteps == 1000
    assert not all(np.array_equal(old, new) for old, new in zip(before, weights(model), strict=True))
    assert_episodes_seen(model, 2)
    assert_predicts_the_same_after_saving(model, PPO, environments, tmp_path)
    environments.close()


@pytest.mark.rendering
@pytest.mark.parametrize("bridge", [False, True], ids=["its own vector", "ours"])
def test_ppo_learns_from_pictures_for_500_steps(bridge):
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env

    from kitchen_suite.adapters.stable_baselines3 import make_vec_env as make_ours

    settings = {"obs_type": "pixels_agent_pos", "image_size": (40, 48), "render_quality": "fast"}
    if bridge:
        environments = make_ours(KITCHEN, 2, seed=0, **settings)
    else:
        environments = make_vec_env(KITCHEN, n_envs=2, seed=0, env_kwargs=settings)
    model = PPO("MultiInputPolicy", environments, n_steps=250, batch_size=250, n_epochs=1, seed=0, device="cpu")
    extractors = model.policy.features_extractor.extractors
    assert {name: type(each).__name__ for name, each in extractors.items()} == {
        "pixels": "NatureCNN",
        "agent_pos": "Flatten",
    }
    before = weights(model)
    model.learn(500)
    assert model.num_timesteps == 500
    assert not all(np.array_equal(old, new) for old, new in zip(before, weights(model), strict=True))
    environments.close()


@pytest.mark.parametrize(
    ("copy_info_dict", "info_format"),
    [(False, "lists"), (True, "lists"), (True, "arrays")],
    ids=["empty infos", "infos of lists", "infos of arrays"],
)
def test_hindsight_rewards_are_those_of_the_goals_put_in(copy_info_dict, info_format, tmp_path):
    from stable_baselines3 import SAC, HerReplayBuffer

    environment = make(info_format=info_format)
    model = SAC(
        "MultiInputPolicy",
        environment,
        replay_buffer_class=HerReplayBuffer,
        replay_buffer_kwargs={"copy_info_dict": copy_info_dict, "n_sampled_goal": 4},
        buffer_size=STEPS,
        # Nothing can be drawn before the first episode has ended.
        learning_starts=EPISODE + 20,
        train_freq=50,
        gradient_steps=5,
        seed=0,
        device="cpu",
    )
    model.learn(STEPS)
    assert model.num_timesteps == STEPS
    assert model.replay_buffer.full
    assert_episodes_seen(model, STEPS // EPISODE)
    assert_relabelled_as_it_should_be(model.replay_buffer, copy_info_dict=copy_info_dict)
    assert_predicts_the_same_after_saving(model, SAC, environment, tmp_path)
    environment.close()


def test_nested_goals_are_what_it_refuses():
    from stable_baselines3 import PPO

    environment = gymnasium.make(KITCHEN, goal_format="dict")
    with pytest.raises(NotImplementedError, match="Nested observation spaces"):
        PPO("MultiInputPolicy", environment)
    environment.close()


def assert_episodes_seen(model, count):
    """Its monitor has seen whole episodes, each paid once, none of them a success."""
    assert [(episode["l"], episode["r"]) for episode in model.ep_info_buffer] == [(EPISODE, 1.0)] * count
    assert [*model.ep_success_buffer] == [False] * count


def assert_predicts_the_same_after_saving(model, algorithm, environment, folder):
    model.save(folder / "model")
    loaded = algorithm.load(folder / "model", env=environment, device="cpu")
    observations = [environment.observation_space.sample() for _ in range(5)]
    for observation in observations:
        action, _ = model.predict(observation, deterministic=True)
        assert environment.action_space.contains(action)
        assert np.array_equal(action, loaded.predict(observation, deterministic=True)[0])


def assert_relabelled_as_it_should_be(buffer, *, copy_info_dict):
    """Every reward drawn is recomputed by hand, from the goals drawn and the step's stored info."""
    # The noise makes every observation another one, so that it tells which stored step was drawn.
    places = {row.tobytes(): i for i, row in enumerate(buffer.observations["observation"][:, 0])}
    assert len(places) == STEPS
    drawn = buffer.sample(1000)
    real = 1000 - int(buffer.her_ratio * 1000)
    rewards = drawn.rewards.numpy().ravel()
    achieved, desired = (drawn.next_observations[key].numpy() for key in ("achieved_goal", "desired_goal"))
    steps = [places[row.tobytes()] for row in drawn.observations["observation"].numpy()]
    assert np.array_equal(rewards[:real], buffer.rewards[steps[:real], 0])
    for i in range(real, 1000):
        within = {
            task for task, part in GOALS.items() if np.linalg.norm(achieved[i, part] - desired[i, part]) < THRESHOLD
        }
        may_pay = still_open(buffer.infos[steps[i], 0]) if copy_info_dict else set(GOALS)
        assert rewards[i] == len(within & may_pay)
    # The microwave may pay once an episode by its info, but always where there is none; the kettle pays in most steps.
    assert {*rewards[real:]} >= ({0.0, 1.0} if copy_info_dict else {1.0, 2.0})
    assert drawn.dones.sum() == 0


def still_open(info):
    """The tasks that could pay in a step, by its info: names, or masks in configured order."""
    if "tasks_to_complete" in info:
        return {*info["tasks_to_complete"], *info["step_task_completions"]}
    mask = info["tasks_to_complete_mask"] | info["step_task_completions_mask"]
    return {task for task, named in zip(GOALS, mask, strict=True) if named}


def weights(model):
    return [parameter.detach().numpy().copy() for parameter in model.policy.parameters()]


CABINET = "kitchen_suite.gymnasium_env:KitchenSuite/FrankaOpenCabinet-v1"
# Arguments of environments that Stable-Baselines3 supports.
SUPPORTED = {KITCHEN: {"goal_format": "flat", **EASY}, CABINET: {"action_limit": 1.0}}
# Infos from which hindsight relabelling computes the rewards of steps.
HINDSIGHT = ["tasks_to_complete_mask", "step_task_completions_mask"]


def make_fast(env_id=KITCHEN, num_envs=2, **options):
    from kitchen_suite.adapters.stable_baselines3 import make_vec_env

    return make_vec_env(env_id, num_envs, num_threads=1, **{**SUPPORTED[env_id], **options})


def assert_same(one, other):
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            assert_same(one[key], other[key])
    else:
        assert np.asarray(one).dtype == np.asarray(other).dtype
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("env_id", SUPPORTED)
def test_the_vectorised_environments_equal_a_dummy_vec_env(env_id):
    from stable_baselines3.common.env_util import make_vec_env

    arguments = {**SUPPORTED[env_id], "max_episode_steps": 7}
    plain, fast = make_vec_env(env_id, n_envs=3, env_kwargs=arguments), make_fast(env_id, 3, max_episode_steps=7)
    for environments in (plain, fast):
        environments.seed(5)
    assert (plain.observation_space, plain.action_space) == (fast.observation_space, fast.action_space)
    assert_same(plain.reset(), fast.reset())
    plain.action_space.seed(0)
    for _ in range(15):
        actions = np.stack([plain.action_space.sample() for _ in range(3)])
        (*expected, infos), (*found, fast_infos) = plain.step(actions), fast.step(actions)
        for one, other in zip(expected, found, strict=True):
            assert_same(one, other)
        for one, other, ended in zip(infos, fast_infos, found[2], strict=True):
            assert other["TimeLimit.truncated"] == one["TimeLimit.truncated"]
            assert ("terminal_observation" in other) == ended
            if ended:
                assert_same(one["terminal_observation"], other["terminal_observation"])
                assert other["episode"]["l"] == one["episode"]["l"] <= 7
                assert other["episode"]["r"] == pytest.approx(one["episode"]["r"], abs=1e-5)
                assert other["is_success"] == one["is_success"]
            else:
                assert other.keys() == {"TimeLimit.truncated"}
    for environments in (plain, fast):
        environments.close()


def test_infos_of_varied_episodes_are_those_of_each_environment():
    from stable_baselines3.common.env_util import make_vec_env

    kwargs = {"variations": "start", "max_episode_steps": 2}
    plain = make_vec_env(CABINET, n_envs=2, env_kwargs={**SUPPORTED[CABINET], **kwargs})
    fast = make_fast(CABINET, 2, info_keys=["variation_values"], **kwargs)
    for environments in (plain, fast):
        environments.seed(5)
        environments.reset()
    for one, other in zip(plain.reset_infos, fast.unwrapped.reset_infos, strict=True):
        assert_same(one["variation_values"], other["variation_values"])
    for _ in range(2):
        infos, fast_infos = (environments.step(np.zeros((2, 8)))[-1] for environments in (plain, fast))
        for one, other in zip(infos, fast_infos, strict=True):
            assert one["variation_values"]["cabinet/drawer_top"] > 0.0
            assert_same(one["variation_values"], other["variation_values"])
    for environments in (plain, fast):
        environments.close()


def test_an_episode_that_terminates_at_its_limit_is_not_truncated():
    goals = {"tasks_to_complete": ["microwave"], "goals": {"microwave": [0.0]}}
    environments = make_fast(num_envs=2, max_episode_steps=1, **goals)
    environments.reset()
    _, rewards, dones, infos = environments.step(np.zeros((2, 9)))
    assert (rewards.tolist(), dones.tolist()) == ([1.0, 1.0], [True, True])
    assert [info["TimeLimit.truncated"] for info in infos] == [False, False]
    assert [bool(info["is_success"]) for info in infos] == [True, True]
    environments.close()


@pytest.mark.parametrize("env_id", SUPPORTED)
def test_ppo_learns_in_the_vectorised_environments(env_id):
    from stable_baselines3 import PPO

    environments = make_fast(env_id, 4, max_episode_steps=20)
    policy = "MultiInputPolicy" if env_id == KITCHEN else "MlpPolicy"
    model = PPO(policy, environments, n_steps=50, batch_size=100, n_epochs=1, seed=0, device="cpu")
    before = weights(model)
    model.learn(400)
    assert not all(np.array_equal(old, new) for old, new in zip(before, weights(model), strict=True))
    assert len(model.ep_info_buffer) >= 20
    assert max(episode["l"] for episode in model.ep_info_buffer) == 20
    environments.close()


def test_sac_learns_changes_of_the_end_effectors_position():
    from stable_baselines3 import SAC

    environment = gymnasium.make(KITCHEN, control_mode="ee_delta_position", goal_format="flat")
    model = SAC(
        "MultiInputPolicy", environment, learning_starts=100, buffer_size=1_000, train_freq=4, seed=0, device="cpu"
    )
    model.learn(300)
    assert model.num_timesteps == 300
    action, _ = model.predict(environment.reset(seed=0)[0])
    assert action.shape == (4,)
    environment.close()


@pytest.mark.parametrize(("env_id", "mode", "size"), [(KITCHEN, "joint_delta", 8), (CABINET, "ee_delta_pose", 7)])
def test_the_vectorised_environments_have_control_modes(env_id, mode, size):
    from stable_baselines3 import SAC

    environments = make_fast(env_id, 2, control_mode=mode)
    policy = "MultiInputPolicy" if env_id == KITCHEN else "MlpPolicy"
    model = SAC(policy, environments, learning_starts=20, buffer_size=100, seed=0, device="cpu").learn(60)
    assert model.predict(environments.reset())[0].shape == (2, size)
    environments.close()


@pytest.mark.parametrize("copy_info_dict", [False, True])
def test_hindsight_relabelling_in_the_vectorised_environments(copy_info_dict):
    from stable_baselines3 import SAC, HerReplayBuffer

    environments = make_fast(KITCHEN, 2, max_episode_steps=30, info_format="arrays", info_keys=HINDSIGHT)
    model = SAC(
        "MultiInputPolicy",
        environments,
        replay_buffer_class=HerReplayBuffer,
        replay_buffer_kwargs={"copy_info_dict": copy_info_dict, "n_sampled_goal": 4},
        buffer_size=400,
        learning_starts=100,
        train_freq=50,
        gradient_steps=2,
        seed=0,
        device="cpu",
    )
    model.learn(300)
    assert [(episode["l"], episode["r"]) for episode in model.ep_info_buffer] == [(30, 1.0)] * 10
    rewards = model.replay_buffer.sample(200).rewards.numpy().ravel()
    # The microwave may be rewarded once an episode by its info, but always where there is none.
    assert {*rewards} >= ({0.0, 1.0} if copy_info_dict else {1.0, 2.0})
    environments.close()


def test_its_own_argument_names_make_the_same_environments(tmp_path):
    from stable_baselines3.common.env_util import make_vec_env

    from kitchen_suite.adapters.stable_baselines3 import make_vec_env as make_ours

    arguments = {
        "env_id": KITCHEN,
        "n_envs": 2,
        "seed": 3,
        "start_index": 4,
        "env_kwargs": {**SUPPORTED[KITCHEN], "max_episode_steps": 5},
        "monitor_kwargs": {"info_keywords": ("is_success",)},
    }
    plain = make_vec_env(**arguments, monitor_dir=str(tmp_path / "plain"))
    fast = make_ours(**arguments, monitor_dir=tmp_path / "fast")
    assert_same(plain.reset(), fast.reset())
    for _ in range(5):
        actions = np.zeros((2, 9))
        for one, other in zip(plain.step(actions)[:3], fast.step(actions)[:3], strict=True):
            assert_same(one, other)
    for environments in (plain, fast):
        environments.close()
    # Its own vector writes a file for each environment.
    expected = rows_of(tmp_path / "plain" / "4.monitor.csv") + rows_of(tmp_path / "plain" / "5.monitor.csv")
    assert rows_of(tmp_path / "fast" / "4.monitor.csv") == expected == [(1.0, 5, "False")] * 2


def rows_of(path):
    """Return, length and success of the episodes in a file of its monitor, which begins with a comment."""
    rows = csv.DictReader(path.read_text().splitlines()[1:])
    return [(float(row["r"]), int(row["l"]), row["is_success"]) for row in rows]


def test_all_its_argument_names_are_taken_or_refused_with_the_way():
    import inspect

    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.common.vec_env import DummyVecEnv

    from kitchen_suite.adapters.stable_baselines3 import make_vec_env as make_ours

    taken = inspect.signature(make_ours).parameters.keys()
    refused_here = {
        "vec_env_cls": DummyVecEnv,
        "vec_env_kwargs": {"start_method": "spawn"},
        "wrapper_class": Monitor,
        "wrapper_kwargs": {"filename": None},
    }
    assert inspect.signature(make_vec_env).parameters.keys() <= taken | refused_here.keys()
    for name, value in refused_here.items():
        with refused(TypeError, name, "stable_baselines3.common.env_util.make_vec_env"):
            make_ours(KITCHEN, 1, **{name: value})
        # Its own default.
        make_ours(CABINET, 1, num_threads=1, action_limit=1.0, **{name: None}).close()
    with refused(TypeError, "num_envs", "n_envs"):
        make_ours(KITCHEN, num_envs=2)
    with refused(TypeError, "goal_format", "env_kwargs"):
        make_ours(KITCHEN, goal_format="flat", env_kwargs={"goal_format": "flat"})
    with refused(TypeError, "env_id"):
        make_ours(DummyVecEnv)
    with refused(TypeError, "allow_early_resets", "monitor_kwargs"):
        make_ours(KITCHEN, monitor_kwargs={"allow_early_resets": False})


def test_the_action_space_draws_the_same_for_the_same_seed():
    draws = []
    for _ in range(2):
        environments = make_fast(CABINET, 1, seed=7)
        draws.append(environments.action_space.sample().tolist())
        environments.close()
    assert draws[0] == draws[1]


def test_the_record_of_gymnasium_has_the_limit_that_applies():
    environments = make_fast(CABINET, 2, max_episode_steps=9)
    assert [spec.max_episode_steps for spec in environments.get_attr("spec")] == [9, 9]
    environments.close()


@pytest.mark.parametrize("vectorised", [False, True], ids=["its own vector", "ours"])
def test_hindsight_relabelling_begins_when_the_first_episodes_of_four_environments_have_ended(vectorised):
    from stable_baselines3 import SAC, HerReplayBuffer
    from stable_baselines3.common.env_util import make_vec_env

    count = 4
    if vectorised:
        environments = make_fast(KITCHEN, count, info_keys=HINDSIGHT, max_episode_steps=20)
    else:
        kwargs = {**SUPPORTED[KITCHEN], "max_episode_steps": 20}
        environments = make_vec_env(KITCHEN, n_envs=count, env_kwargs=kwargs)
    settings = {
        "replay_buffer_class": HerReplayBuffer,
        "replay_buffer_kwargs": {"copy_info_dict": True},
        "buffer_size": 1_000,
        "device": "cpu",
        "seed": 0,
    }
    early = SAC("MultiInputPolicy", environments, learning_starts=20 + 1, **settings)
    with pytest.raises(RuntimeError, match="learning_starts"):
        early.learn(20 * count)
    model = SAC("MultiInputPolicy", environments, learning_starts=20 * count, **settings)
    before = weights(model)
    model.learn(25 * count)
    assert not all(np.array_equal(old, new) for old, new in zip(before, weights(model), strict=True))
    environments.close()


def test_what_it_does_not_support_is_refused_with_the_argument_to_pass():
    with refused(ValueError, "goal_format", "'flat'"):
        make_fast(KITCHEN, goal_format="dict")
    with refused(ValueError, "action_limit", "1.0"):
        make_fast(CABINET, action_limit=None)


def test_attributes_and_methods_are_those_of_the_environments():
    from stable_baselines3.common.monitor import Monitor

    environments = make_fast(num_envs=3)
    assert environments.get_attr("info_format") == ["lists"] * 3
    assert environments.get_attr("render_mode", [0, 2]) == [None, None]
    sentence = environments.get_attr("instruction", 1)
    assert sentence == [make().unwrapped.instruction]
    assert environments.env_is_wrapped(Monitor, 1) == [False]
    with refused(AttributeError, "no_such"):
        environments.get_attr("no_such")
    with refused(AttributeError, "velocity_scale", "make_vec_env"):
        environments.set_attr("velocity_scale", 1.0)
    environments.close()


@pytest.mark.rendering
def test_images_are_tiled():
    environments = make_fast(num_envs=2, render_mode="rgb_array", width=32, height=16)
    environments.reset()
    assert environments.render().shape == (32, 32, 3)
    environments.close()


@pytest.mark.parametrize("name", ["reset", "step", "get_state", "set_state", "render"])
def test_a_method_of_one_episode_is_refused_by_name(name):
    environments = make_fast(num_envs=2)
    with pytest.raises(AttributeError, match=rf"{name} .* compute_reward, compute_terminated, compute_truncated"):
        environments.env_method(name)
    environments.close()


def test_options_of_a_reset_are_refused_in_place_of_being_lost():
    environments = make_fast(num_envs=2)
    environments.set_options()
    with pytest.raises(ValueError, match="options"):
        environments.set_options({"state": None})
    environments.close()


def small_model(**kwargs):
    from stable_baselines3 import PPO

    from kitchen_suite.adapters.stable_baselines3 import make_vec_env

    environment = make_vec_env("kitchen_suite:KitchenSuite/Kettle-v1", n_envs=2, seed=0, obs_type="state", **kwargs)
    return PPO("MlpPolicy", environment, n_steps=8, batch_size=16, n_epochs=1, seed=0, device="cpu")


def evaluating(eval_freq=4, **kwargs):
    from kitchen_suite.adapters.stable_baselines3 import EvaluationCallback

    arguments = {"task_name": "kettle", "task_kwargs": {"obs_type": "state"}, "num_episodes": 2, "max_episode_steps": 3}
    return EvaluationCallback(eval_freq, **{**arguments, **kwargs})


def test_a_model_is_evaluated_while_it_is_trained(tmp_path):
    from stable_baselines3 import PPO

    import kitchen_suite

    model = small_model()
    callback = evaluating(best_model_save_path=tmp_path / "models")
    model.learn(32, callback=callback)
    # Two environments make two timesteps in each of the calls, of which every fourth evaluates.
    assert [*callback.evaluations] == [8, 16, 24, 32]
    assert callback.best_success == 0.0
    assert (tmp_path / "models" / "best_model.zip").is_file()
    last = callback.evaluations[32]
    assert [result.seed for result in last.results["kettle"]] == [300_000_000, 300_000_001]
    comparison = kitchen_suite.compare(last, callback.evaluations[8])
    assert (comparison.ties, comparison.p_value) == (2, 1.0)

    # The model of the first evaluation is the best one, since no later one succeeds more often.
    best = PPO.load(tmp_path / "models" / "best_model")
    arguments = {"task_name": "kettle", "task_kwargs": {"obs_type": "state"}, "num_episodes": 2, "max_episode_steps": 3}
    again = kitchen_suite.evaluate(
        lambda observation: best.predict(observation, deterministic=True)[0],
        takes="observation",
        seed=300_000_000,
        **arguments,
    )
    assert again.results == callback.evaluations[8].results


def test_evaluations_are_normalised_as_training_is():
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecNormalize

    environment = VecNormalize(small_model().get_env())
    model = PPO("MlpPolicy", environment, n_steps=8, batch_size=16, n_epochs=1, seed=0, device="cpu")
    seen = []
    normalize = environment.normalize_obs
    environment.normalize_obs = lambda observations: seen.append(observations.shape) or normalize(observations)
    model.learn(16, callback=evaluating(num_episodes=3))
    # Three environments of the evaluation, beside the two of training.
    assert (3, 59) in seen


def recurrent_model():
    from sb3_contrib import RecurrentPPO

    environment = small_model().get_env()
    # Great weights, so that the hidden state matters.
    policy = {"lstm_hidden_size": 8, "net_arch": [8], "ortho_init": False, "log_std_init": -20.0}
    return RecurrentPPO(
        "MlpLstmPolicy", environment, n_steps=8, batch_size=16, n_epochs=1, seed=0, device="cpu", policy_kwargs=policy
    )


def actions_alone(model, spec, seed):
    """The actions of the episode of a seed, as the documentation of sb3-contrib plays a recurrent model."""
    environment = spec.make_environment()
    observation, _ = environment.reset(seed=seed)
    state, start, actions, truncated = None, np.ones(1, bool), [], False
    while not truncated:
        action, state = model.predict(observation, state=state, episode_start=start, deterministic=True)
        actions.append(action)
        start = np.zeros(1, bool)
        observation, _, _, truncated, _ = environment.step(action)
    environment.close()
    return np.array(actions)


def test_a_recurrent_model_has_a_hidden_state_for_each_episode():
    import kitchen_suite
    from kitchen_suite.adapters.stable_baselines3 import ModelPolicy

    model = recurrent_model()
    spec = kitchen_suite.EnvironmentSpec.make("kitchen", "kettle", {"obs_type": "state"}, 4)
    policy = ModelPolicy(model)
    expected = [actions_alone(model, spec, seed) for seed in range(5)]
    # What it would do without a memory.
    environment = spec.make_environment()
    observation, _ = environment.reset(seed=0)
    observation = environment.step(expected[0][0])[0]
    assert np.abs(model.predict(observation, deterministic=True)[0] - expected[0][1]).max() > 1e-3
    environment.close()
    for num_envs in (1, 2, 4):
        played = kitchen_suite.play(spec, policy, range(5), takes="batch", num_envs=num_envs)
        for episode in played:
            # PyTorch adds up in another order for other sizes of a batch.
            np.testing.assert_allclose(episode.arrays["action"], expected[episode.seed], atol=1e-5)


def test_a_recurrent_model_is_evaluated_while_it_is_trained():
    import kitchen_suite
    from kitchen_suite.adapters.stable_baselines3 import ModelPolicy

    # The first evaluation is made before the first update.
    callback = evaluating(num_episodes=5, num_envs=2)
    recurrent_model().learn(16, callback=callback)
    assert [*callback.evaluations] == [8, 16]
    arguments = {"task_name": "kettle", "task_kwargs": {"obs_type": "state"}, "num_episodes": 5, "max_episode_steps": 3}
    policy = ModelPolicy(recurrent_model())
    again = kitchen_suite.evaluate(policy, takes="batch", num_envs=2, seed=300_000_000, **arguments)
    for one, other in zip(callback.evaluations[8].traces["kettle"], again.traces["kettle"], strict=True):
        np.testing.assert_array_equal(one.actions, other.actions)


@pytest.mark.parametrize(
    ("kwargs", "error", "shown"),
    [
        ({"task_kwargs": {}}, ValueError, "task_kwargs"),
        ({"task_kwargs": {"obs_type": "state", "control_mode": "ee_delta_pose"}}, ValueError, "shape (9,), not (7,)"),
        ({"protocol": "d4rls"}, ValueError, "d4rl"),
        ({"num_episode": 3}, TypeError, "num_episodes"),
        ({"receipt": "a.npz"}, TypeError, "receipt"),
        ({"eval_freq": 0}, ValueError, "eval_freq"),
    ],
    ids=str,
)
def test_evaluations_that_cannot_be_made_are_refused_before_training(kwargs, error, shown):
    model = small_model()
    with refused(error, shown):
        evaluating(**kwargs).init_callback(model)
