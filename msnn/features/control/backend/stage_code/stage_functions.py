"""Writes the functions of one stage in C: its values, and their slopes and curvature."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from backends.c_language.functions import FunctionTable
from backends.c_language.places import ArrayView, Index, c_strides
from backends.c_language.tree import Function, Name
from compiler.hessian.step_derivatives import StepDerivatives, multiplier
from compiler.ir.program import Formula, Graph, NodeId
from compiler.jacobian.matrices import Vector
from msnn.features.control.backend.stage_code.cut import CutGraph, cut_at_values, kept_signal
from msnn.features.control.backend.stage_code.function_body import FunctionBody, part, vector_places
from msnn.features.control.backend.stage_code.placed_matrix import PlacedMatrix
from msnn.features.control.backend.stage_code.series import Place
from msnn.features.control.backend.stage_code.values_that_end import can_end
from msnn.features.control.backend.value_at_zero import Zeros, values_at_zero


@dataclass(frozen=True, slots=True)
class StageArrays:
    """The layout of the solver's arrays."""

    variables: Mapping[str, Place]
    """Where a stage finds states and controls."""
    results: Mapping[str, int]
    """Where the first number of each result stands among those of any stage."""
    given: Vector
    """Disturbances and references."""
    slopes: PlacedMatrix
    curvature: PlacedMatrix
    steady: Zeros = field(default_factory=dict[str, tuple[bool, ...]])
    """Numbers of states in which the results are linear with slopes that stay the same."""

    @property
    def places(self) -> dict[str, Place]:
        """The places of all that values read."""
        return {**self.variables, **vector_places("given", self.given)}

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
    can_end: bool
    """Values can be NaN or infinite where variables are finite, however far."""
    lacks_steady: bool
    """Whether the values are those without what steady slopes say."""


class StageWriter:
    """Writes functions that share prefix, kernels and type."""

    def __init__(
        self,
        functions: FunctionTable,
        formulas: tuple[Formula, ...],
        real: str,
        most_factors: float,
    ) -> None:
        self._functions = functions
        self._formulas = formulas
        self._real = real
        self._most_factors = most_factors

    def stage(self, name: str, found: StepDerivatives, arrays: StageArrays) -> StageFunctions:
        """`<prefix>_<name>value` and `<prefix>_<name>slopes` of these derivatives."""
        # what slopes take from the values is kept, not computed twice
        cut = cut_at_values(found, arrays.wanted(found.graph))
        types = [found.graph[node].type for node in cut.kept]
        # kept values lie one after the other in `kept`, which the values write and the slopes read
        firsts = [sum(type.size for type in types[:number]) for number in range(len(types))]
        places = dict(arrays.places)
        for number, (first, type) in enumerate(zip(firsts, types, strict=True)):
            places[kept_signal(number)] = Place("kept", first, c_strides(type.shape))
        for result, first in arrays.results.items():
            if result in found.values:
                shape = found.graph[found.values[result]].type.shape
                places[multiplier(result)] = Place("weight", first, c_strides(shape))
        # numbers of steady slopes are left out of the values, which other code adds
        lean = None
        if any(any(numbers) for numbers in arrays.steady.values()):
            wanted = [*found.values.values(), *cut.kept]
            lean = values_at_zero(found.graph, wanted, cut.kept, arrays.steady)
        graph, moved = lean or (found.graph, {node: node for node, _ in found.graph})
        return StageFunctions(
            self._values(f"{name}value", found, cut, (graph, moved), places, firsts, arrays),
            self._slopes(f"{name}slopes", found, cut, places, arrays),
            sum(type.size for type in types),
            any(matrix.perhaps_infinite for matrix in found.matrices),
            can_end(found.graph, found.values.values(), self._most_factors),
            lean is not None,
        )

    def steady(self, found: StepDerivatives, arrays: StageArrays, placed: PlacedMatrix) -> Function:
        """`<prefix>_steady`: the slopes that are the same at all stages."""
        body = FunctionBody(found.graph, self._functions, self._formulas, arrays.places)
        body.write((placed,), {node: node for node in placed.matrix.nodes})
        doc = "Computes the slopes of a stage's results that stay the same along the horizon."
        return body.finished("steady", self._real, ("given",), ("steady",), doc)

    def limits(self, graph: Graph, limits: Sequence[PlacedLimit], given: Vector) -> Function:
        """`<prefix>_limits`: the limits of a stage, by their sides."""
        body = FunctionBody(graph, self._functions, self._formulas, vector_places("given", given))
        lowered = body.lowered([limit.node for limit in limits])
        for limit in limits:
            type = graph[limit.node].type
            if type.size == 1:
                # one number for all rows is stored at each of them
                for number in range(limit.size):
                    place = Index(limit.first_side + 2 * number)
                    # a stride of 0 along every axis: the one element has the place as its own
                    zeros = (0,) * len(type.shape)
                    lowered.store(limit.node, ArrayView(Name("limit"), type.shape, zeros, place))
                continue
            # a row has two sides, one beside the other: its limits stand at every second place
            strides = tuple(2 * stride for stride in c_strides(type.shape))
            place = ArrayView(Name("limit"), type.shape, strides, Index(limit.first_side))
            lowered.store(limit.node, place)
        doc = "Computes the limits of a stage."
        return body.finished("limits", self._real, ("given",), ("limit",), doc)

    def _values(
        self,
        name: str,
        found: StepDerivatives,
        cut: CutGraph,
        lean: tuple[Graph, Mapping[NodeId, NodeId]],
        places: Mapping[str, Place],
        firsts: list[int],
        arrays: StageArrays,
    ) -> Function:
        graph, moved = lean
        body = FunctionBody(graph, self._functions, self._formulas, places)
        lowered = body.lowered([moved[node] for node in (*found.values.values(), *cut.kept)])
        for member in found.results.members:
            node = moved[found.values[member.name]]
            place = part("results", graph[node].type, arrays.results[member.name])
            lowered.store(node, place)
        for node, first in zip(cut.kept, firsts, strict=True):
            lowered.store(moved[node], part("kept", graph[moved[node]].type, first))
        doc = "Computes the results of a stage and keeps what its slopes need of them."
        return body.finished(name, self._real, ("z", "given"), ("results", "kept"), doc)

    def _slopes(
        self,
        name: str,
        found: StepDerivatives,
        cut: CutGraph,
        places: Mapping[str, Place],
        arrays: StageArrays,
    ) -> Function:
        body = FunctionBody(cut.slopes, self._functions, self._formulas, places)
        matrices = (arrays.slopes, arrays.curvature)
        body.write(matrices, cut.moved)
        doc = "Computes slopes and weighted curvature of the results where they were computed last."
        read = ("z", "given", "weight", "kept")
        return body.finished(name, self._real, read, ("slopes", "curvature"), doc)
