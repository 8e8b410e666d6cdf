"""Custom tasks act alike in dm_env, single and vectorised environments of every domain, or are refused."""

import contextlib
import copy
import dataclasses
import pickle
import warnings

import gymnasium
import mujoco
import numpy as np
import pytest
from dm_control import composer, mjcf
from dm_control.composer.variation import distributions, noises
from dm_control.entities.props.primitive import Primitive
from docs_scripts import load_script
from gymnasium.error import ResetNeeded
from helpers.errors import refused
from helpers.sweeps import brief

import kitchen_suite
from kitchen_suite import entities, suite, tasks
from kitchen_suite.environment import Environment
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.gymnasium_env.base import SuiteEnv
from kitchen_suite.tasks import Observation, terms
from kitchen_suite.vector_env.base import SuiteVectorEnv

# By domain: what builds the scene, the task, and a free place for a mug [m].
DOMAINS = {
    "kitchen": (entities.build_kitchen_scene, tasks.KitchenTask, (-0.65, -0.35, 1.66)),
    "kitchens": (entities.build_generated_kitchen, tasks.GeneratedKitchenTask, (0.3, 0.4, 1.9)),
    "pick_and_place": (entities.build_pick_and_place, tasks.PickAndPlaceTask, (0.3, 0.4, 1.9)),
    "microwave_table": (entities.build_microwave_table_scene, tasks.MicrowaveTableTask, (0.4, 0.3, 0.9)),
    "open_cabinet": (entities.build_open_cabinet_scene, tasks.OpenCabinetTask, (0.4, 0.3, 0.4)),
}
BASES = [task for _, task, _ in DOMAINS.values()]
MASS = 0.3  # [kg]


def mug(name="mug", **attributes):
    return Primitive(geom_type="cylinder", size=(0.04, 0.05), mass=MASS, name=name, **attributes)


def position(simulation, state):
    return simulation.named("xpos", "mug/")


def touch(simulation, state):
    """The force on the mug [N], which MuJoCo measures in the last physics step."""
    return simulation.named("sensordata", "mug/touch")


def fallen(step):
    return step.previous_observations["mug_position"][..., 2] - step.observations["mug_position"][..., 2]


def height(step):
    return step.observations["hidden_height"][..., 0]


def mug_task(domain, **attributes):
    """A class of a domain's task with a mug that is observed, rewarded, and ends the episode."""
    _, base, place = DOMAINS[domain]

    class MugTask(base):
        extra_observations = {
            "mug_position": Observation(position, noise=noises.Additive(distributions.Uniform(-0.01, 0.01))),
            "mug_touch": Observation(touch),
            "hidden_height": Observation(lambda simulation, state: position(simulation, state)[..., 2:], enabled=False),
        }
        extra_rewards = {"fallen": fallen, "height": height}
        extra_terminations = {"below": lambda step: height(step) < place[2] - 0.05}

        def __init__(self, scene, **options):
            entity = mug()
            site = entity.mjcf_model.worldbody.add("site", name="touch", type="sphere", size=(0.1,))
            entity.mjcf_model.sensor.add("touch", name="touch", site=site)
            scene.attach(entity, pos=(place[0], place[1], place[2] + 0.02), free=True)
            super().__init__(scene, **options)

    return type("MugTask", (MugTask,), attributes)


@contextlib.contextmanager
def registered(domain, task):
    """A registered domain with a task in the scene of one of the suite's domains."""
    name = f"custom_{domain}"
    record = suite.Domain(
        name,
        scene=DOMAINS[domain][0],
        task=task,
        tasks={"one": {}},
        env_id=f"Custom/{domain.title().replace('_', '')}-v1",
        episode_steps=60,
    )
    suite.register(record)
    try:
        yield record
    finally:
        del suite._domains[name]
        for env_id in {record.env_id, *record.task_ids.values()}:
            del gymnasium.registry[env_id]


def numbers(observation):
    return observation["observation"] if isinstance(observation, dict) else observation


@pytest.mark.parametrize("attributes", [{"noise": noises.Additive(0.1)}, {"enabled": False}])
def test_an_observation_of_an_mdp_that_would_be_another_in_vectors_is_refused(attributes):
    scene = entities.build_microwave_table_scene(visuals=False)
    mdp = tasks.MicrowaveTableTask(scene).mdp
    terms = {**mdp.observations, "angle": Observation(lambda simulation, state: state.door_opening, **attributes)}
    other = type("OtherMDP", (type(mdp),), {"observations": terms})
    arguments = {field.name: getattr(mdp, field.name) for field in dataclasses.fields(mdp)}
    with refused(ValueError, "observations['angle'] of OtherMDP", "MDP.corrupted"):
        tasks.SuiteTask.__init__(tasks.MicrowaveTableTask.__new__(tasks.MicrowaveTableTask), scene, other(**arguments))


def test_a_task_of_suite_tasks_own_has_rewards_metrics_and_inputs():
    lever = load_script("examples/my_domain")

    class SlowTask(lever.LeverTask):
        extra_rewards = {"slow": lambda step: 2.0 * np.ones(step.action.shape[:-1])}

    environment = Environment(SlowTask(lever.build_lever_scene(visuals=False)), random_state=0)
    environment.reset()
    task = environment.task
    assert (task.policy_inputs.names, task.policy_inputs.size) == (("SlowTask",), 22)
    timestep = environment.step(np.zeros(8))
    assert task.reward_terms["slow"] == 2.0
    assert timestep.reward == sum(task.reward_terms.values())
    assert task.episode_metrics == {"success": False}
    environment.physics.named.data.qpos["lever/hinge"] = 1.0
    assert environment.step(np.zeros(8)).last()
    assert task.episode_metrics == {"success": True}


class GraspTask(tasks.KitchenTask):
    """The kitchen with a part of the robot, and one of the world, that are observed besides."""

    extra_observations = {
        "hand_height": Observation(
            lambda simulation, state: simulation.named("site_xpos", "franka/end_effector")[..., 2:],
            of_robot=True,
            minimum=-1.0,
            maximum=3.0,
        ),
        "door": Observation(lambda simulation, state: simulation.named("qpos", "microwave/microwave")),
    }


