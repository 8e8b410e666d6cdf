"""The protocols of evaluations, as the sweeps over them need them."""

from kitchen_suite import suite
from kitchen_suite.evaluation.protocols import PROTOCOLS, domain_protocols


def domain_of(name):
    """Returns the name of the first domain that a protocol is for."""
    is_general = PROTOCOLS[name].is_general
    return next(each for each in suite.DOMAINS if is_general or name in domain_protocols(each).protocols)
