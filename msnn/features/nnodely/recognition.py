"""Finds groups of relations: local models, time integrals and derivatives."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any, Protocol

import numpy as np

from msnn.features.nnodely.functions import Functions, NotRecognisedError
from msnn.features.nnodely.layers import Layers, Weighted
from msnn.features.nnodely.saved_model import File, Graph, shared_arrays
from msnn.features.nnodely.signals import Signals
from msnn.features.nnodely.terms import Call, Term, call, times
from msnn.features.nnodely.values import ShapeError, Value, ValueOperations


def recognise(file: File) -> Mapping[str, Recognised]:
    """The groups of relations with a known meaning: local models, integrals and derivatives.

    A relation is nnodely's word for an operation of its file. The keys are the relations whose
    values are those of the groups.
    """
    graph = Graph(file)
    # of a relation that is both, the local model stands
    return {**calculus(graph), **local_models(graph)}


class Followed(Protocol):
    """The values, layers and functions of a model, with which a recognised group builds its value.
    `operand` returns the value of a relation, input or parameter by name.
    """

    values: ValueOperations
    layers: Layers
    functions: Functions
    signals: Signals | None

    def operand(self, name: str) -> Value: ...


@dataclass(frozen=True, slots=True)
class Recognised:
    """A group of relations with a known meaning: the relations whose values it needs first, and a
    function that makes its value.
    """

    needs: tuple[str, ...]
    make: Callable[[Followed], Value]


_FEWEST = 2


@dataclass(frozen=True, slots=True)
class _Sum:
    """A sum in the form of a local model: Σ cell · activation over all combinations of fuzzy sets,
    in order.

    `cells` are relations, `activations` the relations with memberships, `sizes` their numbers of
    sets.
    """

    cells: tuple[str, ...]
    activations: tuple[str, ...]
    sizes: tuple[int, ...]


def local_models(graph: Graph) -> Mapping[str, Recognised]:
    """Sums in the form of a local model whose cells are filters, linear maps or functions, or all
    one relation, by the relation that has their value.
    """
    shared = shared_arrays(graph.file)
    # partial sums: only the outermost one is the local model
    inner = {
        pair[0]
        for name in graph.file.Relations
        if (pair := graph.pair(name, "Add")) is not None and graph.uses[pair[0]] == 1
    }
    found: dict[str, Recognised] = {}
    for name in graph.file.Relations:
        whole = None if name in inner else _sum(graph, name)
        if whole is not None:
            one = _of_layers(graph, whole, shared) or _of_one_value(whole)
            one = one or _of_functions(graph, whole, shared)
            if one is not None:
                found[name] = one
    return found


def _sum(graph: Graph, name: str) -> _Sum | None:
    products: list[str] = []
    # sums are nested on their left side: the last term is found first
    while (sides := graph.pair(name, "Add")) is not None and (
        # an inner sum that others read is a value of its own
        not products or graph.uses[name] == 1
    ):
        products.append(sides[1])
        name = sides[0]
    products = [name, *reversed(products)]
    pairs = [graph.pair(one, "Mul") for one in products]
    # a product that others read is a value of its own
    if len(products) < _FEWEST or any(graph.uses[one] != 1 for one in products):
        return None
    cells = [pair[0] for pair in pairs if pair is not None]
    chosen = [tuple(_selected(graph, pair[1])) for pair in pairs if pair is not None]
    if len(chosen) != len(products) or not chosen[0]:
        return None
    activations = tuple(name for name, _, _ in chosen[0])
    sizes = tuple(size for _, size, _ in chosen[0])
    # the sets of the last activation turn fastest
    # all combinations exactly once: a cell left out would be one with weights 0, which would learn
    wanted = list(product(*(range(size) for size in sizes)))
    indexes = [tuple(index for _, _, index in one) for one in chosen]
    same = all(
        tuple((n, s) for n, s, _ in c) == tuple(zip(activations, sizes, strict=True))
        for c in chosen
    )
    if not same or indexes != wanted or len(set(activations)) != len(activations):
        return None
    return _Sum(tuple(cells), activations, sizes)


def _selected(graph: Graph, name: str) -> Iterator[tuple[str, int, int]]:
    """The activations whose sets are multiplied in the relation `name`, each as (relation, number
    of sets, index of the set). Nothing if another factor is in the product.
    """
    found: list[tuple[str, int, int]] = []
    rest: str | None = name
    while rest is not None:
        sides = graph.pair(rest, "Mul")
        one = rest if sides is None else sides[1]
        match graph.file.Relations.get(one):
            # the degree of one set among `size`
            case ["Select", [str() as source], int() as size, int() as index]:
                found.append((source, size, index))
            case _:
                return
        rest = None if sides is None else sides[0]
    yield from reversed(found)


def _of_one_value(whole: _Sum) -> Recognised | None:
    """A local model in which every cell is the same relation: its value times the sum of the
    memberships. None for others, and for several activations.
    """
    if len(set(whole.cells)) != 1 or len(whole.activations) != 1:
        return None
    cell, [activation] = whole.cells[0], whole.activations

    def make(relations: Followed) -> Value:
        degrees = relations.operand(activation)
        rest = f", over={relations.values.dims.of(degrees.dim)}"
        total = relations.values.along(lambda x: call("sum", x, rest=rest, dim=1), degrees, 1)
        return relations.values.elementwise(times, relations.operand(cell), total)

    return Recognised((cell, activation), make)


def _of_layers(graph: Graph, whole: _Sum, shared: frozenset[str]) -> Recognised | None:
    """A local model whose cells are filters or linear maps of one value, each with its own weights;
    None for others. `shared` are arrays that have other uses.
    """
    kinds: set[tuple[Any, ...]] = set()
    layers: list[Weighted] = []
    for cell in whole.cells:
        match graph.file.Relations.get(cell):
            # without dropout, which a cell of the language has not
            case [("Fir" | "Linear") as kind, [str() as operand], str() as weight, bias, 0 | 0.0]:
                kinds.add((kind, operand, bias is None))
                layers.append(Weighted(kind, weight, bias if isinstance(bias, str) else None, 0.0))
            case _:
                return None
    arrays = [a for layer in layers for a in (layer.weight, layer.bias) if a is not None]
    # cells are stacked in one array: weights that others share would be learned twice
    private = len(set(arrays)) == len(arrays) and not shared.intersection(arrays)
    if len(kinds) != 1 or not private or any(graph.uses[cell] != 1 for cell in whole.cells):
        return None
    if any(array not in graph.file.Parameters for array in arrays):
        return None
    [(kind, operand, _)] = kinds

    def make(relations: Followed) -> Value:
        value = relations.operand(operand)
        inner = value.window if kind == "Fir" else value.dim
        fits = value.dim == 1 if kind == "Fir" else value.window == 1
        if not fits or len(value.pieces) != 1:
            raise NotRecognisedError(
                "cells of a local model over what is no single value or window"
            )
        weights = [relations.layers.matrix(layer, inner) for layer in layers]
        if any(weight.shape[1] != 1 for weight in weights):
            raise NotRecognisedError("cells of a local model with more than one result")
        by = _degrees(relations, whole)
        # cells in the order of their sets, the last activation fastest: that of the layer's array
        stacked = np.concatenate([weight.ravel() for weight in weights])
        parameters = relations.layers.parameters
        biases = [
            parameters.numbers(layer.bias).values.reshape(-1)[:1]
            for layer in layers
            if layer.bias is not None
        ]
        form = "fir" if kind == "Fir" and inner > 1 else "linear"
        # written only where it is not the form's default: linear cells have a bias, filters none
        bias = {"bias": bool(biases)} if bool(biases) != (form == "linear") else {}
        settings = {"local_model": {"by": by, "cell": {form: bias}}}
        name = relations.layers.declare("local", ("local", whole), settings)
        parameters.weights[f"{name}.weight"] = stacked
        if biases:
            parameters.weights[f"{name}.bias"] = np.concatenate(biases)
        return Value(1, 1, (Term(Call(name, steady=False), (value.pieces[0],)),))

    return Recognised((operand, *whole.activations), make)


def _of_functions(graph: Graph, whole: _Sum, shared: frozenset[str]) -> Recognised | None:
    """A local model with one activation whose cells are one function of the same values, each with
    its own scalar parameters; None for others. `shared` are arrays that have other uses.
    """
    codes: set[tuple[Any, ...]] = set()
    own: list[list[str]] = []
    for cell in whole.cells:
        match graph.file.Relations.get(cell):
            case ["ParamFun", _, str() as key] if key in graph.file.Functions:
                given = graph.file.Functions[key]
                operands = tuple(graph.operands(cell))
                # by source: nnodely saves the same function under a new key for each cell
                codes.add((given.code, given.name, operands, given.map_over_dim is False))
                own.append(given.params_and_consts)
            case _:
                return None
    arrays = [array for one in own for array in one]
    private = len(set(arrays)) == len(arrays) > 0 and not shared.intersection(arrays)
    scalars = all(a in graph.file.Parameters and graph.file.Parameters[a].dim == 1 for a in arrays)
    timed = any(
        a in graph.file.Parameters
        and (graph.file.Parameters[a].sw or graph.file.Parameters[a].tw) is not None
        for a in arrays
    )
    if len(codes) != 1 or len(whole.sizes) != 1 or not (private and scalars) or timed:
        return None
    [(_, _, operands, is_plain)] = codes
    if not is_plain or any(graph.uses[cell] != 1 for cell in whole.cells):
        return None
    [activation] = whole.activations
    key = graph.file.Relations[whole.cells[0]][2]

    def make(relations: Followed) -> Value:
        streams = [relations.operand(operand) for operand in operands]
        size = whole.sizes[0]
        dim = relations.values.dims.of(size)
        terms = [
            relations.layers.parameters.joined([one[k] for one in own], dim)
            for k in range(len(own[0]))
        ]
        cells = relations.functions.of_sets(key, streams, terms, size)
        degrees = relations.operand(activation)
        weighted = relations.values.elementwise(times, cells, degrees)
        rest = f", over={dim}"
        return relations.values.along(lambda x: call("sum", x, rest=rest, dim=1), weighted, 1)

    return Recognised((*(o for o in operands if o in graph.file.Relations), activation), make)


def _degrees(relations: Followed, whole: _Sum) -> list[Term]:
    """The memberships of each activation as a term, along a dimension of its own. Raises
    NotRecognisedError for activations over a window.
    """
    found: list[Term] = []
    for k, activation in enumerate(whole.activations):
        value = relations.operand(activation)
        # dimensions are named by size: two of one size would be aligned instead of combined
        repeated = whole.sizes[k] in whole.sizes[:k]
        if value.window != 1:
            raise NotRecognisedError("activations of a local model over a window")
        term = value.pieces[0]
        if repeated:
            term = relations.layers.along_other(term, "set" + "s" * k)
        found.append(term)
    return found


_STEP = "SampleTime"


def calculus(graph: Graph) -> Mapping[str, Recognised]:
    """Integrals and derivatives in time by the relation that is their value; e is the integrand or
    differentiated value.

      integral    I = I[t−1] + e dt, closed by itself
      trapezoidal I = I[t−1] + (e + e[t−1]) 0.5 dt
      derivative  (e − e[t−1]) / dt, e connected to a buffer
      trapezoidal d = (e − e[t−1]) 2 / dt − d[t−1]
    """
    found: dict[str, Recognised] = {}
    for name, given in graph.file.Inputs.items():
        source = given.closed_loop
        # `local` marks inputs that nnodely has made itself: one that a user closes is a state by
        # its own right
        if source is not None and given.connect is None and given.local:
            one = _integral(graph, name, source) or _ringing(graph, name, source)
            if one is not None:
                found[source] = one
    for name in graph.file.Relations:
        slope = _slope(graph, name)
        if slope is not None and name not in found:
            found[name] = _of_past("der", "", slope, graph)
    return found


def _integral(graph: Graph, state: str, source: str) -> Recognised | None:
    sides = graph.pair(source, "Add")
    if sides is None or not _is_own_past(graph, sides[0], state):
        return None
    factors = graph.pair(sides[1], "Mul")
    # nnodely writes its own loops with the operands in this order
    if factors is None or factors[1] != _STEP:
        return None
    half = graph.pair(factors[0], "Mul")
    # looked for first: the sum of two samples is an integrand of the other form as well
    if half is not None and graph.is_constant(half[1], 0.5):
        sums = graph.pair(half[0], "Add")
        buffer = None if sums is None else _neighbours(graph, *sums)
        if buffer is not None:
            return _of_past("integral", ", method=trapezoidal", buffer, graph)
    integrand = factors[0]
    # an integral of a parameter: left to be followed as it stands
    if integrand not in graph.file.Relations:
        return None

    def make(relations: Followed) -> Value:
        return _called("integral", "", relations.operand(integrand))

    return Recognised((integrand,), make)


def _ringing(graph: Graph, state: str, source: str) -> Recognised | None:
    sides = graph.pair(source, "Sub")
    if sides is None or not _is_own_past(graph, sides[1], state):
        return None
    # d = (e − e[t−1]) 2 / dt − d[t−1] has its pole at −1: an error of d stays, with changing sign
    quotient = graph.pair(sides[0], "Div")
    double = None if quotient is None else graph.pair(quotient[0], "Mul")
    if quotient is None or quotient[1] != _STEP or double is None:
        return None
    step = graph.pair(double[0], "Sub")
    buffer = None if step is None else _neighbours(graph, *step)
    if buffer is None or not graph.is_constant(double[1], 2.0):
        return None
    return _of_past("der", ", method=trapezoidal", buffer, graph)


def _slope(graph: Graph, name: str) -> str | None:
    """The buffer whose time derivative the relation `name` is, computed from its two newest
    samples; None for other relations.
    """
    quotient = graph.pair(name, "Div")
    if quotient is None or quotient[1] != _STEP:
        return None
    step = graph.pair(quotient[0], "Sub")
    return None if step is None else _neighbours(graph, *step)


def _neighbours(graph: Graph, newest: str, older: str) -> str | None:
    """The connected buffer whose two newest samples the relations `newest` and `older` are; None if
    there is none.
    """
    buffer = graph.sample(newest, 0)
    if buffer is None or graph.sample(older, 1) != buffer:
        return None
    given = graph.file.Inputs[buffer]
    # exactly two samples: a longer buffer is read elsewhere, too
    is_short = given.sw == [-2, 0] and given.tw is None and given.connect is not None
    return buffer if is_short and given.connect in graph.file.Relations else None


def _is_own_past(graph: Graph, name: str, state: str) -> bool:
    """True if the relation `name` is the previous value of the input `state` and neither has
    another use.
    """
    given = graph.file.Inputs[state]
    is_last = graph.sample(name, 0) == state and given.sw == [-1, 0] and given.tw is None
    # a state that others read has to stay one
    return is_last and graph.uses[name] == 1 and graph.uses[state] == 1


def _of_past(function: str, rest: str, buffer: str, graph: Graph) -> Recognised:
    source = graph.file.Inputs[buffer].connect
    assert source is not None

    def make(relations: Followed) -> Value:
        assert relations.signals is not None
        return _called(function, rest, relations.signals.kept_past(buffer))

    return Recognised((source,), make)


def _called(function: str, rest: str, value: Value) -> Value:
    if value.window != 1:
        raise ShapeError("an integral or derivative in time of more than one sample")
    head = Call(function, rest, steady=False)
    return Value(1, value.dim, (Term(head, (value.pieces[0],), None, value.dim),))
