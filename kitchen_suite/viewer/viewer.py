"""The live viewer: episodes of policies, and of a person, in a browser; needs the extra `web`."""

import atexit
import contextlib
import dataclasses
import functools
import json
import math
import queue
import sys
import time
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import dm_env
import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks, policies, suite
from kitchen_suite.episodes.episode import EpisodeArrays
from kitchen_suite.episodes.play import REWIND_STEPS
from kitchen_suite.episodes.recording import RecordingFolder
from kitchen_suite.episodes.report import print_line
from kitchen_suite.episodes.spec import EpisodeSpec
from kitchen_suite.policies import POLICIES
from kitchen_suite.rendering.cameras import camera_names, find_camera
from kitchen_suite.rendering.viser_servers import HOST, check_extra, local_server
from kitchen_suite.settings import FAILURE, ViewSettings
from kitchen_suite.tasks.variations.distributions import GROUPS, SPLITS
from kitchen_suite.versions import installed_versions
from kitchen_suite.viewer.live import LiveEpisode, TeleoperatedEpisode, kept_by_user
from kitchen_suite.viewer.page import FIRST_CAMERA, CameraPicture, Command, HandPanel, Page, Stage

_PERSONS_STEPS = 2_000  # Control steps of an episode that a person plays, by default: a program needs a tenth.

# Name of a person as a policy, and in the panel of nobody from whom a person takes over.
TELEOP, NOBODY = "teleop", "nobody"

SPEEDS = ("0.25x", "0.5x", "1x", "2x", "4x", "8x")

# Greatest time between two readings of the panel, and least time between two control steps that are shown [s].
_IDLE, _SHOW_EVERY = 0.05, 0.04

# Errors of a choice in the panel, of the policy, or of physics that diverges (a RuntimeError); they are shown there.
_ERRORS = (ImportError, OSError, RuntimeError, TypeError, ValueError)


class EpisodePanel:
    """The report of the episode in progress, and the widgets that play it.

    Attributes:
      report: in Markdown.
      run: whether the episode is not paused.
      cameras: to look through.
    """

    def __init__(self, page: Page, camera: str, *, has_seeds: bool, seed: int = 0, folded: bool = False) -> None:
        """Adds them to a page; `has_seeds` says whether seeds can be chosen, of which the first one is `seed`."""
        gui, self._page = page.gui, page
        self.report = gui.add_markdown("")
        with gui.add_folder("Episode", expand_by_default=not folded):
            self.run = page.guard(gui.add_checkbox("Run", initial_value=True))
            page.add_button("Step", "step", hint="One control step; pauses.")
            self._speed = page.guard(gui.add_dropdown("Speed", SPEEDS, initial_value="1x"))
            self._seed = self._continue = None
            if has_seeds:
                self._seed = page.guard(gui.add_number("Seed", seed, min=0, max=2**31 - 1, step=1))
                self._continue = page.guard(gui.add_checkbox("Next seed at the end", initial_value=True))
                page.add_button("Reset", "reset", hint="Starts the episode of the seed.")
            self.cameras = page.guard(gui.add_dropdown("Camera", (camera,), initial_value=camera))
            self.cameras.on_update(page.putting("camera"))

    @property
    def continues(self) -> bool:
        """Whether the episode of the next seed follows after one has ended."""
        return self._continue is not None and self._continue.value

    @property
    def speed(self) -> float:
        """Simulated time in proportion to real time."""
        # A browser can send anything.
        return float(self._speed.value.removesuffix("x")) if self._speed.value in SPEEDS else 1.0

    @property
    def seed(self) -> int:
        """Seed of the next reset."""
        return max(int(self._seed.value), 0) if self._seed else 0

    @seed.setter
    def seed(self, value: int) -> None:
        if self._seed:
            self._seed.value = value

    @property
    def camera(self) -> str:
        """Name of the camera to look through."""
        value, offered = self.cameras.value, self.cameras.options
        return value if value in offered else offered[0]


