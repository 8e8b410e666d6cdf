"""Episodes in a browser: web pages of recorded ones, and the live viewer, in which a person may move the hand."""

import kitchen_suite.rendering.without_gl  # noqa: F401
