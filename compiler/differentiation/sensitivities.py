"""Builds the step of second-order training: residuals and their derivatives by the parameters θ, in
forward mode.

For every state x that depends on a learned parameter θ, the program gets the state ∂x/∂θ and so
simulates its own sensitivities. Any backend that runs programs can then compute exact Jacobians of
rollouts without a backward pass. Memory does not grow with the horizon.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from compiler.differentiation.forward_mode import tangents, zero_tangent
from compiler.differentiation.sums_of_squares import is_sum_of_squares
from compiler.differentiation.training_step import (
    LossTerm,
    element_factors,
    loss_terms,
    scored_error,
    training_step,
)
from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import ReadParameter, ReadState, Relation, Window
from compiler.ir.program import (
    Declared,
    Graph,
    Loss,
    Measure,
    NodeId,
    Output,
    Parameter,
    Program,
    State,
)
from compiler.ir.slopes import LARGEST_SLOPE
from compiler.ir.types import Axis, Type


@dataclass(frozen=True, slots=True)
class LossResiduals:
    """A loss as Σ r² over its elements: the nodes of the residuals r and of their derivatives
    ∂r/∂θ, both 0 where nothing is scored.

    Both are also 0 where a derivative is infinite, i.e. above `LARGEST_SLOPE` with θ in multiples
    of its scale (decision 0184). The derivative of the sum is exact, 2 Σ r ∂r/∂θ. For huber, r
    contains the weight of its element; rows with factor w have √w times the residual.
    """

    loss: Loss
    values: NodeId
    """The residuals r, axes (…)."""
    slopes: NodeId
    """∂r/∂θ, axes (LEARNED, …)."""
    left_out: NodeId | None
    """√w of the row factor w (1 without factors) where a derivative is infinite, else 0, axes (…);
    None if none can be infinite."""


@dataclass(frozen=True, slots=True)
class Unsquared:
    """The residual of a loss, before it is squared, as factor · error. The factor counts as a
    constant when derivatives are taken; None means 1.
    """

    error: NodeId
    factor: NodeId | None
    root: NodeId | None
    """√ of the row factors, which the factor contains; None means 1."""


def unsquared_residual(builder: GraphBuilder, loss: Loss) -> Unsquared:
    """The residual r of a loss that is a sum of squares Σ r². Raises AssertionError for another
    measure or a loss without a target.
    """
    assert loss.target is not None, "a loss without a target compares nothing"
    error = scored_error(builder, loss)
    axes = builder.type(error).axes
    root = None
    if loss.rows is not None:
        root = builder.apply("sqrt", element_factors(builder, loss, loss.rows))
    if loss.measure is not Measure.HUBER:
        assert loss.measure is Measure.MSE, "other losses are no sums of squares"
        return Unsquared(error, root, root)
    # |e| ≤ δ: (e/√2)²; beyond, the weight δ/|e| gives the square the derivative of the line
    # (iteratively reweighted least squares; Holland, Welsch 1977).
    limit = builder.broadcast(builder.constant(loss.delta), axes)
    size = builder.maximum(builder.apply("abs", error), limit)
    half = builder.broadcast(builder.constant(0.5 * loss.delta), axes)
    factor = builder.apply("sqrt", builder.divide(half, size))
    return Unsquared(error, factor if root is None else builder.multiply(root, factor), root)


def residual_row(
    builder: GraphBuilder,
    loss: Loss,
    residual: Unsquared,
    slopes: NodeId,
    scales: Sequence[float],
    leaves_out: Callable[[], bool],
) -> LossResiduals:
    """The residual with its derivatives, both set to 0 where a derivative is infinite.

    `slopes` is the node of ∂error/∂θ with LEARNED as first axis, `scales` has the scale of every
    learned element. `leaves_out` returns False if no derivative is infinite where the losses are
    finite; then nothing is tested.
    """
    directions = builder.type(slopes).axes[0]
    values = _weighted(builder, residual.factor, residual.error)
    slopes = _weighted(builder, residual.factor, slopes, directions)
    if not builder.infinite_values.can_be_infinite(slopes) or not leaves_out():
        return LossResiduals(loss, values, slopes, None)
    # one infinite derivative excludes the residual for all learned elements
    steepness = builder.apply("abs", slopes)
    if any(scale != 1.0 for scale in scales):
        # scaled, since the derivative by a leak in m^3/s/Pa is huge but harmless
        factors = builder.constant(np.array(scales), (directions,), unit=None)
        factors = builder.broadcast(factors, builder.type(steepness).axes)
        steepness = builder.multiply(steepness, factors)
    size = builder.sum(steepness, directions.name)
    axes = builder.type(size).axes
    # false for NaN
    largest = builder.broadcast(builder.constant(LARGEST_SLOPE), axes)
    finite = builder.compare(Relation.LESS_EQUAL, size, largest)
    zero, one = (builder.broadcast(builder.constant(value), axes) for value in (0.0, 1.0))
    everywhere = (directions, *axes)
    nothing = builder.broadcast(builder.constant(0.0), everywhere)
    return LossResiduals(
        loss,
        builder.select(finite, values, zero),
        builder.select(builder.broadcast(finite, everywhere), slopes, nothing),
        builder.select(finite, zero, one if residual.root is None else residual.root),
    )


def _weighted(
    builder: GraphBuilder, factor: NodeId | None, value: NodeId, directions: Axis | None = None
) -> NodeId:
    if factor is None:
        return value
    if directions is not None:
        factor = builder.broadcast(factor, (directions, *builder.type(factor).axes))
    return builder.multiply(value, factor)


LEARNED = "learned number"
"""The axis of all elements of the learned parameters, one parameter after the other."""

SLOPE = "slope of "
"""Prefix of the name of a state with the derivatives of another state, axes (LEARNED, …)."""


@dataclass(frozen=True, slots=True)
class Sensitivities:
    """A program with closed loops that also simulates its sensitivities, with the nodes of its
    losses and residuals.
    """

    program: Program
    learned: tuple[str, ...]
    """Names of the learned parameters, in the order of the axis LEARNED."""
    losses: tuple[LossTerm, ...]
    residuals: tuple[LossResiduals, ...]
    """Residuals of the losses that are sums of squares."""

    @property
    def numbers(self) -> int:
        """Number of learned elements: the length of the axis LEARNED."""
        return sum(_size(self.program, name) for name in self.learned)


def sensitivities(program: Program, learned: Sequence[str]) -> Sensitivities:
    """Adds to a program the derivatives of its losses and states with respect to every element of
    the parameters `learned`.

    `program` is in window form with closed loops; squares without a target are written as
    comparisons (`with_compared_squares`). Losses that are no sums of squares have no residuals.
    """
    directions = Axis(LEARNED, sum(_size(program, name) for name in learned))
    # a state that does not depend on learned parameters needs no derivative state
    moving = _moving_states(program, frozenset(learned))
    start = GraphBuilder(program.start)
    found = tangents(start, directions, _seeds(start, program, learned, directions), {})
    starts = {state.name: _or_zero(start, directions, state.start, found) for state in moving}
    begun = frozenset(
        name for name, node in starts.items() if start.infinite_values.can_be_infinite(node)
    )
    # An infinite derivative of a state makes derivatives of states that read it infinite:
    # the step is rebuilt until the set of such states does not grow.
    infinite: frozenset[str] = frozenset()

    @cache
    def leaves_out() -> bool:
        """True if derivatives can be infinite where the losses are finite, as reverse mode finds
        out.
        """
        return training_step(program).has_infinite_slopes

    while True:
        step = _Step(program, learned, directions, moving, infinite, leaves_out)
        reached = begun | step.infinite
        if reached <= infinite or not leaves_out():
            break
        infinite |= reached
    slopes = tuple(
        State(
            name=f"{SLOPE}{state.name}",
            axes=(directions, *state.axes),
            unit=None,
            origin=Declared(),
            next=step.slopes[state.name],
            start=starts[state.name],
        )
        for state in moving
    )
    whole = replace(
        program,
        states=(*program.states, *slopes),
        step=step.graph,
        start=start.graph(),
    )
    return Sensitivities(whole, tuple(learned), step.losses, step.residuals)


class _Step:
    """The step with its tangents. `moving` are the states with derivatives; those of the states
    `infinite` may be infinite.
    """

    def __init__(
        self,
        program: Program,
        learned: Sequence[str],
        directions: Axis,
        moving: Sequence[State],
        infinite: Collection[str],
        leaves_out: Callable[[], bool],
    ) -> None:
        # the derivative of a buffer is a buffer too: its Window shifts the derivatives of samples
        buffers = {state.name: f"{SLOPE}{state.name}" for state in moving if state.is_buffer}
        step = GraphBuilder(program.step)
        self.losses = loss_terms(step, program)
        unsquared = {
            loss: unsquared_residual(step, loss)
            for loss in program.losses
            if loss.target is not None and is_sum_of_squares(program.step, loss)
        }
        seeds = _seeds(step, program, learned, directions)
        for node, (name, type) in _reads_of(step.graph(), {s.name for s in moving}).items():
            seeds[node] = step.state(f"{SLOPE}{name}", Type((directions, *type.axes)))
            if name in infinite:
                step.infinite_values.expect(seeds[node])
        found = tangents(step, directions, seeds, buffers, infinite)
        scales = scales_of(program, learned)

        def row(loss: Loss, residual: Unsquared) -> LossResiduals:
            tangent = _or_zero(step, directions, residual.error, found)
            return residual_row(step, loss, residual, tangent, scales, leaves_out)

        self.residuals = tuple(row(*each) for each in unsquared.items())
        self.slopes = {s.name: _or_zero(step, directions, s.next, found) for s in moving}
        """Derivatives of the next value of each state that depends on the parameters."""
        can_be = step.infinite_values.can_be_infinite
        self.infinite = frozenset(name for name, node in self.slopes.items() if can_be(node))
        self.graph = step.graph()


def scales_of(program: Program, learned: Sequence[str]) -> list[float]:
    """The scale of every element of the parameters `learned`, one parameter after the other, as
    along the axis LEARNED.
    """
    return [program.parameter(name).scale for name in learned for _ in range(_size(program, name))]


def _size(program: Program, parameter: str) -> int:
    return Type(program.parameter(parameter).axes).size


def _or_zero(
    builder: GraphBuilder, directions: Axis, node: NodeId, found: dict[NodeId, NodeId]
) -> NodeId:
    tangent = found.get(node)
    return zero_tangent(builder, directions, node) if tangent is None else tangent


def _seeds(
    builder: GraphBuilder, program: Program, learned: Sequence[str], directions: Axis
) -> dict[NodeId, NodeId]:
    """The tangents of the nodes that read learned parameters: a unit direction for each element."""
    first: dict[str, int] = {}
    total = 0
    for name in learned:
        first[name] = total
        total += _size(program, name)
    seeds: dict[NodeId, NodeId] = {}
    for index, node in builder.graph():
        if isinstance(node.op, ReadParameter) and node.op.name in first:
            size = node.type.size
            units = np.zeros((directions.size, size))
            # rows of the identity: ∂θ/∂θ for this parameter, zeros for the others
            units[first[node.op.name] + np.arange(size), np.arange(size)] = 1.0
            seeds[index] = builder.constant(units, (directions, *node.type.axes), unit=None)
    return seeds


def _reads_of(graph: Graph, states: Collection[str]) -> dict[NodeId, tuple[str, Type]]:
    return {
        index: (node.op.name, node.type)
        for index, node in graph
        if isinstance(node.op, ReadState) and node.op.name in states
    }


def _moving_states(program: Program, learned: frozenset[str]) -> tuple[State, ...]:
    """The states whose value depends on the parameters `learned`, through the start or a step, in
    the program's order.
    """
    begun = _depending(program.start, learned, frozenset())
    moving = frozenset(state.name for state in program.states if state.start in begun)
    while True:
        reached = _depending(program.step, learned, moving)
        now = moving | {state.name for state in program.states if state.next in reached}
        if now == moving:
            return tuple(state for state in program.states if state.name in moving)
        # states can depend on each other in cycles: repeat until no state is added
        moving = now


def _depending(graph: Graph, parameters: frozenset[str], states: frozenset[str]) -> set[NodeId]:
    """The nodes of the graph that depend on one of these parameters or states."""
    found: set[NodeId] = set()
    for index, node in graph:
        match node.op:
            case ReadParameter(name):
                depends = name in parameters
            case ReadState(name):
                depends = name in states
            case Window(state):
                depends = state in states or node.args[0] in found
            case _:
                depends = any(arg in found for arg in node.args)
        if depends:
            found.add(index)
    return found


ROOT = "root of the covariance"
"""Name of the parameter L with LLᵀ the covariance of the learned elements, axes (LEARNED,
direction)."""

VARIANCE = "variance of "
"""Prefix of the name of an output with the elementwise variance of another output."""

_DIRECTION = "direction"


def with_variances(program: Program, learned: Sequence[str], outputs: Collection[str]) -> Program:
    """Adds an output for the variance of each of `outputs` that the uncertainty of the parameters
    `learned` causes.

    The covariance of the learned elements is LLᵀ; L is the new parameter `ROOT`. Before: window
    form, loops closed. After: the same, without losses; a variance has the name of its output with
    the prefix `VARIANCE`. Where a derivative is infinite, the variance is 0.
    """
    builder = GraphBuilder(program.step)
    compared: list[Loss] = []
    for output in program.outputs:
        if output.name in outputs:
            type = builder.type(output.node)
            zero = builder.broadcast(builder.constant(0.0, unit=type.unit), type.axes)
            # with target 0, the residual is the output itself and has the wanted derivatives
            compared.append(Loss(output.name, Measure.MSE, output.node, zero))
    whole = sensitivities(replace(program, step=builder.graph(), losses=tuple(compared)), learned)
    builder = GraphBuilder(whole.program.step)
    axes = Axis(LEARNED, whole.numbers), Axis(_DIRECTION, whole.numbers)
    root = builder.parameter(ROOT, Type(axes))
    found: list[Output] = []
    for residual in whole.residuals:
        along = builder.contract_over(residual.slopes, root, LEARNED)
        # a sum of squares is never negative; y' C y could be, by rounding
        variance = builder.sum(builder.power(along, 2), _DIRECTION)
        found.append(Output(f"{VARIANCE}{residual.loss.name}", variance))
    size = whole.numbers * whole.numbers
    return replace(
        whole.program,
        step=builder.graph(),
        losses=(),
        outputs=(*program.outputs, *found),
        parameters=(*program.parameters, Parameter(ROOT, axes, None, (0.0,) * size, learn=False)),
    )
