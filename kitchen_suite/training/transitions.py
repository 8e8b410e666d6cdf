"""Recorded control steps with what came before and after them, and the batches that are drawn of them."""

import functools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from kitchen_suite import suite
from kitchen_suite.episodes.episode import unflatten
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.training.demonstrations import check_same, finite, open_recording, with_counts
from kitchen_suite.training.hyperparameters import OfflineHyperparameters

# Euclidean distance in a goal's elements of the state at which it is reached [rad, m]; as in protocol `goal-reaching`.
REACHED = 0.1

# Shares of the goals of values that are the state after the step, and later states of the same episode; the rest are
# states of any episode. Source: OGBench's goal-conditioned IQL.
_NEXT, _LATER = 0.2, 0.5

# Arguments that may differ between a recording and the environments that a policy is evaluated in.
_FREE = {"episode_seeds", "physics", "render_quality", "sleep", "variation_split", "variations"}


class Transitions(NamedTuple):
    """The control steps of all episodes, one after the other.

    Attributes:
      inputs: `(r, n)`, float32: the state, and which of the policy's tasks are requested, at resets and after steps.
      actions: `(m, k)`, float32.
      rows: `(m,)`, index of the inputs before each step; the next one is after it.
      last: `(m,)`, index of the last inputs of its episode.
      rewards: `(m,)`, float32, of each step.
      terminations: `(m,)`, whether the step ended the episode by success.
    """

    inputs: NDArray[np.float32]
    actions: NDArray[np.float32]
    rows: NDArray[np.int64]
    last: NDArray[np.int64]
    rewards: NDArray[np.float32]
    terminations: NDArray[np.bool_]


def load_transitions(
    folders: Sequence[Path], spec: EnvironmentSpec, tasks: Sequence[str], counts: Sequence[int], *, with_rewards: bool
) -> Transitions:
    """Reads all episodes of recordings of `kitchen-record`, or the first ones of each.

    Arguments are those of `load_demonstrations`, and whether the recorded rewards have to be those of the task.

    Raises:
      OSError: there is no recording, or one of its episodes cannot be read.
      ValueError: it is of another domain or task, or with other arguments that state, actions or rewards depend on, or
        holds fewer episodes, or numbers that are not finite.
    """
    parts, rows = [], 0
    for folder, count in with_counts(folders, counts):
        for part in _load(folder, spec, tasks, count, with_rewards=with_rewards):
            parts.append(part._replace(rows=part.rows + rows, last=part.last + rows))
            rows += len(part.inputs)
    return Transitions(*map(np.concatenate, zip(*parts, strict=True)))


def _load(
    folder: Path, spec: EnvironmentSpec, tasks: Sequence[str], count: int | None, *, with_rewards: bool
) -> Iterator[Transitions]:
    """Yields the transitions of each episode of a recording, with its rows counted from 0."""
    recording = open_recording(folder, spec, suite.find_domain(spec.domain_name).control_options)
    if with_rewards:
        # All arguments but those on which no reward depends.
        specs = (recording.spec, spec)
        arguments = {name for each in specs for name in suite.task_arguments(each.domain_name, each.task_name)}
        arguments |= {name for each in specs for name in each.task_kwargs}
        check_same(folder, recording.spec, spec, sorted(arguments - _FREE))
    if recording.spec.origin is not None:
        raise ValueError(f"{folder} was made by kitchen-convert: --algorithm=bc, flow or vqbet learns from it")
    if not recording.indices or len(recording.indices) < (count or 1):
        raise ValueError(f"{folder} holds {len(recording.indices)} episodes, not {count or 'one or more'}")
    with recording.spec.make_environment() as environment:
        recorded = suite_env(environment).composer_task.policy_inputs
    for index in recording.indices[:count]:
        arrays = recording.load(index).arrays
        steps = len(arrays["reward"])
        observed = recorded.state_and_requests(unflatten(arrays, "observation"), tasks)
        yield Transitions(
            inputs=finite(observed, folder),
            actions=finite(arrays["action"], folder),
            rows=np.arange(steps),
            last=np.full(steps, steps),
            rewards=finite(arrays["reward"], folder),
            terminations=arrays["termination"],
        )


class Batch(NamedTuple):
    """Control steps that a step of the optimiser learns from; inputs and actions are standardised.

    Attributes:
      inputs: `(b, n)`, before the steps.
      chunks: `(b, c k)`, the actions of the chunks that follow; at the end of an episode the last one repeats.
      later_inputs: `(b, n)`, a number of steps later or at the end of the episode.
      rewards: `(b,)`, discounted, of the steps up to then.
      discounts: `(b,)`, discount factor of the value from then on; 0 after a success.
    """

    inputs: torch.Tensor
    chunks: torch.Tensor
    later_inputs: torch.Tensor
    rewards: torch.Tensor
    discounts: torch.Tensor


