"""The plan of an evaluation: its protocol with all replaced values, and the episodes of each condition."""

import dataclasses
import json
from collections.abc import Mapping
from typing import Annotated, Any

from msgspec import Meta

from kitchen_suite import checks, files, policies, suite
from kitchen_suite.evaluation.protocols import PROTOCOLS, Condition, Measure, Protocol, Score, domain_protocols
from kitchen_suite.rollouts.spec import EnvironmentSpec, EpisodeSpec
from kitchen_suite.settings import MAX_COUNT, MAX_EPISODE_STEPS, EvaluateSettings


@dataclasses.dataclass(frozen=True, kw_only=True)
class EvaluationPlan:
    """An evaluation that can be played; episode `i` of every condition has the seed `seed + i`.

    Attributes:
      protocol: its name.
      specs: specifications of the episodes by the names of the conditions.
      num_episodes: of each condition.
      score: a published score; None if the protocol has none, or if it is for other tasks.
      measures: further measures of episodes, by the names of the conditions.
    """

    protocol: str
    specs: Mapping[str, EpisodeSpec]
    num_episodes: int
    score: Score | None
    measures: Mapping[str, Mapping[str, Measure]]

    @property
    def first(self) -> EpisodeSpec:
        """Specification of the first condition."""
        return next(iter(self.specs.values()))

    @property
    def description(self) -> dict[str, Any]:
        """The evaluation without its results, as JSON represents it, without paths and times."""
        first = self.first
        return {
            "protocol": self.protocol,
            "domain_name": first.domain_name,
            "policy": policies.without_file(first.policy),
            "seed": first.seed,
            "num_episodes": self.num_episodes,
            "max_episode_steps": first.max_episode_steps,
            "versions": dict(first.versions),
            "conditions": {name: _described(spec) for name, spec in self.specs.items()},
        }

    @property
    def replaced(self) -> list[str]:
        """Names of the values that are not the protocol's; what a policy has to observe is not among them."""
        own = _unprepared(EvaluateSettings(protocol=self.protocol, domain_name=self.first.domain_name))
        mine, its = _values(self), _values(own)
        return [name for name in mine if mine[name] != its[name]]

    @classmethod
    def of(cls, description: Mapping[str, Any]) -> "EvaluationPlan":
        """Returns the plan of a description, with what the policy has observed, but not prepared for the policy.

        Raises a ValueError or TypeError if it is of another version of the suite, or no description.
        """
        record = files.parse(description, _Description, "not the description of an evaluation")
        domain = suite.DOMAINS[checks.choice(record.domain_name, suite.DOMAINS, "domain")]
        protocol = find_protocol(record.protocol, domain.name)
        specs = {}
        for name, condition in record.conditions.items():
            environments = EnvironmentSpec.make(
                domain_name=domain.name,
                task_name=condition.task_name,
                task_kwargs=condition.task_kwargs,
                max_episode_steps=record.max_episode_steps,
            )
            played = environments.episodes(policy="zero", seed=record.seed, seeding="gymnasium")
            specs[name] = dataclasses.replace(
                played, policy=record.policy, policy_sha256=condition.policy_sha256, versions=record.versions
            )
        return cls(
            protocol=protocol.name,
            specs=specs,
            num_episodes=record.num_episodes,
            score=_score(protocol, specs),
            measures=_measures(protocol, specs),
        )


@dataclasses.dataclass(frozen=True, kw_only=True)
class _Condition:
    """A condition in a description."""

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
    num_episodes: Annotated[int, Meta(ge=1, le=MAX_COUNT)]
    max_episode_steps: Annotated[int, Meta(ge=1, le=MAX_EPISODE_STEPS)]
    versions: dict[str, str]
    conditions: Annotated[dict[str, _Condition], Meta(min_length=1)]


def make_plan(settings: EvaluateSettings) -> EvaluationPlan:
    """Plans the evaluation that a command asks for, and builds the policy once in each condition."""
    plan = _unprepared(settings)
    return dataclasses.replace(plan, specs={name: spec.prepared() for name, spec in plan.specs.items()})


