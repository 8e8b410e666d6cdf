"""The batch of control steps that PPO learns from, in tensors that are filled again and again."""

import torch


class Batch:
    """Control steps of all environments, time first.

    Attributes:
      observations: `(t, n, m)`, before each step.
      actions: `(t, n, k)`, in units of the policy's scale.
      log_densities: `(t, n)`, logarithms of the densities of the actions.
      rewards: `(t, n)`, scaled.
      ended: `(t, n)`, whether a step ended an episode.
      next_observations: `(n, m)`, after the last step.
    """

    def __init__(self, steps: int, count: int, observation_size: int, action_size: int) -> None:
        """Allocates the tensors for `steps` of `count` environments."""
        self.observations = torch.empty(steps, count, observation_size)
        self.actions = torch.empty(steps, count, action_size)
        self.log_densities, self.rewards = torch.empty(steps, count), torch.empty(steps, count)
        self.ended = torch.empty(steps, count, dtype=torch.bool)
        self.next_observations = torch.empty(count, observation_size)
        self._truncated: list[tuple[int, int, torch.Tensor]] = []

    def clear(self) -> None:
        """Forgets the truncated episodes of the last batch; everything else is overwritten."""
        self._truncated = []

    def add_truncated(self, step: int, i: int, observation: torch.Tensor) -> None:
        """Adds the last observation `(m,)` of an episode of environment `i` that a step truncated."""
        self._truncated.append((step, i, observation))

    def last_observations(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Returns steps `(k,)`, environments `(k,)` and last observations `(k, m)` of the truncated episodes."""
        steps, indices, observations = zip(*self._truncated, strict=True) if self._truncated else ((), (), ())
        stacked = torch.stack(observations) if observations else self.observations[:0, 0]
        return torch.tensor(steps, dtype=torch.long), torch.tensor(indices, dtype=torch.long), stacked


def advantages(
    rewards: torch.Tensor, values: torch.Tensor, ended: torch.Tensor, *, discount: float, gae_lambda: float
) -> torch.Tensor:
    """Returns the generalised advantage estimates `(t, n)` (GAE).

    Args:
      rewards: `(t, n)`; where a step truncated an episode, with the discounted value of its last observation.
      values: `(t + 1, n)`, of the observations before each step, and after the last one.
      ended: `(t, n)`, whether a step ended an episode: what follows it belongs to another one.
      discount: discount factor.
      gae_lambda: lambda.
    """
    goes_on = (~ended).float()
    errors = rewards + discount * goes_on * values[1:] - values[:-1]
    estimates, last = torch.empty_like(errors), torch.zeros_like(errors[0])
    for step in reversed(range(len(errors))):
        last = errors[step] + discount * gae_lambda * goes_on[step] * last
        estimates[step] = last
    return estimates
