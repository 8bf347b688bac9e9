"""Has nnodely make models and predictions, and compares what msnn makes of them.

    python benchmarks/import/generate.py             # layers, functions, 300 drawn models
    python benchmarks/import/generate.py --record    # also writes what the tests read
    python benchmarks/import/generate.py --suite     # what the peer's own tests make instead
    python benchmarks/import/generate.py --recorded  # what the tests read, without the peer

`--write` writes RESULTS.md, of the suite SUITE.md, of what the tests read RECORDED.md.
Its tests are those of its source distribution, which pip loads. What is further than the tolerance
from the peer, which computes in single precision, is compared with the peer's code in doubles too.

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
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1] / "training"))
sys.path.insert(0, str(Path(__file__).parents[2]))

from environments import peer_python

from spec_schema.diagnostics.diagnostic import SpecError
from tests.features.nnodely.recorded_model import (
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
_TEXT = """\
# Imports of {peer}

Written by `python benchmarks/import/generate.py{option} --write`. Deviations are the largest of a
model's outputs from what the peer computes, relative to what they are; seconds are of a processor.

```text
{found}
```
"""


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--record", action="store_true", help="Write what the tests read.")
    options.add_argument("--suite", action="store_true", help="Compare what its tests make.")
    options.add_argument("--recorded", action="store_true", help="Compare what the tests read.")
    options.add_argument("--write", action="store_true", help="Write the page of results.")
    options.add_argument("--keep", type=Path, help="A folder with what the peer wrote before.")
    chosen = options.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = chosen.keep or Path(temporary)
        if chosen.recorded:
            unpack(folder)
        elif not any(folder.glob("*.json")):
            python = peer_python("nnodely")
            worker = [python, str(HERE / "worker.py"), str(folder)]
            if chosen.suite:
                worker = [python, str(HERE / "suite_models.py"), str(tests_of(python)), str(folder)]
            subprocess.run(worker, check=True)
        found = report(folder)
        print(found)
        if chosen.write:
            name, option = "RESULTS.md", ""
            if chosen.suite:
                name, option = "SUITE.md", " --suite"
            elif chosen.recorded:
                name, option = "RECORDED.md", " --recorded"
            page = _TEXT.format(option=option, peer=PEER, found=found)
            (HERE / name).write_text(page, encoding="utf-8")
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


def unpack(folder: Path) -> None:
    """Writes the saved models that the tests read, as the worker in nnodely's environment would."""
    for name in ("layers", "drawn"):
        records = json.loads(gzip.decompress((RECORDS / f"{name}.json.gz").read_bytes()))
        for model, kept in records.items():
            (folder / f"{model}.json").write_text(json.dumps(kept), encoding="utf-8")


def report(folder: Path) -> str:
    """Text about the errors of imports against nnodely, and how long they took."""
    lines: list[str] = []
    far: list[tuple[float, str]] = []
    took: dict[str, float] = {}
    failed = 0
    files = sorted(folder.glob("*.json"))
    for file in files:
        one = read_record(json.loads(file.read_text(encoding="utf-8")))
        with tempfile.TemporaryDirectory() as temporary:
            began = time.process_time()
            try:
                written = imported(one, Path(temporary))
            except SpecError as fault:
                lines.append(f"{file.stem}: refused: {_first(fault)}")
                failed += 1
                continue
            took[file.stem] = time.process_time() - began
            if file.stem.startswith("large_"):
                relations = len(json.loads(one.model)["Relations"])
                lines.append(f"{file.stem}: {relations} relations in {took[file.stem]:.2f} s")
            try:
                far.append((max(deviations(one, written).values(), default=0.0), file.stem))
            except SpecError as fault:
                lines.append(f"{file.stem}: imported, and not run: {_first(fault)}")
    far.sort(reverse=True)
    drawn = sum(file.stem.startswith("random_") for file in files)
    within = sum(deviation <= TOLERANCE for deviation, _ in far)
    lines += [
        f"{len(files)} models, {drawn} of them drawn, {failed} refused",
        f"{within} within {TOLERANCE:g}, {len(far) - within} farther",
        f"slowest import {max(took.values()):.2f} s; furthest:",
        *(f"  {name}: {deviation:.1e}" for deviation, name in far[:6]),
    ]
    beyond = [name for deviation, name in far if deviation > TOLERANCE]
    for name, outputs in in_doubles(folder, beyond).items():
        one = read_record(json.loads((folder / f"{name}.json").read_text(encoding="utf-8")))
        with tempfile.TemporaryDirectory() as temporary:
            wide = replace(one, outputs=outputs)
            off = max(deviations(wide, imported(one, Path(temporary))).values())
        lines.append(f"  {name}: {off:.1e} from the peer in doubles")
    return "\n".join(lines)


def _first(fault: SpecError) -> str:
    """The first line of an error."""
    return str(fault).partition("\n")[0]


def in_doubles(folder: Path, names: list[str]) -> dict[str, Mapping[str, NDArray[np.float64]]]:
    """nnodely's predictions in double precision, by model, for the models that it can load."""
    if not names:
        return {}
    script = str(HERE / "double_precision.py")
    subprocess.run([peer_python("nnodely"), script, str(folder), *names], check=True)
    found = {name: folder / "double" / f"{name}.json" for name in names}
    return {
        name: read_record(json.loads(file.read_text(encoding="utf-8"))).outputs
        for name, file in found.items()
        if file.exists()
    }


def record(folder: Path) -> None:
    """Writes the models of layers and functions and some of the drawn ones for the tests."""
    files = sorted(folder.glob("*.json"), key=lambda file: file.stat().st_size)
    drawn = [file for file in files if file.stem.startswith("random_")][
        :: len(files) // _DRAWN_KEPT
    ]
    made = [file for file in files if not file.stem.startswith("random_")]
    for name, kept in (("layers", made), ("drawn", drawn)):
        records = {file.stem: json.loads(file.read_text(encoding="utf-8")) for file in sorted(kept)}
        wide = in_doubles(folder, list(records)) if name == "layers" else {}
        for one, outputs in wide.items():
            values = {key: value.tolist() for key, value in outputs.items()}
            records[one]["doubles"] = values
        text = json.dumps(records, sort_keys=True).encode()
        # without a time in its head the same records are the same bytes
        (RECORDS / f"{name}.json.gz").write_bytes(gzip.compress(text, 9, mtime=0))


if __name__ == "__main__":
    main()
