"""The protocols of evaluations, as the sweeps over them need them."""

from kitchen_suite.evaluation.protocols import PROTOCOLS


def domain_of(name):
    """Returns the name of a domain that a protocol is for."""
    return PROTOCOLS[name].domain_name or "kitchen"
