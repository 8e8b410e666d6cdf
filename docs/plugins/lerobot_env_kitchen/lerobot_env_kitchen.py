"""Registers the environments of Kitchen Suite with LeRobot, which imports this module by its name."""

import kitchen_suite.lerobot.configs  # noqa: F401
