"""Offline reinforcement learning: from all episodes of a recording, with their rewards or with goals in hindsight."""

import json

import numpy as np
import pytest

from kitchen_suite.commands.commands import evaluate, record, train
from kitchen_suite.policies import load_policy
from kitchen_suite.settings import OFFLINE

pytestmark = pytest.mark.clients

SMALL = {
    "width": 32,
    "blocks": 1,
    "chunk": 1,
    "executed": 1,
    "batch_size": 128,
    "averaging": 0.9,
    "learning_rate": 3e-3,
}
METADATA = {"domain_name": "kitchen", "task_name": "all", "task_kwargs": {}}
GOALS = ("gcbc", "gciql")
REWARDS = tuple(name for name in OFFLINE if name not in GOALS)
ELEMENTS = (0, 1)
# What a checkpoint says of evaluations, of which there were none.
NOTHING = {"seconds": 0.0, "processor_seconds": 0.0, "best": (0.0, 0.0), "progress": 0.0, "successes": []}


def corridor(count=200, length=12):
    """Returns episodes of walks on a plane, of which half go to the right at every step and are rewarded for it.

    The state is the place and a constant, the action the step, which is made with a small error.
    """
    from kitchen_suite.training.transitions import Transitions

    generator = np.random.default_rng(0)
    right = np.arange(count) % 2 == 0
    directions = np.where(right[:, np.newaxis], [1.0, 0.0], [-1.0, 0.0])
    actions = directions[:, np.newaxis] + 0.1 * generator.standard_normal((count, length, 2))
    places = np.concatenate([np.zeros((count, 1, 2)), actions.cumsum(axis=1)], axis=1)
    inputs = np.concatenate([places, np.ones((count, length + 1, 1))], axis=2)
    # All walk on the same places, so that only rewards tell them apart.
    inputs[..., 0] = np.abs(inputs[..., 0])
    rows = np.arange(count)[:, np.newaxis] * (length + 1) + np.arange(length)
    return Transitions(
        inputs=inputs.reshape(-1, 3).astype(np.float32),
        actions=actions.reshape(-1, 2).astype(np.float32),
        rows=rows.ravel(),
        last=np.repeat(np.arange(count) * (length + 1) + length, length),
        rewards=np.repeat(right, length).astype(np.float32),
        terminations=np.zeros(count * length, bool),
    )


def forks(count=300, length=8):
    """Returns walks from one place in four directions, in which only the goal says where to go."""
    from kitchen_suite.training.transitions import Transitions

    generator = np.random.default_rng(0)
    directions = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])[np.arange(count) % 4]
    actions = directions[:, np.newaxis] + 0.1 * generator.standard_normal((count, length, 2))
    inputs = np.concatenate([np.zeros((count, 1, 2)), actions.cumsum(axis=1)], axis=1)
    rows = np.arange(count)[:, np.newaxis] * (length + 1) + np.arange(length)
    return Transitions(
        inputs=inputs.reshape(-1, 2).astype(np.float32),
        actions=actions.reshape(-1, 2).astype(np.float32),
        rows=rows.ravel(),
        last=np.repeat(np.arange(count) * (length + 1) + length, length),
        rewards=np.zeros(count * length, np.float32),
        terminations=np.zeros(count * length, bool),
    )


def learner(algorithm, transitions, num_steps=600, seed=0, **changes):
    import torch

    from kitchen_suite.training.hyperparameters import checked_changes
    from kitchen_suite.training.offline import OFFLINE_METHODS
    from kitchen_suite.training.recorded import OfflineLearner

    torch.set_num_threads(1)
    method = OFFLINE_METHODS[algorithm]
    config = checked_changes(method.hyperparameters(), {"n_step": 1, **SMALL, **changes})
    goals = ELEMENTS if method.reaches_goals else ()
    metadata = {"state_size": transitions.inputs.shape[1], "tasks": [], "goal_size": len(goals)}
    return OfflineLearner(
        transitions, method, config, num_steps=num_steps, seed=seed, goal_elements=goals, metadata=metadata
    )


def taught(*arguments, num_steps=600, **options):
    """Returns the policy that a learner exports at its end."""
    each = learner(*arguments, num_steps=num_steps, **options)
    while each.steps < num_steps:
        assert np.isfinite([*each.learn().values()]).all()
    return each.export(METADATA)


def chosen(policy, *inputs):
    """Returns the actions `(b, k)` on some inputs."""
    return np.array([policy.predict(np.array(each), np.random.default_rng(0))[0] for each in inputs])


def test_cloning_does_not_tell_good_from_bad():
    data = corridor()
    one, other = (taught("offline_bc", each).arrays for each in (data, data._replace(rewards=1.0 - data.rewards)))
    for name in one:
        np.testing.assert_array_equal(one[name], other[name])


