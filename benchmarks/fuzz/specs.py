"""Takes random specs through check, every export and a training kernel; keeps what is wrong.

`python -m benchmarks.fuzz.specs [--count 10000] [--first SEED] [--findings FOLDER]`. Goes on after
the last seed that FOLDER/next_seed names, so that it may be ended at any time and started again.
A finding is a folder: the smallest spec with the fault, the spec of the seed, and what was wrong.
Every target exports drawn weights (`tests/random_specs/drawn_weights.py`), of every fourth seed the
initial ones. Two seconds of a processor each, half of it compilers': 2,000 take an hour.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from contextlib import suppress
from functools import partial
from pathlib import Path

from backends.files.atomic_write import write_text
from msnn.exports.table import NAMES
from msnn.model.load import load_model
from spec_schema.diagnostics.diagnostic import SpecError
from tests.random_specs.drawn_weights import drawn_weights
from tests.random_specs.generate import random_spec
from tests.random_specs.shrink import shrunk
from tests.random_specs.trial import Fault, fault_of

SEARCHED = 8
"""Of so many specs one has the test program with searched steps: they take a third of the time."""

SHRINKING = 120.0
"""Seconds for a finding."""


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--first", type=int, help="default: where the last run ended, else 0")
    parser.add_argument("--findings", type=Path, default=Path("build/random_specs"))
    parser.add_argument("--shrink", type=float, default=SHRINKING, metavar="SECONDS")
    arguments = parser.parse_args()
    folder: Path = arguments.findings
    first = arguments.first if arguments.first is not None else _next_seed(folder)
    began, kinds, refused = time.monotonic(), set[tuple[str, str]](), 0
    last, compared = first, Counter[str]()
    with suppress(KeyboardInterrupt):
        for seed in range(first, first + arguments.count):
            spec = random_spec(seed)
            fault = fault_of(
                spec,
                searches=seed % SEARCHED == 0,
                weights_of=partial(drawn_weights, seed=seed),
                compared=compared,
            )
            last = seed + 1
            write_text(folder / "next_seed", f"{last}\n")
            if fault is None:
                continue
            refused += fault.stage == "check" and fault.kind.startswith("refused")
            new = (fault.stage, fault.kind) not in kinds
            kinds.add((fault.stage, fault.kind))
            print(
                f"seed {seed}: {fault.stage}: {fault.kind}{'' if new else ' (again)'}", flush=True
            )
            if new:
                _keep(folder / f"seed_{seed}", seed, fault, arguments.shrink)
    seconds = time.monotonic() - began
    # a backend that was left out finds nothing
    print("compared: " + ", ".join(f"{name} {count}" for name, count in compared.items()))
    print(f"{last - first} specs ({refused} refused), {len(kinds)} kinds of fault, {seconds:.0f} s")
    return 1 if kinds else 0


def _next_seed(folder: Path) -> int:
    try:
        return int((folder / "next_seed").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return 0


def _keep(folder: Path, seed: int, fault: Fault, seconds: float) -> None:
    """Saves a finding: the spec, the fault, then a smaller spec with the same fault and its
    weights.
    """
    spec, weights_of = random_spec(seed), partial(drawn_weights, seed=seed)
    write_text(folder / "fault.txt", f"{fault.stage}: {fault.kind}\n\n{fault.detail}\n")
    for name, text in spec.texts().items():
        write_text(folder / "seed" / name, text)
    # what did not find it is left out: a target takes a second, the searched steps another
    writes = fault.stage == "export"
    targets = (fault.stage,) if fault.stage in NAMES else NAMES if writes else ()
    needed = partial(
        fault_of,
        targets=targets,
        kernel=fault.stage == "train",
        searches=writes,
        weights_of=weights_of,
    )
    smallest = shrunk(spec, fault, needed, seconds)
    for name, text in smallest.texts().items():
        write_text(folder / name, text)
    with suppress(SpecError):  # a spec that is refused has no program
        program = load_model(folder / "spec.msnn.yaml").program
        weights = {name: value.tolist() for name, value in weights_of(program).items()}
        write_text(folder / "weights.json", json.dumps(weights, indent=1) + "\n")


if __name__ == "__main__":
    raise SystemExit(main())
