"""Behaviour cloning: fits an agent's policy to recorded demonstrations before reinforcement learning."""

import contextlib
import inspect
import json
import pkgutil
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from kitchen_suite import suite
from kitchen_suite.gymnasium_env import base
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.rollouts.folder import SPEC_FILE, RecordingFolder
from kitchen_suite.rollouts.spec import EnvironmentSpec
from kitchen_suite.training.ppo import Agent

# Bound of the imitated actions, in units of the action scale. Beyond it, servos and gripper are saturated, and the
# squared error of a few large actions would dominate the loss.
_ACTION_LIMIT = 5.0

# Arguments of all domains on which the meaning of observed numbers depends.
OBSERVATION_OPTIONS = ("obs_type", "extra_observables")

# Other advice than to pass the same arguments to recording and training.
_REMEDIES = {"obs_type": "record again without obs_type; the same seeds are the same episodes"}

_BATCH_SIZE, _LEARNING_RATE, _WEIGHT_DECAY = 512, 1e-3, 1e-4


def load_demonstrations(folder: Path, spec: EnvironmentSpec) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Reads the episodes that `kitchen-record` has written to a folder.

    Args:
      folder: of the recording.
      spec: of the environments to be trained in.

    Returns:
      Flat observations `(m, n)` in the order of a trained policy's, and the actions `(m, k)` taken on them.

    Raises:
      OSError: there is no recording, or one of its episodes cannot be read.
      ValueError: it is of another task or with other arguments that observations or actions depend on, or holds no
        episodes.
    """
    recording = open_recording(folder, spec, suite.DOMAINS[spec.domain_name].cloning_options)
    found, expected = (f"{each.domain_name} {each.task_name}" for each in (recording.spec, spec))
    if found != expected:
        raise ValueError(f"{folder} holds episodes of {found}, not of {expected}")
    if not recording.indices:
        raise ValueError(f"{folder} holds no episodes yet")
    if recording.spec.origin is not None:
        raise ValueError(f"{folder} was made by kitchen-convert: --algorithm=bc, flow or vqbet learns from it")
    episodes = [recording.load(index).arrays for index in recording.indices]
    observations = np.concatenate([flat_observations(arrays)[:-1] for arrays in episodes])
    actions = np.concatenate([arrays["action"] for arrays in episodes])
    return observations.astype(np.float32), actions.astype(np.float32)


def open_recording(folder: Path, wanted: EnvironmentSpec, options: Collection[str]) -> RecordingFolder:
    """Opens a recording whose observations and actions mean the same as in the environments to be trained in.

    Args:
      folder: of the recording.
      wanted: specification of those environments.
      options: names of the domain's options that have to be equal.

    Raises:
      OSError: there is no recording.
      ValueError: the domains differ, or one of the options.
    """
    if not (folder / SPEC_FILE).exists():
        raise FileNotFoundError(f"there is no recording in {folder}: kitchen-record --output={folder} makes one")
    recording = RecordingFolder.open(folder)
    recorded = recording.spec
    if recorded.domain_name != wanted.domain_name:
        found, expected = (f"{each.domain_name} {each.task_name}" for each in (recorded, wanted))
        raise ValueError(f"{folder} holds episodes of {found}, not of {expected}")
    for name in (*OBSERVATION_OPTIONS, *options):
        one, other = (_argument(spec, name) for spec in (recorded, wanted))
        if one != other:
            one, other = _in_mode(recorded, name, one), _in_mode(wanted, name, other)
        if one != other:
            raise ValueError(
                f"{folder} was recorded with {name} {json.dumps(one)}, but this run has {json.dumps(other)}: "
                f"{_REMEDIES.get(name, 'pass the same --task_kwargs to both commands')}"
            )
    return recording


def _argument(spec: EnvironmentSpec, name: str) -> Any:
    """Returns an argument of the environments of a specification, as JSON represents it."""
    environment = pkgutil.resolve_name(suite.DOMAINS[spec.domain_name].env)
    parameter = inspect.signature(environment).parameters.get(name)
    default = {name: parameter.default if parameter else base.DEFAULTS[name]}
    arguments = {**default, **suite.task_arguments(spec.domain_name, spec.task_name), **spec.task_kwargs}
    return json.loads(json.dumps(arguments[name]))


def _in_mode(spec: EnvironmentSpec, name: str, value: Any) -> Any:
    """Returns the value of an argument; where it is None, that of the environments' control mode, if it has it."""
    if value is not None:
        return value
    with contextlib.closing(spec.make_environment()) as environment:
        mode = suite_env(environment).environment.task.mdp.action_mode
    return mode.name if name == "control_mode" else getattr(mode, name, None)


def flat_observations(arrays: Mapping[str, NDArray]) -> NDArray:
    """Returns an episode's observations `(T + 1, n)` as a trained policy takes them; see `trained.flat`.

    Goals recorded by task have one array for each task, in the configured order, which is that of flat goals.
    """
    if "observation" in arrays:
        return arrays["observation"]
    keys = [f"observation/{key}" for key in ("observation", "achieved_goal", "desired_goal", "requested_tasks")]
    parts = [array for key in keys for name, array in arrays.items() if name.startswith(key)]
    return np.concatenate(parts, axis=-1)


def clone(
    agent: Agent,
    observations: NDArray[np.float32],
    actions: NDArray[np.float32],
    epochs: int,
    report: Callable[[float], None] = lambda loss: None,
) -> None:
    """Fits the mean of an agent's policy to demonstrated actions, by least squares.

    The demonstrations also fix the standardisation of observations.

    Args:
      agent: as built by `build_agent`.
      observations: `(m, n)`.
      actions: `(m, k)`.
      epochs: number of passes over the demonstrations.
      report: called after each pass with its mean loss, in squared units of the action scale.
    """
    policy = agent.policy
    inputs = _fit_scaler(agent, torch.as_tensor(observations))
    targets = (torch.as_tensor(actions) / policy.scale).clamp(-_ACTION_LIMIT, _ACTION_LIMIT)
    optimizer = torch.optim.AdamW(policy.network.parameters(), lr=_LEARNING_RATE, weight_decay=_WEIGHT_DECAY)
    num_batches = -(-len(targets) // _BATCH_SIZE)
    scheduler = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, epochs * num_batches)
    for _ in range(epochs):
        losses = []
        for batch in torch.randperm(len(targets)).split(_BATCH_SIZE):
            loss = torch.nn.functional.mse_loss(policy.network(inputs[batch]), targets[batch])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            scheduler.step()
            losses.append(loss.item())
        report(float(np.mean(losses)))
    agent.restart_average()


def _fit_scaler(agent: Agent, observations: torch.Tensor) -> torch.Tensor:
    """Fixes the standardisation by observations `(m, n)`; returns them standardised."""
    scaler = agent.observation_scaler
    scaler.update(observations)
    # Every PPO update adds to the statistics, which would change what the cloned policy sees.
    scaler.freeze()
    return scaler(observations)
