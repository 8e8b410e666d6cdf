"""Checks the rows of the board, replays their receipts, and writes the page docs/results/board.md.

python docs/board/make.py               replays the receipts that `replayed.json` does not name
python docs/board/make.py --all         replays all
python docs/board/make.py --known=FILE  replays those that another table, such as the main branch's, does not name

A row that does not hold is refused in one line, with exit status 1, and nothing is written.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import page
import rows

from kitchen_suite import files

BOARD = Path(__file__).resolve().parent
PAGE = BOARD.parent / "results" / "board.md"

REPLAYED = "replayed.json"
"""The table of receipts whose replay was equal: by SHA-256 of the file, the path in the folder of the board."""


def make(folder: Path, known: dict[str, str], *, replay_all: bool = False) -> tuple[str, dict[str, str]]:
    """Returns the page of the rows in a folder, and the table of their receipts, which have all been replayed.

    Args:
      folder: of the rows.
      known: table of the receipts that need no replay.
      replay_all: whether these are replayed as well.

    Raises:
      RefusedError: a row does not hold.
    """
    found = rows.read_rows(folder, known)
    receipts = [receipt for row in found for receipt in row.receipts.values()]
    for receipt in receipts:
        if replay_all or receipt.sha256 not in known:
            print(f"replaying {receipt.name}", flush=True)
            rows.replay(receipt, known)
    return page.page(found), {receipt.sha256: receipt.name for receipt in receipts}


def main(arguments: Sequence[str] | None = None, folder: Path = BOARD, target: Path = PAGE) -> int:
    """Makes the page of the rows in a folder; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--all", action="store_true", help="replay all receipts")
    parser.add_argument("--known", type=Path, default=folder / REPLAYED, help="table of receipts without a replay")
    given = parser.parse_args(arguments)
    known = json.loads(given.known.read_text(encoding="utf-8")) if given.known.exists() else {}
    try:
        text, replayed = make(folder, known, replay_all=given.all)
    except rows.RefusedError as error:
        print(f"refused: {error}", file=sys.stderr)
        return 1
    target.write_text(text, encoding="utf-8")
    files.write_json(folder / REPLAYED, dict(sorted(replayed.items(), key=lambda item: item[1])), indent=1)
    return 0


if __name__ == "__main__":
    sys.exit(main())
