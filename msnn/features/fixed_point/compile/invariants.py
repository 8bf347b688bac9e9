"""Proves bounds of states without a range in the spec, such as those of stable linear filters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from compiler.ir.ops import Clamp, Constant
from compiler.ir.program import Graph, Node, NodeId, Program, State
from msnn.features.fixed_point.compile.lower_graph import (
    Elements,
    Lowering,
    UnsupportedError,
    elements,
)
from msnn.features.fixed_point.compile.polynomials import PolynomialForm
from msnn.features.fixed_point.compile.word_formats import word_format
from msnn.features.fixed_point.integers.program import Width

_MARGIN = 1.0 + 2.0**-6
"""Factor for rounding errors; the state is also saturated at its bound."""

_LONGEST_MEMORY = 2**16
"""Number of steps after which Aᵏ must have vanished."""


def proved_bounds(
    states: Sequence[State],
    program: Program,
    width: Width,
    reads: Callable[[Lowering, Node], Elements],
    known: Callable[[Lowering, str], Elements],
    starts: Mapping[str, float],
) -> dict[str, float]:
    """Bounds |s| of each state s with s⁺ = A s + d, where d is bounded, by name: the largest
    magnitude of its elements.

    |s| ≤ Σₖ |Aᵏ| |d| + maxₖ |Aᵏ| |s₀|; `starts` are bounds of |s₀|. `reads` and `known` give the
    forms of signals and of states with known bounds. The first attempt ignores the clamps of
    equations to their ranges. If it gives no bound, each value clamped to two constants becomes
    part of d, as any value between them. Raises UnsupportedError if the next value is not linear in
    these states or Aᵏ does not vanish.
    """
    limited, expected = _limited(program), {entry.node for entry in program.expected}
    within = {node: None for node in limited if program.step[node].args[0] in expected}
    try:
        return _proved(states, program.step, width, reads, known, starts, within)
    except UnsupportedError:
        if not limited:
            raise
        return _proved(states, program.step, width, reads, known, starts, limited)


def _limited(program: Program) -> dict[NodeId, tuple[float, float] | None]:
    """The nodes of the step that are clamped to two constants, with these limits as (low, high)."""
    found: dict[NodeId, tuple[float, float] | None] = {}
    for index, node in program.step:
        if isinstance(node.op, Clamp):
            low, high = (_number(program.step, arg) for arg in node.args[1:])
            if low is not None and high is not None:
                found[index] = low, high
    return found


def _number(graph: Graph, index: NodeId) -> float | None:
    op = graph[graph.unrepeated(index)].op
    if isinstance(op, Constant) and len(set(op.values)) == 1:
        return op.values[0]
    return None


def _proved(
    states: Sequence[State],
    graph: Graph,
    width: Width,
    reads: Callable[[Lowering, Node], Elements],
    known: Callable[[Lowering, str], Elements],
    starts: Mapping[str, float],
    limited: Mapping[NodeId, tuple[float, float] | None],
) -> dict[str, float]:
    # Each element of the states is a symbol. What their next values are in these symbols gives a
    # row of A; all that has no symbol in it is bounded, and is d.
    symbols: dict[int, int] = {}
    own: dict[str, Elements] = {}

    def state_values(lowering: Lowering, name: str) -> Elements:
        if name not in sizes:
            return known(lowering, name)
        if name not in own:
            nodes = [lowering.builder.word(f"{name} (any)", i, 0, 0, 0) for i in range(sizes[name])]
            for node in nodes:
                symbols[node] = len(symbols)
            own[name] = elements(lowering, nodes, shapes[name])
        return own[name]

    shapes = {state.name: tuple(axis.size for axis in state.axes) for state in states}
    sizes = {name: int(np.prod(shape, dtype=int)) for name, shape in shapes.items()}
    lowering = _Symbolic(graph, width, reads, state_values, symbols, limited)
    for name in sizes:
        state_values(lowering, name)
    count = len(symbols)
    # A is (count, count) over all elements of all states, d the bound of the rest of each row
    matrix, drive = np.zeros((count, count)), np.zeros(count)
    first = np.concatenate([np.full(sizes[name], starts[name]) for name in sizes])
    row = 0
    for state in states:
        for form in lowering.value(state.next).ravel():
            lowering.place = state
            for monomial, coefficient in form.terms:
                if len(monomial) == 1 and monomial[0] in symbols:
                    matrix[row, symbols[monomial[0]]] = coefficient
            rest = tuple((m, c) for m, c in form.terms if not any(n in symbols for n in m))
            # settling the rest bounds it with all its roundings, as the real program will have them
            node = lowering.node(PolynomialForm(lowering, form.constant, rest))
            drive[row] = max(abs(bound) for bound in lowering.builder.bounds(node))
            row += 1
    reach = _reach(matrix, drive, first)
    if reach is None:
        culprit = states[0]
        why = "has no `range:`, and none can be proved: it does not forget"
        raise UnsupportedError(f"state `{culprit.name}`", culprit.span, why)
    split = np.split(reach, np.cumsum(list(sizes.values()))[:-1])
    return {name: float(part.max()) for name, part in zip(sizes, split, strict=True)}


class _Symbolic(Lowering):
    """Lowers a graph to sums that are linear in symbols: the elements of states without a range.

    Such a sum stays exact. Raises UnsupportedError if a sum with symbols is multiplied by another
    one or rounded. Each clamp in `limited` is replaced by its operand (None) or by any value in its
    range.
    """

    def __init__(
        self,
        graph: Graph,
        width: Width,
        reads: Callable[[Lowering, Node], Elements],
        states: Callable[[Lowering, str], Elements],
        symbols: Mapping[int, int],
        limited: Mapping[NodeId, tuple[float, float] | None],
    ) -> None:
        super().__init__(graph, width, reads, states)
        self._symbols, self._limited = symbols, limited
        self.place: State | None = None

    def _operands(self, index: NodeId) -> tuple[NodeId, ...]:
        if index not in self._limited:
            return super()._operands(index)
        return self.graph[index].args[:1] if self._limited[index] is None else ()

    def _lowered(self, index: NodeId) -> Elements:
        if index not in self._limited:
            return super()._lowered(index)
        node, limits = self.graph[index], self._limited[index]
        if limits is None:
            return self.value(node.args[0])
        word = word_format(*limits, self.builder.width.word)
        anything = [
            self.builder.word(f"%{index} (any)", element, *word)
            for element in range(node.type.size)
        ]
        return elements(self, anything, node.type.shape)

    def node(self, form: PolynomialForm) -> int:
        self._refuse(form)
        return super().node(form)

    def product(self, left: PolynomialForm, right: PolynomialForm) -> PolynomialForm:
        self._refuse(left)
        self._refuse(right)
        return super().product(left, right)

    def shortened(self, form: PolynomialForm) -> PolynomialForm:
        return form if self._has_symbols(form) else super().shortened(form)

    def _has_symbols(self, form: PolynomialForm) -> bool:
        return any(node in self._symbols for monomial, _ in form.terms for node in monomial)

    def _refuse(self, form: PolynomialForm) -> None:
        if self._has_symbols(form):
            why = "has no `range:`, and none can be proved: its next value is not linear in it"
            raise UnsupportedError("a state", self.builder.span, why)


def _reach(
    matrix: NDArray[np.float64], drive: NDArray[np.float64], first: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    power, driven, started = np.eye(len(drive)), np.zeros(len(drive)), np.zeros(len(drive))
    for _ in range(_LONGEST_MEMORY):
        # |Aᵏ| |d| is what an input k steps ago can add now; the start fades by the same powers
        size = np.abs(power)
        driven, started = driven + size @ drive, np.maximum(started, size @ first)
        # signed: |Aᵏ| forgets where |A|ᵏ may not, as in a filter whose taps alternate in sign
        power = power @ matrix
        if not np.isfinite(power).all():
            return None
        # what is left of the sum is less than _MARGIN allows for
        if np.abs(power).max() < 1e-12:
            return (driven + started) * _MARGIN
    return None
