"""Scripted experts, which complete the suite's tasks from observations alone. They need the extra `experts`."""

from kitchen_suite.policies.experts.base import Expert as Expert
from kitchen_suite.policies.experts.base import MotionStyle as MotionStyle
from kitchen_suite.policies.experts.factory import make as make
from kitchen_suite.policies.experts.factory import make_policy as make_policy
from kitchen_suite.policies.experts.kitchen import KitchenExpert as KitchenExpert
from kitchen_suite.policies.experts.open_cabinet import DrawerExpert as DrawerExpert
