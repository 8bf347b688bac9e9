"""Measures the float kernels on all 2³² floats, or on 10⁹ pairs, and writes docs/kernels.md.

    python -m benchmarks.kernel_accuracy.measure [--only NAME ...] [--step N] [--pairs N]

Run from the top folder. Needs gcc; the reference is the double-precision C library, whose error is
about 2⁻²⁹ of a float's unit in the last place. One to four minutes a kernel on one core. Exits with
1 where a kernel exceeds the error that its table row states. Results are kept and merged, so that a
single kernel can be measured again; with --step or --pairs nothing is kept.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

from backends.c_kernels.sources import c_sources
from benchmarks.kernel_accuracy.report import Measurement, keep, write_report
from compiler.kernels.table import KERNELS

HERE = Path(__file__).parent
ALL_PAIRS = 10**9
FLAGS = ("-std=c11", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-D_GNU_SOURCE")


def measure(name: str, count: int) -> Measurement:
    """One kernel's record, from a program that is built for it."""
    sources = c_sources([name], "float", "own")
    program = "exhaustive" if KERNELS[name].arity == 1 else "pairs"
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        (here / sources.header_name).write_text(sources.header, encoding="utf-8")
        (here / sources.source_name).write_text(sources.source, encoding="utf-8")
        defined = (
            f"-DKERNEL={sources.functions[name]}",
            f"-DREFERENCE={name}",
            f"-DIS_POWER={int(name == 'pow')}",
        )
        inputs = (str(HERE / f"{program}.c"), str(here / sources.source_name))
        executable = str(here / program)
        command = ("gcc", *FLAGS, *defined, *inputs, "-o", executable, "-lm")
        subprocess.run(command, check=True)
        run = subprocess.run([executable, str(count)], check=True, capture_output=True, text=True)
    compared, wrong, broken, largest, x, y, broken_x, broken_y = run.stdout.split()
    arity = KERNELS[name].arity
    return Measurement(
        compared=int(compared),
        largest_error=float.fromhex(largest),
        largest_error_at=[float.fromhex(x), float.fromhex(y)][:arity],
        wrongly_rounded=int(wrong),
        broken=int(broken),
        broken_at=[float.fromhex(broken_x), float.fromhex(broken_y)][:arity],
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--step", type=int, default=1, help="take every N-th float")
    parser.add_argument("--pairs", type=int, default=ALL_PAIRS, help="pairs for pow and atan2")
    parser.add_argument("--only", nargs="*", default=[], help="kernels to measure")
    options = parser.parse_args()
    complete = options.step == 1 and options.pairs == ALL_PAIRS
    failed = False
    for name in options.only or list(KERNELS):
        row = measure(name, options.step if KERNELS[name].arity == 1 else options.pairs)
        print(name, row, flush=True)
        failed = failed or row.largest_error > KERNELS[name].error or row.broken > 0
        if complete:
            keep("float", name, row)
            write_report()
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