@pytest.mark.full
def test_what_is_of_the_robot_is_in_agent_pos():
    with registered("kitchen", GraspTask) as record:
        plain = gymnasium.make("KitchenSuite/FrankaKitchen-v1", obs_type="environment_state_agent_pos")
        env = gymnasium.make(record.env_id, obs_type="environment_state_agent_pos")
        envs = gymnasium.make_vec(record.env_id, 2, obs_type="environment_state_agent_pos")
        one, _ = plain.reset(seed=0)
        other, _ = env.reset(seed=0)
        many, _ = envs.reset(seed=0)
        data = env.unwrapped.environment.physics.named.data
        hand, door = data.site_xpos["franka/end_effector", "z"], data.qpos["microwave/microwave"]
        assert other["agent_pos"].tolist() == [*one["agent_pos"], hand]
        agent = env.observation_space["agent_pos"]
        assert (agent.low[-1], agent.high[-1]) == (-1.0, 3.0)
        assert np.isinf(agent.low[:-1]).all()
        assert other["environment_state"].tolist() == [*one["environment_state"], *door]
        for key, part in other.items():
            np.testing.assert_array_equal(many[key][0], part)


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_an_object_with_its_observations_rewards_and_termination_acts_in_all_front_ends(domain):
    with registered(domain, mug_task(domain)) as record:
        env = gymnasium.make(record.env_id)
        envs = gymnasium.make_vec(record.env_id, 3)
        inner = env.unwrapped
        generator = gymnasium.utils.seeding.np_random(1)[0]
        environment = suite.load(record.name, "one", {"time_limit": None, "visuals": False})
        environment.random_state = np.random.RandomState(generator.bit_generator)
        observation, info = env.reset(seed=1)
        many, _ = envs.reset(seed=0)
        timestep = environment.reset()
        mass = inner.environment.physics.named.model.body_mass["mug/"]
        assert mass == pytest.approx(MASS)
        np.testing.assert_array_equal(numbers(many)[1], numbers(observation))
        assert not info["termination/below"]
        rng, ends, touched = np.random.default_rng(0), 0, 0.0
        size = inner.composer_task.policy_inputs.state_size
        assert inner.composer_task.extra_slices["mug_touch"].stop == inner.composer_task.extra_size == 4
        for _ in range(60):
            action = rng.normal(size=env.action_space.shape).clip(-1, 1).astype(np.float32)
            observation, reward, terminated, _, info = env.step(action)
            many, rewards, terminations, _, infos = envs.step(np.stack([action] * 3))
            timestep = environment.step(inner.clip_actions(action.astype(np.float64)))
            flat = numbers(observation)
            assert flat.shape == (size,)
            np.testing.assert_array_equal(numbers(many)[1], flat)
            parts = np.concatenate([timestep.observation["mug_position"], timestep.observation["mug_touch"]])
            np.testing.assert_array_equal(parts.astype(flat.dtype), flat[-4:])
            assert "hidden_height" not in timestep.observation
            assert reward == rewards[1] == timestep.reward
            assert terminated == terminations[1] == (timestep.discount == 0.0)
            assert info["termination/below"] == infos["termination/below"][1]
            assert info["reward/fallen"] == infos["reward/fallen"][1]
            true = inner.environment.physics.named.data.xpos["mug/"]
            assert 0.0 < np.abs(flat[-4:-1] - true).max() <= 0.01 + 1e-6
            touched = max(touched, flat[-1])
            if terminated:
                ends += 1
                assert info["termination/below"] or domain != "kitchen"
                break
        # It falls by gravity, onto furniture or the floor, where it is felt or ends the episode.
        assert touched > 0.0 or ends == 1
        envs.close()


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_a_copy_continues_with_the_noise_of_the_last_observation(domain):
    with registered(domain, mug_task(domain, extra_terminations={"below": None})) as record:
        env = gymnasium.make(record.env_id).unwrapped
        env.reset(seed=3)
        rng = np.random.default_rng(0)
        for _ in range(3):
            env.step(rng.normal(size=env.action_space.shape).clip(-1, 1))
        for other in (copy.deepcopy(env), pickle.loads(pickle.dumps(env))):
            again = other.set_state(env.get_state())
            np.testing.assert_array_equal(numbers(again), numbers(env.observations(env._present())))
        actions = rng.normal(size=(4, *env.action_space.shape)).clip(-1, 1)
        expected = [env.step(action) for action in actions]
        for action, (observation, reward, *_) in zip(actions, expected, strict=True):
            found = other.step(action)
            np.testing.assert_array_equal(numbers(found[0]), numbers(observation))
            assert found[1] == reward


MASSES = [(domain, group) for domain in DOMAINS for group in range(6)]


@pytest.mark.full
@pytest.mark.parametrize(
    ("domain", "group"), brief(MASSES, kept=[(domain, 0) for domain in DOMAINS], full=[*MASSES[1:6], *MASSES[7:12]])
)
def test_anything_attached_has_the_mass_that_it_has_alone(domain, group):
    build, _, place = DOMAINS[domain]
    alone = Primitive(geom_type="box", size=(0.02, 0.03, 0.04), name="box", group=group)
    box = Primitive(geom_type="box", size=(0.02, 0.03, 0.04), name="box", group=group)
    scene = build(visuals=False)
    scene.attach(box, pos=place, free=True)
    arena = composer.Arena()
    arena.add_free_entity(alone)
    expected, found = (mjcf.Physics.from_mjcf_model(root) for root in (arena.mjcf_model, scene.arena.mjcf_model))
    assert found.named.model.body_mass["box/"] == expected.named.model.body_mass["box/"] > 0.0
    np.testing.assert_array_equal(found.named.model.body_inertia["box/"], expected.named.model.body_inertia["box/"])


def test_entities_of_one_name_and_other_objects_are_refused():
    scene = entities.build_kitchen_scene(visuals=False)
    scene.attach(mug())
    for name in ("mug", "kettle", "franka"):
        with refused(ValueError, f"an entity '{name}' already"):
            scene.attach(mug(name))
    with refused(TypeError, "composer.Entity"):
        scene.attach("mug")
    with refused(ValueError, "pos", "(3,)"):
        scene.attach(mug("other"), pos=(0.0, 1.0))
    assert list(scene.attached) == ["mug"]


