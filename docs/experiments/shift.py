"""Measures what each group of variations costs a policy, pair by pair, for the page of results.

python docs/experiments/shift.py FOLDER

Evaluates the expert and the shipped policy under the protocol `shift`, and checks the receipts, which FOLDER keeps with
the finished episodes: the same command continues after an interrupt. It writes results/shift_costs.json: for each
policy the SHA-256 of its receipt, and for each condition the success less that of the control arm in the same episodes.
It needs the extra `experts`. `docs/scripts/tables.py` makes the table.
"""

import argparse
import hashlib
import json
from pathlib import Path
from typing import Any

from experiment import RESULTS

import kitchen_suite
from kitchen_suite.evaluation.folder import DESCRIPTION_FILE

POLICIES = ("expert", "trained")
COSTS = RESULTS / "shift_costs.json"


def main() -> None:
    """Evaluates, checks, and writes the differences."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    found = {policy: costs(policy, folder) for policy in POLICIES}
    COSTS.write_text(f"{json.dumps(found, indent=1)}\n", encoding="utf-8")


def costs(policy: str, folder: Path) -> dict[str, Any]:
    """Returns what each condition costs a policy, of a receipt whose check has found all numbers equal."""
    output = folder / f"{policy}_shift"
    receipt = folder / f"{policy}_shift.npz"
    has_begun = (output / DESCRIPTION_FILE).exists()
    evaluation = kitchen_suite.evaluate(policy, protocol="shift", output=output, resume=has_begun, receipt=receipt)
    check = kitchen_suite.Evaluation.read(receipt).check()
    if check.verdict != "equal":
        raise SystemExit(f"the check of {receipt} says {check.verdict!r}")
    print(f"{policy}: {len(check.episodes)} episodes are equal to the bit")
    success = {name: scores["success"].as_json() for name, scores in evaluation.shifts.items()}
    return {"receipt_sha256": hashlib.sha256(receipt.read_bytes()).hexdigest(), "success": success}


if __name__ == "__main__":
    main()
