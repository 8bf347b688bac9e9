"""Converts a program to step form: replaces windows over inputs by buffers, so that each step reads
every input exactly once.
"""

from __future__ import annotations

from dataclasses import replace

from compiler.ir.builder import GraphBuilder, copy_node, samples, with_start, with_step
from compiler.ir.nodes import Extent, extents
from compiler.ir.ops import ReadLog, ReadSignal, Window
from compiler.ir.program import History, Node, NodeId, Program, Signal, State
from compiler.ir.types import WINDOW, Axis, Type
from spec_schema.late_dataclass import dataclass


def to_step_form(program: Program, late: int = 0) -> Program:
    """Converts to step form: inputs are ports, and buffer states store their past.

    An input read at t+a … t+b becomes one read of t+newest … t+max(b, newest), newest = min(b, 0):
    the current sample, a preview, or (b < 0) one delayed sample. The newest − a samples before it
    are in the buffer `<input>.history`, whose start is read from the log.

    With `late` = d the step at t computes that of the sample t-d: all reads are d samples earlier.
    The newest sample of a port does not change; a preview is d samples shorter.

    Before: any reads; unused nodes should be removed, since their reads would enlarge buffers.
    After: one `ReadSignal` per signal. Losses and `ReadLog` change only by `late`. Example, before
    and after:

        %0: [t=3] = signal(x, -2, 0)

        %0: scalar = signal(x, 0, 0)
        %1: [t=3] = window(x.history, %0)
    """
    reads = extents(program.step, log=False)
    ports = {name: _Port.of(program.signal(name), extent, late) for name, extent in reads.items()}
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    for index, node in program.step:
        if isinstance(node.op, ReadSignal):
            with builder.at(node.span):
                copy = ports[node.op.signal].read(builder, node.op, node)
            # the label stays if the value is still the same, not a longer window
            if node.label is not None and builder.type(copy) == node.type:
                builder.name(copy, node.label)
        else:
            args = tuple(copies[arg] for arg in node.args)
            copy = copy_node(builder, _earlier(node, late), args)
        copies[index] = copy
    if late:
        program = _started(program, late)
    starts = GraphBuilder(program.start)
    # after all reads, which share the window of the buffer
    buffers = [port.state(builder, starts) for port in ports.values() if port.length]
    program = with_step(program, builder.graph(), copies)
    states = (*program.states, *buffers)
    return replace(program, states=states, start=starts.graph(), late=late)


def _started(program: Program, late: int) -> Program:
    """The program with a start that reads the log `late` samples earlier."""
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    for index, node in program.start:
        args = tuple(copies[arg] for arg in node.args)
        copies[index] = copy_node(builder, _earlier(node, late), args)
    return with_start(program, builder.graph(), copies)


def _earlier(node: Node, late: int) -> Node:
    """A `ReadLog` node that reads `late` samples earlier; any other node unchanged."""
    if not isinstance(node.op, ReadLog):
        return node
    op = node.op
    return replace(node, op=ReadLog(op.signal, op.first - late, op.last - late))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Port:
    signal: Signal
    newest: int
    last: int
    length: int
    """Samples in the buffer, 0 for none."""
    late: int
    """Samples by which the step form reads earlier than the window form."""

    @staticmethod
    def of(signal: Signal, extent: Extent, late: int) -> _Port:
        # an input that is read only up to t−2 is a port with that lag (R13); a preview starts
        # at sample t
        newest = min(extent.last, 0)
        first, last = extent.first - late, extent.last - late
        return _Port(
            signal=signal,
            newest=newest,
            last=max(last, newest),
            length=max(newest - first, 0),
            late=late,
        )

    @property
    def _sample(self) -> Type:
        return Type(self.signal.axes, self.signal.unit)

    @property
    def _buffer_name(self) -> str:
        return f"{self.signal.name}.history"

    def _windowed(self, size: int) -> Type:
        return self._sample.with_axes((*self.signal.axes, Axis(WINDOW, size)))

    def read(self, builder: GraphBuilder, op: ReadSignal, node: Node) -> NodeId:
        """The node that replaces `node`, one read `op` of the input in window form."""
        first, last = op.first - self.late, op.last - self.late
        if first == last == self.newest:
            return builder.reshape(self._newest(builder), node.type.axes)
        if last <= self.newest:
            value, oldest = self._past(builder), self.newest - self.length
        elif first >= self.newest:
            value, oldest = self._preview(builder), self.newest
        else:
            # the newest sample is in both the window and the preview: drop one
            coming = builder.slice(self._preview(builder), WINDOW, 1, self.last + 1)
            value = builder.concat([self._past(builder), coming], WINDOW)
            oldest = self.newest - self.length
        return samples(builder, value, oldest, (first, last), node)

    def _preview(self, builder: GraphBuilder) -> NodeId:
        size = self.last - self.newest + 1
        return builder.signal(self.signal.name, self.newest, self.last, self._windowed(size))

    def _newest(self, builder: GraphBuilder) -> NodeId:
        if self.last == self.newest:
            return builder.signal(self.signal.name, self.newest, self.newest, self._sample)
        return builder.element(self._preview(builder), WINDOW, 0)

    def _past(self, builder: GraphBuilder) -> NodeId:
        """The node of the samples t+newest−length … t+newest: those in the buffer and the newest
        one.
        """
        newest = self._newest(builder)
        if not self.length:
            return builder.reshape(newest, self._windowed(1).axes)
        return builder.emit(Window(self._buffer_name), (newest,), self._windowed(self.length + 1))

    def state(self, builder: GraphBuilder, starts: GraphBuilder) -> State:
        """The state that is the buffer of the samples before the newest one. `builder` is that of
        the step, `starts` that of the start.
        """
        kept = builder.slice(self._past(builder), WINDOW, 1, self.length + 1)
        first, last = self.newest - self.length, self.newest - 1
        start = starts.log(self.signal.name, first, last, self._windowed(self.length))
        return State(
            self._buffer_name,
            self._windowed(self.length).axes,
            self.signal.unit,
            History(self.signal.name),
            next=kept,
            start=start,
            range=self.signal.range,
            doc=self.signal.doc,
            span=self.signal.span,
        )
