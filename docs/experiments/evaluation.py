"""Evaluates policies under every protocol, in the kitchen or in generated ones, for the page of results.

python docs/experiments/evaluation.py FOLDER                                    all that have no result yet
python docs/experiments/evaluation.py FOLDER expert:default random:d4rl         some of them
python docs/experiments/evaluation.py FOLDER trained:all:default               all seven tasks instead

Each evaluation is one `kitchen-evaluate`, whose JSON is written to results/evaluation/POLICY_PROTOCOL.json, or
POLICY_TASK_PROTOCOL.json, and whose receipt to results/receipts/ if it is small. Those that have the JSON are skipped.
FOLDER keeps the finished episodes and all receipts: the same command continues after an interrupt. It needs the extra
`experts`. `docs/scripts/tables.py` makes the tables.
"""

import shutil
from collections.abc import Sequence
from pathlib import Path

from experiment import RESULTS, make_parser, run_command

from kitchen_suite.evaluation.folder import DESCRIPTION_FILE
from kitchen_suite.evaluation.protocols import PROTOCOLS

SCORES = RESULTS / "evaluation"
RECEIPTS = RESULTS / "receipts"

# Values of --policy.
POLICIES = ("random", "expert", "trained")

# Policy, sometimes a task instead of the protocol's, and protocol.
Case = tuple[str, ...]

# Protocols that a policy does not apply to: its goals are not those of the expert's tasks, and no policy of the package
# was trained for them.
NOT_FOR = {"random": (), "expert": ("goal-reaching",), "trained": ("goal-reaching",)}

# Protocols whose results are on the board, with their receipts: docs/board/make.py.
ON_BOARD = ("clean", "unseen-kitchens", "unseen-pick-and-place")

# Demonstrations that goals are taken from: random 4 of the 7 tasks.
DEMONSTRATIONS = 100

CASES: tuple[Case, ...] = tuple(
    case
    for policy in POLICIES
    for case in (*((policy, each) for each in PROTOCOLS), (policy, "all", "default"))
    if case[-1] not in (*NOT_FOR[policy], *ON_BOARD)
)

# Greatest receipt that is kept in the repository [bytes].
MAX_RECEIPT = 256 * 2**10


def result_file(case: Case) -> Path:
    """Returns the path of the JSON of an evaluation."""
    return SCORES / f"{'_'.join(case)}.json"


def receipt_file(case: Case, folder: Path) -> Path:
    """Returns the path of the receipt of an evaluation in a folder."""
    return folder / f"{'_'.join(case)}.npz"


def flags(case: Case, folder: Path) -> list[str]:
    """Returns the flags of an evaluation: of a new one, or an interrupted one that is continued."""
    policy, *task, protocol = case
    output = folder / "_".join(case)
    resume = ["--resume"] if (output / DESCRIPTION_FILE).exists() else []
    return [
        f"--policy={policy}",
        f"--protocol={protocol}",
        f"--domain_name={PROTOCOLS[protocol].domain_name or 'kitchen'}",
        *(f"--task_name={each}" for each in task),
        *([f"--dataset={demonstrations(folder)}"] if takes_goals(case) else []),
        f"--output={output}",
        f"--json={result_file(case)}",
        f"--receipt={receipt_file(case, folder)}",
        *resume,
    ]


def takes_goals(case: Case) -> bool:
    """Whether the protocol of an evaluation takes goals from demonstrations."""
    return any(condition.goals for condition in PROTOCOLS[case[-1]].conditions)


def demonstrations(folder: Path) -> Path:
    """Returns the recording that goals are taken from."""
    return folder / "demonstrations"


def record(folder: Path) -> None:
    """Records the demonstrations, or what is missing of them."""
    given = ("--policy=expert(action_noise=0.1)", "--task_name=random_4", f"--num_episodes={DEMONSTRATIONS}")
    run_command("record", f"--output={demonstrations(folder)}", *given)


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the command."""
    cases = {":".join(case): case for case in CASES}
    parser = make_parser(__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("cases", nargs="*", metavar="case", help=f"one of {', '.join(cases)}")
    given = parser.parse_args(arguments)
    if unknown := [name for name in given.cases if name not in cases]:
        parser.error(f"{unknown[0]!r} is none of {', '.join(cases)}")
    for path in (SCORES, RECEIPTS, given.folder):
        path.mkdir(parents=True, exist_ok=True)
    for case in (cases[name] for name in given.cases or cases):
        if not result_file(case).exists():
            if takes_goals(case):
                record(given.folder)
            run_command("evaluate", *flags(case, given.folder))
            receipt = receipt_file(case, given.folder)
            if receipt.stat().st_size <= MAX_RECEIPT:
                shutil.copy(receipt, RECEIPTS)


if __name__ == "__main__":
    main()
