"""Files in the layouts of D4RL's kitchen and of Minari's D4RL/kitchen, of made-up episodes."""

import h5py
import minari
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec

from kitchen_suite.tasks import GOALS
from kitchen_suite.tasks.kitchen.goals import INITIAL_QPOS

# As D4RL has them: indices of the positions of a task's joints among the first 30 numbers of an observation.
ELEMENTS = {
    "bottom burner": [11, 12],
    "top burner": [15, 16],
    "light switch": [17, 18],
    "slide cabinet": [19],
    "hinge cabinet": [20, 21],
    "microwave": [22],
    "kettle": [23, 24, 25, 26, 27, 28, 29],
}
WANTED = ("microwave", "kettle", "light switch", "slide cabinet")

# Tasks that the made-up episodes complete, and the step after which each is complete.
EPISODES = (
    {"kettle": 3, "microwave": 1, "light switch": 5, "slide cabinet": 9},
    {"hinge cabinet": 2, "bottom burner": 4},
    {},
    {"top burner": 8},
)
LENGTH = 10


def positions(completions, length=LENGTH):
    """Returns the 30 positions `(length + 1, 30)` of an episode that completes tasks after given steps."""
    made = np.tile(INITIAL_QPOS, (length + 1, 1))
    made[:, :9] += 0.01 * np.arange(length + 1)[:, np.newaxis]
    for task, step in completions.items():
        made[step:, ELEMENTS[task]] = GOALS[task].value
    return made


def actions(length=LENGTH):
    return np.random.default_rng(length).uniform(-0.999, 0.999, (length, 9)).astype(np.float32)


def write_d4rl(path, episodes=EPISODES, timeouts=False, **changes):
    """Writes a file in the layout of D4RL's kitchen: no observation follows the last action of an episode."""
    goal = np.zeros(30)
    for task in WANTED:
        goal[ELEMENTS[task]] = GOALS[task].value
    rows = [np.column_stack([made, np.tile(goal, (len(made), 1))]) for made in map(positions, episodes)]
    ends = np.concatenate([np.arange(len(each)) == len(each) - 1 for each in rows]).astype(np.float32)
    arrays = {
        "observations": np.concatenate(rows).astype(np.float32),
        "actions": np.concatenate([actions(len(each)) for each in rows]),
        "rewards": np.zeros(ends.size, np.float32),
        "terminals": np.zeros_like(ends) if timeouts else ends,
        "infos": np.zeros(ends.size, np.int64),
        **({"timeouts": ends} if timeouts else {}),
    }
    with h5py.File(path, "w") as file:
        for name, array in {**arrays, **changes}.items():
            if array is not None:
                file[name] = array


def write_minari(name="D4RL/kitchen/complete-v2", env_id="FrankaKitchen-v1", size=59):
    """Writes a Minari dataset in the layout of D4RL/kitchen/complete-v2."""
    goal = spaces.Dict({task: spaces.Box(-np.inf, np.inf, (len(GOALS[task].value),), np.float64) for task in WANTED})
    specification = EnvSpec(
        env_id,
        entry_point="gymnasium_robotics.envs:KitchenEnv",
        max_episode_steps=280,
        kwargs={"remove_task_when_completed": False, "tasks_to_complete": [*WANTED]},
    )
    dataset = minari.create_dataset_from_buffers(
        name,
        [_minari_episode(completions, size) for completions in EPISODES],
        env=None,
        action_space=spaces.Box(-1.0, 1.0, (9,), np.float64),
        observation_space=spaces.Dict(
            achieved_goal=goal, desired_goal=goal, observation=spaces.Box(-np.inf, np.inf, (size,), np.float64)
        ),
    )
    dataset.storage.update_metadata({"env_spec": specification.to_json()})


def _minari_episode(completions, size):
    made = positions(completions)
    state = np.zeros((LENGTH + 1, 59))
    state[:, :9], state[:, 18:39] = made[:, :9], made[:, 9:]
    return minari.data_collector.EpisodeBuffer(
        observations={
            "achieved_goal": {task: made[:, ELEMENTS[task]] for task in WANTED},
            "desired_goal": {task: np.tile(GOALS[task].value, (LENGTH + 1, 1)) for task in WANTED},
            "observation": state[:, :size],
        },
        actions=actions().astype(np.float64),
        rewards=np.zeros(LENGTH),
        terminations=np.zeros(LENGTH, bool),
        truncations=np.arange(LENGTH) == LENGTH - 1,
        infos={"ctrl": np.zeros((LENGTH + 1, 9))},
    )
