"""The live viewer: episodes of policies, and of a person, in a browser; needs the extra `web`."""

import dataclasses
import functools
import itertools
import math
import queue
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from kitchen_suite import checks, policies, suite
from kitchen_suite.environment import Environment
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies import POLICIES
from kitchen_suite.policies.registry import EXPERT_PACKAGES
from kitchen_suite.rendering.cameras import camera_names, find_camera
from kitchen_suite.rendering.viser_servers import HOST, local_server
from kitchen_suite.rendering.web_scenes import WebScene, set_camera
from kitchen_suite.rollouts.episode import EpisodeArrays, EpisodeStats
from kitchen_suite.rollouts.folder import RecordingFolder
from kitchen_suite.rollouts.report import print_line
from kitchen_suite.rollouts.rollout import RewindableRollout, SingleRollout
from kitchen_suite.rollouts.spec import EpisodeSpec
from kitchen_suite.settings import ViewSettings
from kitchen_suite.tasks.variations.distributions import GROUPS, SPLITS

if TYPE_CHECKING:
    from dm_control import mjcf

    from kitchen_suite.policies.experts.teleoperation import Teleoperation

# Lengths and angles of a nudge [m, degrees] by name.
NUDGES = {"2 mm, 1 degree": (0.002, 1.0), "1 cm, 5 degrees": (0.01, 5.0), "3 cm, 15 degrees": (0.03, 15.0)}

# Keys of the nudges, and their directions in the frame of the robot's base: offset, and axis of the turn. The letters
# are robosuite's.
MOVES = {
    "Forward": ("arrowup", (1, 0, 0), (0, 0, 0)),
    "Back": ("arrowdown", (-1, 0, 0), (0, 0, 0)),
    "Left": ("arrowleft", (0, 1, 0), (0, 0, 0)),
    "Right": ("arrowright", (0, -1, 0), (0, 0, 0)),
    "Up": ("pageup", (0, 0, 1), (0, 0, 0)),
    "Down": ("pagedown", (0, 0, -1), (0, 0, 0)),
    "Yaw left": ("O", (0, 0, 0), (0, 0, 1)),
    "Yaw right": ("P", (0, 0, 0), (0, 0, -1)),
    "Pitch up": ("Y", (0, 0, 0), (0, 1, 0)),
    "Pitch down": ("H", (0, 0, 0), (0, -1, 0)),
    "Roll left": ("E", (0, 0, 0), (1, 0, 0)),
    "Roll right": ("R", (0, 0, 0), (-1, 0, 0)),
}
_HELP = (
    "Drag the arrows and rings at the hand, or use keys: arrows, page up and down; O P, Y H, E R to turn; space opens "
    "or closes the fingers; backspace goes back a second; enter saves. Time stands still until you move the hand."
)

# Control steps of an episode that a person plays, by default: a program needs a tenth.
_PERSONS_STEPS = 2_000

# Policy in the recordings of episodes that a person has played.
TELEOP = "teleop"

SPEEDS = ("0.25x", "0.5x", "1x", "2x", "4x", "8x")

# Greatest time between two readings of the panel [s].
_IDLE = 0.05

# Errors of a choice in the panel, of the policy, or of physics that diverges (a RuntimeError); they are shown there.
_ERRORS = (ImportError, OSError, RuntimeError, TypeError, ValueError)


# A command of the panel: `load`, `reset`, `step` or `camera`; or what to do with an episode that a person plays.
Command = str | Callable[["TeleoperatedEpisode"], None]


