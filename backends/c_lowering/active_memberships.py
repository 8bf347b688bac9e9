"""Writes which fuzzy sets a value belongs to, and the degrees of membership in these alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, assert_never

import numpy as np

from backends.c_language.places import ArrayView, Index, variable
from backends.c_language.scope import BlockScope
from backends.c_language.tree import (
    Assign,
    Binary,
    Convert,
    CType,
    Declare,
    Expression,
    If,
    Name,
    Real,
    Unsigned,
)
from backends.c_lowering.even_points import EvenPoints, even_points
from backends.c_lowering.local_values import LocalValues
from compiler.ir.program import Node
from compiler.ir.types import Axis, Type


@dataclass(frozen=True, slots=True)
class ActiveDegrees:
    """The sets that can be other than 0, and their degrees."""

    positions: tuple[Index, ...]
    degrees: tuple[Expression, ...]


def active_degrees(
    node: Node,
    shape: Literal["triangular", "rectangular"],
    value: Expression,
    points: ArrayView,
    numbers: Sequence[float] | None,
    locals: LocalValues,
    scope: BlockScope,
) -> ActiveDegrees:
    """Writes the search and the degrees, with the arithmetic of the formula for all sets.

    `points` are centres or bounds, `numbers` their values where they are known.
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
        value: Expression,
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
        self._at = Name(scope.fresh(f"{self._name}_at"))

    def triangular(self) -> ActiveDegrees:
        """Two neighbours; beyond the ends one, by the formula whose slope is 0 there."""
        scope, last, first = self._scope, self._count - 1, variable(self._at.text)
        here, following = (Name(scope.fresh(f"{self._name}_{n}")) for n in ("here", "next"))
        scope.add(Declare(CType.UNSIGNED, self._at.text, Unsigned(0)))
        scope.add(Declare(CType.REAL, here.text))
        scope.add(Declare(CType.REAL, following.text))
        below, above, inside = scope.inner(), scope.inner(), scope.inner()
        # a NaN reaches no point and comes here, so that it gives NaN and reads within the arrays
        below.assign(here, self._beyond(0))
        below.assign(following, Real(0.0))
        above.assign(self._at, Unsigned(last - 1))
        above.assign(here, Real(0.0))
        above.assign(following, self._beyond(last))
        # the search runs where the value is between the ends, so its index needs no bounds
        self._find_interval(inside)
        slope = self._slope(inside)
        # below the next centre: no zero whose sign the formula's (x - c) * (-slope) would turn
        inside.assign(
            here, Binary("*", Binary("-", self._point(first.plus(Index(1))), self._value), slope)
        )
        inside.assign(following, Binary("*", Binary("-", self._value, self._point(first)), slope))
        within = If(self._reaches(Index(0)), tuple(inside.statements), tuple(below.statements))
        scope.add(If(self._reaches(Index(last)), tuple(above.statements), (within,)))
        return ActiveDegrees((first, first.plus(Index(1))), (here, following))

    def rectangular(self) -> ActiveDegrees:
        """One set: as many bounds as the value reaches are below it."""
        self._scope.add(Declare(CType.UNSIGNED, self._at.text, Unsigned(0)))
        self._search(self._count + 1, -1, self._scope)
        return ActiveDegrees((variable(self._at.text),), (Real(1.0),))

    def _find_interval(self, scope: BlockScope) -> None:
        """The interval of a value from the first to below the last centre."""
        even = None
        if self._numbers is not None:
            even = even_points(self._numbers, self._locals.functions.dtype)
        if even is None:
            self._search(self._count - 1, 0, scope)
        else:
            self._calculate(even, scope)

    def _calculate(self, even: EvenPoints, scope: BlockScope) -> None:
        distance = _difference(self._value, Real(even.origin))
        place = scope.constant(f"{self._name}_place", Binary("*", distance, Real(even.factor)))
        # even points: the interval follows from one product; rounding may be one interval too far
        # up
        scope.assign(self._at, Convert(CType.UNSIGNED, place))
        if not even.exact:
            rounded_up = Binary("<", self._value, self._point(variable(self._at.text)))
            back = Assign(self._at, Binary("-", self._at, Unsigned(1)))
            scope.add(If(rounded_up, (back,)))

    def _search(self, count: int, offset: int, scope: BlockScope) -> None:
        """Halves `count` intervals until one is left; always the same number of comparisons."""
        where = variable(self._at.text)
        reached = Index()
        while count > 1:
            # the same comparisons for every value, so that times differ by branches only
            half = count // 2
            step = Assign(self._at, Binary("+", self._at, Unsigned(half)))
            bound = reached.plus(Index(half + offset))
            scope.add(If(self._reaches(bound), (step,)))
            count -= half
            reached = where

    def _slope(self, scope: BlockScope) -> Expression:
        """1 / (cᵢ₊₁ − cᵢ) of the interval, as the formula for all sets has it."""
        where = variable(self._at.text)
        if self._numbers is None:
            width = Binary("-", self._point(where.plus(Index(1))), self._point(where))
            return scope.constant(f"{self._name}_slope", Binary("/", Real(1.0), width))
        slopes = 1.0 / np.diff(np.array(self._numbers))
        rounded = slopes.astype(self._locals.functions.dtype)
        # even points have one slope, a number in the code
        if np.all(rounded == rounded[0]):
            return Real(float(rounded[0]))
        type = Type((Axis("interval", len(slopes)),))
        table = self._locals.known(tuple(slopes), type, f"{self._name}_slopes", scope)
        return scope.constant(f"{self._name}_slope", table.element((where,)))

    def _beyond(self, end: int) -> Expression:
        """1 for every finite value, NaN for the others."""
        distance = _difference(self._value, self._point(Index(end)))
        return Binary("+", Binary("*", distance, Real(0.0)), Real(1.0))

    def _reaches(self, where: Index) -> Expression:
        return Binary(">=", self._value, self._point(where))

    def _point(self, where: Index) -> Expression:
        return self._points.element((where,))


def _difference(left: Expression, right: Expression) -> Expression:
    """left − right, without a sign before a literal."""
    if isinstance(right, Real) and right.value < 0.0:
        return Binary("+", left, Real(-right.value))
    return Binary("-", left, right)
