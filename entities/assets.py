"""Loads this package's MJCF, with meshes and textures from the installed gymnasium-robotics.

Paths in our MJCF are relative to the folder of kitchen assets in gymnasium-robotics, so nothing is copied or
downloaded. The folder is found without importing the package, which would register environments and print warnings.
"""

import importlib.util
from pathlib import Path

import mujoco
from dm_control import composer, mjcf

from kitchen_suite.entities.parameters import Parameter

_PACKAGE = "gymnasium_robotics"
_REQUIREMENT = "gymnasium-robotics>=1.4,<1.5"
_ASSETS = Path("envs", "assets", "kitchen_franka")
_XML_DIR = Path(__file__).parent / "xml"

VISUAL_BODY = "_visuals"  # Ending of the names of bodies that hold only visual geoms; see `split_visual_geoms`.


class NamedEntity(composer.Entity):
    """An entity that builds its model as `_mjcf_root`; its representation has its name in a scene, and its joints."""

    _mjcf_root: mjcf.RootElement

    @property
    def mjcf_model(self) -> mjcf.RootElement:
        return self._mjcf_root

    def __repr__(self) -> str:
        joints = [joint.full_identifier for joint in self.mjcf_model.find_all("joint", exclude_attachments=True)]
        return f"{type(self).__name__}({self.mjcf_model.model!r}, joints={joints})"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the entity in a scene that a reset may change."""
        return ()


def asset_dir() -> Path:
    """Returns the folder of the Franka kitchen's assets; a FileNotFoundError without gymnasium-robotics."""
    spec = importlib.util.find_spec(_PACKAGE)
    for location in (spec.submodule_search_locations or ()) if spec else ():
        if (path := Path(location) / _ASSETS).is_dir():
            return path
    problem = f"has no folder {_ASSETS}" if spec else "is not installed"
    raise FileNotFoundError(
        f"the meshes and textures of the Franka kitchen come with the package gymnasium-robotics, which {problem}: "
        f"pip install '{_REQUIREMENT}'"
    )


def load_mjcf(name: str, *, visuals: bool = True) -> mjcf.RootElement:
    """Parses `xml/<name>.xml` of this package; the visual geoms have bodies of their own, or are removed."""
    model = parse_mjcf(name)
    (split_visual_geoms if visuals else remove_visuals)(model)
    return model


def parse_mjcf(name: str) -> mjcf.RootElement:
    """Parses `xml/<name>.xml` of this package as it stands."""
    return mjcf.from_xml_string((_XML_DIR / f"{name}.xml").read_text(encoding="utf-8"), model_dir=str(asset_dir()))


def parse_without_meshes(name: str) -> mujoco.MjSpec:
    """Parses `xml/<name>.xml` of this package, whose meshes and textures need not be installed."""
    return mujoco.MjSpec.from_file(str(_XML_DIR / f"{name}.xml"))


def new_model(name: str) -> mjcf.RootElement:
    """Returns an empty model with the compiler settings of the suite's MJCF files, for entities built in Python."""
    model = mjcf.RootElement(model=name, model_dir=str(asset_dir()))
    model.compiler.set_attributes(angle="radian")
    return model


def remove_visuals(model: mjcf.RootElement) -> None:
    """Removes the visual geoms, and every mesh, material and texture left unused.

    Visual geoms neither collide nor have mass: the physics is the same to the bit with and without them.
    """
    for geom in model.find_all("geom", exclude_attachments=True):
        if is_visual(geom):
            geom.remove()
    used = {geom.mesh for geom in model.find_all("geom", exclude_attachments=True)}
    for mesh in model.asset.mesh:
        if mesh not in used:
            mesh.remove()
    for asset in (*model.asset.material, *model.asset.texture):
        asset.remove()


def split_visual_geoms(model: mjcf.RootElement) -> None:
    """Moves the visual geoms of each colliding body to a massless child body.

    MuJoCo's collision detection visits all geoms of a body with at least one colliding geom, and skips other bodies.
    The physics is the same to the bit.
    """
    for body in model.find_all("body", exclude_attachments=True):
        visual = [geom for geom in body.geom if is_visual(geom)]
        if 0 < len(visual) < len(body.geom):
            child = body.add("body", name=f"{body.name}{VISUAL_BODY}")
            for geom in visual:
                attributes = geom.get_attributes()
                geom.remove()
                child.add("geom", **attributes)


def is_visual(geom: mjcf.Element) -> bool:
    """Whether a geom is only for rendering: the name of its default class, or the last part, begins with `visual`."""
    # A string where the model has no such class.
    name = getattr(geom.dclass, "dclass", geom.dclass)
    return name is not None and name.rpartition("\\")[2].startswith("visual")
