"""Certifies generated kitchens: builds each, measures it, and has the expert play every task in it.

python docs/experiments/certify.py                                             the first ten of the split train
python docs/experiments/certify.py --split=test --designs=0:1000               others; continues after an interrupt
python docs/experiments/certify.py --designs=0:200 --output=mine.jsonl         to another file
python docs/experiments/certify.py --designs=0:20 --output=mine.jsonl --check  certifies again, and compares

It plays in several processes, appends a line of JSON for each kitchen, by default to the user's cache folder, and
prints which tasks the expert has completed. It needs the extra `experts`.
"""

import argparse
import collections
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from experiment import make_parser
from tabulate import tabulate

from kitchen_suite.entities.kitchen_designs import SPLITS
from kitchen_suite.evaluation.certification import check_certificates, write_certificates
from kitchen_suite.tasks.generated_kitchens.certificates import Certificate, default_path
from kitchen_suite.tasks.variations.layouts import CLEARANCE_TOLERANCE
from kitchen_suite.vector_env.base import processors


def numbers(text: str) -> range:
    """Returns the numbers of kitchens that an argument such as 0:1000 names, without the last one."""
    first, _, last = text.partition(":")
    if not (first.isdecimal() and last.isdecimal() and int(first) < int(last)):
        raise argparse.ArgumentTypeError(f"designs must be two numbers such as 0:1000, got {text!r}")
    return range(int(first), int(last))


def report(found: Iterable[Certificate]) -> str:
    """Returns a table of tasks and how many of them the expert completed, and a line on the kitchens."""
    found = [*found]
    rows = collections.defaultdict(list)
    for certificate in found:
        for name, steps in certificate.steps.items():
            verb, _, part = name.partition(" ")
            kind = part.rpartition("/")[0].rpartition("_")[0] or part
            rows[f"{verb} {kind}"].append(steps is not None)
    everything = [done for each in rows.values() for done in each]
    cells = [[name, len(each), f"{np.mean(each):.0%}"] for name, each in sorted(rows.items())]
    cells.append(["all", len(everything), f"{np.mean(everything):.1%}"])
    reached = [each for certificate in found for each in certificate.reached.values()]
    line = f"{len(found)} kitchens; handles in reach: {np.mean(reached):.1%}; "
    line += f"greatest depth: {max(certificate.depth_mm for certificate in found):.1f} mm"
    return f"{tabulate(cells, ['task', 'pairs', 'certified'])}\n\n{line}"


def main() -> int:
    """Runs the command; returns the exit status, 1 if fixtures are in each other or a certificate does not hold."""
    parser = make_parser(__doc__)
    parser.add_argument("--split", choices=SPLITS, default="train")
    parser.add_argument("--designs", type=numbers, default=range(10), help="numbers of the kitchens, such as 0:1000")
    parser.add_argument("--output", type=Path, help="file of certificates, instead of one in the cache folder")
    parser.add_argument("--check", action="store_true", help="certify again, and compare with the file")
    parser.add_argument("--num_workers", type=int, default=processors(), help="processes that certify")
    options = parser.parse_args()
    path = options.output or default_path(options.split)
    if path is None:
        parser.error("there is no cache folder: name a file with --output")
    given = path, options.designs, options.split
    if options.check:
        wrong = check_certificates(*given, num_workers=options.num_workers)
        print(f"{len(options.designs) - len(wrong)} of {len(options.designs)} certificates hold")
        for number in wrong:
            print(f"kitchen {options.split}/{number} has another certificate now, or none in the file")
        return int(bool(wrong))
    found = write_certificates(*given, num_workers=options.num_workers).values()
    print(report(found))
    return int(any(certificate.depth_mm > 1e3 * CLEARANCE_TOLERANCE for certificate in found))


if __name__ == "__main__":
    sys.exit(main())
