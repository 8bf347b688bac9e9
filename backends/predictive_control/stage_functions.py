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
from backends.predictive_control.placed_matrix import PlacedMatrix
from backends.predictive_control.series import Place
from compiler.hessian.step_derivatives import StepDerivatives, multiplier
from compiler.ir.ops import AnyRead, Constant, ReadSignal, ReadState, Window
from compiler.ir.program import Formula, Graph, NodeId
from compiler.ir.types import Type
from compiler.jacobian.matrices import Vector

_UNROLL = 4
_BLOCK = 8
_SIDE_BY_SIDE = 4
"""Partial sums: a processor adds them up at once. The judge allows for any order of a sum."""


@dataclass(frozen=True, slots=True)
class StageArrays:
    """How the arrays of the solver are laid out."""

    variables: Mapping[str, Place]
    """Where a stage finds states and controls."""
    results: Mapping[str, int]
    """Where the first number of each result stands among those of any stage."""
    given: Vector
    """Disturbances and references."""
    slopes: PlacedMatrix
    curvature: PlacedMatrix

    @property
    def places(self) -> dict[str, Place]:
        """Where all that values read stands."""
        return {**self.variables, **_vector_places("given", self.given)}

    def wanted(self, graph: Graph) -> list[NodeId]:
        """The nodes of which the arrays have entries."""
        return [
            block.node
            for placed in (self.slopes, self.curvature)
            for block in placed.matrix.blocks
            if placed.has(block, graph[block.node].type.shape)
        ]


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
        cut = cut_at_values(found, arrays.wanted(found.graph))
        types = [found.graph[node].type for node in cut.kept]
        firsts = [sum(type.size for type in types[:number]) for number in range(len(types))]
        places = dict(arrays.places)
        for number, (first, type) in enumerate(zip(firsts, types, strict=True)):
            places[kept_signal(number)] = Place("kept", first, c_strides(type.shape))
        for result, first in arrays.results.items():
            if result in found.values:
                shape = found.graph[found.values[result]].type.shape
                places[multiplier(result)] = Place("weight", first, c_strides(shape))
        return StageFunctions(
            self._values(f"{name}value", found, cut, places, firsts, arrays),
            self._slopes(f"{name}slopes", found, cut, places, arrays),
            sum(type.size for type in types),
            any(matrix.perhaps_infinite for matrix in found.matrices),
        )

    def steady(self, found: StepDerivatives, arrays: StageArrays, placed: PlacedMatrix) -> Function:
        """`<prefix>_steady`: the slopes that are the same at all stages."""
        body = _Body(found.graph, self._functions, self._formulas, arrays.places)
        body.write((placed,), {node: node for node in placed.matrix.nodes})
        doc = "Computes the slopes of a stage's results that stay the same along the horizon."
        return body.finished("steady", self._real, ("given",), ("steady",), doc)

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
        places: Mapping[str, Place],
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
        places: Mapping[str, Place],
        arrays: StageArrays,
    ) -> Function:
        body = _Body(cut.slopes, self._functions, self._formulas, places)
        matrices = (arrays.slopes, arrays.curvature)
        body.write(matrices, cut.moved)
        doc = "Computes slopes and weighted curvature of the results where they were computed last."
        read = ("z", "given", "weight", "kept")
        return body.finished(name, self._real, read, ("slopes", "curvature"), doc)


def _vector_places(array: str, vector: Vector) -> dict[str, Place]:
    return {
        member.name: Place(array, member.first, c_strides(Type(member.axes).shape))
        for member in vector.members
    }


def _part(array: str, type: Type, first: int) -> ArrayView:
    return ArrayView(Name(array), type.shape, c_strides(type.shape), Index(first))


class _Body:
    """One function while it is written; also where its graph finds its leaves."""

    def __init__(
        self,
        graph: Graph,
        functions: FunctionTable,
        formulas: tuple[Formula, ...],
        places: Mapping[str, Place],
    ) -> None:
        self._graph = graph
        self._places = places
        self._functions = functions
        names = LocalNames(functions.prefix, _names_of_spec(graph))
        for array in (
            "z",
            "given",
            "weight",
            "kept",
            "results",
            "slopes",
            "curvature",
            "steady",
            "limit",
        ):
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
                place = self._places[name]
            case ReadSignal(name):
                place = self._places[name]
            case _:
                raise AssertionError("a trained problem reads states and signals alone")
        return ArrayView(Name(place.array), type.shape, place.strides, Index(place.first))

    def push(self, op: Window, newest: ArrayView, scope: Scope) -> ArrayView | None:
        raise AssertionError("derivatives have no windows of buffers")

    def write(self, matrices: Iterable[PlacedMatrix], moved: Mapping[NodeId, NodeId]) -> None:
        """The entries that the arrays have; `moved` says which nodes of the graph they are."""
        wanted = [
            (
                placed,
                [
                    (block, moved[block.node])
                    for block in placed.matrix.blocks
                    if block.node in moved and placed.has(block, self._shape(moved[block.node]))
                ],
            )
            for placed in matrices
        ]
        lowered = self.lowered([node for _, blocks in wanted for _, node in blocks])
        for placed, blocks in wanted:
            self._write_known(placed)
            for block, node in blocks:
                for part, view in placed.parts(block, lowered.value(node)):
                    lowered.store_part(node, part, view)

    def _shape(self, node: NodeId) -> tuple[int, ...]:
        return self._graph[node].type.shape

    def _write_known(self, placed: PlacedMatrix) -> None:
        """Entries that are always the same number."""
        first, last = placed.first, placed.last
        if first == last:
            return
        place = ArrayView(Name(placed.array), (last,), (1,))
        with self.scope.loop(last - first) as (index, inner):
            inner.assign(place.element([index.plus(Index(first))]), Real(0.0))
        for number, value in placed.known().items():
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