def test_the_pose_of_an_attached_entity_is_an_extra_observable():
    class Task(tasks.KitchenTask):
        def __init__(self, scene, **options):
            scene.attach(mug(), pos=(-0.65, -0.35, 1.66), free=True)
            super().__init__(scene, **options)

    env = SuiteEnvOf("kitchen", Task)(extra_observables=("mug/pose",))
    observation, _ = env.reset(seed=0)
    np.testing.assert_allclose(numbers(observation)[59:62], (-0.65, -0.35, 1.66), atol=0.02)


def SuiteEnvOf(domain, task):  # noqa: N802
    """The single environment of a task that is not registered."""
    base = gymnasium.envs.registration.load_env_creator(suite.DOMAINS[domain].env)

    class Env(base):
        pass

    return lambda **arguments: Env(domain=_temporary(domain, task), **arguments)


def _temporary(domain, task):
    name = f"temporary_{len(suite.DOMAINS)}"
    suite._domains[name] = suite.Domain(
        name, scene=DOMAINS[domain][0], task=task, tasks={"one": {}}, env_id=f"Custom/{name}-v1", episode_steps=9
    )
    return name


@pytest.fixture(autouse=True)
def _no_temporary_domains():
    yield
    for name in [name for name in suite.DOMAINS if name.startswith("temporary_")]:
        del suite._domains[name]


# Classes that extend classes with terms


class Mixin:
    extra_rewards = {"mixed": lambda step: 2.0 * np.ones(step.action.shape[:-1])}
    extra_terminations = {"mixed": lambda step: np.zeros(step.action.shape[:-1], bool)}
    extra_observations = {"mixed": Observation(lambda simulation, state: state.joint_velocities[..., 1:2])}


def one(step):
    return np.ones(step.action.shape[:-1])


def moves_up(step):
    """Whether the first element of the action is positive."""
    return step.action[..., 0] > 0.0


def moves_down(step):
    return step.action[..., 0] < 0.0


class BaseTask(tasks.MicrowaveTableTask):
    extra_rewards = {"one": one, "other": one}
    extra_terminations = {"up": moves_up, "removed": lambda step: np.array(True)}
    extra_observations = {
        "first": Observation(lambda simulation, state: state.joint_velocities[..., :1]),
        "hidden": Observation(lambda simulation, state: state.joint_velocities[..., 3:4]),
    }


class DerivedTask(Mixin, BaseTask):
    extra_rewards = {"other": lambda step: 5.0 * one(step)}
    extra_terminations = {"down": moves_down, "removed": None}

    @property
    def extra_observations(self):
        return {"last": Observation(lambda simulation, state: state.joint_velocities[..., 2:3]), "hidden": None}


@pytest.mark.full
def test_terms_of_a_subclass_join_those_of_its_bases_in_all_front_ends():
    with registered("microwave_table", DerivedTask) as record:
        env = gymnasium.make(record.env_id)
        envs = gymnasium.make_vec(record.env_id, 3)
        environment = suite.load(record.name, "one", {"visuals": False})
        reasons = ("up", "mixed", "down")
        for action, reason in ((0.0, None), (0.5, "up"), (-0.5, "down")):
            actions = np.zeros((3, 8), np.float32)
            actions[:, 0] = action
            _, info = env.reset(seed=1)
            many, infos = envs.reset(seed=1)
            environment.reset()
            assert {key for key in info if key.startswith("termination/")} == {f"termination/{key}" for key in reasons}
            observation, reward, terminated, _, info = env.step(actions[0])
            many, rewards, terminations, _, infos = envs.step(actions)
            timestep = environment.step(actions[0].astype(np.float64))
            assert terminated == terminations[0] == (timestep.discount == 0.0) == (reason is not None)
            for key in reasons:
                assert info[f"termination/{key}"] == infos[f"termination/{key}"][0] == (key == reason)
            for key, value in (("one", 1.0), ("other", 5.0), ("mixed", 2.0)):
                assert info[f"reward/{key}"] == infos[f"reward/{key}"][0] == value
                assert environment.task.reward_terms[key] == value
            assert reward == rewards[0]
            np.testing.assert_array_equal(observation, many[0])
            velocities = env.unwrapped.composer_task.state.joint_velocities
            np.testing.assert_array_equal(observation[-3:], velocities[:3].astype(np.float32))
            assert list(timestep.observation)[-3:] == ["first", "mixed", "last"]
        envs.close()


def test_a_base_of_two_classes_does_not_undo_what_one_of_them_replaces():
    base = type("Base", (), {"extra_rewards": {"a": 1, "b": 1}})
    left = type("Left", (base,), {"extra_rewards": {"c": 2}})
    right = type("Right", (base,), {"extra_rewards": {"a": 3, "b": None}})
    both = type("Both", (left, right), {})
    assert terms.added(both(), "extra_rewards") == {"a": 3, "c": 2}
    again = type("Again", (both,), {"extra_rewards": {"b": 4}})()
    again.extra_rewards = {"d": 5}
    assert list(terms.added(again, "extra_rewards").items()) == [("a", 3), ("c", 2), ("b", 4), ("d", 5)]


@pytest.mark.parametrize(
    ("value", "error", "words"),
    [
        ([], TypeError, ("must be a dict",)),
        ({"up": 3}, TypeError, ("['up']", "3")),
        ({3: one}, ValueError, ("names as keys", "3")),
        ({"a/": one}, ValueError, ("names as keys", "'a/'")),
        ({"a//b": one}, ValueError, ("names as keys", "'a//b'")),
        ({"a\0b": one}, ValueError, ("names as keys", "printable", r"'a\x00b'")),
        ({"a/b/c/d/e/f/g": one}, ValueError, ("names as keys", "1 to 6", "'a/b/c/d/e/f/g'")),
        ({"upp": None}, ValueError, ("removes", "'upp' does not exist", "'up'")),
    ],
)
def test_terms_that_cannot_be_are_refused_by_the_name_of_their_class(value, error, words):
    base = type("Base", (), {"extra_rewards": {"up": one}})
    task = type("Mine", (base,), {"extra_rewards": value})
    with refused(error, "extra_rewards", "Mine", *words):
        terms.added_functions(task(), "extra_rewards")


# Names of terms that recordings hold


def domain_of(task):
    return suite.Domain(
        "mine",
        scene=DOMAINS["microwave_table"][0],
        task=task,
        tasks={"one": {}},
        env_id="Mine/A-v1",
        episode_steps=9,
    )


