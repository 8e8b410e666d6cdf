"""Further state observables, which tasks enable by name: end effector, gripper, handles, poses of objects."""

import collections
import contextlib
import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence

import mujoco
import numpy as np
from dm_control import composer, mjcf
from dm_control.composer.observation import observable
from numpy.typing import ArrayLike, NDArray

from kitchen_suite import checks
from kitchen_suite.entities.scenes import Scene
from kitchen_suite.tasks.sensors import FeatureSensors
from kitchen_suite.tasks.simulation import PhysicsSimulation, Simulation
from kitchen_suite.tasks.terms import end_to_end
from kitchen_suite.types import Array

# First part of the keys of the pictures of goals.
GOAL_PIXELS = "goal_pixels"

DEFAULT_SIZE = (128, 128)  # Height and width [pixels].


@dataclasses.dataclass(frozen=True, kw_only=True)
class ExtraObservable:
    """A quantity that MuJoCo sensors measure.

    Attributes:
      content: quantity, frame and units.
      size: number of elements.
      sensors: kind of each sensor, such as `framepos`, and the joint or site that it is for.
      of_robot: whether it belongs to the robot's part of the observation.
      of_layout: whether it is the same throughout an episode, and in all episodes of a layout.
      combine: computes the elements `(..., size)` from the values of all sensors, end to end.
    """

    content: str
    size: int
    sensors: tuple[tuple[str, mjcf.Element], ...]
    of_robot: bool = False
    of_layout: bool = False
    combine: Callable[[Array], Array] = lambda values: values


def offered(scene: Scene) -> dict[str, ExtraObservable]:
    """Returns the quantities of a scene's robot, props and attached entities by key, those of the robot first."""
    robot, hand = scene.robot.mjcf_model.full_identifier, scene.robot.end_effector
    fingers = tuple(("jointpos", joint) for joint in scene.robot.fingers)
    width = ExtraObservable(
        content="distance between the fingers [m], the sum of their joint positions",
        size=1,
        sensors=fingers,
        of_robot=True,
        combine=lambda values: values[..., :1] + values[..., 1:],
    )
    of_robot = {
        f"{robot}end_effector_pose": ExtraObservable(
            content="position [m] and quaternion w, x, y, z of the point between the finger tips, in the world",
            size=7,
            sensors=(("framepos", hand), ("framequat", hand)),
            of_robot=True,
        ),
        f"{robot}end_effector_velocity": ExtraObservable(
            content="linear [m/s] and angular [rad/s] velocity of that point, along the axes of the world",
            size=6,
            sensors=(("framelinvel", hand), ("frameangvel", hand)),
            of_robot=True,
        ),
        **({f"{robot}gripper_width": width} if fingers else {}),
        f"{robot}base_pose": dataclasses.replace(_pose(scene.robot, "the robot's base"), of_robot=True),
    }
    of_handles = {}
    for name, prop in scene.props.items():
        if handles := prop.handles:
            content = f"positions in the world of {', '.join(f'`{site.name}`' for site in handles)} [m]"
            sensors = tuple(("framepos", site) for site in handles)
            extra = ExtraObservable(content=content, size=3 * len(handles), sensors=sensors)
            of_handles[f"{name}/handle_positions"] = extra
    poses = {f"{name}/pose": _pose(prop, "its frame") for name, prop in (*scene.props.items(), *scene.attached.items())}
    return {**of_robot, **of_handles, **poses}


class Computed(observable.Observable):
    """A quantity that a function without arguments returns.

    `observable.Generic` hands the function a physics, by a further call in every step.
    """

    def __init__(self, read: Callable[[], ArrayLike]) -> None:
        """Stores the function, which is called once a step and once a reset."""
        super().__init__(update_interval=1, buffer_size=None, delay=None, aggregator=None, corruptor=None)
        self._read = read

    def _callable(self, physics: mjcf.Physics) -> Callable[[], ArrayLike]:
        return self._read


def joined(*parts: Mapping[str, observable.Observable]) -> dict[str, observable.Observable]:
    """Returns observables by key, in order; a ValueError where two have the same key."""
    keys = [key for part in parts for key in part]
    if taken := sorted({key for key in keys if keys.count(key) > 1}):
        raise ValueError(f"extra_observations must have other names than the task's own observations: {taken}")
    return {key: value for part in parts for key, value in part.items()}


