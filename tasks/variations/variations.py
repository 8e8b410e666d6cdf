"""Variations of a task from episode to episode: the parameters that vary, drawn and set at every reset."""

import contextlib
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
from dm_control import mjcf

from kitchen_suite import checks
from kitchen_suite.entities.parameters import Parameter
from kitchen_suite.entities.scenes import Scene
from kitchen_suite.tasks.variations import distributions
from kitchen_suite.tasks.variations.distributions import GROUPS, NONE, SPLITS, ParameterVariation, Variation
from kitchen_suite.tasks.variations.layouts import LayoutCheck
from kitchen_suite.tasks.variations.randomizer import Draw, Randomizer, Values
from kitchen_suite.types import Array

START_DISTANCE = 1.2  # No requested task starts nearer to its goal than this multiple of its threshold.
MAX_REFUSALS = 20  # Number of refusals in a reset after which the layout is the default one.
SLEEP = int(mujoco.mjtEnableBit.mjENBL_SLEEP)  # Flag of MuJoCo with which objects at rest sleep.


@dataclasses.dataclass(frozen=True, kw_only=True)
class VariationRequest:
    """The variation that is requested of one reset.

    Attributes:
      excluded: parameters that are not drawn, but have their defaults.
      values: values that replace those drawn or default.
    """

    excluded: frozenset[str] = frozenset()
    values: Mapping[str, Array] = dataclasses.field(default_factory=dict)

    def applied(self, drawn: Values, defaults: Mapping[str, Array]) -> Values:
        """Returns the values of a reset, given those drawn and the defaults of all parameters."""
        chosen = {name: defaults[name] if name in self.excluded else drawn[name] for name in drawn}
        return {**chosen, **self.values}

    def draws(self, name: str) -> bool:
        """Whether a parameter has the value drawn."""
        return name not in self.values and name not in self.excluded


# The request of a reset without options.
_EVERYTHING = VariationRequest()