@pytest.mark.parametrize(
    ("algorithm", "changes"), [("iql", {"discount": 0.9}), ("idql", {"discount": 0.9}), ("td3bc", {"bc_weight": 0.1})]
)
def test_what_was_rewarded_is_done(algorithm, changes):
    actions = chosen(taught(algorithm, corridor(), **changes), [0.0, 0.0, 1.0], [2.0, 0.0, 1.0])
    assert actions[:, 0].min() > 0.6


@pytest.mark.parametrize("algorithm", GOALS)
def test_goals_say_where_to_go(algorithm):
    policy = taught(algorithm, forks(), num_steps=800, discount=0.8)
    assert policy.given.goal_size == len(ELEMENTS)
    ends = np.array([[6.0, 0.0], [-6.0, 0.0], [0.0, 6.0], [0.0, -6.0]])
    actions = chosen(policy, *(np.concatenate([[0.0, 0.0], end]) for end in ends))
    # In the direction of the goal, by about the step of the data.
    assert (actions * ends / 6.0).sum(axis=1).min() > 0.6
    assert np.abs((actions * ends[:, ::-1] / 6.0).sum(axis=1)).max() < 0.4


def sampler(transitions, *, goals=False, **changes):
    """Returns a sampler of transitions whose inputs and actions are left as they are."""
    import torch

    from kitchen_suite.training.hyperparameters import OfflineHyperparameters
    from kitchen_suite.training.transitions import GoalSampler, Sampler

    torch.manual_seed(0)
    config = OfflineHyperparameters(**{"batch_size": 4000, "discount": 0.8, "chunk": 3, "n_step": 4, **changes})
    recorded = (transitions, transitions.inputs, transitions.actions, config)
    return GoalSampler(*recorded, elements=ELEMENTS) if goals else Sampler(*recorded)


def steps_of(batch, transitions):
    """Returns which steps `(b,)` of transitions the rows of a batch are."""
    states, actions = batch.inputs.numpy()[:, : transitions.inputs.shape[1]], batch.chunks.numpy()
    size = transitions.actions.shape[1]
    index = {
        (transitions.inputs[row].tobytes(), action.tobytes()): step
        for step, (row, action) in enumerate(zip(transitions.rows, transitions.actions, strict=True))
    }
    return np.array(
        [index[state.tobytes(), action[:size].tobytes()] for state, action in zip(states, actions, strict=True)]
    )


def test_batches_have_the_rewards_of_the_next_steps_up_to_a_success():
    data = corridor()
    generator = np.random.default_rng(1)
    # Some episodes end with success, and all rewards differ.
    success = (data.rows + 1 == data.last) & (data.last % 3 == 0)
    data = data._replace(terminations=success, rewards=generator.random(len(data.rows)).astype(np.float32))
    batch, shown = sampler(data, batch_size=500).draw()
    assert shown is batch
    for row, step in enumerate(steps_of(batch, data)):
        ahead = min(4, data.last[step] - data.rows[step])
        chosen = data.actions[[min(step + i, step + data.last[step] - data.rows[step] - 1) for i in range(3)]]
        np.testing.assert_array_equal(batch.chunks[row], chosen.ravel())
        np.testing.assert_array_equal(batch.later_inputs[row], data.inputs[data.rows[step] + ahead])
        np.testing.assert_allclose(
            batch.rewards[row], sum(0.8**i * data.rewards[step + i] for i in range(ahead)), rtol=1e-5
        )
        ended = success[step : step + ahead].any()
        np.testing.assert_allclose(batch.discounts[row], 0.0 if ended else 0.8**ahead, rtol=1e-6)


