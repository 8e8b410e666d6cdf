"""The command `kitchen-evaluate`."""

import contextlib
import textwrap
from typing import TYPE_CHECKING

from absl.flags import DEFINE_boolean, DEFINE_float, DEFINE_string, FlagValues

from kitchen_suite import checks
from kitchen_suite.commands import flags, watching
from kitchen_suite.commands.command import GATE, Command, fail
from kitchen_suite.evaluation.protocols import PROTOCOLS

if TYPE_CHECKING:
    from kitchen_suite.episodes.spec import EnvironmentSpec
    from kitchen_suite.evaluation.plan import EvaluationPlan
    from kitchen_suite.evaluation.scores import EpisodeResult

_DESCRIPTION = """Evaluates a policy under a published protocol, with confidence intervals. Needs no display.

  kitchen-evaluate --policy=expert                             200 episodes of random 4 of the kitchen's 7 tasks
  kitchen-evaluate --policy=expert --protocol=d4rl --json=expert.json --web=expert.html
  kitchen-evaluate --policy=policy.npz --task_name=all --output=evaluation
  kitchen-evaluate --policy=expert --output=evaluation --resume    continues an evaluation that was interrupted
  kitchen-evaluate --policy=expert --receipt=expert.npz            also writes what kitchen-replay checks
  kitchen-evaluate --policy=expert --episodes --json=expert.json   also prints and writes a row for each episode
  kitchen-evaluate --policy=expert --format=latex                  prints LaTeX tables
  kitchen-evaluate --policy=expert --workers=4                     plays on Ray, in four processes
  kitchen-evaluate --policy=policy.npz --fail_under=0.9            ends with status 4 if less than 90 % succeed

kitchen-compare pairs the episodes of two receipts, or of two JSON files with --episodes.

Flags that are given replace the protocol's values, and the JSON has the final ones. The same evaluation has the same
JSON, to the byte, whatever --num_envs, --num_threads and --workers. A policy module:callable with a memory has a method
reset, or the callable is a factory of policies. Exit status: 0; 1 if writing or the workers failed; 2 for a bad
argument or policy, with one line on stderr; 4 if less succeed than --fail_under; 130 if interrupted. Protocols, whose
sources and values are in docs/guide/protocols.md:
"""


def _protocol_lines() -> str:
    names: dict[str | None, list[str]] = {None: []}
    for protocol in PROTOCOLS.values():
        names.setdefault(protocol.domain_name, []).append(protocol.name)
    lines = (f"of {domain or 'all domains'}: {', '.join(each)}" for domain, each in names.items())
    wrapper = textwrap.TextWrapper(100, "  ", subsequent_indent=" " * 6, break_on_hyphens=False)
    return "\n".join(["", *map(wrapper.fill, lines), ""])


def define(values: FlagValues) -> None:
    """Defines the flags."""
    unset = "the protocol's"
    text = "Protocol of the evaluation: it sets task, variations, seeds and number of episodes."
    DEFINE_string("protocol", "default", text, values)
    flags.policy(values)
    flags.seed(values, default=None, unset=unset)
    flags.num_episodes(values, None, unset=unset)
    flags.max_episode_steps(values, unset=unset)
    flags.num_envs(values)
    flags.cluster(values)
    goals = "Folder of a recording, from whose episodes some protocols take their goals."
    flags.path(values, "dataset", goals)
    flags.output(values)
    DEFINE_boolean("resume", False, "Continue the evaluation in the folder.", values)
    flags.file(values, "json", "File to write the results to as JSON; it may be replaced.")
    rows = "Also print a row for each episode, and write it to the JSON, which kitchen-compare can then pair."
    DEFINE_boolean("episodes", False, rows, values)
    flags.table_format(values)
    gate = (
        "End with status 4 if the success rate is below this number, from 0 to 1: that of the first condition, or the "
        "mean over conditions that are a sample."
    )
    DEFINE_float("fail_under", None, gate, flag_values=values)
    receipt = "File to write a receipt to, with which kitchen-replay checks the scores without the policy."
    flags.file(values, "receipt", receipt, suffix=".npz")
    flags.task(values, unset=unset, task_unset=unset)
    flags.page(values)


