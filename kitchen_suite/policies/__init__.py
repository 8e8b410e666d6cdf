"""Policies by name: random, zero, scripted experts, trained policies, and those of a user."""

from kitchen_suite.policies.registry import POLICIES as POLICIES
from kitchen_suite.policies.registry import Policy as Policy
from kitchen_suite.policies.registry import PolicyBuilder as PolicyBuilder
from kitchen_suite.policies.registry import PolicyError as PolicyError
from kitchen_suite.policies.registry import find as find
from kitchen_suite.policies.registry import policy_file as policy_file
