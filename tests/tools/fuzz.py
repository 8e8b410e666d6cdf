"""Reads files of every kind that have been changed at random, for some minutes each, and prints what goes wrong.

python tests/tools/fuzz.py --minutes=10                      every reader for ten minutes
python tests/tools/fuzz.py receipts policies --minutes=1     some of them
python tests/tools/fuzz.py receipts --seed=1234 --count=1    one change again

A change is one of a seed: of the bytes of a valid file, or of what is in it, with all digests made anew. It may be
refused, by an OSError or a ValueError, or be read. A finding is another exception, a message of more than a line, the
end of the process by a signal, more than 2 GiB of memory, or a read of more than a minute. The exit status is 1 if
there is any.
"""

import abc
import argparse
import contextlib
import copy
import hashlib
import io
import json
import multiprocessing
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kitchen_suite import checks, files
from kitchen_suite.commands import record
from kitchen_suite.datasets.human import D4RLData
from kitchen_suite.entities.kitchen_designs import KitchenDesign
from kitchen_suite.episodes.recording import Recording
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.evaluation.plan import EvaluationPlan
from kitchen_suite.evaluation.receipts import Receipt, sealed
from kitchen_suite.evaluation.verify import checked_plan
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies import load_policy
from kitchen_suite.policies.trained import shipped_as
from kitchen_suite.tasks.generated_kitchens import certificates

ROOT = Path(__file__).resolve().parents[2]

MAX_MEMORY = 2 * 2**20  # Of the process [KiB].
MAX_SECONDS = 60  # Of one read [s].
MAX_MESSAGE = 2_000  # Characters of a message.

# Errors with which a file may be refused.
REFUSALS = (OSError, ValueError, TypeError, checks.WorkFailedError)

# Values that stand in no file that the suite writes.
ODD_VALUES: tuple[Any, ...] = (
    *(None, True, -1, 0, 1, 2**31, 2**63, -(2**64), 10**400, 0.5, -0.0, 1e300, float("nan"), float("inf")),
    *("", "x", "x" * 100_000, "\x1b[31m\n\u202e", "os:system", "../../../etc/passwd", "1", "train/0", "\ud800"),
    *([], {}, [[]] * 3, [1] * 1_000, {"a": {"b": []}}, ["kettle"], {"kettle": 1}),
)
DTYPES = ("f4", "f8", "f2", "i1", "i8", "u1", "?", "c8", "U3", "S3", "M8[s]", ">f8", "V4")


class Reader(abc.ABC):
    """A kind of file: a valid one, changes of its contents, and how it is read."""

    name = ""

    def __init__(self, folder: Path) -> None:
        """Writes a valid file below a folder."""
        self.folder = folder

    @property
    @abc.abstractmethod
    def path(self) -> Path:
        """The file that is changed."""

    @abc.abstractmethod
    def read(self) -> None:
        """Reads the file."""

    def edited(self, contents: bytes, generator: np.random.Generator) -> bytes:
        """Returns contents that have been changed inside; of JSON by default."""
        value = json.loads(contents)
        return json.dumps(edited_json(value, generator)).encode("utf-8", "surrogatepass")


def edited_json(value: Any, generator: np.random.Generator) -> Any:
    """Returns decoded JSON of which one part has been replaced, removed, renamed or doubled."""
    value = copy.deepcopy(value)
    places: list[tuple[Any, Any]] = []

    def collect(part: Any) -> None:
        keys = part.keys() if isinstance(part, dict) else range(len(part)) if isinstance(part, list) else ()
        for key in list(keys)[:1_000]:
            places.append((part, key))
            collect(part[key])

    collect(value)
    if not places:
        return ODD_VALUES[generator.integers(len(ODD_VALUES))]
    part, key = places[generator.integers(len(places))]
    kind = generator.integers(4)
    if kind == 0:
        del part[key]
    elif kind == 1 and isinstance(part, dict):
        part[f"{key}x"] = part[key]
    elif kind == 2:
        # Many levels, or many elements.
        deep = part[key]
        for _ in range(int(generator.integers(1, 200))):
            deep = [deep]
        part[key] = deep
    else:
        part[key] = ODD_VALUES[generator.integers(len(ODD_VALUES))]
    return value


