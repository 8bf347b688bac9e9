"""Gives every name of a spec its nodes, each entry lowered once for each way it is used."""

from __future__ import annotations

from compiler.builtins.gradients import Gradients
from compiler.builtins.table import lower_builtin
from compiler.elaboration.entries import Entries
from compiler.elaboration.functions import argument_value, inlined
from compiler.elaboration.histories import Histories, Known
from compiler.elaboration.layer_calls import lower_layer
from compiler.elaboration.states import States
from compiler.ir.builder import GraphBuilder
from compiler.ir.fit import Fit
from compiler.ir.program import NodeId
from compiler.ir.signatures import SIGNATURES
from compiler.ir.types import WINDOW, Axis, Type
from compiler.linking.connected import Connected
from compiler.linking.given_weights import GivenWeights
from compiler.linking.link import Linked
from compiler.lowering.arrays.arrays import Arrays
from compiler.lowering.constants import Constants
from compiler.lowering.environment import Environment, Part
from compiler.lowering.failure import LoweringFailed
from compiler.lowering.memories import Memories
from compiler.lowering.sampling import Sampling
from compiler.lowering.scope import Declared, Kind, Scope
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.errors import names, submodels, time
from spec_schema.errors import shapes as shape_errors
from spec_schema.expressions.language import LOSS_FUNCTIONS, NUMBERS, STATE_FUNCTIONS
from spec_schema.expressions.tree import Call, Expression, LanguageName, Member, Name
from spec_schema.sections.dimensions import Dimension
from spec_schema.sections.layers import Layer
from spec_schema.sections.signals import Equation, Output, Signal, State
from spec_schema.sections.submodels import Use
from spec_schema.sections.values import Constant, Function, Parameter
from spec_schema.units.parser import parse_unit

_SECOND = parse_unit("s")
_CALLABLE = (Kind.LAYER, Kind.FUNCTION)


