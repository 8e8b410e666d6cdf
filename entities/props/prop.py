"""Objects that scenes are furnished with."""

from dm_control import mjcf

from kitchen_suite.entities import assets


class Prop(assets.NamedEntity):
    """An object with a fixed list of joints.

    Attributes:
      free: whether scenes attach it with a free joint.
    """

    free = False

    @property
    def joints(self) -> tuple[mjcf.Element, ...]:
        """The joints, in the order in which scenes observe them; none unless a prop says otherwise."""
        return ()

    @property
    def handles(self) -> tuple[mjcf.Element, ...]:
        """The sites at its handles, knobs and switches."""
        return tuple(self.mjcf_model.find_all("site", exclude_attachments=True))