@pytest.mark.parametrize(
    ("attribute", "names", "taken"),
    [
        ("extra_rewards", ["approach/left"], "'approach' and ['approach/left']"),
        ("extra_rewards", ["grasp/left", "grasp", "grasp/right/up"], "'grasp' and ['grasp/left', 'grasp/right/up']"),
        ("extra_terminations", ["below", "below/door"], "'below' and ['below/door']"),
    ],
)
def test_a_name_that_is_a_group_of_other_terms_is_refused_when_the_task_is_built(attribute, names, taken):
    task = type("Mine", (tasks.MicrowaveTableTask,), {attribute: dict.fromkeys(names, one)})
    with refused(ValueError, f"{attribute} of Mine", taken, "choose names that do not begin with"):
        domain_of(task).load(visuals=False)


def test_terms_of_an_mdp_whose_names_no_recording_could_hold_are_refused():
    lever = load_script("examples/my_domain")
    scene = lever.build_lever_scene(visuals=False)
    mdp = lever.LeverTask(scene).mdp
    for name, words in (("push/left", "'push' and ['push/left']"), ("a//b", "'a//b'")):
        other = dataclasses.replace(mdp, rewards={**mdp.rewards, name: one})
        with refused(ValueError, "reward and extra_rewards of LeverTask", words):
            tasks.SuiteTask.__init__(lever.LeverTask.__new__(lever.LeverTask), scene, other)


@pytest.mark.full
def test_names_that_do_not_begin_with_one_another_are_recorded_and_read_again(tmp_path):
    names = ["approach_left", "grasp/left", "grasp/right/up", "a/b/c/d/e/f"]
    terms = {"extra_rewards": dict.fromkeys(names, one), "extra_terminations": dict.fromkeys(names, lambda step: False)}
    with registered("microwave_table", type("Mine", (tasks.MicrowaveTableTask,), terms)) as record:
        spec = kitchen_suite.EnvironmentSpec.make(record.name, "one", {})
        kitchen_suite.record(tmp_path / "runs", spec, "zero", num_episodes=1, num_threads=1)
        (episode,) = Recording.open(tmp_path / "runs")
    for name in names:
        assert episode.arrays[f"info/reward/{name}"].tolist() == [0.0, *[1.0] * record.episode_steps]
        assert episode.arrays[f"info/termination/{name}"].tolist() == [False] * (record.episode_steps + 1)


# Shapes of terms


def offset(step):
    """A view of the state, of a quantity that is not 0 at a reset."""
    return step.after.handle_offset[..., 0]


@pytest.mark.full
def test_python_numbers_and_views_of_the_state_are_terms_in_all_front_ends():
    rewards = {"time": lambda step: -0.01, "count": lambda step: 2, "true": lambda step: True, "offset": offset}
    terminations = {"never": lambda step: False, "far": lambda step: offset(step) > 100.0}
    attributes = {"extra_rewards": rewards, "extra_terminations": terminations}
    task = type("Mine", (tasks.MicrowaveTableTask,), attributes)
    with registered("microwave_table", task) as record:
        env = gymnasium.make(record.env_id, max_episode_steps=3)
        envs = gymnasium.make_vec(record.env_id, 2, max_episode_steps=3)
        env.reset(seed=1)
        envs.reset(seed=0)
        rng = np.random.default_rng(0)
        # A step of the vectorised environments starts the next episodes, whose states must not share memory with terms.
        for step in range(8):
            actions = rng.normal(size=(2, 8)).clip(-1, 1).astype(np.float32)
            many, rewards, terminations, _, infos = envs.step(actions)
            if step % 4 == 3:
                observation, info = env.reset()
            else:
                observation, reward, terminated, _, info = env.step(actions[1])
                assert reward == rewards[1]
                assert not terminated
                assert not terminations[1]
                assert [info[f"reward/{name}"] for name in ("time", "count", "true")] == [-0.01, 2.0, 1.0]
            for name in ("time", "count", "true", "offset", "approach", "opening"):
                assert info[f"reward/{name}"].dtype == infos[f"reward/{name}"].dtype == np.float64
                assert infos[f"reward/{name}"].shape == (2,)
                assert info[f"reward/{name}"] == infos[f"reward/{name}"][1]
            for name in ("never", "far"):
                assert infos[f"termination/{name}"].tolist() == [False, False]
            np.testing.assert_array_equal(many[1], observation)
        envs.close()


def with_term(attribute, term):
    """A class of a task with a term `x`."""
    return type("Mine", (tasks.MicrowaveTableTask,), {attribute: {"x": term}})


@pytest.mark.parametrize(
    ("term", "error", "shown"),
    [
        (lambda step: step.after.joint_velocities, ValueError, "the shape (), got (9,): reduce along the last axis"),
        (lambda step: step.after.joint_velocities[..., :1], ValueError, "the shape (), got (1,)"),
        (lambda step: None, TypeError, "numbers of the shape (), got None"),
        (lambda step: "1", TypeError, "numbers of the shape (), got '1'"),
        (lambda step: [[1.0], [1.0, 2.0]], ValueError, "must be an array"),
    ],
)
def test_a_term_of_another_shape_is_refused_at_the_first_step(term, error, shown):
    environment = Environment(with_term("extra_rewards", term)(entities.build_microwave_table_scene(visuals=False)))
    environment.reset()
    with refused(error, "extra_rewards['x']", shown):
        environment.step(np.zeros(8))


@pytest.mark.full
@pytest.mark.parametrize(("attribute", "reduce"), [("extra_rewards", np.max), ("extra_terminations", np.any)])
@pytest.mark.parametrize("count", [1, 2])
def test_a_term_that_is_reduced_over_a_batch_is_refused_and_not_broadcast(attribute, reduce, count):
    def over_all(step):
        return reduce(np.abs(step.after.joint_velocities) > 0.5)

    def of_each(step):
        return reduce(np.abs(step.after.joint_velocities) > 0.5, axis=-1)

    envs = SuiteVectorEnv(count, domain=_temporary("microwave_table", with_term(attribute, over_all)))
    envs.reset(seed=0)
    with refused(ValueError, f"{attribute}['x'] must have the shape ({count},), got (): reduce along the last axis"):
        envs.step(np.zeros((count, 8)))
    envs = SuiteVectorEnv(count, domain=_temporary("microwave_table", with_term(attribute, of_each)))
    envs.reset(seed=0)
    *_, infos = envs.step(np.zeros((count, 8)))
    assert infos[f"{attribute.removeprefix('extra_').removesuffix('s')}/x"].shape == (count,)


