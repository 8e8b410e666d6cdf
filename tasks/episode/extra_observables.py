"""Further quantities of a scene that are observed by name: end effector, gripper, handles, poses of objects."""

import collections
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
from dm_control import composer, mjcf
from dm_control.composer.observation import observable

from kitchen_suite import checks
from kitchen_suite.entities.scenes import Scene
from kitchen_suite.tasks.episode.draws import Draws
from kitchen_suite.tasks.episode.part import MeasuringPart
from kitchen_suite.tasks.observables import Computed
from kitchen_suite.tasks.sensors import FeatureSensors
from kitchen_suite.tasks.simulation import PhysicsSimulation, Simulation
from kitchen_suite.tasks.terms import Transition, end_to_end
from kitchen_suite.types import Array


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


class NamedQuantities(MeasuringPart):
    """The quantities of `extra_observables` that a task observes beside its own, without noise.

    The part's state is their present values `(..., size)`.

    Attributes:
      by_name: an enabled observable for each, by observation key; those of the robot first.
      size: number of elements.
      slices: of each among these, by observation key.
      of_robot: names of those that belong to the robot's part of the observation.
      of_layout: names of those that are the same throughout an episode, and in all episodes of a layout.
    """

    name = "quantities"
    # Measured anew where a state is set.
    is_saved = False
    stage = FeatureSensors.stage

    def __init__(self, scene: Scene, names: Sequence[str]) -> None:
        """Adds the sensors of quantities, named as in `offered`, to a scene that is not yet compiled."""
        super().__init__()
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
        self._sensors.bind(physics)
        self._simulation = PhysicsSimulation(physics)

    @property
    def values(self) -> Array:
        """Present values `(size,)` in the scene that the part is bound to."""
        return self.read(self._simulation)

    def read(self, simulation: Simulation) -> Array:
        values = self._sensors.read(simulation)
        return np.concatenate([self._part(name, values) for name in self._wanted], axis=-1)

    def start(self, part: Any, simulation: Simulation, mdp_state: Any, draws: Draws) -> Array:
        return np.zeros(self.size)

    def evaluated(self, part: Array) -> Array:
        return self.values

    def refresh(self, physics: mjcf.Physics) -> None:
        self._sensors.refresh(physics)

    def after(self, part: Array, simulation: Simulation, step: Transition, draws: Draws) -> Array:
        values: Array = self.reader.read(simulation)
        return values

    def observed(self, part: Array) -> list[Array]:
        return [part]

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
