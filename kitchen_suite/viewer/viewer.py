"""The live viewer: episodes of policies, and of a person, in a browser; needs the extra `web`."""

import math
import queue
import time
from collections.abc import Callable
from typing import Any, Never

from kitchen_suite.closing import closed_on_error
from kitchen_suite.episodes.play import REWIND_STEPS
from kitchen_suite.rendering.cameras import camera_names, find_camera
from kitchen_suite.viewer.escaping import escaped
from kitchen_suite.viewer.hand import HandPanel
from kitchen_suite.viewer.live_episode import Choice, LiveEpisode, started_episode
from kitchen_suite.viewer.live_page import Command, LivePage, show_where
from kitchen_suite.viewer.panels import EpisodePanel, TaskPanel
from kitchen_suite.viewer.servers import address_of, local_server
from kitchen_suite.viewer.stage import CameraImage, Stage
from kitchen_suite.viewer.teleoperation import Collection, SeedTakenError, TeleoperatedEpisode, persons_episode

_IDLE = 0.05  # Greatest time between two readings of the panel [s].
_SHOW_EVERY = 0.04  # Least time between two control steps that are shown [s].

# Errors of a choice in the panel, of the policy, or of physics that diverges (a RuntimeError); they are shown there.
_ERRORS = (ImportError, OSError, RuntimeError, TypeError, ValueError)


class Display:
    """The episode in progress on a page: its scene and its report.

    Attributes:
      stage: the scene.
      is_stale: whether another state is shown than the current one.
    """

    def __init__(self, page: LivePage, headline: Any, panel: EpisodePanel, episode: LiveEpisode) -> None:
        """Shows the model of an episode, and its state with the next call of `show`; `headline` is viser's Markdown."""
        self._page = page
        self._headline = headline
        self._panel = panel
        self._shown = 0.0
        self.show_model(episode)

    @property
    def is_due(self) -> bool:
        """Whether the state is shown so long that a browser can draw another one."""
        return time.monotonic() - self._shown >= _SHOW_EVERY

    def show_model(self, episode: LiveEpisode) -> None:
        """Replaces the scene by that of an episode."""
        person = episode if isinstance(episode, TeleoperatedEpisode) else None
        self._panel.cameras.options = camera_names(episode.physics)
        self.stage = Stage(self._page, episode.physics, self._panel.camera, person)
        self.is_stale = True

    def show(self, episode: LiveEpisode, headline: str, report: str) -> None:
        """Shows state and report in one message: a browser draws a frame for each."""
        with self._page.server.atomic():
            self.stage.update(episode.physics)
            self._headline.content = headline
            self._panel.report.content = report
        self._page.server.flush()
        self.is_stale = False
        self._shown = time.monotonic()


