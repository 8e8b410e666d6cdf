"""Writes the digests with which kitchen-doctor compares, for the installed versions.

python docs/scripts/known_digests.py

The C library, NumPy and OpenBLAS round otherwise on other processors: beside this one, one without AVX-512 and one
without AVX2, FMA and AVX-512 are emulated. x86 alone.
"""

import json
import os
import subprocess
import sys

from kitchen_suite import doctor

# Environment variables that emulate a kind of processor.
KINDS: tuple[dict[str, str], ...] = (
    {},
    {"NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR"},
    {
        "OPENBLAS_CORETYPE": "Prescott",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F",
        "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    },
)

# Program that prints the digests of the process that runs it.
PROGRAM = """
import json
from kitchen_suite import doctor
print(json.dumps({"circumstances": doctor.circumstances(), "digests": dict(doctor.digests())}))
"""


def main() -> None:
    """Writes the digests of all kinds in place of those known for the installed versions."""
    found = []
    for kind in KINDS:
        printed = subprocess.check_output([sys.executable, "-c", PROGRAM], env={**os.environ, **kind})
        found.append(json.loads(printed))
    here = [record["circumstances"] for record in found]
    kept = [record for record in json.loads(doctor.KNOWN.read_text("utf-8")) if record["circumstances"] not in here]
    doctor.KNOWN.write_text(json.dumps(kept + found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
