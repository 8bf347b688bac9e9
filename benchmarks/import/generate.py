"""Has nnodely make models and predictions, and compares what msnn makes of them.

    python benchmarks/import/generate.py             # layers, functions, 300 drawn models
    python benchmarks/import/generate.py --record    # also writes what the tests read
    python benchmarks/import/generate.py --suite     # what the peer's own tests make instead

Its tests are those of its source distribution, which pip loads.

The peer runs in an environment of its own, made once (see benchmarks/training/environments.py).
"""

from __future__ import annotations

import argparse
import gzip
import json
import subprocess
import sys
import tarfile
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "training"))
sys.path.insert(0, str(Path(__file__).parents[2]))

from environments import peer_python

from spec_schema.diagnostics.diagnostic import SpecError
from tests.importing.recorded_model import (
    RECORDS,
    TOLERANCE,
    deviations,
    imported,
    read_record,
)

HERE = Path(__file__).parent
PEER = "nnodely==1.5.4"
_DRAWN_KEPT = 20
"""Of the drawn models, how many the tests read: of all sizes."""


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--record", action="store_true", help="Write what the tests read.")
    options.add_argument("--suite", action="store_true", help="Compare what its tests make.")
    options.add_argument("--keep", type=Path, help="A folder with what the peer wrote before.")
    chosen = options.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = chosen.keep or Path(temporary)
        if not any(folder.glob("*.json")):
            python = peer_python("nnodely")
            worker = [python, str(HERE / "worker.py"), str(folder)]
            if chosen.suite:
                worker = [python, str(HERE / "suite_models.py"), str(tests_of(python)), str(folder)]
            subprocess.run(worker, check=True)
        report(folder)
        if chosen.record:
            record(folder)


def tests_of(python: Path) -> Path:
    """The folder of the peer's tests, unpacked beside its environment."""
    place = python.parents[1] / "source"
    if not place.exists():
        source = ["--no-deps", "--no-binary", ":all:", "--dest", str(place)]
        subprocess.run([python, "-m", "pip", "download", "-q", *source, PEER], check=True)
        # one of its tests reads a table of pygments, which the peer does not ask for
        subprocess.run([python, "-m", "pip", "install", "-q", "pygments"], check=True)
        (packed,) = place.glob("*.tar.gz")
        with tarfile.open(packed) as archive:
            archive.extractall(place, filter="data")
    (tests,) = place.glob("*/tests")
    return tests


def report(folder: Path) -> None:
    """Prints how far imports are from the peer, and how long they took."""
    worst: list[tuple[float, str]] = []
    slowest = 0.0
    failed = 0
    files = sorted(folder.glob("*.json"))
    for file in files:
        one = read_record(json.loads(file.read_text(encoding="utf-8")))
        with tempfile.TemporaryDirectory() as temporary:
            began = time.perf_counter()
            try:
                written = imported(one, Path(temporary))
            except SpecError as fault:
                print(f"{file.stem}: refused: {fault}")
                failed += 1
                continue
            slowest = max(slowest, time.perf_counter() - began)
            try:
                far = max(deviations(one, written).values(), default=0.0)
            except SpecError as fault:
                print(f"{file.stem}: imported, and not run: {fault}")
                continue
            worst.append((far, file.stem))
    worst.sort(reverse=True)
    within = sum(deviation <= TOLERANCE for deviation, _ in worst)
    print(f"{len(files)} models, {failed} refused, {within} within {TOLERANCE:g}")
    print(f"slowest import {slowest:.2f} s; furthest:")
    for deviation, name in worst[:5]:
        print(f"  {name}: {deviation:.1e}")


def record(folder: Path) -> None:
    """Writes the models of layers and functions and some of the drawn ones for the tests."""
    files = sorted(folder.glob("*.json"), key=lambda file: file.stat().st_size)
    drawn = [file for file in files if file.stem.startswith("random_")][
        :: len(files) // _DRAWN_KEPT
    ]
    made = [file for file in files if not file.stem.startswith("random_")]
    for name, kept in (("layers", made), ("drawn", drawn)):
        records = {file.stem: json.loads(file.read_text(encoding="utf-8")) for file in sorted(kept)}
        text = json.dumps(records, sort_keys=True).encode()
        # without a time in its head the same records are the same bytes
        (RECORDS / f"{name}.json.gz").write_bytes(gzip.compress(text, 9, mtime=0))


if __name__ == "__main__":
    main()
