"""Keeps past samples of states and equations in buffers, and finds what fills these (R5)."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

from compiler.ir.program import History, NodeId
from compiler.ir.program import State as ProgramState
from compiler.ir.types import WINDOW, Axis, Type
from compiler.lowering.context import Context
from compiler.lowering.environment import START, STEP, Environment
from compiler.lowering.expressions import lower, window_of
from compiler.lowering.failure import LoweringFailed
from compiler.lowering.places.fitted import fitted
from spec_schema.diagnostics.source import Span
from spec_schema.errors import time as errors
from spec_schema.expressions.tree import Member, Name
from spec_schema.fields.formulas import Prediction
from spec_schema.late_dataclass import dataclass
from spec_schema.sections.references import references
from spec_schema.sections.signals import Equation, Output, State


@dataclass(frozen=True)
class Remembered:
    """The number of past samples that are kept of something, and the axes of one of them."""

    length: int
    axes: tuple[Axis, ...] = ()


Buffers = Mapping[str, Remembered]
"""What is remembered of states, equations and outputs, by their names."""


class Histories:
    """The buffers of one lowering.

    How long a buffer must be is known only when everything is lowered, and the axes of an equation
    that reads its own past only when it is. `known` is what the lowering before this one found;
    the compiler lowers again until nothing changes.
    """

    def __init__(self, context: Context, known: Buffers) -> None:
        self._context = context
        self._known = known
        self._lengths: dict[str, int] = {}
        self._places: dict[str, Span] = {}
        self._refused: set[str] = set()
        """What is a window itself, as is reported: there is no more to say about its past."""

    def read(
        self, name: str, entry: State | Equation | Output, span: Span, environment: Environment
    ) -> NodeId:
        """The samples of a state or equation at the environment's time, none of them after t."""
        begin, end = environment.window or (0, 0)
        first, last = begin + environment.shift, end + environment.shift
        if last > 0:
            self._context.findings.report(errors.future_of(f"`{name}`", span))
            raise LoweringFailed
        if first == 0:
            return self._newest(name, span)
        self._lengths[name] = max(-first, self._lengths.get(name, 0))
        self._places.setdefault(name, span)
        known = self._known.get(name, Remembered(0))
        # the longest look-back that this lowering has met so far or the last one has found: in the
        # last lowering both are the same, and every window is cut from one buffer
        length = max(known.length, self._lengths[name])
        builder = self._context.builder(STEP)
        if last < 0:
            unit = entry.unit.value if entry.unit else None
            type = Type((*known.axes, Axis(WINDOW, length)), unit)
            samples = builder.state(_buffer(name), type)
        else:
            samples = builder.window(_buffer(name), self._now(name, span), length)
        # a buffer ends with t−1, a window with t: in both t+i stands at length + i
        part = builder.slice(samples, WINDOW, length + first, length + last + 1)
        return part if environment.window is not None else builder.element(part, WINDOW, 0)

    def before(self, name: str, entry: State, span: Span, environment: Environment) -> NodeId:
        """Past samples of a state in the start graph: its `history:`, else its log (R5)."""
        builder = self._context.builder(START)
        window = environment.window
        length = window[1] - window[0] + 1 if window is not None else 0
        axes = self._context.axes_of(entry)
        wanted = (*axes, Axis(WINDOW, length)) if length else axes
        if entry.history is not None:
            there = START.shifted(environment.shift)
            if window is not None:
                node = window_of(self._context, entry.history, there, *window)
                there = there.over(*window)
            else:
                node = lower(self._context, entry.history, there)
            what = f"`history` of `{name}`"
            return fitted(self._context, what, node, Type(wanted), entry.history, there)
        if not self._is_measured(name, entry):
            self._context.findings.report(errors.history_needed(name, span))
            raise LoweringFailed
        first, last = window or (0, 0)
        type = Type(wanted, entry.unit.value if entry.unit else None)
        return builder.log(name, first + environment.shift, last + environment.shift, type)

    def found(self) -> Buffers:
        """The buffers of this lowering: lengths, and the axes that their values have."""
        builder = self._context.builder(STEP)
        found: dict[str, Remembered] = {}
        for name, length in self._lengths.items():
            try:
                now = self._now(name, self._places[name])
                axes = builder.type(now).axes
            # its mistake is reported: what was known stays, so that the lowerings come to an end
            except LoweringFailed:
                axes = self._known.get(name, Remembered(0)).axes
            if any(axis.name == WINDOW for axis in axes):
                self._context.findings.report(errors.window_of_window(self._places[name]))
                self._refused.add(name)
                axes = ()
            found[name] = Remembered(length, axes)
        return found

    def states(self) -> list[ProgramState]:
        """A buffer state for everything whose past is read."""
        builder = self._context.builder(STEP)
        made: list[ProgramState] = []
        # the same as what this lowering found: otherwise there is another one
        for name, remembered in self._known.items():
            if name in self._refused:
                continue
            entry = self._entry(name)
            try:
                now = self._now(name, self._places[name])
                start = self._start(name, entry, remembered)
            except LoweringFailed:
                continue
            window = builder.window(_buffer(name), now, remembered.length)
            following = builder.slice(window, WINDOW, 1, remembered.length + 1)
            axes = (*remembered.axes, Axis(WINDOW, remembered.length))
            unit = builder.type(now).unit
            made.append(ProgramState(_buffer(name), axes, unit, History(name), following, start))
        return made

    # ---- inside

    def _is_measured(self, name: str, entry: State) -> bool:
        """Whether the spec reads the log of a state anywhere (R6); then its data must have it."""
        if name not in self._context.measured and name in self._named_logs:
            self._context.measured[name] = entry
        return name in self._context.measured

    @cached_property
    def _named_logs(self) -> frozenset[str]:
        """Whatever the model or its losses name as `name.meas` or predict, lowered yet or not."""
        spec = self._context.spec
        model = (spec.states, spec.equations, spec.outputs, spec.functions, spec.layers)
        found = set[str]()
        for reference in references((*model, spec.losses)):
            match reference:
                case Member(base=base, name="meas"):
                    found.add(base)
                case Prediction(signal=signal):
                    found.add(signal.value)
                case _:
                    pass
        return frozenset(found)

    def _newest(self, name: str, span: Span) -> NodeId:
        """The window of one sample: it holds what is there now, and nothing is remembered."""
        builder = self._context.builder(STEP)
        now = self._now(name, span)
        axes = builder.type(now).axes
        if any(axis.name == WINDOW for axis in axes):
            self._context.findings.report(errors.window_of_window(span))
            raise LoweringFailed
        return builder.reshape(now, (*axes, Axis(WINDOW, 1)))

    def _entry(self, name: str) -> State | Equation | Output:
        entry = self._context.scope[name].entry
        assert isinstance(entry, State | Equation | Output)
        return entry

    def _now(self, name: str, span: Span) -> NodeId:
        return self._context.names.value(Name(name, span), STEP)

    def _start(self, name: str, entry: State | Equation | Output, remembered: Remembered) -> NodeId:
        """Samples before t0, from the first that exists: `history:`, the log, inputs alone (R5)."""
        context, length = self._context, remembered.length
        builder, before = context.builder(START), START.over(-length, -1)
        wanted = (*remembered.axes, Axis(WINDOW, length))
        if entry.history is not None:
            node = window_of(context, entry.history, START, -length, -1)
            what = f"`history` of `{name}`"
            return fitted(context, what, node, Type(wanted), entry.history, before)
        if isinstance(entry, State):
            if not self._is_measured(name, entry):
                return self._missing(name)
            unit = entry.unit.value if entry.unit else None
            return builder.log(name, -length, -1, Type(wanted, unit))
        if isinstance(entry, Output) and entry.predicts is not None:
            # the log of what is predicted, moved: the output at τ stands for the signal at τ+ahead
            # (R5b)
            ahead = context.sampling.samples(entry.predicts.ahead)
            signal = entry.predicts.signal.value
            return builder.log(signal, ahead - length, ahead - 1, Type(wanted))
        # over the log alone (R5c); where the expression needs the simulation there is no past
        node = context.names.tried(lambda: window_of(context, entry.expr, START, -length, -1))
        if node is None:
            return self._missing(name)
        return fitted(context, f"the past of `{name}`", node, Type(wanted), entry.expr, before)

    def _missing(self, name: str) -> NodeId:
        self._context.findings.report(errors.history_needed(name, self._places[name]))
        raise LoweringFailed


def _buffer(name: str) -> str:
    return f"{name}.history"