def _unprepared(settings: EvaluateSettings) -> EvaluationPlan:
    """Returns the plan of an evaluation, without what the policy needs."""
    protocol = find_protocol(settings.protocol, settings.domain_name)
    specs = _specs(protocol, settings)
    return EvaluationPlan(
        protocol=protocol.name,
        specs=specs,
        num_episodes=protocol.num_episodes if settings.num_episodes is None else settings.num_episodes,
        score=_score(protocol, specs),
        measures=_measures(protocol, specs),
    )


def _values(plan: EvaluationPlan) -> dict[str, Any]:
    """Returns what a protocol fixes, by name."""
    first = plan.first
    single = {"seed": first.seed, "num_episodes": plan.num_episodes, "max_episode_steps": first.max_episode_steps}
    conditions = {name: _described(spec) for name, spec in plan.specs.items()}
    for condition in conditions.values():
        condition["task_kwargs"].pop("extra_observables", None)
        del condition["policy_sha256"]
    return {**single, "conditions": [*conditions.items()]}


def _score(protocol: Protocol, specs: Mapping[str, EpisodeSpec]) -> Score | None:
    """Returns the published score of a protocol, unless the episodes are of other tasks."""
    own_tasks = {condition.task_name for condition in protocol.conditions}
    return protocol.score if {spec.task_name for spec in specs.values()} <= own_tasks else None


def _measures(protocol: Protocol, specs: Mapping[str, EpisodeSpec]) -> dict[str, Mapping[str, Measure]]:
    """Returns the measures of each condition; none where its task was replaced."""
    own = {(condition.name, condition.task_name): condition.measures for condition in protocol.conditions}
    return {name: own.get((name, spec.task_name), {}) for name, spec in specs.items()}


def find_protocol(name: str, domain_name: str) -> Protocol:
    """Returns a protocol of a domain; a ValueError if it is for other domains."""
    own = domain_protocols(domain_name).protocols
    protocol = PROTOCOLS[checks.choice(name, PROTOCOLS.keys(), "protocol")]
    offered = [each.name for each in PROTOCOLS.values() if each.is_general or each.name in own]
    if name not in offered:
        raise ValueError(f"protocol {name!r} is not for domain {domain_name!r}; choose from {offered}")
    return protocol


def _specs(protocol: Protocol, settings: EvaluateSettings) -> dict[str, EpisodeSpec]:
    """Returns the specifications by condition, with the values that settings replace; equal ones only once."""
    given = settings.environment_kwargs
    if clash := sorted(_differing(protocol) & given.keys()):
        raise ValueError(f"the conditions of protocol {protocol.name!r} differ in {clash}, which cannot be replaced")
    specs: dict[str, EpisodeSpec] = {}
    for condition in protocol.conditions:
        spec = _spec(protocol, condition, settings, given)
        if spec not in specs.values():
            replaced = condition.task_name not in (None, spec.task_name)
            specs[spec.task_name if replaced else condition.name or spec.task_name] = spec
    return specs


def _differing(protocol: Protocol) -> set[str]:
    """Returns the names of the arguments in which the conditions of a protocol differ."""
    first, *others = (condition.task_kwargs for condition in protocol.conditions)
    return {name for other in others for name in first.keys() | other.keys() if first.get(name) != other.get(name)}


def _spec(
    protocol: Protocol, condition: Condition, settings: EvaluateSettings, given: Mapping[str, Any]
) -> EpisodeSpec:
    """Returns the specification of the episodes of a condition, in which settings replace the protocol's values."""
    environments = EnvironmentSpec.make(
        domain_name=settings.domain_name,
        task_name=settings.task_name or condition.task_name or domain_protocols(settings.domain_name).task_name,
        task_kwargs={**condition.task_kwargs, **given},
        max_episode_steps=settings.max_episode_steps or protocol.max_episode_steps,
    )
    seed = protocol.seed if settings.seed is None else settings.seed
    return environments.episodes(policy=settings.policy, seed=seed, seeding="gymnasium")


def _described(spec: EpisodeSpec) -> dict[str, Any]:
    """Returns the task of a condition, and the policy's file, as JSON represents them."""
    described = {"task_name": spec.task_name, "task_kwargs": dict(spec.task_kwargs)}
    return json.loads(json.dumps({**described, "policy_sha256": spec.policy_sha256}))
