"""Writes golden steps of fixed point as C and as text: input words and expected output words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from backends.c.interface.interface import Field
from backends.c.selftest.text.golden_tables import Array, Column, GoldenTables
from backends.c_language.tree import Binary, CType, Expression, Function
from msnn.features.fixed_point.backend.names import FixedNames
from msnn.features.fixed_point.backend.selftest.golden_states import state_functions
from msnn.features.fixed_point.golden.golden import GoldenWords, IntegerGoldenStart
from msnn.features.fixed_point.golden.golden_singles import GoldenSingle
from msnn.features.fixed_point.integers.program import IntegerProgram, WordPort

_UNROLL = 4
"""Maximum number of elements copied by separate statements."""


def golden_functions(
    program: IntegerProgram,
    names: FixedNames,
    runs: Sequence[GoldenWords],
    starts: Sequence[IntegerGoldenStart] = (),
    singles: Sequence[GoldenSingle] = (),
) -> tuple[Function, ...]:
    """Prints `GoldenTables` as C functions; words must be exactly equal.

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
    """One line per step: the status, then each word, in hexadecimal digits."""
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