class Sampler:
    """Draws batches of recorded control steps with the recorded rewards."""

    def __init__(
        self, transitions: Transitions, inputs: NDArray, actions: NDArray, config: OfflineHyperparameters
    ) -> None:
        """Takes transitions, their standardised inputs and actions, and the sizes of batches."""
        self._transitions, self._config = transitions, config
        self._inputs, self._actions = torch.as_tensor(inputs), torch.as_tensor(actions)
        self._left = transitions.last - transitions.rows

    @functools.cached_property
    def _outcomes(self) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """The discounted rewards `(m,)` of the next `n_step` steps, and whether success ended them."""
        transitions, config = self._transitions, self._config
        count = len(transitions.rows)
        total, ended = np.zeros(count), np.zeros(count, np.bool_)
        for ahead in range(config.n_step):
            steps = np.minimum(np.arange(count) + ahead, count - 1)
            inside = ahead < self._left
            total += np.where(inside, config.discount**ahead * transitions.rewards[steps], 0.0)
            ended |= inside & transitions.terminations[steps]
        return total.astype(np.float32), ended

    def draw(self) -> tuple[Batch, Batch]:
        """Draws batches for the value functions and for the policy; random numbers are PyTorch's."""
        steps = self._draw_steps()
        rows, ahead = self._transitions.rows[steps], np.minimum(self._left[steps], self._config.n_step)
        returns, ended = self._outcomes
        batch = Batch(
            inputs=self._inputs[rows],
            chunks=self._chunks(steps),
            later_inputs=self._inputs[rows + ahead],
            rewards=torch.as_tensor(returns[steps]),
            discounts=torch.as_tensor(~ended[steps] * self._config.discount**ahead).float(),
        )
        return batch, batch

    def _draw_steps(self) -> NDArray[np.int64]:
        return torch.randint(len(self._transitions.rows), (self._config.batch_size,)).numpy()

    def _chunks(self, steps: NDArray[np.int64]) -> torch.Tensor:
        """Returns the actions `(b, c k)` from each step on."""
        ahead = np.minimum(np.arange(self._config.chunk), self._left[steps][:, np.newaxis] - 1)
        return self._actions[steps[:, np.newaxis] + ahead].flatten(1)


class GoalSampler(Sampler):
    """Draws batches with goals that were reached in hindsight: states of the data stand for what was wanted.

    The reward of a step is -1, and 0 where it reaches the goal, after which the value is 0. Later states are
    drawn from a geometric distribution with the discount factor, so that near ones are the more frequent.
    """

    def __init__(self, *recorded: Any, elements: Sequence[int]) -> None:
        """Takes what `Sampler` does; `elements` are those of the state in a goal."""
        super().__init__(*recorded)
        if not 0.0 < self._config.discount < 1.0:
            raise ValueError(f"goals need a discount between 0 and 1, got {self._config.discount}")
        self._goals, self._places = self._inputs[:, [*elements]], self._transitions.inputs[:, [*elements]]

    def draw(self) -> tuple[Batch, Batch]:
        steps = self._draw_steps()
        return self._towards(steps, self._value_goals(steps)), self._towards(steps, self._later(steps))

    def _towards(self, steps: NDArray[np.int64], goals: NDArray[np.int64]) -> Batch:
        """Returns the batch of some steps with goals, which are given as rows `(b,)`."""
        discount, returns, rows = self._config.discount, self._config.n_step, self._transitions.rows[steps]
        next_rows = np.minimum(rows[:, np.newaxis] + 1 + np.arange(returns), self._transitions.last[steps, np.newaxis])
        reached = np.linalg.norm(self._places[next_rows] - self._places[goals, np.newaxis], axis=-1) <= REACHED
        # The first of these steps that reaches the goal; the last one if none does.
        first = np.where(reached.any(axis=1), reached.argmax(axis=1), returns - 1)
        arrives, ahead = reached[np.arange(len(steps)), first], np.minimum(first + 1, self._left[steps])
        wanted = self._goals[goals]
        return Batch(
            inputs=torch.cat([self._inputs[rows], wanted], dim=1),
            chunks=self._chunks(steps),
            later_inputs=torch.cat([self._inputs[rows + ahead], wanted], dim=1),
            # -1 for each step but the one that reaches the goal.
            rewards=torch.as_tensor((discount ** (ahead - arrives) - 1.0) / (1.0 - discount)).float(),
            discounts=torch.as_tensor(~arrives * discount**ahead).float(),
        )

    def _later(self, steps: NDArray[np.int64]) -> NDArray[np.int64]:
        """Returns rows `(b,)` of states after steps, in the same episodes."""
        ahead = torch.empty(len(steps)).geometric_(1.0 - self._config.discount).long().numpy()
        return np.minimum(self._transitions.rows[steps] + ahead, self._transitions.last[steps])

    def _value_goals(self, steps: NDArray[np.int64]) -> NDArray[np.int64]:
        """Returns rows `(b,)` of goals for value functions."""
        kind = torch.rand(len(steps)).numpy()
        anywhere = torch.randint(len(self._inputs), (len(steps),)).numpy()
        goals = np.where(kind < _NEXT + _LATER, self._later(steps), anywhere)
        return np.where(kind < _NEXT, self._transitions.rows[steps] + 1, goals)
