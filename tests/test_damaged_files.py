"""Files that are passed on, damaged in any way: refused with an OSError or a ValueError, or read as what was written.

Some differences cannot be noticed, since nothing else in the files depends on what differs:
  Episodes: statistics and sentence in the metadata, changed by a program that writes the sums of the zip anew. Changed
    arrays are inputs, which have a digest, or outputs, which a replay finds to differ. Physics states that are missing,
    as in older recordings.
  Recordings: of one before there were digests, actions whose change has no effect.
  Policies: weights and metadata, changed in the same way. A recording or evaluation keeps the digest of the whole file.
  D4RL's files and Minari datasets: numbers, since HDF5 has no sums. They are of other programs, whose layout is all
    that is known.
  Receipts: what `kitchen-replay` finds, see tests/evaluation/test_receipts.py.
"""

import abc
import json
import resource
import shutil
import warnings

import h5py
import numpy as np
import pytest
from helpers.episodes import load_episode
from helpers.human_files import write_d4rl, write_minari
from helpers.sweeps import brief
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from kitchen_suite import files
from kitchen_suite.commands import record
from kitchen_suite.datasets import minari
from kitchen_suite.datasets.human import ACTION_SIZE, D4RLData, MinariData, as_episode
from kitchen_suite.episodes import recording
from kitchen_suite.episodes.episode import PHYSICS_STATE
from kitchen_suite.episodes.replay import Verdict, compare, replay_episode
from kitchen_suite.episodes.spec import EnvironmentSpec
from kitchen_suite.evaluation.receipts import Receipt, Trace, sealed
from kitchen_suite.evaluation.scores import EpisodeResult
from kitchen_suite.gymnasium_env.base import suite_env
from kitchen_suite.policies.trained import TrainedPolicy, shipped_as
from kitchen_suite.tasks.kitchen.observation import SIZE as STATE_SIZE

# Growth of the process while it reads a damaged file [KiB]; Linux counts so.
_MAX_GROWTH = 2**20

_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@st.composite
def damages(draw):
    """Returns a function of the bytes of a file, which changes a few of them somewhere, or cuts or doubles them.

    As often as anywhere, it changes those at the start or the end, where the formats have their directories.
    """
    at, length = draw(st.floats(0, 1) | st.floats(0, 0.05) | st.floats(0.95, 1)), draw(st.integers(1, 64))
    replacement = draw(st.binary(max_size=64))
    others = ["swap", "replace", "cut", "remove", "repeat", "empty", "zeros"]
    kind = draw(st.just("flip") | st.sampled_from(others))
    bit = draw(st.integers(0, 7))

    def damage(contents):
        start = min(int(at * len(contents)), len(contents) - 1)
        head, middle, tail = contents[:start], contents[start : start + length], contents[start + length :]
        flipped = bytes([contents[start] ^ 1 << bit]) + contents[start + 1 :]
        return {
            "flip": head + flipped,
            "swap": head + middle[::-1] + tail,
            "replace": head + replacement + tail,
            "cut": head,
            "remove": head + tail,
            "repeat": head + middle + middle + tail,
            "empty": b"",
            "zeros": head + bytes(len(middle)) + tail,
        }[kind]

    return damage


@st.composite
def edits(draw):
    """Returns a function of decoded JSON or of arrays by name, which removes, renames, copies or replaces an entry."""
    kind = draw(st.sampled_from(["remove", "rename", "copy", "replace", "add"]))
    at, name = draw(st.floats(0, 1)), draw(st.text(max_size=5))
    value = draw(_JSON)

    def edit(entries, convert=lambda value: value):
        entries = dict(entries)
        key = list(entries)[min(int(at * len(entries)), len(entries) - 1)]
        old = entries.pop(key) if kind in ("remove", "rename") else entries[key]
        if kind != "remove":
            entries[key if kind == "replace" else name] = old if kind in ("rename", "copy") else convert(value)
        return entries

    return edit


def as_array(value):
    """Returns an array of a JSON value, without objects."""
    try:
        array = np.asarray(value)
    except (ValueError, OverflowError):
        return np.array("odd")
    return np.array(repr(value)) if array.dtype.hasobject else array