def edited_bytes(contents: bytes, generator: np.random.Generator) -> bytes:
    """Returns bytes of which some have been flipped, cut out, doubled, zeroed or replaced; often at start or end."""
    size = max(len(contents), 1)
    at = int(size * generator.choice([generator.random(), 0.05 * generator.random(), 1 - 0.05 * generator.random()]))
    length = int(generator.integers(1, 64))
    head, middle, tail = contents[:at], contents[at : at + length], contents[at + length :]
    kind = generator.integers(6)
    if kind == 0:
        flipped = bytearray(contents)
        for place in generator.integers(size, size=int(generator.integers(1, 9))):
            flipped[place] ^= 1 << int(generator.integers(8))
        return bytes(flipped)
    random = generator.bytes(len(middle))
    return (head, head + tail, head + middle * 2 + tail, head + bytes(len(middle)) + tail, head + random + tail)[
        kind - 1
    ]


def edited_arrays(arrays: Mapping[str, NDArray], generator: np.random.Generator) -> dict[str, NDArray]:
    """Returns arrays of which one has been removed, renamed, doubled, reshaped, cast, or filled with odd numbers."""
    changed = dict(arrays)
    name = list(changed)[generator.integers(len(changed))]
    array = changed[name]
    kind = generator.integers(7)
    if kind == 0:
        del changed[name]
    elif kind == 1:
        changed[f"{name}/{'x/' * int(generator.integers(1, 40))}"] = changed.pop(name)
    elif kind == 2:
        changed[name] = array[..., np.newaxis] if generator.random() < 0.5 else array.ravel()
    elif kind == 3:
        changed[name] = array[: int(generator.integers(0, len(array) + 1))] if array.ndim else array.reshape(1)
    elif kind == 4:
        with np.errstate(all="ignore"):
            try:
                changed[name] = array.astype(DTYPES[generator.integers(len(DTYPES))])
            except (TypeError, ValueError):
                changed[name] = np.zeros(0)
    elif kind == 5:
        changed[name] = np.zeros((int(generator.integers(2**25)), 1), "u1")
    elif array.dtype.kind in "fiub" and array.size:
        odd = array.copy()
        values = [0, 1, -1, 1e10, 1e300, np.nan, np.inf] if array.dtype.kind == "f" else [0, 1, 127]
        odd.flat[generator.integers(array.size, size=3)] = values[generator.integers(len(values))]
        changed[name] = odd
    return changed


class ArraysReader(Reader):
    """A file of arrays, with metadata as JSON."""

    def edited(self, contents: bytes, generator: np.random.Generator) -> bytes:
        with np.load(io.BytesIO(contents)) as file:
            arrays = dict(file)
        metadata = json.loads(str(arrays.pop("metadata")))
        if generator.random() < 0.5:
            metadata = edited_json(metadata, generator)
        else:
            arrays = edited_arrays(arrays, generator)
        text = np.array(json.dumps(metadata))
        return self.packed({**{name: array for name, array in arrays.items() if name != "file"}, "metadata": text})

    def packed(self, arrays: Mapping[str, NDArray]) -> bytes:
        """Returns the contents of a file."""
        return files.pack_arrays(arrays)


class Episodes(ArraysReader):
    """The episodes of a recording."""

    name = "episodes"

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        flags = ["--num_threads=1", "--max_episode_steps=3", "--num_episodes=1", f"--output={folder / 'runs'}"]
        assert record.main(flags) == 0
        self.environment = Recording.open(folder / "runs").spec.make_environment()

    @property
    def path(self) -> Path:
        return self.folder / "runs" / "episode_000000.npz"

    def read(self) -> None:
        recording = Recording.open(self.folder / "runs")
        recording.load_summary(0)
        recording.load_fitting(0, self.environment)


class Specifications(Episodes):
    """The specification of a recording."""

    name = "specifications"

    @property
    def path(self) -> Path:
        return self.folder / "runs" / "recording.json"

    def read(self) -> None:
        Recording.open(self.folder / "runs")

    edited = Reader.edited


class Receipts(ArraysReader):
    """A receipt of an evaluation."""

    name = "receipts"

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        source = min(
            (ROOT / "docs" / "experiments" / "results" / "receipts").glob("*.npz"), key=lambda e: e.stat().st_size
        )
        shutil.copy(source, self.path)

    @property
    def path(self) -> Path:
        return self.folder / "receipt.npz"

    def packed(self, arrays: Mapping[str, NDArray]) -> bytes:
        return sealed(super().packed(arrays))

    def read(self) -> None:
        checked_plan(Receipt.read(self.path))


