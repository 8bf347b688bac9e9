"""The state of one compilation while expressions are lowered: `Context` has the spec, the graphs
under construction and the collected facts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import field
from enum import Enum
from typing import Protocol

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId
from compiler.ir.program import State as ProgramState
from compiler.ir.rules import LARGEST_SIZE
from compiler.ir.types import Axis, Type, describe_axes
from compiler.linking.link import GivenWeights
from compiler.lowering.environment import Environment, EnvironmentPart, FunctionArgument, Time
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.errors import names as name_errors
from spec_schema.errors import shapes
from spec_schema.errors import time as time_errors
from spec_schema.expressions.tree import Call, Duration, Length, Member, Name, Samples, TimeOffset
from spec_schema.late_dataclass import dataclass
from spec_schema.sections.layers import Layer
from spec_schema.sections.signals import Equation, Output, Signal, State
from spec_schema.sections.spec import Spec
from spec_schema.sections.submodels import Use
from spec_schema.sections.values import Constant, Dimension, Function, Parameter


class LoweringFailed(Exception):  # noqa: N818  (no error of its own: the diagnostic is)
    """Raised after a mistake in a value of the spec has been reported. Values that depend on it
    fail in the same way without a second report.
    """


Entry = (
    Use | Dimension | Signal | Constant | Parameter | Layer | Function | State | Equation | Output
)


class Kind(Enum):
    """The section of the spec that declares a name; the value of each member is its wording in
    messages.
    """

    SUBMODEL = "a sub-model"
    DIMENSION = "a dimension"
    INPUT = "an input"
    TARGET = "a target"
    CONSTANT = "a constant"
    PARAMETER = "a parameter"
    LAYER = "a layer"
    FUNCTION = "a function"
    STATE = "a state"
    EQUATION = "an equation"
    OUTPUT = "an output"


@dataclass(frozen=True)
class Declaration:
    """A declared name, the section that declares it, and its entry there."""

    name: str
    kind: Kind
    entry: Entry


def owner_of(name: str) -> str:
    """The sub-model to which a full name belongs, such as `vehicle` of `vehicle.mass`; "" for the
    model itself.
    """
    return name.rpartition(".")[0]


class Scope(Mapping[str, Declaration]):
    """All declared names of the spec, each with its declaration. A second declaration of a name is
    reported; the first one stays valid.
    """

    def __init__(self, spec: Spec, findings: Findings) -> None:
        self._declared: dict[str, Declaration] = {}
        sections: tuple[tuple[Kind, Mapping[str, Entry]], ...] = (
            (Kind.SUBMODEL, spec.use),
            (Kind.DIMENSION, spec.dims),
            (Kind.INPUT, spec.inputs),
            (Kind.TARGET, spec.targets),
            (Kind.CONSTANT, spec.constants),
            (Kind.PARAMETER, spec.parameters),
            (Kind.LAYER, spec.layers),
            (Kind.FUNCTION, spec.functions),
            (Kind.STATE, spec.states),
            (Kind.EQUATION, spec.equations),
            (Kind.OUTPUT, spec.outputs),
        )
        # if two sections declare a name, the later one in this order is reported
        for kind, section in sections:
            for name, entry in section.items():
                first = self._declared.get(name)
                if first is None:
                    self._declared[name] = Declaration(name, kind, entry)
                else:
                    findings.report(
                        name_errors.declared_twice(
                            name, entry.place.key, first.entry.place.key, first.kind.value
                        )
                    )

    def __getitem__(self, name: str) -> Declaration:
        return self._declared[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._declared)

    def __len__(self) -> int:
        return len(self._declared)


LONGEST_WINDOW = 1_000_000
# A duration such as 0.3 s at 0.1 s is 2.9999999999999996 samples in floating point.
_TOLERANCE = 1e-9
_BEYOND = 1e15


class Sampling:
    """Converts durations of the spec to samples. `sample_time` is in seconds, None in a static
    model. Durations that do not fit are reported.
    """

    def __init__(self, sample_time: float | None, findings: Findings) -> None:
        self.sample_time = sample_time
        self._findings = findings

    def samples(self, length: Length) -> int:
        """The number of samples of a length, which is given in samples or as a duration.

        Raises LoweringFailed after reporting a duration that is no multiple of the sample time, a
        static model, or a length above LONGEST_WINDOW. Raises TypeError for no length.
        """
        match length:
            case Samples(count=count):
                found = count
            case Duration():
                found = self.from_seconds(length.seconds, length.quantity.text, length.span)
            case _:  # of a plug-in
                raise TypeError(
                    f"a {type(length).__name__} is no length: declare the field of the settings as "
                    "`msnn.extending.PositiveLength` or `LengthField`"
                )
        if abs(found) > LONGEST_WINDOW:
            shown = f"{'at least ' if found == _BEYOND else ''}{found:,}"
            self._findings.report(time_errors.window_too_long(shown, LONGEST_WINDOW, length.span))
            raise LoweringFailed
        return found

    def offset(self, offset: TimeOffset) -> int:
        """The offset from t in samples; negative in the past. Raises LoweringFailed as `samples`
        does.
        """
        return offset.sign * self.samples(offset.length)

    def required(self, what: str, span: Span) -> float:
        """The sample time in seconds. In a static model it reports that `what` needs one, and
        raises LoweringFailed.
        """
        if self.sample_time is None:
            self._findings.report(time_errors.needs_sample_time(what, span))
            raise LoweringFailed
        return self.sample_time

    def from_seconds(self, seconds: float, text: str, span: Span) -> int:
        """The number of samples of a duration in seconds; `text` is its spelling in the spec.
        Raises LoweringFailed after reporting that it is no multiple of the sample time or that
        there is none.
        """
        sample_time = self.required(f"the duration {text}", span)
        # ∞ cannot be rounded; the limit is far above the longest window
        exact = min(seconds / sample_time, _BEYOND)
        nearest = round(exact)
        if abs(exact - nearest) > _TOLERANCE * max(1.0, abs(exact)):
            # 0 s is not a valid window or delay
            multiples = [each for each in (math.floor(exact), math.ceil(exact)) if each]
            nearest_texts = [_seconds_text(each * sample_time) for each in multiples]
            self._findings.report(
                time_errors.not_a_multiple(text, _seconds_text(sample_time), nearest_texts, span)
            )
            raise LoweringFailed
        return nearest


def _seconds_text(seconds: float) -> str:
    if seconds and abs(seconds) < 1:
        return f"{seconds * 1000:.9g} ms"
    return f"{seconds:.9g} s"


class GradientSources:
    """Stores, for each node that is a gradient ∂y/∂x, the node of y.

    The gradient of 3·x is the constant 3, whose node no longer shows that the spec uses x.
    """

    def __init__(self) -> None:
        # node ids are unique within a graph only: the builder distinguishes step and start
        self._sources: dict[tuple[int, NodeId], list[NodeId]] = {}

    def remember(self, builder: GraphBuilder, result: NodeId, value: NodeId) -> None:
        """Stores that the node `result` is a gradient of the node `value`, both in the builder's
        graph.
        """
        self._sources.setdefault((id(builder), result), []).append(value)

    def made_of(self, builder: GraphBuilder, value: NodeId) -> set[NodeId]:
        """The nodes on which a value depends, and those of y for each gradient ∂y/∂x among them."""
        reached: set[NodeId] = set()
        waiting = [value]
        while waiting:
            node = waiting.pop()
            if node not in reached:
                reached.add(node)
                waiting += builder.node(node).args
                waiting += self._sources.get((id(builder), node), ())
        return reached


class Memories:
    """The states that layers and calls such as `integral` need. Equal calls with the same arguments
    share a state.
    """

    def __init__(self) -> None:
        self._names: dict[tuple[str, tuple[Hashable, ...]], str] = {}
        self._calls: dict[str, int] = {}
        self._states: dict[str, ProgramState] = {}

    @property
    def states(self) -> tuple[ProgramState, ...]:
        """All states that were added, in the order of first use."""
        return tuple(self._states.values())

    def name(self, owner: str, call: tuple[Hashable, ...]) -> str:
        """Name of the state of a call of `owner`: `h.state`, and `h.state2` for a second, different
        call. `call` identifies the call.
        """
        key = (owner, call)
        if key not in self._names:
            number = self._calls[owner] = self._calls.get(owner, 0) + 1
            self._names[key] = f"{owner}.state{number if number > 1 else ''}"
        return self._names[key]

    def keep(self, state: ProgramState) -> None:
        """Adds a state, whose next value and start are nodes already; replaces one of the same
        name.
        """
        self._states[state.name] = state


@dataclass(frozen=True, slots=True)
class SolvedCall:
    """A solution x = M⁻¹ (a − b) of linear equations in a graph, such as the forward dynamics of a
    robot: ddq = M⁻¹ (τ − bias).

    `argument` is the node of a. `with_diagonal(d)` adds the node of (M + diag(d))⁻¹ (a − b), where
    d has the axis of a.
    """

    argument: NodeId
    with_diagonal: Callable[[NodeId], NodeId]


@dataclass(frozen=True)
class StageReads:
    """The names that each integrator reads between samples t and t+1, to check the option
    `between:` of inputs.

    An entry is a pair: the sub-model whose states are integrated ("" for the model itself), and the
    name.
    """

    inputs: set[tuple[str, str]] = field(default_factory=set[tuple[str, str]])
    """Inputs read later than sample t, where an interpolated input differs from its sample."""
    parameters: set[tuple[str, str]] = field(default_factory=set[tuple[str, str]])


class Names(Protocol):
    """The protocol by which the code that lowers expressions looks up names and calls of a spec.
    Each method raises LoweringFailed after reporting a mistake.
    """

    def value(self, name: Name, environment: Environment) -> NodeId:
        """The node of a name such as `mass`, lowered in the environment."""
        ...

    def member(self, member: Member, environment: Environment) -> NodeId:
        """The node of `base.member`, such as `x.meas` or `tire.mu`, lowered in the environment."""
        ...

    def call(self, call: Call, environment: Environment) -> NodeId:
        """The node of a call of a layer, a function or a builtin, lowered in the environment."""
        ...

    def declared(self, name: str, span: Span) -> Declaration:
        """The declaration of a name, which counts as used from then on. Reports an unknown name and
        raises LoweringFailed.
        """
        ...

    def derivative(self, name: str, entry: State, span: Span, environment: Environment) -> NodeId:
        """The node of the time derivative of the continuous state `name`: the right-hand side of
        its differential equation.
        """
        ...

    def lowerings(self, name: str, environment: Environment) -> Sequence[tuple[Time, NodeId]]:
        """The nodes to which an equation or output has been lowered so far, each with its time
        (shift and window).
        """
        ...

    def tried(self, lower_it: Callable[[], NodeId]) -> NodeId | None:
        """The node that `lower_it` returns. None if it raises LoweringFailed; then its reports are
        removed, and nothing counts as failed.
        """
        ...


class Graphs:
    """The builders of the three graphs of a compilation: one for the step and the losses, one for
    the start, one for constants.
    """

    def __init__(self) -> None:
        self._builders = {
            EnvironmentPart.START: GraphBuilder(),
            EnvironmentPart.CONSTANT: GraphBuilder(),
        }
        # the step and the losses share a graph: a loss compares the nodes that the step computes
        self._step = GraphBuilder()

    def builder(self, environment: Environment) -> GraphBuilder:
        """The builder of the graph to which nodes of this environment belong."""
        return self._builders.get(environment.part, self._step)


# compared by identity: two lowerings of one spec build different graphs
@dataclass(frozen=True, eq=False, kw_only=True)
class Context:
    """The state of one compilation of a spec. Its fields are values or collectors; only `names`
    lowers expressions.
    """

    spec: Spec
    findings: Findings
    scope: Scope
    sampling: Sampling
    given: GivenWeights
    names: Names
    draw: int = 0
    """Seed offset of random initial values: another `draw` gives other values."""
    numbers: Mapping[str, str] = field(default_factory=dict[str, str])
    """Contents of files of initial values, by path; files not listed are read from disk."""
    graphs: Graphs = field(default_factory=Graphs)
    memories: Memories = field(default_factory=Memories)
    gradients: GradientSources = field(default_factory=GradientSources)
    stage_reads: StageReads = field(default_factory=StageReads)
    solved_calls: dict[NodeId, SolvedCall] = field(default_factory=dict[NodeId, SolvedCall])
    """Calls in the step that solve linear equations, by the node of their result."""
    used: set[str] = field(default_factory=set[str])
    """Names that the spec refers to."""
    plugin_functions: set[str] = field(default_factory=set[str])
    """Functions of plug-ins that the spec calls."""
    unread: list[FunctionArgument] = field(default_factory=list[FunctionArgument])
    """Arguments that the formula of the called function does not use."""
    measured: dict[str, State] = field(default_factory=dict[str, State])
    """States whose recorded values are read (docs/language.md, States); the data must contain
    them."""

    def builder(self, environment: Environment) -> GraphBuilder:
        """The builder of the graph to which nodes of this environment belong."""
        return self.graphs.builder(environment)

    def dimension(self, name: str, span: Span) -> Axis:
        """The axis of the dimension `name`. Reports a name that `dims:` does not declare and raises
        LoweringFailed.
        """
        entry = self.scope[name].entry if name in self.scope else None
        if not isinstance(entry, Dimension):
            self.findings.report(shapes.unknown_dimension(name, span))
            raise LoweringFailed
        # a dimension of a value counts as used, like a name in an expression
        self.used.add(name)
        return Axis(name, entry.size)

    def labels(self, dimension: str) -> tuple[str, ...]:
        """The names of the elements of a dimension; empty if it has none or does not exist."""
        entry = self.scope[dimension].entry if dimension in self.scope else None
        return entry.labels if isinstance(entry, Dimension) else ()

    def axes_of(self, entry: Signal | State | Parameter) -> tuple[Axis, ...]:
        """The axes of one sample of an entry, from its `dims:`. Reports unknown dimensions or too
        many elements and raises LoweringFailed.
        """
        axes = tuple(self.dimension(dim.value, dim.span) for dim in entry.dims)
        if axes:
            self.refuse_vast(axes, entry.dims[-1].span)
        return axes

    def refuse_vast(self, axes: tuple[Axis, ...], span: Span) -> None:
        """Reports a value with more than LARGEST_SIZE elements, before it is allocated, and raises
        LoweringFailed.
        """
        if math.prod(axis.size for axis in axes) > LARGEST_SIZE:
            self.findings.report(shapes.too_large(describe_axes(axes), LARGEST_SIZE, span))
            raise LoweringFailed

    def type_of(self, entry: Signal | State | Parameter) -> Type:
        """Axes and unit of one sample of an entry; raises LoweringFailed as `axes_of` does."""
        return Type(self.axes_of(entry), entry.unit.value if entry.unit else None)

    def is_of_submodel(self, name: str) -> bool:
        """True if the full name belongs to a sub-model, such as `vehicle.mass`."""
        return name.partition(".")[0] in self.spec.use
