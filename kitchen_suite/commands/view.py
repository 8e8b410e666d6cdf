"""The command `kitchen-view`."""

import contextlib
from typing import TYPE_CHECKING

from absl.flags import DEFINE_boolean, DEFINE_integer, DEFINE_string, FlagValues

from kitchen_suite import checks, installation, suite
from kitchen_suite.commands import flags
from kitchen_suite.commands.command import Command

if TYPE_CHECKING:
    from kitchen_suite.viewer.live_episode import Choice

DESCRIPTION = """Shows episodes live in a browser on this machine. Needs no display, and no GL library.

  kitchen-view                                             the kitchen with random actions, at port 8080
  kitchen-view --policy=expert --task_name=kettle          the scripted expert moves the kettle
  kitchen-view --domain_name=open_cabinet --policy=trained
  kitchen-view --variations=layout,appearance --port=9000  every episode in another kitchen, at another port
  kitchen-view --teleop --task_name=kettle --output=mine   you move the hand, and save episodes as kitchen-record does

Open the address that is printed: it has a token, without which other users of this machine are refused (--no_token
lets them in). In the page, choose domain, task, policy, variations and seed; reset, pause, step and set the speed.
Other machines are refused; from one, use ssh -L 8080:localhost:8080 HOST. Exit status: 1 if the port is in use; 2 for a
bad argument, with one line on stderr; 130 after Ctrl-C, which ends the viewer.
"""


def define(values: FlagValues) -> None:
    """Defines the flags."""
    DEFINE_string("camera", "overview", "Camera of the page at first, by name or number.", values)
    flags.render_quality(values)
    port = "Port of the page, on this machine alone."
    DEFINE_integer("port", 8080, port, 1024, 65535, flag_values=values)
    no_token = "Let every user of this machine see and use the page, at an address without a token."
    DEFINE_boolean("no_token", False, no_token, values)
    teleop = "Move the hand in the page; with a policy, after this policy until it is handed back."
    DEFINE_boolean("teleop", False, teleop, values)
    flags.output(values)
    flags.path(values, "start_from", "Recording with an episode to go on from, of any policy.")
    DEFINE_integer("start_episode", 0, "Number of that episode.", 0, checks.MAX_COUNT, flag_values=values)
    step = "Control step to go on from; else the last one."
    DEFINE_integer("start_step", None, step, 0, checks.MAX_EPISODE_STEPS, flag_values=values)
    flags.custom(values)
    flags.policy(values, default=None)
    flags.seed(values)
    flags.max_episode_steps(values)
    flags.task(values)


def run(given: FlagValues) -> None:
    """Serves the page and plays episodes until it is interrupted."""
    installation.installed(("viser", "mjviser"), "kitchen-view", "web")
    if given.start_from is None and (given.start_episode or given.start_step is not None):
        raise ValueError("start_episode and start_step need start_from, the folder of the episode")
    for name in ("output", "start_from"):
        if given[name].value is not None and not given.teleop:
            raise ValueError(f"{name} is a folder of episodes that a person plays: it needs teleop")
    choice = _choice(given)
    if given.teleop:
        _teleoperate(given, choice)
    else:
        _show(given, choice)


def _choice(given: FlagValues) -> "Choice":
    from kitchen_suite.viewer.live_episode import Choice

    kwargs = flags.environment_kwargs(given)
    flags.import_custom(given, given.domain_name, kwargs.get("robot"))
    return Choice(
        domain_name=given.domain_name,
        task_name=given.task_name or suite.default_task(given.domain_name),
        variations=kwargs.pop("variations", None),
        variation_split=kwargs.pop("variation_split", None),
        task_kwargs=kwargs,
        policy=given.policy,
        max_episode_steps=given.max_episode_steps,
    )


def _show(given: FlagValues, choice: "Choice") -> None:
    from kitchen_suite.episodes.report import print_line
    from kitchen_suite.rendering.cameras import find_camera
    from kitchen_suite.viewer.live_episode import started_episode
    from kitchen_suite.viewer.servers import new_token
    from kitchen_suite.viewer.viewer import show

    episode = started_episode(choice, given.seed, render_quality=given.render_quality)
    with contextlib.closing(episode):
        flags.prepare_images(episode.spec)
        find_camera(episode.physics, given.camera)
        token = "" if given.no_token else new_token()
        show(
            episode,
            choice,
            camera=given.camera,
            render_quality=given.render_quality,
            port=given.port,
            report=print_line,
            token=token,
        )


def _teleoperate(given: FlagValues, choice: "Choice") -> None:
    from kitchen_suite.episodes.recording import Recording
    from kitchen_suite.episodes.report import print_line
    from kitchen_suite.rendering.cameras import find_camera
    from kitchen_suite.viewer.servers import new_token
    from kitchen_suite.viewer.teleoperation import Collection, persons_episode
    from kitchen_suite.viewer.viewer import teleoperate

    source = Recording.open(given.start_from) if given.start_from else None
    recorded = source.load(given.start_episode) if source else None
    episode = persons_episode(choice, source.spec if source else None, render_quality=given.render_quality)
    with contextlib.closing(episode):
        flags.prepare_images(episode.spec)
        find_camera(episode.physics, given.camera)
        # Last, so that bad arguments leave no folder.
        collection = Collection(given.output, episode.spec) if given.output else None
        if recorded:
            episode.start_from(recorded, given.start_step)
        else:
            episode.start(collection.next_seed(given.seed) if collection else given.seed)
        teleoperate(
            episode,
            choice,
            collection=collection,
            camera=given.camera,
            render_quality=given.render_quality,
            port=given.port,
            report=print_line,
            token="" if given.no_token else new_token(),
        )


COMMAND = Command(name="kitchen-view", description=DESCRIPTION, define=define, run=run)
main = COMMAND.main
