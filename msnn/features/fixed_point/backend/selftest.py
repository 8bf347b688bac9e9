"""Writes golden steps in fixed point for the self-test and for the test program on the host."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from backends.c.interface.interface import Field
from backends.c.selftest.golden_tables import (
    DIFFER,
    Array,
    Column,
    GoldenTables,
    numbers_of,
    rows_of,
)
from backends.c_language import tree as c
from backends.c_language.places import ArrayView, Index
from backends.c_language.rendering import render
from backends.c_language.scope import BlockScope, LocalNames
from backends.c_language.tree import Binary, CType, Expression, Function
from backends.c_lowering.values import copy_value
from msnn.features.fixed_point.backend.structs import FixedNames, fixed_printer
from msnn.features.fixed_point.golden.equalities import golden_equalities
from msnn.features.fixed_point.golden.golden import (
    GoldenWords,
    IntegerGoldenStart,
    golden_run,
    golden_starts,
)
from msnn.features.fixed_point.golden.golden_singles import GoldenSingle, golden_singles
from msnn.features.fixed_point.integers.program import IntegerMemory, IntegerProgram, WordPort

_UNROLL = 4
_STATE, _WRITTEN, _STEP, _SINGLE, _DIFFER = "s", "written", "golden_step", "single", "differ"


def state_functions(
    program: IntegerProgram, names: FixedNames, singles: Sequence[GoldenSingle], first: int
) -> tuple[c.Function, c.Function]:
    """The C functions `<prefix>_load_state(s, written)` and `<prefix>_state_differs(s,
    golden_step)`, which write and compare the memories of single golden steps.

    In a golden run, later steps reveal a wrong memory. A single step has no later step, so its
    memories are compared directly; single steps start at index `first`.
    """
    before = [single.memories for single in singles]
    after = [single.following for single in singles]
    state = f"{names.prefix}_state_t *"
    load = BlockScope(LocalNames(names.prefix))
    for name in (_WRITTEN, "words", "sums"):
        load.reserve(name)
    for place, row in _rows(program, names, before, _WRITTEN, load):
        copy_value(row, place, load, _UNROLL)
    differs = BlockScope(LocalNames(names.prefix))
    for name in (_STEP, _SINGLE, _DIFFER, "words", "sums"):
        differs.reserve(name)
    before_singles = c.Binary("<", c.Name(_STEP), c.Unsigned(first))
    differs.add(c.If(before_singles, (c.Return(c.Truth(False)),)))
    single = c.Binary("-", c.Name(_STEP), c.Unsigned(first))
    differs.add(c.Declare(c.CType.UNSIGNED, _SINGLE, single, constant=True))
    differs.add(c.Declare(c.CType.BOOL, _DIFFER, c.Truth(False)))
    for place, row in _rows(program, names, after, _SINGLE, differs):

        def compare(
            at: tuple[Index, ...], scope: BlockScope, place: ArrayView = place, row: ArrayView = row
        ) -> None:
            scope.add(c.If(c.Binary("!=", place.element(at), row.element(at)), DIFFER))

        differs.each(place.shape, _UNROLL, compare)
    differs.add(c.Return(c.Name(_DIFFER)))
    return (
        load.function(
            f"{names.prefix}_load_state",
            "void",
            (c.Argument(state, _STATE), c.Argument("uint32_t", _WRITTEN)),
        ),
        differs.function(
            f"{names.prefix}_state_differs",
            "bool",
            (c.Argument(f"const {state}", _STATE), c.Argument("uint32_t", _STEP)),
        ),
    )


def _rows(
    program: IntegerProgram,
    names: FixedNames,
    steps: Sequence[Mapping[str, Sequence[int]]],
    row: str,
    scope: BlockScope,
) -> list[tuple[ArrayView, ArrayView]]:
    """Pairs of views: each memory in the struct, and the same memory in a row of the tables.

    `steps` are the words of the memories by name, one mapping per table row; `row` is the C name of
    the row's index. The tables are declared in the scope.
    """
    found: list[tuple[ArrayView, ArrayView]] = []
    for table, type, wide in (("words", c.CType.WORD, False), ("sums", c.CType.SUM, True)):
        columns: list[Column] = [
            (
                _field(memory, names),
                np.array([step[memory.name] for step in steps], np.int64),
            )
            for memory in program.memories
            if memory.wide == wide
        ]
        if not columns:
            continue
        scope.add(c.ConstantTable(table, numbers_of(columns), type, hexadecimal=True))
        fields = [field for field, _ in columns]
        places = [field.place(_STATE) for field in fields]
        found += zip(places, rows_of(table, fields, row), strict=True)
    return found


def _field(memory: IntegerMemory, names: FixedNames) -> Field:
    return Field(
        name=memory.name,
        identifier=names.memories[memory.name],
        axes=memory.axes,
        unit=memory.unit,
        comment="",
    )


def golden_functions(
    program: IntegerProgram,
    names: FixedNames,
    runs: Sequence[GoldenWords],
    starts: Sequence[IntegerGoldenStart] = (),
    singles: Sequence[GoldenSingle] = (),
) -> tuple[Function, ...]:
    """The C functions that replay golden steps from tables; output words must be exactly equal.

    The tables contain first the starts of the runs, then the starts that check only the status of
    `reset`. Single steps, each with its own memories, follow the steps of the runs.
    """

    def differs(given: Expression, expected: Expression, values: Array) -> Expression:
        return Binary("!=", given, expected)

    steps = [*(step for run in runs for step in run.inputs), *(s.inputs for s in singles)]
    answers = [*(step for run in runs for step in run.outputs), *(s.outputs for s in singles)]
    every = [*(run.start for run in runs), *starts]
    tables = GoldenTables(
        prefix=names.prefix,
        number=CType.WORD,
        unroll=_UNROLL,
        starts=[
            _column(port, names.windows[port.name], (start.windows[port.name] for start in every))
            for port in program.windows
        ],
        start_status=[start.status for start in every],
        written=(),
        inputs=[
            _column(e.port, names.inputs[e.port.name], (step[e.port.name] for step in steps))
            for e in program.inputs
        ],
        outputs=[
            _column(port, names.outputs[port.name], (answer[port.name] for answer in answers))
            for port, _ in program.outputs
        ],
        status=[*(bits for run in runs for bits in run.status), *(s.status for s in singles)],
        # the memories are written over whatever reset gives
        singles=[0] * len(singles),
    )
    written = _written(program, names, singles, sum(len(run.status) for run in runs))
    return (*tables.functions(differs), *written)


def _written(
    program: IntegerProgram, names: FixedNames, singles: Sequence[GoldenSingle], first: int
) -> tuple[Function, ...]:
    there = singles and program.memories
    return state_functions(program, names, singles, first) if there else ()


def expected_text(
    program: IntegerProgram, runs: Sequence[GoldenWords], singles: Sequence[GoldenSingle]
) -> str:
    """The expected results as text: one line per step with the status, then each output word, in
    hexadecimal digits; a blank line between runs.
    """
    # two's complement, as C prints the word as unsigned: Python would write a minus sign
    digits = program.width.word // 4
    mask = 2**program.width.word - 1
    blocks: list[str] = []
    answered = [[*zip(run.status, run.outputs, strict=True)] for run in runs]
    if singles:
        answered.append([(single.status, single.outputs) for single in singles])
    for steps in answered:
        lines: list[str] = []
        for status, answer in steps:
            words = [word for port, _ in program.outputs for word in answer[port.name]]
            lines.append(" ".join([f"{status:08x}", *(f"{w & mask:0{digits}x}" for w in words)]))
        blocks.append("\n".join(lines) + "\n")
    return "\n".join(blocks)


def _column(port: WordPort, field: str, rows: Iterable[Sequence[int]]) -> Column:
    return Field(
        name=port.name, identifier=field, axes=port.axes, unit=port.unit, comment=""
    ), np.array(list(rows), np.int64)


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
    """The texts of the C functions with the golden steps of the self-test, which is compiled into
    the code for the target.
    """
    begun = golden_run(program, SELFTEST_STEPS, 1, opening=_SELFTEST_OPENING, spoiled=0)
    return _golden(program, names, [begun])


def test_texts(program: IntegerProgram, names: FixedNames) -> dict[str, str]:
    """The files of the test on the host, by path: the program `test/<prefix>_sil.c`, the vectors
    that it replays, and the expected output words.
    """
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
