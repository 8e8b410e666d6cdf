"""Pictures of a scene's cameras as composer observables: colours, depth, segmentation."""

import collections
import dataclasses
from collections.abc import Callable, Mapping, Sequence

from dm_control import mjcf
from dm_control.composer.observation import observable
from numpy.typing import NDArray

from kitchen_suite import checks

# Kinds of pictures, by the argument of `MJCFCamera` that asks for one.
KINDS = ("pixels", "depth", "segmentation")

DEFAULT_SIZE = (128, 128)  # Height and width [pixels].

# Arguments of tasks that are settings of pictures.
SETTINGS = ("cameras", "image_size", "depth", "segmentation")


@dataclasses.dataclass(frozen=True)
class Picture:
    """A picture that a camera takes.

    Attributes:
      kind: one of `KINDS`.
      camera: name of the camera.
      taker: the observable.
    """

    kind: str
    camera: str
    taker: observable.MJCFCamera

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

    def __init__(self, pictures: Sequence[Picture] = ()) -> None:
        """Enables the observables."""
        self.pictures = tuple(pictures)
        self.by_name: collections.OrderedDict[str, observable.MJCFCamera] = collections.OrderedDict(
            (picture.key, picture.taker) for picture in self.pictures
        )
        for taker in self.by_name.values():
            taker.enabled = True

    @classmethod
    def build(
        cls,
        root: mjcf.RootElement,
        *,
        cameras: Sequence[str] = (),
        image_size: Sequence[int] | None = None,
        depth: bool = False,
        segmentation: bool = False,
    ) -> "Pictures":
        """Makes the pictures of some cameras.

        Args:
          root: model of the arena, with everything attached to it.
          cameras: names; none for no pictures.
          image_size: height and width [pixels]; 128 x 128 when omitted.
          depth: whether each camera also measures depth [m], float32 `(height, width, 1)`.
          segmentation: whether each camera also returns what each pixel shows, int32 `(height, width, 2)`: MuJoCo's
            number and type of the object, -1 for the background.

        Raises:
          TypeError: an argument of the wrong type.
          ValueError: an unknown or repeated camera, a size that is not positive or exceeds the model's offscreen
            buffer, or a setting of pictures without cameras.
        """
        kinds = ("pixels", *(["depth"] if checks.boolean(depth, "depth") else []))
        kinds += ("segmentation",) if checks.boolean(segmentation, "segmentation") else ()
        names = _checked_cameras(cameras, [camera.full_identifier for camera in root.find_all("camera")])
        if not names and (image_size is not None or len(kinds) > 1):
            raise ValueError("image_size, depth and segmentation are settings of pictures, and need cameras: name some")
        height, width = _checked_size(DEFAULT_SIZE if image_size is None else image_size, root)
        elements = {camera.full_identifier: camera for camera in root.find_all("camera")}
        return cls(
            [
                Picture(kind, name, observable.MJCFCamera(elements[name], height, width, **_flags(kind)))
                for kind in kinds
                for name in names
            ]
        )

    def takers(self, physics: mjcf.Physics) -> Mapping[str, Callable[[], NDArray]]:
        """Returns a function for each picture, by observation key, that takes it of a physics as it is at present."""
        return {name: taker.observation_callable(physics) for name, taker in self.by_name.items()}


NO_PICTURES = Pictures()


def _flags(kind: str) -> dict[str, bool]:
    return {} if kind == "pixels" else {kind: True}


def _checked_cameras(cameras: object, choices: Sequence[str]) -> tuple[str, ...]:
    if isinstance(cameras, Sequence) and not isinstance(cameras, str) and not len(cameras):
        return ()
    return tuple(checks.choice(name, choices, "camera") for name in checks.unique_names(cameras, "cameras"))


def _checked_size(size: object, root: mjcf.RootElement) -> tuple[int, int]:
    """Returns height and width."""
    if isinstance(size, str) or not isinstance(size, Sequence) or len(size) != 2:
        raise TypeError(f"image_size must be (height, width), got {size!r}")
    # MuJoCo's default is 640 x 480.
    buffer = getattr(root.visual, "global")
    limits = (buffer.offheight or 480, buffer.offwidth or 640)
    height, width = (
        checks.integer(pixels, f"{name} of image_size", minimum=1, maximum=int(limit))
        for pixels, name, limit in zip(size, ("height", "width"), limits, strict=True)
    )
    return height, width
