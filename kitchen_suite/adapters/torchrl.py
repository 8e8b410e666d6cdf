"""Recordings as replay buffers of TorchRL. Needs the extras `record` and `clients`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from tensordict import TensorDict
from torchrl.data.datasets import MinariExperienceReplay

from kitchen_suite.datasets.minari import import_minari


def load_recording(dataset_id: str, *, root: str | Path | None = None, **options: Any) -> MinariExperienceReplay:
    """Returns a local Minari dataset as TorchRL's replay buffer, with the numbers of the recording.

    With `load_from_local_minari=True` TorchRL 0.14 makes the buffer's files with the right names, shapes and types, but
    all numbers in them are 0. Here the files are written again from the dataset, and then loaded by TorchRL. A copy of
    the dataset that is in `root` is replaced.

    Args:
      dataset_id: name of the dataset, such as that of `kitchen-convert`. Minari looks for it in
        `MINARI_DATASETS_PATH`.
      root: folder of TorchRL's copies of datasets; its own cache when omitted.
      **options: further arguments of `MinariExperienceReplay`, such as `batch_size`, `sampler` and `split_trajs`.
    """
    prepared = MinariExperienceReplay(dataset_id, batch_size=1, root=root, load_from_local_minari=True)
    episodes = [_as_steps(episode) for episode in import_minari().load_dataset(dataset_id)]
    TensorDict.cat(episodes).memmap(prepared.data_path_root)
    return MinariExperienceReplay(dataset_id, root=root, **options)


def _as_steps(episode: Any) -> TensorDict:
    """Returns an episode in TorchRL's format: each step with what follows it under `next`."""
    before, after = (
        {"observation": _part(episode.observations, part), "info": _part(episode.infos, part)}
        for part in (slice(None, -1), slice(1, None))
    )
    after |= {
        "reward": episode.rewards[:, None],
        "terminated": episode.terminations[:, None],
        "truncated": episode.truncations[:, None],
        "done": (episode.terminations | episode.truncations)[:, None],
    }
    steps = before | {"episode": np.full(len(episode), episode.id), "action": episode.actions, "next": after}
    return TensorDict(steps, batch_size=[len(episode)])


def _part(values: Any, part: slice) -> Any:
    return {key: _part(value, part) for key, value in values.items()} if isinstance(values, Mapping) else values[part]
