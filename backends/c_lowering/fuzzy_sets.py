"""Computes active fuzzy sets only: their search, memberships, and sums that skip the rest."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal, assert_never

import numpy as np

from backends.c_language import tree as c
from backends.c_language.literals import Dtype
from backends.c_language.places import ArrayView, Index, variable
from backends.c_language.scope import BlockScope
from backends.c_lowering.state_memory import StateMemory, joining, seen_values
from backends.c_lowering.values import LocalValues
from compiler.ir.ops import Add
from compiler.ir.program import Graph, Node, NodeId, Program
from compiler.ir.types import Axis, Type
from compiler.passes.analyses.compact_sets import (
    CompactSets,
    active_sums,
    compact_sets,
    is_positive_zero,
    supports,
)


@dataclass(frozen=True, slots=True)
class EvenPoints:
    """Evenly spaced points, between which the interval of x is found by ⌊(x − origin) · factor⌋,
    for x from the first to below the last point. If it is not `exact`, it can be one too high just
    below the upper end of an interval.
    """

    origin: float
    factor: float
    exact: bool


def even_points(points: Sequence[float], dtype: Dtype) -> EvenPoints | None:
    """Origin and factor with which one product finds the interval of x between ascending `points`
    in the arithmetic of `dtype`; None if the points are not evenly spaced enough. Subtraction,
    multiplication and truncation are monotonic, so it suffices to check the lowest and the highest
    float of each interval.
    """
    real = np.dtype(dtype).type
    rounded = np.array(points, dtype)
    count = len(rounded) - 1
    if count < 2 or not np.all(np.diff(rounded) > 0):
        return None
    # the highest float below each upper end, which belongs to the next interval
    lowest, highest = rounded[:-1], np.nextafter(rounded[1:], real(-np.inf))
    intervals = np.arange(count)
    quotient = real(count) / (rounded[-1] - rounded[0])
    for larger in _LARGER:
        factor = quotient + real(larger) * np.spacing(quotient)
        first, last = (np.floor((x - rounded[0]) * factor) for x in (lowest, highest))
        # one comparison corrects a result that is too high; too low would need another one
        if np.all(first == intervals) and np.all(last <= intervals + 1):
            exact = bool(np.all(last == intervals))
            return EvenPoints(float(rounded[0]), float(factor), exact)
    return None


_LARGER = (0, 1, 2, 4, 8, 16, 32, 64, 128, 256)
"""Tried increments of the factor, in ulp."""


@dataclass(frozen=True, slots=True)
class ActiveMemberships:
    """The one or two fuzzy sets of a variable that can have a degree of membership above 0: their
    indices and C expressions of their degrees.
    """

    positions: tuple[Index, ...]
    degrees: tuple[c.Expression, ...]


def active_memberships(
    node: Node,
    shape: Literal["triangular", "rectangular"],
    value: c.Expression,
    points: ArrayView,
    numbers: Sequence[float] | None,
    locals: LocalValues,
    scope: BlockScope,
) -> ActiveMemberships:
    """Writes C that searches the active fuzzy sets of `value` and computes their degrees of
    membership, with the same rounding as the general formula. `points` is the place of the centres
    of triangular or the bounds of rectangular sets (`shape`). `numbers` are their values if known
    at compile time, else None. `node` is that of all degrees, for comments and names.
    """
    locals.notes.write(node, scope)
    writer = _Writer(node, value, points, numbers, locals, scope)
    match shape:
        case "triangular":
            return writer.triangular()
        case "rectangular":
            return writer.rectangular()
        case _:
            assert_never(shape)


class _Writer:
    def __init__(
        self,
        node: Node,
        value: c.Expression,
        points: ArrayView,
        numbers: Sequence[float] | None,
        locals: LocalValues,
        scope: BlockScope,
    ) -> None:
        self._value = value
        self._points = points
        self._count = points.shape[0]
        self._numbers = numbers
        self._locals = locals
        self._scope = scope
        self._name = locals.notes.part_name(node, "sets")
        self._at = c.Name(scope.fresh(f"{self._name}_at"))

    def triangular(self) -> ActiveMemberships:
        """Writes the search for two neighbouring triangular sets and their degrees. Below the first
        or above the last centre one set has the degree 1, the other 0.
        """
        scope, last, first = self._scope, self._count - 1, variable(self._at.text)
        here, following = (c.Name(scope.fresh(f"{self._name}_{n}")) for n in ("here", "next"))
        scope.add(c.Declare(c.CType.UNSIGNED, self._at.text, c.Unsigned(0)))
        scope.add(c.Declare(c.CType.REAL, here.text))
        scope.add(c.Declare(c.CType.REAL, following.text))
        below, above, inside = scope.inner(), scope.inner(), scope.inner()
        # NaN fails all comparisons and comes here: the result is NaN, and reads stay in bounds
        below.assign(here, self._beyond(0))
        below.assign(following, c.Real(0.0))
        above.assign(self._at, c.Unsigned(last - 1))
        above.assign(here, c.Real(0.0))
        above.assign(following, self._beyond(last))
        # the value is between the ends, so the search needs no bounds check
        self._find_interval(inside)
        slope = self._slope(inside)
        # below the next centre: no zero whose sign would differ from (x - c) * (-slope)
        inside.assign(
            here,
            c.Binary("*", c.Binary("-", self._point(first.plus(Index(1))), self._value), slope),
        )
        inside.assign(
            following, c.Binary("*", c.Binary("-", self._value, self._point(first)), slope)
        )
        within = c.If(self._reaches(Index(0)), tuple(inside.statements), tuple(below.statements))
        scope.add(c.If(self._reaches(Index(last)), tuple(above.statements), (within,)))
        return ActiveMemberships((first, first.plus(Index(1))), (here, following))

    def rectangular(self) -> ActiveMemberships:
        """Writes the search for the one active set, whose index is the number of bounds at or below
        the value. Its degree is 1.
        """
        self._scope.add(c.Declare(c.CType.UNSIGNED, self._at.text, c.Unsigned(0)))
        self._search(self._count + 1, -1, self._scope)
        return ActiveMemberships((variable(self._at.text),), (c.Real(1.0),))

    def _find_interval(self, scope: BlockScope) -> None:
        """Writes the search for the interval of a value between the first and the last centre, into
        the local variable of the index.
        """
        even = None
        if self._numbers is not None:
            even = even_points(self._numbers, self._locals.functions.dtype)
        if even is None:
            self._search(self._count - 1, 0, scope)
        else:
            self._calculate(even, scope)

    def _calculate(self, even: EvenPoints, scope: BlockScope) -> None:
        distance = _difference(self._value, c.Real(even.origin))
        place = scope.constant(f"{self._name}_place", c.Binary("*", distance, c.Real(even.factor)))
        # even points: one product gives the interval; rounding may give the next one
        scope.assign(self._at, c.Convert(c.CType.UNSIGNED, place))
        if not even.exact:
            rounded_up = c.Binary("<", self._value, self._point(variable(self._at.text)))
            back = c.Assign(self._at, c.Binary("-", self._at, c.Unsigned(1)))
            scope.add(c.If(rounded_up, (back,)))

    def _search(self, count: int, offset: int, scope: BlockScope) -> None:
        """Writes a binary search over `count` intervals, which takes the same number of comparisons
        for every value. The bound below interval i is point i + `offset`.
        """
        where = variable(self._at.text)
        reached = Index()
        while count > 1:
            # the same number of comparisons for every value
            half = count // 2
            step = c.Assign(self._at, c.Binary("+", self._at, c.Unsigned(half)))
            bound = reached.plus(Index(half + offset))
            scope.add(c.If(self._reaches(bound), (step,)))
            count -= half
            reached = where

    def _slope(self, scope: BlockScope) -> c.Expression:
        """The C expression 1 / (cᵢ₊₁ − cᵢ) for the centres c around the interval i that was found,
        rounded as in the general formula.
        """
        where = variable(self._at.text)
        if self._numbers is None:
            width = c.Binary("-", self._point(where.plus(Index(1))), self._point(where))
            return scope.constant(f"{self._name}_slope", c.Binary("/", c.Real(1.0), width))
        slopes = 1.0 / np.diff(np.array(self._numbers))
        rounded = slopes.astype(self._locals.functions.dtype)
        # evenly spaced points have a common factor, written as a literal
        if np.all(rounded == rounded[0]):
            return c.Real(float(rounded[0]))
        type = Type((Axis("interval", len(slopes)),))
        table = self._locals.known(tuple(slopes), type, f"{self._name}_slopes", scope)
        return scope.constant(f"{self._name}_slope", table.element((where,)))

    def _beyond(self, end: int) -> c.Expression:
        """The C expression of the degree beyond the end with index `end`: 1, but NaN if the value
        is NaN or infinite, as the general formula gives.
        """
        distance = _difference(self._value, self._point(Index(end)))
        return c.Binary("+", c.Binary("*", distance, c.Real(0.0)), c.Real(1.0))

    def _reaches(self, where: Index) -> c.Expression:
        return c.Binary(">=", self._value, self._point(where))

    def _point(self, where: Index) -> c.Expression:
        return self._points.element((where,))


def _difference(left: c.Expression, right: c.Expression) -> c.Expression:
    """The C expression left − right; a negative literal becomes left + |right|."""
    if isinstance(right, c.Real) and right.value < 0.0:
        return c.Binary("+", left, c.Real(-right.value))
    return c.Binary("-", left, right)


@dataclass(frozen=True, slots=True)
class ActiveSums:
    """The nodes of a graph that C computes for active fuzzy sets only. Inactive sets have a degree
    of membership of 0 and are skipped.
    """

    sets: dict[NodeId, CompactSets] = field(default_factory=dict[NodeId, CompactSets])
    """Degrees of membership that are computed for active sets only."""
    sums: dict[NodeId, NodeId] = field(default_factory=dict[NodeId, NodeId])
    """Sums over the terms of active sets only, with their sets."""
    parts: frozenset[NodeId] = frozenset()
    """Values that only such sums read: computed where they are used, not stored."""


def sums_of_active_sets(program: Program, memories: Iterable[StateMemory]) -> list[NodeId]:
    """The nodes of the step that are sums over fuzzy sets and that generated C computes over active
    sets only. `memories` are the states in C. If a term of an inactive set is infinite or NaN, the
    sum is NaN in the interpreter but not in C. Such steps do not have to give the same bits.
    """
    read = seen_values(program) + [joining(memory) for memory in memories]
    return [*find_active_sums(program.step, read).sums]


def find_active_sums(graph: Graph, roots: Iterable[NodeId]) -> ActiveSums:
    """The sums over fuzzy sets that have the same bits if terms of inactive sets are skipped. That
    requires that +0 is added to the sum (`settle_zeros`), so that a sum of zeros is +0. Fuzzy sets
    that anything else reads are computed completely. `roots` are the nodes whose values are needed.
    """
    found = compact_sets(graph)
    support = supports(graph, found)
    sums = active_sums(graph, support)
    users = _users(graph, roots)
    sums = {node: sets for node, sets in sums.items() if _settled(graph, users[node])}
    carried: list[set[NodeId]] = [set() for _ in graph.nodes]
    # users have higher ids, so they are processed before their operands
    for index in range(len(graph) - 1, -1, -1):
        read_by = users[index]
        carried[index] = {
            sets
            for sets in support[index].values()
            # a sum along another axis needs all sets; an unused value needs none, so `read_by` is
            # tested first
            if read_by
            and all(
                user is not None and (sums.get(user) == sets or sets in carried[user])
                for user in read_by
            )
        }
    found = {node: sets for node, sets in found.items() if node in carried[node]}
    sums = {node: sets for node, sets in sums.items() if sets in found}
    parts = [index for index, sets in enumerate(carried) if not found.keys().isdisjoint(sets)]
    return ActiveSums(found, sums, frozenset(parts))


def _users(graph: Graph, roots: Iterable[NodeId]) -> list[list[NodeId | None]]:
    """For each node the list of the nodes that read it, as far as `roots` depend on them; None in
    it means that the node is a root.
    """
    users: list[list[NodeId | None]] = [[] for _ in graph.nodes]
    wanted = set(roots)
    for root in wanted:
        users[root].append(None)
    for index in range(len(graph) - 1, -1, -1):
        if users[index]:
            for arg in graph[index].args:
                users[arg].append(index)
    return users


def _settled(graph: Graph, users: list[NodeId | None]) -> bool:
    return bool(users) and all(
        user is not None
        and isinstance(graph[user].op, Add)
        and is_positive_zero(graph, graph[user].args[1])
        for user in users
    )
