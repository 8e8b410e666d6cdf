"""Scripted experts, which act on observations alone. They need the extra `experts`."""

from kitchen_suite.policies.experts import *  # noqa: F403