# Errors of terms


def failing_once(error):
    """A function of a step that raises an error at its second call, and returns False at all others."""
    calls = iter((False, error))

    def term(step):
        if next(calls, False):
            raise error
        return np.zeros(step.action.shape[:-1], bool)

    return term


def make_front_end(front_end, task):
    """Returns functions that reset and step `dm_env`, `single` or `vector`, in the scene of microwave_table."""
    if front_end == "dm_env":
        environment = Environment(task(entities.build_microwave_table_scene(visuals=False)), episode_seeds=True)

        def reset():
            environment.random_state = 0
            environment.reset()

        return reset, lambda: environment.step(np.zeros(8)).reward
    if front_end == "single":
        env = SuiteEnv(domain=_temporary("microwave_table", task))
        return lambda: env.reset(seed=0), lambda: env.step(np.zeros(8))[1]
    envs = SuiteVectorEnv(2, domain=_temporary("microwave_table", task))
    return lambda: envs.reset(seed=0), lambda: envs.step(np.zeros((2, 8)))[1].tolist()


@pytest.mark.parametrize("attribute", ["extra_rewards", "extra_terminations"])
@pytest.mark.parametrize("error", [ZeroDivisionError("of a user"), KeyboardInterrupt()], ids=["error", "interrupt"])
@pytest.mark.parametrize("front_end", ["dm_env", "single", "vector"])
def test_an_episode_does_not_go_on_half_stepped_after_a_term_has_raised(front_end, error, attribute):
    task = with_term(attribute, failing_once(error))
    reset, step = make_front_end(front_end, task)
    reset()
    first = step()
    with pytest.raises(type(error)):
        step()
    for _ in range(2):
        with pytest.raises(ResetNeeded, match="interrupted"):
            step()
    reset()
    assert step() == first


def test_a_refused_action_after_a_step_needs_no_reset():
    environment = Environment(tasks.MicrowaveTableTask(entities.build_microwave_table_scene(visuals=False)))
    environment.reset()
    environment.step(np.zeros(8))
    with pytest.raises(ValueError, match="action"):
        environment.step(np.full(8, np.nan))
    assert environment.step(np.zeros(8)).mid()


def test_the_state_of_a_step_that_was_interrupted_is_of_no_episode():
    task = with_term("extra_rewards", failing_once(ZeroDivisionError()))
    env = SuiteEnv(domain=_temporary("microwave_table", task))
    env.reset(seed=0)
    before = env.get_state()
    env.step(np.zeros(8))
    with pytest.raises(ZeroDivisionError):
        env.step(np.zeros(8))
    with pytest.raises(ValueError, match="of no episode"):
        env.reset(options={"state": env.get_state()})
    env.reset(options={"state": before})
    assert env.step(np.zeros(8))[4]["episode_step"] == 1


# Mixing of the environments of a batch


def speeds(step):
    return np.abs(step.after.joint_velocities)


def slowed(simulation, state, **axis):
    """Velocities in comparison with the greatest one."""
    return state.joint_velocities / (1.0 + np.abs(state.joint_velocities).max(**axis))


def ended(step, **axis):
    return np.full(step.action.shape[:-1], (speeds(step) > 2.0).any(**axis))


# By what differs: a term that mixes the environments of a batch, and one that computes each alone.
MIXING = {
    "reward/x": (
        {"extra_rewards": {"x": lambda step: -(speeds(step) / speeds(step).max()).max(axis=-1)}},
        {"extra_rewards": {"x": lambda step: -(speeds(step) / speeds(step).max(axis=-1, keepdims=True)).max(axis=-1)}},
    ),
    "termination": (
        {"extra_terminations": {"x": ended}},
        {"extra_terminations": {"x": lambda step: ended(step, axis=-1)}},
    ),
    "observation": (
        {"extra_observations": {"x": Observation(slowed)}},
        {"extra_observations": {"x": Observation(lambda *state: slowed(*state, axis=-1, keepdims=True))}},
    ),
}


@pytest.mark.full
@pytest.mark.parametrize("what", MIXING)
def test_what_mixes_the_environments_of_a_batch_is_refused_at_registration(what):
    mixing, alone = (type("Mine", (tasks.MicrowaveTableTask,), attributes) for attributes in MIXING[what])
    with (
        refused(ValueError, what.partition("/")[0], "single", "vectorised", "reducing along the last axis"),
        registered("microwave_table", mixing),
    ):
        pass
    with registered("microwave_table", alone) as record:
        assert suite.DOMAINS[record.name] is record


@pytest.mark.full
def test_what_mixes_three_environments_alone_is_refused_at_registration():
    def lowest(step):
        value = step.action[..., 0]
        return value - np.median(value) if value.size >= 3 else value

    with (
        refused(ValueError, "reward after step 1", "single", "vectorised"),
        registered("microwave_table", with_term("extra_rewards", lowest)),
    ):
        pass


@pytest.mark.full
def test_nan_of_an_observation_is_the_same_in_all_environments_at_registration():
    observations = {"x": Observation(lambda simulation, state: np.full_like(state.joint_velocities, np.nan))}
    task = type("Mine", (tasks.MicrowaveTableTask,), {"extra_observations": observations})
    with registered("microwave_table", task) as record:
        assert np.isnan(gymnasium.make(record.env_id).unwrapped.reset(seed=0)[0]).any()


@pytest.mark.full
@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("base", [tasks.MicrowaveTableTask, tasks.KitchenTask])
def test_a_reward_that_is_not_finite_is_refused_at_registration(value, base):
    domain = next(name for name, (_, task, _) in DOMAINS.items() if task is base)
    task = type("Mine", (base,), {"extra_rewards": {"x": lambda step: np.full(step.action.shape[:-1], value)}})
    with refused(ValueError, "'x' of the reward", "must be finite", str(value)), registered(domain, task):
        pass
    assert not [name for name in suite.DOMAINS if name.startswith("custom_")]


