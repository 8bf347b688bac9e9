"""Derives the value, Jacobian and Hessian of one step in one graph of array operations.

The results r = f(z) of one step (next states and outputs) depend on variables z: states, inputs,
and on request parameters. λ is a multiplier per result. The graph has r, J = ∂r/∂z and the Hessian
H = ∇²(λᵀf) in z. Forward mode gives the tangents ẏ of every value y, reverse mode the adjoints ȳ =
∂(λᵀf)/∂y. H sums, over the nonlinear operations φ, ȳ times the second derivatives of φ in the
tangents of its operands (Griewank, Walther: Evaluating Derivatives, 2008, ch. 3 and 5;
`curvature`). Products with matrices stay array operations.

Value, J and H share common nodes. Kinks and infinite derivatives follow `reverse_mode`; a kink has
no second derivative.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from compiler.differentiation.forward_mode import tangents
from compiler.differentiation.reverse_mode import gradients
from compiler.hessian.curvature import bending_nodes, curvatures, grouped_directions
from compiler.hessian.matrix_blocks import (
    Placed,
    curvature_of_groups,
    matrix_of_blocks,
    slopes_of_result,
    with_picked_rows,
)
from compiler.interpreter.interpreter import Interpreter
from compiler.interpreter.operations import Array
from compiler.ir import ops
from compiler.ir.builder import GraphBuilder, copy_node
from compiler.ir.nodes import needed
from compiler.ir.program import Graph, NodeId, Output, Program
from compiler.ir.types import WINDOW, Axis, Type
from compiler.jacobian.matrices import Matrix, Quantity, Vector, vector_of
from compiler.jacobian.zeros import without_zeros
from compiler.passes.guard_derivatives import guard_untaken
from compiler.passes.simplify import folded

LARGEST_FOLDED = 1 << 20
"""Maximum number of elements of a constant array of derivatives: a buffer of a thousand samples."""


@dataclass(frozen=True, slots=True)
class StepDerivatives:
    """Jacobian and Hessian of a step, and the graph that computes their entries and the results."""

    graph: Graph
    """It reads the same values as the step, and the `multiplier` of each result as a state."""
    results: Vector
    """r: next states (`next_value`), then outputs."""
    variables: Vector
    """z: states, then inputs, then parameters."""
    values: dict[str, NodeId]
    """The node of each result."""
    jacobian: Matrix
    hessian: Matrix | None
    """Both triangles, bit-identical; None if not requested."""

    @property
    def matrices(self) -> tuple[Matrix, ...]:
        return (self.jacobian,) if self.hessian is None else (self.jacobian, self.hessian)

    @property
    def roots(self) -> list[NodeId]:
        """The nodes of the results and of all computed entries."""
        return [*self.values.values(), *(n for matrix in self.matrices for n in matrix.nodes)]


def next_value(state: str) -> str:
    """The name of a state's next value among the results: `next(x)`."""
    return f"next({state})"


def multiplier(result: str) -> str:
    """The name of the state from which the graph reads λ of a result, an array with the result's
    axes.
    """
    return f"multiplier of {result}"