class TaskPanel:
    """The widgets that choose domain, task, policy and variations."""

    def __init__(self, page: Page, settings: ViewSettings) -> None:
        """Adds them to a page, with the settings as their initial values."""
        gui, first, tasks = page.gui, settings, suite.TASKS_BY_DOMAIN
        self._settings, self._nobody = first, (NOBODY,) if first.teleop else ()
        given = first.policy or NOBODY
        # Where a person plays, the hand comes first.
        with gui.add_folder("Task", expand_by_default=not first.teleop):
            self._domain = page.guard(gui.add_dropdown("Domain", tuple(tasks), initial_value=first.domain_name))
            names = tuple(tasks[first.domain_name])
            self._task = page.guard(gui.add_dropdown("Task", names, initial_value=str(first.task_name)))
            label = "Take over from" if first.teleop else "Policy"
            self._policy = page.guard(gui.add_dropdown(label, (given,), initial_value=given))
            self._offer_policies()
            with gui.add_folder("Variations", expand_by_default=False):
                groups = (first.variations or "").split(",")
                self._groups = {
                    name: page.guard(gui.add_checkbox(name, initial_value=name in groups)) for name in GROUPS
                }
                # Those of the flag by parameter apply while no group is chosen.
                self._distributions = first.variations if not {*groups} & {*GROUPS} else None
                split = first.variation_split or SPLITS[0]
                self._split = page.guard(gui.add_dropdown("Split", tuple(SPLITS), initial_value=split))
            page.add_button("Load", "load", hint="Builds the environment that is chosen here.")
        self._domain.on_update(lambda event: self._offer_tasks())
        self._task.on_update(lambda event: self._offer_policies())

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
            policy=None if self._policy.value == NOBODY else self._policy.value,
            task_kwargs=first.task_kwargs if self._domain.value == first.domain_name else {},
            variations=",".join(groups) if groups else self._distributions,
            variation_split=self._split.value if groups else None,
            start_from=None,
        )

    def _offer_tasks(self) -> None:
        """Offers the tasks of the domain that has been chosen, and chooses its default task."""
        if self._domain.value in suite.TASKS_BY_DOMAIN:
            self._task.options = tuple(suite.TASKS_BY_DOMAIN[self._domain.value])
            self._task.value = suite.default_task(self._domain.value)
            self._offer_policies()

    def _offer_policies(self) -> None:
        """Offers the policies that can act in the chosen task, and the one that was given with it."""
        first, chosen, domain = self._settings, self._policy.value, self._domain.value
        if self._task.value not in suite.TASKS_BY_DOMAIN.get(domain, ()):
            return
        task = domain, self._task.value
        given = (first.policy,) if first.policy and (first.domain_name, first.task_name) == task else ()
        offered = tuple(dict.fromkeys((*given, *self._nobody, *policies_for(*task))))
        self._policy.options = offered
        self._policy.value = chosen if chosen in offered else offered[0]


@functools.cache
def policies_for(domain_name: str, task_name: str) -> tuple[str, ...]:
    """Returns the names of the policies that can act in a task by themselves, the scripted expert first."""
    environment = suite.load(domain_name, task_name, {"visuals": False})
    acting = []
    for name in sorted((name for name in POLICIES if not POLICIES[name].player), key=lambda name: name != "expert"):
        with contextlib.suppress(*_ERRORS):
            policies.find(name)(environment, np.random.default_rng(0))
            acting.append(name)
    return tuple(acting)


