"""Pictures of cameras that are observed, and pictures of a scene in another state."""

import collections
import contextlib
import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence

import mujoco
import numpy as np
from dm_control import mjcf
from dm_control.composer.observation import observable
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.types import Array

# First part of the keys of the pictures of goals.
GOAL_PIXELS = "goal_pixels"

DEFAULT_SIZE = (128, 128)  # Height and width [pixels].


class Camera(observable.MJCFCamera):
    """A camera whose pictures can be black instead of rendered.

    Attributes:
      is_covered: whether they are black.
    """

    is_covered = False

    def _callable(self, physics: mjcf.Physics) -> Callable[[], NDArray]:
        take, spec = super()._callable(physics), self.array_spec
        return lambda: np.zeros(spec.shape, spec.dtype) if self.is_covered else take()


@dataclasses.dataclass(frozen=True)
class Picture:
    """A picture that a camera takes.

    Attributes:
      kind: `pixels`, `depth` or `segmentation`.
      camera: name of the camera.
      taker: the observable.
    """

    kind: str
    camera: str
    taker: Camera

    @property
    def key(self) -> str:
        """Key of the observable: the name of the camera, with the kind unless it is `pixels`."""
        return self.camera if self.kind == "pixels" else f"{self.camera}/{self.kind}"


class Pictures:
    """The pictures that a task observes.

    Attributes:
      pictures: in the order of observation: kind by kind, each in the order of the cameras.
      by_name: an enabled observable for each, by observation key.
    """

    def __init__(
        self,
        root: mjcf.RootElement,
        /,
        *,
        cameras: Sequence[str] = (),
        image_size: Sequence[int] | None = None,
        depth: bool = False,
        segmentation: bool = False,
    ) -> None:
        """Makes the pictures of some cameras.

        Args:
          root: model of the arena, with everything attached to it.
          cameras: names of the cameras whose pictures are observed; none for no pictures.
          image_size: height and width [pixels]; 128 x 128 when omitted.
          depth: whether each camera also measures depth [m], float32 `(height, width, 1)`.
          segmentation: whether each camera also returns what each pixel shows, int32 `(height, width, 2)`: MuJoCo's
            number and type of the object, -1 for the background.

        Raises:
          TypeError: an argument of the wrong type.
          ValueError: an unknown or repeated camera, a size that is not positive or exceeds the model's offscreen
            buffer, or a setting of pictures without cameras.
        """
        flags = {"depth": checks.boolean(depth, "depth"), "segmentation": checks.boolean(segmentation, "segmentation")}
        elements = {camera.full_identifier: camera for camera in root.find_all("camera")}
        names = [checks.choice(name, elements, "camera") for name in checks.unique_names(cameras, "cameras", minimum=0)]
        if not names and (image_size is not None or any(flags.values())):
            raise ValueError("image_size, depth and segmentation are settings of pictures, and need cameras: name some")
        height, width = _checked_size(DEFAULT_SIZE if image_size is None else image_size, root)
        kinds = {"pixels": {}, **{kind: {kind: True} for kind, flag in flags.items() if flag}}
        self.pictures = tuple(
            Picture(kind, name, Camera(elements[name], height, width, **kinds[kind]))
            for kind in kinds
            for name in names
        )
        self.by_name = collections.OrderedDict((picture.key, picture.taker) for picture in self.pictures)
        for taker in self.by_name.values():
            taker.enabled = True

    @property
    def colour(self) -> tuple[Picture, ...]:
        """Those of kind `pixels`."""
        return tuple(picture for picture in self.pictures if picture.kind == "pixels")

    def takers(self, physics: mjcf.Physics) -> Mapping[str, Callable[[], NDArray]]:
        """Returns a function for each picture, by observation key, that takes it of a physics as it is at present."""
        return {name: taker.observation_callable(physics) for name, taker in self.by_name.items()}


@contextlib.contextmanager
def shown_at(physics: mjcf.Physics, columns: NDArray[np.int64], positions: Array) -> Iterator[None]:
    """Shows a physics with other positions; afterwards it is as before.

    Args:
      physics: that is rendered meanwhile.
      columns: `(k,)`, of the positions in qpos.
      positions: `(k,)` [rad, m, quaternion].
    """
    model, data = physics.model.ptr, physics.data.ptr
    present = data.qpos.copy()
    try:
        data.qpos[columns] = positions
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        yield
    finally:
        data.qpos[:] = present
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)


def _checked_size(size: object, root: mjcf.RootElement) -> tuple[int, int]:
    if isinstance(size, str) or not isinstance(size, Sequence) or len(size) != 2:
        raise TypeError(f"image_size must be (height, width), got {checks.shown(size)}")
    # MuJoCo's default is 640 x 480.
    buffer = getattr(root.visual, "global")
    limits = (buffer.offheight or 480, buffer.offwidth or 640)
    height, width = (
        checks.integer(pixels, f"{name} of image_size", minimum=1, maximum=int(limit))
        for pixels, name, limit in zip(size, ("height", "width"), limits, strict=True)
    )
    return height, width
