"""Builds the step of second-order training: residuals and their derivatives in forward mode.

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
from compiler.differentiation.residuals import (
    LossResiduals,
    Unsquared,
    residual_row,
    unsquared_residual,
)
from compiler.differentiation.sums_of_squares import is_sum_of_squares
from compiler.differentiation.training_step import (
    LossTerm,
    loss_terms,
    training_step,
)
from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import ReadParameter, ReadState, Window
from compiler.ir.program import Declared, Graph, Loss, NodeId, Program, State
from compiler.ir.types import Axis, Type

LEARNED = "learned number"
"""The axis of all elements of the learned parameters, one parameter after the other."""

SLOPE = "slope of "
"""Prefix of the name of a state with the derivatives of another state, axes (LEARNED, …)."""


@dataclass(frozen=True, slots=True)
class Sensitivities:
    """A program with closed loops that simulates its sensitivities."""

    program: Program
    learned: tuple[str, ...]
    """Parameters in the order of LEARNED."""
    losses: tuple[LossTerm, ...]
    residuals: tuple[LossResiduals, ...]
    """Residuals of the losses that are sums of squares."""

    @property
    def numbers(self) -> int:
        """Length of LEARNED."""
        return sum(_size(self.program, name) for name in self.learned)


def sensitivities(program: Program, learned: Sequence[str]) -> Sensitivities:
    """Adds derivatives of losses and states with respect to every element of the parameters
    `learned`.

    `program` is in window form with closed loops; squares without a target are written as
    comparisons (`with_compared_squares`). Other losses have no residuals.
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
        """True if derivatives can be infinite where the losses are finite, by reverse mode."""
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
    """The step with its tangents; derivatives of the states in `infinite` may be infinite."""

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
    """The scale of every element of the parameters `learned`, in the order of LEARNED."""
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
    """The tangents of the reads of learned parameters: unit directions for each element."""
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
    """The states that depend on learned parameters, by their start or by any step."""
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
    """The nodes that depend on these parameters and states."""
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
