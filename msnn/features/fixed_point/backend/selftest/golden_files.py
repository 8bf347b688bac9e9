"""Writes the golden steps of the self-test, and the host test program with its test vectors."""

from __future__ import annotations

from collections.abc import Sequence

from backends.c_language.rendering import render
from msnn.features.fixed_point.backend.names import FixedNames, fixed_printer
from msnn.features.fixed_point.backend.selftest.golden_text import expected_text, golden_functions
from msnn.features.fixed_point.golden.equalities import golden_equalities
from msnn.features.fixed_point.golden.golden import (
    GoldenWords,
    IntegerGoldenStart,
    golden_run,
    golden_starts,
)
from msnn.features.fixed_point.golden.golden_singles import GoldenSingle, golden_singles
from msnn.features.fixed_point.integers.program import IntegerProgram

SELFTEST_STEPS = 16
_STEPS, _SEED, _STARTS_SEED, _LAG = 25, 2, 0, 3
_OPENINGS = (0, 0, 0, 0, 0, 0, 1, 2, 5)
"""For each run, the number of first words outside their ranges. If it is not 0, the past also
contains such words."""
_AFTER_INIT = (2, 0)
"""The same for the runs that start from `init`, without a past. They are the last runs."""
_SELFTEST_OPENING = 2
_FILLED = 90
"""Byte that fills the memory before `reset`. Bytes of 255 would be words of -1, so close to 0 that
a test might miss a missing initialisation."""


def selftest_functions(program: IntegerProgram, names: FixedNames) -> list[str]:
    """The golden steps that are compiled into the code for the target."""
    begun = golden_run(program, SELFTEST_STEPS, 1, opening=_SELFTEST_OPENING, spoiled=0)
    return _golden(program, names, [begun])


def test_texts(program: IntegerProgram, names: FixedNames) -> dict[str, str]:
    """`test/<prefix>_sil.c`, the test vectors that it replays, and the expected output words."""
    prefix = names.prefix
    # the last runs begin at `init`, the others at a drawn past: the template counts them by
    # `from_init`
    begins = enumerate((*_OPENINGS, *_AFTER_INIT))
    drawn = [
        golden_run(
            program,
            _STEPS,
            _SEED + run,
            opening=opening,
            spoiled=run % 2 if opening else None,
            from_init=run >= len(_OPENINGS),
        )
        for run, opening in begins
    ]
    from_init = len(_AFTER_INIT)
    runs = [
        *drawn[:-from_init],
        *golden_equalities(program, _STEPS, _SEED),
        *drawn[-from_init:],
    ]
    starts = golden_starts(program, _STARTS_SEED)
    singles = golden_singles(program, _SEED)
    writes = bool(singles and program.memories)
    vectors = render(
        "vectors.h.j2",
        names,
        "Golden vectors",
        guard=f"{names.macro}_VECTORS_H",
        functions=_golden(program, names, runs, starts, singles),
        runs=len(runs),
        steps=_STEPS,
        singles=len(singles),
        from_init=from_init,
        # every run has a start of its own; those behind them are only judged by the status of
        # `reset`
        starts=len(runs) + len(starts),
        written=0,
        writes=writes,
        tunes=False,
        filled=_FILLED,
        linearized=0,
        hashes=False,
    )
    return {
        f"test/{prefix}_vectors.h": vectors,
        f"test/{prefix}_sil.c": render(
            "main.c.j2",
            names,
            "Test program",
            runs=len(runs),
            from_init=from_init,
            steps=_STEPS,
            singles=len(singles),
            writes=writes,
            count=len(runs) * _STEPS + len(singles),
            lag=_LAG,
        ),
        f"test/{prefix}_expected.txt": expected_text(program, runs, singles),
    }


def _golden(
    program: IntegerProgram,
    names: FixedNames,
    runs: Sequence[GoldenWords],
    starts: Sequence[IntegerGoldenStart] = (),
    singles: Sequence[GoldenSingle] = (),
) -> list[str]:
    functions = golden_functions(program, names, runs, starts, singles)
    return [fixed_printer(program, names).function(function) for function in functions]
