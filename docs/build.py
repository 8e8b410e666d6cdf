"""Generates the tables and pictures of these pages from the code.

python docs/build.py tables     rewrites the tables between their markers in docs/*.md
python docs/build.py pictures   renders the scenes from every camera, and varied scenes, into docs/pictures/
"""

import re
import sys
from pathlib import Path

from tables import TABLES

DOCS = Path(__file__).parent
_MARKED = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def with_tables(page: str) -> str:
    """Returns a page with its tables regenerated."""
    return _MARKED.sub(lambda match: f"{match[1]}\n{TABLES[match[2]]()}\n{match[3]}", page)


def write_tables() -> None:
    """Rewrites the tables of every page."""
    for path in sorted(DOCS.glob("*.md")):
        path.write_text(with_tables(path.read_text(encoding="utf-8")), encoding="utf-8")


def write_pictures() -> None:
    """Renders the pictures of all domains."""
    import stills
    import variation_sheet

    stills.write_pictures()
    variation_sheet.write_sheets()


if __name__ == "__main__":
    commands = {"tables": write_tables, "pictures": write_pictures}
    if len(sys.argv) != 2 or sys.argv[1] not in commands:
        sys.exit(__doc__)
    commands[sys.argv[1]]()
