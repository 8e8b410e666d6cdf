"""Compares what two versions of the suite compute, array by array, to the bit.

python tests/tools/compare_trees.py REVISION                   compares that revision of this repository with this tree
python tests/tools/compare_trees.py REVISION --only=vector     only the cases whose names match a regular expression
python tests/tools/compare_trees.py REVISION --quick           a few cases of everything
python tests/tools/compare_trees.py REVISION --ignore=digests  without the arrays whose names match
python tests/tools/compare_trees.py REVISION --cache=FOLDER    keeps the arrays of the revision, and uses those kept

Both trees play in processes of their own, on this machine and with the same packages. The cases of experts, recordings
and training are left out where their extras are not installed, those of pictures without a GL library. Exit status: 0
if all arrays are equal, else 1.
"""

import argparse
import concurrent.futures
import hashlib
import importlib
import importlib.metadata
import json
import multiprocessing
import os
import pickle
import re
import subprocess
import sys
import tempfile
import traceback
import warnings
from collections.abc import Mapping
from pathlib import Path
from urllib.parse import quote

import numpy as np
import trees
from tqdm import tqdm

Arrays = dict[str, np.ndarray]

# Cases that touch everything in about a minute.
QUICK = (
    r"load (kitchen all|open_cabinet top_drawer|microwave_table open), (random|noise|dense|ee_delta_pose|varied all)$",
    r"load kitchen (kettle|random_3), (expert|trained)$",
    r"gymnasium \w+, (defaults|tasks in turn|options of variations)$",
    r"vector \w+, (defaults, SameStep|defaults, Disabled|tasks in turn, NextStep|options of variations)",
    r"record (open_cabinet random|kitchen to Minari)$",
    r"evaluate microwave_table$",
    r"train microwave_table$",
)
# Packages on which the arrays depend.
PACKAGES = ("mujoco", "dm-control", "numpy", "gymnasium", "gymnasium-robotics", "scipy", "torch", "mink", "minari")
MAX_LISTED = 8
# Ending of the name of an array with the rows that have another array.
ROWS = "@rows"


def play(name: str, folder: Path) -> str:
    """Plays a case in this process, which has been prepared; writes its arrays. Returns the traceback of an error."""
    import tree_cases

    path = folder / file_name(name)
    try:
        arrays = tree_cases.cases()[name]()
    except Exception:
        return traceback.format_exc(limit=-3)
    unfinished = path.with_suffix(".part")
    unfinished.write_bytes(pickle.dumps(arrays))
    unfinished.replace(path)
    return ""


def prepare(tree: Path, work: Path) -> None:
    """Makes a worker process play on a tree."""
    warnings.simplefilter("ignore")
    os.environ.update({"COMPARED_TREE": str(tree), "OMP_NUM_THREADS": "1"})
    os.chdir(work)
    trees.use(tree)
    # It chooses its GL library now: a command that draws no pictures would choose none.
    importlib.import_module("dm_control.mujoco")


def names() -> list[str]:
    """Returns the names of the cases of the tree that this process plays on."""
    import tree_cases

    return list(tree_cases.cases())


def file_name(case: str) -> str:
    return f"{quote(case, safe=' ,')}.pkl"


def play_all(tree: Path, folder: Path, only: str, workers: int) -> dict[str, str]:
    """Plays the cases of a tree whose names match, and whose arrays are not in a folder yet, and writes them there.

    Returns:
      By the name of each case that matches, the traceback of its error; empty where there is none.
    """
    context = multiprocessing.get_context("spawn")
    with (
        tempfile.TemporaryDirectory() as work,
        concurrent.futures.ProcessPoolExecutor(workers, context, prepare, (tree, Path(work))) as pool,
    ):
        expression = re.compile(only)
        wanted = [name for name in pool.submit(names).result() if expression.search(name)]
        missing = [name for name in wanted if not (folder / file_name(name)).exists()]
        running = {pool.submit(play, name, folder): name for name in missing}
        errors = dict.fromkeys(wanted, "")
        with tqdm(total=len(missing), desc=folder.name[:12], unit="case", disable=None) as bar:
            for future in concurrent.futures.as_completed(running):
                errors[running[future]] = future.result()
                bar.update()
    return errors


