"""Policies for the cabinet whose actions depend on what they have seen before in the episode.

Some episodes end after a few control steps, since the arm moves too fast: environments are then filled again at
different times, while queues are not empty.
"""

import contextlib
import functools

import dm_env
import numpy as np

from kitchen_suite import EnvironmentSpec

EPISODES, LIMIT = 20, 24
SPEC = EnvironmentSpec.make("open_cabinet", None, {"variations": ["start"]}, LIMIT)
ROBOT = 8  # Elements of the joints' positions, and of the action.
FAST = 4.0  # An action that ends the episode.


def joints(given):
    """The positions of the joints in a time step, or in an observation of the Gymnasium environment."""
    if isinstance(given, dm_env.TimeStep):
        return given.observation["joint_positions"].astype(np.float64)
    return given[:ROBOT].astype(np.float64)


class Chunks:
    """Plays eight actions, then looks again, as an action-chunking transformer does."""

    def __init__(self):
        self._waiting = []

    def reset(self):
        self._waiting.clear()

    def __call__(self, given):
        if not self._waiting:
            self._waiting.extend(chunk(joints(given)))
        return self._waiting.pop(0)


def chunk(seen):
    """Eight actions that follow positions of the joints."""
    moves = [0.5 * np.sin(50.0 * seen + number) for number in range(8)]
    return [move + FAST * (np.sin(300.0 * seen[0] + number) > 0.95) for number, move in enumerate(moves)]


class Recurrent:
    """Acts by a hidden state, of which each element depends on all observations of the episode."""

    def __init__(self):
        self._hidden = np.zeros(ROBOT)

    def reset(self):
        self._hidden = np.zeros(ROBOT)

    def __call__(self, given):
        self._hidden = np.tanh(0.9 * np.roll(self._hidden, 1) + 3.0 * np.sin(30.0 * joints(given)))
        return 0.5 * self._hidden + FAST * (np.abs(self._hidden).mean() > 0.9)

    def act(self, given):
        return self(given)


class Rows:
    """Acts in many environments by a policy of a class for each row, and keeps the rows that it was told of."""

    def __init__(self, policy):
        self._policy, self._by_row, self.told = policy, {}, []

    def reset(self, rows):
        self.told.append(rows.tolist())
        self._by_row |= {row: self._policy() for row in rows.tolist()}

    def __call__(self, observations):
        # Rows without an episode may have none yet.
        return np.stack([self._by_row.get(row, self._policy())(each) for row, each in enumerate(observations)])


class RowsOfChunks(Rows):
    def __init__(self):
        super().__init__(Chunks)


class RowsOfRecurrent(Rows):
    def __init__(self):
        super().__init__(Recurrent)


def make_chunks():
    return Chunks()


@functools.cache
def alone(policy):
    """The actions of each seed, of a new policy in an environment that plays this episode alone."""
    found = {}
    environment = SPEC.make_environment()
    with contextlib.closing(environment):
        for seed in range(EPISODES):
            act, actions, has_ended = policy(), [], False
            observation, _ = environment.reset(seed=seed)
            while not has_ended:
                actions.append(act(observation).astype(np.float32))
                observation, _, terminated, truncated, _ = environment.step(actions[-1])
                has_ended = terminated or truncated
            found[seed] = np.array(actions)
    return found


def assert_as_alone(episodes, policy):
    """Asserts that the episodes of all seeds have the actions of `alone`."""
    found = {episode.seed: episode.arrays["action"] for episode in episodes}
    expected = alone(policy)
    lengths = {len(actions) for actions in expected.values()}
    assert len(lengths) > 2, "environments have to be filled again at different times"
    assert found.keys() == expected.keys()
    for seed, actions in expected.items():
        np.testing.assert_array_equal(found[seed], actions, f"seed {seed}")