class Viewer:
    """Plays an episode in real time, and does what is chosen in the panel."""

    def __init__(
        self, page: Page, episode: LiveEpisode, *, settings: ViewSettings | None = None, camera: str = FIRST_CAMERA
    ) -> None:
        """Shows an episode that has been started, in place of the contents of a page, through a camera at first.

        With the settings of `kitchen-view` a panel chooses further episodes.
        """
        page.clear()
        self._page, self.episode = page, episode
        self._problem, self._due, self._shown, self._is_stale = "", time.monotonic(), 0.0, False
        self._picture: CameraPicture | None = None
        self._follow: Any = None
        is_persons = isinstance(episode, TeleoperatedEpisode)
        if isinstance(episode, TeleoperatedEpisode):
            # First in the panel, which shows little on a phone.
            self._add_hand_widgets(episode, settings)
        has_seeds = settings is not None
        self._panel = EpisodePanel(page, camera, has_seeds=has_seeds, seed=episode.seed, folded=is_persons)
        self._tasks = TaskPanel(page, settings) if settings else None
        self._show_stage()

    def update(self) -> None:
        """Makes the control step that is due, and carries out a command that is given until the next one is."""
        panel, now = self._panel, time.monotonic()
        is_alone = self._page.exclusive and self._page.controlling is None
        stands_still = not panel.run.value or bool(self._problem) or self.episode.is_waiting or is_alone
        if not stands_still and now >= self._due:
            self._step()
            # Where steps take longer than they should, time passes more slowly.
            self._due = max(self._due + self.episode.timestep / panel.speed, now)
        if self._is_stale and (stands_still or now - self._shown >= _SHOW_EVERY):
            self._show()
        elif self._picture and not self._picture.is_of_now:
            self._picture.update(self.episode.physics)
        wait = _IDLE if stands_still else min(_IDLE, max(self._due - time.monotonic(), 0.0))
        try:
            command = self._page.commands.get(timeout=wait) if wait else self._page.commands.get_nowait()
        except queue.Empty:
            return
        self._carry_out(command)

    def _add_hand_widgets(self, episode: TeleoperatedEpisode, settings: ViewSettings | None) -> None:
        page, gui = self._page, self._page.gui
        if settings is None:
            page.add_button("Finish", lambda episode: episode.finish(), "enter", hint="The hand stays to the end.")
        elif settings.output is not None:
            page.add_button("Save", self._save, "enter", hint="And starts the episode of the next seed.")
        with gui.add_folder("Hand"):
            # Another policy can be loaded from the panel.
            HandPanel(page, hands_back=settings is not None or "policy" in policies.options_of(episode.spec.policy))
            if episode.can_rewind:
                page.add_button(
                    "Back 1 s", lambda episode: episode.rewind(math.ceil(1.0 / episode.timestep)), "backspace"
                )
                steps = page.guard(gui.add_number("Control steps", 25, min=1, max=REWIND_STEPS, step=1))
                page.add_button("Go back", lambda episode: episode.rewind(int(steps.value)), hint="By these steps.")
                page.add_button("Discard", lambda episode: episode.discard(), hint="Starts the episode anew.")
            self._follow = page.guard(gui.add_checkbox("Camera follows", initial_value=False))
            self._picture = CameraPicture(page, episode.physics)

    def _save(self, episode: TeleoperatedEpisode) -> None:
        is_done = episode.save()
        title, color = ("Saved", None) if is_done else ("Saved a failed episode", "red")
        self._page.notify(title, episode.last_saved, color=color)
        self._panel.seed = episode.next_seed
        self._page.commands.put("reset")

    def _carry_out(self, command: Command) -> None:
        if callable(command):
            self._command_episode(command)
            return
        if command == "step":
            self._panel.run.value = False
            self._step()
        elif command == "camera":
            self._page.move_cameras(self.episode.physics, find_camera(self.episode.physics, self._panel.camera))
        elif command == "picture":
            self._is_stale = True
        elif command == "release":
            # The browser is gone that has controlled until now: time stands still.
            self._stage.release()
            if self._person and self._person.policy.is_persons:
                self._person.policy.take_over()
                self._person.keep()
        elif command in ("load", "reset"):
            self._try(self._load if command == "load" else self._reset)
        self._due = time.monotonic()

    def _command_episode(self, command: Callable[[Any], None]) -> None:
        if person := self._person:
            was_waiting = person.is_waiting
            self._try(lambda: command(person), is_due=False)
            if was_waiting and not person.is_waiting:
                # The first control step is made at once, and shown with what the command has changed.
                self._due = time.monotonic()
            elif self._is_stale:
                self._show()

    def _step(self) -> None:
        if not self.episode.has_ended:
            now = time.monotonic()
            if is_due := now - self._shown >= _SHOW_EVERY:
                self._shown = now
            self._try(self.episode.step, is_due=is_due)
        elif self._panel.continues and not self._person:
            self._panel.seed = self.episode.seed + 1
            self._try(self._reset)

    def _load(self) -> None:
        assert self._tasks
        self._panel.report.content = "Loading."
        episode = live_episode(dataclasses.replace(self._tasks.settings(), seed=self._panel.seed))
        self.episode.close()
        self.episode = episode
        self._panel.seed = episode.seed
        self._show_stage()
        if self._picture:
            self._picture.offer(episode.physics)

    def _reset(self) -> None:
        if self._person and self._panel.seed == self.episode.seed:
            # Otherwise it would go on from its copy.
            self._person.discard()
        else:
            self.episode.start(self._panel.seed)
        if not self._stage.shows(self.episode.physics):
            self._show_stage()

    def _try(self, action: Callable[[], None], *, is_due: bool = True) -> None:
        """Calls a function, and shows the state after it; or its error, which pauses the episode until a reset.

        `is_due` says whether the state is shown at once; otherwise later.
        """
        try:
            action()
            self._problem = ""
        except _ERRORS as error:
            self._problem = " ".join(str(error).split())
        if is_due or self._problem:
            self._show()
        else:
            self._is_stale = True

    def _show(self) -> None:
        """Shows the present state, with its report in one message: a browser draws a frame for each."""
        self._is_stale = False
        follows = self._follow is not None and bool(self._follow.value)
        with self._page.server.atomic():
            self._stage.update(self.episode.physics, self._person, follows=follows)
            self._panel.report.content = f"**Error:** {self._problem}" if self._problem else self.episode.report()
        self._page.server.flush()
        if self._picture:
            self._picture.update(self.episode.physics)

    @property
    def _person(self) -> TeleoperatedEpisode | None:
        return self.episode if isinstance(self.episode, TeleoperatedEpisode) else None

    def _show_stage(self) -> None:
        physics = self.episode.physics
        self._panel.cameras.options = camera_names(physics)
        self._stage = Stage(self._page, physics, self._panel.camera, self._person)
        self._panel.report.content = self.episode.report()


