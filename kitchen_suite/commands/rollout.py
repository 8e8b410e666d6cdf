"""The command `kitchen-rollout`."""

import contextlib
import textwrap
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from absl.flags import DEFINE_boolean, FlagValues

from kitchen_suite.commands import flags, watching
from kitchen_suite.commands.command import Command

if TYPE_CHECKING:
    from pathlib import Path

    from kitchen_suite.episodes.cluster import Cluster
    from kitchen_suite.episodes.episode import Episode
    from kitchen_suite.episodes.recording import Recording
    from kitchen_suite.episodes.spec import EpisodeSpec
    from kitchen_suite.policies import PolicyRef

DESCRIPTION = """Plays episodes of a task with a policy, and reports the results. Needs no display.

  kitchen-rollout                                          three episodes of random actions in the kitchen
  kitchen-rollout --list                                   domains, tasks and cameras
  kitchen-rollout --task_name=kettle --output=episodes     also writes each episode to a file
  kitchen-rollout --num_episodes=1 --video=kitchen.mp4     also films it
  kitchen-rollout --policy=expert --web=kitchen.html       completes the task, and writes a page that shows it in 3-D
  kitchen-rollout --policy=my_module:act                   acts as your own function of a dm_env.TimeStep does
  kitchen-rollout --policy=gym:my_module:act --obs_type=state    a function of Gymnasium's observation
  kitchen-rollout --workers=4 --num_episodes=100           plays on Ray, in four processes

Your own policy is a callable that takes a dm_env.TimeStep, or with gym: the observation of the Gymnasium environment,
and returns the action. Files are written atomically. Ctrl-C keeps the finished episodes and the video until then. Exit
status: 0; 1 if writing, the physics or the workers failed; 2 for a bad argument or policy, with one line on stderr; 130
if interrupted.
"""

# Shows a policy that succeeds, to those who have seen the random one.
_NEXT_COMMAND = "kitchen-rollout --domain_name=open_cabinet --policy=trained"


def define(values: FlagValues) -> None:
    """Defines the flags."""
    DEFINE_boolean("list", False, "List all domains with their tasks and cameras, and exit.", values)
    flags.num_episodes(values, 3)
    flags.output(values)
    colours = "Colour objects in the video while they count as a success."
    DEFINE_boolean("visualize_reward", False, colours, values)
    flags.policy(values)
    flags.seed(values)
    flags.max_episode_steps(values)
    flags.cluster(values)
    flags.task(values)
    flags.video(values)
    flags.page(values)


def run(given: FlagValues) -> None:
    """Plays the episodes; prints a table row by row, and a summary."""
    from kitchen_suite.episodes.spec import EnvironmentSpec
    from kitchen_suite.policies import PolicyRef

    if given.list:
        _print_domains()
        return
    kwargs = flags.environment_kwargs(given)
    spec = EnvironmentSpec.make(given.domain_name, given.task_name, kwargs, given.max_episode_steps)
    policy = PolicyRef.parse(given.policy)
    episodes = spec.episodes(policy, seed=given.seed, seeding="dm_control").with_observables(policy)
    cluster = flags.make_cluster(given)
    if cluster:
        _play_on_cluster(given, episodes, policy, cluster)
    else:
        play_and_print(given, episodes, policy, output=given.output, visualize_reward=given.visualize_reward)
    if not any(given[name].present for name in given):
        print(f"\nTry next: {_NEXT_COMMAND}")


def play_and_print(
    given: FlagValues,
    spec: "EpisodeSpec",
    policy: "PolicyRef",
    *,
    output: "Path | None" = None,
    visualize_reward: bool = False,
) -> None:
    """Plays episodes in this process, films them where that is wanted, and prints their table."""
    from kitchen_suite.episodes.episode import check_file_size
    from kitchen_suite.episodes.play import SingleRollout
    from kitchen_suite.gymnasium_env.base import suite_env

    flags.prepare_images(spec, rendering=given.video is not None)
    rollout = SingleRollout(spec, policy.sequential_builder(spec.policy_sha256), **watching.rendering(given))
    environment = suite_env(rollout.environment).environment
    environment.task.visualize_reward = visualize_reward
    count, steps = given.num_episodes, spec.max_episode_steps
    with contextlib.closing(rollout.environment):
        if output:
            check_file_size(rollout.environment.observation_space, steps)
        spec.check_policy(policy, rollout.environment)
        watching.check(given, environment)
        recording = _begin(spec, output)
        with watching.watching(given, environment, num_episodes=count, max_steps=steps) as watch:
            episodes = (rollout.play(index, spec.seed_of(index), watch) for index in range(count))
            _print(spec, episodes, count, recording)


def _play_on_cluster(given: FlagValues, spec: "EpisodeSpec", policy: "PolicyRef", cluster: "Cluster") -> None:
    """Plays episodes on Ray, and prints their table in the order in which they end."""
    from kitchen_suite.episodes.episode import check_file_size
    from kitchen_suite.episodes.play import play_singly

    if given.video or given.web:
        raise ValueError("workers make no video and no web page: leave out the workers")
    flags.prepare_images(spec)
    with contextlib.closing(spec.make_environment()) as environment:
        if given.output:
            check_file_size(environment.observation_space, spec.max_episode_steps)
        spec.check_policy(policy, environment)
    numbers = [(index, spec.seed_of(index)) for index in range(given.num_episodes)]
    with contextlib.closing(cluster.run(play_singly, (spec, policy), numbers, num_threads=1)) as episodes:
        _print(spec, episodes, given.num_episodes, _begin(spec, given.output))


def _begin(spec: "EpisodeSpec", output: "Path | None") -> "Recording | None":
    """Makes the folder of the episodes where there is one, and prints the heading."""
    from kitchen_suite.episodes.recording import Recording
    from kitchen_suite.episodes.report import print_line

    recording = Recording.create(output, spec) if output else None
    print_line(f"{spec.domain_name} {spec.task_name}, policy {spec.policy}, {spec.circumstances}\n")
    return recording


def _print(spec: "EpisodeSpec", episodes: "Iterable[Episode]", count: int, recording: "Recording | None") -> None:
    """Prints a row of each of `count` episodes, and a summary, also of those that were finished before an error."""
    from kitchen_suite.episodes.report import Report, print_line

    report = Report(last_seed=spec.seed + count - 1)
    try:
        with recording.withdrawn_without_episodes() if recording else contextlib.nullcontext():
            for episode in episodes:
                if recording:
                    recording.append(episode)
                print_line(report.add(episode.summary, episode.index))
    finally:
        if report.count:
            print_line(f"\n{report.summary()}")


def _print_domains() -> None:
    """Prints the tasks and cameras of each domain."""
    from kitchen_suite import suite
    from kitchen_suite.rendering.cameras import camera_names

    for domain, tasks in suite.TASKS_BY_DOMAIN.items():
        with contextlib.closing(suite.load(domain, tasks[0], task_kwargs={"visuals": False})) as environment:
            names = camera_names(environment.physics)
        print("\n".join((domain, _listing("tasks", tasks), _listing("cameras", names))), flush=True)


def _listing(title: str, names: Sequence[str]) -> str:
    return textwrap.fill(", ".join(names), 100, initial_indent=f"  {title:<9}", subsequent_indent=" " * 11)


COMMAND = Command(name="kitchen-rollout", description=DESCRIPTION, define=define, run=run)
main = COMMAND.main
