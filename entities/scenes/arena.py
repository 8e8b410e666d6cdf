"""Arenas that are loaded from one MJCF file and have a named site for each entity."""

from collections.abc import Sequence

from dm_control import composer, mjcf

from kitchen_suite.entities import appearance, assets, viewpoints
from kitchen_suite.entities.appearance import Surface
from kitchen_suite.entities.parameters import Parameter
from kitchen_suite.entities.quantities import SLIDING_FRICTION_SCALE, scale


class SiteArena(assets.NamedEntity, composer.Arena):
    """Floor, lights, cameras, and a site at the pose of each entity.

    Attributes:
      surfaces: of the scene, with all entities that are attached to the arena.
    """

    xml_name: str
    default_name: str
    surfaces: Sequence[Surface] = ()

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
        """Sliding friction, appearance of surfaces, lights and cameras, those of attached entities included."""
        root = self._mjcf_root
        geoms = [geom for geom in root.find_all("geom") if not assets.is_visual(geom)]
        friction = scale(f"{root.model}/friction_scale", SLIDING_FRICTION_SCALE, geoms)
        surfaces = (parameter for surface in self.surfaces for parameter in surface.parameters)
        return (friction, *surfaces, *viewpoints.light_parameters(root), *viewpoints.camera_parameters(root))

    def prepare_appearance(self) -> None:
        """Adds the textures from which a reset may choose; to be called before the scene is compiled.

        Without visuals, it adds nothing.
        """
        appearance.add_variants(self._mjcf_root, self.surfaces)

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
