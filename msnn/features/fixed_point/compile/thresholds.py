"""Narrows the bounds of integer nodes if one node is known more closely, as near a threshold."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from compiler.ir.ops import Relation
from msnn.features.fixed_point.compile.polynomials import PolynomialForm
from msnn.features.fixed_point.integers.builder import IntegerBuilder, share
from msnn.features.fixed_point.integers.program import (
    IntegerLookup,
    IntegerNode,
    Larger,
    Literal,
    RoundShift,
    Smaller,
    WeightedSum,
)

Interval = tuple[int, int]


def bounds_near(
    nodes: Sequence[IntegerNode], node: int, ends: Interval
) -> dict[int, tuple[float, float]]:
    """The real intervals of nodes while the word of `node` lies between the two `ends`, by index.

    The result contains only nodes with narrowed intervals: the nodes of which this node is a
    rescaled copy, and those computed from them.
    """
    words = {node: ends}
    # backwards first: what holds of a rescaled copy holds of the node that it was made of
    while (before := _scaled_from(nodes, node, words[node])) is not None:
        node = nodes[node].args[0]
        words[node] = before
    for index in range(node + 1, len(nodes)):
        args = nodes[index].args
        if index not in words and any(arg in words for arg in args):
            given = [words.get(arg, (nodes[arg].low, nodes[arg].high)) for arg in args]
            narrowed = _narrowed(nodes[index], given)
            if narrowed is not None:
                words[index] = narrowed
    return {
        index: (
            math.ldexp(max(low, nodes[index].low), -nodes[index].fraction),
            math.ldexp(min(high, nodes[index].high), -nodes[index].fraction),
        )
        for index, (low, high) in words.items()
    }


def _scaled_from(nodes: Sequence[IntegerNode], node: int, ends: Interval) -> Interval | None:
    """The range of words of the operand that this node rescales, if its own words lie between
    `ends`; None if it is no rescaled copy.
    """
    low, high = ends
    match nodes[node].op:
        case RoundShift(bits):
            # all words that the rounded shift takes there, and half a unit more at both ends
            return (low - 1) << bits, (high + 1) << bits
        case WeightedSum(0, (factor,)) if factor > 0:
            finer = nodes[node].fraction - nodes[nodes[node].args[0]].fraction
            # floor and ceiling: an interval may only widen
            return (low // factor, -(-high // factor)) if factor == 2**finer else None
        case _:
            return None


def _narrowed(node: IntegerNode, args: Sequence[Interval]) -> Interval | None:
    """The range of words of a node for these ranges of its arguments; None if not narrowed."""
    lows, highs = [low for low, _ in args], [high for _, high in args]
    match node.op:
        case RoundShift(bits):
            # one unit at both ends covers the rounding of the shift
            return (lows[0] >> bits) - 1, (highs[0] >> bits) + 1
        case WeightedSum(constant, coefficients):
            ends = [
                sorted((c * low, c * high))
                for c, low, high in zip(coefficients, lows, highs, strict=True)
            ]
            return constant + sum(a for a, _ in ends), constant + sum(b for _, b in ends)
        case Smaller():
            return min(lows), min(highs)
        case Larger():
            return max(lows), max(highs)
        case IntegerLookup(first, bits, values):
            cell, last = ((end - first) >> bits for end in (lows[0], highs[0]))
            # entries at both ends of every cell that the interval touches
            inside = values[max(cell, 0) : max(last, 0) + 2]
            return (min(inside), max(inside)) if inside else None
        case _:
            return None


@dataclass(frozen=True, slots=True)
class IntegerCondition:
    """A condition `left relation right`, for two nodes of the same scale."""

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
