"""Whether another last digit of a constant changes any result of a mathematical function.

`python -m benchmarks.mutation.digit_outcomes [--quick] [--at X,…] [KERNEL…]`: changes of kernels in
single precision meet corners, to which X are added, and drawn arguments, then those that nothing
showed all floats, an hour or more of a processor for all kernels; not if `--quick`. Functions of
two arguments meet all floats beside 1 and -1, which proves nothing of other pairs. All is kept in
digit_outcomes.json under the hash of both texts. Needs gcc; Ctrl-C keeps what was found.
"""

from __future__ import annotations

import argparse
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from pydantic import TypeAdapter

from backends.c_kernels.sources import c_sources
from backends.files.atomic_write import write_text
from benchmarks.mutation.digit_equivalents import DIGITS
from benchmarks.mutation.every_argument import first_shown
from benchmarks.mutation.math_functions import PREFIX, Function, functions_of, needed, text_hash
from benchmarks.mutation.mutants import last_digit_mutants
from compiler.ir.scalars import SCALAR_FUNCTIONS
from compiler.kernels.tables.formats import RealName

OUTCOMES = Path(__file__).with_suffix(".json")

_TOGETHER = 32
"""Changes that meet all floats in one program, after which what was found is kept."""
_DRAWN = ("drawn", "600", "-12", "12", "-12", "12")
_WITHIN = {
    "own_log_words": ("1", str(0x7F7FFFFF)),
    "own_reduce_angle": ("0", str(0x7F7FFFFF)),
}
"""Where not every float is an argument: the callers give a size, and treat infinities and NaN."""
_BESIDE = ("beside", "8192", "-12", "12", "-12", "12")
"""Where a called function differs at an x, which of many y shows it."""
_ALL = ("every", "0", str(0xFFFFFFFF))
_UPPER_HALF = ("every", "0", str(0x7FFFFFFF))
"""Where f(-x) is f(x) or -f(x), in the changed text too; zeros of both signs are corners."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What is known about one change of a digit: arguments that show it, or which ones were
    tried.
    """

    function: str
    line: str
    change: str
    shown: tuple[str, ...]
    """The arguments of one place that shows it; empty where none does."""
    every: bool
    """Whether all floats were tried."""


_ROWS = TypeAdapter(dict[str, Outcome])


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("kernels", nargs="*")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--at", default="", metavar="X,…", help="as C writes them")
    given = parser.parse_args()
    at = [float.fromhex(x) if "x" in x else float(x) for x in given.at.split(",") if x]
    every = sorted({row.kernel for row in SCALAR_FUNCTIONS.values() if row.kernel})
    with suppress(KeyboardInterrupt):
        for kernel in given.kernels or every:
            source = c_sources([kernel], "float", "own").source
            right = functions_of(source)
            for name in right:
                _decide(source, right, name, at, quick=given.quick)


def known() -> dict[str, Outcome]:
    """The saved outcomes, by the hash of the original and the changed text."""
    if not OUTCOMES.exists():
        return {}
    return _ROWS.validate_json(OUTCOMES.read_bytes())


def changes_no_result(source: str, changed: str, prefix: str) -> bool:
    """True if all floats were tried for each function that a model calls, and none showed the
    change.
    """
    outcomes = known()
    right, other = functions_of(source, prefix), functions_of(changed, prefix)
    differ = [name for name in right if right[name].text != other[name].text]

    def same(name: str) -> bool:
        own = needed(right, name)
        outcome = outcomes.get(text_hash(own, needed(other, name)))
        proved = outcome is not None and outcome.every and not outcome.shown
        return proved and len(right[name].arguments) == 1

    if all(map(same, differ)):
        return True
    public = (name for name, one in right.items() if one.is_public)
    return all(same(name) for name in public if not {*differ}.isdisjoint(needed(right, name)))


