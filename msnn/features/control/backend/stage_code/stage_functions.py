"""Writes the C functions of one stage: one for its values, one for their Jacobian and Hessian."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from backends.c_language.functions import FunctionTable
from backends.c_language.places import ArrayView, Index, c_strides
from backends.c_language.tree import Function, Name
from compiler.hessian.step_derivatives import StepDerivatives, multiplier
from compiler.ir.program import Formula, Graph, NodeId
from compiler.jacobian.matrices import Vector
from msnn.features.control.backend.stage_code.array_places import Place, PlacedMatrix
from msnn.features.control.backend.stage_code.function_body import FunctionBody, part, vector_places
from msnn.features.control.backend.stage_code.stage_graphs import (
    CutGraph,
    Zeros,
    can_end,
    cut_at_values,
    kept_signal,
    values_at_zero,
)


@dataclass(frozen=True, slots=True)
class StageArrays:
    """The layout of the solver's C arrays that the functions of a stage read and write."""

    variables: Mapping[str, Place]
    """The place of each state and control, by name."""
    results: Mapping[str, int]
    """The index of the first element of each result in the array `results`, by name."""
    given: Vector
    """Disturbances and references of a stage, stacked in the array `given`."""
    slopes: PlacedMatrix
    curvature: PlacedMatrix
    steady: Zeros = field(default_factory=dict[str, tuple[bool, ...]])
    """For each state, marks of the elements whose columns of the Jacobian are constant.

    Constant means equal at all stages: the results are linear in these elements.
    """

    @property
    def places(self) -> dict[str, Place]:
        """The places of states, controls, disturbances and references, by name."""
        return {**self.variables, **vector_places("given", self.given)}

    def wanted(self, graph: Graph) -> list[NodeId]:
        """Returns the nodes whose entries of the Jacobian or Hessian the arrays hold."""
        return [
            block.node
            for placed in (self.slopes, self.curvature)
            for block in placed.matrix.blocks
            if placed.has(block, graph[block.node].type.shape)
        ]


@dataclass(frozen=True, slots=True)
class PlacedLimit:
    """A node with the limits of `size` consecutive rows: one for all rows, or one per row.

    Row r has the minimum at index 2 r of the array `limit` and the maximum at 2 r + 1.
    """

    node: NodeId
    first_side: int
    """The index of the first row's limit in the array `limit`."""
    size: int


@dataclass(frozen=True, slots=True)
class StageFunctions:
    """The two C functions of a stage and facts that the solver's templates depend on."""

    values: Function
    slopes: Function
    kept: int
    """Number of intermediate values that `values` saves for `slopes`."""
    can_be_infinite: bool
    """True if a derivative can be infinite at finite states and controls."""
    can_end: bool
    """True if a value can be NaN or infinite at finite, but maybe large, states and controls."""
    lacks_steady: bool
    """True if `values` omits terms with constant Jacobian columns; the solver then adds them."""


