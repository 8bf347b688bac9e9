"""Keeps the measured accuracy of the kernels and writes it as docs/kernels.md."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path

from compiler.kernels.table import KERNELS

HERE = Path(__file__).parent
RESULTS = HERE / "results.json"
DOCUMENT = HERE.parents[1] / "docs" / "kernels.md"

OPENING = """\
# Math kernels

msnn has its own scalar functions, so that the float32 interpreter, the generated C and every
processor give the same bits. They are built from + − × ÷ √, comparisons, selections, conversions
between integers and reals, and small tables: each is exact or correctly rounded by IEEE 754, and
numpy and the C text perform them in the same order (`compiler/kernels/`). The C needs
`-ffp-contract=off`, and `sqrt` from the C library where a model takes roots.

Errors are in units in the last place (ulp) of the exact result; 0.5 is a perfectly rounded
function. NaN gives NaN, odd functions keep the sign of zero, overflow gives ±∞, and underflow is
gradual. Which NaN it is differs between processors and is not promised. Angles are reduced exactly
however large they are.

This page is written by `python -m benchmarks.kernel_accuracy.measure` and
`python -m benchmarks.kernel_accuracy.sample_double`; the polynomials are those of
`benchmarks/kernel_accuracy/fit_coefficients.py`.
"""

FLOAT = """
## float: every number

All 2³² floats against the double-precision C library, its result rounded to float; `pow` and
`atan2` on 10⁹ stratified pairs. *Compared* counts arguments with a finite result; all others (NaN,
infinities, signed zeros) are checked to be what IEEE 754 and C99 annex F say.

<!-- figures by: tests/docs/test_kernels_page.py -->
| kernel | arguments | promised ulp | compared | largest ulp | at | not the nearest float |
|---|---|---|---|---|---|---|
"""

DOUBLE = """
## double: samples

<!-- figures given: a precision -->
Random numbers of every binade and of usual size against mpmath with 200 bits and more.

<!-- figures by: tests/docs/test_kernels_page.py -->
| kernel | promised ulp | compared | largest ulp | at |
|---|---|---|---|---|
"""

PROMISED_DOUBLE = 2.0


@dataclass(frozen=True, slots=True)
class Measurement:
    """The accuracy of one kernel: the number of compared results, and the largest error in ulp.

    It also has the arguments of that error, the number of results that are not the nearest float,
    and the number of wrong special cases with the arguments of the last one.
    """

    compared: int
    largest_error: float
    largest_error_at: list[float]
    wrongly_rounded: int
    broken: int
    broken_at: list[float]


def keep(real: str, name: str, row: Measurement) -> None:
    """Adds the measurement of one kernel to the saved results."""
    results = _results()
    results.setdefault(real, {})[name] = dataclasses.asdict(row)
    text = json.dumps(results, indent=1, sort_keys=True)
    RESULTS.write_text(text + "\n", encoding="utf-8")


def write_report() -> None:
    """Writes docs/kernels.md from all saved measurements."""
    DOCUMENT.parent.mkdir(exist_ok=True)
    DOCUMENT.write_text(report(), encoding="utf-8")


def report() -> str:
    """The document, from all that has been measured."""
    results = _results()
    lines = [OPENING, FLOAT]
    for name, kernel in KERNELS.items():
        if name in results.get("float", {}):
            row = Measurement(**results["float"][name])
            lines.append(
                f"| `{name}` | {kernel.domain} | {kernel.error:g} | {row.compared:,} | "
                f"{row.largest_error:.3f} | {_point(row)} | "
                f"{100.0 * row.wrongly_rounded / row.compared:.2f} % |\n"
            )
    lines.append(DOUBLE)
    for name in KERNELS:
        if name in results.get("double", {}):
            row = Measurement(**results["double"][name])
            lines.append(
                f"| `{name}` | {PROMISED_DOUBLE:g} | {row.compared:,} | {row.largest_error:.3f} | "
                f"{_point(row)} |\n"
            )
    return "".join(lines)


def _point(row: Measurement) -> str:
    return ", ".join(f"{value:.9g}" for value in row.largest_error_at)


def _results() -> dict[str, dict[str, dict[str, float]]]:
    return json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else {}


if __name__ == "__main__":
    write_report()
