"""Reads this package's MJCF, with meshes and textures from the installed gymnasium-robotics.

Nothing is copied out of gymnasium-robotics and nothing is fetched: the paths in our MJCF are relative to its folder of
kitchen assets, which is found without importing it (an import would register environments and print warnings).
"""

import importlib.util
from pathlib import Path

from dm_control import mjcf

_PACKAGE = "gymnasium_robotics"
_REQUIREMENT = "gymnasium-robotics==1.4.2"
_ASSETS = Path("envs", "assets", "kitchen_franka")
_XML_DIR = Path(__file__).parent / "xml"


def asset_dir() -> Path:
    """The folder of the Franka kitchen's assets inside the installed gymnasium-robotics.

    Raises:
      FileNotFoundError: gymnasium-robotics is not installed, or carries no such folder.
    """
    spec = importlib.util.find_spec(_PACKAGE)
    for location in (spec.submodule_search_locations or ()) if spec else ():
        if (path := Path(location) / _ASSETS).is_dir():
            return path
    problem = f"carries no folder {_ASSETS}" if spec else "is not installed"
    raise FileNotFoundError(
        f"the meshes and textures of the Franka kitchen come with the package gymnasium-robotics, which {problem}: "
        f"pip install '{_REQUIREMENT}'"
    )


def load_mjcf(name: str, *, visuals: bool = True) -> mjcf.RootElement:
    """Parses `xml/<name>.xml` of this package.

    Args:
      name: file name without its ending.
      visuals: `False` drops what only the eye needs (see `remove_visuals`), `True` sets it apart from what collides.

    Raises:
      FileNotFoundError: the file, or the package that holds the meshes and textures, is missing.
    """
    model = mjcf.from_xml_string((_XML_DIR / f"{name}.xml").read_text(encoding="utf-8"), model_dir=str(asset_dir()))
    if visuals:
        split_visual_geoms(model)
    else:
        remove_visuals(model)
    return model


def new_model(name: str) -> mjcf.RootElement:
    """An empty model with the compiler settings that all of the suite's files have, for entities built in Python."""
    model = mjcf.RootElement(model=name, model_dir=str(asset_dir()))
    model.compiler.set_attributes(angle="radian", inertiagrouprange=[3, 5])
    return model


def remove_visuals(model: mjcf.RootElement) -> None:
    """Removes geoms that neither collide nor weigh anything, and every mesh, material and texture left unused.

    Visual geoms are those of group 0 to 2 in the default class `visual` or one nested in it; they lie outside the
    groups that inertia is computed from, so the physics is the same to the bit with and without them.
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
    """Moves the visual geoms of each body that collides to a weightless body of their own inside it.

    In search of contacts MuJoCo goes through all geoms of a body that collides; bodies in which nothing does it leaves
    alone. The physics is the same to the bit.
    """
    for body in model.find_all("body", exclude_attachments=True):
        visual = [geom for geom in body.geom if is_visual(geom)]
        if 0 < len(visual) < len(body.geom):
            apart = body.add("body", name=f"{body.name}_visuals")
            for geom in visual:
                attributes = geom.get_attributes()
                geom.remove()
                apart.add("geom", **attributes)


def is_visual(geom: mjcf.Element) -> bool:
    """Whether a geom is drawn only: its default class is `visual` or one whose name begins so."""
    return geom.dclass is not None and geom.dclass.dclass.startswith("visual")
