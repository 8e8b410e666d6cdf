"""Arenas that are loaded from one MJCF file and have a named site for each entity."""

from dm_control import composer, mjcf

from kitchen_suite.entities import assets
from kitchen_suite.entities.parameters import Parameter
from kitchen_suite.entities.quantities import SLIDING_FRICTION_SCALE, scale


class SiteArena(assets.NamedEntity, composer.Arena):
    """Floor, lights, cameras, and a site at the pose of each entity."""

    xml_name: str
    default_name: str

    def _build(self, *, visuals: bool = True, name: str | None = None) -> None:
        """Loads the arena's MJCF.

        Args:
          visuals: `False` leaves out visual geoms, materials and textures; the physics stays the same to the bit.
          name: name of the model.
        """
        self._mjcf_root = assets.load_mjcf(self.xml_name, visuals=visuals)
        self._mjcf_root.model = name or self.default_name

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Factor of the sliding friction of all colliding geoms, those of attached entities included."""
        geoms = [geom for geom in self._mjcf_root.find_all("geom") if not assets.is_visual(geom)]
        return (scale(f"{self._mjcf_root.model}/friction_scale", SLIDING_FRICTION_SCALE, geoms),)

    def attach_at_site(self, entity: composer.Entity, *, free: bool = False) -> mjcf.Element:
        """Attaches an entity at the arena's site of the same name, and returns the attachment frame.

        Args:
          entity: entity whose model has the name of a site.
          free: whether to add a free joint.

        Raises:
          ValueError: the arena has no site of that name.
        """
        name = entity.mjcf_model.model
        sites = {site.name: site for site in self._mjcf_root.find_all("site", exclude_attachments=True)}
        if name not in sites:
            raise ValueError(f"the arena has no site for {name!r}; its sites are {sorted(sites)}")
        frame = self.attach(entity, sites[name])
        if free:
            frame.add("freejoint")
        return frame
