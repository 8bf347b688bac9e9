"""Writes fuzzy sets as a layer, or as formulas if no layer is suitable."""

from __future__ import annotations

import itertools
from functools import partial
from typing import Any

from msnn.features.nnodely.errors import surplus_set
from msnn.features.nnodely.followed_python.torch_names import negative
from msnn.features.nnodely.functions import Functions
from msnn.features.nnodely.layers.layers import Layers
from msnn.features.nnodely.saved_file.grammar import Function
from msnn.features.nnodely.terms.terms import Term, call, infix, number, shortest
from msnn.features.nnodely.terms.values import ShapeError, Value, filled, refuse_many
from spec_schema.diagnostics.diagnostic import Findings

_SHAPES = {"Triangular": "triangular", "Rectangular": "rectangular"}


def fuzzified(
    functions: Functions, layers: Layers, name: str, value: Value, findings: Findings
) -> Value:
    """The membership of a scalar in each set, for a function of the file."""
    given = functions.file.Functions[name]
    centers = [float(c) for c in given.centers or []]
    count = (given.dim_out or {}).get("dim", 0)
    if value.dim != 1:
        raise ShapeError(f"fuzzy sets of {value.dim} elements")
    if not centers or not 1 <= count <= len(centers) <= count + 1 or given.functions is None:
        raise ShapeError(f"the fuzzy sets of `{name}` have not as many centres as they are")
    if len(centers) > count:
        place = functions.text.place("Functions", name)
        findings.report(surplus_set(name, count, place))
    # automatic names have an F in front of the relation's kind
    wanted = name[1:] if name.startswith("FFuzzify") else name
    rising = all(a < b for a, b in itertools.pairwise(centers))
    settings = _settings(functions, name, given, len(centers))
    if settings is None or not rising or len(centers) == 1:
        return _by_formulas(functions, layers, (name, given, centers, count), value)
    dim = layers.dims.of(len(centers))
    settings = {"centers": [shortest(c) for c in centers], **settings, "dim": dim}
    layer = layers.declare(wanted, ("fuzzify", name), {"fuzzify": settings})
    sets = layers.values.along(lambda x: call(layer, x, dim=len(centers)), value, len(centers))
    if count == len(centers):
        return sets
    # the surplus set shapes its neighbour and is dropped afterwards
    return layers.values.stacked([layers.values.element(sets, i) for i in range(count)])


def _settings(
    functions: Functions, name: str, given: Function, count: int
) -> dict[str, Any] | None:
    """The shape of the sets as a layer option; None if sets have different functions."""
    shape = given.functions
    if isinstance(shape, str) and shape in _SHAPES:
        return {} if shape == "Triangular" else {"membership": _SHAPES[shape]}
    # one function for all: of the distance to the centre, as `membership: {function}` has it
    if isinstance(shape, str) and count > 1:
        function = functions.of_offset(name)
        return None if function is None else {"membership": {"function": function}}
    return None


def _by_formulas(
    functions: Functions,
    layers: Layers,
    sets: tuple[str, Function, list[float], int],
    value: Value,
) -> Value:
    name, given, centers, count = sets
    values = layers.values
    refuse_many(count)
    made: list[Value] = []
    for i in range(count):
        if isinstance(given.functions, str) and given.functions in _SHAPES:
            if len(centers) == 1:
                # a single set has no neighbour at which it would end
                made.append(filled(1.0, value))
                continue
            shape = _hat if given.functions == "Triangular" else _box
            made.append(values.elementwise(partial(shape, i, centers), value))
        else:
            made.append(functions.membership(name, i, centers[i], value))
    return values.stacked(made)


def _hat(i: int, centers: list[float], x: Term) -> Term:
    last = len(centers) - 1
    rising = falling = None
    if i > 0:
        width = number(centers[i] - centers[i - 1])
        rising = infix("/", infix("-", x, number(centers[i - 1])), width)
    if i < last:
        width = number(centers[i + 1] - centers[i])
        part = infix("/", infix("-", x, number(centers[i])), width)
        falling = infix("+", negative(part), number(1))
    if rising is None or falling is None:
        edge = rising if rising is not None else falling
        assert edge is not None
        # outermost sets stay 1 beyond their centre
        return call("min", call("max", edge, number(0)), number(1))
    return call("min", call("max", rising, number(0)), call("max", falling, number(0)))


def _box(i: int, centers: list[float], x: Term) -> Term:
    last = len(centers) - 1
    one, none = number(1), number(0)
    inside: Term | None = None
    if i < last:
        # a set ends in the middle between two centres; the middle itself belongs to the upper one
        high = centers[i] + abs(centers[i + 1] - centers[i]) / 2
        inside = call("where", infix("<", x, number(high)), one, none)
    if i > 0:
        low = centers[i] - abs(centers[i] - centers[i - 1]) / 2
        inside = call("where", infix(">=", x, number(low)), inside or one, none)
    assert inside is not None
    return inside
