"""Policies by name: random, zero, scripted experts, trained policies, servers, and those of a user."""

from kitchen_suite.policies.registry import (
    POLICIES,
    Policy,
    PolicyBuilder,
    PolicyError,
    PolicySource,
    Takeover,
    find,
    instruct,
    labels_of,
    load_policy,
    missing_observables,
    options_of,
    player_of,
    policy_file,
    without_file,
)

__all__ = [
    "POLICIES",
    "Policy",
    "PolicyBuilder",
    "PolicyError",
    "PolicySource",
    "Takeover",
    "find",
    "instruct",
    "labels_of",
    "load_policy",
    "missing_observables",
    "options_of",
    "player_of",
    "policy_file",
    "without_file",
]
