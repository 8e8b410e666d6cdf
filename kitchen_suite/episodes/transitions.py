"""The control steps of many episodes as arrays, one episode after the other."""

import dataclasses
from collections.abc import Iterable
from typing import Self

import numpy as np
from numpy.typing import NDArray

from kitchen_suite.episodes.episode import Episode, NamedArrays

_OBSERVATION = "observation"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Transitions:
    """The control steps of `e` episodes, `m` in total, in the order in which they were played.

    Every episode also has an observation from before its first control step: there are `m + e` rows of observations,
    infos and physics states, and `m` of all other arrays. Control step `i` led from row `rows[i]` to `rows[i] + 1`.

    Attributes:
      arrays: by the names that an episode's arrays have (see `episodes.episode`).
      indices: `(e,)` int64, numbers of the episodes in their recording.
      lengths: `(e,)` int64, numbers of control steps of the episodes.
    """

    arrays: NamedArrays
    indices: NDArray[np.int64]
    lengths: NDArray[np.int64]

    @classmethod
    def of(cls, episodes: Iterable[Episode]) -> Self:
        """Returns the control steps of episodes, which are read one by one.

        Raises a ValueError if there is none, or if the episodes do not have arrays of the same names.
        """
        indices: list[int] = []
        lengths: list[int] = []
        parts: dict[str, list[NDArray]] = {}
        for episode in episodes:
            if indices and (odd := sorted(parts.keys() ^ episode.arrays.keys())):
                raise ValueError(f"episodes {indices[0]} and {episode.index} do not both have the arrays {odd}")
            indices.append(episode.index)
            lengths.append(episode.steps)
            for name, array in episode.arrays.items():
                parts.setdefault(name, []).append(array)
        if not indices:
            raise ValueError("there are no episodes")
        # The parts of one name are freed before those of the next are joined.
        arrays = NamedArrays({name: np.concatenate(parts.pop(name)) for name in [*parts]})
        return cls(arrays=arrays, indices=np.array(indices), lengths=np.array(lengths))

    @property
    def observations(self) -> NamedArrays:
        """Observations `(m + e, ...)` by key, in the types of the environment's observation space.

        Keys of nested observations are joined with slashes, such as `achieved_goal/kettle`. An observation that is one
        array has the key `observation`.
        """
        prefix = f"{_OBSERVATION}/"
        named = {name: rows for name, rows in self.arrays.items() if name == _OBSERVATION or name.startswith(prefix)}
        return NamedArrays({name.removeprefix(prefix): rows for name, rows in named.items()})

    @property
    def actions(self) -> NDArray:
        """Actions `(m, n)` as they were applied: float32, in recordings of `kitchen-rollout` float64."""
        return self.arrays["action"]

    @property
    def rewards(self) -> NDArray[np.float64]:
        """Rewards `(m,)` of the control steps, float64."""
        return self.arrays["reward"]

    @property
    def terminations(self) -> NDArray[np.bool_]:
        """Whether a control step terminated its episode `(m,)`, bool."""
        return self.arrays["termination"]

    @property
    def truncations(self) -> NDArray[np.bool_]:
        """Whether a control step truncated its episode `(m,)`, bool."""
        return self.arrays["truncation"]

    @property
    def rows(self) -> NDArray[np.int64]:
        """Rows `(m,)` of what was observed before each control step; the next row was observed after it."""
        episodes = np.repeat(np.arange(len(self.lengths)), self.lengths)
        return np.arange(len(episodes)) + episodes

    @property
    def last(self) -> NDArray[np.int64]:
        """Number `(m,)`, among all control steps, of the last one in the episode of each control step."""
        return np.repeat(np.cumsum(self.lengths) - 1, self.lengths)

    @property
    def ends(self) -> NDArray[np.bool_]:
        """Whether a control step is the last one of its episode `(m,)`, bool: terminated, truncated, or cut short."""
        return np.arange(len(self.last)) == self.last