class Policies(ArraysReader):
    """A trained policy."""

    name = "policies"
    source = "kettle"

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        shutil.copy(shipped_as(self.source), self.path)
        self.task = suite_env(EnvironmentSpec.make("kitchen", "kettle", {}).make_environment()).composer_task

    @property
    def path(self) -> Path:
        return self.folder / "policy.npz"

    def read(self) -> None:
        load_policy(self.path).episode(self.task)


class ClonedPolicies(Policies):
    """A policy of behaviour cloning."""

    name = "cloned policies"
    source = "kitchen"


class Designs(Reader):
    """A design of a kitchen."""

    name = "designs"

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.path.write_text(json.dumps(KitchenDesign.drawn(7, "train").to_json()), encoding="utf-8")

    @property
    def path(self) -> Path:
        return self.folder / "design.json"

    def read(self) -> None:
        KitchenDesign.make(str(self.path), "train")


class Certificates(Reader):
    """Certificates of kitchens."""

    name = "certificates"

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        lines = (
            (Path(certificates.__file__).parent / "certificates" / "train.jsonl").read_bytes().splitlines(keepends=True)
        )
        self.path.write_bytes(b"".join(lines[:3]))

    @property
    def path(self) -> Path:
        return self.folder / "certificates.jsonl"

    def edited(self, contents: bytes, generator: np.random.Generator) -> bytes:
        first, *others = contents.splitlines()
        line = json.dumps(edited_json(json.loads(first), generator), separators=(",", ":"))
        return b"\n".join([line.encode("utf-8", "surrogatepass"), *others, b""])

    def read(self) -> None:
        for certificate in certificates.read(self.path).values():
            assert isinstance(certificate.certified, tuple)


class Results(Reader):
    """A result of an evaluation as JSON, and the description in it."""

    name = "results"

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        source = ROOT / "docs" / "experiments" / "results" / "evaluation" / "expert_d4rl.json"
        found = source if source.exists() else min(source.parent.glob("*.json"))
        shutil.copy(found, self.path)
        self.result = files.load_json(self.path, "a result")

    @property
    def path(self) -> Path:
        return self.folder / "result.json"

    def read(self) -> None:
        result = files.load_json(self.path, "a result")
        files.first_difference(result, self.result)
        EvaluationPlan.of(result)


class HumanData(Reader):
    """Demonstrations in HDF5."""

    name = "human data"

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        sys.path.append(str(ROOT / "tests"))
        from helpers.human_files import write_d4rl

        write_d4rl(self.path)
        self.scene = suite_env(EnvironmentSpec.make("kitchen", "all", {}).make_environment()).composer_task.scene

    @property
    def path(self) -> Path:
        return self.folder / "kitchen.hdf5"

    def edited(self, contents: bytes, generator: np.random.Generator) -> bytes:
        import h5py

        with h5py.File(io.BytesIO(contents)) as file:
            arrays = {name: np.asarray(item) for name, item in file.items()}
        buffer = io.BytesIO()
        with h5py.File(buffer, "w") as file:
            for name, array in edited_arrays(arrays, generator).items():
                if array.dtype.kind in "biufc":
                    file[name.strip("/") or "x"] = array
        return buffer.getvalue()

    def read(self) -> None:
        for demonstration in D4RLData(self.path, self.scene).read():
            assert len(demonstration.observations) == len(demonstration.actions) + 1


