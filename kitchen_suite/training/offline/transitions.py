"""Recorded control steps with what came before and after them, and the batches that are drawn of them."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from kitchen_suite import suite
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.rollouts.episode import unflatten
from kitchen_suite.rollouts.spec import EnvironmentSpec
from kitchen_suite.training.imitation.demonstrations import finite, open_recording

# Euclidean distance from a goal, in the elements of the state that it has, at which it is reached [rad, m]: that of the
# protocol `goal-reaching`.
REACHED = 0.1


class Transitions(NamedTuple):
    """The control steps of all episodes, one after the other.

    Attributes:
      inputs: `(r, n)`, float32: the state, and which of the policy's tasks are requested, at each reset and after each
        step.
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

    Args:
      folders: of the recordings.
      spec: of the environments that the policy is evaluated in.
      tasks: names of the tasks whose request the policy observes.
      counts: number of episodes of each recording, or one number for all; empty for all episodes.
      with_rewards: whether the recorded rewards have to be those of that task.

    Raises:
      OSError: there is no recording, or one of its episodes cannot be read.
      ValueError: it is of another domain or task, or with other arguments that state, actions or rewards depend on, or
        holds fewer episodes, or numbers that are not finite.
    """
    if len(counts) not in (0, 1, len(folders)):
        raise ValueError(f"num_demonstrations has {len(counts)} numbers for {len(folders)} folders of demonstrations")
    wanted = counts if len(counts) == len(folders) else [counts[0] if counts else None] * len(folders)
    parts = [
        _load(folder, spec, tasks, count, with_rewards=with_rewards)
        for folder, count in zip(folders, wanted, strict=True)
    ]
    starts = np.cumsum([0, *(len(part.inputs) for part in parts[:-1])])
    moved = [
        part._replace(rows=part.rows + start, last=part.last + start)
        for part, start in zip(parts, starts, strict=True)
    ]
    return Transitions(*map(np.concatenate, zip(*moved, strict=True)))


def _load(
    folder: Path, spec: EnvironmentSpec, tasks: Sequence[str], count: int | None, *, with_rewards: bool
) -> Transitions:
    domain = suite.find_domain(spec.domain_name)
    options = (*domain.control_options, *(("reward", *spec.env_class.goal_options) if with_rewards else ()))
    recording = open_recording(folder, spec, options)
    if recording.spec.origin is not None:
        raise ValueError(f"{folder} was made by kitchen-convert: --algorithm=bc, flow or vqbet learns from it")
    if not recording.indices or len(recording.indices) < (count or 1):
        raise ValueError(f"{folder} holds {len(recording.indices)} episodes, not {count or 'one or more'}")
    with recording.spec.make_environment() as environment:
        recorded = suite_env(environment).composer_task.policy_inputs
    rows, parts = 0, []
    for index in recording.indices[:count]:
        arrays = recording.load(index).arrays
        steps = len(arrays["reward"])
        observed = recorded.state_and_requests(unflatten(arrays, "observation"), tasks)
        parts.append(
            Transitions(
                inputs=finite(observed, folder),
                actions=finite(arrays["action"], folder),
                rows=rows + np.arange(steps),
                last=np.full(steps, rows + steps),
                rewards=finite(arrays["reward"], folder),
                terminations=arrays["termination"],
            )
        )
        rows += steps + 1
    return Transitions(*map(np.concatenate, zip(*parts, strict=True)))


class Batch(NamedTuple):
    """Control steps that a step of the optimiser learns from; inputs and actions are standardised.

    Attributes:
      inputs: `(b, n)`, of the policy, before the steps.
      actions: `(b, k)`.
      value_inputs: `(b, n)`, of the value functions: the same, but for the goals where there are any.
      next_value_inputs: `(b, n)`, after the steps.
      rewards: `(b,)`.
      continues: `(b,)`, 0 where nothing is to be had after the step, else 1.
    """

    inputs: torch.Tensor
    actions: torch.Tensor
    value_inputs: torch.Tensor
    next_value_inputs: torch.Tensor
    rewards: torch.Tensor
    continues: torch.Tensor


class Sampler:
    """Draws batches of recorded control steps with the recorded rewards."""

    def __init__(self, transitions: Transitions, inputs: NDArray[np.float32], actions: NDArray[np.float32]) -> None:
        """Takes transitions, and their standardised inputs and actions."""
        self._transitions = transitions
        self._inputs, self._actions = torch.as_tensor(inputs), torch.as_tensor(actions)

    def draw(self, size: int, discount: float) -> Batch:
        """Draws a batch; random numbers are PyTorch's."""
        steps = self._draw_steps(size)
        rows = self._transitions.rows[steps]
        inputs = self._inputs[rows]
        return Batch(
            inputs=inputs,
            actions=self._actions[steps],
            value_inputs=inputs,
            next_value_inputs=self._inputs[rows + 1],
            rewards=torch.as_tensor(self._transitions.rewards[steps]),
            continues=1.0 - torch.as_tensor(self._transitions.terminations[steps]).float(),
        )

    def _draw_steps(self, size: int) -> NDArray[np.int64]:
        return torch.randint(len(self._transitions.rows), (size,)).numpy()


