"""Jacobians of one step: the derivatives of next states and outputs by states, inputs and
parameters.

For x' = f(x, u, p), y = h(x, u, p) the matrices are A = ∂x'/∂x, B = ∂x'/∂u, C = ∂y/∂x, D = ∂y/∂u,
and on request ∂x'/∂p and ∂y/∂p. The vector x is the whole memory of the step: declared states and
samples in buffers, so that A is the matrix of the whole discrete system.

Every element of the next states and outputs is a row, computed separately. Structurally zero or
constant entries are stored as constants. Reverse mode computes the others, one pass per row, with
its conventions at kinks (`reverse_mode`).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from typing import assert_never

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from compiler.differentiation.reverse_mode import gradients
from compiler.interpreter.interpreter import Interpreter
from compiler.interpreter.operations import Array
from compiler.ir.builder import GraphBuilder, copy_node
from compiler.ir.nodes import needed
from compiler.ir.ops import Constant, ReadParameter, ReadSignal, ReadState
from compiler.ir.program import Declared, Graph, NodeId, Output, Program
from compiler.jacobian.matrices import Jacobian, Matrix, MatrixBlock, Vector, vector_of
from compiler.jacobian.scalarize import Elements, Leaf, LeafSlice, every_element, single_elements
from compiler.jacobian.zeros import known_number, without_zeros
from compiler.passes.guard_derivatives import guard_untaken
from compiler.passes.simplify import folded


def jacobian(
    program: Program,
    *,
    parameters: bool = False,
    declared_only: bool = False,
    feedthrough_only: bool = False,
) -> Jacobian:
    """The Jacobian of a program in step form: the matrices A, B, C and D, with `parameters` also
    ∂x'/∂p and ∂y/∂p.

    With `declared_only` the vector x contains only declared states; other memory counts as
    constant. With `feedthrough_only` x is empty and D is the only matrix.
    """
    # losses and ranges of equations are not needed: the graph is shorter without them
    program = guard_untaken(replace(program, losses=(), expected=()))
    step = program.step
    kept = () if feedthrough_only else program.states
    listed = [s for s in kept if not declared_only or isinstance(s.origin, Declared)]
    results = {"x": [(s.name, s.next, s.axes, s.unit) for s in listed]}
    types = [(output, step[output.node].type) for output in program.outputs]
    results["y"] = [(output.name, output.node, type.axes, type.unit) for output, type in types]
    roots = [node for members in results.values() for _, node, _, _ in members]
    states, outputs = (
        vector_of(letter, [(name, axes, unit) for name, _, axes, unit in members])
        for letter, members in results.items()
    )
    inputs, tuned = _read(program, roots)

    elements = single_elements(
        step, [(root, at) for root in roots for at in every_element(step[root].type)]
    )
    names = {state.name for state in listed}
    wanted = [
        node for node, part in elements.parts.items() if _is_asked_for(part.leaf, parameters, names)
    ]
    graph, slopes = slopes_of_elements(elements, wanted)
    builder = GraphBuilder(graph)
    of_states, of_outputs = slopes[: states.size], slopes[states.size :]
    named = [
        ("A", states, states, of_states),
        ("B", states, inputs, of_states),
        ("C", outputs, states, of_outputs),
        ("D", outputs, inputs, of_outputs),
    ]
    if parameters:
        named += [("dx_dp", states, tuned, of_states), ("dy_dp", outputs, tuned, of_outputs)]
    matrices: list[Matrix] = [
        matrix_of(name, rows, columns, rows_slopes, elements.parts, builder)
        for name, rows, columns, rows_slopes in named
    ]
    return Jacobian(
        graph=builder.graph(),
        matrices=tuple(matrices),
        states=states,
        inputs=inputs,
        outputs=outputs,
        parameters=tuned,
    )


def _is_asked_for(leaf: Leaf, parameters: bool, states: Collection[str]) -> bool:
    match leaf:
        case ReadParameter():
            return parameters
        case ReadState(name):
            return name in states
        case ReadSignal():
            return True
        case _:
            assert_never(leaf)


def _read(program: Program, roots: Sequence[NodeId]) -> tuple[Vector, Vector]:
    """The inputs and the parameters that the nodes `roots` depend on, as vectors u and p in the
    program's order.
    """
    marked = needed(program.step, roots)
    live = [node for index, node in program.step if marked[index]]
    ports = {n.op.signal: n.type for n in live if isinstance(n.op, ReadSignal)}
    names = {n.op.name for n in live if isinstance(n.op, ReadParameter)}
    inputs = [(s.name, ports[s.name].axes, s.unit) for s in program.signals if s.name in ports]
    tuned = [(p.name, p.axes, p.unit) for p in program.parameters if p.name in names]
    return vector_of("u", inputs), vector_of("p", tuned)


Slopes = tuple[dict[NodeId, NodeId], ...]
"""For each element, the nodes of its gradients with respect to part nodes, by these; in the axes of
the part, absent if 0."""


def slopes_of_elements(elements: Elements, parts: Sequence[NodeId]) -> tuple[Graph, Slopes]:
    """For each element, its gradients with respect to the nodes `parts`, and the graph of all
    gradient nodes.

    Reverse mode, one pass per element. The graph reads the leaves directly and contains no known
    zeros.
    """
    draft = GraphBuilder(elements.graph)
    one = draft.constant(1.0)
    passes = {
        element: gradients(draft, {element: one}, parts)
        # an element that two rows share, such as with `y: x`, is differentiated once
        for element in dict.fromkeys(elements.nodes)
    }
    slopes = [
        {part: s for part, s in zip(parts, passes[element], strict=True) if s is not None}
        for element in elements.nodes
    ]
    wanted = [slope for by_part in slopes for slope in by_part.values()]
    graph, read = _with_leaves(draft.graph(), elements.parts, wanted)
    # folding turns constant derivatives into constants before zeros are removed
    graph, moved = folded(graph)
    builder = GraphBuilder()
    found = without_zeros(graph, [moved[read[slope]] for slope in wanted], builder)
    finished = tuple(
        {
            part: slope
            for part, draft_slope in by_part.items()
            if known_number(builder, slope := found[moved[read[draft_slope]]]) != 0.0
        }
        for by_part in slopes
    )
    return builder.graph(), finished


def _with_leaves(
    graph: Graph, parts: dict[NodeId, LeafSlice], wanted: Sequence[NodeId]
) -> tuple[Graph, dict[NodeId, NodeId]]:
    """Rebuilds the wanted nodes, with reads and slices of leaves instead of the nodes `parts`.
    Returns the graph and the new ids by the old ones.
    """
    live = needed(graph, wanted)
    builder = GraphBuilder()
    copies: dict[NodeId, NodeId] = {}
    for index, node in graph:
        if index in parts:
            copies[index] = parts[index].read(builder)
        elif live[index]:
            copies[index] = copy_node(builder, node, tuple(copies[arg] for arg in node.args))
    return builder.graph(), copies


def matrix_of(
    name: str,
    rows: Vector,
    columns: Vector,
    slopes: Slopes,
    parts: dict[NodeId, LeafSlice],
    builder: GraphBuilder,
) -> Matrix:
    """The matrix whose row i consists of the gradients `slopes[i]`, each in the columns of its
    part.

    `parts` describes which elements of a leaf a part node reads. Sums for overlapping parts of a
    leaf are added to the builder.
    """
    entries = _Entries(builder, rows, columns, parts)
    for row, by_part in enumerate(slopes):
        entries.add_row(row, by_part)
    moving = moving_nodes(builder.graph())
    # an entry that depends on no state or input is constant over all steps
    fixed = [True] * len(entries.known)
    for block in entries.blocks:
        for place in block.places(builder.type(block.node).shape).ravel().tolist():
            fixed[place] = not moving[block.node]
    known = tuple(entries.known)
    return Matrix(
        name=name,
        rows=rows,
        columns=columns,
        known=known,
        fixed=tuple(fixed),
        blocks=tuple(entries.blocks),
    )


def moving_nodes(graph: Graph) -> list[bool]:
    """One flag per node: True if it depends on states or inputs, not only on parameters and
    constants.
    """
    found: list[bool] = []
    for _, node in graph:
        reads = isinstance(node.op, ReadState | ReadSignal)
        found.append(reads or any(found[arg] for arg in node.args))
    return found


class _Entries:
    def __init__(
        self, builder: GraphBuilder, rows: Vector, columns: Vector, parts: dict[NodeId, LeafSlice]
    ) -> None:
        self._builder = builder
        self._width = columns.size
        self._columns: dict[NodeId, list[int]] = {}
        for node, part in parts.items():
            name = _name_in(columns, part.leaf)
            if name is not None:
                first = columns.member(name).first
                self._columns[node] = [first + number for number in part.numbers]
        self._strides = {node: part.strides for node, part in parts.items()}
        self.known: list[float | None] = [0.0] * (rows.size * columns.size)
        self.blocks: list[MatrixBlock] = []

    def add_row(self, row: int, slopes: dict[NodeId, NodeId]) -> None:
        shared: dict[int, list[tuple[NodeId, int]]] = {}
        for part, slope in slopes.items():
            if part in self._columns:
                places = [row * self._width + column for column in self._columns[part]]
                for number, place in enumerate(places):
                    # parts of a leaf may overlap, such as a vector and one of its elements:
                    # their derivatives are added
                    shared.setdefault(place, []).append((slope, number))
                self._store(slope, places, self._strides[part])
        for place, terms in shared.items():
            if len(terms) > 1:
                numbers = [self._element(slope, number) for slope, number in terms]
                self._store(reduce(self._builder.add, numbers), [place], ())

    def _element(self, value: NodeId, number: int) -> NodeId:
        """The node of one element of a value; `number` is its index in C order."""
        b = self._builder
        for axis in reversed(b.type(value).axes):
            number, index = divmod(number, axis.size)
            value = b.element(value, axis.name, index)
        return value

    def _store(self, slope: NodeId, places: Sequence[int], strides: tuple[int, ...]) -> None:
        op = self._builder.node(slope).op
        number = known_number(self._builder, slope)
        # structurally zero or constant entries are stored as constants of the matrix
        known = op.values if isinstance(op, Constant) else [number] * len(places)
        for place, value in zip(places, known, strict=True):
            self.known[place] = value
        if None in known:
            infinite = self._builder.infinite_values.is_made_of_infinite(slope)
            self.blocks.append(MatrixBlock(slope, places[0], strides, infinite))


def _name_in(vector: Vector, leaf: Leaf) -> str | None:
    """The name of the quantity that a leaf reads, if the vector contains it; else None."""
    match vector.letter, leaf:
        case ("x", ReadState(name)) | ("u", ReadSignal(name)) | ("p", ReadParameter(name)):
            return name if any(member.name == name for member in vector.members) else None
        case _:
            return None


class JacobianInterpreter:
    """Evaluates the Jacobian of a program with numpy, as `Interpreter` evaluates the program.
    `weights` are physical arrays by name; a missing one is the parameter's initial value. Raises
    ValueError as `Interpreter` does.
    """

    def __init__(
        self,
        jacobian: Jacobian,
        program: Program,
        weights: Mapping[str, ArrayLike] | None = None,
        dtype: DTypeLike = np.float64,
    ) -> None:
        self._jacobian = jacobian
        outputs = tuple(Output(str(node), node) for node in dict.fromkeys(jacobian.roots))
        slopes = replace(
            program,
            states=(),
            step=jacobian.graph,
            outputs=outputs,
            losses=(),
            fits=(),
            expected=(),
        )
        self._interpreter = Interpreter(slopes, weights, dtype)

    def matrices(
        self, log: Mapping[str, Array], t: ArrayLike, states: Mapping[str, Array]
    ) -> dict[str, Array]:
        """The matrices by name, arrays (B, rows, columns), for steps at the rows `t` of the log
        (one per member) from `states`, arrays (B, *shape). Raises IndexError for rows outside the
        log.
        """
        values = self._interpreter.step(log, t, states, losses=False).outputs
        members = len(np.atleast_1d(np.asarray(t)))
        dtype = self._interpreter.dtype
        return {
            matrix.name: matrix.filled(
                {node: values[str(node)] for node in matrix.nodes}, members, dtype
            )
            for matrix in self._jacobian.matrices
        }