class ViewerPanel:
    """Widgets of the panel. Their callbacks run in threads of viser's, so they only put commands into the queue.

    Attributes:
      commands: in the order in which they were given.
    """

    def __init__(self, gui: Any, settings: ViewSettings) -> None:
        """Adds the widgets to the panel of a viser server, with the settings as their initial values."""
        self.commands: queue.SimpleQueue[Command] = queue.SimpleQueue()
        self._settings, self._gui = settings, gui
        self._add_episode_widgets()
        if settings.teleop:
            self._add_hand_widgets()
        self._add_task_widgets()

    @property
    def is_paused(self) -> bool:
        """Whether the episode is paused."""
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

    def _add_hand_widgets(self) -> None:
        gui = self._gui
        with gui.add_folder("Hand"):
            gui.add_markdown(_HELP)
            self._size = gui.add_dropdown("Nudge", tuple(NUDGES), initial_value=list(NUDGES)[1])
            for label, (key, offset, turn) in MOVES.items():
                self._add_hotkey(label, key, functools.partial(self._nudge, offset, turn))
            self._add_action("Open or close", "space", TeleoperatedEpisode.turn_gripper)
            self._add_action("Back 1 s", "backspace", lambda episode: episode.rewind(1.0))
            self._add_action("Back 5 s", None, lambda episode: episode.rewind(5.0))
            if self._settings.output is not None:
                self._add_action("Save", "enter", self._save)

    def _add_action(self, label: str, key: str | None, action: Callable[["TeleoperatedEpisode"], None]) -> None:
        """Adds a button, and a key if there is one, that do something with the episode."""
        self._gui.add_button(label).on_click(lambda event: self.commands.put(action))
        if key:
            self._add_hotkey(label, key, lambda: self.commands.put(action))

    def _add_hotkey(self, label: str, key: str, call: Callable[[], None]) -> None:
        self._gui.add_command(label, hotkey=key).on_trigger(lambda event: call())

    def _nudge(self, offset: Sequence[float], turn: Sequence[float]) -> None:
        length, angle = NUDGES[self._size.value]
        moved, turned = length * np.array(offset), math.radians(angle) * np.array(turn)
        self.commands.put(lambda episode: episode.arm.nudge(moved, turned))

    def _save(self, episode: "TeleoperatedEpisode") -> None:
        episode.save()
        self.seed = episode.next_seed
        self.commands.put("reset")

    def _add_task_widgets(self) -> None:
        gui, first = self._gui, self._settings
        tasks = suite.TASKS_BY_DOMAIN
        with gui.add_folder("Task"):
            self._domain = gui.add_dropdown("Domain", tuple(tasks), initial_value=first.domain_name)
            self._task = gui.add_dropdown("Task", tuple(tasks[first.domain_name]), initial_value=first.task_name)
            self._policy = gui.add_dropdown("Policy", (first.policy,), initial_value=first.policy)
            self._offer_policies()
            with gui.add_folder("Variations", expand_by_default=False):
                given = (first.variations or "").split(",")
                self._groups = {name: gui.add_checkbox(name, initial_value=name in given) for name in GROUPS}
                # Those of the flag by parameter apply while no group is chosen.
                self._distributions = first.variations if not {*given} & {*GROUPS} else None
                split = first.variation_split or SPLITS[0]
                self._split = gui.add_dropdown("Split", tuple(SPLITS), initial_value=split)
            self._add_button("Load", "load", "Builds the environment that is chosen here.")
        self._domain.on_update(lambda event: self._offer_tasks())
        self._task.on_update(lambda event: self._offer_policies())

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
        self._offer_policies()

    def _offer_policies(self) -> None:
        """Offers the policies that can act in the chosen task, and the one that was given with it."""
        first, chosen = self._settings, self._policy.value
        task = self._domain.value, self._task.value
        given = (first.policy,) if (first.domain_name, first.task_name) == task else ()
        offered = tuple(dict.fromkeys((*given, *policies_for(*task))))
        self._policy.options = offered
        self._policy.value = chosen if chosen in offered else offered[0]


@functools.cache
def policies_for(domain_name: str, task_name: str) -> tuple[str, ...]:
    """Returns the names of the policies that can act in a task without options, the scripted expert first."""
    environment = suite.load(domain_name, task_name, {"visuals": False})
    return tuple(name for name in sorted(POLICIES, key=lambda name: name != "expert") if _can_act(name, environment))


def _can_act(name: str, environment: Environment) -> bool:
    try:
        policies.find(name)(environment, np.random.default_rng(0))
    except _ERRORS:
        return False
    return True


