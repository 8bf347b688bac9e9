"""Writes `compiler/kernels/tables/telling_arguments.py`: where a last digit of a constant shows.

Each constant of each kernel is moved to its neighbours in the interpreter. Of many arguments those
few are kept that together tell every changed kernel from the right one, if any of them does. What
nothing tells is printed. `choose_arguments.py KERNEL…` writes anew what it finds for these alone.
Among them are the arguments that `python -m benchmarks.mutation.digit_outcomes` found.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
from numpy.typing import NDArray

from backends.c.selftest.selftest_text import plain_points
from benchmarks.kernel_accuracy.changed_constants import Site, changed_constants
from benchmarks.mutation.digit_outcomes import shown_arguments
from compiler.ir.scalars import SCALAR_FUNCTIONS
from compiler.kernels.table import routine
from compiler.kernels.tables.formats import FORMATS, RealName
from compiler.kernels.tables.telling_arguments import HEXADECIMAL
from compiler.kernels.trace.run_routine import run_routine
from compiler.kernels.trace.statements import Routine

Array = NDArray[Any]
_FIRST = 1024
"""Arguments of each kind that are tried of every changed kernel."""
_THEN = (2**13,)
"""Arguments of each kind that are tried, one after the other, where those tell nothing."""


@dataclass(frozen=True, slots=True)
class Chosen:
    """The arguments chosen for a kernel, and the changes of it that no argument shows."""

    points: Array
    told: int
    untold: tuple[Site, ...]


def main() -> None:
    kernels = sorted({row.kernel for row in SCALAR_FUNCTIONS.values() if row.kernel})
    texts = dict(HEXADECIMAL)
    for name in sys.argv[1:] or kernels:
        for real in FORMATS:
            chosen = chosen_arguments(name, real)
            what = f"{len(chosen.points)} arguments, {chosen.told} told, {len(chosen.untold)} not"
            print(f"{name} {real}: {what}: {chosen.untold}", flush=True)
            texts[name, real] = " ".join(float(x).hex() for point in chosen.points for x in point)
    target = Path("compiler/kernels/tables/telling_arguments.py")
    before, _, rest = target.read_text(encoding="utf-8").partition(_BEGIN)
    rows: list[str] = []
    for name in kernels:
        for real in FORMATS:
            lines = "\n".join(f"        {line}" for line in _lines(texts[name, real].split()))
            shown = lines or '        ""'
            rows.append(f'    ("{name}", "{real}"): (\n{shown}\n    ),')
    after = rest.partition(_END)[2]
    target.write_text(before + _BEGIN + "\n".join(rows) + _END + after, encoding="utf-8")


_BEGIN, _END = "HEXADECIMAL: dict[tuple[str, RealName], str] = {\n", "\n}\n"


def chosen_arguments(name: str, real: RealName) -> Chosen:
    """Few arguments that show the changes which ordinary ones do not."""
    right = routine(name, real)
    random = np.random.Generator(np.random.Philox(7))
    plain = np.array(plain_points(name, real), right.format.dtype)
    zeros = np.array([*product((0.0, -0.0), repeat=plain.shape[1])], right.format.dtype)
    first = np.concatenate([_drawn(name, right, _FIRST, random), zeros])
    if shown := shown_arguments(name, real):
        first = np.concatenate([first, np.array(shown, right.format.dtype)])
    later = [_drawn(name, right, count, random) for count in _THEN]
    told, untold = 0, list[Site]()
    left: list[Routine] = []
    found: list[Array] = []
    rows: list[NDArray[np.bool_]] = []
    for site, changed in changed_constants(right):
        if _differs(right, changed, plain).any():
            told += 1
            continue
        row = _differs(right, changed, first)
        late = None if row.any() else _first_of(right, changed, later)
        if row.any() or late is not None:
            told += 1
            left.append(changed)
            rows.append(row)
            found += [] if late is None else [late]
        else:
            untold.append(site)
    points = np.concatenate([first, *found])
    tells = np.zeros((len(left), len(points)), np.bool_)
    for number, (changed, row) in enumerate(zip(left, rows, strict=True)):
        tells[number, : len(first)] = row
        if found:
            tells[number, len(first) :] = _differs(right, changed, points[len(first) :])
    return Chosen(points[_cover(tells)], told, tuple(untold))


def _cover(tells: NDArray[np.bool_]) -> list[int]:
    """Few columns that together have a True in each row; greedy choice."""
    chosen: list[int] = []
    while len(tells):
        best = int(np.argmax(tells.sum(axis=0)))
        chosen.append(best)
        tells = tells[~tells[:, best]]
    return chosen


def _first_of(right: Routine, changed: Routine, sets: list[Array]) -> Array | None:
    for points in sets:
        for part in np.array_split(points, max(1, len(points) // 8192)):
            row = _differs(right, changed, part)
            if row.any():
                return part[row][:1]
    return None


def _differs(right: Routine, changed: Routine, points: Array) -> NDArray[np.bool_]:
    (expected,) = run_routine(right, tuple(points.T))
    (given,) = run_routine(changed, tuple(points.T))
    # zeros are told by their signs, as the self-test does
    other = (given != expected) | (np.signbit(given) != np.signbit(expected))
    return other & ~(np.isnan(given) & np.isnan(expected))


def _drawn(name: str, right: Routine, count: int, random: np.random.Generator) -> Array:
    """Within the domain of tests, evenly over the binades around 1, and any bits."""
    dtype = right.format.dtype
    word = np.uint32 if dtype == np.float32 else np.uint64
    (domain, *_) = [r.domain for r in SCALAR_FUNCTIONS.values() if name in (r.kernel, r.name)]
    columns: list[Array] = []
    for low, high in domain:
        bits = random.integers(0, np.iinfo(word).max, count, word, endpoint=True).view(dtype)
        signs = random.choice([-1.0, 1.0], count)
        around = (signs * np.exp2(random.uniform(-24.0, 12.0, count))).astype(dtype)
        columns.append(np.concatenate([random.uniform(low, high, count).astype(dtype), around]))
        columns[-1] = np.concatenate([columns[-1], bits])
    mixed = [columns[0], *(random.permutation(column) for column in columns[1:])]
    points = np.stack(mixed, 1)
    return points[~np.isnan(points).any(axis=1)]


def _lines(numbers: list[str]) -> Iterator[str]:
    line = ""
    short = (re.sub(r"\.?0*(?=p)", "", float.fromhex(number).hex()) for number in numbers)
    for number in short:
        if len(line) + len(number) > 84:
            yield f'"{line}"'
            line = ""
        line += number + " "
    if line:
        yield f'"{line.rstrip()}"'


if __name__ == "__main__":
    main()