class Variations:
    """The parameters of a task that vary from episode to episode.

    Attributes:
      by_name: the parameters that vary with their variations, in the order in which they are drawn; may be empty.
      layout: names of those that move furniture or the robot's base.
      split: `seen` or `held_out`.
      moves_sleepers: whether the layout varies in a scene whose objects may sleep.
      randomizer: draws and sets them; from `bind` on.
      ranges: least and greatest value of each, by name; from `bind` on.
    """

    randomizer: Randomizer
    ranges: Mapping[str, tuple[Array, Array]]

    def __init__(
        self,
        scene: Scene,
        table: Sequence[ParameterVariation],
        variations: str | Sequence[str] | Mapping[str, Variation] | None,
        split: str,
        *,
        handles: Sequence[mjcf.Element],
        parameters: Sequence[Parameter],
        home: Array | None = None,
        correct: Callable[[Values], Values] = lambda values: values,
    ) -> None:
        """Selects the parameters that vary, and their distributions.

        Args:
          scene: of the task; not yet compiled.
          table: the parameters that groups vary, in the order in which they are drawn; those that the scene does not
            have are left out.
          variations: names of groups of `distributions.GROUPS`, alone, in a sequence or joined by commas; or
            distributions by parameter, which JSON may describe (see `distributions.parse`); None, `none` or an empty
            sequence for no variation.
          split: `seen`, or `held_out`: which distributions of the groups are drawn from.
          handles: sites that the hand must reach in every layout.
          parameters: those that belong to the task, not to an entity of the scene.
          home: positions `(9,)` of the robot's joints in the default layout [rad, m]; those at the first reset when
            omitted.
          correct: returns values that suit the task, given the physics with the current ones; the same object if they
            do.
        """
        self.split = checks.choice(split, SPLITS, "variation_split")
        if not isinstance(variations, str | Sequence | Mapping | None):
            raise TypeError(
                f"variations must be names of groups, distributions by parameter or {NONE!r}, "
                f"got {checks.shown(variations)}"
            )
        variations = distributions.unified(variations)
        self._scene = scene
        self._home = home
        self._correct = correct
        self._refusals = 0
        self._checked_model = None
        offered = {parameter.name: parameter for parameter in (*scene.parameters, *parameters)}
        rows = {row.name: row for row in table if row.name in offered}
        self._given = _parsed(variations, rows, offered) if isinstance(variations, Mapping) else {}
        chosen = {*self._given} if isinstance(variations, Mapping) else _in_groups(variations or (), rows)
        self._rows = {name: row for name, row in rows.items() if name in chosen}
        self._parameters = {name: offered[name] for name in self._rows}
        self.by_name = self._rows
        self.layout = [name for name, row in self.by_name.items() if row.group == "layout"]
        if any(row.group == "appearance" for row in self.by_name.values()):
            scene.prepare_appearance()
        self.moves_sleepers = bool(self.layout) and scene.sleeps
        self._layout_check = LayoutCheck(scene, handles) if self.layout else None

    @property
    def definition(self) -> dict[str, Any]:
        """The arguments that choose variations, by name: distributions by parameter or names of groups, and a split."""
        varied = {name: self._given.get(name) for name in self._rows}
        return {"variations": varied, "variation_split": self.split if varied else None}

    def bind(self, physics: mjcf.Physics) -> None:
        """Reads the default values from a compiled scene, which must have those of the built one.

        Raises a TypeError or a ValueError if a parameter does not take its constant.
        """
        self._physics = physics
        defaults = {name: parameter.get(physics) for name, parameter in self._parameters.items()}
        self.by_name = {name: row.about(defaults[name]) for name, row in self._rows.items()}
        self.ranges = {name: row.range(defaults[name]) for name, row in self.by_name.items()}
        draws = [
            Draw(
                parameter=self._parameters[name],
                variation=self._given.get(name, row.distribution(self.split)),
                # Distributions of a user's own may reach beyond the ranges; those of groups do not.
                bounds=self.ranges[name] if self._given else None,
            )
            for name, row in self.by_name.items()
        ]
        self.randomizer = Randomizer(physics, draws)
        constants = {name: each for name, each in self._given.items() if distributions.is_constant(each)}
        self._check_ranges(self.randomizer.checked(constants))

    def _check_ranges(self, values: Values) -> None:
        for name, value in values.items():
            low, high = self.ranges[name]
            if (value < low).any() or (value > high).any():
                bounds = f"{low.tolist()} and {high.tolist()}"
                raise ValueError(f"variation's {name} must be within {bounds}, got {value.tolist()}")

    @property
    def values(self) -> dict[str, Array]:
        """Current values of the parameters that vary, in fresh arrays."""
        return {name: np.array(self.randomizer.values[name]) for name in self.by_name}

    @property
    def info(self) -> dict[str, Any]:
        """Infos on the variation of the episode: `variation_values`, and `layout_refusals` where layouts vary.

        Empty if nothing varies. With `MAX_REFUSALS` refusals the layout is the default one.
        """
        if not self.by_name:
            return {}
        refusals = {"layout_refusals": np.array(self._refusals)} if self._layout_check else {}
        return {"variation_values": self.values, **refusals}

    def restore(self, values: Values, refusals: int) -> None:
        """Sets checked values of all parameters of the randomizer, and the number of refused layouts."""
        self._apply(values)
        self._refusals = refusals

    def request(
        self, names: str | Sequence[str] | None = None, values: Mapping[str, Any] | None = None
    ) -> VariationRequest:
        """Returns the checked request for a reset.

        Args:
          names: parameters and groups that are drawn; the others have their defaults. All are drawn when omitted, none
            when empty.
          values: values of parameters by name, or in nested dicts by the parts of the names.
        """
        if (names or values) and not self.by_name:
            raise ValueError("nothing varies: build the environment with variations")
        flat = flat_values(values or {})
        for name in flat:
            checks.choice(name, self.by_name, "parameter of variation_values")
        checked = self.randomizer.checked(flat)
        self._check_ranges(checked)
        excluded = set() if names is None else self.by_name.keys() - self._named(names)
        return VariationRequest(excluded=frozenset(excluded), values=checked)

    def _named(self, names: str | Sequence[str]) -> set[str]:
        """Returns the parameters that names of parameters and groups stand for."""
        choices = {name: [name] for name in self.by_name}
        for name, row in self.by_name.items():
            choices.setdefault(row.group, []).append(name)
        each = (checks.choice(name, choices, "variation") for name in _group_names(names, "variation"))
        return {name for one in each for name in choices[one]}

    def draw(
        self, physics: mjcf.Physics, random_state: np.random.RandomState, request: VariationRequest = _EVERYTHING
    ) -> None:
        """Draws and sets the parameters of an episode, at its start state; resets the physics if that fails.

        The same numbers are drawn whatever the request.
        """
        if not self.randomizer.names:
            return
        with contextlib.ExitStack() as undo:
            undo.callback(physics.reset)
            drawn = self.randomizer.draw(random_state)
            undo.pop_all()
        start = np.array(physics.data.qpos)
        self._refusals = 0
        if self._layout_check:
            seed = random_state.randint(2**31)
            if self._checked_model is not physics.model.ptr:
                # The check compares with the default layout, once for each compiled scene.
                self._checked_model = physics.model.ptr
                self._apply(self.randomizer.defaults)
                if self._home is not None:
                    physics.bind(self._scene.robot.joints).qpos = self._home
                self._layout_check.bind(physics)
            self._set_accepted(physics, self._layout_check, start, drawn, request, seed)
        else:
            self._set(physics, start, request.applied(drawn, self.randomizer.defaults))

    def _set_accepted(
        self,
        physics: mjcf.Physics,
        check: LayoutCheck,
        start: Array,
        drawn: Values,
        request: VariationRequest,
        seed: int,
    ) -> None:
        """Sets the values of an episode, after drawing its layout again, from a seed, while it is refused."""
        trial, defaults = request, self.randomizer.defaults
        if not any(request.draws(name) for name in self.layout):
            # All values are given back: the infos count as many refusals as when they were drawn.
            trial = dataclasses.replace(request, values={})
        redrawn = [name for name in self.layout if trial.draws(name)]
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

    def _set(self, physics: mjcf.Physics, start: Array, values: Values) -> None:
        """Sets values at a start state, corrected by the task."""
        physics.data.qpos[:] = start
        self._apply(values)
        corrected = self._correct(values)
        if corrected is not values:
            physics.data.qpos[:] = start
            self._apply(corrected)

    def _apply(self, values: Mapping[str, Array]) -> None:
        """Sets values in the physics, and moves the furniture with them."""
        self.randomizer.set(values)
        self.place_fixed()

    def place_fixed(self) -> None:
        """Moves what is fixed to where the current values have it, as MuJoCo does by itself where nothing sleeps."""
        if self.moves_sleepers or (self._scene.sleeps and self.randomizer.visual_fields):
            model, data = self._physics.model.ptr, self._physics.data.ptr
            flags = model.opt.enableflags
            # With `SLEEP`, MuJoCo does not look whether those that are fixed, or on fixed bodies, have been moved.
            model.opt.enableflags = flags & ~SLEEP
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_camlight(model, data)
            model.opt.enableflags = flags


