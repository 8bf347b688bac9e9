"""Holds the state of one lowering: the spec, the growing graphs, and the collected facts."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from typing import Protocol

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId
from compiler.ir.rules.op_rules import LARGEST_SIZE
from compiler.ir.types import Axis, Type, describe_axes
from compiler.linking.given_weights import GivenWeights
from compiler.lowering.environment import Environment, EnvironmentPart, FunctionArgument, Time
from compiler.lowering.failure import LoweringFailed
from compiler.lowering.notes.gradient_sources import GradientSources
from compiler.lowering.notes.memories import Memories
from compiler.lowering.notes.solved_calls import SolvedCall
from compiler.lowering.notes.stage_reads import StageReads
from compiler.lowering.sampling import Sampling
from compiler.lowering.scope import Declaration, Scope
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.errors import shapes
from spec_schema.expressions.tree import Call, Member, Name
from spec_schema.late_dataclass import dataclass
from spec_schema.sections.dimensions import Dimension
from spec_schema.sections.signals import Signal, State
from spec_schema.sections.spec import Spec
from spec_schema.sections.values import Parameter


class Names(Protocol):
    """Looks up names and calls of a spec for the code that lowers expressions."""

    def value(self, name: Name, environment: Environment) -> NodeId:
        """The node of a bare name."""
        ...

    def member(self, member: Member, environment: Environment) -> NodeId:
        """The node of `base.member`."""
        ...

    def call(self, call: Call, environment: Environment) -> NodeId:
        """The value of a layer, function or builtin."""
        ...

    def declared(self, name: str, span: Span) -> Declaration:
        """The declaration of a name, which counts as used from then on; reports an unknown name."""
        ...

    def derivative(self, name: str, entry: State, span: Span, environment: Environment) -> NodeId:
        """The right-hand side of a continuous state."""
        ...

    def lowerings(self, name: str, environment: Environment) -> Sequence[tuple[Time, NodeId]]:
        """The times at which an equation or output has been lowered, with the node at each."""
        ...

    def tried(self, lower_it: Callable[[], NodeId]) -> NodeId | None:
        """The node, or None if lowering fails. Reports nothing and has no side effects."""
        ...


class Graphs:
    """The graphs of a program under construction."""

    def __init__(self) -> None:
        self._builders = {
            EnvironmentPart.START: GraphBuilder(),
            EnvironmentPart.CONSTANT: GraphBuilder(),
        }
        # the step and the losses share a graph: a loss compares the nodes that the step computes
        self._step = GraphBuilder()

    def builder(self, environment: Environment) -> GraphBuilder:
        """The builder of the graph that the environment's nodes belong to."""
        return self._builders.get(environment.part, self._step)


# compared by identity: two lowerings of one spec build different graphs
@dataclass(frozen=True, eq=False, kw_only=True)
class Context:
    """One lowering of a spec. Its fields are values or collectors; only `names` lowers anything."""

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
        """The builder of the graph that the environment's nodes belong to."""
        return self.graphs.builder(environment)

    def dimension(self, name: str, span: Span) -> Axis:
        """The axis of a dimension that `dims:` declares; reports an unknown one."""
        entry = self.scope[name].entry if name in self.scope else None
        if not isinstance(entry, Dimension):
            self.findings.report(shapes.unknown_dimension(name, span))
            raise LoweringFailed
        # a dimension of a value counts as used, like a name in an expression
        self.used.add(name)
        return Axis(name, entry.size)

    def labels(self, dimension: str) -> tuple[str, ...]:
        """Labels of the elements of a dimension; empty without labels."""
        entry = self.scope[dimension].entry if dimension in self.scope else None
        return entry.labels if isinstance(entry, Dimension) else ()

    def axes_of(self, entry: Signal | State | Parameter) -> tuple[Axis, ...]:
        """The axes of an entry, from its `dims:`."""
        axes = tuple(self.dimension(dim.value, dim.span) for dim in entry.dims)
        if axes:
            self.refuse_vast(axes, entry.dims[-1].span)
        return axes

    def refuse_vast(self, axes: tuple[Axis, ...], span: Span) -> None:
        """Reports a value that is too large for memory, before it is allocated."""
        if math.prod(axis.size for axis in axes) > LARGEST_SIZE:
            self.findings.report(shapes.too_large(describe_axes(axes), LARGEST_SIZE, span))
            raise LoweringFailed

    def type_of(self, entry: Signal | State | Parameter) -> Type:
        """Axes and unit of one sample of an entry."""
        return Type(self.axes_of(entry), entry.unit.value if entry.unit else None)

    def is_of_submodel(self, name: str) -> bool:
        """True if a full name belongs to a sub-model."""
        return name.partition(".")[0] in self.spec.use
