"""Scripted experts, which act on observations alone. They need the extra `experts`."""

from kitchen_suite.policies.experts import (
    DrawerExpert,
    Expert,
    KitchenExpert,
    MicrowaveExpert,
    MotionStyle,
    make,
    make_policy,
)

__all__ = ["DrawerExpert", "Expert", "KitchenExpert", "MicrowaveExpert", "MotionStyle", "make", "make_policy"]
