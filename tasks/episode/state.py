"""The state of episodes between control steps."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Self

import numpy as np
import tree
from numpy.typing import NDArray


class EpisodeState(NamedTuple):
    """All that later steps of an episode depend on, beside physics and random state.

    Single and vectorised environments hold one each: its arrays have no leading axis, or one with a row for each
    episode.

    Attributes:
      mdp_state: state of the task's MDP; None before the first reset.
      command: memory of the control mode from earlier actions, such as a commanded pose; None if it has none.
      variation: infos on the variation of the episode; empty if nothing varies.
      parts: state of each optional part by its name; see `part.EpisodePart`.
    """

    mdp_state: Any = None
    command: Any = None
    variation: Mapping[str, Any] = {}
    parts: Mapping[str, Any] = {}

    def keep_fields(self, names: Sequence[str], before: Any, where: NDArray[np.bool_] | bool) -> Self:
        """Returns the state with some fields of the MDP's earlier state, where a mask `(...)` is True."""
        kept = {name: np.where(where, getattr(before, name), getattr(self.mdp_state, name)) for name in names}
        return self._replace(mdp_state=self.mdp_state._replace(**kept)) if kept else self

    def keep_rows(self, before: Self, where: NDArray[np.bool_]) -> Self:
        """Returns the states of many episodes, in fresh arrays, with those before where a mask `(n,)` is True."""

        def kept(present: NDArray, earlier: NDArray) -> NDArray:
            return np.where(where.reshape(-1, *(1,) * (present.ndim - 1)), earlier, present)

        states: Self = map_arrays(kept, self, before)
        return states

    def repeated(self, count: int) -> Self:
        """Returns the state of one episode for `count` of them: arrays with a new first axis."""
        repeated: Self = map_arrays(lambda each: np.repeat(np.asarray(each)[np.newaxis], count, axis=0), self)
        return repeated

    def arrays(self) -> list[Any]:
        """Returns all arrays of the state, None where it has none, always in the same order."""
        arrays: list[Any] = tree.flatten(self)
        return arrays


def map_arrays(function: Callable[..., Any], *nested: Any) -> Any:
    """Returns nested tuples and dicts of arrays with a function applied to each array; None stays None."""
    return tree.map_structure(lambda *parts: None if parts[0] is None else function(*parts), *nested)
