"""Measures how long vla-eval takes for the hundred episodes of each config in docs/plugins/vla_eval_kitchen.

python docs/experiments/vla_eval_speed.py   plays them one after the other, and writes results/vla_eval.json

Needs `pip install '.[pixels]' docs/plugins/vla_eval_kitchen` and a GL library. The time is that of the whole command
`vla-eval run`, its start included; the model server is a process of its own, which waits for it.
"""

import contextlib
import json
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

from experiment import RESULTS, Row, make_parser, write_rows

ROOT = Path(__file__).resolve().parents[2]
PLUGIN = ROOT / "docs" / "plugins" / "vla_eval_kitchen"

# Config and policy. Random actions succeed in no episode, so that each has all of its control steps.
RUNS = (("state", "trained"), ("state", "random"), ("pixels", "trained"))

# Time that a server may take to start [s].
START = 60


@contextlib.contextmanager
def serving(policy: str) -> Iterator[str]:
    """Serves a policy on a free port; yields the address."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = f"localhost:{probe.getsockname()[1]}"
    command = [sys.executable, "-m", "vla_eval_kitchen_server", f"--address={address}", f"--args.policy={policy}"]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL) as server:
        try:
            deadline = time.monotonic() + START
            while not is_ready(f"http://{address}/health"):
                if server.poll() is not None or time.monotonic() > deadline:
                    raise RuntimeError(f"the server of {policy!r} has not started")
                time.sleep(0.1)
            yield f"ws://{address}"
        finally:
            server.terminate()


def is_ready(url: str) -> bool:
    """Whether a server answers."""
    with contextlib.suppress(OSError), urllib.request.urlopen(url) as answer:
        return bool(answer.status == 200)
    return False


def measure(config: str, policy: str, *flags: str) -> Row:
    """Plays the episodes of a config; returns a row of the results. `flags` are further ones of `vla-eval run`."""
    program = Path(sys.executable).with_name("vla-eval")
    with serving(policy) as url, tempfile.TemporaryDirectory() as folder:
        command = [program, "run", f"--config={PLUGIN / config}.yaml", f"--server-url={url}", f"--output-dir={folder}"]
        started = time.perf_counter()
        subprocess.run([*command, *flags], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        seconds = time.perf_counter() - started
        (path,) = Path(folder).glob("*_aggregate.json")
        found = json.loads(path.read_text("utf-8"))
    episodes = [episode for task in found["tasks"] for episode in task["episodes"]]
    if found["num_errors"]:
        raise RuntimeError(f"{found['num_errors']} episodes of {config} have failed")
    return {
        "config": config,
        "policy": policy,
        "episodes": len(episodes),
        "successes": sum(episode["metrics"]["success"] for episode in episodes),
        "control_steps": sum(episode["steps"] for episode in episodes),
        "seconds": round(seconds, 1),
    }


if __name__ == "__main__":
    make_parser(__doc__).parse_args()
    write_rows(RESULTS / "vla_eval.json", [measure(*run) for run in RUNS])
