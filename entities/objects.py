"""Objects that a hand picks up: a can, a carton, a mug and a bottle, with the sizes and masses of real ones.

| object   | size [mm]            | mass [g] | source                                   |
|----------|----------------------|----------|------------------------------------------|
| `Can`    | 66 across, 101 high  | 349      | `tomato soup can` of the YCB objects     |
| `Carton` | 35 by 110, 89 high   | 187      | `pudding box` of the YCB objects         |
| `Mug`    | 80 across, 82 high   | 118      | `mug` of the YCB objects                 |
| `Bottle` | 54 across, 150 high  | 204      | 200 ml of water in 4.4 g of plastic      |

The bottle: Krones, in "Super-Lightweight PET Bottle", Plastics Technology, 23 April 2018;
its width follows from the volume.
The YCB objects: B. Calli et al., "Benchmarking in Manipulation Research", IEEE Robotics and Automation Magazine, 2015.
"""

from dm_control import mjcf

from kitchen_suite.entities.parameters import FREE_DISPLACEMENT, MASS, SLIDING_FRICTION, Parameter
from kitchen_suite.entities.props import FreeProp, KitchenProp
from kitchen_suite.types import Vector


class GraspedObject(FreeProp):
    """An object that moves freely, with grasp sites; its frame is at the centre of its base.

    Sites whose names begin with `grasp` have the poses of the hand's end effector in grasps: z is the direction of
    approach, y that in which the fingers move. The site `centre` is at the middle of its height.
    """

    # Corners of the box around it, in its frame [m].
    bounds: tuple[Vector, Vector]

    @property
    def body(self) -> mjcf.Element:
        """The body that has the object's mass."""
        return self._mjcf_root.find("body", self.xml_name)

    @property
    def grasps(self) -> tuple[mjcf.Element, ...]:
        """The grasp sites, the best one first."""
        return tuple(site for site in self.handles if site.name.startswith("grasp"))

    @property
    def centre(self) -> mjcf.Element:
        """The site at the middle of its height."""
        return self._mjcf_root.find("site", "centre")

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Displacement at the start: x, y and rotation about the vertical; mass; friction. None while not attached."""
        if not self.joints:
            return ()
        owner = self._mjcf_root.model
        geoms = tuple(geom for geom in self.body.geom if geom.dclass.dclass == "collision")
        return (
            Parameter(name=f"{owner}/pose", unit="m, m, rad", type=FREE_DISPLACEMENT, elements=self.joints),
            Parameter(name=f"{owner}/mass", unit="kg", type=MASS, elements=(self.body,)),
            Parameter(name=f"{owner}/friction", unit="1", type=SLIDING_FRICTION, elements=geoms),
        )


class Can(GraspedObject):
    """A can of soup of 349 g, grasped from above."""

    xml_name = "can"
    bounds = (-0.033, -0.033, 0.0), (0.033, 0.033, 0.101)


class Carton(GraspedObject):
    """A carton of pudding powder of 187 g, grasped from above across its 35 mm."""

    xml_name = "carton"
    bounds = (-0.055, -0.0175, 0.0), (0.055, 0.0175, 0.089)


class Mug(GraspedObject):
    """A mug of 118 g, grasped by its handle."""

    xml_name = "mug"
    bounds = (-0.041, -0.041, 0.0), (0.073, 0.041, 0.082)


class Bottle(GraspedObject):
    """A bottle of 200 ml of water, grasped by its neck."""

    xml_name = "bottle"
    bounds = (-0.027, -0.027, 0.0), (0.027, 0.027, 0.15)


class Tray(KitchenProp):
    """A tray on which objects are put, which stands fixed."""

    xml_name = "tray"


OBJECTS = {kind.xml_name: kind for kind in (Can, Carton, Mug, Bottle)}
"""The objects by name."""
