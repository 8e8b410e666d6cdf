"""Behaviour cloning of the scripted expert: record, learn, count the tasks that are completed.

kitchen-record --output=demonstrations --policy='expert(action_noise=0.1, jitter=0.01)' --num_episodes=300
python docs/cloning.py demonstrations

It needs PyTorch, and takes some minutes on a CPU.
"""

import sys
from pathlib import Path

import numpy as np
import torch
from tqdm import tqdm

from kitchen_suite.vector_env import FrankaKitchenVectorEnv

TASKS = ("microwave", "kettle", "light switch", "slide cabinet")
EPOCHS, BATCH, EPISODES, STEPS = 60, 512, 50, 280


def load(folder: Path) -> tuple[torch.Tensor, torch.Tensor]:
    """Observations `(m, 59)` and the actions `(m, 9)` that followed them, of all recorded episodes."""
    episodes = [np.load(path) for path in sorted(folder.glob("episode_*.npz"))]
    seen = np.concatenate([episode["observation/observation"][:-1] for episode in episodes])
    done = np.concatenate([episode["action"] for episode in episodes])
    return torch.tensor(seen, dtype=torch.float32), torch.tensor(done, dtype=torch.float32)


def clone(observations: torch.Tensor, actions: torch.Tensor) -> torch.nn.Module:
    """A network that does what was done, in the mean."""
    network = torch.nn.Sequential(
        torch.nn.BatchNorm1d(observations.shape[1], affine=False),
        torch.nn.Linear(observations.shape[1], 512),
        torch.nn.ReLU(),
        torch.nn.Linear(512, 512),
        torch.nn.ReLU(),
        torch.nn.Linear(512, actions.shape[1]),
    )
    steps = EPOCHS * len(actions) // BATCH
    optimizer = torch.optim.AdamW(network.parameters(), lr=1e-3, weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    for _ in (bar := tqdm(range(steps), desc="learning")):
        chosen = torch.randint(len(actions), (BATCH,))
        loss = torch.nn.functional.mse_loss(network(observations[chosen]), actions[chosen])
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        bar.set_postfix(loss=f"{loss.item():.4f}", refresh=False)
    return network.eval()


def evaluate(network: torch.nn.Module) -> np.ndarray:
    """How many of the tasks are completed in each of some episodes with seeds that nothing was recorded with."""
    environments = FrankaKitchenVectorEnv(EPISODES, tasks_to_complete=TASKS, terminate_on_tasks_completed=False)
    seen, _ = environments.reset(seed=1_000_000)
    for _ in tqdm(range(STEPS), desc="playing"):
        with torch.no_grad():
            actions = network(torch.tensor(seen["observation"], dtype=torch.float32)).numpy()
        seen, _, _, _, infos = environments.step(actions)
    return infos["episode_task_completions_mask"].sum(axis=1)


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    torch.manual_seed(0)
    torch.set_num_threads(1)
    completed = evaluate(clone(*load(Path(sys.argv[1]))))
    print(f"tasks completed, mean of {EPISODES} episodes: {completed.mean():.2f} of {len(TASKS)}")
    print("episodes by number of tasks completed:", dict(enumerate(np.bincount(completed, minlength=5).tolist())))
