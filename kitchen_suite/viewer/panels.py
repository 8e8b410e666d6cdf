"""The panels of the viewer: the episode in progress, and what is played next."""

import contextlib
import dataclasses
import functools

import numpy as np

from kitchen_suite import checks, policies, suite
from kitchen_suite.policies import POLICIES
from kitchen_suite.tasks.variations.distributions import GROUPS, SPLITS
from kitchen_suite.viewer.live_episode import DEFAULT_POLICY, Choice
from kitchen_suite.viewer.live_page import Command, LivePage

NOBODY = "nobody"  # From whom a person takes over where no policy acts.

SPEEDS = ("0.25x", "0.5x", "1x", "2x", "4x", "8x")

# Errors of a policy that cannot act in a task.
_ERRORS = (ImportError, OSError, RuntimeError, TypeError, ValueError)


class EpisodePanel:
    """The report of the episode in progress, and the widgets that play it.

    Attributes:
      report: its numbers, in Markdown.
      run: whether the episode is not paused.
      cameras: to look through.
    """

    def __init__(
        self, page: LivePage, *, camera: str, seed: int, folded: bool, step: Command, reset: Command, look: Command
    ) -> None:
        """Adds them to a page.

        Args:
          page: to add them to.
          camera: to look through at first.
          seed: of the first reset.
          folded: whether the widgets are folded at first.
          step: command of a single control step.
          reset: command that starts the episode of the seed.
          look: command that looks through another camera.
        """
        gui = page.gui
        self.report = gui.add_markdown("")
        with gui.add_folder("Episode", expand_by_default=not folded):
            self.run = page.guard(gui.add_checkbox("Run", initial_value=True))
            page.add_button("Step", step, hint="One control step; pauses.")
            self._speed = page.guard(gui.add_dropdown("Speed", SPEEDS, initial_value="1x"))
            self._seed = page.guard(gui.add_number("Seed", seed, min=0, max=2**31 - 1, step=1))
            self._continue = page.guard(gui.add_checkbox("Next seed at the end", initial_value=True))
            page.add_button("Reset", reset, hint="Starts the episode of the seed.")
            self.cameras = page.guard(gui.add_dropdown("Camera", (camera,), initial_value=camera))
            self.cameras.on_update(page.putting(look))

    @property
    def continues(self) -> bool:
        """Whether the episode of the next seed follows after one has ended."""
        return self._continue.value

    @property
    def speed(self) -> float:
        """Simulated time in proportion to real time."""
        return float(self._speed.value.removesuffix("x"))

    @property
    def seed(self) -> int:
        """Seed of the next reset."""
        return int(self._seed.value)

    @seed.setter
    def seed(self, value: int) -> None:
        self._seed.value = value

    @property
    def camera(self) -> str:
        """Name of the camera to look through."""
        value, offered = self.cameras.value, self.cameras.options
        return value if value in offered else offered[0]


class TaskPanel:
    """The widgets that choose domain, task, policy and variations."""

    def __init__(self, page: LivePage, first: Choice, *, takes_over: bool, load: Command) -> None:
        """Adds them to a page, with the values of a first choice.

        Args:
          page: to add them to.
          first: the first choice.
          takes_over: whether a person takes over from the policy, which may then be nobody.
          load: command that builds the environment that is chosen.
        """
        gui, tasks = page.gui, suite.TASKS_BY_DOMAIN
        self._first = first
        self._nobody = (NOBODY,) if takes_over else ()
        given = first.policy or (NOBODY if takes_over else DEFAULT_POLICY)
        # Where a person plays, the hand comes first.
        with gui.add_folder("Task", expand_by_default=not takes_over):
            self._domain = page.guard(gui.add_dropdown("Domain", tuple(tasks), initial_value=first.domain_name))
            names = tuple(tasks[first.domain_name])
            self._task = page.guard(gui.add_dropdown("Task", names, initial_value=first.task_name))
            label = "Take over from" if takes_over else "Policy"
            self._policy = page.guard(gui.add_dropdown(label, (given,), initial_value=given))
            self._offer_policies()
            with gui.add_folder("Variations", expand_by_default=False):
                varied = first.variations if isinstance(first.variations, list) else []
                self._groups = {
                    name: page.guard(gui.add_checkbox(name, initial_value=name in varied)) for name in GROUPS
                }
                # Those by parameter apply while no group is chosen.
                self._distributions = first.variations if not {*varied} & {*GROUPS} else None
                split = first.variation_split or SPLITS[0]
                self._split = page.guard(gui.add_dropdown("Split", tuple(SPLITS), initial_value=split))
            page.add_button("Load", load, hint="Builds the environment that is chosen here.")
        self._domain.on_update(lambda event: self._offer_tasks())
        self._task.on_update(lambda event: self._offer_policies())

    def choice(self) -> Choice:
        """Returns what has been chosen.

        Arguments of the first choice are of its domain; another domain has its defaults. Raises a ValueError for a
        domain or policy that is not offered: names such as `module:callable` are code, and without a token a browser
        may be another user's, from which viser takes any value.
        """
        first, tasks = self._first, suite.TASKS_BY_DOMAIN
        domain = checks.choice(self._domain.value, tasks, "domain")
        task = checks.choice(self._task.value, tasks[domain], "task")
        policy = checks.choice(self._policy.value, self._offered(domain, task), "policy")
        groups = [name for name, box in self._groups.items() if box.value]
        return dataclasses.replace(
            first,
            domain_name=domain,
            task_name=task,
            policy=None if policy == NOBODY else policy,
            task_kwargs=first.task_kwargs if domain == first.domain_name else {},
            variations=groups or self._distributions,
            variation_split=self._split.value if groups else None,
        )

    def _offer_tasks(self) -> None:
        """Offers the tasks of the domain that has been chosen, and chooses its default task."""
        self._task.options = tuple(suite.TASKS_BY_DOMAIN[self._domain.value])
        self._task.value = suite.default_task(self._domain.value)
        self._offer_policies()

    def _offer_policies(self) -> None:
        """Offers the policies that can act in the chosen task, and the one that was given with it."""
        chosen, domain, task = self._policy.value, self._domain.value, self._task.value
        if task not in suite.TASKS_BY_DOMAIN.get(domain, ()):
            return
        offered = self._offered(domain, task)
        self._policy.options = offered
        self._policy.value = chosen if chosen in offered else offered[0]

    def _offered(self, domain_name: str, task_name: str) -> tuple[str, ...]:
        first = self._first
        is_first = (first.domain_name, first.task_name) == (domain_name, task_name)
        given = (first.policy,) if first.policy and is_first else ()
        return tuple(dict.fromkeys((*given, *self._nobody, *policies_for(domain_name, task_name))))


@functools.cache
def policies_for(domain_name: str, task_name: str) -> tuple[str, ...]:
    """Returns the names of the policies that can act in a task by themselves, the scripted expert first."""
    environment = suite.load(domain_name, task_name, {"visuals": False})
    acting = []
    for name in sorted(POLICIES, key=lambda name: name != "expert"):
        with contextlib.suppress(*_ERRORS):
            policies.find(name)(environment, np.random.default_rng(0))
            acting.append(name)
    return tuple(acting)