def live_episode(settings: ViewSettings) -> LiveEpisode:
    """Returns the episode that settings ask for, started: that of a policy, or of a person."""
    if not settings.teleop:
        spec = EpisodeSpec.of(dataclasses.replace(settings, policy=settings.policy or "random"), seeding="gymnasium")
        episode = LiveEpisode(spec.prepared(), render_quality=settings.render_quality)
        find_camera(episode.physics, settings.camera)
        episode.start(settings.seed)
        return episode
    return _persons_episode(settings)


def _persons_episode(settings: ViewSettings) -> TeleoperatedEpisode:
    # Who may take over from another policy.
    policy = f"{TELEOP}(policy={settings.policy!r})" if settings.policy else TELEOP
    steps = settings.max_episode_steps or _PERSONS_STEPS
    source = settings.start_from and RecordingFolder.open(settings.start_from)
    spec = source.spec if source else EpisodeSpec.of(dataclasses.replace(settings, policy=policy), seeding="gymnasium")
    # Episodes have the numbers of their seeds. That recorded ones play again here is checked.
    spec = dataclasses.replace(
        spec, policy=policy, policy_sha256=None, seed=0, versions=installed_versions(), max_episode_steps=steps
    )
    if settings.policy:
        spec = spec.prepared()
    recorded = source and source.load(settings.start_episode)
    # Last, so that bad settings leave no folder.
    episode = TeleoperatedEpisode(spec, render_quality=settings.render_quality)
    find_camera(episode.physics, settings.camera)
    if settings.output:
        episode.keep_in(settings.output)
    if recorded:
        episode.start_from(recorded, settings.start_step)
    else:
        episode.seed = settings.seed
        episode.start(episode.next_seed)
    return episode


