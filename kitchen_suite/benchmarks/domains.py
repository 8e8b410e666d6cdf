"""The domains that `kitchen-benchmark` knows."""

from collections.abc import Mapping
from types import MappingProxyType

from kitchen_suite.benchmarks.cases import Domain
from kitchen_suite.benchmarks.kitchen import KITCHEN
from kitchen_suite.benchmarks.open_cabinet import CABINET

DOMAINS: Mapping[str, Domain] = MappingProxyType({"kitchen": KITCHEN, "open_cabinet": CABINET})