class LiveEpisode:
    """The episode in progress of a task and a policy, which is played step by step.

    Attributes:
      seed: of the episode.
    """

    def __init__(self, settings: ViewSettings) -> None:
        """Builds environment and policy, and starts the episode of the settings' seed."""
        self._spec = EpisodeSpec.of(settings, seeding="gymnasium")
        self._rollout = self._make_rollout(settings)
        self._max_steps = self._spec.max_episode_steps
        self._environment = suite_env(self._rollout.environment).environment
        find_camera(self.physics, settings.camera)
        self.start(settings.seed)

    def _make_rollout(self, settings: ViewSettings) -> SingleRollout:
        return SingleRollout(self._spec.prepared(), visuals=True, render_quality=settings.render_quality)

    @property
    def physics(self) -> "mjcf.Physics":
        """The physics, another object after a reset that compiles the model again."""
        return self._environment.physics

    @property
    def timestep(self) -> float:
        """Duration of a control step [s]."""
        return self._environment.control_timestep()

    @property
    def has_ended(self) -> bool:
        """Whether the episode has terminated or was truncated."""
        return self._rollout.buffer.has_ended

    @property
    def is_waiting(self) -> bool:
        """Whether time stands still until a person does something."""
        return False

    def start(self, seed: int) -> None:
        """Starts the episode of a seed; raises a PolicyError if the policy cannot be built."""
        self.seed, self._total_reward = seed, 0.0
        self._rollout.start(seed)

    def step(self) -> None:
        """Makes a control step, unless the episode has ended; raises what `SingleRollout.step` does."""
        if not self.has_ended:
            self._rollout.step()
            self._total_reward += self._rollout.buffer.reward

    def report(self) -> str:
        """Returns the progress of the episode as Markdown: the tasks that it asks for, reward and measures."""
        task, buffer = self._environment.task, self._rollout.buffer
        numbers = {
            "time": f"{buffer.steps * self.timestep:.1f} s",
            "control step": f"{buffer.steps} of {self._max_steps}",
            "reward": f"{buffer.reward:.3f}",
            "return": f"{self._total_reward:.3f}",
        }
        for name, value in task.episode_metrics.items():
            if not isinstance(value, dict):
                numbers[name.replace("_", " ")] = ("no", "yes")[value] if isinstance(value, bool) else f"{value:.3f}"
        lines = [f"**{task.instruction}**", ""] if task.instruction else []
        if completions := task.episode_completions:
            steps = completions.steps_by_task
            lines += [self._task_line(name, step) for name, step in steps.items()]
            completed = sum(step is not None for step in steps.values())
            numbers = {"tasks completed": f"{completed} of {len(steps)}", **numbers}
        return "\n".join([*lines, "", "| | |", "| --- | --- |", *(f"| {key} | {it} |" for key, it in numbers.items())])

    def close(self) -> None:
        """Frees the environment."""
        self._rollout.environment.close()

    def _task_line(self, name: str, step: int | None) -> str:
        name = name.replace("_", " ")
        return f"- {name}" if step is None else f"- **{name}**: completed after {step * self.timestep:.1f} s"


