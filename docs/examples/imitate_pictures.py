"""Learns a custom task from images: scripted episodes, a small network, an evaluation on other seeds.

Needs a GL library, and pip install '.[experts,pixels,train]'. It writes the recording `pictures` and the
weights `imitate_pictures.pt` to the working directory; a recording that is there is used again.

python imitate_pictures.py
"""

import functools

import numpy as np
import torch
from torch import nn

import kitchen_suite
from kitchen_suite import EnvironmentSpec
from kitchen_suite.evaluation.text import format_evaluation

TASK = {"tasks_to_complete": ["kettle", "microwave"], "goals": {"microwave": [-1.2]}, "reward": "dense_gain"}
CAMERA = {"obs_type": "pixels_agent_pos", "cameras": ["workspace"], "image_size": [64, 64], "render_quality": "fast"}


class Network(nn.Module):
    """Predicts the next 8 actions `(n, 8, 9)` from pictures `(n, 64, 64, 3)` and positions of the joints `(n, 9)`."""

    def __init__(self):
        super().__init__()
        first, second, third = nn.Conv2d(3, 16, 5, 2), nn.Conv2d(16, 32, 3, 2), nn.Conv2d(32, 32, 3, 2)
        self.vision = nn.Sequential(first, nn.ReLU(), second, nn.ReLU(), third, nn.ReLU(), nn.Flatten())
        self.head = nn.Sequential(nn.Linear(1152 + 9, 256), nn.ReLU(), nn.Linear(256, 72), nn.Unflatten(1, (8, 9)))

    def forward(self, pictures, joints):
        return self.head(torch.cat([self.vision(pictures.permute(0, 3, 1, 2) / 255), joints.float()], 1))


@functools.cache
def trained():
    """Returns the network with the weights in the file."""
    network = Network()
    network.load_state_dict(torch.load("imitate_pictures.pt"))
    return network


@torch.no_grad()
def act(timestep):
    """Returns the first of the actions that the network predicts."""
    seen = (timestep.observation[name] for name in ("workspace", "franka/joint_positions"))
    return trained()(*(torch.as_tensor(array)[None] for array in seen))[0, 0].numpy()


def train(recording, steps):
    """Fits a network to recorded episodes, and writes its weights."""
    network, taken = Network(), recording.load_transitions()
    later = np.minimum(np.arange(len(taken.actions))[:, None] + np.arange(8), taken.last[:, None])
    pictures, joints = (torch.as_tensor(taken.observations[key][taken.rows]) for key in ("pixels", "agent_pos"))
    actions = torch.as_tensor(taken.actions[later])
    optimizer = torch.optim.AdamW(network.parameters())
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    for _ in range(steps):
        rows = torch.randint(len(actions), (64,))
        loss = (network(pictures[rows], joints[rows, :9]) - actions[rows]).abs().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
    torch.save(network.state_dict(), "imitate_pictures.pt")


if __name__ == "__main__":
    torch.manual_seed(0)
    task = {**TASK, **CAMERA, "variations": None}
    spec = EnvironmentSpec.make("kitchen", "all", task)
    train(kitchen_suite.record("pictures", spec, "expert(action_noise=0.1, jitter=0.01)", num_episodes=20), steps=1500)
    print(format_evaluation(kitchen_suite.evaluate(act, task_name="all", task_kwargs=task, num_episodes=10)))
