"""Behaviour cloning: an agent's policy learns what was done in recorded episodes, before it learns on its own."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from skrl.agents.torch.ppo import PPO

from kitchen_suite.policies.trained import flat
from kitchen_suite.recordings.folder import RecordingFolder
from kitchen_suite.rollouts.episode_arrays import nested

# Bound of what is imitated, in units of the action's scale: beyond it servos and gripper do nothing else, and the
# squares of a few great numbers would drown all others.
_LIMIT = 5.0

# Observations that a scaler must have seen for no later ones to move it.
_SETTLED = 1e15

_BATCH, _LEARNING_RATE, _WEIGHT_DECAY = 512, 1e-3, 1e-4


def load_demonstrations(
    folder: Path, domain_name: str, task_name: str
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Reads what `kitchen-record` has written.

    Args:
      folder: of the recording.
      domain_name: what it must be of.
      task_name: what it must be of.

    Returns:
      Observations `(m, ...)` as a trained policy takes them, and the actions `(m, k)` that followed them.

    Raises:
      OSError: there is no recording, or one of its episodes cannot be read.
      ValueError: it is of another task, its goals are not laid end to end, or it holds no episodes.
    """
    staging = RecordingFolder.open(folder)
    found, wanted = (staging.recipe.domain_name, staging.recipe.task_name), (domain_name, task_name)
    if found != wanted:
        raise ValueError(f"{folder} holds episodes of {' '.join(found)}, not of {' '.join(wanted)}")
    if not staging.indices:
        raise ValueError(f"{folder} holds no episodes yet")
    if domain_name == "kitchen" and staging.recipe.task_kwargs.get("goal_format") != "flat":
        raise ValueError(f'{folder} holds goals by task: record with --task_kwargs=\'{{"goal_format": "flat"}}\'')
    episodes = [staging.load(index).arrays for index in staging.indices]
    observations = [flat(nested(arrays, "observation"))[:-1] for arrays in episodes]
    actions = [arrays["action"] for arrays in episodes]
    return np.concatenate(observations).astype(np.float32), np.concatenate(actions).astype(np.float32)


def clone(
    agent: PPO,
    observations: NDArray[np.float32],
    actions: NDArray[np.float32],
    epochs: int,
    watch: Callable[[float], None] = lambda loss: None,
) -> None:
    """Teaches an agent's policy to do, in the mean, what was done.

    How observations are standardised is settled by the demonstrations, too.

    Args:
      agent: as `agent.build` gives it.
      observations: `(m, n)`.
      actions: `(m, k)`.
      epochs: passes over all of them.
      watch: called after each pass with its mean loss, in units of the action's scale.
    """
    policy, scaler = agent.models["policy"], agent.checkpoint_modules["observation_preprocessor"]
    scaler(torch.as_tensor(observations), train=True)
    # skrl would go on to follow what is seen, and so change the policy behind the optimiser's back.
    scaler.current_count.fill_(_SETTLED)
    seen, done = scaler(torch.as_tensor(observations)), (torch.as_tensor(actions) / policy.scale).clamp(-_LIMIT, _LIMIT)
    optimizer = torch.optim.AdamW(policy.network.parameters(), lr=_LEARNING_RATE, weight_decay=_WEIGHT_DECAY)
    batches = -(-len(done) // _BATCH)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, epochs * batches)
    for _ in range(epochs):
        losses = []
        for chosen in torch.randperm(len(done)).split(_BATCH):
            loss = torch.nn.functional.mse_loss(policy.network(seen[chosen]), done[chosen])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
            losses.append(loss.item())
        watch(float(np.mean(losses)))