class Kind(abc.ABC):
    """A kind of file, of which one is valid."""

    @abc.abstractmethod
    def __init__(self, folder):
        """Writes valid files below a folder."""

    @property
    @abc.abstractmethod
    def paths(self):
        """Files to damage."""

    @abc.abstractmethod
    def read(self, is_edit):
        """Reads the files, and asserts that no difference is silent.

        Args:
          is_edit: whether an entry was changed in place of the file's bytes.

        Raises:
          OSError: a file is damaged.
          ValueError: a file holds something else.
        """

    def edit(self, path, change):
        """Changes an entry of a file of JSON; other kinds do so with their own entries."""
        path.write_text(json.dumps(change(json.loads(path.read_text()))))


def play(source, index, environment):
    """Whether the replay of an episode of a recording is equal."""
    recorded = source.load(index)
    replayed = replay_episode(environment, recorded, source.spec.seeding)
    return compare(environment.unwrapped.composer_task, recorded, replayed).verdict is Verdict.EQUAL


def same(one, other):
    return one.keys() == other.keys() and all(np.array_equal(array, other[name]) for name, array in one.items())


class Recording(Kind):
    """A folder of `kitchen-record`."""

    def __init__(self, folder):
        self.folder = folder / "runs"
        arguments = ["--num_threads=1", "--max_episode_steps=3", f"--output={self.folder}", "--num_episodes=1"]
        assert record.main(arguments) == 0
        self.source = recording.Recording.open(self.folder)
        self.environment = self.source.spec.make_environment(visuals=False)
        self.episode = self.source.load(0)
        self.stats = self.source.load_summary(0)

    def read(self, is_edit):
        opened = recording.Recording.open(self.folder)
        episode = opened.load(0)
        assert opened.spec == self.source.spec
        assert episode.seed == self.episode.seed
        # Older recordings have no physics states.
        if not same({PHYSICS_STATE: self.episode.arrays[PHYSICS_STATE], **episode.arrays}, self.episode.arrays):
            assert is_edit
            assert not play(opened, 0, self.environment)
        stats = opened.load_summary(0)
        assert is_edit or (stats, episode.instruction) == (self.stats, self.episode.instruction)


class Episodes(Recording):
    @property
    def paths(self):
        return [self.folder / "episode_000000.npz"]

    def edit(self, path, change):
        metadata, arrays = load_episode(path)
        if len(str(change({"": 0}))) % 2:
            metadata = change(metadata)
        else:
            arrays = change(arrays, as_array)
            arrays.pop("file", None)
        np.savez_compressed(path, **arrays, **({} if "metadata" in arrays else {"metadata": json.dumps(metadata)}))


class Specifications(Recording):
    @property
    def paths(self):
        return [self.folder / "recording.json"]


class Policies(Kind):
    """A trained policy."""

    def __init__(self, folder):
        self.path = folder / "policy.npz"
        shutil.copy(shipped_as("top_drawer"), self.path)
        self.policy = TrainedPolicy.load(self.path)

    @property
    def paths(self):
        return [self.path]

    def edit(self, path, change):
        metadata, arrays = load_episode(path)
        arrays = change(arrays, as_array)
        arrays.pop("file", None)
        np.savez_compressed(path, **arrays, **({} if "metadata" in arrays else {"metadata": json.dumps(metadata)}))

    def read(self, is_edit):
        policy = TrainedPolicy.load(self.path)
        action = policy(np.linspace(-1, 1, policy.observation_size))
        assert np.isfinite(action).all()
        if not is_edit:
            assert policy.metadata == self.policy.metadata
            assert same(policy.arrays, self.policy.arrays)


class Receipts(Kind):
    """A receipt of an evaluation; an entry is changed with the digest of the file made anew."""

    def __init__(self, folder):
        self.path = folder / "receipt.npz"
        trace = Trace(
            actions=np.linspace(-1, 1, 6, dtype=np.float32).reshape(3, 2),
            checks=np.arange(4, dtype=np.uint16),
            digest=np.arange(32, dtype=np.uint8),
            last=np.arange(5, dtype=np.float32),
        )
        result = EpisodeResult(condition="a", episode=0, seed=3, success=True, progress=1.0, control_steps=3)
        Receipt(evaluation={"seed": 3}, replaced=[], results={"a": [result]}, traces={"a": [trace]}).write(self.path)
        self.receipt = Receipt.read(self.path)

    @property
    def paths(self):
        return [self.path]

    def edit(self, path, change):
        with np.load(path) as file:
            arrays = dict(file)
        if len(str(change({"": 0}))) % 2:
            arrays["metadata"] = np.array(json.dumps(change(json.loads(str(arrays["metadata"])))))
        else:
            arrays = change(arrays, as_array)
            arrays.pop("file", None)
        path.write_bytes(sealed(files.pack_arrays(arrays)))

    def read(self, is_edit):
        receipt = Receipt.read(self.path)
        if not is_edit:
            assert receipt.evaluation == self.receipt.evaluation
        for traces in receipt.traces.values():
            for trace in traces:
                assert len(trace.checks) == len(trace.actions) + 1


