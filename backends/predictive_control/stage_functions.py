"""Writes the functions of one stage in C: its values, and their slopes and curvature."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from backends.c_language.functions import FunctionTable
from backends.c_language.places import ArrayView, Index, c_strides
from backends.c_language.scope import LocalNames, Scope
from backends.c_language.tree import Argument, Discard, Function, Name, Real
from backends.c_language.used_names import used_names
from backends.c_lowering.graph import GraphLowering
from backends.c_lowering.local_values import LocalValues
from backends.c_lowering.spec_notes import SpecNotes
from backends.predictive_control.cut import Cut, cut_at_values, kept_signal
from compiler.hessian.step_derivatives import StepDerivatives, multiplier
from compiler.ir.ops import AnyRead, Constant, ReadSignal, ReadState, Window
from compiler.ir.program import Formula, Graph, NodeId
from compiler.ir.types import Type
from compiler.jacobian.matrices import Matrix, MatrixBlock, Vector

_UNROLL = 4
_BLOCK = 8
_SIDE_BY_SIDE = 4
"""Partial sums: a processor adds them up at once. The judge allows for any order of a sum."""


@dataclass(frozen=True, slots=True)
class StageArrays:
    """How the arrays of the solver are laid out."""

    variables: int
    """Numbers in a row of a matrix: states, then controls."""
    results: Mapping[str, int]
    """Where the first number of each result stands among those of any stage."""
    given: Vector
    """Disturbances and references."""


@dataclass(frozen=True, slots=True)
class PlacedLimit:
    """Limits of rows that follow each other: one number for all of them, or one each."""

    node: NodeId
    first_side: int
    size: int


@dataclass(frozen=True, slots=True)
class StageFunctions:
    """The two functions of a stage, and how many numbers one leaves for the other."""

    values: Function
    slopes: Function
    kept: int
    can_be_infinite: bool
    """Whether slopes can be infinite where variables are finite."""


class StageWriter:
    """Writes functions that share prefix, kernels and type."""

    def __init__(self, functions: FunctionTable, formulas: tuple[Formula, ...], real: str) -> None:
        self._functions = functions
        self._formulas = formulas
        self._real = real

    def stage(self, name: str, found: StepDerivatives, arrays: StageArrays) -> StageFunctions:
        """`<prefix>_<name>value` and `<prefix>_<name>slopes` of these derivatives."""
        cut = cut_at_values(found)
        sizes = [found.graph[node].type.size for node in cut.kept]
        firsts = [sum(sizes[:number]) for number in range(len(sizes))]
        places = {kept_signal(number): ("kept", first) for number, first in enumerate(firsts)}
        places |= _vector_places("z", found.variables) | _vector_places("given", arrays.given)
        places |= {
            multiplier(name): ("weight", first)
            for name, first in arrays.results.items()
            if name in found.values
        }
        return StageFunctions(
            self._values(f"{name}value", found, cut, places, firsts, arrays),
            self._slopes(f"{name}slopes", found, cut, places, arrays),
            sum(sizes),
            any(matrix.perhaps_infinite for matrix in found.matrices),
        )

    def limits(self, graph: Graph, limits: Sequence[PlacedLimit], given: Vector) -> Function:
        """`<prefix>_limits`: the limits of a stage, by their sides."""
        body = _Body(graph, self._functions, self._formulas, _vector_places("given", given))
        lowered = body.lowered([limit.node for limit in limits])
        for limit in limits:
            type = graph[limit.node].type
            if type.size == 1:
                for number in range(limit.size):
                    place = Index(limit.first_side + 2 * number)
                    zeros = (0,) * len(type.shape)
                    lowered.store(limit.node, ArrayView(Name("limit"), type.shape, zeros, place))
                continue
            strides = tuple(2 * stride for stride in c_strides(type.shape))
            place = ArrayView(Name("limit"), type.shape, strides, Index(limit.first_side))
            lowered.store(limit.node, place)
        doc = "Computes the limits of a stage."
        return body.finished("limits", self._real, ("given",), ("limit",), doc)

    def _values(
        self,
        name: str,
        found: StepDerivatives,
        cut: Cut,
        places: Mapping[str, tuple[str, int]],
        firsts: list[int],
        arrays: StageArrays,
    ) -> Function:
        body = _Body(found.graph, self._functions, self._formulas, places)
        lowered = body.lowered([*found.values.values(), *cut.kept])
        for member in found.results.members:
            node = found.values[member.name]
            place = _part("results", found.graph[node].type, arrays.results[member.name])
            lowered.store(node, place)
        for node, first in zip(cut.kept, firsts, strict=True):
            lowered.store(node, _part("kept", found.graph[node].type, first))
        doc = "Computes the results of a stage and keeps what its slopes need of them."
        return body.finished(name, self._real, ("z", "given"), ("results", "kept"), doc)

    def _slopes(
        self,
        name: str,
        found: StepDerivatives,
        cut: Cut,
        places: Mapping[str, tuple[str, int]],
        arrays: StageArrays,
    ) -> Function:
        body = _Body(cut.slopes, self._functions, self._formulas, places)
        assert found.hessian is not None
        of_results = [
            arrays.results[member.name] + number
            for member in found.results.members
            for number in range(member.size)
        ]
        variables = list(range(found.variables.size))
        matrices = {
            "slopes": WiderMatrix(found.jacobian, of_results, arrays.variables),
            "curvature": WiderMatrix(found.hessian, variables, arrays.variables),
        }
        roots = [cut.moved[n] for wider in matrices.values() for n in wider.matrix.nodes]
        lowered = body.lowered(roots)
        for array, wider in matrices.items():
            body.write_known(array, wider)
            for block in wider.matrix.blocks:
                node = cut.moved[block.node]
                place = wider.entries(array, block, cut.slopes[node].type.shape)
                lowered.store(node, place)
        doc = "Computes slopes and weighted curvature of the results where they were computed last."
        read = ("z", "given", "weight", "kept")
        return body.finished(name, self._real, read, ("slopes", "curvature"), doc)


def _vector_places(array: str, vector: Vector) -> dict[str, tuple[str, int]]:
    return {member.name: (array, member.first) for member in vector.members}


def _part(array: str, type: Type, first: int) -> ArrayView:
    return ArrayView(Name(array), type.shape, c_strides(type.shape), Index(first))


@dataclass(frozen=True, slots=True)
class WiderMatrix:
    """A matrix in an array with more rows and longer ones."""

    matrix: Matrix
    rows: Sequence[int]
    """Where its rows are; those of one quantity follow each other."""
    width: int

    def place(self, number: int) -> int:
        """Where the entry of that number stands."""
        row, column = divmod(number, self.matrix.shape[1])
        return self.rows[row] * self.width + column

    def entries(self, array: str, block: MatrixBlock, shape: tuple[int, ...]) -> ArrayView:
        """Where the entries of a block stand."""
        columns = self.matrix.shape[1]
        steps = [divmod(stride, columns) for stride in block.strides]
        strides = tuple(rows * self.width + column for rows, column in steps)
        return ArrayView(Name(array), shape, strides, Index(self.place(block.offset)))

    def known(self) -> dict[int, float]:
        """Numbers other than 0 that are always the same, by their places."""
        return {self.place(i): x for i, x in enumerate(self.matrix.known) if x}


class _Body:
    """One function while it is written; also where its graph finds its leaves."""

    def __init__(
        self,
        graph: Graph,
        functions: FunctionTable,
        formulas: tuple[Formula, ...],
        places: Mapping[str, tuple[str, int]],
    ) -> None:
        self._graph = graph
        self._places = places
        self._functions = functions
        names = LocalNames(functions.prefix, _names_of_spec(graph))
        for array in ("z", "given", "weight", "kept", "results", "slopes", "curvature", "limit"):
            names.reserve(array)
        self.scope = Scope(names)
        notes = SpecNotes(graph, formulas)
        self._locals = LocalValues(
            functions,
            notes,
            _UNROLL,
            parallel_sums=_SIDE_BY_SIDE,
            block=_BLOCK,
            names_constants=True,
        )

    def lowered(self, roots: Iterable[int]) -> GraphLowering:
        return GraphLowering(self._graph, list(roots), self, self.scope, self._locals)

    def read(self, op: AnyRead, type: Type) -> ArrayView:
        match op:
            case ReadState(name):
                array, first = self._places[name]
            case ReadSignal(name):
                array, first = self._places[name]
            case _:
                raise AssertionError("a trained problem reads states and signals alone")
        return _part(array, type, first)

    def push(self, op: Window, newest: ArrayView, scope: Scope) -> ArrayView | None:
        raise AssertionError("derivatives have no windows of buffers")

    def write_known(self, array: str, wider: WiderMatrix) -> None:
        """Entries that are always the same number."""
        if not wider.rows:
            return
        first, last = min(wider.rows) * wider.width, (max(wider.rows) + 1) * wider.width
        place = ArrayView(Name(array), (last,), (1,))
        with self.scope.loop(last - first) as (index, inner):
            inner.assign(place.element([index.plus(Index(first))]), Real(0.0))
        for number, value in wider.known().items():
            self.scope.assign(place.element([Index(number)]), Real(value))

    def finished(
        self, name: str, real: str, read: tuple[str, ...], written: tuple[str, ...], doc: str
    ) -> Function:
        statements = self.scope.statements
        constants = self._locals.constants(statements)
        used = used_names(statements)
        unused = [Discard(array) for array in (*read, *written) if array not in used]
        arguments = (
            *(Argument(f"const {real} *", array) for array in read),
            *(Argument(f"{real} *", array) for array in written),
        )
        body = (*unused, *constants, *statements)
        prefix = self._functions.prefix
        return Function(f"{prefix}_{name}", "void", arguments, body, doc, static=True)


def _names_of_spec(graph: Graph) -> Iterator[str]:
    for node in graph.nodes:
        if node.label:
            yield node.label
        if isinstance(node.op, Constant) and node.op.name:
            yield node.op.name
