"""The domains that `kitchen-benchmark` knows."""

from collections.abc import Mapping
from types import MappingProxyType

from kitchen_suite.benchmark_cabinet import CABINET
from kitchen_suite.benchmark_contender import Domain
from kitchen_suite.benchmark_kitchen import KITCHEN

DOMAINS: Mapping[str, Domain] = MappingProxyType({"kitchen": KITCHEN, "open_cabinet": CABINET})
