"""The plan of an evaluation: its protocol with all replaced values, and the episodes of each condition."""

import contextlib
import dataclasses
import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Self

from msgspec import Meta

from kitchen_suite import checks, files, suite
from kitchen_suite.entities.arms import FRANKA
from kitchen_suite.episodes.spec import EnvironmentSpec, EpisodeSpec
from kitchen_suite.evaluation import criteria, goals, quality
from kitchen_suite.evaluation.goals import check_franka
from kitchen_suite.evaluation.protocols import (
    EPISODE,
    PROTOCOLS,
    Condition,
    Goals,
    Measure,
    Protocol,
    Score,
    domain_protocols,
)
from kitchen_suite.evaluation.scores import MAX_SEED, EpisodeResult, score_episodes, score_sample
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies import PolicyRef
from kitchen_suite.tasks.variations.distributions import NONE
from kitchen_suite.versions import PACKAGES, VERSION

# Values of a protocol that are numbers of all conditions.
_NUMBERS = ("seed", "num_episodes", "max_episode_steps")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Replaced:
    """Values that replace a protocol's; those that are None are the protocol's.

    Attributes:
      domain_name: of the environments.
      task_name: of all conditions.
      task_kwargs: arguments of the environments of all conditions, beside those of the protocol.
      seed: of the first episode of each condition.
      num_episodes: of each condition.
      max_episode_steps: control steps after which an episode ends.
    """

    domain_name: str = "kitchen"
    task_name: str | None = None
    task_kwargs: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    seed: int | None = None
    num_episodes: int | None = None
    max_episode_steps: int | None = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class EvaluationPlan:
    """An evaluation that can be played; episode `i` of every condition has the seed `seed + i`.

    Attributes:
      protocol: its name.
      specs: specifications of the episodes by the names of the conditions.
      num_episodes: of each condition.
      resets: options of the reset of each episode, as JSON, by condition; empty where the seeds say it all.
    """

    protocol: str
    specs: Mapping[str, EpisodeSpec]
    num_episodes: int
    resets: Mapping[str, Sequence[dict[str, Any]]] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        """Raises a ValueError if positions of `criteria.STATE` are measured, or goals, with another arm than theirs."""
        for name, condition in self.conditions.items():
            if condition.measures or condition.goals:
                check_franka(self.specs[name], f"protocol {self.protocol!r}")

    @property
    def conditions(self) -> dict[str, Condition]:
        """The protocol's condition by each name; where its task was replaced, one with its goals, but no measures."""
        protocol = PROTOCOLS[self.protocol]
        own = {(condition.name, condition.task_name): condition for condition in protocol.conditions}
        first = protocol.conditions[0]
        replaced = Condition(goals=first.goals, goal_options=first.goal_options)
        return {name: own.get((name, spec.task_name), replaced) for name, spec in self.specs.items()}

    @property
    def goals(self) -> dict[str, Goals]:
        """By condition, the function that takes the goals of its episodes from a recording."""
        return {name: condition.goals for name, condition in self.conditions.items() if condition.goals}

    def draw_resets(self, dataset: Path) -> dict[str, list[dict[str, Any]]]:
        """Returns the options of the resets of the conditions with goals, see `goals.draw_resets`."""
        seeds = range(self.first.seed, self.first.seed + self.num_episodes)
        return goals.draw_resets(self.goals, seeds, dataset, self.first.domain_name)

    @property
    def measures(self) -> dict[str, Mapping[str, Measure]]:
        """Further measures of episodes, by condition."""
        return {name: condition.measures for name, condition in self.conditions.items()}

    @property
    def measure_names(self) -> dict[str, list[str]]:
        """Names of the measures of an episode's result, those of its quality included, by condition."""
        return {name: [*own, *quality.measured(self.specs[name])] for name, own in self.measures.items()}

    @property
    def score(self) -> Score | None:
        """The published score of the protocol, if it has one, unless the episodes ask for other tasks."""
        protocol = PROTOCOLS[self.protocol]
        own = [_tasks_of(condition.task_name, condition.task_kwargs) for condition in protocol.conditions]
        found = [_tasks_of(spec.task_name, spec.task_kwargs) for spec in self.specs.values()]
        return protocol.score if all(each in own for each in found) else None

    @property
    def is_sample(self) -> bool:
        """Whether the conditions are a sample of many more, and scores are means over them."""
        protocol = PROTOCOLS[self.protocol]
        return bool(protocol.sampled) and len(self.specs) == len(protocol.conditions)

    @property
    def unit(self) -> str:
        """The unit of observation, such as an episode: see `Protocol.unit`."""
        return PROTOCOLS[self.protocol].unit if self.is_sample else EPISODE

    @property
    def control(self) -> str | None:
        """The control arm, the condition with which others are compared in pairs; None where there is none."""
        has_control = PROTOCOLS[self.protocol].has_control and len(self.specs) > 1
        return next(iter(self.specs)) if has_control else None

    def scores(self, results: Sequence[EpisodeResult]) -> dict[str, Any]:
        """Returns the scores of the episodes of a condition, see `score_episodes`."""
        return score_episodes(results, self.score, self.first.max_episode_steps)

    def main_scores(self, by_condition: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
        """Returns the scores by which the evaluation is known: of its first condition, or the means over a sample."""
        if self.is_sample:
            return score_sample(by_condition, PROTOCOLS[self.protocol].sampled)
        return dict(next(iter(by_condition.values())))

    def reset_options(self, name: str, index: int) -> dict[str, Any]:
        return self.resets[name][index] if name in self.resets else {}

    @property
    def first(self) -> EpisodeSpec:
        return next(iter(self.specs.values()))

    @property
    def description(self) -> dict[str, Any]:
        """The evaluation without its results, as JSON represents it, without paths and times."""
        first, conditions = self.first, {}
        for name, spec in self.specs.items():
            task = {"task_name": spec.task_name, "task_kwargs": dict(spec.task_kwargs)}
            conditions[name] = {**task, "policy_sha256": spec.policy_sha256}
        return {
            "protocol": self.protocol,
            "domain_name": first.domain_name,
            "policy": PolicyRef.parse(first.policy).without_file,
            "seed": first.seed,
            "num_episodes": self.num_episodes,
            "max_episode_steps": first.max_episode_steps,
            **({"goals_sha256": hashlib.sha256(json.dumps(self.resets).encode()).hexdigest()} if self.resets else {}),
            "versions": dict(first.versions),
            "conditions": json.loads(json.dumps(conditions)),
        }

    @property
    def replaced(self) -> list[str]:
        """Names of the values that are not the protocol's; what a policy has to observe is not among them."""
        return [*dict.fromkeys(name if name in _NUMBERS else "conditions" for name in self.changes)]

    @property
    def _unchanged(self) -> "EvaluationPlan":
        """The protocol in the plan's domain, without replaced values."""
        return make_unprepared_plan(
            PolicyRef.parse("zero"), self.protocol, Replaced(domain_name=self.first.domain_name)
        )

    @property
    def changes(self) -> dict[str, tuple[Any, Any]]:
        """The values that are not the protocol's, by name, each with the protocol's; None for a default.

        A value that is the default, and one that is omitted, are the same. The names of arguments begin with that of
        their condition, unless they are the same in all conditions.
        """
        unchanged = self._unchanged
        mine, its = self.description, unchanged.description
        found = {name: (mine[name], its[name]) for name in _NUMBERS if mine[name] != its[name]}
        if [*self.specs] != [*unchanged.specs]:
            found["conditions"] = [*self.specs], [*unchanged.specs]
        by_condition = {}
        for name, spec in self.specs.items():
            # Where the task is replaced, the first condition stands for all.
            other = unchanged.specs.get(name, unchanged.first)
            by_condition[name] = _differences(spec, other, self._ignored)
        common = set.intersection(*({*map(json.dumps, each.items())} for each in by_condition.values()))
        for name, each in by_condition.items():
            for argument, pair in each.items():
                is_common = json.dumps((argument, pair)) in common
                found[argument if is_common else f"{name}: {argument}"] = pair
        return found

    @property
    def _ignored(self) -> set[str]:
        """Arguments that replace nothing of the protocol."""
        is_of_quality = any(condition.task_kwargs.get("quality") for condition in PROTOCOLS[self.protocol].conditions)
        # Quality measures what happens, and changes nothing of it; scores of some protocols are made of it.
        return {"extra_observables"} if is_of_quality else {"extra_observables", "quality"}

    @classmethod
    def of(cls, description: Mapping[str, Any], resets: Mapping[str, list[dict[str, Any]]] | None = None) -> Self:
        """Returns the plan of a description, unprepared; a TypeError or ValueError for one of another version."""
        record = files.parse(description, _Description, "not the description of an evaluation")
        domain = suite.DOMAINS[checks.choice(record.domain_name, suite.DOMAINS, "domain")]
        if record.protocol not in PROTOCOLS:
            raise ValueError(
                f"it is of protocol {checks.shown(record.protocol)}, which this version of the suite does not have: "
                f"replay it with the version that wrote it. Here there are {sorted(PROTOCOLS)}"
            )
        protocol = find_protocol(record.protocol, domain.name)
        _check_versions(record.versions)
        specs = {}
        for name, condition in record.conditions.items():
            task_name, kwargs = condition.task_name, condition.task_kwargs
            _check_name(protocol, name, task_name)
            check_robot(kwargs)
            if domain.with_contents(kwargs) != kwargs:
                raise ValueError(f"{name} depends on files of the machine that wrote it, which may be others elsewhere")
            environments = EnvironmentSpec.make(domain.name, task_name, kwargs, record.max_episode_steps)
            played = environments.episodes(PolicyRef.parse("zero"), seed=record.seed)
            specs[name] = dataclasses.replace(
                played, policy=record.policy, policy_sha256=condition.policy_sha256, versions=record.versions
            )
        return cls(protocol=protocol.name, specs=specs, num_episodes=record.num_episodes).with_resets(resets or {})

    def with_resets(self, resets: Mapping[str, list[dict[str, Any]]]) -> Self:
        """Returns the plan with options of resets; a ValueError unless the conditions with goals have some that fit."""
        if resets.keys() != self.goals.keys():
            raise ValueError(f"episodes of {sorted(resets)} have goals of their own, not of {sorted(self.goals)}")
        for name, each in resets.items():
            with contextlib.closing(self.specs[name].make_environment()) as environment:
                requests = suite_env(environment).composer_task.requests
            goal_options = {*self.conditions[name].goal_options}
            for options in each:
                if options.keys() != goal_options:
                    shown = f"the options {sorted(options)}, not {sorted(goal_options)}"
                    raise ValueError(f"the reset of an episode of {name} has {shown}, which are its goals")
                requests.checked(options)
                if criteria.holds_at_start(options):
                    raise ValueError(f"a goal of {name} holds at the start of its episode: it cannot be reached")
            if len(each) != self.num_episodes:
                raise ValueError(f"{len(each)} episodes of {name} have goals of their own, not {self.num_episodes}")
        return dataclasses.replace(self, resets=dict(resets))


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Condition:
    task_name: str
    task_kwargs: dict[str, Any]
    policy_sha256: str | None


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Description:
    """`EvaluationPlan.description`."""

    protocol: str
    domain_name: str
    policy: str
    seed: Annotated[int, Meta(ge=0)]
    num_episodes: Annotated[int, Meta(ge=1, le=checks.MAX_COUNT)]
    max_episode_steps: Annotated[int, Meta(ge=1, le=checks.MAX_EPISODE_STEPS)]
    versions: dict[str, str]
    goals_sha256: str | None = None
    conditions: Annotated[dict[str, _Condition], Meta(min_length=1)]


def make_plan(
    policy: PolicyRef, protocol: str = "default", replaced: Replaced = Replaced(), dataset: Path | None = None
) -> EvaluationPlan:
    """Plans the evaluation of a policy under a protocol, and builds the policy once in each condition.

    A policy that is the same in every task is built in the first one alone, so that an action of the wrong size shows
    before the environments of all conditions have been built.

    `dataset` is the folder of a recording, from whose episodes some protocols take their goals.
    """
    plan = make_unprepared_plan(policy, protocol, replaced)
    first, *_ = plan.specs
    prepared = {
        name: spec if policy.is_independent_of_tasks and name != first else spec.prepared(policy)
        for name, spec in plan.specs.items()
    }
    if dataset is None:
        if plan.goals:
            raise ValueError(f"protocol {plan.protocol!r} needs a dataset: the folder of a recording, for its goals")
        return dataclasses.replace(plan, specs=prepared)
    if not plan.goals:
        raise ValueError(f"protocol {plan.protocol!r} takes no goals from a dataset")
    return dataclasses.replace(plan.with_resets(plan.draw_resets(dataset)), specs=prepared)


def make_unprepared_plan(policy: PolicyRef, protocol: str, replaced: Replaced) -> EvaluationPlan:
    """Plans an evaluation as `make_plan` does, but builds no policy, and takes no goals from a dataset."""
    found = find_protocol(protocol, replaced.domain_name)
    given_count = found.num_episodes if replaced.num_episodes is None else replaced.num_episodes
    count = checks.integer(given_count, "num_episodes", minimum=1, maximum=checks.MAX_COUNT)
    return EvaluationPlan(protocol=found.name, specs=_specs(policy, found, replaced), num_episodes=count)


def _tasks_of(task_name: str | None, task_kwargs: Mapping[str, Any]) -> tuple[Any, ...]:
    """Returns what decides for which tasks the episodes of a condition ask."""
    return task_name, *(json.dumps(task_kwargs.get(name)) for name in ("tasks_to_complete", "tasks_per_episode"))


def _differences(spec: EpisodeSpec, other: EpisodeSpec, ignored: Collection[str]) -> dict[str, tuple[Any, Any]]:
    """Returns task and arguments that two conditions have otherwise, as `EvaluationPlan.changes`."""
    found: dict[str, tuple[Any, Any]] = {}
    if spec.task_name != other.task_name:
        found["task_name"] = spec.task_name, other.task_name
    # Defaults of further arguments may depend on the control mode.
    mode = {name: value for name, value in spec.task_kwargs.items() if name == "control_mode"}
    in_mode = dataclasses.replace(other, task_kwargs={**other.task_kwargs, **mode})
    for name in {**spec.task_kwargs, **other.task_kwargs}:
        if name not in ignored and spec.argument(name) != (other if name in mode else in_mode).argument(name):
            found[name] = _given(spec, name), _given(other, name)
    return found


def _given(spec: EpisodeSpec, name: str) -> Any:
    """Returns an argument as it was given, None for a default; groups of variations in one form."""
    if name == "variations":
        return spec.argument(name) or NONE
    return spec.task_kwargs.get(name)


def _check_name(protocol: Protocol, name: str, task_name: str) -> None:
    """Raises a ValueError unless a condition of a task has the name that the protocol gives it; see `_specs`."""
    names = [_name_of(condition, task_name) for condition in protocol.conditions]
    if name not in names:
        problem = f"{name!r} is no condition of protocol {protocol.name!r} with the task {task_name!r}"
        raise ValueError(f"{problem}: that is called {' or '.join(map(repr, dict.fromkeys(names)))}")


def _name_of(condition: Condition, task_name: str) -> str:
    """Returns the name of a condition whose episodes are of a task."""
    is_replaced = condition.task_name not in (None, task_name)
    return task_name if is_replaced else condition.name or task_name


def find_protocol(name: str, domain_name: str) -> Protocol:
    """Returns a protocol of a domain; a ValueError if it is for other domains."""
    own = {None, domain_name}
    taken = domain_protocols(domain_name).protocols
    protocol = PROTOCOLS[checks.choice(name, PROTOCOLS.keys(), "protocol")]
    offered = [each.name for each in PROTOCOLS.values() if each.domain_name in own or each.name in taken]
    if name not in offered:
        raise ValueError(f"protocol {name!r} is not for domain {domain_name!r}; choose from {offered}")
    return protocol


def _specs(policy: PolicyRef, protocol: Protocol, replaced: Replaced) -> dict[str, EpisodeSpec]:
    """Returns the specifications by condition, with the values that are replaced; equal ones only once."""
    first, *others = (condition.task_kwargs for condition in protocol.conditions)
    differing = {name for each in others for name in first.keys() | each.keys() if first.get(name) != each.get(name)}
    if clash := sorted(differing & replaced.task_kwargs.keys()):
        raise ValueError(f"the conditions of protocol {protocol.name!r} differ in {clash}, which cannot be replaced")
    given_seed = protocol.seed if replaced.seed is None else replaced.seed
    seed = checks.integer(given_seed, "seed", minimum=0, maximum=MAX_SEED - checks.MAX_COUNT)
    given_steps = replaced.max_episode_steps
    max_episode_steps = protocol.max_episode_steps if given_steps is None else given_steps
    default_task = domain_protocols(replaced.domain_name).task_name
    specs: dict[str, EpisodeSpec] = {}
    for condition in protocol.conditions:
        task_name = replaced.task_name or condition.task_name or default_task
        kwargs = {**_available(condition.task_kwargs, replaced.domain_name), **replaced.task_kwargs}
        environments = EnvironmentSpec.make(replaced.domain_name, task_name, kwargs, max_episode_steps)
        if condition.measures or condition.goals:
            # Before the model of another arm is looked for.
            check_franka(environments, f"protocol {protocol.name!r}")
        spec = environments.episodes(policy, seed=seed)
        if spec in specs.values():
            continue
        name = _name_of(condition, spec.task_name)
        if name in specs:
            raise ValueError(f"the conditions of protocol {protocol.name!r} are of tasks that {name!r} cannot replace")
        specs[name] = spec
    return specs


def _available(task_kwargs: Mapping[str, Any], domain_name: str) -> dict[str, Any]:
    """Returns the arguments of a condition without the groups of variations that a domain does not have."""
    available = {row.group for row in suite.find_domain(domain_name).resolve("task").varied}
    groups = [name for name in task_kwargs.get("variations", ()) if name in available]
    others = {name: value for name, value in task_kwargs.items() if name not in ("variations", "variation_split")}
    if not groups:
        return others
    return {**task_kwargs, "variations": groups}


def check_robot(task_kwargs: Mapping[str, Any]) -> None:
    """Raises a ValueError if a robot is not the suite's: to read a receipt must not import code that it names."""
    if (robot := task_kwargs.get("robot", FRANKA)) != FRANKA:
        raise ValueError(f"the robot of a receipt must be {FRANKA!r}, not {checks.shown(robot)}")


def _check_versions(versions: Mapping[str, str]) -> None:
    """Raises a ValueError unless a file names versions of the suite's packages alone.

    They are shown as facts, which any other words could be taken for.
    """
    for name, version in versions.items():
        checks.choice(name, ("kitchen-suite", *PACKAGES), "package of the versions")
        if not VERSION.fullmatch(version):
            raise ValueError(f"the version of {name} is no version: {checks.shown(version)}")