@dataclasses.dataclass(frozen=True, kw_only=True)
class GoalShares:
    """Where the goals of value functions come from; the rest are states of any episode. The policy's are all later ones.

    Source: OGBench's goal-conditioned IQL.

    Attributes:
      present: share of goals that are the state after the step itself.
      later: share of goals that are later states of the same episode.
    """

    present: float = 0.2
    later: float = 0.5


class GoalSampler(Sampler):
    """Draws batches with goals that were reached in hindsight: states of the data stand for what was wanted.

    The reward of a step is -1, and 0 where it reaches the goal, after which nothing is to be had. Later states are drawn
    from a geometric distribution with the discount factor, so that near ones are the more frequent.
    """

    def __init__(
        self,
        transitions: Transitions,
        inputs: NDArray[np.float32],
        actions: NDArray[np.float32],
        elements: Sequence[int],
        shares: GoalShares,
    ) -> None:
        """Takes transitions, and their standardised inputs and actions; `elements` are those of the state in a goal."""
        super().__init__(transitions, inputs, actions)
        self._elements, self._shares = [*elements], shares
        self._goals = self._inputs[:, self._elements]

    def draw(self, size: int, discount: float) -> Batch:
        steps = self._draw_steps(size)
        rows = self._transitions.rows[steps]
        later, goals = self._later(steps, discount), self._value_goals(steps, discount)
        reached = self._reached(rows + 1, goals)
        inputs, wanted = self._inputs[rows], self._goals[goals]
        return Batch(
            inputs=torch.cat([inputs, self._goals[later]], dim=1),
            actions=self._actions[steps],
            value_inputs=torch.cat([inputs, wanted], dim=1),
            next_value_inputs=torch.cat([self._inputs[rows + 1], wanted], dim=1),
            rewards=reached - 1.0,
            continues=1.0 - reached,
        )

    def _later(self, steps: NDArray[np.int64], discount: float) -> NDArray[np.int64]:
        """Returns rows `(b,)` of states after steps, in the same episodes."""
        ahead = torch.empty(len(steps)).geometric_(1.0 - discount).long().numpy()
        return np.minimum(self._transitions.rows[steps] + ahead, self._transitions.last[steps])

    def _value_goals(self, steps: NDArray[np.int64], discount: float) -> NDArray[np.int64]:
        """Returns rows `(b,)` of goals for value functions."""
        kind, shares = torch.rand(len(steps)).numpy(), self._shares
        anywhere = torch.randint(len(self._inputs), (len(steps),)).numpy()
        goals = np.where(kind < shares.present + shares.later, self._later(steps, discount), anywhere)
        return np.where(kind < shares.present, self._transitions.rows[steps] + 1, goals)

    def _reached(self, rows: NDArray[np.int64], goals: NDArray[np.int64]) -> torch.Tensor:
        """Returns 1 where the state of a row is that of the goal, else 0."""
        states = self._transitions.inputs
        away = states[rows][:, self._elements] - states[goals][:, self._elements]
        return torch.as_tensor(np.linalg.norm(away, axis=1) <= REACHED).float()
