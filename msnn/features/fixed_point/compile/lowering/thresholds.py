"""Bounds the cost of a wrong decision: near a threshold both choices may be almost equal."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from compiler.ir.ops import Relation
from msnn.features.fixed_point.compile.lowering.forms import PolynomialForm
from msnn.features.fixed_point.compile.lowering.intervals import bounds_near
from msnn.features.fixed_point.integers.builder import IntegerBuilder, share
from msnn.features.fixed_point.integers.program import Literal


@dataclass(frozen=True, slots=True)
class IntegerCondition:
    """left relation right, for two nodes of the same scale."""

    relation: Relation
    left: int
    right: int
    difference: PolynomialForm
    """left − right before rounding."""


@dataclass(frozen=True, slots=True)
class Decided:
    """A condition decided by bounds; `is_sure` is True if the exact values always agree."""

    holds: bool
    is_sure: bool


def reach_beside(
    builder: IntegerBuilder, condition: IntegerCondition, form: PolynomialForm
) -> float:
    """The largest magnitude of a form where rounding may change the condition; 0 if nowhere.

    There, |left − right| is at most the sum of both errors. form = κ (left − right) + rest holds
    for any κ, and a κ that cancels a term may give a small bound, as for `where(x > 0, x, 0.1 *
    x)`.
    """
    left, right, difference = condition.left, condition.right, condition.difference
    if not builder.is_doubtful(left, right):
        return 0.0
    error = builder.errors[left] + builder.errors[right]
    near: Mapping[int, tuple[float, float]] = {}
    for this, other in ((left, right), (right, left)):
        if isinstance(builder[other].op, Literal) and math.isfinite(error):
            middle = builder[other].low
            # the error in units of this node's words, rounded away from 0
            room = math.ceil(math.ldexp(error, builder[this].fraction))
            near = bounds_near(builder.nodes, this, (middle - room, middle + room))
    mine = dict(form.terms)
    factors = {0.0, *(mine.get(monomial, 0.0) / c for monomial, c in difference.terms)}
    return min(
        share(factor, error + difference.error)
        + _reach(builder, form - difference.times(factor), near)
        for factor in factors
    )


def _reach(
    builder: IntegerBuilder, form: PolynomialForm, near: Mapping[int, tuple[float, float]]
) -> float:
    """The largest magnitude of a form if the nodes in `near` have these narrower bounds."""
    low = high = form.constant
    error = form.error
    for monomial, coefficient in form.terms:
        if len(monomial) == 1:
            (node,) = monomial
            ends = near.get(node, builder.bounds(node))
            error += share(coefficient, builder.errors[node])
        else:
            # a product of nodes is bounded by its size alone, errors included
            sizes = (
                max(map(abs, near.get(node, builder.bounds(node)))) + builder.errors[node]
                for node in monomial
            )
            size = math.prod(sizes)
            ends = -size, size
        first, last = sorted((coefficient * ends[0], coefficient * ends[1]))
        low, high = low + first, high + last
    return max(abs(low), abs(high)) + error
