"""Draws expressions of a wanted shape whose values stay within some units.

Sums are halved, factors are bounded, divisors begin at 1, and conditions compare inputs with odd
numbers: no model is so badly conditioned that rounding alone tells two backends apart.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from tests.random_specs.layers import LAYERS
from tests.random_specs.scope import DIMS, LISTS, SIZES, WINDOWS, Scope
from tests.random_specs.terms import SCALAR, Shape, Term, leaf

Make = Callable[[Scope, Shape, int], Term | None]


def expression(scope: Scope, shape: Shape, depth: int) -> Term:
    """An expression of the shape, at most so deep."""
    while depth > 0:
        term = scope.one_of(MAKERS)(scope, shape, depth - 1)
        if term is not None:
            return term
    return scope.name(shape)


def _lesser(scope: Scope, shape: Shape) -> Shape:
    """The shape, or one that is broadcast to it."""
    dims = frozenset(dim for dim in shape.dims if scope.often(0.7))
    if scope.often(0.3):
        return Shape(dims)
    return replace(shape, dims=dims)


def _combined(scope: Scope, shape: Shape, depth: int) -> Term:
    pattern = scope.one_of(
        (
            "0.5 * (({0}) + ({1}))",
            "0.5 * (({0}) - ({1}))",
            "({0}) * sin({1})",
            "({0}) / (1 + ({1}) ** 2)",
            "min({0}, {1})",
            "max({0}, {1}, -0.9)",
            "clip({0}, -0.71, 0.2 + abs({1}))",
            "clip({0}, -0.6, 0.8) - 0.1 * ({1})",
            "atan2({0}, 1.1 + ({1}) ** 2)",
            "0.4 * ({0}) * tanh({1})",
            "smooth_sign({0}, 0.7) * cos({1})",
        )
    )
    return Term(
        pattern, (expression(scope, shape, depth), expression(scope, _lesser(scope, shape), depth))
    )


_FUNCTIONS = (
    *("sin({0})", "cos({0})", "tanh({0})", "sigmoid({0})", "softplus({0})", "atan({0})", "-({0})"),
    *("abs({0})", "relu({0})", "elu({0})", "sech({0})", "sign({0}) * 0.3", "exp(-abs({0}))"),
    *("sqrt(0.2 + ({0}) ** 2)", "log(1.5 + ({0}) ** 2)", "asin(0.9 * sin({0}))"),
    *("acos(0.9 * cos({0}))", "tan(0.7 * tanh({0}))", "sinh(tanh({0}))", "cosh(sin({0}))"),
    *("pow(1.1 + ({0}) ** 2, 0.7)", "tanh({0}) ** 3", "(1 + ({0}) ** 2) ** -0.5", "sin({0}) ** 2"),
    *("smooth_sign({0})", "(0.3 + abs({0})) ** 0.5", "dropout({0}, 0.2)", "dt * ({0})"),
    "sin(2 * pi * ({0}))",
)


def _applied(scope: Scope, shape: Shape, depth: int) -> Term | None:
    pattern = scope.one_of(_FUNCTIONS)
    if not scope.memory and ("dropout" in pattern or "dt" in pattern):
        return None
    return Term(pattern, (expression(scope, shape, depth),))


def _selected(scope: Scope, shape: Shape, depth: int) -> Term:
    source = scope.one_of(scope.readable(lambda value: value.shape == SCALAR and value.from_inputs))
    relation = scope.one_of(("<", ">", "<=", ">="))
    condition = f"{source.name} {relation} {scope.number(-0.5, 0.5)}123456789"
    return Term(
        f"where({condition}, {{0}}, {{1}})",
        (expression(scope, shape, depth), expression(scope, shape, depth)),
    )


def _reduced(scope: Scope, shape: Shape, depth: int) -> Term | None:
    absent = [dim for dim in DIMS if dim not in shape.dims]
    choices = ["dim", "time", "list", "both", "all"]
    if not shape.is_sample or not scope.memory:
        choices = ["dim"]
    what = scope.one_of(choices)
    reducer = scope.one_of(("0.4 * sum", "mean"))
    if what == "time":
        child = replace(shape, window=scope.one_of(WINDOWS))
        return Term(f"{reducer}({{0}}, over=t)", (expression(scope, child, depth),))
    if what == "all" and shape == SCALAR:
        child = Shape(frozenset(scope.chance.sample(sorted(DIMS), scope.one_of((1, 2)))))
        return Term(f"{reducer}({{0}})", (expression(scope, child, depth),))
    if what == "list" and shape == SCALAR:
        child = Shape(listed=scope.one_of(LISTS))
        return Term(f"{reducer}({{0}})", (expression(scope, child, depth),))
    if len(shape.dims) > 1 or not absent:
        return None
    dim = scope.one_of(absent)
    child = shape.plus(dim)
    if what == "both" and len(absent) > 1:
        other = scope.one_of([d for d in absent if d != dim])
        return Term(
            f"0.5 * {reducer}({{0}}, over=[{dim}, {other}])",
            (expression(scope, child.plus(other), depth),),
        )
    return Term(f"{reducer}({{0}}, over={dim})", (expression(scope, child, depth),))


def _multiplied(scope: Scope, shape: Shape, depth: int) -> Term | None:
    """A matrix and a vector, or taps and a window."""
    if not shape.is_sample or len(shape.dims) > 1:
        return None
    if scope.memory and scope.often(0.3) and not shape.dims:
        n = scope.one_of(WINDOWS)
        taps = ", ".join(scope.number(0.1, 0.5) for _ in range(n))
        return Term(f"[{taps}] @ ({{0}})", (expression(scope, Shape(window=n), depth),))
    inner = scope.one_of([dim for dim in DIMS if dim not in shape.dims])
    outer = sorted(shape.dims)
    if outer and outer[0] > inner:
        return None  # the last axis of the matrix, in the order of the parameter, is summed over
    matrix = scope.parameter(shape.plus(inner))
    return Term(
        "0.4 * ({0} @ ({1}))", (matrix, expression(scope, Shape(frozenset({inner})), depth))
    )


def _put_together(scope: Scope, shape: Shape, depth: int) -> Term | None:
    if shape.listed and not shape.dims:
        kind = scope.one_of(("list", "concat", "linspace", "windows", "numbers"))
        n = shape.listed
        if kind == "numbers":
            return leaf(scope.one_of((f"0.3 * ones({n})", f"zeros({n})", f"0.2 * arange({n})")))
        if kind == "linspace":
            return leaf(f"linspace({scope.number()}, {scope.number()}, {n})")
        if kind == "windows" and n == 3 and scope.memory:
            window = scope.name(Shape(window=2))
            return Term("concat({0}, {1})", (window, expression(scope, SCALAR, depth)))
        parts = tuple(expression(scope, SCALAR, depth) for _ in range(n))
        inside = ", ".join(f"{{{k}}}" for k in range(n))
        return Term(f"[{inside}]" if kind == "list" else f"concat({inside})", parts)
    for dim in sorted(shape.dims):
        if shape.is_sample and SIZES[dim] < 4 and scope.often(0.5):
            rest = shape.minus(dim)
            parts = tuple(expression(scope, rest, depth) for _ in range(SIZES[dim]))
            inside = ", ".join(f"{{{k}}}" for k in range(len(parts)))
            return Term(f"stack({inside}, dim={dim})", parts)
    if shape.is_sample and len(shape.dims) == 2 and scope.often(0.5):
        one, other = sorted(shape.dims)
        if SIZES[one] == SIZES[other] and scope.often(0.5):
            return Term(f"({{0}}) * eye({one}, {other})", (expression(scope, shape, depth),))
        operands = tuple(expression(scope, Shape(frozenset({d})), depth) for d in (one, other))
        return Term("0.5 * outer({0}, {1})", operands)
    return None


def _taken_apart(scope: Scope, shape: Shape, depth: int) -> Term | None:
    if shape == SCALAR:
        dim = scope.one_of(sorted(DIMS))
        child = expression(scope, Shape(frozenset({dim})), depth)
        labels = DIMS[dim]
        which = scope.one_of(labels) if isinstance(labels, list) else scope.one_of(range(labels))
        return Term(f"part({{0}}, {which})", (child,))
    if shape.is_sample and shape.dims:
        dim = scope.one_of(sorted(shape.dims))
        return Term(f"softmax({{0}}, over={dim})", (expression(scope, shape, depth),))
    return None


def _in_time(scope: Scope, shape: Shape, depth: int) -> Term | None:
    """Integrals and derivatives; only of what inputs say, so that every past is known."""
    if not scope.memory or not shape.is_sample or depth < 1:
        return None
    pattern = scope.one_of(
        (
            "tanh(integral({0}))",
            "tanh(integral({0}, method=trapezoidal))",
            "tanh(integral({0}, init=0.2))",
            "0.05 * der({0})",
            "0.02 * der({0}, method=trapezoidal)",
        )
    )
    inner = scope.restricted(memory=False, previews=False)
    if "der" in pattern:
        inner = inner.restricted(pure=True)
    return Term(pattern, (expression(inner, shape, depth - 1),))


def _slope(scope: Scope, shape: Shape, depth: int) -> Term | None:
    if not shape.is_sample or not scope.memory:
        return None
    found = scope.readable(lambda value: value.shape == shape and value.varies)
    if not found:
        return None
    name = scope.one_of(found).name
    return Term(
        f"0.3 * grad(sin({name}) * cos(0.5 * ({{0}})) + {name} ** 2, {name})",
        (expression(scope.restricted(memory=False), SCALAR, depth - 1),),
    )


def _shifted(scope: Scope, shape: Shape, depth: int) -> Term | None:
    """Earlier samples of an expression, one or a window of them."""
    if not scope.memory or shape.listed:
        return None
    inner = scope.restricted(pure=True, memory=False, previews=False)
    sample = expression(inner, Shape(shape.dims), depth)
    if not shape.window:
        return Term(f"({{0}})[t-{scope.one_of((1, 3))}]", (sample,))
    return Term(f"({{0}})[t-{shape.window - 1}:t]", (sample,))


def _own_function(scope: Scope, shape: Shape, depth: int) -> Term | None:
    body = Term(
        scope.one_of(
            (
                "tanh(v) * cos(w)",
                "where(v > 0.0123, v, 0.2 * w)",
                "0.4 * v + 0.3 * w * abs(sin(v))",
                "max(v, w) / (1 + w ** 2)",
            )
        )
    )
    name = scope.declare("functions", "f", {"args": ["v", "w"], "expr": body})
    return Term(
        f"{name}({{0}}, {{1}})", (expression(scope, shape, depth), expression(scope, shape, depth))
    )


def _layer(scope: Scope, shape: Shape, depth: int) -> Term | None:
    return scope.one_of(LAYERS)(scope, shape, depth, expression)


MAKERS: tuple[Make, ...] = (
    *(_combined, _combined, _combined, _applied, _applied, _applied, _selected, _reduced),
    *(_multiplied, _put_together, _taken_apart, _in_time, _slope, _own_function),
    *(_layer, _layer, _layer, _shifted),
)
