"""Reads the files of trained policies, whatever algorithm has trained them."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from kitchen_suite import checks
from kitchen_suite.policies import stored
from kitchen_suite.policies.imitated import ClonedPolicy, FlowPolicy, TokenPolicy
from kitchen_suite.policies.stored import StoredPolicy
from kitchen_suite.policies.trained import TrainedPolicy

# Files of PPO do not name their algorithm.
_DEFAULT = "ppo"

_CLASSES: Mapping[str, Any] = MappingProxyType(
    {_DEFAULT: TrainedPolicy, **{each.algorithm: each for each in (ClonedPolicy, FlowPolicy, TokenPolicy)}}
)


def load(path: Path) -> StoredPolicy:
    """Reads a policy.

    Raises:
      OSError: the file does not exist, is larger than any policy, or is not an npz file with metadata.
      ValueError: the file has another version of the layout, or lacks or contradicts a part of a policy.
    """
    arrays, metadata = stored.read(path)
    try:
        algorithm = checks.choice(metadata.get("algorithm", _DEFAULT), _CLASSES, "algorithm")
        return _CLASSES[algorithm].from_arrays(arrays, metadata)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{stored.problem(path)}: {error}") from error