def step_derivatives(
    program: Program,
    *,
    states: Collection[str] | None = None,
    inputs: Collection[str] | None = None,
    parameters: Collection[str] = (),
    next_states: Collection[str] | None = None,
    outputs: Collection[str] | None = None,
    flat: Collection[str] = (),
    hessian: bool = True,
) -> StepDerivatives:
    """The derivatives of a program in step form: of the results `next_states` and `outputs` with
    respect to the variables `states`, `inputs` and `parameters`, all by name.

    None selects all of them; for inputs, all that a result reads. Their order is that of the
    program. The Hessian treats next values (`next(x)`) and outputs named in `flat`, and their
    operands, as linear. For sums of squares of such outputs it is the Gauss-Newton approximation.
    """
    # losses and ranges would keep nodes that no result depends on
    program = guard_untaken(replace(program, losses=(), expected=()))
    named = {next_value(s.name): s.next for s in program.states if _has(next_states, s.name)}
    named |= {o.name: o.node for o in program.outputs if _has(outputs, o.name)}
    # flat results have first derivatives only: their operations add nothing to the Hessian
    straight = [s.next for s in program.states if next_value(s.name) in flat]
    straight += [o.node for o in program.outputs if o.name in flat]
    builder, copies = _without_windows(program.step, [*named.values(), *straight])
    roots = {name: copies[node] for name, node in named.items()}
    count = len(builder.graph())
    leaves = _readers(builder.graph())
    variables = vector_of(
        "z",
        [
            *((s.name, s.axes, s.unit) for s in program.states if _has(states, s.name)),
            *(port for port in _inputs(program, builder, leaves) if _has(inputs, port[0])),
            *((p.name, p.axes, p.unit) for p in program.parameters if p.name in parameters),
        ],
    )
    types = {name: builder.type(node) for name, node in roots.items()}
    results = vector_of("r", [(name, type.axes, type.unit) for name, type in types.items()])

    # only nodes of the model are differentiated, not the tangents of previous groups
    groups = [
        (group, tangents(builder, group.axis, group.seeds(builder, leaves), {}, count=count))
        for group in grouped_directions(builder.graph(), variables.members, leaves)
    ]
    slopes = [
        placed
        for name, node in roots.items()
        for group, found in groups
        if node in found
        for placed in slopes_of_result(
            builder, found[node], results.member(name), group.runs, variables.size
        )
    ]
    bends: list[Placed] = []
    if hessian:
        bending = bending_nodes(builder, count, [t for _, t in groups])
        linear = needed(builder.graph(), [copies[node] for node in straight])
        bending = [node for node in bending if not linear[node]]
        adjoints = _adjoints(builder, roots, bending)
        runs = [group.runs for group, _ in groups]
        for (g, h), block in curvatures(builder, adjoints, groups).items():
            bends += curvature_of_groups(builder, block, runs[g], runs[h], variables.size)
    wanted = [*roots.values(), *(placed.node for placed in (*slopes, *bends))]
    finished, moved = _finished(builder.graph(), count, wanted)

    def matrix(name: str, rows: Vector, blocks: list[Placed]) -> Matrix:
        placed = [replace(block, node=moved[block.node]) for block in blocks]
        return matrix_of_blocks(finished, name, rows, variables, placed)

    return StepDerivatives(
        graph=finished.graph(),
        results=results,
        variables=variables,
        values={name: moved[node] for name, node in roots.items()},
        # rows are results, columns variables, in the order of the program
        jacobian=matrix("J", results, slopes),
        hessian=matrix("H", variables, bends) if hessian else None,
    )


def _has(names: Collection[str] | None, name: str) -> bool:
    return names is None or name in names


def _without_windows(
    graph: Graph, wanted: Iterable[NodeId]
) -> tuple[GraphBuilder, dict[NodeId, NodeId]]:
    """A builder with copies of the nodes that the wanted ones depend on, and their new ids by the
    old ones. A `Window` becomes a concatenation of its buffer and the newest sample.
    """
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    live = needed(graph, wanted)
    for index, node in graph:
        if not live[index]:
            continue
        args = tuple(copies[arg] for arg in node.args)
        if isinstance(node.op, ops.Window):
            # oldest sample first: the buffer, then the newest sample (R1)
            *axes, last = node.type.axes
            past = node.type.with_axes((*axes, Axis(WINDOW, last.size - 1)))
            with builder.at(node.span):
                newest = builder.reshape(args[0], (*axes, Axis(WINDOW, 1)))
                kept = builder.state(node.op.state, past)
                joined = builder.emit(ops.Concat(WINDOW), (kept, newest), node.type)
            copies[index] = joined
        else:
            copies[index] = copy_node(builder, node, args)
    return builder, copies


def _readers(graph: Graph) -> dict[str, list[NodeId]]:
    """The nodes that read each state, input and parameter, by its name."""
    found: dict[str, list[NodeId]] = {}
    for index, node in graph:
        match node.op:
            case ops.ReadState(name) | ops.ReadParameter(name) | ops.ReadSignal(name):
                found.setdefault(name, []).append(index)
            case _:
                pass
    return found