class Model:
    """A spec being lowered: its names, the graphs that grow, and what was found on the way."""

    def __init__(self, linked: Linked, findings: Findings, known: Known, draw: int = 0) -> None:
        spec = self.spec = linked.spec
        self.integrators = linked.integrators
        self.draw = draw
        """Which initial values are drawn, where they are."""
        self.findings = findings
        self.given = GivenWeights(linked, findings)
        self.scope = Scope(spec, findings)
        seconds = spec.sample_time.value if spec.sample_time else None
        self.sampling = Sampling(seconds, findings)
        self._builders = {Part.START: GraphBuilder(), Part.CONSTANT: GraphBuilder()}
        self._step = GraphBuilder()
        self.constants = Constants(self)
        self.arrays = Arrays(self)
        self.states = States(self)
        self.histories = Histories(self, known.buffers)
        self.memories = Memories()
        self.gradients = Gradients()
        self.measured: dict[str, State] = {}
        """States whose log is read somewhere (R6): the data must have them."""
        self._known_measured = known.measured
        self._asked_measured = False
        self.first_calls: dict[str, str] = {}
        """Shapes of the arguments of each layer's first call."""
        self.normalized: dict[str, str] = {}
        """The signal whose statistics each `normalize` layer has."""
        self.fits: dict[str, Fit] = {}
        """What each layer with `fit:` starts at."""
        self.used: set[str] = set()
        """Names that something refers to."""
        self.entries = Entries(self, known.variables)

    def builder(self, environment: Environment) -> GraphBuilder:
        """The graph that the environment's nodes belong to."""
        return self._builders.get(environment.part, self._step)

    def found(self) -> Known:
        """What this lowering found out that the next one must begin with."""
        measured = frozenset(self.measured) if self._asked_measured else frozenset[str]()
        return Known(self.histories.found(), measured, frozenset(self.gradients.variables))

    def is_measured(self, name: str) -> bool:
        """Whether a state is known to be logged; where it matters, the next lowering knows it."""
        self._asked_measured = True
        return name in self.measured or name in self._known_measured

    # ---- names

    def value(self, name: Name, environment: Environment) -> NodeId:
        """The node of a bare name."""
        argument = environment.arguments.get(name.name)
        if argument is not None:
            return argument_value(self, argument, environment)
        builder = self.builder(environment)
        if name.name in NUMBERS:
            return builder.constant(NUMBERS[name.name])
        if name.name == "dt":
            return builder.constant(self.sample_time("`dt`", name.span), unit=_SECOND)
        declared = self.declared(name.name, name.span)
        match declared.entry:
            case Signal() as signal:
                logged = declared.kind is Kind.TARGET or environment.part is not Part.STEP
                return self._signal(name.name, signal, name.span, environment, logged=logged)
            case Constant() as constant:
                array = self.constants.value(name.name, constant)
                return builder.constant(array.values, array.axes, array.unit)
            case Parameter() as parameter:
                self._forbid_in_constant(name.name, name.span, environment)
                self.arrays.parameter(name.name, parameter)
                return self.arrays.read(builder, name.name)
            case State() as state:
                return self.states.value(name.name, state, name.span, environment)
            case Equation() | Output() as entry:
                return self.entries.value(name.name, entry, environment, name.span)
            case Layer() | Function() | Dimension() | Use():
                self.findings.report(names.not_a_value(name.name, declared.kind.value, name.span))
                raise LoweringFailed

    def declared(self, name: str, span: Span) -> Declared:
        """The declaration of a name; reports an unknown one."""
        found = self.scope.get(name)
        if found is None:
            if name in SIGNATURES:
                self.findings.report(names.not_a_value(name, "a builtin", span))
            else:
                known = (*self.scope, "dt", *NUMBERS)
                self.findings.report(names.unknown_name(name, span, known))
            raise LoweringFailed
        self.used.add(name)
        return found

    def member(self, member: Member, environment: Environment) -> NodeId:
        """`s.meas`: the log of a signal or state, whatever the step sees (R6)."""
        base, _, rest = member.base.rpartition(".")
        if member.base not in self.scope and base in self.scope:  # `x.meas.meas`
            member = Member(base, f"{rest}.{member.name}", member.span)
        entry = self.declared(member.base, member.span).entry
        if isinstance(entry, Use):
            unknown = f"{member.base}.{member.name}"
            self.findings.report(
                submodels.unknown_submodel_member(unknown, member.span, self.scope)
            )
            raise LoweringFailed
        if isinstance(entry, Connected) and member.name == "meas":
            if environment.part is Part.START:  # where a bare input is its log too
                return self.entries.value(member.base, entry, environment, member.span)
            place = entry.place.key
            self.findings.report(submodels.log_of_connected(member.base, member.span, place))
            raise LoweringFailed
        if member.name != "meas" or not isinstance(entry, Signal | State):
            self.findings.report(names.no_member(member.base, member.name, member.span))
            raise LoweringFailed
        if isinstance(entry, State):
            self.measured.setdefault(member.base, entry)
        return self._signal(member.base, entry, member.span, environment, logged=True)

    # ---- calls

    def call(self, call: Call, environment: Environment) -> NodeId:
        """The value of a layer, function or builtin."""
        function = call.function
        if isinstance(function, Member):
            owner = self.scope.get(function.base)
            if owner is not None and isinstance(owner.entry, Layer):
                self.used.add(function.base)
                self._forbid_in_constant(function.base, function.span, environment)
                return lower_layer(self, function.base, owner.entry, call, environment)
            self.findings.report(names.no_member(function.base, function.name, function.span))
            raise LoweringFailed
        name = function.name
        if name in environment.arguments:
            self.findings.report(names.not_callable(name, "an argument", function.span))
            raise LoweringFailed
        if name in STATE_FUNCTIONS:
            return self.states.call(name, call, environment)
        is_declared = name in self.scope and not isinstance(function, LanguageName)
        if name in SIGNATURES and not is_declared:
            return lower_builtin(self, name, call, environment)
        if name in LOSS_FUNCTIONS and not is_declared:
            repair = "it belongs in `losses:`"
            self.findings.report(names.misplaced(name, "an expression", function.span, repair))
            raise LoweringFailed
        declared = self.declared(name, function.span) if is_declared else None
        if declared is None:
            known = [n for n, d in self.scope.items() if d.kind in _CALLABLE]
            report = names.unknown_name(
                name, function.span, (*known, *SIGNATURES), "a layer or function"
            )
            self.findings.report(report)
            raise LoweringFailed
        match declared.entry:
            case Layer() as layer:
                self._forbid_in_constant(name, function.span, environment)
                return lower_layer(self, name, layer, call, environment)
            case Function() as entry:
                return inlined(self, name, entry, call, environment)
            case _:
                self.findings.report(names.not_callable(name, declared.kind.value, function.span))
                raise LoweringFailed

    # ---- compile-time values and dimensions

    def number(self, expression: Expression, environment: Environment, what: str) -> float:
        """The number of an expression that must be known at compile time."""
        del environment
        return self.constants.number(expression, what)

    def whole_number(self, expression: Expression, environment: Environment, what: str) -> int:
        """A whole number known at compile time."""
        value = self.number(expression, environment, what)
        if not value.is_integer():
            self.findings.report(names.unfit_constant(what, "is no whole number", expression.span))
            raise LoweringFailed
        return int(value)

    def dimension(self, name: str, span: Span) -> Axis:
        """The axis of a name of `dims:`."""
        entry = self.scope[name].entry if name in self.scope else None
        if not isinstance(entry, Dimension):
            self.findings.report(shape_errors.unknown_dimension(name, span))
            raise LoweringFailed
        self.used.add(name)
        return Axis(name, entry.size)

    def is_of_submodel(self, name: str) -> bool:
        """Whether a full name is a member of a sub-model."""
        return name.partition(".")[0] in self.spec.use

    def labels(self, dimension: str) -> tuple[str, ...]:
        """Labels of a dimension's elements; empty where it has none."""
        entry = self.scope[dimension].entry if dimension in self.scope else None
        return entry.labels if isinstance(entry, Dimension) else ()

    def sample_time(self, what: str, span: Span) -> float:
        """Seconds between samples; reports what needs them in a static model."""
        if self.sampling.sample_time is None:
            self.findings.report(time.needs_sample_time(what, span))
            raise LoweringFailed
        return self.sampling.sample_time

    # ---- inside

    def _signal(
        self,
        name: str,
        entry: Signal | State,
        span: Span,
        environment: Environment,
        *,
        logged: bool,
    ) -> NodeId:
        """The samples of a signal at the environment's time: its log, or what the step sees."""
        self._forbid_in_constant(name, span, environment)
        axes = self.arrays.axes_of(entry)
        first, last = environment.window or (0, 0)
        if environment.window is not None:
            axes = (*axes, Axis(WINDOW, last - first + 1))
        type = Type(axes, entry.unit.value if entry.unit else None)
        first, last = first + environment.shift, last + environment.shift
        builder = self.builder(environment)
        read = builder.log if logged else builder.signal
        return read(name, first, last, type)

    def _forbid_in_constant(self, name: str, span: Span, environment: Environment) -> None:
        if environment.part is Part.CONSTANT:
            self.findings.report(names.constant_needed(f"`{name}`", span))
            raise LoweringFailed
