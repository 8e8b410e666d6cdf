"""Variations of a task from episode to episode: the parameters that vary, drawn and set at every reset."""

import contextlib
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from dm_control import mjcf
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.entities.parameters import Parameter
from kitchen_suite.entities.scenes import Scene
from kitchen_suite.tasks.variations import distributions as descriptions
from kitchen_suite.tasks.variations.distributions import GROUPS, SPLITS, Variation, Varied
from kitchen_suite.tasks.variations.layouts import LayoutCheck
from kitchen_suite.tasks.variations.randomizer import Randomizer, Values, VariationRequest, group_names, make_request

# No asked task starts nearer to its goal than this multiple of its threshold.
START_DISTANCE = 1.2

# Number of refusals in a reset after which the layout is the default one.
MAX_REFUSALS = 20


class Variations:
    """The parameters of a task that vary from episode to episode.

    Attributes:
      wanted: the parameters that vary, by name, in the order in which they are drawn; empty if nothing varies.
      split: `seen` or `held_out`.
      randomizer: draws and sets them.
    """

    def __init__(
        self,
        scene: Scene,
        table: Sequence[Varied],
        variations: str | Sequence[str] | Mapping[str, Variation] | None = None,
        split: str = "seen",
        *,
        handles: Sequence[mjcf.Element],
        parameters: Sequence[Parameter] = (),
        home: NDArray[np.float64] | None = None,
        correct: Callable[[Values], Values] = lambda values: values,
        randomizer: Randomizer | None = None,
    ) -> None:
        """Selects the parameters that vary, and their distributions.

        Args:
          scene: of the task; not yet compiled.
          table: the parameters that groups vary, in the order in which they are drawn; those that the scene does not
            have are left out.
          variations: names of groups of `distributions.GROUPS`, alone, in a sequence or joined by commas; or
            distributions by parameter, which JSON may describe (see `distributions.parse`). Nothing varies when
            omitted.
          split: `seen`, or `held_out`: which distributions of the groups are drawn from.
          handles: sites that the hand must reach in every layout.
          parameters: those that belong to the task, not to an entity of the scene.
          home: positions `(9,)` of the robot's joints in the default layout [rad, m]; those at the first reset when
            omitted.
          correct: returns values that suit the task, given the physics with the present ones; the same object if they
            do.
          randomizer: of parameters that are drawn and set before these.

        Raises:
          TypeError: an argument of the wrong type.
          ValueError: an unknown or repeated name, an unknown distribution, or a number out of range.
        """
        self.split = checks.choice(split, SPLITS, "variation_split")
        if not isinstance(variations, str | Sequence | Mapping | None):
            raise TypeError(f"variations must be names of groups, or distributions by parameter, got {variations!r}")
        self._scene, self._home, self._correct = scene, home, correct
        self._request, self._refusals, self._checked_model = VariationRequest(), 0, None
        self.randomizer = randomizer or Randomizer({}, {})
        offered = {parameter.name: parameter for parameter in (*scene.parameters, *parameters)}
        offered_rows = {varied.name: varied for varied in table if varied.name in offered}
        distributions = _distributions(variations or (), offered_rows, offered, split)
        self.wanted = {name: varied for name, varied in offered_rows.items() if name in distributions}
        # Groups draw within the ranges anyway.
        given = self.wanted if isinstance(variations, Mapping) else {}
        ranges = {name: (varied.low, varied.high) for name, varied in given.items()}
        chosen = Randomizer(
            {name: offered[name] for name in self.wanted}, distributions, owner="variation", ranges=ranges
        )
        for name, each in distributions.items():
            if descriptions.is_constant(each):
                self.wanted[name].check(np.asarray(each, np.float64))
        self.randomizer.add(chosen)
        self._layout = [name for name, varied in self.wanted.items() if varied.group == "layout"]
        if any(varied.group == "appearance" for varied in self.wanted.values()):
            scene.prepare_appearance()
        if self._layout and scene.arena.mjcf_model.option.flag.sleep == "enable":
            raise ValueError("variations of the layout need sleep=False: sleeping objects would stay where they were")
        self._layout_check = LayoutCheck(scene, handles) if self._layout else None

    @property
    def values(self) -> dict[str, NDArray[np.float64]]:
        """Present values of the parameters that vary, in fresh arrays."""
        return {name: np.array(self.randomizer.values[name]) for name in self.wanted}

    @property
    def info(self) -> dict[str, Any]:
        """Infos on the variation of the episode: `variation_values`, and `layout_refusals` where layouts vary.

        Empty if nothing varies. With `MAX_REFUSALS` refusals the layout is the default one.
        """
        if not self.wanted:
            return {}
        refusals = {"layout_refusals": np.array(self._refusals)} if self._layout_check else {}
        return {"variation_values": self.values, **refusals}

    def restore(self, values: Values, refusals: int) -> None:
        """Sets checked values of all parameters of the randomizer, and the number of refused layouts."""
        self.randomizer.set(values)
        self._refusals = refusals

    def request(
        self, names: str | Sequence[str] | None = None, values: Mapping[str, Any] | None = None
    ) -> VariationRequest:
        """Returns the checked request for a reset.

        Args:
          names: parameters and groups that are drawn; the others have their defaults. All are drawn when omitted, none
            when empty.
          values: values of parameters by name, or in nested dicts by the parts of the names.

        Raises:
          TypeError: an argument of the wrong type.
          ValueError: an unknown name, or a value of the wrong shape or outside the parameter's range.
        """
        return make_request(self.wanted, self.randomizer, names, values)

    def follow(self, request: VariationRequest) -> None:
        """Makes the next reset follow a request."""
        self._request = request

    def draw(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        """Draws and sets the parameters of an episode, at its start state; resets the physics if that fails."""
        if not self.randomizer.names:
            return
        with contextlib.ExitStack() as undo:
            undo.callback(physics.reset)
            drawn = self.randomizer.draw(random_state)
            undo.pop_all()
        request, self._request = self._request, VariationRequest()
        start, self._refusals = np.array(physics.data.qpos), 0
        if self._layout_check:
            seed = random_state.randint(2**31)
            self._bind_layout_check(physics, self._layout_check)
            self._set_accepted(physics, self._layout_check, start, drawn, request, seed)
        else:
            self._set(physics, start, request.applied(drawn, self.randomizer.defaults))

    def _set_accepted(
        self,
        physics: mjcf.Physics,
        check: LayoutCheck,
        start: NDArray[np.float64],
        drawn: Values,
        request: VariationRequest,
        seed: int,
    ) -> None:
        """Sets the values of an episode, after drawing its layout again, from a seed, while it is refused."""
        trial, defaults = request, self.randomizer.defaults
        if not any(request.draws(name) for name in self._layout):
            # All values are given back: the infos count as many refusals as when they were drawn.
            trial = dataclasses.replace(request, values={})
        redrawn = [name for name in self._layout if trial.draws(name)]
        self._set(physics, start, trial.applied(drawn, defaults))
        # Starting a generator takes as long as checking a layout.
        generator: np.random.RandomState | None = None
        while redrawn and self._refusals < MAX_REFUSALS and not check.accepts(physics):
            self._refusals += 1
            generator = generator or np.random.RandomState(seed)
            others = defaults if self._refusals == MAX_REFUSALS else self.randomizer.draw(generator)
            drawn = {**drawn, **{name: others[name] for name in redrawn}}
            self._set(physics, start, trial.applied(drawn, defaults))
        if trial is not request:
            self._set(physics, start, request.applied(drawn, defaults))

    def _bind_layout_check(self, physics: mjcf.Physics, check: LayoutCheck) -> None:
        """Binds the layout check to the default layout, once for each compiled scene."""
        if self._checked_model is physics.model.ptr:
            return
        self._checked_model = physics.model.ptr
        self.randomizer.set(self.randomizer.defaults)
        if self._home is not None:
            physics.bind(self._scene.robot.joints).qpos = self._home
        check.bind(physics)

    def _set(self, physics: mjcf.Physics, start: NDArray[np.float64], values: Values) -> None:
        """Sets values at a start state, corrected by the task."""
        physics.data.qpos[:] = start
        self.randomizer.set(values)
        corrected = self._correct(values)
        if corrected is not values:
            physics.data.qpos[:] = start
            self.randomizer.set(corrected)


def _distributions(
    wanted: str | Sequence[str] | Mapping[str, Variation],
    table: Mapping[str, Varied],
    offered: Mapping[str, Parameter],
    split: str,
) -> dict[str, Variation]:
    """Returns distributions by the names of parameters."""
    if isinstance(wanted, Mapping):
        names = [checks.choice(name, table, "variation") for name in wanted]
        if absent := [name for name in names if wanted[name] is None]:
            raise TypeError(f"variation's {absent[0]} must be a distribution or a constant, got None")
        return {name: descriptions.parse(wanted[name], offered[name].quantity, f"variation's {name}") for name in names}
    groups = [checks.choice(name, GROUPS, "variation") for name in group_names(wanted, "variations")]
    return {name: varied.distribution(split) for name, varied in table.items() if varied.group in groups}
