"""Lets libFuzzer step the C of every spec of the gallery from any bits, ten million times each.

`gallery.py [RUNS [NAME…]]`. Takes ten minutes or more, so `make benchmark` leaves it out.
Needs clang and its libFuzzer (`apt-get install clang libclang-rt-14-dev`).
"""

from __future__ import annotations

import sys
import tempfile
import time
from contextlib import redirect_stdout
from pathlib import Path

from msnn.cli.application import run
from msnn.verification.exported_c import read_exported_c
from msnn.verification.fuzz import fuzz
from msnn.verification.proof_step import ToolFailedError, UnansweredError

GALLERY = Path(__file__).parents[2] / "examples" / "gallery"
_RUNS = 10_000_000
_SECONDS = 6 * 3600.0
"""For a model: a fuzzer that takes longer hangs."""


def main() -> int:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else _RUNS
    names = sys.argv[2:] or sorted(p.name.split(".")[0] for p in GALLERY.glob("*.msnn.yaml"))
    print("| model | runs of 8 steps | seconds | found |")
    print("| --- | --- | --- | --- |", flush=True)
    outcomes = [_fuzzed(name, runs) for name in names]
    return 0 if all(outcomes) else 1


def _fuzzed(name: str, runs: int) -> bool:
    """Fuzzes one spec and prints a row; True if nothing was found."""
    with tempfile.TemporaryDirectory() as place, redirect_stdout(sys.stderr):
        spec = str(GALLERY / f"{name}.msnn.yaml")
        if run(["export", spec, "--initial", "--to", "c", "--out", place]) != 0:
            raise SystemExit(f"{name} was not exported")
        began, done, found = time.monotonic(), 0, ""
        try:
            done = fuzz(read_exported_c(Path(place) / "c"), Path(place), f"-runs={runs}", _SECONDS)
        except ToolFailedError as error:
            found = "; ".join(error.lines) or str(error)
        except UnansweredError as error:
            found = str(error)
    seconds = time.monotonic() - began
    print(f"| {name} | {done:,} | {seconds:.0f} | {found or 'nothing'} |", flush=True)
    return not found


if __name__ == "__main__":
    sys.exit(main())
