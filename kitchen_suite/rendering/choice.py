"""Importing this module chooses a GL library: packages that import dm_control import it first; see `rendering.gl`."""

from kitchen_suite.rendering import gl

gl.import_dm_control()