class ViewJob:
    """Shows episodes in a browser until it is interrupted."""

    errors: ClassVar = {OSError: FAILURE}

    def __init__(self, settings: ViewSettings) -> None:
        """Builds the first environment, so that bad settings are refused."""
        task_name = settings.task_name or suite.default_task(settings.domain_name)
        settings = dataclasses.replace(settings, task_name=task_name)
        if settings.policy is not None and policies.player_of(settings.policy):
            options = policies.options_of(settings.policy)
            if others := sorted(options.keys() - {"policy"}):
                raise ValueError(f"options {others} of policy 'teleop' are for other commands")
            settings = dataclasses.replace(settings, teleop=True, policy=options.get("policy"))
        if settings.start_from is None and (settings.start_episode or settings.start_step is not None):
            raise ValueError("--start_episode and --start_step need --start_from, the folder of the episode")
        for name in ("output", "start_from"):
            if getattr(settings, name) is not None and not settings.teleop:
                raise ValueError(f"--{name} is a folder of episodes that a person plays: it needs --teleop")
        self._settings, self._episode = settings, live_episode(settings)

    def progress(self) -> str:
        return "while showing episodes"

    def run(self) -> bool:
        """Serves the page and plays episodes; does not return."""
        settings = self._settings
        with local_server(settings.port, "kitchen-view") as server:
            page = Page(server, exclusive=settings.teleop)
            viewer = Viewer(page, self._episode, settings=settings, camera=settings.camera)
            print_line(f"{_address(settings.port)}  (Ctrl-C ends)")
            while True:
                viewer.update()


class PlayedPolicy:
    """Acts as a person has played an episode, with the labels; the episode has to be stepped in the same way."""

    def __init__(self, episode: EpisodeArrays) -> None:
        self._actions, self._step = episode.arrays["action"], 0
        self._labels = {name.removeprefix("label/"): rows for name, rows in episode.labels.items()}
        self.labels: Mapping[str, NDArray] = {}

    def __call__(self, timestep: dm_env.TimeStep) -> NDArray[np.float32]:
        step = self._step
        if step == len(self._actions):
            raise policies.PolicyError(f"the person has played {step} control steps, and the episode has not ended")
        self.labels = {name: rows[step] for name, rows in self._labels.items()}
        self._step += 1
        return self._actions[step]


class Player:
    """Lets a person play each episode in a browser, before it is stepped; a `episodes.spec.EpisodePolicies`.

    The same episode is played once in a process.
    """

    # Episodes that have been played, by specification, seed and options.
    _played: dict[str, EpisodeArrays] = {}  # noqa: RUF012

    def __init__(self, spec: EpisodeSpec) -> None:
        """Prepares to let a person play episodes; raises an ImportError without the extra `web`."""
        check_extra(f"policy {checks.shown(spec.policy)}")
        self._spec, self._options = spec, policies.options_of(spec.policy)

    def __call__(self, environment: dm_env.Environment, seed: int, options: Mapping[str, Any] | None) -> PlayedPolicy:
        key = json.dumps([self._spec.as_json(), seed, dict(options or {})], default=np.ndarray.tolist)
        if key not in self._played:
            self._played[key] = self._play(seed, options)
        return PlayedPolicy(self._played[key])

    def _play(self, seed: int, options: Mapping[str, Any] | None) -> EpisodeArrays:
        page = _open_page(self._options.get("port", 8080))
        episode = TeleoperatedEpisode(self._spec, unsaved=kept_by_user(self._spec, seed, options))
        with contextlib.closing(episode):
            episode.start(seed, options)
            viewer = Viewer(page, episode)
            while not episode.is_finished:
                viewer.update()
            episode.forget()
            return episode.episode()


@functools.cache
def _open_page(port: int) -> Page:
    """Returns the page in which a person plays, which stays open as long as the process."""
    stack = contextlib.ExitStack()
    atexit.register(stack.close)
    page = Page(stack.enter_context(local_server(port, "kitchen-suite")), exclusive=True)
    # Standard output is the command's.
    print(f"play the episodes at {_address(port)}", file=sys.stderr, flush=True)
    return page


def _address(port: int) -> str:
    return f"http://{HOST}:{port}"
