"""dm_control's physics, with an error that says what to install where no GL library works."""

from dm_control import mjcf

from kitchen_suite.rendering import gl


class Physics(mjcf.Physics):
    """`mjcf.Physics` whose `render` raises a RuntimeError that names the remedy where nothing can be rendered."""

    def free_context(self) -> None:
        """Frees the GL context; the next picture makes another."""
        if self._contexts:
            self._free_rendering_contexts()

    def _make_rendering_contexts(self) -> None:
        with gl.making_dm_control_context(self):
            super()._make_rendering_contexts()