def slices(scene: Scene, names: Sequence[str]) -> Mapping[str, slice]:
    """Returns the slice of each extra observable among their elements, end to end in the order of observation."""
    wanted = _checked(names, offered(scene))
    return end_to_end({name: extra.size for name, extra in wanted.items()})


def _pose(entity: composer.Entity, owner: str) -> ExtraObservable:
    frame = mjcf.get_attachment_frame(entity.mjcf_model)
    return ExtraObservable(
        content=f"position [m] and quaternion w, x, y, z of {owner}, in the world",
        size=7,
        sensors=(("framepos", frame), ("framequat", frame)),
        of_layout=mjcf.get_frame_freejoint(entity.mjcf_model) is None,
    )


class _Sensors(FeatureSensors):
    """Sensors that also measure velocities in space."""

    def refresh(self, physics: mjcf.Physics) -> None:
        """Updates positions and velocities in space, and the sensors, from the joints' positions and velocities."""
        model, data = physics.model.ptr, physics.data.ptr
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_sensorPos(model, data)
        mujoco.mj_sensorVel(model, data)


class ExtraObservables:
    """The quantities that a task observes beside its own, without noise.

    Attributes:
      by_name: an enabled observable for each, by observation key; those of the robot first.
      size: number of elements.
      slices: of each among these, by observation key.
      of_robot: names of those that belong to the robot's part of the observation.
      of_layout: names of those that are the same throughout an episode, and in all episodes of a layout.
      stage: stage of MuJoCo's pipeline up to which the state after a control step is evaluated before `read`.
    """

    stage = FeatureSensors.stage

    def __init__(self, scene: Scene, names: Sequence[str]) -> None:
        """Adds the sensors of quantities, named as in `offered`, to a scene that is not yet compiled."""
        wanted = _checked(names, offered(scene))
        self._sensors = _Sensors(scene.arena.mjcf_model, scene.robot)
        for name, extra in wanted.items():
            for number, (kind, element) in enumerate(extra.sensors):
                if element.tag == "joint":
                    self._sensors.add_joints(f"{name} {number}", kind, (element,))
                else:
                    self._sensors.add_frame(f"{name} {number}", kind, element)
        self._wanted = wanted
        self.size = sum(extra.size for extra in wanted.values())
        self.slices = slices(scene, names)
        self.of_robot = tuple(name for name, extra in wanted.items() if extra.of_robot)
        self.of_layout = tuple(name for name, extra in wanted.items() if extra.of_layout)
        self.by_name: collections.OrderedDict[str, observable.Observable] = collections.OrderedDict(
            (
                name,
                Computed(lambda name=name: self._part(name, self._sensors.read(self._simulation))),  # type: ignore[misc]
            )
            for name in wanted
        )
        for part in self.by_name.values():
            part.enabled = True

    def bind(self, physics: mjcf.Physics) -> None:
        """Looks up the sensors in a compiled scene."""
        self._sensors.bind(physics)
        self._simulation = PhysicsSimulation(physics)

    @property
    def values(self) -> Array:
        """Present values `(size,)` in the scene that it is bound to."""
        return self.read(self._simulation)

    def refresh(self, physics: mjcf.Physics) -> None:
        """Evaluates a single physics up to `stage`."""
        self._sensors.refresh(physics)

    def read(self, simulation: Simulation) -> Array:
        """Returns the present values `(..., size)`, in a fresh array; the sensors must be up to date."""
        values = self._sensors.read(simulation)
        return np.concatenate([self._part(name, values) for name in self._wanted], axis=-1)

    def _part(self, name: str, values: Array) -> Array:
        """Returns the elements `(..., k)` of one quantity from the values of all sensors."""
        indices = [self._sensors.indices[f"{name} {i}"] for i in range(len(self._wanted[name].sensors))]
        return self._wanted[name].combine(values[..., indices[0].start : indices[-1].stop])


def _checked(names: object, choices: Mapping[str, ExtraObservable]) -> dict[str, ExtraObservable]:
    """Returns the quantities of some names, those of the robot first."""
    wanted = [
        checks.choice(name, choices, "extra observable")
        for name in checks.unique_names(names, "extra_observables", minimum=0)
    ]
    return {name: choices[name] for name in sorted(wanted, key=lambda name: not choices[name].of_robot)}


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
