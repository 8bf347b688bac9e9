"""Draws a layer and a call of it whose value has the wanted shape."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tests.random_specs.scope import DIMS, SIZES, WINDOWS, Scope
from tests.random_specs.terms import SCALAR, Shape, Term

Expression = Callable[[Scope, Shape, int], Term]
MakeLayer = Callable[[Scope, Shape, int, Expression], Term | None]


def _called(name: str, *arguments: Term) -> Term:
    inside = ", ".join(f"{{{k}}}" for k in range(len(arguments)))
    return Term(f"{name}({inside})", arguments)


def _out(scope: Scope, shape: Shape) -> dict[str, Any] | None:
    """The option for a result of this shape from a scalar or a vector; None where there is none."""
    if not shape.is_sample or len(shape.dims) > 1:
        return None
    return {"out": next(iter(shape.dims))} if shape.dims else {}


def _initial(scope: Scope) -> dict[str, Any]:
    choices: list[Any] = [
        None,
        None,
        0.2,
        {"normal": {"std": 0.3}},
        {"uniform": {"min": -0.4, "max": 0.4}},
        Term("0.4 * exp(-i)"),
    ]
    chosen = scope.one_of(choices)
    return {} if chosen is None else {"init": chosen}


def _share(scope: Scope) -> dict[str, Any]:
    return {"dropout": 0.2} if scope.often(0.1) else {}


def _fir(scope: Scope, shape: Shape, depth: int, draw: Expression) -> Term | None:
    if not scope.memory or not shape.is_sample:
        return None
    inner, out = shape, {}
    if shape.dims and scope.often(0.4):
        dim = scope.one_of(sorted(shape.dims))
        inner, out = shape.minus(dim), {"out": dim}
    n = scope.one_of((2, 3, 5))
    options = {**out, "bias": scope.often(0.3), **_initial(scope), **_share(scope)}
    if scope.often(0.3):
        name = scope.declare("layers", "h", {"fir": options})
        return _called(name, draw(scope, Shape(inner.dims, window=scope.one_of(WINDOWS)), depth))
    window: Any = n if scope.often(0.7) else f"{n * 100} ms"
    name = scope.declare("layers", "h", {"fir": {"window": window, **options}})
    return _called(name, draw(scope.restricted(pure=True, memory=False), inner, depth))


def _vectors(scope: Scope, depth: int, draw: Expression) -> tuple[Term, ...]:
    """One vector, or several scalars."""
    if scope.often(0.4):
        return (draw(scope, Shape(frozenset({scope.one_of(sorted(DIMS))})), depth),)
    return tuple(draw(scope, SCALAR, depth) for _ in range(scope.one_of((1, 2, 3))))


def _linear(scope: Scope, shape: Shape, depth: int, draw: Expression) -> Term | None:
    out = _out(scope, shape)
    if out is None:
        return None
    options = {**out, "bias": scope.often(0.5), **_initial(scope), **_share(scope)}
    name = scope.declare("layers", "m", {"linear": options})
    return _called(name, *_vectors(scope, depth, draw))


def _mlp(scope: Scope, shape: Shape, depth: int, draw: Expression) -> Term | None:
    out = _out(scope, shape)
    if out is None:
        return None
    activation = scope.one_of(("tanh", "relu", "sigmoid", "softplus", "sin"))
    options = {"hidden": scope.one_of(([3], [4, 2])), "activation": activation, **out}
    name = scope.declare("layers", "net", {"mlp": {**options, **_share(scope)}})
    return _called(name, *_vectors(scope, depth, draw))


def _equation_learner(scope: Scope, shape: Shape, depth: int, draw: Expression) -> Term | None:
    out = _out(scope, shape)
    if out is None:
        return None
    functions = scope.one_of(
        (["sin", "mul"], ["tanh", "identity", "square"], ["cos", "add", "sub"])
    )
    options = {"functions": functions, **out, **_initial(scope)}
    name = scope.declare("layers", "eql", {"equation_learner": options})
    return Term("tanh({0})", (_called(name, *_vectors(scope, depth, draw)),))


def fuzzy_sets(scope: Scope, dim: str) -> str:
    """A new layer of fuzzy sets that `dim` numbers; its name."""
    membership: Any = scope.one_of(("triangular", "gaussian", "rectangular", "function"))
    centers = [round(-0.83 + 1.7 * k / (SIZES[dim] - 1), 3) for k in range(SIZES[dim])]
    if membership == "function":
        body = {"args": ["d"], "expr": Term("exp(-2 * d ** 2)")}
        membership = {"function": scope.declare("functions", "bell", body)}
    options: dict[str, Any] = {"centers": centers, "membership": membership, "dim": dim}
    if membership in ("triangular", "gaussian") and scope.often(0.3):
        options["learn"] = True
    return scope.declare("layers", "phi", {"fuzzify": options})


def _fuzzify(scope: Scope, shape: Shape, depth: int, draw: Expression) -> Term | None:
    if not shape.is_sample or len(shape.dims) not in (1, 2):
        return None
    names = [fuzzy_sets(scope, dim) for dim in sorted(shape.dims)]
    arguments = [draw(scope, SCALAR, depth) for _ in names]
    if len(names) == 1:
        return _called(names[0], *arguments)
    grid = scope.declare("layers", "grid", {"fuzzify": {"over": names, "combine": "product"}})
    return _called(grid, *arguments)


def _local_model(scope: Scope, shape: Shape, depth: int, draw: Expression) -> Term | None:
    out = _out(scope, shape)
    if out is None:
        return None
    free = [dim for dim in sorted(DIMS) if dim not in shape.dims]
    dims = scope.chance.sample(free, scope.one_of((1, 1, 2)))
    by = [Term(f"{fuzzy_sets(scope, d)}({{0}})", (draw(scope, SCALAR, 1),)) for d in dims]
    kinds = ["linear", "mlp", "equation_learner", "interpolation"]
    if scope.memory:
        kinds += ["fir", "fir", "iir", "state_space"]
    kind = scope.one_of(kinds)
    arguments = (draw(scope, SCALAR, depth),)
    match kind:
        case "linear":
            cell: dict[str, Any] = {**out, "bias": scope.often(0.5)}
        case "mlp":
            cell = {"hidden": [2], **out}
        case "equation_learner":
            cell = {"functions": ["sin", "identity"], **out}
        case "state_space":
            cell = {"order": 2, **out}
        case "fir":
            cell = {"window": 3, **out, "bias": scope.often(0.3)}
            arguments = (draw(scope.restricted(pure=True, memory=False), SCALAR, depth),)
        case "iir":
            cell = {"num": 1, "den": 1}
        case _:
            cell = {"x": [-0.7, 0.1, 0.9], "y": [0.2, -0.3, 0.5], "learn": True}
    if kind in ("iir", "interpolation") and out:
        return None
    entry = {"local_model": {"by": by, "cell": {kind: cell}}}
    return _called(scope.declare("layers", "local", entry), *arguments)


def _interpolation(scope: Scope, shape: Shape, depth: int, draw: Expression) -> Term | None:
    if shape != SCALAR:
        return None
    options: dict[str, Any] = {"x": [-0.8, -0.13, 0.42, 1.1], "learn": scope.often(0.5)}
    options["outside"] = scope.one_of(("clamp", "extrapolate"))
    arguments = [draw(scope, SCALAR, depth)]
    if scope.often(0.3):
        options |= {"x2": [-0.51, 0.77], "y": [[0.1, 0.2], [-0.4, 0.3], [0.5, 0.1], [0.0, -0.2]]}
        arguments.append(draw(scope, SCALAR, depth))
    else:
        options["y"] = [0.3, -0.2, 0.6, 0.4]
    return _called(scope.declare("layers", "table", {"interpolation": options}), *arguments)


def _normalize(scope: Scope, shape: Shape, depth: int, draw: Expression) -> Term | None:
    if not shape.is_sample:
        return None
    name = scope.declare("layers", "n", {"normalize": {"mean": 0.2, "std": 1.3}})
    method = scope.one_of(("", ".inverse"))
    return _called(name + method, draw(scope, shape, depth))


def _iir(scope: Scope, shape: Shape, depth: int, draw: Expression) -> Term | None:
    if not scope.memory or not shape.is_sample:
        return None
    options: dict[str, Any] = {"num": scope.one_of((0, 1, 2)), "den": scope.one_of((1, 2, 3))}
    name = scope.declare("layers", "lag", {"iir": options})
    return _called(name, draw(scope.restricted(memory=False), shape, depth))


def _state_space(scope: Scope, shape: Shape, depth: int, draw: Expression) -> Term | None:
    out = _out(scope, shape)
    if out is None or not scope.memory:
        return None
    options = {"order": scope.one_of((1, 2, 3)), **out, "feedthrough": scope.often(0.5)}
    options["radius"] = scope.one_of((0.9, 0.5))
    name = scope.declare("layers", "sys", {"state_space": options})
    arguments = [draw(scope.restricted(memory=False), SCALAR, depth)]
    return _called(name, *arguments * scope.one_of((1, 2)))


def _savitzky_golay(scope: Scope, shape: Shape, depth: int, draw: Expression) -> Term | None:
    if not scope.memory or not shape.is_sample:
        return None
    options = {"window": 5, "order": scope.one_of((1, 2)), "derivative": scope.one_of((0, 1))}
    if scope.often(0.3):
        options["lag"] = 2
    name = scope.declare("layers", "slope", {"savitzky_golay": options})
    inner = draw(scope.restricted(pure=True, memory=False), shape, depth)
    return Term("0.1 * {0}", (_called(name, inner),))


LAYERS: tuple[MakeLayer, ...] = (
    *(_fir, _linear, _mlp, _equation_learner, _fuzzify, _local_model),
    *(_interpolation, _normalize, _iir, _state_space, _savitzky_golay),
)
