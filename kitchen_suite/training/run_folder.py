"""The folder of a training run: its description, by which a resumed run is recognised as the same."""

import dataclasses
import json
from pathlib import Path
from typing import Any

from kitchen_suite import files

RUN_FILE = "training.json"
_RUN = files.DescribedFolder(RUN_FILE, "a training run", "seed_*", "name another folder, or resume it")


@dataclasses.dataclass(frozen=True, kw_only=True)
class RunDescription:
    """The task, hyperparameters and seed of a run. A run is resumed only with an equal description.

    Attributes:
      domain_name: a key of `suite.DOMAINS`.
      task_name: one of the domain's tasks.
      task_kwargs: additional arguments of the Gymnasium environment, which JSON can hold.
      training_kwargs: additional arguments of the environments trained in, among them `max_episode_steps`.
      hyperparameters: all of them, by name.
      seed: of the first learner.
      algorithm: `ppo` or `bc`.
      data_sha256: of what is learned or started from; None in descriptions of an earlier version.
    """

    domain_name: str
    task_name: str
    task_kwargs: dict[str, Any]
    training_kwargs: dict[str, Any]
    hyperparameters: dict[str, Any]
    seed: int
    algorithm: str = "ppo"
    data_sha256: str | None = None

    @property
    def metadata(self) -> dict[str, Any]:
        """The metadata of the run's policies on their training."""
        names = ("domain_name", "task_name", "task_kwargs", "training_kwargs", "hyperparameters")
        return {name: getattr(self, name) for name in names}

    def create(self, folder: Path) -> None:
        """Writes it to the folder of a new run, as `DescribedFolder.create`."""
        _RUN.create(folder, vars(self))

    def resume(self, folder: Path) -> None:
        """Checks the description in the folder of an interrupted run.

        Raises:
          OSError: the folder cannot be written to, or holds no run.
          ValueError: it holds a run with another description, or on other data.
        """
        found = files.parse(_RUN.load(folder), RunDescription, str(folder / RUN_FILE))
        _RUN.resume(folder, found.entries(), self.entries())
        if found.data_sha256 not in (None, self.data_sha256):
            remedy = "pass the same demonstrations and their number, or the same initial policy, or name another folder"
            raise ValueError(f"{folder} holds a training run on other data: {remedy}")

    def entries(self) -> dict[str, Any]:
        """Returns it as JSON without the data; arguments of the task and hyperparameters are beside other entries."""
        entries = json.loads(json.dumps(vars(self)))
        entries.pop("data_sha256", None)
        return {**entries.pop("task_kwargs"), **entries.pop("hyperparameters"), **entries}
