"""Policies by name: random, zero, scripted experts, trained policies, servers, and those of a user."""

from kitchen_suite.policies.memory import BatchPolicyWithMemory, PolicyWithMemory
from kitchen_suite.policies.reference import (
    BATCH,
    OBSERVATION,
    TIMESTEP,
    PolicyRef,
    find,
    instruct,
    labels_of,
    takes_of,
)
from kitchen_suite.policies.registry import (
    POLICIES,
    Policy,
    PolicyBuilder,
    PolicyError,
    PolicySource,
    Takeover,
    load_policy,
)

__all__ = [
    "BATCH",
    "OBSERVATION",
    "POLICIES",
    "TIMESTEP",
    "BatchPolicyWithMemory",
    "Policy",
    "PolicyBuilder",
    "PolicyError",
    "PolicyRef",
    "PolicySource",
    "PolicyWithMemory",
    "Takeover",
    "find",
    "instruct",
    "labels_of",
    "load_policy",
    "takes_of",
]
