"""Shared by the baselines: flags, inputs of a policy, acting in chunks of actions, and the evaluation."""

import abc
import argparse
import dataclasses
import itertools
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import dm_env
import numpy as np
from numpy.typing import NDArray

import kitchen_suite
from kitchen_suite import EnvironmentSpec, Recording
from kitchen_suite.evaluation.text import format_evaluation
from kitchen_suite.tasks.policy_inputs import PolicyInputs
from kitchen_suite.training import demonstrations
from kitchen_suite.training.demonstrations import Demonstrations

INPUT_EPSILON = 0.01  # Added to the standard deviations of inputs.


def make_parser(documentation: str | None, config: type, num_steps: int) -> argparse.ArgumentParser:
    """Returns a parser of the flags that all baselines have, and of one for each field of the hyperparameters."""
    parser = argparse.ArgumentParser(description=documentation, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, required=True, help="new folder of settings, scores and receipt")
    parser.add_argument("--num_steps", type=int, default=num_steps, help="steps of the optimiser (%(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the training (%(default)s)")
    parser.add_argument("--protocol", default="default", help="of the evaluation (%(default)s)")
    parser.add_argument("--eval_episodes", type=int, default=100, help="(%(default)s)")
    parser.add_argument("--eval_seed", type=int, default=400_000_000, help="of the first episode (%(default)s)")
    for field in dataclasses.fields(config):
        kind = type(field.default)
        parser.add_argument(f"--{field.name}", type=kind, default=argparse.SUPPRESS, help=f"({field.default})")
    return parser


def add_demonstrations(parser: argparse.ArgumentParser) -> None:
    """Adds the flags of baselines that learn from successful episodes."""
    parser.add_argument("recordings", type=Path, nargs="+", help="folders of kitchen-record")
    parser.add_argument("--num_demonstrations", type=int, help="episodes of each recording; all without it")
    add_task(parser)


def add_task(parser: argparse.ArgumentParser) -> None:
    """Adds the flags of the task to evaluate on."""
    parser.add_argument("--task_name", help="to evaluate on; that of the recording without it")
    of_task = "of that task, as JSON, such as variations; those of the recording without it"
    parser.add_argument("--task_kwargs", type=json.loads, help=of_task)


def task(given: argparse.Namespace, recorded: EnvironmentSpec) -> EnvironmentSpec:
    """Returns the task to evaluate on: the one of the flags, where they name one, or that of a recording."""
    task_kwargs = recorded.task_kwargs if given.task_kwargs is None else given.task_kwargs
    return EnvironmentSpec.make(recorded.domain_name, given.task_name or recorded.task_name, task_kwargs)


def load_demonstrations(given: argparse.Namespace) -> tuple[EnvironmentSpec, PolicyInputs, Demonstrations]:
    """Returns the task to evaluate on, what policies take of its observations, and the successful episodes."""
    spec = task(given, Recording.open(given.recordings[0]).spec)
    observed = policy_inputs(spec)
    counts = [given.num_demonstrations] if given.num_demonstrations else []
    found = demonstrations.load_demonstrations(given.recordings, spec, requested_tasks(observed), counts)
    if found.state_elements is not None:
        raise SystemExit("the recordings hold a part of the state alone")
    return spec, observed, found


def changes(config: type, given: argparse.Namespace) -> dict[str, Any]:
    """Returns the hyperparameters that are among the given flags, by name."""
    names = {field.name for field in dataclasses.fields(config)}
    return {name: value for name, value in vars(given).items() if name in names}


def policy_inputs(spec: EnvironmentSpec) -> PolicyInputs:
    """Returns what policies take of the observations of environments."""
    with spec.make_environment() as environment:
        return environment.unwrapped.environment.task.policy_inputs


def requested_tasks(inputs: PolicyInputs) -> tuple[str, ...]:
    """Returns the tasks whose request a policy observes; none where every episode requests the same ones."""
    return inputs.tasks if inputs.observes_requests else ()


class ChunkPolicy(abc.ABC):
    """Predicts a chunk of actions, and applies the first ones before it predicts the next chunk."""

    def __init__(self, observed: PolicyInputs, executed: int, generators: Iterator[np.random.Generator]) -> None:
        """Prepares to act; of each chunk `executed` actions are applied. `generators` are those of the episodes."""
        self._observed = observed
        self._executed = executed
        self._generators = generators
        self._waiting: list[NDArray[np.float32]] = []

    @abc.abstractmethod
    def predict(self, inputs: NDArray, generator: np.random.Generator) -> NDArray[np.float32]:
        """Returns a chunk of actions `(c, k)` for inputs `(n,)`; the generator is that of the episode."""

    def __call__(self, timestep: dm_env.TimeStep) -> NDArray[np.float32]:
        """Returns the action for a time step of an episode."""
        if timestep.first():
            self._generator = next(self._generators)
            self._waiting = []
        if not self._waiting:
            tasks = requested_tasks(self._observed)
            inputs = self._observed.state_and_requests(timestep.observation, tasks).ravel()
            self._waiting = [*self.predict(inputs, self._generator)[: self._executed]]
        return self._waiting.pop(0)


def generators(first_seed: int) -> Iterator[np.random.Generator]:
    """Yields a generator for each episode of one condition, of the seed of that episode: they are played in order."""
    # The 1 tells its stream from that of the environment.
    return (np.random.default_rng((seed, 1)) for seed in itertools.count(first_seed))


def evaluate(policy: ChunkPolicy, spec: EnvironmentSpec, given: argparse.Namespace) -> None:
    """Evaluates a policy on a task, and writes scores and receipt.

    Protocols such as `default` vary the start unless the arguments of the task say what varies.
    """
    # One episode after the other, by time steps: the policy keeps a chunk of actions between control steps, and drops
    # it at the first time step of an episode.
    evaluation = kitchen_suite.evaluate(
        policy,
        takes="timestep",
        protocol=given.protocol,
        domain_name=spec.domain_name,
        task_name=spec.task_name,
        task_kwargs=spec.task_kwargs,
        num_episodes=given.eval_episodes,
        seed=given.eval_seed,
        num_envs=1,
        receipt=given.output / "receipt.npz",
    )
    print(format_evaluation(evaluation))
    write_json(given.output / "evaluation.json", evaluation.as_json())


def write_training(given: argparse.Namespace, config: Any, processor_seconds: float) -> None:
    """Writes the settings of a training, and how long it took."""
    measured = {"num_steps": given.num_steps, "seed": given.seed, "processor_minutes": processor_seconds / 60}
    write_json(given.output / "training.json", {**measured, **vars(config)})


def write_json(path: Path, value: Any) -> None:
    """Writes a value as JSON."""
    path.write_text(json.dumps(value, indent=1) + "\n", encoding="utf-8")
