"""Scripted experts, which complete the suite's tasks from observations alone. They need the extra `experts`."""

import kitchen_suite.policies.experts.mink_import
import kitchen_suite.rendering.choice  # noqa: F401
from kitchen_suite.policies.experts.base import Expert, MotionStyle, expert_class, make, make_policy
from kitchen_suite.policies.experts.kitchen import KitchenExpert
from kitchen_suite.policies.experts.open_cabinet import DrawerExpert

__all__ = ["DrawerExpert", "Expert", "KitchenExpert", "MotionStyle", "expert_class", "make", "make_policy"]