@pytest.mark.full
def test_a_reward_that_is_infinite_in_another_environment_of_a_batch_is_refused_at_registration():
    """The environment that is compared has a reward of 0."""

    def far(step):
        up = step.action[..., 0]
        return np.where(up == up.ravel()[0], 0.0, np.inf)

    with (
        refused(ValueError, "'x' of the reward", "must be finite", "inf"),
        registered("microwave_table", with_term("extra_rewards", far)),
    ):
        pass


@pytest.mark.parametrize("attribute", ["extra_terminations", "extra_successes"])
@pytest.mark.parametrize("value", [np.nan, 0.0, 1])
def test_a_termination_that_is_no_bool_is_refused(attribute, value):
    environment = loaded_with(attribute, lambda step: np.full(step.action.shape[:-1], value))
    environment.reset()
    with refused(TypeError, f"{attribute}['x'] must return bools"):
        environment.step(np.zeros(8))


def loaded_with(attribute, term):
    task = with_term(attribute, term)
    domain = suite.Domain(
        "mine",
        scene=entities.build_microwave_table_scene,
        task=task,
        tasks={"one": {}},
        env_id="Mine/A-v1",
        episode_steps=9,
    )
    return domain.load(visuals=False)


def overwrite(array):
    array[...] = 0.0


# By what a term writes into.
WRITES = {
    "the action": lambda step: overwrite(step.action),
    "the state after": lambda step: overwrite(step.after.observation),
    "the state before": lambda step: overwrite(step.before.target),
    "an observation": lambda step: overwrite(step.observations["velocities"]),
    "an observation before": lambda step: overwrite(step.previous_observations["velocities"]),
}


@pytest.mark.parametrize(
    ("attribute", "what"),
    [
        *(("extra_rewards", what) for what in WRITES),
        *((name, "the action") for name in ("extra_terminations", "extra_successes")),
    ],
)
def test_a_term_that_writes_into_a_step_is_refused(attribute, what):
    def writes(step):
        WRITES[what](step)
        return np.zeros(step.action.shape[:-1], bool)

    velocities = {"velocities": Observation(lambda simulation, state: state.joint_velocities)}
    task = type("Mine", (tasks.MicrowaveTableTask,), {attribute: {"x": writes}, "extra_observations": velocities})
    environment = Environment(task(entities.build_microwave_table_scene(visuals=False)), random_state=0)
    environment.reset()
    with refused(ValueError, f"{attribute}['x'] must not write into", "write into a copy"):
        environment.step(np.zeros(8))
    # Which helps.
    assert terms.read_only(np.ones(2)).copy().flags.writeable


def test_an_observation_that_writes_into_the_state_is_refused():
    def writes(simulation, state):
        state.observation[...] = 0.0
        return state.observation[..., :1]

    task = type("Mine", (tasks.MicrowaveTableTask,), {"extra_observations": {"x": Observation(writes)}})
    with refused(ValueError, "extra_observations['x'] must not write into"):
        Environment(task(entities.build_microwave_table_scene(visuals=False)), random_state=0).reset()


@pytest.mark.full
def test_a_term_that_reads_a_missing_observation_is_named_at_registration():
    task = type(
        "Mine",
        (tasks.MicrowaveTableTask,),
        {
            "extra_rewards": {"lifted": lambda step: step.observations["mug_position"][..., 2]},
            "extra_observations": {"cup_position": Observation(lambda simulation, state: state.joint_velocities)},
        },
    )
    with (
        refused(ValueError, "extra_rewards['lifted'] reads 'mug_position'", "['cup_position']"),
        registered("microwave_table", task),
    ):
        pass


# Last digits, which depend on the number of environments in some functions of NumPy.


def velocities(step):
    return step.after.joint_velocities


@pytest.mark.full
def test_a_norm_along_the_last_axis_is_equal_in_a_batch():
    """The joint velocities of a batch are columns of an array in Fortran order, whose sums have other last digits."""
    with registered(
        "microwave_table", with_term("extra_rewards", lambda step: np.linalg.norm(velocities(step), axis=-1))
    ):
        pass


def root(values):
    """A power of numbers in one digit that differs on some processors, as that of NumPy does."""
    return np.float64(np.nextafter(np.power(values, 0.37), np.inf)) if values.ndim == 0 else np.power(values, 0.37)


@pytest.mark.full
def test_a_term_that_differs_in_its_last_digit_is_refused_with_a_remedy_that_helps():
    with (
        refused(ValueError, "np.power(x, p)", "np.sqrt(np.ascontiguousarray(x * x).sum(-1))"),
        registered("microwave_table", with_term("extra_rewards", lambda step: root(np.abs(velocities(step)[..., 0])))),
    ):
        pass

    def remedied(step):
        x = velocities(step)
        return np.power(np.abs(x[..., 0]), 0.37) + np.sqrt(np.ascontiguousarray(x * x).sum(-1))

    with registered("microwave_table", with_term("extra_rewards", remedied)) as record:
        assert suite.DOMAINS[record.name] is record


# Warnings of registration


@pytest.mark.full
@pytest.mark.parametrize("attribute", ["extra_rewards", "extra_terminations"])
def test_a_class_that_leaves_its_success_to_the_domains_tasks_is_warned_of(attribute):
    task = with_term(attribute, lambda step: np.full(step.action.shape[:-1], False))
    with (
        pytest.warns(UserWarning, match=r"Mine adds \['x'\].* success is still that of .*extra_successes"),
        registered("microwave_table", task),
    ):
        pass
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        followed = {"extra_successes": {"far": lambda step: np.full(step.action.shape[:-1], False)}}
        with registered("microwave_table", type("Mine", (task,), followed)):
            pass


@pytest.mark.full
def test_a_reward_of_an_mdp_that_has_no_number_for_each_environment_is_refused_at_registration():
    lever = load_script("examples/my_domain")

    def task_with(term):
        class Task(lever.LeverTask):
            def __init__(self, scene, **options):
                super().__init__(scene, **options)
                self.mdp = dataclasses.replace(self.mdp, rewards={**self.mdp.rewards, "time": term})

        return Task

    def register(term):
        record = suite.Domain(
            "mine",
            scene=lever.build_lever_scene,
            task=task_with(term),
            tasks={"one": {}},
            env_id="Custom/Mine-v1",
            episode_steps=9,
        )
        suite.register(record)
        del suite._domains["mine"]
        for env_id in {record.env_id, *record.task_ids.values()}:
            del gymnasium.registry[env_id]

    with refused(ValueError, "shape in a batch of info['reward/time']", "(3,)", "()"):
        register(lambda step: -0.01)
    register(lambda step: np.full(step.action.shape[:-1], -0.01))


