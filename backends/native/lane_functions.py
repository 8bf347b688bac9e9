"""Writes the functions for one lane group: start, step, reverse step and reverse start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import assert_never

from backends.c_language.functions import FunctionTable
from backends.c_language.places import ArrayView, Index
from backends.c_language.scope import BlockScope, LocalNames
from backends.c_language.tree import Argument, Binary, Function, Name, Statement
from backends.c_lowering.graph import GraphLowering
from backends.c_lowering.spec_notes import SpecNotes
from backends.c_lowering.sums import sum_along
from backends.c_lowering.values import LocalValues, Value, copy_value
from backends.native.lane_memory import LaneMemory, read_of
from backends.native.loop_splitting import LateAdjoint
from backends.native.tiled_sums import HORIZON, TIME, Factor
from compiler.ir import ops
from compiler.ir.ops import KeptRow, LossScale, NewestSample, StateAdjoint, TrainingValue
from compiler.ir.program import Graph, Node, NodeId, State
from compiler.ir.types import WINDOW, Type

UNROLL = 4
"""Maximum number of elements for which loops are unrolled here; the compiler unrolls longer
ones."""

PARALLEL_SUMS = 4
"""Number of partial sums; 4 hide the latency of a multiply-add (4 cycles on current processors)."""

GRADIENT = "gradient"
PARAMETERS = "theta"


class LaneWriter:
    """Writes one C function of a kernel from a graph: collects statements in `scope`, and gives the
    C places of the signals, states, parameters and adjoints that the graph reads.
    """

    def __init__(self, memory: LaneMemory, graph: Graph, functions: FunctionTable) -> None:
        self.memory = memory
        self.graph = graph
        self.time = Index()
        """Time offset of reads, in samples after the rows that the function receives."""
        # arguments are named first; locals with the same name are renamed
        self.scope = BlockScope(LocalNames("msnn"))
        for tape in (*memory.signals.values(), *memory.buffers.values()):
            self.scope.reserve(tape.name)
            self.scope.reserve(f"d_{tape.name}")
        for name, _ in memory.plain.values():
            for prefix in ("", "d_", "next_"):
                self.scope.reserve(f"{prefix}{name}")
        for tape in (*memory.rows.values(), *memory.late_adjoints.values()):
            self.scope.reserve(tape.name)
        for name in (PARAMETERS, GRADIENT, "scale", "total", "count", "rows", TIME, HORIZON):
            self.scope.reserve(name)
        self.locals = LocalValues(functions, SpecNotes(graph), UNROLL, PARALLEL_SUMS)

    # ---- surroundings of the lowering

    def read(self, op: ops.AnyRead, type: Type) -> ArrayView:
        match op:
            case ops.ReadParameter(name):
                return array(PARAMETERS, type.shape, Index(self.memory.parameters[name]))
            case ops.ReadSignal(name) | ops.ReadLog(name):
                tape = self.memory.signals[name]
                return self._now(read_of(tape, op, type.axes), tape.elements)
            case ops.ReadState(name):
                return self._state(name, type)
            case ops.ReadTraining(value):
                return self._given(value, type)
            case _:
                assert_never(op)

    def push(self, op: ops.Window, newest: ArrayView, scope: BlockScope) -> ArrayView | None:
        """Writes the newest sample of the buffer of `op` to its row after the others, unless it was
        computed there. Returns the place of the window with it.
        """
        tape = self.memory.buffers[op.state]
        count = tape.last + 1
        row = self._now(tape.place(newest.shape, tape.last, None), tape.elements)
        # the step often computes the sample in place
        if row != newest:
            copy_value(newest, row, scope, UNROLL)
        return self._now(tape.place((*newest.shape, count), 0, count), tape.elements)

    def _given(self, value: TrainingValue, type: Type) -> ArrayView:
        match value:
            case LossScale(loss):
                # by index: the caller passes one scale per loss, in this order
                names = [term.loss.name for term in self.memory.step.losses]
                return ArrayView(Name("scale"), (), (), Index(names.index(loss)))
            case KeptRow(node):
                tape = self.memory.rows[node]
                return self._now(array(tape.name, type.shape), tape.elements)
            case NewestSample(buffer):
                tape = self.memory.buffers[buffer]
                return self._now(tape.place(type.shape, tape.last, None), tape.elements)
            case StateAdjoint(state):
                return self._adjoint(state, type)
            case _:
                assert_never(value)

    def _state(self, name: str, type: Type) -> ArrayView:
        buffers, plain = self.memory.buffers, self.memory.plain
        if name in plain:
            return self._now(array(plain[name][0], type.shape), type.size)
        tape = buffers[name]
        return self._now(tape.place(type.shape, 0, type.axes[-1].size), tape.elements)

    def _adjoint(self, name: str, type: Type) -> ArrayView:
        if name in self.memory.plain:
            return array(f"d_next_{self.memory.plain[name][0]}", type.shape)
        tape = self.memory.buffers[name]
        if type.window is not None:  # at t0 all samples of a buffer have adjoints
            return adjoint_of(tape.place(type.shape, 0, type.window))
        return adjoint_of(tape.place(type.shape, tape.last, None))

    def _now(self, place: ArrayView, elements: int) -> ArrayView:
        """A place moved from the row that the function receives to that of the time `self.time`.
        Rows have `elements` elements.
        """
        return replace(place, offset=place.offset.plus(self.time.times(elements)))

    def state_place(self, state: State) -> ArrayView:
        """The place of a state at the time of the function, with all samples of a buffer."""
        return self._state(state.name, Type(state.axes))

    @staticmethod
    def shape(state: State) -> tuple[int, ...]:
        return tuple(axis.size for axis in state.axes)

    # ---- writing

    def lowered(self, *roots: NodeId) -> GraphLowering:
        return GraphLowering(self.graph, roots, self, self.scope, self.locals)

    def add_to(self, lowered: GraphLowering, node: NodeId, target: ArrayView) -> None:
        """Writes target += value of the node, element by element. `lowered` is the lowering that
        has the node as a root.
        """
        self._add_value(lowered.value(node), target)

    def _add_value(self, value: Value, target: ArrayView) -> None:
        def one(indices: tuple[Index, ...], inner: BlockScope) -> None:
            element = target.element(indices)
            term = (
                value.element(indices)
                if isinstance(value, ArrayView)
                else value.make(indices, inner)
            )
            inner.assign(element, Binary("+", element, term))

        self.scope.each(target.shape, UNROLL, one)

    def collect(self, adjoint: LateAdjoint) -> None:
        """Writes statements that add the terms of one late adjoint, stored by the steps at later
        times, to the adjoint of the buffer's newest sample.
        """
        graph, tape = self.graph, self.memory.late_adjoints[adjoint]
        taps = GraphLowering(graph, [adjoint.taps], self, self.scope, self.locals).value(
            adjoint.taps
        )
        type = graph[adjoint.taps].type
        past = tape.place(type.shape, 0, tape.last)
        source = graph[adjoint.source]
        node = Node(ops.Contract(WINDOW), (adjoint.taps, adjoint.source), source.type, source.span)
        value = sum_along(node, WINDOW, [(taps, type), (past, type)], self.locals)
        buffer = self.memory.buffers[adjoint.state]
        newest = adjoint_of(buffer.place(source.type.shape, buffer.last, None))
        self._add_value(value, newest)

    def factors(self, product: Node) -> list[Factor]:
        """The operands of a product or contraction as `Factor`s: each with its places in arrays
        over time at times 0 and 1, whose distance is the stride.
        """
        args = product.args
        until = Graph(self.graph.nodes[: max(args) + 1])
        moved: list[list[ArrayView]] = []
        # lowered at two times: the difference of the places is the stride of rows (`Factor`)
        for time in (0, 1):
            self.time = Index(time)
            lowered = GraphLowering(until, args, self, self.scope, self.locals)
            moved.append([lowered.place(arg, "factor") for arg in args])
        self.time = Index()
        return [
            Factor(first, second, self.graph[arg].type.axis_names)
            for arg, first, second in zip(args, *moved, strict=True)
        ]

    def function(self, name: str, arguments: Sequence[Argument], doc: str) -> Function:
        body: tuple[Statement, ...] = (
            *self.locals.constants(self.scope.statements),
            *self.scope.statements,
        )
        return Function(
            name=name,
            result="void",
            arguments=tuple(arguments),
            body=body,
            doc=doc,
            static=True,
            inline=True,
        )


def array(name: str, shape: tuple[int, ...], offset: Index | None = None) -> ArrayView:
    place = ArrayView.array(Name(name), shape)
    return place if offset is None else ArrayView(place.storage, shape, place.strides, offset)


def adjoint_of(place: ArrayView) -> ArrayView:
    """The place of the adjoints of values in a buffer: the same position in the C array with `d_`
    in front of its name.
    """
    assert isinstance(place.storage, Name)
    return ArrayView(Name(f"d_{place.storage.text}"), place.shape, place.strides, place.offset)
