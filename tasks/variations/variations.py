"""Tasks whose scenes vary: at every reset, wanted parameters are drawn and set."""

import abc
import contextlib
import dataclasses
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from dm_control import composer, mjcf
from numpy.typing import NDArray

from kitchen_suite import checks
from kitchen_suite.entities.parameters import Parameter
from kitchen_suite.entities.scenes import Scene
from kitchen_suite.tasks.episode import sensing_parameters
from kitchen_suite.tasks.mdp import MDP
from kitchen_suite.tasks.variations import distributions as descriptions
from kitchen_suite.tasks.variations.distributions import GROUPS, SPLITS, Variation, Varied
from kitchen_suite.tasks.variations.layouts import LayoutCheck
from kitchen_suite.tasks.variations.randomizer import Randomizer, Values, VariationRequest, group_names, make_request

# No asked task starts nearer to its goal than this multiple of its threshold.
START_DISTANCE = 1.2

# Number of refusals in a reset after which the layout is the default one.
MAX_REFUSALS = 20


class VariedTask(composer.Task):
    """A task with variations.

    Attributes:
      varied: the parameters that groups vary, in the order in which they are drawn.
    """

    varied: ClassVar[Sequence[Varied]] = ()
    _randomizer = Randomizer({}, {})
    _wanted: Mapping[str, Varied] = MappingProxyType({})
    _split = "seen"
    _request = VariationRequest()
    _refusals = 0
    _layout_check: LayoutCheck | None = None
    _checked_model: Any = None

    def __init__(
        self,
        scene: Scene,
        *,
        variations: str | Sequence[str] | Mapping[str, Variation] | None = None,
        variation_split: str = "seen",
        **observables: Any,
    ) -> None:
        """Chooses what varies; a task in which nothing may vary need not call this.

        Args:
          scene: of the task; not yet compiled.
          variations: names of groups of `tasks.varied.GROUPS`, alone, in a sequence or joined by commas; or
            distributions by parameter, which JSON may describe (see `variations.parse`). Nothing varies when omitted.
          variation_split: `seen`, or `held_out`: which distributions of the groups are drawn from.
          **observables: further arguments of tasks; see `ObservedTask`.

        Raises:
          TypeError: an argument of the wrong type.
          ValueError: an unknown or repeated name, an unknown distribution, or a number out of range.
        """
        super().__init__(scene, **observables)
        self._split = checks.choice(variation_split, SPLITS, "variation_split")
        if not isinstance(variations, str | Sequence | Mapping | None):
            raise TypeError(f"variations must be names of groups, or distributions by parameter, got {variations!r}")
        if variations:
            self._choose(scene, variations)

    def _choose(self, scene: Scene, variations: str | Sequence[str] | Mapping[str, Variation]) -> None:
        """Selects the parameters that vary, and their distributions."""
        offered = {parameter.name: parameter for parameter in (*scene.parameters, *self._own_parameters(scene))}
        table = {varied.name: varied for varied in self.varied if varied.name in offered}
        distributions = _distributions(variations, table, offered, self._split)
        self._wanted = {name: varied for name, varied in table.items() if name in distributions}
        parameters = {name: offered[name] for name in self._wanted}
        # Groups draw within the ranges anyway.
        given = self._wanted if isinstance(variations, Mapping) else {}
        ranges = {name: (varied.low, varied.high) for name, varied in given.items()}
        chosen = Randomizer(parameters, distributions, owner="variation", ranges=ranges)
        for name, each in distributions.items():
            if descriptions.is_constant(each):
                self._wanted[name].check(np.asarray(each, np.float64))
        # The task may have set a randomizer of its own.
        if "_randomizer" not in vars(self):
            self._randomizer = Randomizer({}, {})
        self._randomizer.add(chosen)
        groups = {varied.group for varied in self._wanted.values()}
        if "appearance" in groups:
            scene.prepare_appearance()
        if "layout" in groups:
            if scene.arena.mjcf_model.option.flag.sleep == "enable":
                raise ValueError(
                    "variations of the layout need sleep=False: sleeping objects would stay where they were"
                )
            self._layout_check = LayoutCheck(scene, self._handles(scene))

    def _own_parameters(self, scene: Scene) -> tuple[Parameter, ...]:
        """Returns parameters that belong to the task in a scene, not to an entity."""
        del scene
        return sensing_parameters(self.mdp.noise_parts)

    def _handles(self, scene: Scene) -> Sequence[mjcf.Element]:
        """Returns the sites that the hand must reach."""
        return [handle for prop in scene.props.values() for handle in prop.handles]

    @property
    def _home(self) -> NDArray[np.float64] | None:
        """Positions `(9,)` of the robot's joints in the default layout [rad, m]; None for those at the first reset."""
        return None

    @property
    @abc.abstractmethod
    def mdp(self) -> MDP:
        """The task's settings, and the mathematics of an episode under them."""

    @property
    def randomizer(self) -> Randomizer:
        """Draws parameters of the scene at resets."""
        return self._randomizer

    @property
    def varies(self) -> bool:
        """Whether anything varies by `variations`."""
        return bool(self._wanted)

    @property
    def wanted_variations(self) -> Mapping[str, Varied]:
        """The parameters that vary by `variations`, by name."""
        return self._wanted

    @property
    def variation_split(self) -> str:
        """`seen` or `held_out`."""
        return self._split

    @property
    def variation_values(self) -> dict[str, NDArray[np.float64]]:
        """Present values of the parameters that vary by `variations`, in fresh arrays."""
        return {name: np.array(self._randomizer.values[name]) for name in self._wanted}

    @property
    def variation_info(self) -> dict[str, Any]:
        """Infos on the variation of the episode: `variation_values`, and `layout_refusals` where layouts vary.

        Empty if nothing varies. With `MAX_REFUSALS` refusals the layout is the default one.
        """
        if not self._wanted:
            return {}
        refusals = {"layout_refusals": np.array(self._refusals)} if self._layout_check else {}
        return {"variation_values": self.variation_values, **refusals}

    def _values_in(self, state: Mapping[str, Any]) -> dict[str, NDArray[np.float64]]:
        """Returns the values of all parameters in a state that `get_state` returned."""
        return dict(state.get("variation_values", {}))

    def _restore_variation(self, state: Mapping[str, Any], values: Values) -> None:
        """Sets the checked values of all parameters in a state that `get_state` returned."""
        self._randomizer.set(values)
        self._refusals = int(state.get("layout_refusals", 0))

    def variation_request(
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
        return make_request(self._wanted, self._randomizer, names, values)

    def request_variation(self, request: VariationRequest) -> None:
        """Makes the next reset follow a request."""
        self._request = request

    def _vary(self, physics: mjcf.Physics, random_state: np.random.RandomState) -> None:
        """Draws and sets the parameters of an episode, at its start state; resets the physics if that fails."""
        if not self._randomizer.names:
            return
        with contextlib.ExitStack() as undo:
            undo.callback(physics.reset)
            drawn = self._randomizer.draw(random_state)
            undo.pop_all()
        request, self._request = self._request, VariationRequest()
        start, self._refusals = np.array(physics.data.qpos), 0
        if self._layout_check:
            seed = random_state.randint(2**31)
            self._bind_layout_check(physics, self._layout_check)
            self._set_accepted(physics, self._layout_check, start, drawn, request, seed)
        else:
            self._set_variation(physics, start, request.applied(drawn, self._randomizer.defaults))

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
        trial, defaults = request, self._randomizer.defaults
        if not any(request.draws(name) for name in self._layout):
            # All values are given back: the infos count as many refusals as when they were drawn.
            trial = dataclasses.replace(request, values={})
        redrawn = [name for name in self._layout if trial.draws(name)]
        self._set_variation(physics, start, trial.applied(drawn, defaults))
        # Starting a generator takes as long as checking a layout.
        generator: np.random.RandomState | None = None
        while redrawn and self._refusals < MAX_REFUSALS and not check.accepts(physics):
            self._refusals += 1
            generator = generator or np.random.RandomState(seed)
            others = defaults if self._refusals == MAX_REFUSALS else self._randomizer.draw(generator)
            drawn = {**drawn, **{name: others[name] for name in redrawn}}
            self._set_variation(physics, start, trial.applied(drawn, defaults))
        if trial is not request:
            self._set_variation(physics, start, request.applied(drawn, defaults))

    @property
    def _layout(self) -> list[str]:
        """Names of the parameters of the layout that vary."""
        return [name for name, varied in self._wanted.items() if varied.group == "layout"]

    def _bind_layout_check(self, physics: mjcf.Physics, check: LayoutCheck) -> None:
        """Binds the layout check to the default layout, once for each compiled scene."""
        if self._checked_model is physics.model.ptr:
            return
        self._checked_model = physics.model.ptr
        self._randomizer.set(self._randomizer.defaults)
        if self._home is not None:
            physics.bind(self.robot.joints).qpos = self._home
        check.bind(physics)

    def _set_variation(self, physics: mjcf.Physics, start: NDArray[np.float64], values: Values) -> None:
        """Sets values at a start state, corrected by the task."""
        physics.data.qpos[:] = start
        self._randomizer.set(values)
        corrected = self._corrected(values)
        if corrected is not values:
            physics.data.qpos[:] = start
            self._randomizer.set(corrected)

    def _corrected(self, values: Values) -> Values:
        """Returns values that suit the task, given the physics with the present ones; the same object if they do."""
        return values


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
