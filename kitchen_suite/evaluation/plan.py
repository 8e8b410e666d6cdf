"""The plan of an evaluation: its protocol with all replaced values, and the episodes of each condition."""

import dataclasses
import json
from collections.abc import Mapping
from typing import Any

from kitchen_suite import checks, policies
from kitchen_suite.evaluation.protocols import PROTOCOLS, Condition, Protocol, Score, domain_protocols
from kitchen_suite.rollouts.spec import EnvironmentSpec, EpisodeSpec
from kitchen_suite.settings import EvaluateSettings


@dataclasses.dataclass(frozen=True, kw_only=True)
class EvaluationPlan:
    """An evaluation that can be played; episode `i` of every condition has the seed `seed + i`.

    Attributes:
      protocol: its name.
      specs: specifications of the episodes by the names of the conditions.
      num_episodes: of each condition.
      score: a published score; None if the protocol has none, or if it is for other tasks.
    """

    protocol: str
    specs: Mapping[str, EpisodeSpec]
    num_episodes: int
    score: Score | None

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


def make_plan(settings: EvaluateSettings) -> EvaluationPlan:
    """Plans the evaluation that a command asks for, and builds the policy once in each condition."""
    protocol = find_protocol(settings.protocol, settings.domain_name)
    specs = {name: spec.prepared() for name, spec in _specs(protocol, settings).items()}
    own_tasks = {condition.task_name for condition in protocol.conditions}
    return EvaluationPlan(
        protocol=protocol.name,
        specs=specs,
        num_episodes=protocol.num_episodes if settings.num_episodes is None else settings.num_episodes,
        score=protocol.score if {spec.task_name for spec in specs.values()} <= own_tasks else None,
    )


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
