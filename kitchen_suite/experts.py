"""Scripted experts, which act on observations alone. They need the extra `experts`."""

from kitchen_suite.policies.experts import DrawerExpert as DrawerExpert
from kitchen_suite.policies.experts import Expert as Expert
from kitchen_suite.policies.experts import KitchenExpert as KitchenExpert
from kitchen_suite.policies.experts import MotionStyle as MotionStyle
from kitchen_suite.policies.experts import make as make
from kitchen_suite.policies.experts import make_policy as make_policy
