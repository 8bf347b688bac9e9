"""Evaluates a graph with changed operands of single nodes, one change per row (mutation testing).

If a change affects a result, the step detects a wrong constant, operand or operator at this place
in generated C (DeMillo, Lipton, Sayward: Hints on test data selection, 1978).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import NDArray

from compiler.interpreter.operations import (
    NOWHERE,
    Array,
    Evaluator,
    LeafValues,
    evaluator,
    repeated_batch,
)
from compiler.ir import ops
from compiler.ir.nodes import needed
from compiler.ir.program import Graph, NodeId

Kind = Literal["moved", "negated", "flipped"]

_ELEMENTS = 8
"""Operands with more elements have changes of the first, middle and last element only."""


@dataclass(frozen=True, slots=True)
class Change:
    """A change that imitates an error of generated C: one element (index in C order) of an operand
    of a node. Kind `moved` increases it slightly, `negated` changes its sign, `flipped` inverts a
    bool.
    """

    node: NodeId
    operand: int
    element: int
    kind: Kind


class ChangeableGraph:
    """The nodes of a graph that some results depend on, with an evaluator that can change operands
    of single nodes.
    """

    def __init__(
        self,
        graph: Graph,
        results: Iterable[NodeId],
        weights: Mapping[str, NDArray[Any]],
        dtype: np.dtype[Any],
    ) -> None:
        live = needed(graph, results)
        self._graph = graph
        with np.errstate(over="ignore"):  # a weight beyond float32 is infinite, as in C
            self._evaluators: dict[NodeId, Evaluator] = {
                i: evaluator(n, tuple(graph[a].type for a in n.args), weights, dtype)
                for i, n in graph
                if live[i]
            }

    @property
    def size(self) -> int:
        """The number of elements that one step computes, with the terms of sums counted
        separately.
        """
        return sum(
            self._graph[index].type.size + sum(self._graph[arg].type.size for arg in node.args)
            if isinstance((node := self._graph[index]).op, ops.Reduction)
            else node.type.size
            for index in self._evaluators
        )

    def changes(self) -> list[Change]:
        """All changes that are tried: for each node the first, middle and last element, or all of
        up to 8 elements, of each operand. Numbers are moved and negated, bools flipped.
        """
        found: list[Change] = []
        for index in self._evaluators:
            node = self._graph[index]
            # structural operations are tested at their users; a window also reads the state
            if isinstance(node.op, ops.Structure | ops.Identity | ops.Window):
                continue
            for operand, arg in enumerate(node.args):
                type = self._graph[arg].type
                kinds: tuple[Kind, ...] = (
                    ("flipped",) if type.kind == "bool" else ("moved", "negated")
                )
                last = type.size - 1
                elements = range(last + 1) if last < _ELEMENTS else (0, last // 2, last)
                found += [Change(index, operand, e, kind) for e in elements for kind in kinds]
        return found

    def run(self, around: LeafValues, parameters: Mapping[str, Array]) -> Mapping[NodeId, Array]:
        """The values by node id, (B, *shape), or (1, *shape) if equal for all rows; computed when
        they are read. `around` has the log, rows and states; `parameters` (B, *shape) replace
        weights.
        """
        return _Asked(self._graph, self._evaluators, around, parameters)

    def with_changes(
        self,
        right: Mapping[NodeId, Array],
        copies: NDArray[np.int64],
        around: LeafValues,
        changes: Mapping[Change, NDArray[np.int64]],
    ) -> Mapping[NodeId, Array]:
        """The values by node id in copies of rows of `right`, the correct values, with changes.
        `copies` has the row of `right` for each copy, `around` the data of the copies, `changes`
        the copies to which each change applies. Nodes that no change affects are not recomputed.
        """
        by_node: dict[NodeId, list[tuple[Change, NDArray[np.int64]]]] = {}
        for change, rows in changes.items():
            by_node.setdefault(change.node, []).append((change, rows))
        values, touched = _Copied(right, copies), set[NodeId]()
        with np.errstate(all="ignore"):
            for index, evaluate in self._evaluators.items():
                # recompute first: the node may depend on an earlier change
                if not touched.isdisjoint(self._graph[index].args):
                    values[index] = evaluate(cast("list[Array]", values), around)
                    touched.add(index)
                if index in by_node:
                    value = repeated_batch(values[index], len(copies)).copy()
                    for change, rows in by_node[index]:
                        # one change per copy, like a mutant of the C code
                        value[rows] = self._changed(evaluate, change, values, rows)
                    values[index] = value
                    touched.add(index)
        return values

    def _changed(
        self,
        evaluate: Evaluator,
        change: Change,
        values: Mapping[NodeId, Array],
        rows: NDArray[np.int64],
    ) -> Array:
        """The values of the changed node in the copies `rows`, (rows, *shape). `values` are the
        operands before the change.
        """
        args = self._graph[change.node].args
        operands = {arg: values[arg][rows] if len(values[arg]) > 1 else values[arg] for arg in args}
        changed = repeated_batch(operands[args[change.operand]], len(rows)).copy()
        numbers = changed.reshape(len(rows), -1)[:, change.element]
        match change.kind:
            case "moved":
                # by 1 %, and 0 changes as well
                numbers[:] = numbers * 1.01 + 0.001
            case "negated":
                numbers[:] = -numbers
            case "flipped":
                numbers[:] = ~numbers
        operands[args[change.operand]] = changed
        return evaluate(cast("list[Array]", operands), NOWHERE)


class _Asked(dict[NodeId, Array]):
    """Values by node id, each computed with its operands when it is first read. `around` has the
    log, rows and states; `parameters` (B, *shape) replace weights.
    """

    def __init__(
        self,
        graph: Graph,
        evaluators: Mapping[NodeId, Evaluator],
        around: LeafValues,
        parameters: Mapping[str, Array],
    ) -> None:
        super().__init__()
        self._graph, self._evaluators = graph, evaluators
        self._around, self._parameters = around, parameters

    def __missing__(self, asked: NodeId) -> Array:
        # no recursion: a graph may exceed Python's recursion limit
        waiting = [asked]
        with np.errstate(all="ignore"):
            while waiting:
                node = self._graph[waiting[-1]]
                before = [arg for arg in node.args if arg not in self]
                if before:
                    waiting += before
                    continue
                index = waiting.pop()
                if index in self:
                    continue
                if isinstance(node.op, ops.ReadParameter) and node.op.name in self._parameters:
                    self[index] = self._parameters[node.op.name]
                else:
                    values = cast("list[Array]", self)
                    self[index] = self._evaluators[index](values, self._around)
        return self[asked]


class _Copied(dict[NodeId, Array]):
    """Values by node id in copies of rows: copy k has row `copies[k]` of `values`, made when a node
    is first read.
    """

    def __init__(self, values: Mapping[NodeId, Array], copies: NDArray[np.int64]) -> None:
        super().__init__()
        self._values, self._copies = values, copies

    def __missing__(self, node: NodeId) -> Array:
        value = self._values[node]
        self[node] = value if len(value) == 1 else value[self._copies]
        return self[node]
