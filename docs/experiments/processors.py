"""Compares episodes on this processor with those on an emulated other one.

The results are results/processors.json, and results/processors_receipts.json for receipts.

python docs/experiments/processors.py                   20 episodes of random actions and of the expert in every domain
python docs/experiments/processors.py digests           writes the digests of kitchen-doctor for kinds of processors
python docs/experiments/processors.py receipts          verifies the committed receipts there
python docs/experiments/processors.py receipts FOLDER   verifies those of the FOLDER of evaluation.py

The other one has no AVX2, FMA and AVX-512, without which the C library, NumPy and OpenBLAS round otherwise. The actions
are those of the policies on this processor. x86 alone; needs the extra `experts`.
"""

import itertools
import json
import os
import pickle
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import dm_env
import numpy as np
from experiment import RESULTS, Row, make_parser, timesteps, write_rows
from numpy.typing import NDArray
from tqdm import tqdm

from kitchen_suite import doctor, policies, suite
from kitchen_suite.evaluation import verify
from kitchen_suite.evaluation.receipt import Receipt
from kitchen_suite.policies import Policy

RECEIPTS = RESULTS / "receipts"
ENVIRONMENTS = 16  # stepped together in a replay.
OTHER = {
    "OPENBLAS_CORETYPE": "Prescott",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
}
# One without AVX-512, and the other one: kinds of processors whose digests are known beside this one's.
KINDS: tuple[dict[str, str], ...] = ({}, {"NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR"}, OTHER)
EPISODES = 20
FIRST_SEED = 50_000
CASES = [
    (domain, record.default_task, policy) for domain, record in suite.DOMAINS.items() for policy in ("random", "expert")
]

Episode = tuple[NDArray, NDArray, bool]


def play(domain: str, task: str, policy: str, seed: int, actions: NDArray | None = None) -> Episode:
    """Returns the actions `(T, k)` of an episode, its observations `(T + 1, m)`, and whether it succeeded."""
    environment = suite.load(domain, task, {"random": seed, "visuals": False})
    if actions is None:
        chosen, count = policies.find(policy)(environment, np.random.default_rng(seed)), None
    else:
        chosen, count = repeated(actions), len(actions) + 1
    played: list[NDArray] = []

    def act(timestep: dm_env.TimeStep) -> NDArray:
        played.append(np.array(chosen(timestep)))
        return played[-1]

    seen = [flat(timestep) for timestep in itertools.islice(timesteps(environment, act), count)]
    return np.array(played), np.array(seen), bool(environment.task.episode_metrics["success"])


def repeated(actions: NDArray) -> Policy:
    """Returns a policy that takes actions in their order."""
    remaining = iter(actions)
    return lambda timestep: next(remaining)


def flat(timestep: dm_env.TimeStep) -> NDArray:
    """Returns the observation as one array."""
    return np.concatenate([np.ravel(value) for value in timestep.observation.values()])


def replay(path: Path) -> None:
    """Plays the actions in a file again, and writes the episodes to it."""
    recorded = pickle.loads(path.read_bytes())
    played = {key: play(*key, actions=actions) for key, (actions, _, _) in recorded.items()}
    path.write_bytes(pickle.dumps(played))


def compare(here: list[Episode], there: list[Episode]) -> Row:
    """Returns when episodes part, how far, and how many succeed alike."""
    firsts, greatest, alike = [], [], 0
    for (_, one, success), (_, other, other_success) in zip(here, there, strict=True):
        count = min(len(one), len(other))
        difference = np.abs(one[:count] - other[:count]).max(axis=1)
        differing = np.flatnonzero(difference)
        firsts.append(int(differing[0]) if differing.size else None)
        greatest.append(difference)
        alike += success == other_success
    apart = [first for first in firsts if first is not None]
    return {
        "episodes": len(here),
        "equal": firsts.count(None),
        "first": statistics.median(apart) if apart else None,
        **{f"after_{step}": float(max(each[: step + 1].max() for each in greatest)) for step in (10, 50, 100)},
        "greatest": float(max(each.max() for each in greatest)),
        "alike": alike,
        "success": sum(success for _, _, success in here),
    }


def write_digests() -> None:
    """Writes the digests of kitchen-doctor on all `KINDS`, in place of those known for the installed versions."""
    found = [json.loads(output_of(kind, "digest")) for kind in KINDS]
    here = [record["circumstances"] for record in found]
    kept = [record for record in json.loads(doctor.KNOWN.read_text("utf-8")) if record["circumstances"] not in here]
    doctor.KNOWN.write_text(json.dumps(kept + found, indent=1) + "\n", encoding="utf-8")


def verified(path: Path) -> Row:
    """Returns how the episodes of a receipt differ from their replay here."""
    receipt = Receipt.read(path)
    compared = [*verify.compare(receipt, verify.checked_plan(receipt), ENVIRONMENTS, None)]
    firsts = [each.first for each in compared if each.first is not None]
    return {
        "receipt": path.stem,
        "episodes": len(compared),
        "equal": len(compared) - len(firsts),
        "alike": sum(each.scores_alike for each in compared),
        "first": min(firsts, default=None),
        "greatest": max(each.greatest for each in compared),
    }


def verify_receipts(folder: Path) -> None:
    """Verifies the receipts of a folder on the other processor."""
    found = sorted(folder.glob("*.npz"))
    if not found:
        raise FileNotFoundError(f"there are no receipts in {folder}")
    paths = tqdm(found, unit="receipt", disable=None)
    rows = [json.loads(output_of(OTHER, "receipt", path)) for path in paths]
    write_rows(RESULTS / "processors_receipts.json", rows)


def output_of(kind: dict[str, str], *arguments: object) -> bytes:
    """Returns what this script prints with some arguments on a kind of processor."""
    command = [sys.executable, __file__, *map(str, arguments)]
    return subprocess.run(command, env={**os.environ, **kind}, check=True, stdout=subprocess.PIPE).stdout


def compare_episodes() -> None:
    """Plays episodes here and on the other processor, and writes how they differ."""
    keys = [(*case, FIRST_SEED + number) for case in CASES for number in range(EPISODES)]
    here = {key: play(*key) for key in tqdm(keys, unit="episode", disable=None)}
    with tempfile.NamedTemporaryFile() as file:
        Path(file.name).write_bytes(pickle.dumps(here))
        output_of(OTHER, "replay", file.name)
        there = pickle.loads(Path(file.name).read_bytes())
    rows = []
    for case in CASES:
        episodes = ([each[key] for key in keys if key[:3] == case] for each in (here, there))
        rows.append(dict(zip(("domain", "task", "policy"), case, strict=True)) | compare(*episodes))
    write_rows(RESULTS / "processors.json", rows)


def main() -> None:
    """Runs the command; `replay`, `digest` and `receipt` are its calls of itself on other processors."""
    parser = make_parser(__doc__)
    measures = ("episodes", "digests", "receipts", "replay", "digest", "receipt")
    parser.add_argument("measure", nargs="?", choices=measures, default="episodes")
    parser.add_argument("path", nargs="?", type=Path, help="of receipts, replay and receipt")
    given = parser.parse_args()
    match given.measure:
        case "episodes":
            compare_episodes()
        case "digests":
            write_digests()
        case "receipts":
            verify_receipts(given.path or RECEIPTS)
        case "replay":
            replay(given.path)
        case "digest":
            print(json.dumps({"circumstances": doctor.circumstances(), "digests": dict(doctor.digests())}))
        case "receipt":
            print(json.dumps(verified(given.path)))


if __name__ == "__main__":
    main()
