"""Compares episodes on this processor with those on an emulated other one.

The results are results/processors.json, and results/processors_receipts.json for receipts.

python docs/experiments/processors.py            20 episodes of random actions and of the expert in every domain
python docs/experiments/processors.py digests    writes the digests of kitchen-doctor for kinds of processors instead
python docs/experiments/processors.py receipts   verifies the committed receipts there

The other one has no AVX2, FMA and AVX-512, without which the C library, NumPy and OpenBLAS round otherwise. The actions
are those of the policies on this processor. x86 alone; needs the extra `experts`.
"""

import json
import os
import pickle
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from kitchen_suite import doctor, policies, suite
from kitchen_suite.evaluation import verify_job
from kitchen_suite.evaluation.receipts import Receipt

RESULTS = Path(__file__).parent / "results" / "processors.json"
RECEIPTS = RESULTS.with_name("receipts")
ENVIRONMENTS = 16  # stepped together in a replay.
OTHER = {
    "OPENBLAS_CORETYPE": "Prescott",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
}
# One without AVX-512, and the other one: kinds of processors whose digests are known beside this one's.
KINDS: tuple[dict[str, str], ...] = ({}, {"NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR"}, OTHER)
EPISODES, FIRST_SEED = 20, 50_000
CASES = [
    (domain, record.default_task, policy) for domain, record in suite.DOMAINS.items() for policy in ("random", "expert")
]

Episode = tuple[NDArray, NDArray, bool]


def play(domain: str, task: str, policy: str, seed: int, actions: NDArray | None = None) -> Episode:
    """Returns the actions `(T, k)` of an episode, its observations `(T + 1, m)`, and whether it succeeded."""
    environment = suite.load(domain, task, {"random": seed, "visuals": False})
    timestep = environment.reset()
    act = policies.find(policy)(environment, np.random.default_rng(seed)) if actions is None else None
    played, seen = [], [flat(timestep)]
    while not timestep.last():
        assert actions is not None or act is not None
        action = actions[len(played)] if act is None else np.array(act(timestep))
        played.append(action)
        timestep = environment.step(action)
        seen.append(flat(timestep))
        if actions is not None and len(played) == len(actions):
            break
    return np.array(played), np.array(seen), bool(environment.task.episode_metrics["success"])


def flat(timestep: Any) -> NDArray:
    """Returns the observation as one array."""
    return np.concatenate([np.ravel(value) for value in timestep.observation.values()])


def replay(path: str) -> None:
    """Plays the actions in a file again, and writes the episodes to it."""
    recorded = pickle.loads(Path(path).read_bytes())
    played = {key: play(*key, actions=actions) for key, (actions, _, _) in recorded.items()}
    Path(path).write_bytes(pickle.dumps(played))


def compare(here: list[Episode], there: list[Episode]) -> dict[str, Any]:
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
    command = [sys.executable, __file__, "digest"]
    found = [
        json.loads(subprocess.run(command, env={**os.environ, **kind}, check=True, stdout=subprocess.PIPE).stdout)
        for kind in KINDS
    ]
    here = [record["circumstances"] for record in found]
    kept = [record for record in json.loads(doctor.KNOWN.read_text("utf-8")) if record["circumstances"] not in here]
    doctor.KNOWN.write_text(json.dumps(kept + found, indent=1) + "\n", encoding="utf-8")


def verified(path: Path) -> dict[str, Any]:
    """Returns how the episodes of a receipt differ from their replay here."""
    receipt = Receipt.read(path)
    compared = [*verify_job.compare(receipt, verify_job.checked_plan(receipt), ENVIRONMENTS, None)]
    firsts = [each.first for each in compared if each.first is not None]
    return {
        "receipt": path.stem,
        "episodes": len(compared),
        "equal": len(compared) - len(firsts),
        "alike": sum(each.scores_alike for each in compared),
        "first": min(firsts, default=None),
        "greatest": max(each.greatest for each in compared),
    }


def verify_receipts() -> None:
    """Verifies the committed receipts on the other processor."""
    command, rows = [sys.executable, __file__, "receipt"], []
    for path in tqdm(sorted(RECEIPTS.glob("*.npz")), unit="receipt", disable=None):
        done = subprocess.run([*command, str(path)], env={**os.environ, **OTHER}, check=True, stdout=subprocess.PIPE)
        rows.append(json.loads(done.stdout))
    RESULTS.with_name("processors_receipts.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


def main() -> None:
    """Plays, compares and writes."""
    keys = [(*case, FIRST_SEED + number) for case in CASES for number in range(EPISODES)]
    here = {key: play(*key) for key in tqdm(keys, unit="episode", disable=None)}
    with tempfile.NamedTemporaryFile() as file:
        Path(file.name).write_bytes(pickle.dumps(here))
        subprocess.run([sys.executable, __file__, file.name], env={**os.environ, **OTHER}, check=True)
        there = pickle.loads(Path(file.name).read_bytes())
    rows = []
    for case in CASES:
        episodes = ([each[key] for key in keys if key[:3] == case] for each in (here, there))
        rows.append(dict(zip(("domain", "task", "policy"), case, strict=True)) | compare(*episodes))
    RESULTS.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(rows, indent=1))


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["digests"]:
            write_digests()
        case ["receipts"]:
            verify_receipts()
        case ["receipt", path]:
            print(json.dumps(verified(Path(path))))
        case ["digest"]:
            print(json.dumps({"circumstances": doctor.circumstances(), "digests": dict(doctor.digests())}))
        case [path]:
            replay(path)
        case _:
            main()
