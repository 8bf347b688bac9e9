"""Declares the layers of a spec for relations with weights, sets or tables."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msnn.features.nnodely.parameters import Parameters
from msnn.features.nnodely.terms.dims import Dims
from msnn.features.nnodely.terms.names import TakenNames
from msnn.features.nnodely.terms.terms import Call, Named, Term, call, infix, number
from msnn.features.nnodely.terms.values import ShapeError, Value, ValueOperations


@dataclass(frozen=True, slots=True)
class Weighted:
    """A relation with a matrix and an optional offset; equal ones share a layer."""

    kind: str
    weight: str
    bias: str | None
    dropout: float


@dataclass(slots=True, kw_only=True)
class Layers:
    """Declares layers in the spec."""

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
        """Σₖ W[k, o] x[t − n + 1 + k] + b[o]."""
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
        """Σᵢ W[i, o] x[i] + b[o], sample by sample."""
        weight = self.matrix(layer, value.dim)
        out = weight.shape[1]
        name = self._layer("linear", layer, weight, (value.dim, "dim"))
        return self.values.along(lambda term: call(name, term, dim=out), value, out)

    def declare(self, wanted: str, key: Any, settings: dict[str, Any]) -> str:
        """A layer with settings; equal keys share one layer."""
        if key not in self._known:
            self._known[key] = self.names.free(wanted)
            self.declared[self._known[key]] = settings
        return self._known[key]

    def along_other(self, term: Term, kind: str) -> Term:
        """A copy of fuzzy sets along a separate dimension."""
        head = term.head
        settings = self.declared.get(head.name) if isinstance(head, Call) else None
        if not isinstance(head, Call) or settings is None or "fuzzify" not in settings:
            raise ShapeError("two activations of one size that are no fuzzy sets")
        dim = self.dims.of(term.dim, kind)
        again = {"fuzzify": {**settings["fuzzify"], "dim": dim}}
        name = self.declare(head.name, ("other", head.name, kind), again)
        return Term(Call(name), term.args, term.window, term.dim)

    def matrix(self, layer: Weighted, rows: int) -> NDArray[np.float64]:
        """The weights of a layer over so many samples or elements, with fitting offsets."""
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
        """The filter for a concatenated window: a matrix times a list."""
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
