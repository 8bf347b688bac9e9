"""Declares the layers of a spec for relations with weights, sets or tables."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msnn.features.nnodely.errors import nearest_knot, surplus_set
from msnn.features.nnodely.followed_python.torch_names import negative
from msnn.features.nnodely.functions import Functions
from msnn.features.nnodely.names import Dims, TakenNames
from msnn.features.nnodely.parameters import Parameters, entry_of, number_array
from msnn.features.nnodely.saved_model import Function
from msnn.features.nnodely.terms import Call, Named, Term, call, infix, number, shortest
from msnn.features.nnodely.values import (
    ShapeError,
    Value,
    ValueOperations,
    filled,
    refuse_many,
)
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span


@dataclass(frozen=True, slots=True)
class Weighted:
    """A relation `Fir` or `Linear` (`kind`) of nnodely: the names of its matrix and its offset
    (None without one), and its dropout from 0 to 1. Equal ones share one layer of the spec.
    """

    kind: str
    weight: str
    bias: str | None
    dropout: float


@dataclass(slots=True, kw_only=True)
class Layers:
    """Collects the layers that the spec declares."""

    names: TakenNames
    dims: Dims
    parameters: Parameters
    values: ValueOperations
    shared: frozenset[str]
    """Arrays used by several layers or formulas."""
    copied: dict[str, None] = field(default_factory=dict[str, None])
    """Shared arrays that a layer must own."""
    declared: dict[str, dict[str, Any]] = field(default_factory=dict[str, dict[str, Any]])
    _known: dict[Any, str] = field(default_factory=dict[Any, str])

    def fir(self, layer: Weighted, value: Value) -> Value:
        """The value of a filter, Σₖ W[k, o] x[t − n + 1 + k] + b[o], for a window of n scalar
        samples; o counts results. Raises ShapeError for several elements and arrays that do not
        fit.
        """
        weight = self.matrix(layer, value.window)
        if value.dim != 1:
            raise ShapeError(f"a filter of {value.dim} elements")
        out = int(weight.shape[1])
        # a `fir` reads a window of a signal; several pieces are a list of values
        if len(value.pieces) != 1:
            return self._over_pieces(layer, value, out)
        # over one sample they are the same, and `fir` wants a window
        kind = "linear" if value.window == 1 else "fir"
        name = self._layer(kind, layer, weight, (value.window, "tap"))
        term = Term(Call(name, steady=False), (value.pieces[0],), None, out)
        return Value(1, out, (term,))

    def linear(self, layer: Weighted, value: Value) -> Value:
        """The value of a linear map of each sample: Σᵢ W[i, o] x[i] + b[o], i over elements, o over
        results. Raises ShapeError if the arrays do not fit.
        """
        weight = self.matrix(layer, value.dim)
        out = weight.shape[1]
        name = self._layer("linear", layer, weight, (value.dim, "dim"))
        return self.values.along(lambda term: call(name, term, dim=out), value, out)

    def declare(self, wanted: str, key: Any, settings: dict[str, Any]) -> str:
        """Declares a layer with these settings and returns its name, which is similar to `wanted`.
        Equal keys share one layer.
        """
        if key not in self._known:
            self._known[key] = self.names.free(wanted)
            self.declared[self._known[key]] = settings
        return self._known[key]

    def along_other(self, term: Term, kind: str) -> Term:
        """A copy of a term of fuzzy sets along another dimension of the same size, named after
        `kind`. Raises ShapeError if the term is not that of a `fuzzify` layer.
        """
        head = term.head
        settings = self.declared.get(head.name) if isinstance(head, Call) else None
        if not isinstance(head, Call) or settings is None or "fuzzify" not in settings:
            raise ShapeError("two activations of one size that are no fuzzy sets")
        dim = self.dims.of(term.dim, kind)
        again = {"fuzzify": {**settings["fuzzify"], "dim": dim}}
        name = self.declare(head.name, ("other", head.name, kind), again)
        return Term(Call(name), term.args, term.window, term.dim)

    def matrix(self, layer: Weighted, rows: int) -> NDArray[np.float64]:
        """The weights of a layer, (rows, results). Raises ShapeError if they are no matrix with
        `rows` rows, or if the offset does not fit.
        """
        weight = self.parameters.numbers(layer.weight).values
        if weight.ndim != 2 or weight.shape[0] != rows:
            shape = " × ".join(map(str, weight.shape)) or "one number"
            raise ShapeError(f"the weights `{layer.weight}` are {shape}, not {rows} × any")
        if layer.bias is not None:
            bias = self.parameters.numbers(layer.bias).values
            if bias.shape not in {(weight.shape[1],), (1,), ()}:
                raise ShapeError(f"the offset `{layer.bias}` does not fit the weights")
        return weight

    def _layer(
        self, kind: str, layer: Weighted, weight: NDArray[np.float64], inner: tuple[int, str]
    ) -> str:
        key = (kind, layer)
        if key in self._known:
            return self._known[key]
        out = weight.shape[1]
        settings: dict[str, Any] = {}
        axes = [self.dims.of(out)] if out > 1 else []
        if out > 1:
            settings["out"] = axes[0]
        # nnodely has samples × results; the language results × samples, and no axis of one result
        turned = weight.T if out > 1 else weight[:, 0]
        name = self.names.free(_name_of(layer.weight))
        # an array has no dimension twice, and the layer wants one of one row without it
        is_one = weight.shape[0] > 1 and (inner[1] == "tap" or inner[0] != out)
        is_one = is_one and layer.weight in self.shared
        head = self.parameters.term(layer.weight).head if is_one else None
        if isinstance(head, Named) and head.axes == (*axes, self.dims.of(*inner)):
            settings["weight"] = head.name
        else:
            self.parameters.weights[f"{name}.weight"] = turned
            self._copy(layer.weight)
        if layer.bias is None:
            if kind == "linear":
                # `linear` has a bias unless told, `fir` has none
                settings["bias"] = False
        else:
            self._bias(name, layer.bias, out, axes, settings)
        if layer.dropout:
            settings["dropout"] = layer.dropout
        self.declared[name] = {kind: settings}
        self._known[key] = name
        return name

    def _copy(self, array: str) -> None:
        if array in self.shared:
            self.copied[array] = None

    def _bias(
        self, name: str, bias: str, out: int, axes: list[str], settings: dict[str, Any]
    ) -> None:
        values = np.broadcast_to(self.parameters.numbers(bias).values, (out,)).astype(np.float64)
        values = values if out > 1 else values.reshape(())
        head = self.parameters.term(bias).head if bias in self.shared else None
        if isinstance(head, Named) and len(head.axes) == len(axes):
            settings["bias"] = head.name
        else:
            settings["bias"] = True
            self.parameters.weights[f"{name}.bias"] = values
            self._copy(bias)

    def _over_pieces(self, layer: Weighted, value: Value, out: int) -> Value:
        """The filter for a window that is concatenated from several terms, as a matrix times a
        list; `out` is the number of results.
        """
        matrix = Term(self.parameters.term(layer.weight).head, (), None, out)
        whole = self.values.whole(value)
        term = infix("@", matrix, Term(whole.head, whole.args, None, 1))
        if layer.bias is not None:
            offset = self.parameters.term(layer.bias)
            term = infix("+", term, offset)
        if layer.dropout:
            term = call("dropout", term, number(layer.dropout))
        return Value(1, out, (term,))


def _name_of(weight: str) -> str:
    return weight[:-1] if weight[:1] == "P" and weight[-1:] == "W" and len(weight) > 2 else weight


_SHAPES = {"Triangular": "triangular", "Rectangular": "rectangular"}


def fuzzified(
    functions: Functions, layers: Layers, name: str, value: Value, findings: Findings
) -> Value:
    """The membership of the scalar `value` in each fuzzy set of the function `name` of the file,
    one element per set. Raises ShapeError for several elements or centres that do not fit the sets.
    """
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
    """The option of the `fuzzify` layer that gives the shape of the sets, empty for triangles. None
    if sets have different functions, and for a single set. `count` is the number of centres.
    """
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


def interpolated(
    layers: Layers,
    name: str,
    table: tuple[Any, Any, str],
    value: Value,
    said: tuple[Findings, Span],
) -> Value:
    """The value of a table, y = Yᵢ + sᵢ (x − Xᵢ), with the knot i, except the last, that is nearest
    to x.

    x is limited to the range of the knots X; sᵢ is the gradient from knot i to the next. `table` is
    (knots, values Y, mode). Raises ShapeError for invalid tables.
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
