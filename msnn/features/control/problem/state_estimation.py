"""Defines the problem of an estimator, as data for every filter.

With x the memory of one step, p the parameters that are estimated and u all inputs,

    x_{k+1} = F(x_k, u_k, p_k) + w,   p_{k+1} = p_k + w_p,   y_k = h(x_k, u_k, p_k) + e

with independent noises of the variances process² · Δt, walk² · Δt and std². F and h are one program
in step form: its next states and its outputs.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

from compiler.ir.builder import GraphBuilder
from compiler.ir.nodes import needed
from compiler.ir.ops import ReadParameter, ReadSignal, ReadState
from compiler.ir.program import Declared, Graph, History, Program, State, Tape
from compiler.ir.types import Type
from compiler.jacobian.matrices import Vector
from spec_schema.late_dataclass import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurement:
    """A measured output of the model; each element has noise with the standard deviation `std`, in
    its unit.
    """

    name: str
    """Of the output in the spec."""
    signal: str
    """The port: the signal that the output predicts."""
    value: str
    """The output of the program that computes h."""
    std: float


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimatedNumbers:
    """The uncertainty of a state or parameter, in its unit, equal for all its elements: initial
    standard deviation, drift, and limits of the estimate.
    """

    initial: float
    drift: float
    """Standard deviation of its random drift in one second, in its unit per √s."""
    minimum: float | None = None
    maximum: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class MovingWindow:
    """The window of moving-horizon estimation, and the settings of its solver."""

    horizon: int
    """N: the window is of the samples t−N … t."""
    is_fixed: bool
    """True if each solve takes a fixed number of iterations, whatever its residual."""
    iterations: int
    tolerance: float


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimationProblem:
    """The model and noise of an estimator; vectors as in `ControlProblem`."""

    program: Program
    """In step form, loops closed, without losses."""
    states: Vector
    inputs: Vector
    """u: all ports."""
    measured: tuple[Measurement, ...]
    deviations: Mapping[str, EstimatedNumbers]
    """By state. What is not there is known, as the registers of inputs; of a register that a
    prediction feeds it is of the newest sample."""
    parameters: Mapping[str, EstimatedNumbers]
    window: MovingWindow | None = None
    """None for an extended Kalman filter."""

    @property
    def sample_time(self) -> float:
        """Seconds from one k to the next."""
        assert self.program.sample_time is not None
        return self.program.sample_time

    @property
    def variances(self) -> tuple[tuple[str, float], ...]:
        """The nonzero variances of the filter, by name."""
        found = [(measurement.name, measurement.std**2) for measurement in self.measured]
        for name, numbers in (*self.deviations.items(), *self.parameters.items()):
            found += [(name, numbers.initial**2), (name, numbers.drift**2 * self.sample_time)]
        return tuple((name, variance) for name, variance in found if variance != 0)

    @property
    def registers(self) -> dict[str, History | Tape]:
        """The states that are shift registers of past samples, by name, with their signals."""
        found = {state.name: state.origin for state in self.program.states}
        return {n: o for n, o in found.items() if isinstance(o, History | Tape)}

    @property
    def inputs_measured(self) -> frozenset[str]:
        """The names of the inputs on which measured outputs depend in the same step."""
        graph = self.program.step
        marked = needed(graph, [self.program.output(m.value).node for m in self.measured])
        reads = [node.op for index, node in graph if marked[index]]
        return frozenset(op.signal for op in reads if isinstance(op, ReadSignal))


def augmented(program: Program, parameters: Collection[str]) -> Program:
    """The program in which these parameters are constant states, after all others.

    %1: scalar = parameter k

    %1: scalar = state k              # next: itself
    """
    # the log of a parameter is the parameter itself: it is read as a state from here on
    nodes = (
        replace(node, op=ReadState(node.op.name))
        if isinstance(node.op, ReadParameter) and node.op.name in parameters
        else node
        for node in program.step.nodes
    )
    builder, starts = GraphBuilder(Graph(tuple(nodes))), GraphBuilder(program.start)
    states = [
        State(
            name=p.name,
            axes=p.axes,
            unit=p.unit,
            origin=Declared(),
            next=builder.state(p.name, Type(p.axes, p.unit)),
            # the value that training left is where estimation begins
            start=starts.parameter(p.name, Type(p.axes, p.unit)),
            doc=p.doc,
            span=p.span,
        )
        for p in program.parameters
        if p.name in parameters
    ]
    return replace(
        program,
        states=(*program.states, *states),
        step=builder.graph(),
        start=starts.graph(),
    )