class Viewer:
    """Plays an episode in real time, shows it in a page, and carries out the commands that are given there.

    Attributes:
      episode: that is played.
    """

    episode: LiveEpisode

    def __init__(
        self,
        page: LivePage,
        episode: LiveEpisode,
        choice: Choice,
        start: Callable[[Choice, int], LiveEpisode],
        *,
        camera: str,
    ) -> None:
        """Shows an episode that has been started.

        Args:
          page: that is empty.
          episode: to show first.
          choice: of which the episode is.
          start: returns the episode of another choice and of a seed, started.
          camera: to look through at first.
        """
        self._page = page
        self.episode = episode
        self._start = start
        # First in the panel, of which a phone shows little.
        self._headline = page.gui.add_markdown("")
        self._add_hand()
        self._problem = ""
        self._due = time.monotonic()
        is_persons = isinstance(episode, TeleoperatedEpisode)
        self._panel = EpisodePanel(
            page,
            camera=camera,
            seed=episode.seed,
            folded=is_persons,
            step=self._step,
            reset=self._reset,
            look=self._look,
        )
        self._tasks = TaskPanel(page, choice, takes_over=is_persons, load=self._load)
        self._display = Display(page, self._headline, self._panel, episode)

    def update(self) -> None:
        """Makes the control step that is due, and carries out a command that is given until the next one is."""
        now = time.monotonic()
        stands_still = self._stands_still
        if not stands_still and now >= self._due:
            self._try(self._go_on)
            self._display.is_stale = True
            # Where steps take longer than they should, time passes more slowly.
            self._due = max(self._due + self.episode.timestep / self._panel.speed, now)
        if self._display.is_stale and (stands_still or self._problem or self._display.is_due):
            self._show()
        wait = _IDLE if stands_still else min(_IDLE, max(self._due - time.monotonic(), 0.0))
        try:
            command = self._page.commands.get(timeout=wait) if wait else self._page.commands.get_nowait()
        except queue.Empty:
            return
        self._carry_out(command)

    @property
    def _stands_still(self) -> bool:
        is_alone = self._page.exclusive and self._page.controlling is None
        return not self._panel.run.value or bool(self._problem) or self.episode.is_waiting or is_alone

    def _carry_out(self, command: Command) -> None:
        was_waiting = self.episode.is_waiting
        self._try(command)
        self._display.is_stale = True
        if was_waiting and not self.episode.is_waiting:
            # The first control step is made at once, and shown with what the command has changed.
            self._due = time.monotonic()
        else:
            self._show()

    def _try(self, action: Command) -> None:
        """Calls a function; its error pauses the episode until another command succeeds."""
        try:
            action()
            self._problem = ""
        except _ERRORS as error:
            self._problem = escaped(str(error))

    def _step(self) -> None:
        self._panel.run.value = False
        self._go_on()

    def _go_on(self) -> None:
        """Makes a control step, or starts the next episode where this one has ended."""
        if not self.episode.has_ended:
            self.episode.step()
        elif self._panel.continues and not self.episode.is_waiting:
            self._panel.seed = self.episode.seed + 1
            self._reset()

    def _reset(self) -> None:
        self.episode.start(self._panel.seed)
        if not self._display.stage.shows(self.episode.physics):
            self._display.show_model(self.episode)

    def _look(self) -> None:
        physics = self.episode.physics
        self._page.move_cameras(physics, find_camera(physics, self._panel.camera))

    def _load(self) -> None:
        self._headline.content = "Loading."
        episode = self._start(self._tasks.choice(), self._panel.seed)
        self.episode.close()
        self.episode = episode
        self._panel.seed = episode.seed
        self._display.show_model(episode)

    def _show(self) -> None:
        headline = f"**Error:** {self._problem}" if self._problem else self.episode.headline()
        self._display.show(self.episode, headline, self._report())

    def _add_hand(self) -> None:
        """Adds what a person needs who plays, above the other widgets; nothing where a policy plays."""

    def _report(self) -> str:
        return self.episode.report()


class HandFolder:
    """The widgets of a person who plays: the hand, going back in time, and the image of a camera.

    Attributes:
      image: of a camera.
    """

    def __init__(self, page: LivePage, person: Callable[[], TeleoperatedEpisode]) -> None:
        """Adds them to a page; `person` returns the episode that commands are for."""
        self._person = person
        gui = page.gui
        with gui.add_folder("Hand"):
            self._hand = HandPanel(page, person)
            # They do nothing before the first control step.
            self._backwards = (
                page.add_button("Rewind 1 s", self._rewind_a_second, "backspace", visible=False),
                page.guard(gui.add_number("n", 25, min=1, max=REWIND_STEPS, step=1, visible=False)),
                page.add_button("Rewind n steps", self._rewind_steps, visible=False),
                page.add_button("Discard", lambda: person().discard(), hint="Starts the episode anew.", visible=False),
            )
            self._follow = page.guard(gui.add_checkbox("Camera follows", initial_value=False))
            self.image = CameraImage(page, person().physics)

    @property
    def follows(self) -> bool:
        """Whether views move with the hand."""
        return bool(self._follow.value)

    def update(self) -> None:
        """Shows the current image, and the buttons that do something now."""
        person = self._person()
        self._hand.update()
        for widget in self._backwards:
            show_where(widget, person.steps > 0)
        self.image.update(person.physics)

    def _rewind_steps(self) -> None:
        _, steps, *_ = self._backwards
        self._person().rewind(int(steps.value))

    def _rewind_a_second(self) -> None:
        episode = self._person()
        episode.rewind(math.ceil(1.0 / episode.timestep))