def _inputs(
    program: Program, builder: GraphBuilder, leaves: Mapping[str, Sequence[NodeId]]
) -> Iterator[Quantity]:
    """The inputs that the graph reads, as (name, axes, unit), in the program's order. `leaves` has
    the nodes that read each name; in step form one node reads an input.
    """
    for signal in program.signals:
        for leaf in leaves.get(signal.name, ()):
            # a target can have the name of a state
            if isinstance(builder.node(leaf).op, ops.ReadSignal):
                yield signal.name, builder.type(leaf).axes, signal.unit


def _adjoints(
    builder: GraphBuilder, roots: Mapping[str, NodeId], wanted: Sequence[NodeId]
) -> dict[NodeId, NodeId]:
    """∂(λᵀf)/∂y of those wanted nodes y on which a result depends, by node. `roots` are the nodes
    of the results, by name.
    """
    seeds: dict[NodeId, NodeId] = {}
    for name, root in roots.items():
        weight = builder.state(multiplier(name), Type(builder.type(root).axes))
        # two results can be one node: an output that is a next state
        seeds[root] = builder.add(seeds[root], weight) if root in seeds else weight
    found = gradients(builder, seeds, wanted)
    return {
        node: adjoint for node, adjoint in zip(wanted, found, strict=True) if adjoint is not None
    }


def _finished(
    graph: Graph, count: int, wanted: Sequence[NodeId]
) -> tuple[GraphBuilder, dict[NodeId, NodeId]]:
    """A builder with the wanted nodes, without terms that are known to be 0, and their new ids by
    the old ones. The first `count` nodes, those of the model, are copied unchanged.
    """
    live = needed(graph, wanted)
    draft = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    exact = 0
    for index, node in graph:
        if live[index]:
            args = [copies[arg] for arg in node.args]
            # `second_slopes` marked its operands with names, which are no longer needed
            is_mark = index >= count and isinstance(node.op, ops.Named)
            copies[index] = args[0] if is_mark else copy_node(draft, node, tuple(args))
            if index < count:
                exact = max(exact, copies[index] + 1)
    # results keep their bits: folding may regroup derivatives only
    known, moved = folded(draft.graph(), exact=exact, largest=LARGEST_FOLDED)
    picked, places = with_picked_rows(known, exact=exact)
    at = {node: places[moved[copies[node]]] for node in wanted}
    builder = GraphBuilder()
    found = without_zeros(picked, list(at.values()), builder, exact=exact)
    return builder, {node: found[place] for node, place in at.items()}


@dataclass(frozen=True, slots=True)
class DerivativeValues:
    """The results by name, arrays (B, *shape), and the matrices J and H by name, arrays (B, rows,
    columns), for B members.
    """

    results: dict[str, Array]
    matrices: dict[str, Array]


class DerivativeInterpreter:
    """Evaluates the derivatives of a program with numpy, as `Interpreter` evaluates the program.
    `weights` are physical arrays by name; a missing one is the parameter's initial value. Raises
    ValueError as `Interpreter` does.
    """

    def __init__(
        self,
        derivatives: StepDerivatives,
        program: Program,
        weights: Mapping[str, ArrayLike] | None = None,
        dtype: DTypeLike = np.float64,
    ) -> None:
        self._derivatives = derivatives
        # a node that is the value of two results is computed once, named by its id
        outputs = tuple(Output(str(node), node) for node in dict.fromkeys(derivatives.roots))
        slopes = replace(
            program,
            # no state is stepped; multipliers are passed as states
            states=(),
            step=derivatives.graph,
            outputs=outputs,
            losses=(),
            fits=(),
            expected=(),
        )
        self._interpreter = Interpreter(slopes, weights, dtype)

    def values(
        self, log: Mapping[str, Array], t: ArrayLike, states: Mapping[str, Array]
    ) -> DerivativeValues:
        """The results and matrices of steps at the rows `t` of the log (one per member). `states`
        are arrays (B, *shape) by name, including the multipliers. Raises IndexError for rows
        outside the log.
        """
        values = self._interpreter.step(log, t, states, losses=False).outputs
        members = len(np.atleast_1d(np.asarray(t)))
        found = self._derivatives
        matrices = {
            matrix.name: matrix.filled(
                {node: values[str(node)] for node in matrix.nodes}, members, self._interpreter.dtype
            )
            for matrix in found.matrices
        }
        return DerivativeValues(
            {name: values[str(node)] for name, node in found.values.items()}, matrices
        )
