"""The cameras of an environment, and what they can take."""

from kitchen_suite import checks
from kitchen_suite.environment import Environment


def camera_names(environment: Environment) -> list[str]:
    """Names of all cameras, by number."""
    model = environment.physics.model
    return [model.id2name(number, "camera") for number in range(model.ncam)]


def find_camera(environment: Environment, camera: str) -> int:
    """Number of a camera given by name or number.

    Raises:
      ValueError: there is no such camera.
    """
    names = camera_names(environment)
    if camera.isdecimal() and int(camera) < len(names):
        return int(camera)
    return names.index(checks.choice(camera, names, "camera"))


def check_size(environment: Environment, width: int, height: int) -> None:
    """Sees to it that pictures of that size can be rendered.

    Raises:
      ValueError: they are too large.
    """
    largest = environment.physics.model.vis.global_
    if width > largest.offwidth or height > largest.offheight:
        raise ValueError(
            f"a video of {width} x {height} pixels is too large: the model has room for "
            f"{largest.offwidth} x {largest.offheight}"
        )
