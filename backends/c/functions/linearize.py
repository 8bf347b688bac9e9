"""Writes the Jacobian of a step in C: checks inputs, writes constants, computes the rest."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from backends.c.functions.function_writer import ControllerCode, FunctionWriter
from backends.c.functions.input_policy import checked_input
from backends.c.functions.state_reports import report_outside, report_unready
from backends.c.interface.jacobian_interface import OUT, JacobianInterface, MatrixField
from backends.c.interface.status import StatusBit
from backends.c_language.places import ArrayView, Index
from backends.c_language.tree import Argument, CType, Declare, Discard, Function, Name, Real, Return
from backends.c_lowering.graph import GraphLowering
from backends.c_lowering.state_memory import DelayLine, PlainState
from compiler.ir.nodes import needed
from compiler.ir.ops import ReadSignal, ReadState
from compiler.ir.program import Graph
from compiler.ir.rules import quotient_unit
from compiler.ir.types import Type
from compiler.jacobian.matrices import Matrix, MatrixBlock, Member, Vector

_FEW = 16
"""Maximum number of constant entries that are written one by one."""


def linearize_function(model: ControllerCode, interface: JacobianInterface) -> Function:
    """The C function `<prefix>_linearize(s, p, u, jac)`: writes the Jacobian of the step at state s
    and inputs u to `jac`, and returns status bits. The state does not change.
    """
    writer = _LinearizeWriter(model, interface)
    writer.begin()
    graph = interface.jacobian.graph
    roots = interface.jacobian.roots
    lowered = GraphLowering(graph, roots, writer, writer.scope, writer.locals)
    for field in interface.fields:
        writer.comment(f"{field.identifier} = {field.comment}")
        for line in pattern_comments(field.matrix):
            writer.comment(line)
        writer.write_known(field)
        for block in field.matrix.blocks:
            writer.comment(entries_comment(field.matrix, block, graph[block.node].type))
            lowered.store(block.node, _entries(field, block, graph))
    writer.report_infinite(graph)
    writer.scope.add(Return(Name("status")))
    prefix = model.interface.prefix
    structs = (
        Argument(f"const {prefix}_in_t *", "u"),
        Argument(f"{prefix}_jacobian_t *", OUT),
    )
    doc = "Computes the slopes of one step in its states and inputs."
    return writer.finished("linearize", f"{prefix}_status_t", structs, doc, reads_only=True)


def _entries(field: MatrixField, block: MatrixBlock, graph: Graph) -> ArrayView:
    """The place in the struct of those entries of a matrix that the node of `block` computes, as a
    view with the node's shape.
    """
    shape = graph[block.node].type.shape
    return ArrayView(field.place.storage, shape, block.strides, Index(block.offset))


class _LinearizeWriter(FunctionWriter):
    def __init__(self, model: ControllerCode, interface: JacobianInterface) -> None:
        super().__init__(model, interface.jacobian.graph)
        graph = interface.jacobian.graph
        live = needed(graph, interface.jacobian.roots)
        ops = [node.op for index, node in graph if live[index]]
        self._states = {op.name for op in ops if isinstance(op, ReadState)}
        self._signals = {op.signal for op in ops if isinstance(op, ReadSignal)}
        self._fields = interface.fields

    def begin(self) -> None:
        """Writes the declaration of the status, the heads of the rings that are read, and the
        checks of the inputs. Policy `hold` stores nothing here.
        """
        interface, scope = self.interface, self.scope
        scope.reserve(OUT)
        if not interface.has_state:
            scope.add(Discard("s"))
        checked = [i for i in interface.inputs if i.port.signal.on_invalid != "trust"]
        if not (self._signals or checked):
            scope.add(Discard("u"))
        if not self._fields:
            scope.add(Discard(OUT))
        ok = Name(f"{interface.prefix.upper()}_OK")
        infinite = any(field.matrix.perhaps_infinite for field in self._fields)
        # otherwise nothing sets a bit
        constant = not (checked or interface.has_state or infinite)
        scope.add(Declare(CType.STATUS, "status", ok, constant=constant))
        for memory in interface.states:
            if not isinstance(memory, PlainState | DelayLine) and memory.state.name in self._states:
                memory.begin(scope)
        report_unready(self)
        if checked:
            self.comment("inputs")
        for input in interface.inputs:
            name = input.port.signal.name
            valid = checked_input(input, self.model.functions, scope, self.unroll, remembers=False)
            self.inputs[name] = valid
            # checked for its status, although no entry reads it
            if name not in self._signals and isinstance(valid.storage, Name):
                scope.add(Discard(valid.storage.text))

    def report_infinite(self, graph: Graph) -> None:
        """Writes checks that set the bit SLOPE_NOT_FINITE if an entry is infinite or NaN, for the
        entries for which that is possible.
        """
        blocks = [(f, block) for f in self._fields for block in f.matrix.perhaps_infinite]
        if blocks:
            self.comment("slopes that can be infinite")
        # larger entries are infinite; NaN is outside of every range
        largest = float(np.finfo(self.interface.options.dtype).max)
        for field, block in blocks:
            place = _entries(field, block, graph)
            report_outside(self, place, (-largest, largest), StatusBit.SLOPE_NOT_FINITE)

    def write_known(self, field: MatrixField) -> None:
        """Writes the entries of a matrix that are the same number for every state and input."""
        known = {i: x for i, x in enumerate(field.matrix.known) if x is not None}
        place, scope = field.place, self.scope
        # if there are many, a loop sets all entries to 0, then the nonzero constants are written
        if len(known) > _FEW:
            with scope.loop(field.matrix.size) as (index, inner):
                inner.assign(place.element([index]), Real(0.0))
            # -0.0 equals 0.0, so +0 from the loop is fine
            known = {i: x for i, x in known.items() if x != 0.0}
        for run in number_runs(known):
            along = ArrayView(place.storage, (run.count,), (run.stride,), Index(run.first))
            scope.each(
                along.shape,
                self.unroll,
                lambda at, inner, run=run, along=along: inner.assign(
                    along.element(at), Real(run.value)
                ),
            )


@dataclass(frozen=True, slots=True)
class NumberRun:
    """`count` equal values at the indices first, first + stride, …; a single value has stride 1."""

    value: float
    first: int
    stride: int
    count: int


def number_runs(numbers: Mapping[int, float]) -> list[NumberRun]:
    """Groups values, given by index, into runs of equal values at equal distances. Runs are in the
    order of their first indices.
    """
    places: dict[float, list[int]] = {}
    for place, value in sorted(numbers.items()):
        places.setdefault(value, []).append(place)
    runs = [run for value, at in places.items() for run in _runs(value, at)]
    return sorted(runs, key=lambda run: run.first)


def _runs(value: float, places: list[int]) -> list[NumberRun]:
    """Splits `places`, the ascending indices of one value, into runs: each is extended while the
    distance stays the same. Two places alone become two runs of one.
    """
    runs: list[NumberRun] = []
    begin = 0
    while begin < len(places):
        end = begin + 1
        stride = places[end] - places[begin] if end < len(places) else 1
        while end < len(places) and places[end] - places[end - 1] == stride:
            end += 1
        if end - begin == 2:
            # two values are always equidistant
            end, stride = begin + 1, 1
        runs.append(NumberRun(value, places[begin], stride, end - begin))
        begin = end
    return runs


_MOST_ROWS, _MOST_COLUMNS = 32, 64
"""Maximum size of a matrix whose pattern is shown; the JSON file has every pattern."""


def pattern_comments(matrix: Matrix) -> Iterator[str]:
    """Comment lines that show the structure of a matrix: a legend, then one line of marks per row
    with the row's name; consecutive equal rows share a line. Nothing for a matrix larger than 32 ×
    64.
    """
    rows, columns = matrix.shape
    if rows > _MOST_ROWS or columns > _MOST_COLUMNS:
        return
    yield ". is always 0, = always the same number, p made of parameters only, * computed"
    names = [name for member in matrix.rows.members for name in _element_names(member)]
    for marks, equal in groupby(range(rows), lambda row: _row_marks(matrix, row)):
        first, *others = equal
        yield f"{marks}  {names[first]}" + (f" .. {names[others[-1]]}" if others else "")


def _row_marks(matrix: Matrix, row: int) -> str:
    columns = matrix.columns.size
    marks = "".join(mark(matrix, row * columns + column) for column in range(columns))
    return " ".join(marks[m.first : m.first + m.size] for m in matrix.columns.members)


def mark(matrix: Matrix, entry: int) -> str:
    """The kind of the entry with this row-major index, as one character: `.` 0, `=` another
    constant, `p` computed from parameters only, `*` computed.
    """
    known = matrix.known[entry]
    if known is not None:
        return "." if known == 0.0 else "="
    return "p" if matrix.fixed[entry] else "*"


def entries_comment(matrix: Matrix, block: MatrixBlock, type: Type) -> str:
    """The C comment on the entries of a matrix that one node, of this type, computes: `d speed / d
    torque [m/s/N/m]`.
    """
    places = block.places(type.shape).ravel()
    row, first = divmod(int(places[0]), matrix.columns.size)
    last = int(places[-1]) % matrix.columns.size
    of, by = _member_at(matrix.rows, row), _member_at(matrix.columns, first)
    unit = quotient_unit(of.unit, by.unit)
    following = "next " if matrix.rows.letter == "x" else ""
    text = f"d {following}{_element_name(of, row)} / d {_element_name(by, first)}"
    if last != first:
        text += f" .. {_element_name(by, last)}"
    return text + (f" [{unit.text}]" if unit is not None else "")


def _member_at(vector: Vector, place: int) -> Member:
    return next(m for m in vector.members if m.first <= place < m.first + m.size)


def _element_name(member: Member, place: int) -> str:
    return f"{member.name}[{place - member.first}]" if member.axes else member.name


def _element_names(member: Member) -> list[str]:
    return [_element_name(member, member.first + number) for number in range(member.size)]
