"""Compares msnn with jax-sysid, sysidentpy and torch by hand: time and error in one run.

    python benchmarks/identification/against.py [--rounds 3] [--systems duffing bouc_wen]

Data are made of published equations with fixed seeds; the quarter drone's were measured (--data).
Every contender has the same records, first guesses and integration steps, one after the other in a
process of its own; the toolboxes live in an environment that the first run makes with pip. "First"
is a fit with its process: from its start, importing the toolbox and all that is compiled; "again"
is the same fit once more: reading the spec, what is written and traced, all steps of the optimiser.
"Of processors" are the seconds of all cores, which do not depend on what else runs; the ratio is
that of these, again. Prints a table in Markdown.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.identification.systems import BEGAN, SYSTEMS, measured_records, records
from benchmarks.training.environments import peer_python
from benchmarks.training.machine import load, processor

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "quarter_drone"
PEERS = Path(__file__).parent / "peers"
CONTENDERS = ("msnn", "jax_sysid", "sysidentpy", "torch")
NAMES = {"jax_sysid": "jax-sysid, L-BFGS", "torch": "torch by hand, L-BFGS"}
NAMES |= {"msnn": "msnn, Levenberg-Marquardt", "sysidentpy": "sysidentpy, polynomial NARX"}
ONCE = {"torch"}
"""Takes minutes: its time is of one round."""


def main() -> None:
    """Measures, and prints one line for each tool and system."""
    parser = argparse.ArgumentParser(description="Toolboxes of identification, side by side.")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--systems", nargs="*", default=list(SYSTEMS))
    parser.add_argument("--contenders", nargs="*", choices=CONTENDERS, default=list(CONTENDERS))
    parser.add_argument("--data", type=Path, default=DATA, help="records of the quarter drone")
    chosen = parser.parse_args()
    peers = peer_python("toolboxes", PEERS)
    print(f"{processor()}, load {load():.1f} at the start\n")
    print(
        "| system | contender | first s | of processors | again s | of processors | / msnn "
        "| loss / noise | test rms / output |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for name in chosen.systems:
        with tempfile.TemporaryDirectory(prefix="msnn-against-") as folder:
            system = SYSTEMS[name]
            if system.record and not (chosen.data / system.record).is_file():
                print(f"{name}: no records in {chosen.data}, see --data", file=sys.stderr)
                continue
            file = chosen.data / system.record
            data = measured_records(file) if system.record else records(system, 1)
            file = Path(folder) / "data.npz"
            np.savez(file, **data)
            for line in table(
                name, file, data, peers, chosen.rounds, Path(folder), chosen.contenders
            ):
                print(line, flush=True)
    print(f"\nload {load():.1f} at the end")


def table(
    name: str,
    file: Path,
    data: dict[str, Any],
    peers: Path,
    rounds: int,
    folder: Path,
    contenders: Sequence[str],
) -> list[str]:
    """The lines of one system; the tools take turns in each round, and msnn is one of them."""
    found: dict[str, list[dict[str, Any]]] = {contender: [] for contender in contenders}
    for number in range(rounds):
        for contender in contenders:
            if contender in ONCE and number:
                continue
            is_peer = contender in ("jax_sysid", "sysidentpy")
            python = str(peers) if is_peer else sys.executable
            cache = {"MSNN_CACHE": str(folder / f"kernels_{number}")}
            found[contender].append(fitted(python, contender, name, file, cache))
    noise = float(np.mean((data["train_y"] - data["train_clean"]) ** 2))
    size = float(np.std(data["test_clean"]))
    lines: list[str] = []
    ours = statistics.median(each["computed"][-1] for each in found["msnn"])
    for contender in contenders:
        results = found[contender]
        first = statistics.median(each["seconds"][0] for each in results)
        again = statistics.median(each["seconds"][-1] for each in results)
        computed = statistics.median(each["computed"][-1] for each in results)
        begun = statistics.median(each["computed"][0] for each in results)
        last = results[-1]
        lines.append(
            f"| {name} | {NAMES[contender]} | {first:.2f} | {begun:.2f} | {again:.3f} "
            f"| {computed:.3f} | {computed / ours:.1f} "
            f"| {last['loss'] / noise:.3f} | {last['test'] / size:.2%} |"
        )
    return lines


def fitted(
    python: str, contender: str, name: str, file: Path, more: dict[str, str]
) -> dict[str, Any]:
    """Runs one tool on one system in a process of its own; returns its JSON result."""
    script = Path(__file__).parent / "contenders" / f"{contender}_contender.py"
    done = subprocess.run(
        [python, script, name, file],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **more, BEGAN: repr(time.time())},
    )
    if done.returncode:
        raise RuntimeError(done.stderr)
    return json.loads(done.stdout.splitlines()[-1])


if __name__ == "__main__":
    main()
