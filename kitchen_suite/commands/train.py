"""The command `kitchen-train`."""

from pathlib import Path
from typing import Any

from absl.flags import DEFINE_boolean, DEFINE_enum, DEFINE_integer, DEFINE_list, FlagValues

from kitchen_suite import checks, installation, suite
from kitchen_suite.commands import flags
from kitchen_suite.commands.command import Command
from kitchen_suite.training.recipes import (
    ALGORITHMS,
    BC,
    EVAL_EPISODES,
    MIN_PROGRESS,
    PPO,
    SCHEDULES,
    find_schedule,
)

DESCRIPTION = """Trains a policy by PPO on many environments at once, or by behaviour cloning. Needs the extra `train`.

  kitchen-train --output=runs/light --task_name=light_switch                      a task of the kitchen
  kitchen-train --output=runs/drawer --domain_name=open_cabinet                   the top drawer
  kitchen-train --output=runs/drawer --domain_name=open_cabinet --resume          continues that run
  kitchen-train --output=runs/kettle --task_name=kettle --demonstrations=kettle   clones a recording first
  kitchen-train --output=runs/more --task_name=kettle --initial_policy=runs/kettle/policy.npz
  kitchen-train --output=runs/bc --algorithm=bc --demonstrations=kettle --task_name=kettle
  tensorboard --logdir=runs                                                       shows the curves

The folder gets a folder for each seed: curves for TensorBoard, the last checkpoints, and `policy.npz`, the best policy
of all evaluations on held-out seeds; `kitchen-play --policy_file=...` plays it. A seed without progress is given up for
the next one. With --video, an episode of the best policy is filmed at the end. Steps are control steps over all
environments, and steps of the optimiser in behaviour cloning. Exit status: 0; 1 if writing or the physics failed,
learning diverged, or no checkpoint can be read; 2 for a bad argument, with one line on stderr; 130 if interrupted:
the same command with --resume continues.
"""


def define(values: FlagValues) -> None:
    """Defines the flags."""
    flags.output(values, required=True)
    DEFINE_enum("algorithm", PPO, ALGORITHMS, "ppo, or bc: behaviour cloning of --demonstrations.", values)
    trained_in = "Arguments of the environments trained in, not of those evaluated in; they replace the domain's."
    flags.json_object(values, "training_kwargs", trained_in)
    flags.json_object(values, "hyperparameters", "Changes to the domain's hyperparameters.")
    folders = "Folders of kitchen-record, separated by commas; PPO clones them first."
    DEFINE_list("demonstrations", [], folders, values)
    counts = "Episodes to learn from, or a number for each folder; else all."
    DEFINE_list("num_demonstrations", [], counts, values)
    flags.path(values, "initial_policy", "File of a trained policy to start from; else training is from scratch.")
    _schedule_flag(values, "num_steps", "Steps at most: see --target_success")
    _schedule_flag(values, "eval_interval", "Steps between evaluations and checkpoints")
    episodes = f"Episodes of an evaluation, on seeds held out; else {EVAL_EPISODES}."
    DEFINE_integer("eval_episodes", None, episodes, flag_values=values)
    target = "Success rate of two evaluations in a row that ends training, above 1 for never"
    flags.number(values, "target_success", None, f"{target}; else {_by_domain('target_success')}.", minimum=0)
    _schedule_flag(values, "patience", "Steps without --min_progress after which a seed is given up, 0 for never")
    progress = f"Mean opening [m], or tasks completed, that is progress; else {MIN_PROGRESS}."
    flags.number(values, "min_progress", None, progress, minimum=0)
    flags.seed(values)
    restarts = "Number of additional seeds to try where one is given up."
    DEFINE_integer("restarts", 3, restarts, 0, checks.MAX_COUNT, flag_values=values)
    flags.num_threads(values)
    DEFINE_boolean("resume", False, "Continue the run in the folder from its newest checkpoint.", values)
    video = "Video of an episode of the best policy to write, an .mp4 in an existing folder, which may be replaced."
    flags.file(values, "video", video, suffix=".mp4")
    flags.task(values)


def _schedule_flag(values: FlagValues, name: str, help: str) -> None:
    """Defines an integer of the schedule, which checks it."""
    DEFINE_integer(name, None, f"{help}; else {_by_domain(name)}.", flag_values=values)


def _by_domain(name: str) -> str:
    """Returns the values of a schedule's field by domain and algorithm, for the help."""
    recipes = {domain.name: domain.resolve("training") for domain in suite.DOMAINS.values()}
    own = {domain: recipe.schedule[name] for domain, recipe in recipes.items() if recipe and name in recipe.schedule}
    values = {**{f" in {domain}": value for domain, value in own.items()}, " elsewhere": SCHEDULES[PPO][name]}
    of_ppo = ", ".join(f"{value:,}{place}" for place, value in values.items())
    return f"{of_ppo}, {SCHEDULES[BC][name]:,} by bc"


def run(given: FlagValues) -> None:
    """Trains the policy, and films it where that is wanted."""
    _refuse_flags_of_others(given)
    chosen = ("num_steps", "eval_interval", "eval_episodes", "target_success", "patience", "min_progress")
    schedule = find_schedule(given.domain_name, given.algorithm, **{name: given[name].value for name in chosen})
    installation.installed(("tensorboard", "torch"), "kitchen-train", "train")

    from kitchen_suite.episodes import video
    from kitchen_suite.episodes.report import Report, print_line
    from kitchen_suite.episodes.spec import EnvironmentSpec
    from kitchen_suite.policies import PolicyRef
    from kitchen_suite.training import bc, ppo
    from kitchen_suite.training.run import EVALUATION_SEEDS

    spec = EnvironmentSpec.make(given.domain_name, given.task_name, flags.environment_kwargs(given))
    flags.prepare_images(spec, rendering=given.video is not None)
    if given.video:
        video.check_ffmpeg()
    demonstrations = [Path(folder) for folder in given.demonstrations]
    shared: dict[str, Any] = {name: given[name].value for name in ("seed", "restarts", "num_threads", "resume")}
    shared |= {"hyperparameters": given.hyperparameters or {}, "report": print_line}
    if given.algorithm == PPO:
        best = ppo.train(
            given.output,
            spec,
            schedule,
            training_kwargs=given.training_kwargs or {},
            demonstrations=demonstrations,
            initial_policy=given.initial_policy,
            **shared,
        )
    else:
        counts = flags.integers(given.num_demonstrations, "num_demonstrations")
        best = bc.train(given.output, spec, schedule, demonstrations, num_demonstrations=counts, **shared)
    print_line(f"best policy: {best}")
    if given.video:
        policy = PolicyRef.parse(f"trained(file={str(best)!r})")
        episode = spec.episodes(policy, seed=EVALUATION_SEEDS, seeding="dm_control").with_observables(policy)
        summary = video.film(given.video, episode, policy)
        print_line(Report(last_seed=EVALUATION_SEEDS).add(summary))
        print_line(f"video {given.video}")


def _refuse_flags_of_others(given: FlagValues) -> None:
    """Raises a ValueError for flags of another algorithm than the one that is chosen."""
    for algorithm, names in {PPO: ("initial_policy", "training_kwargs"), BC: ("num_demonstrations",)}.items():
        for name in names:
            if algorithm != given.algorithm and given[name].value:
                raise ValueError(f"{name} is for the algorithm {algorithm!r}, not for {given.algorithm!r}")


COMMAND = Command(name="kitchen-train", description=DESCRIPTION, define=define, run=run)
main = COMMAND.main
