"""Measures rewards and success of the kitchen's twenty tasks with the expert.

`python docs/experiments/kitchen_rewards.py` plays 100 episodes of each task with each criterion of success, and 10 with
the reward `dense`, in as many processes as there are CPUs, and writes results/kitchen_rewards.json. That takes 20
minutes of processor time; `python docs/experiments/kitchen_rewards.py 5` plays 5 of each. It needs the extra `experts`.
`docs/scripts/tables.py` makes the tables.
"""

import functools
import statistics
from typing import Any, NamedTuple

import numpy as np
from experiment import RESULTS, Case, make_parser, play_cases, positive, write_rows
from numpy.typing import NDArray

from kitchen_suite.experts import KitchenExpert
from kitchen_suite.gymnasium_env import FrankaKitchenEnv
from kitchen_suite.tasks import GOALS

# Seeds that were not used for tuning.
FIRST_SEED = 50_000
EPISODES = 100
DENSE_EPISODES = 10
STEPS = 280

# Steps over which the potential is averaged.
_WINDOW = 5

# Policies, and arguments of the environment, by the name of a case.
CASES: dict[str, tuple[str, dict[str, str]]] = {
    "original": ("expert", {"reward": "dense_gain"}),
    "strict": ("expert", {"success": "strict"}),
    "dense": ("expert", {"reward": "dense"}),
    "waiting": ("zero", {"reward": "dense"}),
    "waiting_gain": ("zero", {"reward": "dense_gain"}),
}


class Episode(NamedTuple):
    """An episode that was played.

    Attributes:
      rewards: `(t,)`, of its control steps.
      completion: control step, from 1, at which the task was completed; -1 if it was not.
    """

    rewards: NDArray[np.float64]
    completion: int

    @property
    def potential_before(self) -> NDArray[np.float64]:
        """The rewards before completion; with the reward `dense` they are the potential."""
        return self.rewards[: self.completion - 1] if self.completion > 0 else self.rewards


@functools.lru_cache(maxsize=1)
def load(task: str, case: str) -> FrankaKitchenEnv:
    """Returns an environment; consecutive episodes of a case share it."""
    return FrankaKitchenEnv([task], **CASES[case][1])


def play(episode: Case) -> Episode:
    """Plays an episode of a task in a case, from a seed."""
    task, case, seed = episode
    env = load(task, case)
    acts = CASES[case][0] == "expert"
    expert = KitchenExpert.for_task(env.composer_task) if acts else None
    observation, info = env.reset(seed=seed)
    rewards = []
    for _ in range(STEPS):
        action = expert.act(observation["observation"]) if expert else np.zeros(9)
        observation, reward, terminated, _, info = env.step(action)
        rewards.append(float(reward))
        if terminated:
            break
    return Episode(np.array(rewards), int(info["completion_steps"].max()))


def greatest_fall(potential: NDArray[np.float64]) -> float:
    """Returns how far the mean over a window falls below an earlier one at most; 0 in episodes shorter than that."""
    if potential.size < _WINDOW:
        return 0.0
    means = np.convolve(potential, np.ones(_WINDOW) / _WINDOW, "valid")
    return float((np.maximum.accumulate(means) - means).max())


def row(task: str, played: dict[str, list[Episode]]) -> dict[str, Any]:
    """Returns the results of a task."""
    result: dict[str, Any] = {"task": task, "episodes": len(played["strict"]), "dense_episodes": len(played["dense"])}
    for case in ("original", "strict"):
        steps = [episode.completion for episode in played[case] if episode.completion > 0]
        result[f"{case}_success"] = len(steps)
        result[f"{case}_steps"] = statistics.median(steps) if steps else None
    befores = [episode.potential_before for episode in played["dense"]]
    done = {
        case: [each.rewards.sum() for each in played[case] if each.completion > 0] for case in ("dense", "original")
    }
    return {
        **result,
        "greatest_fall": max(map(greatest_fall, befores)),
        "greatest_potential": max(float(before.max(initial=0.0)) for before in befores),
        "dense_return": min(done["dense"], default=None),
        "dense_waiting": max(episode.rewards.sum() for episode in played["waiting"]),
        "gain_return": min(done["original"], default=None),
        "gain_waiting": max(episode.rewards.sum() for episode in played["waiting_gain"]),
    }


def measure(count: int) -> None:
    """Plays `count` episodes of each task, and fewer with the reward `dense`; writes the results."""
    fewer = min(count, DENSE_EPISODES)
    counts = {"original": count, "strict": count, "dense": fewer, "waiting": fewer, "waiting_gain": fewer}
    played = play_cases(play, {(task, case): counts[case] for task in GOALS for case in CASES}, FIRST_SEED)
    rows = [row(task, {case: played[task, case] for case in CASES}) for task in GOALS]
    write_rows(RESULTS / "kitchen_rewards.json", rows)


if __name__ == "__main__":
    parser = make_parser(__doc__)
    parser.add_argument("episodes", nargs="?", type=positive, default=EPISODES, help="of each task and criterion")
    measure(parser.parse_args().episodes)
