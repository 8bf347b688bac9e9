"""Closes loops: replaces inputs that the step reads from the log by the outputs that predict them
(rule R4 of the language).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from enum import Enum

from compiler.ir.builder import GraphBuilder, copy_node, samples, with_step
from compiler.ir.nodes import CycleError, evaluation_order
from compiler.ir.nodes import extents as extents_of
from compiler.ir.ops import ReadSignal, Relation, Window
from compiler.ir.program import (
    LayerMemory,
    Node,
    NodeId,
    Output,
    Program,
    Role,
    Signal,
    State,
    Tape,
)
from compiler.ir.types import WINDOW, Axis, Type
from spec_schema.diagnostics.source import Span
from spec_schema.late_dataclass import dataclass


class LoopFault(Enum):
    """The reason why a loop cannot be closed; the value of each member is a clause for messages."""

    UNKNOWN = "the program has no input of this name"
    UNPREDICTED = "no output predicts it"
    PREDICTED_TWICE = "more than one output predicts it"
    AXES = "the output that predicts it has other axes"
    FUTURE = "a sample is read that no output has predicted yet"
    CYCLE = "its value depends on itself within one step"


class LoopError(Exception):
    """Raised for a loop that cannot be closed. It has the reason, the input, its place in the spec,
    and the names of the values on a cycle, if there is one.
    """

    def __init__(
        self,
        kind: LoopFault,
        signal: str,
        cycle: tuple[str, ...] = (),
        span: Span | None = None,
    ) -> None:
        through = f" ({' -> '.join(cycle)})" if cycle else ""
        super().__init__(f"`{signal}`: {kind.value}{through}")
        self.kind = kind
        self.signal = signal
        self.cycle = cycle
        self.span = span

    @property
    def reason(self) -> str:
        """The reason as a clause for messages, followed by the names of the values on the cycle."""
        through = f" ({' → '.join(self.cycle)})" if self.cycle else ""
        return f"{self.kind.value}{through}"


WARM_UP = "warm-up"
"""Name of the state that counts down the steps of the warm-up, in which the log is read."""


def close_loop(program: Program, signals: Iterable[str], warm_up: int = 0) -> Program:
    """Closes the loops of the named inputs: the step reads their predictions instead of the log.

    Let an output o predict the input s k samples ahead. Samples of s up to t+k−1 come from the
    buffer `<s>.tape`, which starts from the log and to which every step appends o. For k = 0 the
    sample t is the value of o in the same step. In the first `warm_up` steps of a run the recorded
    sample replaces o; a state counts these steps.

    Before: window form. After: window form; no `ReadSignal` of the closed inputs, which are now
    targets. Losses and `ReadLog` do not change. Raises LoopError if a loop cannot be closed.
    Example, before and after:

        %0: [t=3] = signal(x, -2, 0)              # output y predicts x[t+1]

        %0: [t=3] = state(x.tape)                 # next: window(x.tape, y)[t, 1:4]
    """
    loops = _loops(program, signals, warm=warm_up > 0)
    feeds: dict[NodeId, NodeId] = {}
    for index, node in program.step:
        if isinstance(node.op, ReadSignal) and node.op.signal in loops:
            loop = loops[node.op.signal]
            # at t the tape ends with sample t+ahead−1, the newest predicted one
            if node.op.last > max(loop.ahead - 1, 0):
                raise LoopError(LoopFault.FUTURE, node.op.signal, span=node.span)
            if loop.ahead == 0 and node.op.last == 0:
                feeds[index] = loop.output.node
    try:
        # a prediction for t itself is an edge from the output to its reader: the nodes may need
        # another order, and a cycle of such edges has none
        order = evaluation_order(program.step, feeds)
    except CycleError as error:
        raise _cycle_error(program, error) from error

    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    for index in order:
        node = program.step[index]
        if isinstance(node.op, ReadSignal) and node.op.signal in loops:
            with builder.at(node.span):
                copies[index] = loops[node.op.signal].read(builder, node.op, node, copies)
        else:
            copies[index] = copy_node(builder, node, tuple(copies[arg] for arg in node.args))
    starts = GraphBuilder(program.start)
    # a pure feed-through needs no tape
    tapes = [loop.state(builder, starts, copies) for loop in loops.values() if loop.length]
    # a closed input becomes a target: losses compare with its log (R6), the step does not read it
    listed = tuple(replace(s, role=Role.TARGET) if s.name in loops else s for s in program.signals)
    counts = [_countdown(builder, starts, warm_up)] if loops and warm_up else []
    program = with_step(program, builder.graph(), copies)
    states = (*program.states, *tapes, *counts)
    return replace(program, signals=listed, states=states, start=starts.graph())


@dataclass(frozen=True, slots=True, kw_only=True)
class _Loop:
    signal: Signal
    output: Output
    ahead: int
    first: int
    """The oldest sample that the step reads, relative to t."""
    warm: bool
    """True if the log replaces the output during the warm-up."""

    @property
    def length(self) -> int:
        """Number of samples in the buffer: those of t+first … t+ahead−1. It is 0 if the step reads
        only the sample that an output of the same step gives.
        """
        return self.ahead - self.first

    @property
    def _tape_name(self) -> str:
        return f"{self.signal.name}.tape"

    def _windowed(self, size: int) -> Type:
        return Type((*self.signal.axes, Axis(WINDOW, size)), self.signal.unit)

    def read(
        self, builder: GraphBuilder, op: ReadSignal, node: Node, copies: dict[NodeId, NodeId]
    ) -> NodeId:
        # k = 0 and only s[t] is read: the output itself
        if self.ahead == op.first == op.last == 0:
            return builder.reshape(self._predicted(builder, copies), node.type.axes)
        # k = 0 with past samples: the tape ends at t−1, and the output of this step follows
        if self.ahead == op.last == 0:
            value = self._with_prediction(builder, copies)
        else:
            value = builder.state(self._tape_name, self._windowed(self.length))
        return samples(builder, value, self.first, (op.first, op.last), node)

    def _predicted(self, builder: GraphBuilder, copies: dict[NodeId, NodeId]) -> NodeId:
        axes = self.signal.axes
        predicted = builder.broadcast(copies[self.output.node], axes)
        if not self.warm:
            return predicted
        # the state counts the remaining steps
        lasts = builder.compare(
            Relation.LESS, builder.constant(0.0), builder.state(WARM_UP, Type())
        )
        logged = builder.log(self.signal.name, self.ahead, self.ahead, builder.type(predicted))
        return builder.select(builder.broadcast(lasts, axes), logged, predicted)

    def _with_prediction(self, builder: GraphBuilder, copies: dict[NodeId, NodeId]) -> NodeId:
        """The node of the samples in the buffer, followed by the output of this step. `copies` maps
        old node ids to those of the builder.
        """
        predicted = self._predicted(builder, copies)
        return builder.emit(Window(self._tape_name), (predicted,), self._windowed(self.length + 1))

    def state(
        self, builder: GraphBuilder, starts: GraphBuilder, copies: dict[NodeId, NodeId]
    ) -> State:
        # R4, step 5: drop the oldest sample, append the new prediction
        moved = builder.slice(self._with_prediction(builder, copies), WINDOW, 1, self.length + 1)
        name, kept = self.signal.name, self._windowed(self.length)
        return State(
            self._tape_name,
            kept.axes,
            kept.unit,
            Tape(name, self.ahead),
            next=moved,
            # R4, start: the tape is the log up to t0+k−1
            start=starts.log(name, self.first, self.ahead - 1, kept),
            range=self.signal.range,
            doc=self.signal.doc,
            span=self.signal.span,
        )


def _countdown(builder: GraphBuilder, starts: GraphBuilder, warm_up: int) -> State:
    """The state that counts the remaining steps n of a warm-up: `warm_up` at first, max(n − 1, 0)
    after each step. `builder` is that of the step, `starts` that of the start.
    """
    left = builder.subtract(builder.state(WARM_UP, Type()), builder.constant(1.0))
    return State(
        WARM_UP,
        (),
        None,
        # reset at each start, also in runs that continue from given states
        LayerMemory(starts_fresh_each_run=True),
        next=builder.maximum(left, builder.constant(0.0)),
        start=starts.constant(float(warm_up)),
    )


def _loops(program: Program, names: Iterable[str], *, warm: bool) -> dict[str, _Loop]:
    """The loop of each named input, by name; inputs that the step does not read need none. `warm`
    is True if there is a warm-up. Raises LoopError if an input cannot be replaced by an output.
    """
    known = {signal.name: signal for signal in program.signals}
    # losses read the log (R6): only reads of the step determine the length of the tape
    extents = extents_of(program.step, log=False)
    loops: dict[str, _Loop] = {}
    for name in names:
        if name not in known:
            raise LoopError(LoopFault.UNKNOWN, name)
        signal = known[name]
        found = [out for out in program.outputs if out.predicts and out.predicts.signal == name]
        if not found:
            raise LoopError(LoopFault.UNPREDICTED, name, span=signal.span)
        # a signal has one source (R4)
        if len(found) > 1:
            raise LoopError(LoopFault.PREDICTED_TWICE, name, span=found[1].span)
        # missing axes are broadcast; additional axes do not fit
        if not set(program.step[found[0].node].type.axes) <= set(signal.axes):
            raise LoopError(LoopFault.AXES, name, span=found[0].span)
        predicts = found[0].predicts
        if predicts is not None and name in extents:
            loops[name] = _Loop(
                signal=signal,
                output=found[0],
                ahead=predicts.ahead,
                first=extents[name].first,
                warm=warm,
            )
    return loops


def _cycle_error(program: Program, error: CycleError) -> LoopError:
    nodes = [program.step[index] for index in error.nodes]
    closed = [node for node in nodes if isinstance(node.op, ReadSignal)]
    names: list[str] = []
    # the named values on the cycle, each once
    for node in nodes:
        name = node.op.signal if isinstance(node.op, ReadSignal) else node.label
        if name is not None and name not in names:
            names.append(name)
    # lowering has reported cycles without a closed input
    signal = closed[0].op.signal if isinstance(closed[0].op, ReadSignal) else ""
    return LoopError(LoopFault.CYCLE, signal, tuple(names), closed[0].span)