class TeleoperatedEpisode(LiveEpisode):
    """An episode that a person plays, which can go back, and be saved.

    Attributes:
      saved: number of episodes that have been saved.
    """

    def __init__(self, settings: ViewSettings) -> None:
        self.saved = 0
        super().__init__(dataclasses.replace(settings, max_episode_steps=settings.max_episode_steps or _PERSONS_STEPS))
        if self.seed in self._present:
            self.start(self.next_seed)

    def _make_rollout(self, settings: ViewSettings) -> SingleRollout:
        # The names of policies are those of programs. Episodes have the numbers of their seeds.
        self._spec = dataclasses.replace(self._spec, policy=TELEOP, seed=0)
        self._folder = None if settings.output is None else RecordingFolder.claim(settings.output, self._spec)
        checks.installed(EXPERT_PACKAGES, "--teleop", "experts")
        from kitchen_suite.policies.experts.teleoperation import make_policy

        return RewindableRollout(self._spec, make_policy, visuals=True, render_quality=settings.render_quality)

    @property
    def is_waiting(self) -> bool:
        return self.has_ended or self.arm.is_idle

    @property
    def arm(self) -> "Teleoperation":
        """The arm, to be commanded."""
        arm: Teleoperation = self._rollout.policy.arm  # type: ignore[attr-defined]
        return arm

    @property
    def next_seed(self) -> int:
        """The first seed from that of this episode on of which no episode has been saved."""
        return next(seed for seed in itertools.count(self.seed) if seed not in self._present)

    @property
    def _present(self) -> list[int]:
        """Seeds of the episodes that have been saved."""
        return self._folder.indices if self._folder else []

    def start(self, seed: int) -> None:
        super().start(seed)
        self._observe()

    def turn_gripper(self) -> None:
        """Closes the fingers if they are open, and opens them otherwise."""
        self.arm.grasp(not self.arm.is_closed)

    def rewind(self, seconds: float) -> None:
        """Goes back, as far as states are kept; the hand stays where it was then."""
        assert isinstance(self._rollout, RewindableRollout)
        self._rollout.rewind(round(seconds / self.timestep))
        self._observe()
        self.arm.hold()

    def save(self) -> None:
        """Saves the episode up to now; raises a ValueError where there is nothing to save, or its seed has been."""
        buffer, task = self._rollout.buffer, self._environment.task
        if self._folder is None or not buffer.steps:
            raise ValueError("there is nothing to save: make a control step first")
        if self.seed in self._present:
            raise ValueError(f"an episode of seed {self.seed} has been saved already: choose another seed, and reset")
        episode = EpisodeArrays(
            index=self.seed,
            seed=self.seed,
            arrays=buffer.arrays(),
            seconds=buffer.steps * self.timestep,
            instruction=task.instruction,
        )
        self._folder.save(episode, EpisodeStats.of(episode, task.metrics(episode.last_info)))
        self.saved += 1

    def report(self) -> str:
        fingers = "closed" if self.arm.is_closed else "open"
        return f"{super().report()}\n| fingers | {fingers} |\n| episodes saved | {self.saved} |"

    def _observe(self) -> None:
        """Shows the person's policy where the hand is."""
        policy, environment = self._rollout.policy, suite_env(self._rollout.environment)
        policy.observe(self._rollout.buffer.timestep(environment))  # type: ignore[attr-defined]


class HandGizmo:
    """Arrows and rings at the commanded pose of the hand, which can be dragged."""

    def __init__(self, server: Any, episode: TeleoperatedEpisode, commands: "queue.SimpleQueue[Command]") -> None:
        """Adds them to the scene."""
        self._handle = server.scene.add_transform_controls("/hand", scale=0.2, depth_test=False, opacity=0.7)
        self._commands, self._is_dragged, self._is_waiting = commands, False, False
        self._handle.on_update(self._move)
        self.update(episode)

    def update(self, episode: TeleoperatedEpisode) -> None:
        """Moves them to the commanded pose, unless they are being dragged."""
        if not self._is_dragged:
            self._handle.position, self._handle.wxyz = episode.arm.command or episode.arm.hand

    async def _move(self, event: Any) -> None:
        # In viser's event loop, which keeps the order of events; its threads do not.
        self._is_dragged = event.phase != "end"
        if not self._is_waiting:
            self._is_waiting = True
            self._commands.put(self._follow)

    def _follow(self, episode: TeleoperatedEpisode) -> None:
        """Commands the present pose, in place of all poses since the last time."""
        self._is_waiting = False
        episode.arm.move_to(self._handle.position, self._handle.wxyz)