class HumanData(Kind):
    """Demonstrations, as `kitchen-convert` reads them."""

    def __init__(self):
        arguments = {"tasks_per_episode": [1, 7], "terminate_on_tasks_completed": False}
        spec = EnvironmentSpec.make(domain_name="kitchen", task_name="all", task_kwargs=arguments)
        self.environment = suite_env(spec.make_environment())

    def check(self, data):
        for index, demonstration in enumerate(data.read()):
            steps = len(demonstration.actions)
            assert demonstration.observations.shape == (steps + 1, STATE_SIZE)
            assert demonstration.actions.shape == (steps, ACTION_SIZE)
            assert np.abs(demonstration.actions).max() < 1.01
            as_episode(self.environment, index, demonstration)[0].check()


class HumanFiles(HumanData):
    """A file of D4RL."""

    def __init__(self, folder):
        super().__init__()
        self.path = folder / "kitchen.hdf5"
        write_d4rl(self.path)

    @property
    def paths(self):
        return [self.path]

    def edit(self, path, change):
        with h5py.File(path) as file:
            arrays = {name: np.asarray(item) for name, item in file.items()}
        with h5py.File(path, "w") as file:
            for name, array in change(arrays, as_array).items():
                if array.dtype.kind != "U" and name.strip("/."):
                    file[name.replace("/", "")] = array if array.size else h5py.Empty("f4")

    def read(self, is_edit):
        self.check(D4RLData(self.path, self.environment.composer_task.scene))


class HumanDatasets(HumanData):
    """A Minari dataset of FrankaKitchen-v1."""

    def __init__(self, folder):
        super().__init__()
        with minari.folder(folder), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            write_minari("x-v0")
        self.folder = folder / "x-v0" / "data"

    @property
    def paths(self):
        return [self.folder / "main_data.hdf5", self.folder / "metadata.json"]

    def edit(self, path, change):
        super().edit(self.folder / "metadata.json", change)

    def read(self, is_edit):
        name = str(self.folder)
        self.check(MinariData(minari.load(name), name))


KINDS = {
    "episodes": Episodes,
    "specifications": Specifications,
    "policies": Policies,
    "receipts": Receipts,
    "D4RL's files": HumanFiles,
    "Minari datasets": HumanDatasets,
}
LONG = ["episodes", "Minari datasets"]
QUICK = [name for name in KINDS if name not in LONG]
NAMES = brief([*KINDS], QUICK, full=LONG)


@pytest.fixture(scope="module")
def kinds(tmp_path_factory):
    """The kinds of files by name, each written once."""
    written = {}

    def get(name):
        if name not in written:
            written[name] = KINDS[name](tmp_path_factory.mktemp("files"))
        return written[name]

    return get


def check(kind, choice, harm, is_edit):
    path = kind.paths[choice % len(kind.paths)]
    before = {path: path.read_bytes() for path in kind.paths}
    growth = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        if is_edit:
            kind.edit(path, harm)
        else:
            path.write_bytes(harm(before[path]))
        kind.read(is_edit)
    except (OSError, ValueError):
        pass
    finally:
        for path, contents in before.items():
            path.write_bytes(contents)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - growth < _MAX_GROWTH


DAMAGED = st.tuples(damages(), st.just(False)) | st.tuples(edits(), st.just(True))
COMMON = {
    "deadline": None,
    "database": None,
    "suppress_health_check": [HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
}


@pytest.mark.full
@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=20, derandomize=True, **COMMON)
@given(choice=st.integers(0, 9), damaged=DAMAGED)
def test_a_damaged_file_is_refused_or_read_as_it_was(kinds, name, choice, damaged):
    check(kinds(name), choice, *damaged)


@pytest.mark.nightly
@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=400, derandomize=True, **COMMON)
@given(choice=st.integers(0, 9), damaged=DAMAGED)
def test_many_damaged_files_are_refused_or_read_as_they_were(kinds, name, choice, damaged):
    check(kinds(name), choice, *damaged)
