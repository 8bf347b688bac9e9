"""Writes golden vectors as C functions, which feed the step and compare its results and states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.interface.interface import Interface
from backends.c.selftest.golden_tables import DIFFER, Array, GoldenTables
from backends.c.selftest.golden_vectors import GoldenStart, GoldenVectors, joined, state_fields
from backends.c.selftest.singles.golden_singles import GoldenSingles
from backends.c_language import tree as c
from backends.c_language.functions import is_nan
from backends.c_language.places import ArrayView, Index
from backends.c_language.scope import BlockScope, LocalNames


def golden_functions(
    interface: Interface,
    runs: Sequence[GoldenVectors],
    starts: Sequence[GoldenStart] = (),
    singles: GoldenSingles | None = None,
) -> tuple[c.Function, ...]:
    """The C functions that load golden values and compare results with them (see
    `GoldenTables.functions`), after the function that compares two values. `starts` test only the
    status of `reset`; in tables they follow the starts of the runs. `singles` are independent
    steps, None if there are none.
    """
    prefix = interface.prefix
    golden = joined([*runs, singles.vectors] if singles else runs)
    every = [*(run.start for run in runs), *starts]
    given = [
        (f, np.stack([start.windows[f.name] for start in every])) for f, _ in interface.windows
    ]
    given += [
        (f, np.stack([start.supplied[f.name] for start in every])) for f, _ in interface.supplied
    ]
    written = [run.written for run in runs if run.written]
    if singles:
        own = singles.vectors.written
        count = len(singles.starts)
        written += [{name: values[k] for name, values in own.items()} for k in range(count)]
    fields = state_fields(interface) if written else ()
    tables = GoldenTables(
        prefix=prefix,
        number=c.CType.REAL,
        unroll=interface.options.unroll,
        starts=given,
        start_status=[int(start.status) for start in every],
        written=[(f, np.stack([states[f.name] for states in written])) for f in fields],
        inputs=[(input.field, golden.inputs[input.field.name]) for input in interface.inputs],
        outputs=[(field, golden.outputs[field.name]) for field in interface.outputs],
        status=[int(status) for status in golden.status],
        singles=singles.starts if singles else (),
    )

    tuned = (_tune_function(interface, singles.tuned),) if singles and singles.tunes else ()

    def differs(given: c.Expression, expected: c.Expression, values: Array) -> c.Expression:
        allowed = c.Real(tolerance(interface, values))
        return c.Call(f"{prefix}_differs", (given, expected, allowed))

    known = (differs_function(prefix),) if interface.outputs else ()
    return (*known, *tables.functions(differs), *tuned)


def _tune_function(interface: Interface, tuned: Sequence[Mapping[int, float]]) -> c.Function:
    """The C function `<prefix>_tune(numbers, single)`: writes the changed parameters of a single
    step into the array `numbers` of all parameters. `tuned` has, for each single step, new values
    by index.
    """
    scope = BlockScope(LocalNames(interface.prefix))
    for name in ("numbers", "single"):
        scope.reserve(name)
    listed = [(k, place, x) for k, own in enumerate(tuned) for place, x in own.items()]
    columns = [tuple(map(float, column)) for column in zip(*listed, strict=True)]
    scope.add(c.ConstantTable("golden_single", columns[0], c.CType.UNSIGNED))
    scope.add(c.ConstantTable("golden_place", columns[1], c.CType.UNSIGNED))
    scope.add(c.ConstantTable("golden_number", columns[2], hexadecimal=True))
    with scope.loop(len(listed)) as (index, inner):
        at = index.expression()
        own = c.Binary("==", c.Element(c.Name("golden_single"), at), c.Name("single"))
        place = c.Element(c.Name("numbers"), c.Element(c.Name("golden_place"), at))
        inner.add(c.If(own, (c.Assign(place, c.Element(c.Name("golden_number"), at)),)))
    real = f"{interface.prefix}_real *"
    arguments = (c.Argument(real, "numbers"), c.Argument("uint32_t", "single"))
    name = f"{interface.prefix}_tune"
    return scope.function(name, "void", arguments)


def differs_function(prefix: str) -> c.Function:
    """The C function `<prefix>_differs(x, expected, tolerance)`: true if |x − expected| >
    tolerance. NaN equals NaN, and an infinity equals the same infinity.
    """
    x, expected, tolerance = c.Name("x"), c.Name("expected"), c.Name("tolerance")
    near = c.Binary(
        "&&",
        c.Binary("<=", c.Binary("-", x, expected), tolerance),
        c.Binary("<=", c.Binary("-", expected, x), tolerance),
    )
    parts = {
        "within": near,
        # ∞ - ∞ is NaN and within nothing; two relations, as -Wfloat-equal warns of ==
        "equal": c.Binary("&&", c.Binary("<=", x, expected), c.Binary(">=", x, expected)),
        "both_nan": c.Binary("&&", is_nan(x), is_nan(expected)),
    }
    fine = c.Binary("||", c.Binary("||", c.Name("within"), c.Name("equal")), c.Name("both_nan"))
    body = (
        *(c.Declare(c.CType.BOOL, name, value, constant=True) for name, value in parts.items()),
        c.Return(c.Unary("!", fine)),
    )
    real = f"{prefix}_real"
    arguments = tuple(c.Argument(real, name) for name in ("x", "expected", "tolerance"))
    return c.Function(
        name=f"{prefix}_differs", result="bool", arguments=arguments, body=body, static=True
    )


def tolerance(interface: Interface, values: Array) -> float:
    """The absolute tolerance of comparisons with these golden values: 0 if C must give the same
    bits as the interpreter, otherwise relative to the largest value (at least 1). In float64 the
    interpreter calls numpy's functions and the C code another library. Their last digits differ,
    and the difference grows over a run.
    """
    options = interface.options
    if options.is_exact:
        return 0.0
    finite = np.abs(values[np.isfinite(values)])
    scale = max(1.0, float(finite.max())) if finite.size else 1.0
    return scale * (1e-9 if options.dtype == "float64" else 1e-3)


def kernels_function(
    prefix: str, cases: Mapping[str, Sequence[tuple[tuple[float, ...], float]]]
) -> c.Function:
    """The C function `<prefix>_kernels_differ()`: true if a math kernel gives other bits than
    expected. `cases` are (arguments, result) pairs by name of kernel.
    """

    def reciprocal(x: c.Expression) -> c.Expression:
        return c.Binary("/", c.Real(1.0), x)

    scope = BlockScope(LocalNames(prefix))
    scope.reserve("differ")
    scope.add(c.Declare(c.CType.BOOL, "differ", c.Truth(False)))
    for kernel, rows in cases.items():
        table = scope.fresh(f"golden_{kernel}")
        numbers = tuple(x for arguments, value in rows for x in (*arguments, value))
        width = len(numbers) // len(rows)
        scope.add(c.ConstantTable(table, numbers, hexadecimal=True))
        with scope.loop(len(rows)) as (index, inner):
            begin = index.times(width)
            row = [
                c.Element(c.Name(table), begin.plus(Index(n)).expression()) for n in range(width)
            ]
            value = inner.constant("value", c.Call(f"{prefix}_{kernel}", tuple(row[:-1])))
            # -0 is within 0 of 0; their reciprocals are infinities of both signs
            both = ((value, row[-1]), (reciprocal(value), reciprocal(row[-1])))
            numbers, signs = (c.Call(f"{prefix}_differs", (*two, c.Real(0.0))) for two in both)
            inner.add(c.If(c.Binary("||", numbers, signs), DIFFER))
    scope.add(c.Return(c.Name("differ")))
    return scope.function(f"{prefix}_kernels_differ", "bool", ())


_STATE, _STEP, _HASH = "s", "golden_step", "hash"


def state_function(interface: Interface, singles: GoldenSingles, first: int) -> c.Function:
    """The C function `<prefix>_state_differs(s, golden_step)`: true if the states after a single
    step are wrong. In a golden run, later steps reveal wrong states. A single step has no later
    step, so its states are compared by a hash. `first` is the number of the first single step,
    after those of the runs.
    """
    prefix, fields = interface.prefix, state_fields(interface)
    scope = BlockScope(LocalNames(prefix))
    for name in (_STEP, _HASH):
        scope.reserve(name)
    scope.add(c.If(c.Binary("<", c.Name(_STEP), c.Unsigned(first)), (c.Return(c.Truth(False)),)))
    hashes = checksums({field.name: singles.vectors.states[field.name] for field in fields})
    scope.add(c.ConstantTable("golden_hash", tuple(map(float, hashes)), c.CType.UNSIGNED))
    scope.add(c.Declare(c.CType.UNSIGNED, _HASH, c.Unsigned(START)))
    for field in fields:
        place = field.place(_STATE)

        def add(at: tuple[Index, ...], inner: BlockScope, place: ArrayView = place) -> None:
            called = c.Call(f"{prefix}_hashed", (c.Name(_HASH), place.element(at)))
            inner.add(c.Assign(c.Name(_HASH), called))

        scope.each(field.shape, interface.options.unroll, add)
    expected = c.Element(c.Name("golden_hash"), c.Binary("-", c.Name(_STEP), c.Unsigned(first)))
    scope.add(c.Return(c.Binary("!=", c.Name(_HASH), expected)))
    arguments = (c.Argument(f"const {prefix}_state_t *", _STATE), c.Argument("uint32_t", _STEP))
    return scope.function(f"{prefix}_state_differs", "bool", arguments)


START, _FACTOR, _DIGITS = 2166136261, 16777619, 15
"""FNV-1a in 32 bits (Fowler, Noll, Vo 1991), and a shift by which the hash is mixed after each
word. Without it the top bit affects no other bit, so that two changed signs would cancel."""


def checksums(matrices: Mapping[str, NDArray[Any]]) -> list[int]:
    """A hash for each step: mixed FNV-1a of the float32 words of all matrices (steps, …), in the
    order of the struct. All NaN are equal, as are both zeros: C omits terms that are 0, which
    affects the sign of zero sums.
    """
    steps = len(next(iter(matrices.values())))
    parts = [matrix.reshape(steps, -1) for matrix in matrices.values()]
    entries = np.concatenate(parts, axis=1).astype(np.float32)
    # processors differ in the sign and payload of NaN
    entries[np.isnan(entries)] = np.float32(np.nan)
    entries[entries == 0.0] = np.float32(0.0)
    hashes = np.full(steps, START, np.uint64)
    for word in entries.view(np.uint32).astype(np.uint64).T:
        hashes = ((hashes ^ word) * np.uint64(_FACTOR)) & np.uint64(0xFFFFFFFF)
        hashes ^= hashes >> np.uint64(_DIGITS)
    return [int(value) for value in hashes]