def test_goals_of_batches_are_reached_later_in_the_same_episode():
    data = forks()
    batch, shown = sampler(data, goals=True).draw()
    state, goal = shown.inputs[:, :2].numpy(), shown.inputs[:, 2:].numpy()
    along = shown.chunks[:, :2].numpy().round()
    assert (((goal - state) * along).sum(axis=1) > 0).all()
    # A fifth of the goals of values is the next state, and three in ten are of any episode, mostly elsewhere.
    wanted = batch.inputs[:, 2:].numpy()
    elsewhere = ((wanted - state) * along).sum(axis=1) <= 0
    assert 0.1 < elsewhere.mean() < 0.35
    steps = steps_of(batch, data)
    for row, step in enumerate(steps[:800]):
        left = data.last[step] - data.rows[step]
        places = data.inputs[data.rows[step] + 1 : data.rows[step] + 1 + min(4, left)]
        near = np.flatnonzero(np.linalg.norm(places - wanted[row], axis=1) <= 0.1)
        ahead = near[0] + 1 if near.size else len(places)
        np.testing.assert_array_equal(batch.later_inputs[row, :2], places[ahead - 1])
        # -1 a step, but for the one that arrives, after which nothing is to be had.
        costs = ahead - 1 if near.size else ahead
        np.testing.assert_allclose(batch.rewards[row], -sum(0.8**i for i in range(costs)), rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(batch.discounts[row], 0.0 if near.size else 0.8**ahead, rtol=1e-6)
    assert 0.2 < (batch.discounts == 0.0).float().mean() < 0.7


@pytest.mark.parametrize("algorithm", OFFLINE)
def test_an_interrupted_run_goes_on_to_the_bit(algorithm):
    from kitchen_suite.training.checkpoints import Checkpoint

    data = forks() if algorithm in GOALS else corridor()

    def started(steps):
        each = learner(algorithm, data, num_steps=400, seed=3)
        while each.steps < steps:
            each.learn()
        return each

    whole, half = started(400), Checkpoint(**started(200).state(), **NOTHING)
    second = started(0)
    second.load_state(half)
    while second.steps < 400:
        second.learn()
    one, other = whole.export(METADATA).arrays, second.export(METADATA).arrays
    assert one.keys() == other.keys()
    for name in one:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("set") / "mixed"
    flags = ("--preset=mixed", "--num_episodes=3", "--max_episode_steps=140", "--num_threads=1")
    assert record.main([f"--output={folder}", *flags]) == 0
    return folder


FEW = ("--num_steps=20", "--eval_interval=20", "--eval_episodes=2", "--max_episode_steps=20", "--num_threads=1")


@pytest.mark.parametrize("algorithm", OFFLINE)
def test_a_run_learns_from_failed_episodes_and_its_policy_acts(run, tmp_path, recording, algorithm):
    goals = (
        ["--task_name=random_1", '--task_kwargs={"goal_states": 1}'] if algorithm in GOALS else ["--task_name=mixed"]
    )
    output = tmp_path / "run"
    flags = [flag for flag in FEW if not flag.startswith("--max")]
    flags += [f"--hyperparameters={json.dumps({'width': 16, 'batch_size': 32})}"]
    status, out, _ = run(
        train, *goals, f"--algorithm={algorithm}", f"--demonstrations={recording}", f"--output={output}", *flags
    )
    assert status == 0
    assert "20 steps of the optimiser" in out
    policy = load_policy(output / "policy.npz")
    assert policy.given.chunk == 8
    last = load_policy(output / "seed_0" / "last_policy.npz")
    assert last.metadata["training"]["steps"] == 20
    name = f"trained(file={str(output / 'policy.npz')!r})"
    episodes = ("--num_episodes=2", "--max_episode_steps=10", "--num_threads=1")
    assert run(evaluate, *goals, f"--policy={name}", *episodes)[0] == 0


def test_what_does_not_fit_is_refused_in_one_line(refusal, tmp_path, recording):
    def refused(*flags):
        return refusal(train, f"--output={tmp_path / 'run'}", *FEW[:3], *flags)

    own = f"--demonstrations={recording}"
    assert "--demonstrations" in refused("--task_name=mixed", "--algorithm=iql")
    # Rewards of another task.
    assert "tasks_to_complete" in refused("--task_name=complete", "--algorithm=iql", own)
    for changed in ('{"success": "strict"}', '{"remove_task_when_completed": false}', '{"threshold": 0.2}'):
        name = changed.split('"')[1]
        assert name in refused("--task_name=mixed", "--algorithm=iql", own, f"--task_kwargs={changed}")
    for discount in (0, 1):
        flags = ("--task_name=random_1", '--task_kwargs={"goal_states": 1}', "--algorithm=gcbc", own)
        problem = refused(*flags, f'--hyperparameters={{"discount": {discount}}}')
        assert "goals need a discount between 0 and 1" in problem
    assert "goal states" in refused("--task_name=random_1", "--algorithm=gcbc", own)
    assert "3 episodes, not 4" in refused("--task_name=mixed", "--algorithm=iql", own, "--num_demonstrations=4")
    assert "expertile" in refused("--task_name=mixed", "--algorithm=iql", own, '--hyperparameters={"expertile": 0.5}')
    assert "temperature" in refused(
        "--task_name=mixed", "--algorithm=td3bc", own, '--hyperparameters={"temperature": 1}'
    )
    assert "--training_kwargs is for" in refused(
        "--task_name=mixed", "--algorithm=iql", own, '--training_kwargs={"physics": "fast"}'
    )


def test_a_policy_for_goals_needs_a_goal(run, refusal, tmp_path, recording):
    output = tmp_path / "run"
    flags = ("--task_name=random_1", '--task_kwargs={"goal_states": 1}', "--algorithm=gcbc")
    small = f"--hyperparameters={json.dumps({'width': 16, 'batch_size': 32})}"
    arguments = (*flags, f"--demonstrations={recording}", f"--output={output}", small, *FEW[:3])
    assert run(train, *arguments)[0] == 0
    name = f"trained(file={str(output / 'policy.npz')!r})"
    error = refusal(evaluate, "--task_name=random_1", f"--policy={name}", "--num_episodes=1")
    assert "the policy needs a goal state in the observation" in error
