"""Observables that can be added to a task: further quantities, and pictures of cameras."""

import collections
from collections.abc import Sequence
from typing import Any

from dm_control import composer
from dm_control.composer.observation import observable

from kitchen_suite.entities.scenes.scene import Scene
from kitchen_suite.tasks.extra_observables import ExtraObservables
from kitchen_suite.tasks.pictures import NO_PICTURES, Pictures


class ObservedTask(composer.Task):
    """A task to which observables can be added when it is built."""

    _extras: ExtraObservables | None = None
    _pictures = NO_PICTURES

    def __init__(self, scene: Scene, *, extra_observables: Sequence[str] = (), **pictures: Any) -> None:
        """Adds observables to those that the task has itself; a task that adds none need not call this.

        Args:
          scene: of the task; not yet compiled.
          extra_observables: further quantities to observe, by the names of `extra_observables.offered`.
          **pictures: `cameras`, `image_size`, `depth` and `segmentation`; see `Pictures.build`.

        Raises:
          TypeError: an argument of the wrong type.
          ValueError: an unknown or repeated name, or a size out of range.
        """
        extras = ExtraObservables(scene, extra_observables)
        self._extras = extras if extras.size else None
        self._pictures = Pictures.build(scene.arena.mjcf_model, **pictures)

    @property
    def extras(self) -> ExtraObservables | None:
        """Quantities that are observed beside the task's own; None if there are none."""
        return self._extras

    @property
    def extra_observables(self) -> dict[str, observable.Observable]:
        """Their observables by observation key."""
        return {} if self._extras is None else dict(self._extras.by_name)

    @property
    def extra_size(self) -> int:
        """Number of their elements."""
        return 0 if self._extras is None else self._extras.size

    @property
    def pictures(self) -> Pictures:
        """The pictures of cameras that are observed."""
        return self._pictures

    @property
    def observables(self) -> collections.OrderedDict[str, observable.Observable]:
        """All observables: those of the task, of its entities, and the pictures."""
        return collections.OrderedDict({**super().observables, **self._pictures.by_name})
