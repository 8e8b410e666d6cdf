"""Follows pages of the docs literally: in a new virtual environment for each, with exactly what the page installs.

    python tests/tools/fresh_pages.py docs/guide/recipes/skrl.md docs/guide/recipes/torchrl.md

Blocks with `pip install` are run first, then the others in their order, in one folder, as by a user who follows the
page. Without pages it follows those of `PAGES`. The tests of the blocks (tests/docs/test_blocks.py) run in one
environment with everything, and so do not notice a page whose install line is too short.

Exit status: the number of pages on which a block failed.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import venv
from collections.abc import Iterator, Mapping
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from docs_blocks import PARSED_MARKS, ROOT, UNSET, Block, blocks_of

PAGES = [
    *(f"docs/guide/recipes/{name}.md" for name in ("skrl", "stable_baselines3", "torchrl", "minari")),
    "docs/guide/experts.md",
    "docs/guide/tutorial.md",
    "docs/guide/remote_policies.md",
]
"""Pages with an install line, and blocks that need no more than it installs; others need other machines or hours."""

# An index may have a build of this version for the CPU, which what the pages install then leaves in place.
TORCH = "torch == 2.13.0"

# [s] that a block may take on two busy cores.
TIME_LIMIT = 1200


def installs(block: Block) -> bool:
    """Whether a block is an install line of the page."""
    return block.language == "sh" and all(line.startswith("pip install") for line in block.code.splitlines())


def follow(page: Path, folder: Path, torch: str) -> Iterator[str]:
    """Follows a page in a folder; yields a message for each block that fails, at most one, and stops there.

    Args:
      page: the page.
      folder: an empty folder, for the environment and for what the blocks write.
      torch: requirement of PyTorch that is installed first where the page brings PyTorch; none if empty.
    """
    checkout, home = folder / "checkout", folder / "home"
    ignored = shutil.ignore_patterns(".git", "__pycache__", "build", "*.egg-info", ".pytest_cache", ".ruff_cache")
    shutil.copytree(ROOT, checkout, ignore=ignored)
    shutil.copytree(checkout / "docs", home / "docs")
    venv.create(folder / "venv", with_pip=True)
    path = os.pathsep.join((str(folder / "venv" / "bin"), os.environ["PATH"]))
    environment = {name: value for name, value in os.environ.items() if name not in UNSET}
    environment |= {"PATH": path, "PIP_QUIET": "1", "RAY_USAGE_STATS_ENABLED": "0"}
    blocks = [block for block in blocks_of(page) if block.language and not {*block.marks} & {*PARSED_MARKS}]
    lines = [block for block in blocks if installs(block)]
    if torch and brings_torch("".join(block.code for block in lines), checkout, environment):
        subprocess.run(["pip", "install", torch], env=environment, check=True)
    for block in lines:
        subprocess.run(["bash", "-e", "-c", block.code], cwd=checkout, env=environment, check=True)
    for block in blocks:
        if not installs(block) and (problem := failure(block, home, environment | {"HOME": str(home)})):
            yield problem
            return


def brings_torch(command: str, checkout: Path, environment: Mapping[str, str]) -> bool:
    """Whether an install command would install PyTorch."""
    dry = command.replace("pip install", "pip install --dry-run --quiet --report -")
    result = subprocess.run(
        ["bash", "-e", "-c", dry], cwd=checkout, env=environment, stdout=subprocess.PIPE, text=True, check=True
    )
    return '"name": "torch"' in result.stdout


def failure(block: Block, folder: Path, environment: Mapping[str, str]) -> str:
    """Runs a block; returns its place and the end of its output if it fails, else nothing."""
    script = folder / f"line_{block.line}.{block.language}"
    script.write_text(block.code, encoding="utf-8")
    interpreter = ["python"] if block.language == "python" else ["bash", "-e"]
    try:
        result = subprocess.run(
            [*interpreter, script.name],
            cwd=folder,
            env=dict(environment),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=TIME_LIMIT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"{block.page.name}:{block.line} took longer than {TIME_LIMIT} s"
    if result.returncode == 0:
        return ""
    return f"{block.page.name}:{block.line} ended with status {result.returncode}\n{result.stdout[-3000:]}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pages", nargs="*", default=PAGES, help="pages, from the top of the repository")
    parser.add_argument("--torch", default=TORCH, help=f"installed first where a page brings PyTorch ({TORCH})")
    given = parser.parse_args()
    failed = 0
    for page in given.pages:
        with tempfile.TemporaryDirectory() as folder:
            problems = [*follow(ROOT / page, Path(folder), given.torch)]
        failed += bool(problems)
        print(f"{page}: {'failed' if problems else 'followed'}", *problems, sep="\n", flush=True)
    return failed


if __name__ == "__main__":
    sys.exit(main())
