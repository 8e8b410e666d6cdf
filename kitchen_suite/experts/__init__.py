"""Scripted experts: they do the suite's tasks on nothing but what an agent sees. They need the extra `experts`."""

from kitchen_suite.experts.drawer_expert import DrawerExpert as DrawerExpert
from kitchen_suite.experts.expert import Expert as Expert
from kitchen_suite.experts.expert import Style as Style
from kitchen_suite.experts.kitchen_expert import KitchenExpert as KitchenExpert
from kitchen_suite.experts.policy import make as make
from kitchen_suite.experts.policy import make_policy as make_policy
