"""Builds the graphs of gradient-based training: the losses of one step, and its reverse step.

A rollout runs the step forward over the horizon and stores the states. Then it runs the reverse
step from the last sample to the first. The reverse step reads the stored values, the adjoints of
the next states, and ∂S/∂(sum of the loss) for each loss; its results are added to the gradients.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

from compiler.differentiation.reverse_mode import StepGradients, accumulate, step_gradients
from compiler.ir.builder import GraphBuilder
from compiler.ir.ops import (
    LossScale,
    NewestSample,
    ReadTraining,
    Relation,
    Slice,
    StateAdjoint,
    Window,
)
from compiler.ir.program import Graph, Loss, Measure, Node, NodeId, Program, State
from compiler.ir.types import Type
from compiler.passes.guard_derivatives import guard_untaken


@dataclass(frozen=True, slots=True)
class LossTerm:
    """The contribution of one step to a loss: the sum of the cost over its scored elements, and
    their number. `elements` is the number of all elements.
    """

    loss: Loss
    total: NodeId
    count: NodeId | None
    """Number of scored elements, weighted by the factors of their rows; None if all count as 1."""
    elements: int

    @property
    def is_root(self) -> bool:
        return self.loss.measure is Measure.RMSE


@dataclass(frozen=True, slots=True)
class Reverse:
    """A graph that computes gradients, and the nodes of these gradients."""

    graph: Graph
    gradients: StepGradients


@dataclass(frozen=True, slots=True)
class TrainingStep:
    """The graphs that training kernels run, for a program with closed loops."""

    program: Program
    """Its `step` also contains the nodes of the loss terms."""
    losses: tuple[LossTerm, ...]
    newest: dict[str, NodeId]
    """The node of the step with the newest sample of each buffer; other states have `next`."""
    reverse_step: Reverse
    reverse_start: Reverse
    has_infinite_slopes: bool
    """True if a gradient can be infinite where the losses are finite."""


def training_step(program: Program) -> TrainingStep:
    """The graphs of gradient-based training, for a program in window form with closed loops."""
    # before differentiation: the other branch must contribute 0, not 0·∞ (decision 0184)
    program = guard_untaken(program)
    builder = GraphBuilder(program.step)
    losses = loss_terms(builder, program)
    # a buffer shifts by one sample per step: only its newest sample needs an adjoint here, the
    # others are on the tape
    newest = newest_samples(program)
    forward = replace(program, step=builder.graph())
    reverse_step, infinite, in_step = _reverse_step(forward, losses, newest)
    reverse_start, at_start = _reverse_start(forward, infinite)
    return TrainingStep(
        program=forward,
        losses=losses,
        newest=newest,
        reverse_step=reverse_step,
        reverse_start=reverse_start,
        has_infinite_slopes=in_step or at_start,
    )


def losses_alone(program: Program) -> TrainingStep:
    """The training step of a program without its reverse graphs, for runs that need no gradient.
    The losses have the same bits as with them.
    """
    program = guard_untaken(program)
    builder = GraphBuilder(program.step)
    losses = loss_terms(builder, program)
    return forward_only(replace(program, step=builder.graph()), losses)


def forward_only(program: Program, losses: tuple[LossTerm, ...]) -> TrainingStep:
    """The training step without reverse graphs, for a program whose step already contains the nodes
    of the loss terms `losses`.
    """
    nothing = StepGradients({}, {}, {})
    return TrainingStep(
        program=program,
        losses=losses,
        newest=newest_samples(program),
        reverse_step=Reverse(program.step, nothing),
        reverse_start=Reverse(program.start, nothing),
        has_infinite_slopes=False,
    )


def loss_terms(builder: GraphBuilder, program: Program) -> tuple[LossTerm, ...]:
    """The contribution of one step to every loss, in the program's order. The nodes are added to
    `builder`, which has those of the step.
    """
    return tuple(loss_term(builder, loss) for loss in program.losses)


def newest_samples(program: Program) -> dict[str, NodeId]:
    """For every buffer, by name, the node of the sample that a step appends to it."""
    return {state.name: _newest(program, state) for state in program.states if state.is_buffer}


def _newest(program: Program, state: State) -> NodeId:
    """The node of the sample that a step appends to the buffer `state`. Raises AssertionError if
    the state is not shifted by one sample.
    """
    following = program.step[state.next]
    window = program.step[following.args[0]] if following.args else following
    assert isinstance(following.op, Slice), "a buffer is shifted by one sample"
    assert window.op == Window(state.name), "a buffer is shifted by one sample"
    return window.args[0]


def loss_term(builder: GraphBuilder, loss: Loss) -> LossTerm:
    """The contribution of one step to a loss: the sum of its cost over the scored elements, and
    their number. The nodes are added to `builder`.
    """
    error = scored_error(builder, loss)
    cost, elements = element_cost(builder, loss, error), builder.type(error).size
    counts = None
    if loss.rows is not None:
        counts = element_factors(builder, loss, loss.rows)
        cost = builder.multiply(counts, cost)
    elif (present := _present(builder, loss)) is not None:
        axes = builder.type(error).axes
        one, zero = (builder.broadcast(builder.constant(value), axes) for value in (1.0, 0.0))
        counts = builder.select(present, one, zero)
    # counted in the step, since missing targets are known only with the data
    count = None if counts is None else _sum_of_all(builder, counts)
    return LossTerm(loss, _sum_of_all(builder, cost), count, elements)


def scored_error(builder: GraphBuilder, loss: Loss) -> NodeId:
    """The node of the loss's prediction − target, or of the prediction if there is no target or the
    measure is a mean; 0 for elements that are not scored.
    """
    error = loss.prediction
    # the target of a mean only marks missing samples
    if loss.target is not None and loss.measure is not Measure.MEAN:
        error = builder.subtract(loss.prediction, loss.target)
    present = _present(builder, loss)
    if present is None:
        return error
    zero = builder.broadcast(builder.constant(0.0), builder.type(error).axes)
    # a selection: the error of a missing target is NaN, and 0·NaN is NaN
    return builder.select(present, error, zero)


def element_factors(builder: GraphBuilder, loss: Loss, rows: NodeId) -> NodeId:
    """The node of the weight of each element of a loss: the factor of its row, the scalar node
    `rows`; 0 where its target is missing.

    A negative factor counts as 0; data with negative factors are refused (E0850).
    """
    axes = builder.type(loss.prediction).axes
    # second-order training takes the square root, which is NaN below 0
    each = builder.broadcast(builder.maximum(rows, builder.constant(0.0)), axes)
    if loss.target is None:
        return each
    zero = builder.broadcast(builder.constant(0.0), axes)
    return builder.select(_there(builder, loss.target), each, zero)


def _present(builder: GraphBuilder, loss: Loss) -> NodeId | None:
    """The bool node that is true for the scored elements of a loss; None if all elements are scored
    for any data.
    """
    if loss.rows is None:
        return None if loss.target is None else _there(builder, loss.target)
    factors = element_factors(builder, loss, loss.rows)
    zero = builder.broadcast(builder.constant(0.0), builder.type(factors).axes)
    return builder.compare(Relation.LESS, zero, factors)


def _there(builder: GraphBuilder, target: NodeId) -> NodeId:
    # false only for NaN, which marks a missing target
    return builder.compare(Relation.LESS_EQUAL, target, target)


def element_cost(builder: GraphBuilder, loss: Loss, error: NodeId) -> NodeId:
    """The node of the cost of each element, by the measure of the loss, for the node `error`. An
    error of 0 costs 0.
    """
    match loss.measure:
        case Measure.MSE | Measure.RMSE:
            return builder.multiply(error, error)
        case Measure.MAE:
            return builder.apply("abs", error)
        case Measure.HUBER:
            size = builder.apply("abs", error)
            half = builder.constant(0.5)
            square = builder.multiply(half, builder.multiply(error, error))
            # at |e| = δ both pieces are δ²/2 with derivative δ
            delta, middle = builder.constant(loss.delta), builder.constant(0.5 * loss.delta)
            near = builder.compare(Relation.LESS_EQUAL, size, delta)
            line = builder.multiply(delta, builder.subtract(size, middle))
            return builder.select(near, square, line)
        case Measure.MEAN:
            return error


def _sum_of_all(builder: GraphBuilder, value: NodeId) -> NodeId:
    for axis in reversed(builder.type(value).axes):
        value = builder.sum(value, axis.name)
    return value


def _reverse_step(
    program: Program, losses: tuple[LossTerm, ...], newest: dict[str, NodeId]
) -> tuple[Reverse, frozenset[str], bool]:
    """The reverse step, the states whose adjoints can be infinite, and True if a gradient with
    respect to a parameter can be infinite. `losses` are the loss terms of the step; `newest` has
    the node of the newest sample of each buffer.

    Adjoints pass from step to step, so the set of states with infinite adjoints is iterated until
    it is constant.
    """
    infinite: frozenset[str] = frozenset()
    while True:
        builder = GraphBuilder(program.step)
        adjoints: dict[NodeId, NodeId] = {}
        for term in losses:
            if term.loss.penalty is not None:  # proximal steps handle it, without its gradient
                continue
            scale = builder.emit(ReadTraining(LossScale(term.loss.name)), (), Type(unit=None))
            accumulate(builder, adjoints, term.total, scale)
        for state in program.states:
            # seeds: the adjoint of the state after the step, known from the following step
            result = newest.get(state.name, state.next)
            accumulate(builder, adjoints, result, _seed(builder, state, result, infinite))
        gradients = step_gradients(builder, adjoints, signals=False)
        found = infinite.union(
            name
            for name, gradient in gradients.states.items()
            if builder.infinite_values.can_be_infinite(gradient)
        )
        if found == infinite:
            # converged: seeds and results agree on the states with infinite adjoints
            names = {node: name for name, node in newest.items()}
            made = _read_back(builder.graph(), gradients, names)
            return made, infinite, _any_infinite(builder, gradients)
        infinite = found


def _seed(builder: GraphBuilder, state: State, result: NodeId, infinite: Collection[str]) -> NodeId:
    """The node from which the adjoint of a state enters the reverse graph; training passes its
    value.

    `result` is the state's value after the step or the start. `infinite` names states whose adjoint
    can be infinite.
    """
    type = builder.type(result).with_unit(None)
    seed = builder.emit(ReadTraining(StateAdjoint(state.name)), (), type)
    if state.name in infinite:
        builder.infinite_values.expect(seed)
    return seed


def _read_back(graph: Graph, gradients: StepGradients, newest: dict[NodeId, str]) -> Reverse:
    """A reverse graph that reads the newest samples of buffers as stored values, instead of
    computing them again. `newest` maps the nodes of these samples to the names of the buffers;
    `gradients` stay valid, since node ids do not change.
    """
    nodes: list[Node] = []
    for index, node in graph:
        # recomputing it would need all its operands; the forward step stored it on the tape
        if index in newest:
            node = Node(ReadTraining(NewestSample(newest[index])), (), node.type, node.span)
        nodes.append(node)
    return Reverse(Graph(tuple(nodes)), gradients)


def _any_infinite(builder: GraphBuilder, gradients: StepGradients) -> bool:
    return any(map(builder.infinite_values.can_be_infinite, gradients.parameters.values()))


def _reverse_start(program: Program, infinite: Collection[str]) -> tuple[Reverse, bool]:
    builder = GraphBuilder(program.start)
    adjoints: dict[NodeId, NodeId] = {}
    for state in program.states:
        accumulate(builder, adjoints, state.start, _seed(builder, state, state.start, infinite))
    gradients = step_gradients(builder, adjoints, signals=False)
    return Reverse(builder.graph(), gradients), _any_infinite(builder, gradients)


SIZE_OF = "size of "
"""Prefix of the loss that sums the squared targets of another loss."""


def compared_squares(program: Program) -> Program:
    """Replaces losses with a target by their mse, and adds a loss for the sum of squares of each
    target.

    The estimation of initial states uses these squares, whatever the measure of the loss.
    """
    builder = GraphBuilder(program.step)
    losses: list[Loss] = []
    sizes: list[Loss] = []
    for loss in program.losses:
        if loss.target is not None and loss.measure is not Measure.MEAN:
            losses.append(replace(loss, measure=Measure.MSE))
            square = _square(builder, loss, loss.target)
            # weight 0: it is summed like the others but does not affect the gradient
            sizes.append(
                Loss(
                    name=f"{SIZE_OF}{loss.name}",
                    measure=Measure.MEAN,
                    prediction=square,
                    target=None,
                    weight=0.0,
                )
            )
    return replace(program, losses=(*losses, *sizes), step=builder.graph())


def _square(builder: GraphBuilder, loss: Loss, target: NodeId) -> NodeId:
    """The node of the square of each element of the loss's target, times the factor of its row; 0
    where the target is missing.
    """
    axes = builder.type(target).axes
    zero = builder.broadcast(builder.constant(0.0), axes)
    # false only for NaN, which marks a missing recording
    there = builder.compare(Relation.LESS_EQUAL, target, target)
    known = builder.select(there, target, zero)
    square = builder.multiply(known, known)
    if loss.rows is None:
        return square
    return builder.multiply(element_factors(builder, loss, loss.rows), square)