def run(given: FlagValues) -> int | None:
    """Evaluates the policy; prints the scores, and writes the files that are wanted; returns the status of a gate."""
    from kitchen_suite.episodes.report import paragraph, print_line
    from kitchen_suite.episodes.spec import EnvironmentSpec
    from kitchen_suite.evaluation import text
    from kitchen_suite.evaluation.evaluate import check_destinations, evaluate
    from kitchen_suite.evaluation.rollout import watch_episodes
    from kitchen_suite.policies import PolicyRef

    if given.fail_under is not None:
        checks.number(given.fail_under, "fail_under", maximum=1.0)
    wanted = {"json": given.json, "receipt": given.receipt, "web": given.web}
    check_destinations(PolicyRef.parse(given.policy), given.dataset, given.output, wanted)
    kwargs = flags.environment_kwargs(given)
    # Without what the protocol sets, which changes neither images nor cameras.
    shown = EnvironmentSpec.make(given.domain_name, given.task_name, kwargs)
    flags.prepare_images(shown)
    if given.web:
        _check_page(given, shown)
    with _Scores(given) as scores:
        evaluation = evaluate(
            given.policy,
            protocol=given.protocol,
            domain_name=given.domain_name,
            task_name=given.task_name,
            task_kwargs=kwargs,
            seed=given.seed,
            num_episodes=given.num_episodes,
            max_episode_steps=given.max_episode_steps,
            dataset=given.dataset,
            num_envs=given.num_envs,
            num_threads=given.num_threads,
            cluster=flags.make_cluster(given),
            output=given.output,
            resume=given.resume,
            receipt=given.receipt,
            announce=scores.begin,
            progress=scores.add,
        )
    if totals := text.format_totals(evaluation, given.format):
        print_line(f"\n{totals}")
    if latency := text.format_latency(evaluation):
        print_line(f"\n{paragraph(latency, given.format)}")
    if given.episodes:
        print_line(f"\n{text.format_episodes(evaluation.results, given.format)}")
    if given.json:
        evaluation.write_json(given.json, episodes=given.episodes)
    if given.web:
        with watching.page(given, None) as watch:
            watch_episodes(evaluation.plan, evaluation.results, evaluation.traces, given.web_episodes, watch)
    success = evaluation.scores["success"]
    if given.fail_under is not None and success < given.fail_under:
        problem = f"success {100 * success:.1f} % is below --fail_under, {100 * given.fail_under:g} %"
        return fail(COMMAND.name, problem, GATE)
    return None


class _Scores(contextlib.ExitStack):
    """Prints the scores of each condition as soon as its last episode has ended, below a progress bar."""

    def __init__(self, given: FlagValues) -> None:
        super().__init__()
        self._format: str = given.format
        self._policy: str = given.policy

    def begin(self, plan: "EvaluationPlan") -> None:
        """Prints what is evaluated, and shows the progress bar."""
        from kitchen_suite.episodes.report import EpisodeBar, paragraph, print_line
        from kitchen_suite.evaluation import text
        from kitchen_suite.policies import PolicyRef

        self._plan = plan
        starts = text.format_starts(plan, PolicyRef.parse(self._policy))
        parts = [text.format_heading(plan), text.format_changes(plan), starts]
        print_line(paragraph("\n".join(filter(None, parts)), self._format))
        self._bar = self.enter_context(EpisodeBar(plan.num_episodes * len(plan.specs)))
        self._results: dict[str, list[EpisodeResult]] = {name: [] for name in plan.specs}

    def add(self, result: "EpisodeResult") -> None:
        """Counts an episode."""
        from kitchen_suite.episodes.report import print_line
        from kitchen_suite.evaluation import text

        self._bar.count(result.success)
        name = result.condition
        self._results[name].append(result)
        if len(self._results[name]) == self._plan.num_episodes and not self._plan.is_sample:
            in_order = sorted(self._results[name], key=lambda each: each.episode)
            print_line(f"\n{text.format_condition(self._plan, name, in_order, self._format)}")


def _check_page(given: FlagValues, spec: "EnvironmentSpec") -> None:
    """Raises an ImportError or a ValueError if a web page cannot be made, before anything is played."""
    from kitchen_suite.gymnasium_env.base import suite_env
    from kitchen_suite.rendering.cameras import find_camera

    watching.check_page(given)
    with contextlib.closing(spec.make_environment()) as environment:
        find_camera(suite_env(environment).environment.physics, given.camera)


COMMAND = Command(name="kitchen-evaluate", description=f"{_DESCRIPTION}{_protocol_lines()}", define=define, run=run)
main = COMMAND.main
