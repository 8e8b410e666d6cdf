"""The command `kitchen-record`."""

from typing import Any

from absl.flags import DEFINE_string, FlagValues

from kitchen_suite import checks, suite
from kitchen_suite.commands import flags
from kitchen_suite.commands.command import Command

DESCRIPTION = """Records episodes of a task, many at once, each from its own seed. Needs no display.

  kitchen-record --output=runs                                a hundred episodes of random actions in the kitchen
  kitchen-record --output=runs --task_name=kettle --seed=7    another task, other seeds
  kitchen-record --output=runs --preset=random_order          demonstrations: four tasks in an order drawn at each reset
  kitchen-record --output=runs --num_episodes=1000            completes the recording that is in the folder
  kitchen-record --output=runs --workers=4                    plays on Ray, in four processes

Episode i of --seed=S has the seed S+i and does not depend on how many are played at once. Its file is written
atomically, so that an interrupt, even by kill -9, loses only the episodes in progress, with --workers the parts in
progress; the same command completes the recording. A policy module:callable with a memory has a method reset, or the
callable is a factory of policies. kitchen-convert makes datasets of a recording. Exit status: 0; 1 if writing, the
physics or the workers failed; 2 for a bad argument or policy, with one line on stderr; 130 if interrupted.
"""

_DEFAULT_EPISODES = 100


def define(values: FlagValues) -> None:
    """Defines the flags."""
    flags.output(values, required=True)
    preset = "Set of demonstrations, of its own task and policy: one of the domain's presets."
    DEFINE_string("preset", None, preset, values)
    flags.num_episodes(values, None, unset=f"the preset's, or {_DEFAULT_EPISODES}")
    flags.policy(values)
    flags.seed(values)
    flags.max_episode_steps(values)
    flags.num_envs(values)
    flags.cluster(values)
    flags.task(values)


def run(given: FlagValues) -> None:
    """Records the episodes; prints a summary, also of those that were finished before an error."""
    from kitchen_suite.episodes.record import claim, complete
    from kitchen_suite.episodes.report import Report, print_line
    from kitchen_suite.episodes.spec import EnvironmentSpec
    from kitchen_suite.policies import PolicyRef

    chosen = with_preset(given)
    count = chosen["num_episodes"]
    arguments = (given.domain_name, chosen["task_name"], chosen["task_kwargs"], chosen["max_episode_steps"])
    spec = EnvironmentSpec.make(*arguments)
    flags.prepare_images(spec)
    cluster = flags.make_cluster(given)
    policy = PolicyRef.of(chosen["policy"])
    recording = claim(given.output, spec, policy, num_episodes=count, seed=given.seed)
    found = count - len(recording.missing(count))
    print_line(
        f"{spec.domain_name} {spec.task_name}, policy {policy.text}, {spec.circumstances}, seeds from {given.seed}"
    )
    print_line(f"{count} episodes in {given.output}, {found} of them there already")
    try:
        complete(
            recording,
            policy,
            count,
            num_envs=given.num_envs,
            num_threads=given.num_threads,
            cluster=cluster,
        )
    finally:
        report = Report(last_seed=given.seed + count - 1)
        for index in recording.present(count):
            report.add(recording.load_summary(index))
        print_line(f"\n{report.summary()}")
    print_line(f"digest of all arrays  {recording.digest(range(count))}")


def with_preset(given: FlagValues) -> dict[str, Any]:
    """Returns task, policy and number of episodes, with those of the preset if there is one.

    A preset only proposes the number of episodes, and leaves free those `task_kwargs` that it does not have. Raises a
    ValueError where a flag gives another value to what the preset fixes.
    """
    names = ("task_name", "policy", "max_episode_steps")
    chosen: dict[str, Any] = {name: given[name].value for name in names}
    kwargs = flags.environment_kwargs(given)
    count = given.num_episodes
    if given.preset is not None:
        presets = suite.find_domain(given.domain_name).resolve("recording") or {}
        fixed = dict(presets[checks.choice(given.preset, presets, "preset")])
        proposed = fixed.pop("num_episodes", _DEFAULT_EPISODES)
        count = proposed if count is None else count
        own_kwargs = fixed.pop("task_kwargs", {})
        clashes = [name for name, value in fixed.items() if given[name].present and chosen[name] != value]
        clashes += [
            f"{name} of the task_kwargs" for name, value in own_kwargs.items() if kwargs.get(name, value) != value
        ]
        if clashes:
            text = ", ".join(sorted(clashes))
            raise ValueError(f"preset {given.preset!r} fixes {text}: leave it out, or the preset")
        chosen |= fixed
        kwargs |= own_kwargs
    return {**chosen, "task_kwargs": kwargs, "num_episodes": count or _DEFAULT_EPISODES}


COMMAND = Command(name="kitchen-record", description=DESCRIPTION, define=define, run=run)
main = COMMAND.main