# Hooks


HOOKS = (
    *("get_reward", "get_discount", "should_terminate_episode", "before_step", "after_step", "before_substep"),
    *("after_substep", "action_spec", "task_observables", "observables", "initialize_episode_mjcf"),
)


@pytest.mark.parametrize("base", BASES)
def test_a_hook_that_would_act_in_composer_alone_is_refused_when_the_class_is_made(base):
    for hook in HOOKS:
        attributes = {hook: lambda self, *arguments: 0.0}
        with refused(TypeError, "Mine", hook, "vectorised"):
            type("Mine", (base,), attributes)
        # Inherited from a mixin as well.
        with refused(TypeError, "Mine", hook):
            type("Mine", (type("Mixin", (), attributes), base), {})


class HookedProp(Primitive):
    def after_step(self, physics, random_state):
        self.steps = getattr(self, "steps", 0) + 1


class ObservedProp(Primitive):
    def _build_observables(self):
        observables = super()._build_observables()
        observables.get_observable("position").enabled = True
        return observables


ENTITIES = [(domain, *case) for domain in DOMAINS for case in ((HookedProp, "after_step"), (ObservedProp, "position"))]


@pytest.mark.full
@pytest.mark.parametrize(("domain", "prop", "word"), brief(ENTITIES, kept=ENTITIES[:2], full=ENTITIES[2:]))
def test_entities_that_a_batch_would_ignore_are_refused_in_vectors_and_at_registration(domain, prop, word):
    _, base, place = DOMAINS[domain]

    class Task(base):
        def __init__(self, scene, **options):
            scene.attach(prop(geom_type="sphere", size=(0.02,), name="ball"), pos=place)
            super().__init__(scene, **options)

    with refused(ValueError, "ball", word), registered(domain, Task):
        pass
    assert not [name for name in suite.DOMAINS if name.startswith("custom_")]


# Bad input


@pytest.mark.parametrize(
    ("observations", "error", "words"),
    [
        ({"a": lambda simulation, state: 0.0}, TypeError, "Observation"),
        ({"a/": Observation(position)}, ValueError, "names as keys"),
        ({"a": Observation(lambda simulation, state: np.zeros(()))}, ValueError, "shape"),
        ({"a": Observation(lambda simulation, state: np.zeros((2, 3)))}, ValueError, "shape"),
        ({"a": Observation(lambda simulation, state: simulation.named("xpos", "no"))}, ValueError, "'no'"),
        ({"a": Observation(lambda simulation, state: simulation.named("no", "x"))}, ValueError, "field"),
        ([], TypeError, "dict"),
    ],
)
def test_observations_that_cannot_be_are_refused(observations, error, words):
    build, base, _ = DOMAINS["microwave_table"]
    task = type("Mine", (base,), {"extra_observations": observations})
    domain = suite.Domain("mine", scene=build, task=task, tasks={"one": {}}, env_id="Mine/A-v1", episode_steps=9)
    with pytest.raises(error, match=words):
        domain.load(visuals=False).reset()


@pytest.mark.parametrize(("domain", "taken"), [("kitchen", "object_positions"), ("open_cabinet", "drawer_position")])
def test_observations_must_not_take_the_names_of_the_tasks_own(domain, taken):
    build, base, _ = DOMAINS[domain]
    task = type("Mine", (base,), {"extra_observations": {taken: Observation(lambda simulation, state: [0.0])}})
    with refused(ValueError, "other names", taken):
        task(build(visuals=False))


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
@pytest.mark.parametrize("kind", ["observable of an attached entity", "observable of the robot", "picture"])
def test_observations_must_not_take_names_under_which_composer_observes_something_else(domain, kind):
    build, base, place = DOMAINS[domain]
    taken, free = {
        "observable of an attached entity": ("mug/position", "mug/place"),
        "observable of the robot": ("franka/end_effector_position", "franka/hand"),
        "picture": ("mug/depth", "mug/deep"),
    }[kind]

    def task_with(name):
        class Task(base):
            extra_observations = {name: Observation(position)}

            def __init__(self, scene, **options):
                scene.attach(mug(), pos=place)
                scene.arena.mjcf_model.worldbody.add("camera", name="mug", pos=(0.0, 0.0, 3.0))
                super().__init__(scene, **options, cameras=["mug"], depth=True)

        return Task(build(visuals=False))

    with refused(ValueError, "extra_observations must have other names", "entities", "pictures", f"['{taken}']"):
        task_with(taken)
    environment = Environment(task_with(free))
    # Without the pictures, nothing is rendered.
    for picture in environment.task.pictures.by_name.values():
        picture.enabled = False
    timestep = environment.reset()
    np.testing.assert_array_equal(np.ravel(timestep.observation[free]), environment.physics.named.data.xpos["mug/"])


def test_attributes_of_an_observation_are_checked():
    with refused(TypeError, "read"):
        Observation(3)
    with refused(TypeError, "noise"):
        Observation(position, noise=0.1)


# Edits


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_an_edit_of_the_mjcf_acts_at_the_next_reset_of_single_environments(domain):
    environment = suite.load(domain, suite.default_task(domain), {"random": 0, "visuals": False})
    environment.reset()
    physics = environment.physics
    environment.reset()
    assert environment.physics.model.ptr is physics.model.ptr
    environment.task.root_entity.mjcf_model.option.gravity = (0.0, 0.0, -1.0)
    environment.reset()
    assert environment.physics.model.opt.gravity[2] == -1.0
    environment.task.root_entity.mjcf_model.option.gravity[2] = -2.0
    environment.reset()
    assert environment.physics.model.opt.gravity[2] == -2.0
    world = environment.task.root_entity.mjcf_model.worldbody
    world.add("geom", type="sphere", size=(0.01,), pos=(0, 0, 9), name="new")
    timestep = environment.reset()
    assert environment.physics.named.model.geom_size["new"][0] == 0.01
    assert environment.step(np.zeros(environment.action_spec().shape)).observation.keys() == timestep.observation.keys()
    world.geom["new"].remove()
    environment.reset()
    with pytest.raises(KeyError):
        environment.physics.named.model.geom_size["new"]
    # In a model that is attached.
    body = environment.task.robot.mjcf_model.find_all("body")[0]
    for value in (0.25, None):
        body.gravcomp = value
        environment.reset()
        assert environment.physics.bind(body).gravcomp == (value or 0.0)


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_an_edit_of_the_mjcf_is_refused_by_vectors(domain):
    envs = gymnasium.make_vec(suite.DOMAINS[domain].env_id, 2, num_threads=1).unwrapped
    envs.reset(seed=0)
    envs.template_env.environment.task.root_entity.mjcf_model.option.gravity = (0.0, 0.0, -1.0)
    with pytest.raises(RuntimeError, match="MJCF of the scene has been edited"):
        envs.reset()