class StageWriter:
    """Writes the functions of stages that share a C prefix, kernels and a floating-point type.

    `most_factors` is the argument of `can_end`.
    """

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
        """Writes `<prefix>_<name>value` and `<prefix>_<name>slopes` of a stage with the derivatives
        `found`.

        The first stores the results; the second their Jacobian and the Hessian of Σ weight ·
        result.
        """
        # costly intermediate values are saved for the derivatives, not computed twice
        cut = cut_at_values(found, arrays.wanted(found.graph))
        types = [found.graph[node].type for node in cut.kept]
        # saved values lie one after the other in the array `kept`
        firsts = [sum(type.size for type in types[:number]) for number in range(len(types))]
        places = dict(arrays.places)
        for number, (first, type) in enumerate(zip(firsts, types, strict=True)):
            places[kept_signal(number)] = Place("kept", first, c_strides(type.shape))
        for result, first in arrays.results.items():
            if result in found.values:
                shape = found.graph[found.values[result]].type.shape
                places[multiplier(result)] = Place("weight", first, c_strides(shape))
        # terms with constant Jacobian columns are omitted from the values: the solver adds them
        lean = None
        if any(any(numbers) for numbers in arrays.steady.values()):
            roots = [*found.values.values(), *cut.kept]
            lean = values_at_zero(found.graph, roots, cut.kept, arrays.steady)
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
        """Writes `<prefix>_steady`, which computes the Jacobian columns that are equal at all
        stages; `placed` is the layout of their array.
        """
        body = FunctionBody(found.graph, self._functions, self._formulas, arrays.places)
        body.write((placed,), {node: node for node in placed.matrix.nodes})
        doc = "Computes the slopes of a stage's results that stay the same along the horizon."
        return body.finished("steady", self._real, ("given",), ("steady",), doc)

    def limits(self, graph: Graph, limits: Sequence[PlacedLimit], given: Vector) -> Function:
        """Writes `<prefix>_limits`, which computes limits from the references of a stage. `graph`
        has the nodes of the limits, `given` is the layout of disturbances and references.

        The array `limit` has the minimum of row r at index 2 r and its maximum at 2 r + 1.
        """
        body = FunctionBody(graph, self._functions, self._formulas, vector_places("given", given))
        lowered = body.lowered([limit.node for limit in limits])
        for limit in limits:
            type = graph[limit.node].type
            if type.size == 1:
                # one scalar limit for all rows is stored once per row
                for number in range(limit.size):
                    place = Index(limit.first_side + 2 * number)
                    # strides of 0: the value has one element
                    zeros = (0,) * len(type.shape)
                    lowered.store(limit.node, ArrayView(Name("limit"), type.shape, zeros, place))
                continue
            # minimum and maximum alternate, so that the limits of one side have twice the stride
            strides = tuple(2 * stride for stride in c_strides(type.shape))
            place = ArrayView(Name("limit"), type.shape, strides, Index(limit.first_side))
            lowered.store(limit.node, place)
        doc = "Computes the limits of a stage."
        return body.finished("limits", self._real, ("given",), ("limit",), doc)

    def _values(
        self,
        name: str,
        derivatives: StepDerivatives,
        cut: CutGraph,
        lean: tuple[Graph, Mapping[NodeId, NodeId]],
        places: Mapping[str, Place],
        firsts: list[int],
        arrays: StageArrays,
    ) -> Function:
        """Writes the values function: it stores the results and the intermediate values to save.

        `lean` has the graph of the values and maps nodes of `derivatives.graph` to its nodes.
        `firsts` has the index of each saved value in the array `kept`.
        """
        graph, moved = lean
        body = FunctionBody(graph, self._functions, self._formulas, places)
        lowered = body.lowered([moved[node] for node in (*derivatives.values.values(), *cut.kept)])
        for member in derivatives.results.members:
            node = moved[derivatives.values[member.name]]
            place = part("results", graph[node].type, arrays.results[member.name])
            lowered.store(node, place)
        for node, first in zip(cut.kept, firsts, strict=True):
            lowered.store(moved[node], part("kept", graph[moved[node]].type, first))
        doc = "Computes the results of a stage and keeps what its slopes need of them."
        return body.finished(name, self._real, ("z", "given"), ("results", "kept"), doc)

    def _slopes(
        self,
        name: str,
        derivatives: StepDerivatives,
        cut: CutGraph,
        places: Mapping[str, Place],
        arrays: StageArrays,
    ) -> Function:
        """Writes the derivatives function, which stores entries of the Jacobian and of the Hessian.
        It reads saved intermediate values as `cut` defines.
        """
        body = FunctionBody(cut.slopes, self._functions, self._formulas, places)
        matrices = (arrays.slopes, arrays.curvature)
        body.write(matrices, cut.moved)
        doc = "Computes slopes and weighted curvature of the results where they were computed last."
        read = ("z", "given", "weight", "kept")
        return body.finished(name, self._real, read, ("slopes", "curvature"), doc)