def shown_arguments(kernel: str, real: RealName) -> list[tuple[float, ...]]:
    """Arguments that show changes of a kernel: saved ones in single precision.

    In double precision, corner cases and random arguments are tried again.
    """
    source = c_sources([kernel], real, "own").source
    name = f"own_{kernel}"
    right = needed(functions_of(source), name)
    changed = (needed(functions_of(one.text), name) for one in last_digit_mutants(source))
    differ = [each for each in changed if text_hash(right, each) != text_hash(right, right)]
    found = set[tuple[float, ...]]()
    if real == "float":
        outcomes = known()
        rows = (outcomes.get(text_hash(right, each)) for each in differ)
        found |= {tuple(map(float.fromhex, row.shown)) for row in rows if row and row.shown}
    else:
        arity = len(right[name].arguments)
        found |= {point[:arity] for _, point in first_shown(name, right, differ, _DRAWN)}
    return sorted(found, key=str)


def _decide(
    source: str, functions: Mapping[str, Function], name: str, at: Iterable[float], *, quick: bool
) -> None:
    """Determines the outcome of each change of a function, and of functions that it calls."""
    outcomes, right = known(), needed(functions, name)
    left, corners = dict[str, tuple[Outcome, Mapping[str, Function]]](), {*at}
    places = dict[str, tuple[float, ...]]()
    for mutant in last_digit_mutants(source):
        changed = needed(functions_of(mutant.text), name)
        key = text_hash(right, changed)
        inner = next((one for one in right if right[one].text != changed[one].text), None)
        if inner is None or _is_same_inside(outcomes, right, changed, inner, name):
            continue
        if (mutant.line, mutant.change) in DIGITS.get(inner.removeprefix(f"{PREFIX}_"), {}):
            continue
        if key not in outcomes or not (outcomes[key].shown or outcomes[key].every):
            outcome = Outcome(mutant.function, mutant.line, mutant.change, (), every=False)
            left[key] = outcome, changed
            # where a called function differs its caller may
            called = outcomes.get(text_hash(needed(right, inner), needed(changed, inner)))
            places[key] = tuple(map(float.fromhex, called.shown if called else ()))
            corners |= {*places[key]}
    within = _WITHIN.get(name)
    _try(name, right, left, ("corners", *within) if within else _DRAWN, corners)
    if len(right[name].arguments) > 1:
        for key in [key for key in left if places[key]]:
            alone = {key: left[key]}
            _try(name, right, alone, _BESIDE, places[key])
            if not alone:
                del left[key]
    if not quick:
        mirrored = {k: row for k, row in left.items() if _is_mirrored(right, row[1], name)}
        others = {key: row for key, row in left.items() if key not in mirrored}
        whole = ("every", *within) if within else _ALL
        for rows, every in ((mirrored, _UPPER_HALF), (others, whole)):
            for begin in range(0, len(rows), _TOGETHER):
                own = dict([*rows.items()][begin : begin + _TOGETHER])
                _try(name, right, own, every)
    print(name, flush=True)


def _is_mirrored(right: Mapping[str, Function], changed: Mapping[str, Function], name: str) -> bool:
    return right[name].is_mirrored and changed[name].is_mirrored


def _is_same_inside(
    outcomes: Mapping[str, Outcome],
    right: Mapping[str, Function],
    changed: Mapping[str, Function],
    inner: str,
    name: str,
) -> bool:
    """True if a called function was proved to have the same results after the change."""
    if inner == name:
        return False
    outcome = outcomes.get(text_hash(needed(right, inner), needed(changed, inner)))
    return outcome is not None and outcome.every and not outcome.shown


def _try(
    name: str,
    right: Mapping[str, Function],
    left: dict[str, tuple[Outcome, Mapping[str, Function]]],
    arguments: Sequence[str],
    corners: Collection[float] = (),
) -> None:
    """Tries arguments; saves outcomes of changes that they show, and removes these from `left`."""
    keys = list(left)
    if not keys:
        return
    points = dict(first_shown(name, right, [left[key][1] for key in keys], arguments, corners))
    outcomes, arity = known(), len(right[name].arguments)
    every = arguments[0] == "every"
    for number, key in enumerate(keys):
        outcome = replace(left[key][0], every=every)
        if number in points:
            outcome = replace(outcome, shown=tuple(one.hex() for one in points[number][:arity]))
            del left[key]
        outcomes[key] = outcome
    kept = dict(sorted(outcomes.items()))
    write_text(OUTCOMES, _ROWS.dump_json(kept, indent=1).decode() + "\n")


if __name__ == "__main__":
    main()
