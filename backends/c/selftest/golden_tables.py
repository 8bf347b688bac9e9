"""Writes C functions with tables of golden values: they load arguments of a step and compare
results.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.c.interface.interface import Field
from backends.c.interface.structs import RESERVED
from backends.c_language import tree as c
from backends.c_language.places import ArrayView, Index, variable
from backends.c_language.scope import BlockScope, LocalNames
from backends.c_lowering.values import copy_value

Array = NDArray[Any]
Column = tuple[Field, Array]
"""A field and its values, with one row per step or run."""

_STEP, _START = "step", "start"


@dataclass(frozen=True, slots=True, kw_only=True)
class GoldenTables:
    """The golden values of all runs, from which C functions with tables are written. Rows of
    inputs, outputs and status are steps, numbered across runs; `number` is the C type of values.
    `start_status` and `status` are the expected status bits of each start and step.
    """

    prefix: str
    number: c.CType
    unroll: int
    """Maximum number of elements that are copied without a loop."""
    starts: Sequence[Column]
    """The arguments of `reset` for each start; the starts of runs come first."""
    written: Sequence[Column]
    """The values that runs write into the state struct; one row for each of the last runs, which
    write."""
    start_status: Sequence[int]
    inputs: Sequence[Column]
    outputs: Sequence[Column]
    status: Sequence[int]
    singles: Sequence[int] = ()
    """Index of the start of each single step; single steps follow the steps of the runs."""

    def functions(
        self, differs: Callable[[c.Expression, c.Expression, Array], c.Expression]
    ) -> tuple[c.Function, ...]:
        """The static C functions of the test program.

        - `<prefix>_load_start(x0, start)` and `_load_inputs(u, step)` fill a struct with golden
          values.
        - `_start_differs(status, start)` and `_results_differ(status, y, step)` compare with them.
        - `_load_state(s, written)` exists if runs write states, `_start_of(single)` if there are
          single steps.

        `differs(actual, expected, values)` gives the C expression that compares an element of a
        column with these golden values.
        """
        state = c.Argument("state", "s")
        written = (self._loader("state", state, self.written, "written"),) if self.written else ()
        singles = (self._start_of(),) if self.singles else ()
        return (
            *written,
            *singles,
            self._loader("start", c.Argument("init", "x0"), self.starts, _START),
            self._start_comparison(),
            self._loader("inputs", c.Argument("in", "u"), self.inputs, _STEP),
            self._comparison(differs),
        )

    def _loader(
        self, name: str, struct: c.Argument, columns: Sequence[Column], row_name: str
    ) -> c.Function:
        """The C function `<prefix>_load_<name>` that copies one row of a table of these columns
        into a struct. `struct` is type and name of the struct argument, `row_name` the name of the
        row argument.
        """
        scope = BlockScope(LocalNames(self.prefix))
        if columns:
            scope.add(self._table(columns))
        else:
            scope.add(c.Discard(row_name))
            # a struct without fields of the spec has one that is reserved: unset memory would be
            # read by copies
            scope.assign(c.Member(struct.name, RESERVED), c.Unsigned(0))
        fields = [field for field, _ in columns]
        for field, row in zip(fields, rows_of("golden", fields, row_name), strict=True):
            copy_value(row, field.place(struct.name), scope, self.unroll)
        arguments = (
            c.Argument(f"{self.prefix}_{struct.type}_t *", struct.name),
            c.Argument("uint32_t", row_name),
        )
        return scope.function(f"{self.prefix}_load_{name}", "void", arguments)

    def _start_of(self) -> c.Function:
        # tables hold floats, which are exact for numbers of steps
        starts = tuple(map(float, self.singles))
        body = (
            c.ConstantTable("golden_start", starts, c.CType.UNSIGNED),
            c.Return(c.Element(c.Name("golden_start"), c.Name("single"))),
        )
        argument = c.Argument("uint32_t", "single")
        return c.Function(
            name=f"{self.prefix}_start_of",
            result="uint32_t",
            arguments=(argument,),
            body=body,
            static=True,
        )

    def _start_comparison(self) -> c.Function:
        bits = tuple(map(float, self.start_status))
        expected = c.Element(c.Name("golden_status"), c.Name(_START))
        body = (
            c.ConstantTable("golden_status", bits, c.CType.UNSIGNED),
            c.Return(c.Binary("!=", c.Name("status"), expected)),
        )
        arguments = (
            c.Argument(f"{self.prefix}_status_t", "status"),
            c.Argument("uint32_t", _START),
        )
        return c.Function(
            name=f"{self.prefix}_start_differs",
            result="bool",
            arguments=arguments,
            body=body,
            static=True,
        )

    def _comparison(
        self, differs: Callable[[c.Expression, c.Expression, Array], c.Expression]
    ) -> c.Function:
        prefix = self.prefix
        scope = BlockScope(LocalNames(prefix))
        # tables hold doubles, in which every word of 32 bits is exact
        bits = tuple(float(status) for status in self.status)
        scope.add(c.ConstantTable("golden_status", bits, c.CType.UNSIGNED))
        if self.outputs:
            scope.add(self._table(self.outputs))
        else:
            scope.add(c.Discard("y"))
        expected = c.Element(c.Name("golden_status"), c.Name(_STEP))
        scope.add(c.Declare(c.CType.BOOL, "differ", c.Binary("!=", c.Name("status"), expected)))
        fields = [field for field, _ in self.outputs]
        for (field, values), row in zip(
            self.outputs, rows_of("golden", fields, _STEP), strict=True
        ):
            compare = _compared(field.place("y"), row, values, differs)
            scope.each(field.shape, self.unroll, compare)
        scope.add(c.Return(c.Name("differ")))
        arguments = (
            c.Argument(f"{prefix}_status_t", "status"),
            c.Argument(f"const {prefix}_out_t *", "y"),
            c.Argument("uint32_t", _STEP),
        )
        return scope.function(f"{prefix}_results_differ", "bool", arguments)

    def _table(self, columns: Sequence[Column]) -> c.ConstantTable:
        """A C table with one row per step or start; a row has all columns one after the other."""
        return c.ConstantTable("golden", numbers_of(columns), self.number, hexadecimal=True)


DIFFER: tuple[c.Statement, ...] = (c.Assign(c.Name("differ"), c.Truth(True)),)
"""The statement for a value that is not as expected."""


def numbers_of(columns: Sequence[Column]) -> tuple[float, ...]:
    """All values of the columns, row by row; within a row, field by field in C order."""
    # C order of each field, so that a row is the struct as the header declares it
    parts = [values.reshape(-1, field.size) for field, values in columns]
    return tuple(np.concatenate(parts, axis=1).ravel().tolist())


def rows_of(table: str, fields: Iterable[Field], row: str) -> list[ArrayView]:
    """Views of the fields in a row of the C array `table`, whose rows have all fields one after the
    other. `row` is the C variable with the number of the row.
    """
    listed = list(fields)
    width = sum(field.size for field in listed)
    # row · width + place: one table for all fields, so that a step's numbers lie together
    begin = variable(row).times(width)
    places: list[ArrayView] = []
    for field in listed:
        place = ArrayView.array(c.Name(table), field.shape)
        places.append(ArrayView(place.storage, place.shape, place.strides, begin))
        begin = begin.plus(Index(field.size))
    return places


def _compared(
    given: ArrayView,
    expected: ArrayView,
    values: Array,
    differs: Callable[[c.Expression, c.Expression, Array], c.Expression],
) -> Callable[[tuple[Index, ...], BlockScope], None]:
    def compare(at: tuple[Index, ...], scope: BlockScope) -> None:
        scope.add(c.If(differs(given.element(at), expected.element(at), values), DIFFER))

    return compare
