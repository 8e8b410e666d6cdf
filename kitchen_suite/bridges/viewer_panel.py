"""The panel of `kitchen-view`: what is chosen in the browser, as commands in a queue; needs the extra `web`."""

import dataclasses
import queue
from typing import Any

from kitchen_suite import suite
from kitchen_suite.bridges.viewer_settings import ViewSettings
from kitchen_suite.policies import POLICIES
from kitchen_suite.tasks.varied import GROUPS, SPLITS

SPEEDS = ("0.25x", "0.5x", "1x", "2x", "4x", "8x")


class ViewerPanel:
    """Widgets of the panel. Their callbacks run in threads of viser's, so they only put commands into the queue.

    Attributes:
      commands: names of commands, in the order in which they were given: `load`, `reset`, `step`, `camera`.
    """

    def __init__(self, gui: Any, settings: ViewSettings) -> None:
        """Adds the widgets.

        Args:
          gui: of a viser server.
          settings: initial values.
        """
        self.commands: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._settings, self._gui = settings, gui
        self._add_episode_widgets()
        self._add_task_widgets()

    @property
    def is_paused(self) -> bool:
        """Whether time stands still."""
        return not self._run.value

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
        return self._camera.value

    def settings(self) -> ViewSettings:
        """Returns the settings with what has been chosen.

        Arguments of the task that were given on the command line are of the domain that was given with them.
        """
        first = self._settings
        groups = [name for name, box in self._groups.items() if box.value]
        return dataclasses.replace(
            first,
            domain_name=self._domain.value,
            task_name=self._task.value,
            policy=self._policy.value,
            seed=self.seed,
            task_kwargs=first.task_kwargs if self._domain.value == first.domain_name else {},
            variations=",".join(groups) if groups else self._distributions,
            variation_split=self._split.value if groups else None,
        )

    def show(self, report: str) -> None:
        """Shows the progress of the episode, in Markdown."""
        self._report.content = report

    def offer_cameras(self, names: list[str]) -> None:
        """Offers the cameras of a model."""
        self._camera.options = names

    def _add_episode_widgets(self) -> None:
        gui, first = self._gui, self._settings
        self._report = gui.add_markdown("")
        with gui.add_folder("Episode"):
            self._run = gui.add_checkbox("Run", initial_value=True)
            self._add_button("Step", "step", "One control step; pauses.")
            self._speed = gui.add_dropdown("Speed", SPEEDS, initial_value="1x")
            self._seed = gui.add_number("Seed", first.seed, min=0, max=2**31 - 1, step=1)
            self._continue = gui.add_checkbox("Next seed at the end", initial_value=True)
            self._add_button("Reset", "reset", "Starts the episode of the seed.")
            self._camera = gui.add_dropdown("Camera", (first.camera,), initial_value=first.camera)
            self._camera.on_update(lambda event: self.commands.put("camera"))

    def _add_task_widgets(self) -> None:
        gui, first = self._gui, self._settings
        tasks = suite.TASKS_BY_DOMAIN
        with gui.add_folder("Task"):
            self._domain = gui.add_dropdown("Domain", tuple(tasks), initial_value=first.domain_name)
            self._task = gui.add_dropdown("Task", tuple(tasks[first.domain_name]), initial_value=first.task_name)
            policies = dict.fromkeys((first.policy, *POLICIES))
            self._policy = gui.add_dropdown("Policy", tuple(policies), initial_value=first.policy)
            with gui.add_folder("Variations", expand_by_default=False):
                given = (first.variations or "").split(",")
                self._groups = {name: gui.add_checkbox(name, initial_value=name in given) for name in GROUPS}
                # Those of the flag by parameter apply while no group is chosen.
                self._distributions = first.variations if not {*given} & {*GROUPS} else None
                split = first.variation_split or SPLITS[0]
                self._split = gui.add_dropdown("Split", tuple(SPLITS), initial_value=split)
            self._add_button("Load", "load", "Builds the environment that is chosen here.")
        self._domain.on_update(lambda event: self._offer_tasks())

    def _add_button(self, label: str, command: str, hint: str) -> None:
        button = self._gui.add_button(label, hint=hint)

        def put(event: object) -> None:
            if command == "step":
                self._run.value = False
            self.commands.put(command)

        button.on_click(put)

    def _offer_tasks(self) -> None:
        """Offers the tasks of the domain that has been chosen, and chooses its default task."""
        domain = self._domain.value
        self._task.options = tuple(suite.TASKS_BY_DOMAIN[domain])
        self._task.value = suite.default_task(domain)