class TeleoperationViewer(Viewer):
    """A viewer in which a person moves the hand, and saves episodes."""

    episode: TeleoperatedEpisode

    def __init__(
        self,
        page: LivePage,
        episode: TeleoperatedEpisode,
        choice: Choice,
        start: Callable[[Choice, int], TeleoperatedEpisode],
        *,
        camera: str,
        collection: Collection | None,
    ) -> None:
        """Shows an episode that has been started; arguments as of `Viewer`.

        Episodes are saved in a collection, if there is one.
        """
        self._collection = collection
        super().__init__(page, episode, choice, start, camera=camera)
        page.on_release = self._release

    def _add_hand(self) -> None:
        if self._collection:
            self._page.add_button("Save", self._save, "enter", hint="And starts the episode of the next seed.")
        self._hand = HandFolder(self._page, lambda: self.episode)

    def update(self) -> None:
        super().update()
        if not self._hand.image.is_of_now:
            self._hand.image.update(self.episode.physics)

    def _save(self) -> None:
        assert self._collection
        try:
            is_done = self._collection.save(self.episode)
        except SeedTakenError as error:
            self._page.notify("Kept aside", str(error), color="red")
        else:
            title, color = ("Saved", None) if is_done else ("Saved a failed episode", "red")
            self._page.notify(title, self._collection.last, color=color)
        self._panel.seed = self._collection.next_seed(self.episode.seed)
        self._reset()

    def _release(self) -> None:
        """Lets time stand still: the browser is gone that has controlled until now."""
        self._display.stage.release()
        if self.episode.policy.is_persons:
            self.episode.policy.take_over()

    def _load(self) -> None:
        super()._load()
        self._hand.image.offer(self.episode.physics)

    def _show(self) -> None:
        super()._show()
        if self._hand.follows:
            self._display.stage.follow()
        self._hand.update()

    def _report(self) -> str:
        return self.episode.report(self._collection.numbers() if self._collection else {})


def show(
    episode: LiveEpisode,
    choice: Choice,
    *,
    camera: str,
    render_quality: str,
    port: int,
    report: Callable[[str], object],
    token: str = "",
) -> Never:
    """Serves a page at a port of this machine, and plays episodes there until an interrupt, from a started one on.

    `report` is called with the address. With a token, the page is for those who know its address.
    """

    def start(other: Choice, seed: int) -> LiveEpisode:
        return started_episode(other, seed, render_quality=render_quality)

    with local_server(port, token) as server:
        page = LivePage(server, exclusive=False)
        _play(Viewer(page, episode, choice, start, camera=camera), address_of(port, token), report)


def teleoperate(
    episode: TeleoperatedEpisode,
    choice: Choice,
    *,
    collection: Collection | None,
    camera: str,
    render_quality: str,
    port: int,
    report: Callable[[str], object],
    token: str = "",
) -> Never:
    """As `show`, in a page in which a person moves the hand, and saves episodes where there is a collection."""

    def start(other: Choice, seed: int) -> TeleoperatedEpisode:
        loaded = persons_episode(other, render_quality=render_quality)
        with closed_on_error([loaded]):
            if collection:
                collection.check(loaded.spec)
            loaded.start(collection.next_seed(seed) if collection else seed)
        return loaded

    with local_server(port, token) as server:
        page = LivePage(server, exclusive=True)
        viewer = TeleoperationViewer(page, episode, choice, start, camera=camera, collection=collection)
        _play(viewer, address_of(port, token), report)


def _play(viewer: Viewer, address: str, report: Callable[[str], object]) -> Never:
    report(f"{address}  (Ctrl-C ends)")
    try:
        while True:
            viewer.update()
    finally:
        viewer.episode.close()
