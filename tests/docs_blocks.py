"""The fenced blocks of README and the pages below docs/, and how each is run.

Words after the language of a fence are marks:

  full, nightly, clients, torch, ray, lerobot, web, vla_eval, rendering   as of the tests: what a block costs and needs
  hours                                                   takes hours: only the command lines are parsed
  ci                                                      .ci/stage has the same line: only the command lines are parsed
"""

import dataclasses
import os
import re
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]

PYTEST_MARKS = ("full", "nightly", "clients", "torch", "ray", "lerobot", "web", "vla_eval", "rendering")
PARSED_MARKS = ("hours", "ci")
INTERPRETERS = {"python": (sys.executable,), "sh": ("bash", "-e")}
PARSED_PROGRAMS = (
    *(f"kitchen-{name}" for name in ("rollout", "record", "replay", "train", "play", "evaluate", "compare")),
    *("kitchen-export", "kitchen-convert", "kitchen-view", "kitchen-suite"),
    *("pytest", "python", "lerobot-train", "lerobot-eval"),
)

_FENCE = re.compile(r"^```(\w*) *(.*)\n([\s\S]*?)^```$", re.MULTILINE)
# A block is run as by a user of a headless machine who has set no variable of the suite.
UNSET = ("MUJOCO_GL", "PYOPENGL_PLATFORM", "DISPLAY", "WAYLAND_DISPLAY", "MINARI_DATASETS_PATH")


@dataclasses.dataclass(frozen=True)
class Block:
    """A fenced block.

    Attributes:
      page: file that has it.
      line: its first line there.
      language: first word of its fence; empty for output.
      marks: the other words.
      code: the lines between the fences.
    """

    page: Path
    line: int
    language: str
    marks: tuple[str, ...]
    code: str


def blocks_of(page: Path) -> list[Block]:
    """Returns the blocks of a page in their order."""
    text = page.read_text(encoding="utf-8")
    return [
        Block(page, text.count("\n", 0, found.start()) + 2, found[1], tuple(found[2].split()), found[3])
        for found in _FENCE.finditer(text)
    ]


def make_programs(folder: Path, names: Iterable[str]) -> Path:
    """Makes a folder of programs, each of which passes its arguments to `stand_ins.py`; returns the folder."""
    folder.mkdir()
    for name in names:
        program = folder / name
        program.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{ROOT}/tests/stand_ins.py" {name} "$@"\n')
        program.chmod(0o755)
    return folder


def run(block: Block, folder: Path, programs: Path) -> str:
    """Runs a block in a process of its own; returns the output.

    Args:
      block: the block.
      folder: working directory and home.
      programs: folder of programs that are found before all others.

    Raises:
      AssertionError: the process failed; the message has the block's place and the output.
    """
    script = folder / f"line_{block.line}.{block.language}"
    script.write_text(block.code, encoding="utf-8")
    path = os.pathsep.join((str(programs), str(Path(sys.executable).parent), os.environ["PATH"]))
    environment = {name: value for name, value in os.environ.items() if name not in UNSET}
    result = subprocess.run(
        [*INTERPRETERS[block.language], script.name],
        cwd=folder,
        env=environment | {"HOME": str(folder), "PATH": path, "RAY_USAGE_STATS_ENABLED": "0"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    assert result.returncode == 0, f"{block.page.name}:{block.line}\n{block.code}\n{result.stdout}"
    return result.stdout