def is_equal(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two arrays are the same in shape, type and every bit."""
    if one.dtype.kind == other.dtype.kind == "U":
        return np.array_equal(one, other)
    return one.shape == other.shape and one.dtype == other.dtype and one.tobytes() == other.tobytes()


def differences(before: Mapping[str, np.ndarray], after: Mapping[str, np.ndarray]) -> list[str]:
    """Returns a line for each name that one mapping lacks, or whose arrays differ, with the first place that does."""
    lines = [f"{name}: removed" for name in _alone(before, after)]
    lines += [f"{name}: added" for name in _alone(after, before)]
    for name, one in before.items():
        if name in after and not is_equal(one, after[name]):
            lines.append(f"{name}: {_difference(one, after[name])}")
    return lines


def _alone(one: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray]) -> list[str]:
    """Returns the names of one mapping alone, without the rows of arrays that are among them."""
    names = [name for name in one if name not in other]
    return [name for name in names if not (name.endswith(ROWS) and name.removesuffix(ROWS) in names)]


def _difference(one: np.ndarray, other: np.ndarray) -> str:
    if one.shape != other.shape or one.dtype.kind != other.dtype.kind:
        return f"{one.dtype} {one.shape} became {other.dtype} {other.shape}"
    places = np.argwhere(one != other)
    if not len(places):
        return "equal values of other types or bits"
    place = tuple(places[0].tolist())
    return f"at {place}: {str(one[place])[:80]} became {str(other[place])[:80]}; {len(places)} of {one.size} differ"


def compare(folders: Mapping[str, Path], errors: Mapping[str, Mapping[str, str]], ignore: str = "") -> bool:
    """Prints what differs between two trees; returns whether all is equal.

    Args:
      folders: of the arrays of both trees, by their names; the earlier one is first.
      errors: by tree, what `play_all` returned.
      ignore: regular expression of names of arrays that are left out; none if it is empty.
    """
    (before, before_errors), (after, after_errors) = errors.items()
    problems, elements = 0, 0
    for name in {**before_errors, **after_errors}:
        lines = [f"no such case on {tree}" for tree, each in errors.items() if name not in each]
        lines += [f"error on {tree}:\n{each[name]}" for tree, each in errors.items() if each.get(name)]
        if not lines:
            arrays = [pickle.loads((folders[tree] / file_name(name)).read_bytes()) for tree in (before, after)]
            if ignore:
                arrays = [{key: each[key] for key in each if not re.search(ignore, key)} for each in arrays]
            elements += sum(array.size for array in arrays[0].values())
            lines = differences(*arrays)
        problems += bool(lines)
        further = [f"and {len(lines) - MAX_LISTED} more"] if len(lines) > MAX_LISTED else []
        if lines:
            print(f"{name}: DIFFERENT", *lines[:MAX_LISTED], *further, sep="\n  ")
    verdict = f"{problems} DIFFERENT" if problems else "all equal"
    print(f"{len(before_errors)} cases, {elements} elements: {verdict}")
    return not problems and bool(before_errors)


def can_render() -> bool:
    """Whether EGL renders here."""
    code = "import mujoco; mujoco.GLContext(8, 8).make_current()"
    environ = {**os.environ, "MUJOCO_GL": "egl"}
    return subprocess.run([sys.executable, "-c", code], env=environ, capture_output=True).returncode == 0


def cache_name(revision: str) -> str:
    """Returns a name that depends on the revision, the cases, the packages and the GL library."""
    own = Path(__file__).parent
    cases = b"".join((own / name).read_bytes() for name in ("tree_cases.py", "trees.py"))
    versions = {name: importlib.metadata.version(name) for name in PACKAGES if has(name)}
    settings = json.dumps([versions, os.environ["MUJOCO_GL"]])
    return f"{trees.commit(revision)[:12]}-{hashlib.sha256(cases + settings.encode()).hexdigest()[:12]}"


def has(package: str) -> bool:
    try:
        importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("revision", help="revision of git to compare this tree with")
    parser.add_argument("--only", default="", help="play only the cases whose names match this regular expression")
    parser.add_argument("--quick", action="store_true", help="play a few cases of everything")
    parser.add_argument("--ignore", default="", help="leave out arrays whose names match this regular expression")
    parser.add_argument("--cache", type=Path, help="folder that keeps the arrays of the revision")
    parser.add_argument("--tree", type=Path, default=trees.ROOT, help="tree to compare in place of this one")
    parser.add_argument("--workers", type=int, default=2, help="processes that play, by default 2")
    arguments = parser.parse_args()
    os.environ.setdefault("MUJOCO_GL", "egl" if can_render() else "disable")
    only = "|".join(f"(?:{each})" for each in QUICK) if arguments.quick else arguments.only
    with tempfile.TemporaryDirectory() as work:
        cache = arguments.cache or Path(work)
        folders = {arguments.revision: cache / cache_name(arguments.revision), "this tree": Path(work, "this tree")}
        found = {arguments.revision: Path(work, "tree"), "this tree": arguments.tree.resolve()}
        trees.extract(arguments.revision, found[arguments.revision])
        errors = {}
        for name, folder in folders.items():
            folder.mkdir(parents=True, exist_ok=True)
            errors[name] = play_all(found[name], folder.resolve(), only, arguments.workers)
        return 0 if compare(folders, errors, arguments.ignore) else 1


if __name__ == "__main__":
    sys.exit(main())
