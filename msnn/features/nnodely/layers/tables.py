"""Writes a table with nnodely's interpolation: along the line of the nearest knot."""

from __future__ import annotations

from typing import Any

import numpy as np

from msnn.features.nnodely.errors import nearest_knot
from msnn.features.nnodely.layers.layers import Layers
from msnn.features.nnodely.parameters import entry_of, number_array
from msnn.features.nnodely.terms.terms import Named, Term, call, infix, number
from msnn.features.nnodely.terms.values import ShapeError, Value
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span


def interpolated(
    layers: Layers,
    name: str,
    table: tuple[Any, Any, str],
    value: Value,
    said: tuple[Findings, Span],
) -> Value:
    """y = Yᵢ + sᵢ (x − Xᵢ), i the knot but the last that is nearest to x.

    x is kept between the first and the last knot; sᵢ is the slope from knot i to the next.
    """
    knots, heights, mode = table
    if mode != "linear":
        raise ShapeError(f"a table of the mode `{mode}`, which nnodely does not have either")
    x, y = _numbers(knots), _numbers(heights)
    if x.shape != y.shape or x.ndim != 1 or len(x) < 2:
        raise ShapeError("a table has as many knots as values, at least two")
    if value.window != 1 or value.dim != 1:
        raise ShapeError("a table of more than one number, of which nnodely makes something else")
    order = np.argsort(x, kind="stable")
    x, y = x[order], y[order]
    if np.any(np.diff(x) <= 0):
        raise ShapeError("two knots of a table are the same")
    slope = np.diff(y) / np.diff(x)
    # nnodely does not extrapolate: beyond the ends it goes on with the value there
    inside = call("clip", value.pieces[0], number(x[0]), number(x[-1]))
    if len(x) == 2:
        line = infix("*", number(slope[0]), infix("-", inside, number(x[0])))
        return Value(1, 1, (infix("+", number(y[0]), line),))
    findings, place = said
    findings.report(nearest_knot(name, place))
    dims, names = layers.dims, layers.names
    knot = dims.of(len(slope), "knot")
    # rectangular sets about the knots choose the nearest one; the last has no line of its own
    # as nnodely searches: by distance to a knot, not by the interval that x lies in
    settings = {"centers": x[:-1].tolist(), "membership": "rectangular", "dim": knot}
    layer = layers.declare(f"nearest_{name}", ("nearest", name), {"fuzzify": settings})
    parts: list[Term] = []
    for what, numbers in (("height", y[:-1]), ("slope", slope)):
        new = names.free(f"{name}_{what}")
        layers.parameters.fixed[new] = {"value": entry_of(numbers), "dims": knot}
        parts.append(Term(Named(new, (knot,)), (), None, len(slope)))
    # x − Xᵢ for each set, which the layer computes anyway
    offset = call(f"{layer}.offset", inside, dim=len(slope))
    line = infix("+", parts[0], infix("*", parts[1], offset))
    chosen = infix("*", call(layer, inside, dim=len(slope)), line)
    return Value(1, 1, (call("sum", chosen, rest=f", over={knot}", dim=1),))


def _numbers(values: Any) -> Any:
    found = number_array(values)
    if found is None:
        raise ShapeError("a table is made of numbers")
    return found