def _parsed(
    wanted: Mapping[str, Variation], rows: Mapping[str, ParameterVariation], offered: Mapping[str, Parameter]
) -> dict[str, Variation]:
    """Returns the variations that distributions by parameter describe."""
    names = [checks.choice(name, rows, "variation") for name in wanted]
    if absent := [name for name in names if wanted[name] is None]:
        raise TypeError(f"variation's {absent[0]} must be a distribution or a constant, got None")
    return {name: distributions.parse(wanted[name], offered[name].type, f"variation's {name}") for name in names}


def _in_groups(names: Sequence[str], rows: Mapping[str, ParameterVariation]) -> set[str]:
    try:
        groups = [checks.choice(name, GROUPS, "variation") for name in _group_names(names, "variations")]
    except ValueError as error:
        raise ValueError(f"{error}; where nothing varies, write variations={NONE!r}") from error
    present = [group for group in GROUPS if any(row.group == group for row in rows.values())]
    if empty := [group for group in groups if group not in present]:
        raise ValueError(f"variations {empty[0]!r} match no parameter of this task; those that do are {present}")
    return {name for name, row in rows.items() if row.group in groups}


def _group_names(value: str | Sequence[str], what: str) -> tuple[object, ...]:
    """Returns names that are alone, in a sequence, or joined by commas; `what` is for messages."""
    return checks.unique_names(value.split(",") if isinstance(value, str) else value, what, minimum=0)


def flat_values(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Returns the leaves of nested dicts by their path, the parts of which are joined by `/`."""
    if not isinstance(values, Mapping):
        raise TypeError(f"variation_values must be a dict, got {checks.shown(values)}")
    # Names such as `kettle/mass` have a few parts; deeper dicts would exceed Python's limit on recursion.
    if prefix.count("/") > 8:
        raise ValueError(f"variation_values are nested too deeply at {checks.shown(prefix)}")
    flat: dict[str, Any] = {}
    for name, value in values.items():
        flat |= flat_values(value, f"{prefix}{name}/") if isinstance(value, Mapping) else {f"{prefix}{name}": value}
    return flat