class Viewer:
    """Plays an episode in real time, and does what is chosen in the panel.

    Attributes:
      episode: the one that is shown.
    """

    def __init__(self, server: Any, settings: ViewSettings, episode: LiveEpisode) -> None:
        """Shows an episode of the settings in a server of viser."""
        self._server, self.episode = server, episode
        self._panel = ViewerPanel(server.gui, settings)
        self._panel.seed = episode.seed
        self._problem = ""
        self._due = time.monotonic()
        self._scene = self._show_scene()

    def run(self) -> None:
        """Plays episodes until an exception is raised, such as an interrupt."""
        while True:
            self.update()

    def update(self) -> None:
        """Makes the control step that is due, and carries out a command that is given until the next one is."""
        panel, now = self._panel, time.monotonic()
        stands_still = panel.is_paused or bool(self._problem) or self.episode.is_waiting
        if not stands_still and now >= self._due:
            self._step()
            # Where steps take longer than they should, time passes more slowly.
            self._due = max(self._due + self.episode.timestep / panel.speed, now)
        wait = _IDLE if stands_still else min(_IDLE, max(self._due - time.monotonic(), 0.0))
        try:
            command = panel.commands.get(timeout=wait) if wait else panel.commands.get_nowait()
        except queue.Empty:
            return
        self._carry_out(command)

    def _carry_out(self, command: Command) -> None:
        if callable(command):
            self._command_arm(command)
        elif command == "step":
            self._step()
        elif command == "camera":
            self._move_cameras()
        else:
            self._try(self._load if command == "load" else self._reset)
        if not callable(command):
            self._due = time.monotonic()

    def _command_arm(self, command: Callable[["TeleoperatedEpisode"], None]) -> None:
        episode = self.episode
        if isinstance(episode, TeleoperatedEpisode):
            was_waiting = episode.is_waiting
            self._try(lambda: command(episode))
            if was_waiting:
                self._due = time.monotonic()

    def _step(self) -> None:
        if not self.episode.has_ended:
            self._try(self.episode.step)
        elif self._panel.continues:
            self._panel.seed = self.episode.seed + 1
            self._try(self._reset)

    def _load(self) -> None:
        self._panel.show("Loading.")
        episode = live_episode(self._panel.settings())
        self.episode.close()
        self.episode = episode
        self._scene = self._show_scene()

    def _reset(self) -> None:
        self.episode.start(self._panel.seed)
        if not self._scene.shows(self.episode.physics):
            self._scene = self._show_scene()

    def _try(self, action: Any) -> None:
        """Calls a function, and shows the state after it; or its error, which pauses the episode until a reset."""
        try:
            action()
            self._problem = ""
        except _ERRORS as error:
            self._problem = " ".join(str(error).split())
        self._scene.update(self.episode.physics)
        if isinstance(self.episode, TeleoperatedEpisode):
            self._gizmo.update(self.episode)
        self._panel.show(f"**Error:** {self._problem}" if self._problem else self.episode.report())

    def _show_scene(self) -> WebScene:
        """Replaces the scene by that of the episode's model."""
        physics, server = self.episode.physics, self._server
        server.scene.reset()
        server.scene.set_up_direction("+z")
        self._panel.offer_cameras(camera_names(physics))
        scene = WebScene(server, physics, find_camera(physics, self._panel.camera))
        scene.update(physics)
        if isinstance(self.episode, TeleoperatedEpisode):
            self._gizmo = HandGizmo(server, self.episode, self._panel.commands)
        self._panel.show(self.episode.report())
        self._move_cameras()
        return scene

    def _move_cameras(self) -> None:
        """Moves the views of all browsers to the chosen camera."""
        physics, view = self.episode.physics, self._server.initial_camera
        set_camera(self._server, physics, find_camera(physics, self._panel.camera))
        for client in self._server.get_clients().values():
            with client.atomic():
                client.camera.position, client.camera.look_at = view.position, view.look_at
                client.camera.fov = view.fov


def live_episode(settings: ViewSettings) -> LiveEpisode:
    """Returns the episode that settings ask for: of a policy, or of a person."""
    return TeleoperatedEpisode(settings) if settings.teleop else LiveEpisode(settings)


class ViewJob:
    """Shows episodes in a browser until it is interrupted."""

    failures = (OSError,)
    usage_errors = ()

    def __init__(self, settings: ViewSettings) -> None:
        """Builds the first environment, so that bad settings are refused."""
        task_name = settings.task_name or suite.default_task(settings.domain_name)
        self._settings = dataclasses.replace(settings, task_name=task_name)
        if settings.output is not None and not settings.teleop:
            raise ValueError("--output is the folder of the episodes that a person plays: it needs --teleop")
        self._episode = live_episode(self._settings)

    def progress(self) -> str:
        return "while showing episodes"

    def run(self) -> bool:
        """Serves the page and plays episodes; does not return."""
        with local_server(self._settings.port, "kitchen-view") as server:
            viewer = Viewer(server, self._settings, self._episode)
            print_line(f"http://{HOST}:{self._settings.port}  (Ctrl-C ends)")
            viewer.run()
        return True
