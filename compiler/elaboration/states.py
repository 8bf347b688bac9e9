"""Lowers declared states, and adds buffers of past samples of states and equations (R4, R5, R6)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from functools import cached_property

from compiler.elaboration.integration import integrated
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import History, NodeId
from compiler.ir.program import State as ProgramState
from compiler.ir.types import WINDOW, Axis, Type
from compiler.lowering.constants import range_in
from compiler.lowering.context import Context, LoweringFailed, owner_of
from compiler.lowering.environment import START, STEP, Environment, EnvironmentPart
from compiler.lowering.expressions import lower, window_of
from compiler.lowering.places import fitted
from compiler.passes.analyses.saturation import saturated
from spec_schema.diagnostics.source import Span
from spec_schema.errors import names
from spec_schema.errors import states as state_errors
from spec_schema.errors import time as time_errors
from spec_schema.expressions.tree import Call, Member, Name
from spec_schema.fields.formulas import Prediction
from spec_schema.late_dataclass import dataclass
from spec_schema.sections.references import references
from spec_schema.sections.signals import Equation, Output, State
from spec_schema.sections.spec import Integrator
from spec_schema.units.unit import Unit


@dataclass(frozen=True)
class Remembered:
    """A buffer: its length in samples, and the axes of one sample."""

    length: int
    axes: tuple[Axis, ...] = ()


Buffers = Mapping[str, Remembered]
"""Buffers of states, equations and outputs, by name."""


class Histories:
    """The buffers of past samples of states, equations and outputs in one lowering.

    The length of a buffer is known only after everything is lowered; so are the axes of an equation
    that reads its own past. `known` is the result of the previous lowering. The compiler repeats
    the lowering until nothing changes.
    """

    def __init__(self, context: Context, known: Buffers) -> None:
        self._context = context
        self._known = known
        self._lengths: dict[str, int] = {}
        self._places: dict[str, Span] = {}
        self._refused: set[str] = set()
        """Names of values that are windows themselves although their past is read. This is
        reported; they get no buffer."""

    def read(
        self, name: str, entry: State | Equation | Output, span: Span, environment: Environment
    ) -> NodeId:
        """The node of the samples of a state, equation or output at the environment's time, from
        its buffer. `span` is the place that reads them. Reports samples after t and raises
        LoweringFailed.
        """
        begin, end = environment.window or (0, 0)
        first, last = begin + environment.shift, end + environment.shift
        if last > 0:
            self._context.findings.report(time_errors.future_of(f"`{name}`", span))
            raise LoweringFailed
        if first == 0:
            return self._newest(name, span)
        self._lengths[name] = max(-first, self._lengths.get(name, 0))
        self._places.setdefault(name, span)
        known = self._known.get(name, Remembered(0))
        # the longest history of this lowering so far or of the previous one: in the last lowering
        # both are equal, and every window is a slice of one buffer
        length = max(known.length, self._lengths[name])
        builder = self._context.builder(STEP)
        if last < 0:
            unit = entry.unit.value if entry.unit else None
            type = Type((*known.axes, Axis(WINDOW, length)), unit)
            samples = builder.state(_buffer(name), type)
        else:
            samples = builder.window(_buffer(name), self._now(name, span), length)
        # a buffer ends at t−1, a window at t: in both, sample t+i has index length + i
        part = builder.slice(samples, WINDOW, length + first, length + last + 1)
        return part if environment.window is not None else builder.element(part, WINDOW, 0)

    def before(self, name: str, entry: State, span: Span, environment: Environment) -> NodeId:
        """The node in the start graph of samples of a state before t0: from its `history:`,
        otherwise from its log (R5). Reports a state that has neither and raises LoweringFailed.
        """
        builder = self._context.builder(START)
        window = environment.window
        length = window[1] - window[0] + 1 if window is not None else 0
        axes = self._context.axes_of(entry)
        target = (*axes, Axis(WINDOW, length)) if length else axes
        if entry.history is not None:
            there = START.shifted(environment.shift)
            if window is not None:
                node = window_of(self._context, entry.history, there, *window)
                there = there.over(*window)
            else:
                node = lower(self._context, entry.history, there)
            what = f"`history` of `{name}`"
            return fitted(self._context, what, node, Type(target), entry.history, there)
        if not self._is_measured(name, entry):
            self._context.findings.report(time_errors.history_needed(name, span))
            raise LoweringFailed
        first, last = window or (0, 0)
        type = Type(target, entry.unit.value if entry.unit else None)
        return builder.log(name, first + environment.shift, last + environment.shift, type)

    def found(self) -> Buffers:
        """The buffers that this lowering needs, by name: their lengths and the axes of one sample.
        Reports a window over a value that is a window itself.
        """
        builder = self._context.builder(STEP)
        buffers: dict[str, Remembered] = {}
        for name, length in self._lengths.items():
            try:
                now = self._now(name, self._places[name])
                axes = builder.type(now).axes
            # its mistake is reported: the previous axes stay, so that the repetition ends
            except LoweringFailed:
                axes = self._known.get(name, Remembered(0)).axes
            if any(axis.name == WINDOW for axis in axes):
                self._context.findings.report(time_errors.window_of_window(self._places[name]))
                self._refused.add(name)
                axes = ()
            buffers[name] = Remembered(length, axes)
        return buffers

    def states(self) -> list[ProgramState]:
        """The buffers as states of the program, one for each value whose past is read. A buffer
        without known initial samples is reported and omitted.
        """
        builder = self._context.builder(STEP)
        made: list[ProgramState] = []
        # in the last lowering, `_known` equals the buffers found
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
        """True if the spec reads the log of the state `name` anywhere (R6). It then counts as
        measured: the data must contain its log.
        """
        if name not in self._context.measured and name in self._named_logs:
            self._context.measured[name] = entry
        return name in self._context.measured

    @cached_property
    def _named_logs(self) -> frozenset[str]:
        """Names whose log the model or its losses read as `name.meas` or as a predicted signal,
        also in entries that are not lowered yet.
        """
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
        """The node of a window of one sample, the value at t, which needs no buffer. Reports a
        value that is a window itself and raises LoweringFailed.
        """
        builder = self._context.builder(STEP)
        now = self._now(name, span)
        axes = builder.type(now).axes
        if any(axis.name == WINDOW for axis in axes):
            self._context.findings.report(time_errors.window_of_window(span))
            raise LoweringFailed
        return builder.reshape(now, (*axes, Axis(WINDOW, 1)))

    def _entry(self, name: str) -> State | Equation | Output:
        entry = self._context.scope[name].entry
        assert isinstance(entry, State | Equation | Output)
        return entry

    def _now(self, name: str, span: Span) -> NodeId:
        return self._context.names.value(Name(name, span), STEP)

    def _start(self, name: str, entry: State | Equation | Output, remembered: Remembered) -> NodeId:
        """The node of the samples in the buffer `remembered` of `name` before t0: from `history:`,
        from the log, or evaluated from recorded inputs (R5). Reports that none of these is possible
        and raises LoweringFailed.
        """
        context, length = self._context, remembered.length
        builder, before = context.builder(START), START.over(-length, -1)
        target = (*remembered.axes, Axis(WINDOW, length))
        if entry.history is not None:
            node = window_of(context, entry.history, START, -length, -1)
            what = f"`history` of `{name}`"
            return fitted(context, what, node, Type(target), entry.history, before)
        if isinstance(entry, State):
            if not self._is_measured(name, entry):
                return self._missing(name)
            unit = entry.unit.value if entry.unit else None
            return builder.log(name, -length, -1, Type(target, unit))
        if isinstance(entry, Output) and entry.predicts is not None:
            # the shifted log: the output at τ predicts the signal at τ+ahead
            # (R5b)
            ahead = context.sampling.samples(entry.predicts.ahead)
            signal = entry.predicts.signal.value
            return builder.log(signal, ahead - length, ahead - 1, Type(target))
        # evaluated from the log (R5c); an expression that needs the simulation has no past
        node = context.names.tried(lambda: window_of(context, entry.expr, START, -length, -1))
        if node is None:
            return self._missing(name)
        return fitted(context, f"the past of `{name}`", node, Type(target), entry.expr, before)

    def _missing(self, name: str) -> NodeId:
        self._context.findings.report(time_errors.history_needed(name, self._places[name]))
        raise LoweringFailed


def _buffer(name: str) -> str:
    return f"{name}.history"


@dataclass(frozen=True)
class FoundBefore:
    """Buffers and units that the previous lowering found and that the next one assumes; empty at
    first.

    Lowering repeats until they do not change.
    """

    buffers: Buffers = field(default_factory=dict[str, Remembered])
    """Buffers of states and equations, with their lengths."""
    units: Mapping[str, Unit] = field(default_factory=dict[str, Unit])
    """Units of centres of fuzzy sets that are read as values, from the argument of their layer."""


class States:
    """The entries of `states:` in one lowering; `integrators` has the integrator of the model ("")
    and of each sub-model.
    """

    def __init__(
        self,
        context: Context,
        histories: Histories,
        integrators: Mapping[str, Integrator | None],
    ) -> None:
        self._context = context
        self._histories = histories
        self._integrators = integrators
        self._flow: dict[str, Mapping[str, NodeId]] = {}
        self._next: dict[str, NodeId | None] = {}
        """The node of the next value of each state; None if its `next` failed or is being
        lowered."""
        self._followed: list[str] = []
        """States whose `next` is being lowered, outermost first."""
        self._differentiated: list[str] = []
        """States whose right-hand side is being lowered, outermost first."""

    def value(self, name: str, entry: State, span: Span, environment: Environment) -> NodeId:
        """The node of a state's value: at t, at earlier samples, or at an integrator stage. `span`
        is the place that reads it.

        An initial value can read only samples before t0. Reports any other use there or in a
        constant, and samples after t, and raises LoweringFailed.
        """
        findings = self._context.findings
        if environment.part is EnvironmentPart.CONSTANT:
            findings.report(names.constant_needed(f"`{name}`", span))
            raise LoweringFailed
        if environment.part is EnvironmentPart.START:
            if environment.latest < 0:
                return self._histories.before(name, entry, span, environment)
            findings.report(state_errors.simulation_in_init(name, span))
            raise LoweringFailed
        if environment.is_elsewhere:
            return self._histories.read(name, entry, span, environment)
        if environment.stage is not None and name in environment.stage.values:
            return environment.stage.values[name]
        # discrete, or of another spec: constant over the step of this integrator (R6)
        return self._context.builder(environment).state(name, self._context.type_of(entry))

    def call(self, function: str, call: Call, environment: Environment) -> NodeId:
        """The node of `next(x)`, the value of the state x after the step, or of `flow(x)`, the
        result of its integrator; `function` is `next` or `flow`. Raises LoweringFailed after
        reporting a mistake.
        """
        findings = self._context.findings
        if len(call.arguments) != 1 or call.keywords:
            found = len(call.arguments) + len(call.keywords)
            findings.report(
                names.wrong_argument_count(function, "1 argument", found, call.function.span)
            )
            raise LoweringFailed
        argument = call.arguments[0]
        name = argument.name if isinstance(argument, Name) else ""
        entry = self._context.spec.states.get(name)
        if entry is None:
            findings.report(state_errors.not_a_state(function, argument.span))
            raise LoweringFailed
        if (
            environment.part in (EnvironmentPart.START, EnvironmentPart.CONSTANT)
            or environment.stage is not None
        ):
            where = "a vector field" if environment.stage else environment.part.value
            findings.report(names.misplaced(function, where, call.span))
            raise LoweringFailed
        if function == "next":
            if name in self._followed:
                loop = (*self._followed[self._followed.index(name) :], name)
                findings.report(
                    state_errors.algebraic_loop(
                        tuple(f"next({state})" for state in loop), call.span
                    )
                )
                raise LoweringFailed
            return self.next(name, entry)
        if entry.der is None:
            findings.report(state_errors.flow_of_discrete(name, argument.span))
            raise LoweringFailed
        return self.flow(owner_of(name))[name]

    def derivative(self, name: str, entry: State, span: Span, environment: Environment) -> NodeId:
        """The node of the right-hand side of a continuous state at the environment's time and
        integrator stage. Reports a use in the start, in a constant or within itself, and raises
        LoweringFailed.
        """
        assert entry.der is not None
        before = environment.part is EnvironmentPart.START and environment.latest < 0
        if environment.part in (EnvironmentPart.START, EnvironmentPart.CONSTANT) and not before:
            where = environment.part.value
            repair = f"write `der({name}.meas)` for the derivative of its log"
            self._context.findings.report(names.misplaced("der", where, span, repair))
            raise LoweringFailed
        if name in self._differentiated:
            loop = (*self._differentiated[self._differentiated.index(name) :], name)
            self._context.findings.report(
                state_errors.algebraic_loop(tuple(f"der({state})" for state in loop), span)
            )
            raise LoweringFailed
        self._differentiated.append(name)
        try:
            return lower(self._context, entry.der, environment.of_entry())
        finally:
            self._differentiated.pop()

    def next(self, name: str, entry: State) -> NodeId:
        """The node of a state's value after the step: its `next:`, otherwise the result of the
        integrator, limited by `on_range: saturate`. Raises LoweringFailed after reporting a
        mistake.
        """
        if name not in self._next:
            self._next[name] = None
            self._followed.append(name)
            try:
                self._next[name] = self._lower_next(name, entry)
            finally:
                self._followed.pop()
        node = self._next[name]
        if node is None:
            raise LoweringFailed
        return node

    def start(self, name: str, entry: State, builder: GraphBuilder) -> NodeId:
        """The node of the state's value before the first step, from `init:`; 0 without it.
        `builder` is that of the start graph. Raises LoweringFailed after reporting a mistake.
        """
        type = self._context.type_of(entry)
        if entry.start is None:
            return builder.broadcast(builder.constant(0.0, unit=type.unit), type.axes)
        at_start = START
        node = lower(self._context, entry.start, at_start)
        return fitted(self._context, f"`init` of `{name}`", node, type, entry.start, at_start)

    def flow(self, owner: str) -> Mapping[str, NodeId]:
        """The nodes of all continuous states of one spec after the step, by name, computed by its
        integrator (R6). `owner` is the sub-model, "" for the model itself.
        """
        if owner not in self._flow:
            self._flow[owner] = integrated(self._context, owner, self._integrators[owner])
        return self._flow[owner]

    # ---- inside

    def _lower_next(self, name: str, entry: State) -> NodeId:
        following = self._lower_law(name, entry)
        type = self._context.type_of(entry)
        limits = range_in(self._context, entry.range, type.unit)
        # saturation is part of `next`, so that training differentiates it; a reset exists in
        # deployed code only
        if entry.on_range is None or entry.on_range.value != "saturate" or limits is None:
            return following
        builder = self._context.builder(STEP)
        with builder.at(entry.on_range.span):
            return saturated(builder, following, builder.state(name, type), limits)

    def _lower_law(self, name: str, entry: State) -> NodeId:
        if entry.next is None:
            return self.flow(owner_of(name))[name]
        node = lower(self._context, entry.next, STEP)
        what = f"`next` of `{name}`"
        return fitted(self._context, what, node, self._context.type_of(entry), entry.next, STEP)
