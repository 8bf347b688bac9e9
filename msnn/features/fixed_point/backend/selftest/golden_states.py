"""Writes C that loads the memories before single golden steps and checks those after them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from backends.c.interface.interface import Field
from backends.c.selftest.text.golden_tables import DIFFER, Column, numbers_of, rows_of
from backends.c_language import tree as c
from backends.c_language.places import ArrayView, Index
from backends.c_language.scope import BlockScope, LocalNames
from backends.c_lowering.values import copy_value
from msnn.features.fixed_point.backend.names import FixedNames
from msnn.features.fixed_point.golden.golden_singles import GoldenSingle
from msnn.features.fixed_point.integers.program import IntegerMemory, IntegerProgram

_UNROLL = 4
_STATE, _WRITTEN, _STEP, _SINGLE, _DIFFER = "s", "written", "golden_step", "single", "differ"


def state_functions(
    program: IntegerProgram, names: FixedNames, singles: Sequence[GoldenSingle], first: int
) -> tuple[c.Function, c.Function]:
    """`<prefix>_load_state(s, written)` and `<prefix>_state_differs(s, golden_step)`.

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

    The tables are declared in the scope.
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
