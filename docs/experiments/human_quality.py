"""Measures the quality of human demonstrations: replays their actions from their first observed positions.

`kitchen-convert kitchen_complete-v0.hdf5 --output=human` makes a recording of the data, which are not part of this
suite. `python docs/experiments/human_quality.py human` prints the measures that docs/guide/quality.md has of policies.

An episode succeeds if it completes all tasks that the demonstration completed. Not all do: the data were recorded with
another version of MuJoCo or noise that is not known, and the first observation, from which an episode starts, has noise
itself. Demonstrations that complete nothing are left out.
"""

import contextlib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import gymnasium
import numpy as np
from experiment import make_parser
from tabulate import tabulate
from tqdm import tqdm

from kitchen_suite.datasets.d4rl import POSITIONS
from kitchen_suite.episodes.episode import Episode
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.evaluation.quality import CLEAN_SUCCESS, INFOS, measures
from kitchen_suite.evaluation.scores import mean, rate
from kitchen_suite.gymnasium_env import FrankaKitchenEnv

# Arrays of an episode: what the kitchen observes, and which tasks are requested.
OBSERVATION = "observation/observation"
REQUESTED_TASKS = "observation/requested_tasks"

Measured = dict[str, bool | float]


def make_environment() -> gymnasium.Env:
    """Returns a kitchen that measures quality, in which an episode ends with the last of its tasks; without noise."""
    return FrankaKitchenEnv(
        tasks_per_episode=(1, 7), quality=True, max_episode_steps=10**9, robot_noise_ratio=0.0, object_noise_ratio=0.0
    )


def replay(environment: gymnasium.Env, episode: Episode) -> Measured:
    """Plays the actions of a demonstration from its first positions; returns its success and the measures of it."""
    start = episode.arrays[OBSERVATION][0, POSITIONS]
    requested = episode.arrays[REQUESTED_TASKS][0].astype(bool)
    options = {"requested_tasks": requested, "start_state": start}
    _, infos = environment.reset(seed=0, options=options)
    for action in episode.arrays["action"]:
        _, _, terminated, _, infos = environment.step(action)
        if terminated:
            break
    success = bool(infos["is_success"])
    return {"success": success, **measures(success, infos)}


def replays(recording: Iterable[Episode]) -> Iterator[Measured]:
    """Yields the measures of the demonstrations of a recording that complete a task."""
    with contextlib.closing(make_environment()) as environment:
        for episode in recording:
            if lacking := {OBSERVATION, REQUESTED_TASKS} - episode.arrays.keys():
                raise ValueError(f"the recording has no {min(lacking)}: make it with kitchen-convert")
            if episode.arrays[REQUESTED_TASKS][0].any():
                yield replay(environment, episode)


def rows(measured: Sequence[Measured]) -> Iterator[tuple[str, float, str]]:
    """Yields the name, the value and the interval of each measure."""
    for name in ("success", CLEAN_SUCCESS):
        value, (low, high) = rate(np.array([each[name] for each in measured], bool))
        yield name, value, f"{low:.2f} to {high:.2f}"
    for name, least in INFOS.items():
        value, interval = mean(np.array([each[name] for each in measured], float), low=least)
        yield name, value, "" if interval is None else f"{interval[0]:.2f} to {interval[1]:.2f}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the command."""
    parser = make_parser(__doc__)
    parser.add_argument("recording", type=Path, help="folder that kitchen-convert has made")
    recording = Recording.open(parser.parse_args(arguments).recording)
    try:
        measured = [*replays(tqdm(recording, total=len(recording.indices), disable=None))]
    except ValueError as error:
        parser.error(str(error))
    if not measured:
        parser.error("no episode of the recording completes a task")
    print(tabulate([*rows(measured)], ("measure", f"of {len(measured)} episodes", "95 % interval"), floatfmt=".2f"))


if __name__ == "__main__":
    main()