EDITS = [
    (domain, edit, when)
    for domain in DOMAINS
    for edit in ("opt.gravity", "geom_friction", "body_mass")
    for when in ("between episodes", "before the first reset")
]


@pytest.mark.full
@pytest.mark.parametrize(("domain", "edit", "when"), brief(EDITS, kept=[EDITS[0], EDITS[-1]], full=EDITS[1:-1]))
def test_an_edit_of_the_compiled_model_acts_in_single_and_vectorised_environments(domain, edit, when):
    def change(environment):
        model = environment.physics.model
        if edit == "opt.gravity":
            model.opt.gravity[:] = (1.0, 0.5, -3.0)
        else:
            getattr(model, edit)[:] *= 0.5
        if edit == "body_mass":
            # What the stiffness of contacts follows from; without it, free objects that are held by friction jump.
            mujoco.mj_setConst(model.ptr, environment.physics.data.ptr)

    env_id = suite.DOMAINS[domain].env_id
    env, envs = gymnasium.make(env_id), gymnasium.make_vec(env_id, 2, num_threads=1)
    plain = gymnasium.make(env_id)
    single, template = env.unwrapped.environment, envs.unwrapped.template_env.environment
    if when == "between episodes":
        env.reset(seed=5)
        envs.reset(seed=5)
    change(single)
    change(template)
    observation, _ = env.reset(seed=1)
    many, _ = envs.reset(seed=0)
    plain.reset(seed=1)
    np.testing.assert_array_equal(numbers(many)[1], numbers(observation))
    for _ in range(12):
        action = np.full(env.action_space.shape, 0.3, np.float32)
        observation, many, other = env.step(action)[0], envs.step(np.stack([action] * 2))[0], plain.step(action)[0]
        np.testing.assert_array_equal(numbers(many)[1], numbers(observation))
    if edit != "geom_friction":
        assert not np.array_equal(numbers(other), numbers(observation))


def heavier(field):
    class Task(tasks.KitchenTask):
        """The kettle's mass, or gravity, is drawn at each reset, in a task's own way."""

        def reset_physics(self, physics, random_state):
            super().reset_physics(physics, random_state)
            if field == "opt.gravity":
                physics.model.opt.gravity[2] = random_state.uniform(-12.0, -6.0)
            else:
                physics.named.model.body_mass["kettle/kettle"] = random_state.uniform(0.5, 2.0)

    return Task


@pytest.mark.full
@pytest.mark.parametrize("field", ["opt.gravity", "body_mass"])
def test_what_a_tasks_reset_writes_into_the_model_differs_from_environment_to_environment(field):
    with registered("kitchen", heavier(field)) as record:
        envs = gymnasium.make_vec(record.env_id, 3, num_threads=2)
        singles = [gymnasium.make(record.env_id) for _ in range(3)]
        many, _ = envs.reset(seed=4)
        ones = [env.reset(seed=4 + i)[0] for i, env in enumerate(singles)]
        for _ in range(2):
            for i, one in enumerate(ones):
                np.testing.assert_array_equal(numbers(many)[i], numbers(one))
            action = np.full(9, -0.5)
            for _ in range(8):
                many, ones = envs.step(np.stack([action] * 3))[0], [env.step(action)[0] for env in singles]
            for i, one in enumerate(ones):
                np.testing.assert_array_equal(numbers(many)[i], numbers(one))
            many, ones = envs.reset()[0], [env.reset()[0] for env in singles]


class Slippery(tasks.KitchenTask):
    """In one episode of two all friction is that of the built scene, in the others less."""

    def reset_physics(self, physics, random_state):
        super().reset_physics(physics, random_state)
        is_slippery = random_state.uniform() < 0.5
        physics.model.geom_friction[:, 0] = 0.1 if is_slippery else 1.0


@pytest.mark.full
@pytest.mark.parametrize("mode", brief(["Disabled", "SameStep"], kept=["SameStep"], full=["Disabled"]))
def test_a_reset_may_write_what_the_built_model_has_whatever_the_first_draw(mode, monkeypatch):
    original = gymnasium.utils.seeding.np_random
    name, frictions = _temporary("kitchen", Slippery), set()
    for first in range(4):
        # The first draw of all, which is made while the vector is built.
        monkeypatch.setattr(
            gymnasium.utils.seeding, "np_random", lambda seed=None, own=first: original(own if seed is None else seed)
        )
        single = SuiteEnv(domain=name)
        envs = SuiteVectorEnv(
            2, domain=name, num_threads=1, max_episode_steps=1, autoreset_mode=mode, episode_seeds=True
        )
        envs.reset(seed=0)
        for number in range(6):
            for i in range(2):
                single.reset(seed=2 * number + i)
                friction = envs._episodes.batch.get_model(i).geom_friction
                np.testing.assert_array_equal(friction, single.environment.physics.model.geom_friction)
                frictions.add(friction[0, 0])
            # Each starts the next episodes, with the next seeds.
            if mode == "Disabled":
                envs.reset()
            else:
                envs.step(np.zeros(envs.action_space.shape))
    assert frictions == {0.1, 1.0}


@pytest.mark.full
@pytest.mark.parametrize("domain", DOMAINS)
def test_resets_of_the_suites_own_tasks_write_nothing_into_the_model(domain):
    """Otherwise every simulation would have fields of its own, for nothing."""
    envs = gymnasium.make_vec(suite.DOMAINS[domain].env_id, 2, num_threads=1).unwrapped
    assert envs._episodes._model_fields == {}
    assert isinstance(envs.template_env, SuiteEnv)
