"""Writes what variations have changed in a compiled model back to the MJCF that it was compiled from.

MuJoCo's `MjSpec` does that as well, by `copy_back` and `to_xml`, but not to the bit: it writes six digits of a number.
In MuJoCo 3.17 the kitchen compiles again with differences of up to 1.6e-5 (actuator_acc0); with variations of up to
3.1e-4 in the gains of its servos, and without the materials that geoms have been given. Here it is 0, and with
variations 1e-12 or less in all that the physics depends on.
"""

import kitchen_suite.rendering.without_gl  # noqa: F401

# isort: split
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

# Returns the attributes of the element of a number in a model that a field determines.
_Reader = Callable[[mujoco.MjModel, str, int], Mapping[str, Any]]

# Attributes that give an orientation in place of a quaternion.
_ORIENTATIONS = ("axisangle", "euler", "xyaxes", "zaxis")

# Texts and their addresses, which say where files lay, and keyframes: no physics and no image depends on them.
_LEFT_OUT = re.compile(r"names|names_map|paths|text_.*|.*_pathadr|name_\w+adr|key_.*")

# Fields that only images depend on, and statistics, which viewers use.
_VISUAL = re.compile(r"(cam|light|mat|mesh_tex|skin|tex)_.*|\w+_(matid|rgba)|bvh_aabb|(vis|stat)\..*")

# Frames of the inertia of bodies, without effect where there is no mass.
_INERTIAL = ("body_ipos", "body_iquat", "body_sameframe")


def _row(attribute: str) -> _Reader:
    return lambda model, field, number: {attribute: np.array(getattr(model, field)[number])}


def _of_joint(attribute: str) -> _Reader:
    """Returns a reader of a field of degrees of freedom, which those of a joint share."""
    return lambda model, field, joint: {attribute: getattr(model, field)[model.jnt_dofadr[joint]].item()}


def _inertial(model: mujoco.MjModel, field: str, body: int) -> Mapping[str, Any]:
    return {
        "mass": model.body_mass[body].item(),
        "diaginertia": np.array(model.body_inertia[body]),
        "pos": np.array(model.body_ipos[body]),
        "quat": np.array(model.body_iquat[body]),
    }


# Namespaces of the elements that fields belong to, and readers, by field.
_FIELDS: Mapping[str, tuple[str, _Reader]] = {
    "body_pos": ("body", _row("pos")),
    "body_quat": ("body", _row("quat")),
    "body_mass": ("body", _inertial),
    "body_inertia": ("body", _inertial),
    "dof_damping": ("joint", _of_joint("damping")),
    "dof_frictionloss": ("joint", _of_joint("frictionloss")),
    "geom_friction": ("geom", _row("friction")),
    "geom_matid": ("geom", lambda model, field, geom: {"material": model.material(model.geom_matid[geom]).name}),
    "geom_rgba": ("geom", _row("rgba")),
    # Position servos, whose gain is `kp`.
    "actuator_gainprm": ("actuator", lambda model, field, number: {"kp": getattr(model, field)[number, 0].item()}),
    "mat_rgba": ("material", _row("rgba")),
    **{f"light_{name}": ("light", _row(name)) for name in ("ambient", "diffuse", "dir", "specular")},
    "cam_pos": ("camera", _row("pos")),
    "cam_quat": ("camera", _row("quat")),
    "cam_fovy": ("camera", lambda model, field, number: {"fovy": model.cam_fovy[number].item()}),
}


def write_values(root: Any, built: mujoco.MjModel, live: mujoco.MjModel) -> None:
    """Sets the attributes of those elements whose values differ between a model as it was built and as it is now.

    The scene's `mjcf.RootElement`, with all that is attached to it, has been compiled to `built`; fields that MuJoCo
    derives from these follow when it is compiled again.
    """
    namespaces = {namespace for namespace, _ in _FIELDS.values()}
    elements = {(each, element.full_identifier): element for each in namespaces for element in root.find_all(each)}
    for field, (namespace, reader) in _FIELDS.items():
        kind = getattr(mujoco.mjtObj, f"mjOBJ_{namespace.upper()}")
        one, other = (np.asarray(getattr(model, field)) for model in (built, live))
        rows: NDArray[np.int64] = np.unique(np.nonzero(one != other)[0])
        if namespace == "joint":
            rows = np.unique(live.dof_jntid[rows])
        for number in rows.tolist():
            element = elements[namespace, mujoco.mj_id2name(live, kind, number)]
            attributes = {**reader(live, field, number)}
            if reader is _inertial:
                if element.inertial is not None:
                    element.inertial.remove()
                element.add("inertial", **attributes)
                continue
            for name in _ORIENTATIONS if "quat" in attributes else ():
                if getattr(element, name, None) is not None:
                    delattr(element, name)
            if "material" in attributes:
                attributes["material"] = root.find("material", attributes["material"])
            element.set_attributes(**attributes)


class Difference(NamedTuple):
    """The greatest difference of a number of two models, and the name of its field, which is empty if none differs.

    Its absolute value is infinite where an array has another shape.
    """

    value: float
    field: str

    def __str__(self) -> str:
        return f"{self.value:.3g} ({self.field})" if self.field else "0"


def greatest_difference(one: mujoco.MjModel, other: mujoco.MjModel, *, physical: bool = False) -> Difference:
    """Returns the greatest difference over the numbers of two models of a scene but those of texts and keyframes.

    With `physical` only those count that the physics depends on.
    """
    numbers = _physical_numbers if physical else _numbers
    found, others = Difference(0.0, ""), dict(numbers(other))
    for name, array in numbers(one):
        value = float("inf")
        if array.shape == others[name].shape:
            value = float(np.abs(array.astype(np.float64) - others[name].astype(np.float64)).max(initial=0.0))
        if value > found.value:
            found = Difference(value, name)
    return found


def _physical_numbers(model: mujoco.MjModel) -> Iterator[tuple[str, NDArray]]:
    for name, array in _numbers(model):
        if not _VISUAL.fullmatch(name):
            yield name, array[model.body_mass > 0] if name in _INERTIAL else array


def _numbers(structure: Any, prefix: str = "") -> Iterator[tuple[str, NDArray]]:
    """Yields name and values of all fields of a model, or of a structure within it."""
    for name in dir(structure):
        if name.startswith("_") or (not prefix and _LEFT_OUT.fullmatch(name)):
            continue
        value, path = getattr(structure, name), f"{prefix}{name}"
        # Those of the model itself are the sizes of its arrays.
        if isinstance(value, np.ndarray) or (prefix and isinstance(value, int | float)):
            yield path, np.asarray(value)
        elif type(value).__module__.startswith("mujoco"):
            yield from _numbers(value, f"{path}.")
