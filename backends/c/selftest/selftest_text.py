"""Writes the self-test, which runs on the microcontroller, and the test program for the PC."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from itertools import product

import numpy as np

from backends.c.functions.function_writer import Weights
from backends.c.interface.interface import Interface
from backends.c.selftest.drawn_inputs import Outside, StartPoint
from backends.c.selftest.golden_jacobian import helper_functions, resumed_step, slopes_function
from backends.c.selftest.golden_text import (
    checksums,
    differs_function,
    golden_functions,
    kernels_function,
    state_function,
)
from backends.c.selftest.golden_vectors import (
    GoldenRun,
    GoldenStart,
    GoldenVectors,
    WrittenNumber,
    golden_runs,
    golden_starts,
    joined,
    written_states,
)
from backends.c.selftest.singles.golden_singles import GoldenSingles, golden_singles
from backends.c_language.literals import Dtype, hex_literal, real_literal
from backends.c_language.printer import Printer
from backends.c_language.rendering import render
from compiler.ir.program import Program
from compiler.ir.scalars import SCALAR_FUNCTIONS
from compiler.kernels.branch_cover import branch_cover
from compiler.kernels.table import evaluate
from compiler.kernels.tables.formats import RealName
from compiler.kernels.tables.telling_arguments import telling_arguments

SELFTEST_STEPS = 16
"""Number of golden steps compiled into the code for the target."""

_LAG = 3
"""Number of steps by which a second instance lags, to detect shared memory."""

_PARTS = 7
_STARTS: tuple[StartPoint | Outside, ...] = (
    *(StartPoint(part, _PARTS) for part in range(_PARTS)),
    *(StartPoint(part, _PARTS, "at") for part in range(_PARTS)),
    *(StartPoint(part, _PARTS, "below") for part in range(_PARTS)),
    "above",
    "below",
    "far above",
    "nan",
)
_OPENINGS = ((1, 1, 0), (3, 3, 1), (5, 5, 4))
"""Runs that start with invalid samples: the part of the ranges, the number of invalid samples, and
the first kind of invalid samples in the past (above the range, below, NaN)."""

_AFTER_INIT = (0, 0, 2, 4)
"""Number of invalid first samples of the runs without a past, which come last."""

FROM_INIT = len(_AFTER_INIT)
"""Number of golden runs without a past."""
_SELFTEST_OPENING = 2
"""Number of invalid first samples of the self-test, for inputs whose policy replaces them."""

_TEST_STEPS = 16
"""Number of golden steps of each run."""

_DIVIDEND, _DIVISOR = 5.0, 3.0
"""In float32 and float64, 5 / 3 differs from 5 times the rounded 1 / 3."""

_SELFTEST_SEED, _TEST_SEED, _STARTS_SEED, _SINGLES_SEED = 1, 2, 0, 5


def selftest_text(
    program: Program, interface: Interface, weights: Weights, kernels: Collection[str]
) -> str:
    """The text of `src/<prefix>_selftest.c`: it checks golden steps, math kernels, vectors, and
    that the compiler keeps the arithmetic. `weights` are physical arrays by name, `kernels` the
    names of the math kernels that the code calls.
    """
    dtype, prefix = interface.options.dtype, interface.prefix
    printer = Printer(prefix, dtype, places_tables=True)
    begin = GoldenRun(_SELFTEST_SEED, opening=_SELFTEST_OPENING, invalid=0)
    (golden,) = golden_runs(program, interface, weights, SELFTEST_STEPS, [begin])
    functions = _golden(interface, [golden])
    jacobian, sample_time = interface.jacobian, program.sample_time
    if (kernels or sample_time is not None or jacobian) and not _compares(interface):
        functions.append(printer.function(differs_function(prefix)))
    if kernels:
        check = kernels_function(prefix, kernel_cases(kernels, dtype))
        functions.append(printer.function(check))
    if jacobian is not None:
        helpers = helper_functions(interface, jacobian, golden, weights)
        functions += [printer.function(function) for function in helpers]
    letters = _letters(interface)
    # 1 + ε' squared is 1 + 2ε' + ε'²: for this ε' the last term is lost when the product is rounded
    small = 2.0**-12 if dtype == "float32" else 2.0**-27
    return render(
        "selftest.c.j2",
        interface,
        "Self-test",
        functions=functions,
        kernels=bool(kernels),
        calibrates=interface.calibrates,
        jacobian=jacobian is not None,
        has_state=interface.has_state,
        hashes=interface.hashes_slopes,
        letters=letters,
        sample_time=None if sample_time is None else real_literal(sample_time, dtype),
        resumed=resumed_step(interface, golden) if _moves_all(interface) else None,
        lag=_LAG,
        steps=SELFTEST_STEPS,
        factor=hex_literal(1.0 + small, dtype),
        square=hex_literal(1.0 + 2.0 * small, dtype),
        # the sum with 1 rounds to it
        large=hex_literal(float(4.0 / np.finfo(dtype).eps), dtype),
        dividend=real_literal(_DIVIDEND, dtype),
        divisor=real_literal(_DIVISOR, dtype),
        quotient=hex_literal(float(np.divide(_DIVIDEND, _DIVISOR, dtype=dtype)), dtype),
        smallest=hex_literal(float(np.finfo(dtype).tiny), dtype),
        half=real_literal(0.5, dtype),
        zero=real_literal(0.0, dtype),
        one=real_literal(1.0, dtype),
    )


def test_texts(program: Program, interface: Interface, weights: Weights) -> dict[str, str]:
    """The test program for the PC, path in the folder → text: `test/<prefix>_sil.c`, the golden
    vectors that it runs, and the status and output bits that it must reproduce. `weights` are
    physical arrays by name.
    """
    prefix = interface.prefix
    runs = _golden_runs(program, interface, weights)
    starts = golden_starts(program, interface, weights, _STARTS_SEED)
    # those whose states begin within their ranges
    begun = [run.start for run in runs[:_PARTS]]
    singles = None
    # single steps show what one bit decides, and only promised bits decide alike everywhere
    if interface.options.is_exact:
        singles = golden_singles(program, interface, weights, begun, _SINGLES_SEED)
    alone = len(singles.starts) if singles else 0
    writes = bool(singles and singles.vectors.written)
    every = [*runs, singles.vectors] if singles else runs
    vectors = render(
        "vectors.h.j2",
        interface,
        "Golden vectors",
        guard=f"{prefix.upper()}_VECTORS_H",
        functions=_golden(interface, runs, starts, singles),
        hashes=interface.hashes_slopes or writes,
        runs=len(runs),
        steps=_TEST_STEPS,
        singles=alone,
        from_init=FROM_INIT,
        tunes=bool(singles and singles.tunes),
        linearized=singles.linearized if singles else 0,
        writes=writes,
        # of reals these bytes make NaN
        filled=255,
        written=sum(bool(run.written) for run in runs),
        starts=len(runs) + len(starts),
    )
    main = render(
        "main.c.j2",
        interface,
        "Test program",
        jacobian=interface.jacobian is not None,
        letters=_letters(interface),
        runs=len(runs),
        from_init=FROM_INIT,
        steps=_TEST_STEPS,
        singles=alone,
        writes=writes,
        count=len(runs) * _TEST_STEPS + alone,
        lag=_LAG,
    )
    return {
        f"test/{prefix}_sil.c": main,
        f"test/{prefix}_vectors.h": vectors,
        f"test/{prefix}_expected.txt": expected_text(interface, every),
    }


def _golden_runs(program: Program, interface: Interface, weights: Weights) -> list[GoldenVectors]:
    """The runs of the test program with these weights (physical arrays by name): from `reset`, some
    with a value written into a state, then from `init`. A run whose written value is an infinite
    one that C may omit from a sum is left out.
    """
    begun: list[tuple[StartPoint | Outside | None, int, int | None, WrittenNumber | None]] = [
        # a seed of its own for each run: none repeats the inputs of another
        *((start, 0, None, None) for start in _STARTS),
        *((StartPoint(part, _PARTS), opening, kind, None) for part, opening, kind in _OPENINGS),
        *(
            (StartPoint(number % _PARTS, _PARTS), 0, number, written)
            for number, written in enumerate(written_states(interface))
        ),
        # last: the test program calls `init` in place of `reset` from a number of runs on
        *((None, opening, None, None) for opening in _AFTER_INIT),
    ]
    runs = [GoldenRun(_TEST_SEED + number, *begin) for number, begin in enumerate(begun)]
    found = golden_runs(program, interface, weights, _TEST_STEPS, runs)
    return [golden for golden in found if golden.promised or not golden.written]


def _letters(interface: Interface) -> list[str]:
    """The letters (x, u, y, p) of the vectors of the Jacobian for which C has copy functions; empty
    without a Jacobian.
    """
    if interface.jacobian is None:
        return []
    return [vector.letter for vector in interface.jacobian.vectors]


def _moves_all(interface: Interface) -> bool:
    """True if the vector x of the Jacobian has all states, including buffers."""
    if "x" not in _letters(interface) or interface.jacobian is None:
        return False
    moved = {member.name for member in interface.jacobian.jacobian.states.members}
    return all(memory.state.name in moved for memory in interface.states)


def _compares(interface: Interface) -> bool:
    """True if the comparison of golden steps calls the C function `<prefix>_differs`."""
    slopes = interface.jacobian is not None and not interface.options.is_exact
    return bool(interface.outputs) or slopes


def _golden(
    interface: Interface,
    runs: Sequence[GoldenVectors],
    starts: Sequence[GoldenStart] = (),
    singles: GoldenSingles | None = None,
) -> list[str]:
    printer = Printer(interface.prefix, interface.options.dtype, places_tables=True)
    functions = [*golden_functions(interface, runs, starts, singles)]
    every = [*runs, singles.vectors] if singles else runs
    if interface.jacobian is not None:
        # else `golden_functions` has it
        if not interface.outputs and _compares(interface):
            functions.insert(0, differs_function(interface.prefix))
        functions.append(slopes_function(interface, interface.jacobian, every))
    if singles and singles.vectors.written:
        functions.append(state_function(interface, singles, len(runs) * _TEST_STEPS))
    return [printer.function(function) for function in functions]


def expected_text(interface: Interface, runs: Sequence[GoldenVectors]) -> str:
    """The text of the file of expected results. A line per step has the status, then the bits of
    each output in hexadecimal digits, or `nan`. If the Jacobian must be exact, its hash ends the
    line. An empty line separates runs.
    """
    # hashed together: one takes as long as all
    lines = _lines(interface, joined(runs))
    ends = np.cumsum([len(run.status) for run in runs]).tolist()
    parts = [lines[begin:end] for begin, end in zip([0, *ends], ends, strict=False)]
    return "\n".join("\n".join(part) + "\n" for part in parts)


def _lines(interface: Interface, golden: GoldenVectors) -> list[str]:
    steps = len(golden.status)
    parts = [golden.outputs[field.name].reshape(steps, -1) for field in interface.outputs]
    rows = np.concatenate(parts, axis=1) if parts else np.empty((steps, 0), np.float32)
    hashed = interface.hashes_slopes
    hashes = checksums(golden.slopes) if hashed else []
    digits = 2 * rows.itemsize
    # decimals would hide the last bit, or take 17 digits to show it
    bits = rows.view(f"u{rows.itemsize}")
    return [
        " ".join(
            [
                f"{golden.status[k]:08x}",
                *(
                    "nan" if nan else f"{word:0{digits}x}"
                    for word, nan in zip(bits[k].tolist(), np.isnan(rows[k]), strict=True)
                ),
                *([f"{hashes[k]:08x}"] if hashed else []),
            ]
        )
        for k in range(steps)
    ]


Case = tuple[tuple[float, ...], float]

_PLACES = (0.03, 0.37, 0.81)
"""Relative positions in the domain."""


def kernel_cases(kernels: Iterable[str], dtype: Dtype) -> dict[str, list[Case]]:
    """Test cases by name of kernel: (arguments, expected result) pairs. The arguments reach every
    branch of the kernel, and some of them reveal a change of each constant in it.
    """
    real = "float" if dtype == "float32" else "double"
    cases: dict[str, list[Case]] = {}
    # sorted, so that the file is deterministic
    for kernel in sorted(kernels):
        plain = plain_points(kernel, real)
        points = np.array([*plain, *telling_arguments(kernel, real, len(plain[0]))], dtype)
        values = evaluate(kernel, *points.T)
        cases[kernel] = [
            (tuple(float(x) for x in point), float(value))
            for point, value in zip(points, values, strict=True)
        ]
    return cases


def plain_points(kernel: str, real: RealName) -> list[tuple[float, ...]]:
    """Argument tuples within the domain of a kernel, and one on every branch of its code. `real` is
    the C type, `float` or `double`.
    """
    domains = {row.kernel: row.domain for row in SCALAR_FUNCTIONS.values() if row.kernel}
    axes = [[low + (high - low) * place for place in _PLACES] for low, high in domains[kernel]]
    return [*product(*axes), *branch_cover(kernel, real)]
