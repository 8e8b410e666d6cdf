"""A live page of an environment in a browser, and teleoperation."""
