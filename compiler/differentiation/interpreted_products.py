"""Evaluates the sums of second-order training in the interpreter, as reference for kernels.

The products of residuals and Jacobians have bounds on their rounding error, with which kernels of
the same program are compared.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.differentiation.sensitivities import LossResiduals, Sensitivities
from compiler.interpreter.bounded import Bounded, exact, unit_roundoff
from compiler.interpreter.bounded_rollouts import Forward, Rollouts, RolloutStep
from compiler.interpreter.bounded_sums import Total
from compiler.interpreter.operations import Array

_DTYPE: np.dtype[Any] = np.dtype(np.float64)


@dataclass(frozen=True, slots=True)
class InterpretedProducts:
    """The products [J r]ᵀ[J r] of one loss, (n + 1, n + 1) for n learned elements, and Σ of its
    cost.
    """

    products: Total
    cost: Total
    count: Total
    """Number of scored elements, weighted by the factors of their rows."""
    left_out: Total
    """Number of scored elements that the products exclude."""


def interpreted_products(
    found: Sensitivities, weights: Mapping[str, Array], runs: Rollouts
) -> dict[str, InterpretedProducts]:
    """The products of every loss that is a sum of squares, over these rollouts, in float64."""
    terms = {term.loss.name: term for term in found.losses}
    summed = [node for term in found.losses for node in (term.total, term.count)]
    wanted = [node for one in found.residuals for node in (one.values, one.slopes, one.left_out)]
    asked = [node for node in (*summed, *wanted) if node is not None]
    forward = Forward(found.program, asked, weights, _DTYPE)
    sums = {
        one.loss.name: InterpretedProducts(*(Total(_DTYPE) for _ in range(4)))
        for one in found.residuals
    }
    members = len(runs.t0)
    # the first `skip` samples of a rollout let the states settle; no loss counts them
    for moment in forward.moments(runs)[runs.skip :]:
        for one in found.residuals:
            total, term = sums[one.loss.name], terms[one.loss.name]
            total.cost.add(moment.values[term.total].repeated(members))
            every = exact(np.full(members, float(term.elements)))
            count = every if term.count is None else moment.values[term.count].repeated(members)
            total.count.add(count)
            total.products.add(_products(_rows(one, moment, found.numbers, members)))
            if one.left_out is not None:
                total.left_out.add(_over_elements(moment.values[one.left_out].repeated(members)))
    return sums


def _rows(
    one: LossResiduals, moment: RolloutStep, numbers: int, members: int
) -> tuple[Array, Array]:
    """Rows [J r], (members, elements, numbers + 1), and the error bound of each element."""
    unit = unit_roundoff(_DTYPE)
    values, slopes = (moment.values[node].repeated(members) for node in (one.values, one.slopes))

    def joined(of_slopes: Array, of_values: Array) -> Array:
        # (members, numbers, …) → (members, elements, numbers), with the residual as the last column
        columns = of_slopes.reshape(members, numbers, -1).transpose(0, 2, 1)
        return np.concatenate([columns, of_values.reshape(members, -1, 1)], axis=2)

    return (
        joined(slopes.value, values.value),
        joined(slopes.spread(unit), values.spread(unit)),
    )


def _over_elements(one: Bounded) -> Bounded:
    """The sum over the elements of each member."""
    value, error, terms = (part.reshape(len(part), -1) for part in one.parts)
    return Bounded(value.sum(1), error.sum(1), terms.sum(1), one.count * value.shape[1])


def _products(rows: tuple[Array, Array]) -> Bounded:
    """The products of the rows of each member, summed over its elements."""
    row, off = rows
    size = np.abs(row)
    with np.errstate(all="ignore"):
        value = row.transpose(0, 2, 1) @ row
        terms = (size + off).transpose(0, 2, 1) @ (size + off)
        moved = size.transpose(0, 2, 1) @ off
        error = moved + (off.transpose(0, 2, 1) @ (size + off)) + unit_roundoff(_DTYPE) * terms
    return Bounded(value, np.where(np.isnan(error), np.inf, error), terms, row.shape[1])