class Checkpoints(Reader):
    """A checkpoint of a training run."""

    name = "checkpoints"

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        import torch

        from kitchen_suite.training import checkpoints

        self.library = checkpoints
        self.network = torch.nn.Linear(30, 10)
        self.modules = {"policy": self.network, "optimiser": torch.optim.Adam(self.network.parameters())}
        states = {name: module.state_dict() for name, module in self.modules.items()}
        numbers = {"seconds": 1.5, "processor_seconds": 2.5, "best": (0.0, 1.25), "progress": 0.5, "successes": [0.0]}
        checkpoint = checkpoints.Checkpoint(
            modules=states, random=torch.get_rng_state(), steps=1, warmup_batches=0, **numbers
        )
        self._path = checkpoints.save(folder, checkpoint)

    @property
    def path(self) -> Path:
        return self._path

    def edited(self, contents: bytes, generator: np.random.Generator) -> bytes:
        """Changes a member of the zip file, and makes the digest anew."""
        state = contents[:-32]
        buffer = io.BytesIO()
        with zipfile.ZipFile(io.BytesIO(state)) as source, zipfile.ZipFile(buffer, "w") as target:
            names = source.namelist()
            # Most often the pickle.
            pickles = [name for name in names if name.endswith("data.pkl")]
            chosen = pickles[0] if generator.random() < 0.8 else names[generator.integers(len(names))]
            for name in names:
                member = source.read(name)
                target.writestr(name, edited_bytes(member, generator) if name == chosen else member)
        changed = buffer.getvalue()
        return changed + hashlib.sha256(changed).digest()

    def read(self) -> None:
        self.library.load_last(self.folder, lambda found: self.library.check_modules(found.modules, self.modules))


READERS: Mapping[str, Callable[[Path], Reader]] = {
    kind.name: kind
    for kind in (
        *(Episodes, Specifications, Receipts, Policies, ClonedPolicies, Designs, Certificates, Results, HumanData),
        Checkpoints,
    )
}


def check(reader: Reader, valid: bytes, seed: int) -> str:
    """Reads one changed file; returns what is wrong, empty if nothing is."""
    generator = np.random.default_rng(seed)
    change = edited_bytes if generator.random() < 0.5 else reader.edited
    contents = change(valid, generator)
    reader.path.write_bytes(contents)
    signal.alarm(MAX_SECONDS)
    try:
        reader.read()
    except REFUSALS as error:
        message = str(error)
        if len(message) > MAX_MESSAGE or "\n" in message:
            return (
                f"a message of {len(message)} characters, {message.count(chr(10))} of them new lines: {message[:200]!r}"
            )
    except Exception:
        return traceback.format_exc(limit=-4)
    finally:
        signal.alarm(0)
    return ""


def work(name: str, seed: int, count: int, left: Any, current: Any) -> None:
    """Checks the changes of seeds for the time that is left; a process of its own, which ends at the first finding."""
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as folder:
        # What commands print is of no interest.
        with contextlib.redirect_stdout(io.StringIO()):
            reader = READERS[name](Path(folder))
        valid = reader.path.read_bytes()
        reader.read()
        now = time.monotonic()
        for each in range(seed, seed + count):
            left.value -= time.monotonic() - now
            now = time.monotonic()
            current.value = each
            problem = check(reader, valid, each)
            if not problem and resource.getrusage(resource.RUSAGE_SELF).ru_maxrss > MAX_MEMORY:
                problem = "more than 2 GiB of memory"
            if problem:
                print(f"{name}, seed {each}: {problem}", flush=True)
                sys.exit(1)
            if left.value <= 0.0:
                return


def fuzz(name: str, seed: int, count: int, minutes: float) -> tuple[int, int]:
    """Reads changed files of a kind for some minutes; returns the numbers of files and of findings."""
    context = multiprocessing.get_context("spawn")
    current = context.Value("q", seed - 1)
    left = context.Value("d", 60.0 * minutes)
    first, last, findings = seed, seed + count, 0
    while first < last and left.value > 0.0:
        process = context.Process(target=work, args=(name, first, last - first, left, current))
        process.start()
        process.join()
        if process.exitcode == 0:
            break
        findings += 1
        if process.exitcode != 1:
            print(f"{name}, seed {current.value}: the process ended with {process.exitcode}", flush=True)
        if current.value < first:
            break  # It could not begin.
        first = current.value + 1
    return current.value - seed + 1, findings


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("readers", nargs="*", help=f"some of: {', '.join(READERS)}; all when omitted")
    parser.add_argument("--minutes", type=float, default=10.0, help="time for each reader")
    parser.add_argument("--seed", type=int, default=0, help="of the first change; later ones have the next ones")
    parser.add_argument("--count", type=int, default=10**9, help="number of changes at most")
    arguments = parser.parse_args()
    total = 0
    for name in arguments.readers or READERS:
        checks.choice(name, READERS, "reader")
        count, findings = fuzz(name, arguments.seed, arguments.count, arguments.minutes)
        print(f"{name}: {count} files, {findings} findings", flush=True)
        total += findings
    return int(total > 0)


if __name__ == "__main__":
    sys.exit(main())
