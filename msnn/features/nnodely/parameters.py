"""Converts the arrays of a saved model to parameters and constants of a spec."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from msnn.features.nnodely.arrays import Elements
from msnn.features.nnodely.errors import unfit_shapes, without_values
from msnn.features.nnodely.json_text import JsonText
from msnn.features.nnodely.names import Dims, TakenNames
from msnn.features.nnodely.saved_model import Array
from msnn.features.nnodely.terms import LARGEST, Named, Term, number, number_text, shortest
from msnn.features.nnodely.terms import Call as CallHead
from msnn.features.nnodely.values import Value
from spec_schema.diagnostics.diagnostic import SpecError

# names that nnodely gives to numbers in formulas: these are written as numbers again
_AUTOMATIC = re.compile(r"Constant\d+|FParamFun\d+.*")
_SHOWN = 16
"""Maximum number of elements written in the spec."""
_IN_ONE_TEXT = 150
"""Maximum number of elements in one expression."""


@dataclass(frozen=True, slots=True)
class Numbers:
    """An array of the saved model; `timed` is True if its first axis is a window."""

    name: str
    values: NDArray[np.float64]
    """Values in the file's shape: window first, then the dimensions."""
    timed: bool

    @property
    def turned(self) -> NDArray[np.float64]:
        """The values with the window last, without axes of length 1."""
        values = np.moveaxis(self.values, 0, -1) if self.timed else self.values
        # the language has no axes of one element (R3)
        return values.reshape([n for n in values.shape if n > 1])


@dataclass(slots=True, kw_only=True)
class Parameters:
    """The arrays of the saved model, and the parameters (`declared`) and constants (`fixed`) that
    the spec declares for them, with trained values in `weights`.
    """

    text: JsonText
    parameters: dict[str, Array]
    constants: dict[str, Array]
    sample_time: float
    names: TakenNames
    dims: Dims
    across: frozenset[str] = frozenset()
    """Matrices that are transposed in the spec, as required by the layers that share them."""
    declared: dict[str, dict[str, Any]] = field(default_factory=dict[str, dict[str, Any]])
    fixed: dict[str, Any] = field(default_factory=dict[str, Any])
    weights: dict[str, NDArray[np.float64]] = field(
        default_factory=dict[str, "NDArray[np.float64]"]
    )
    _terms: dict[str, Term] = field(default_factory=dict[str, Term])

    def has(self, name: str) -> bool:
        """True if the file has an array with that name."""
        return name in self.parameters or name in self.constants

    def numbers(self, name: str) -> Numbers:
        """The values of an array in nnodely's shape: trained ones, else initial ones. Raises
        SpecError if it has none, or values of another shape.
        """
        section = "Parameters" if name in self.parameters else "Constants"
        array = self.parameters.get(name) or self.constants[name]
        place = self.text.place(section, name)
        # trained values, else those that training would begin with
        given = array.values if array.values is not None else array.init_values
        if given == "SampleTime":
            given = self.sample_time
        if given is None:
            raise SpecError([without_values(name, place)], [self.text.source])
        sizes = tuple(array.dim) if isinstance(array.dim, list) else (array.dim,)
        timed = array.sw is not None or array.tw is not None
        if timed:
            samples = array.sw if array.sw is not None else self._rounded(array.tw or 0)
            # nnodely has time first, the language last
            sizes = (samples, *sizes)
        # not reshaped: an array of another shape would be read in another order
        values = number_array(given)
        if values is None or values.shape not in {sizes, ()} or (values.shape == () and timed):
            wanted = " × ".join(map(str, sizes))
            reason = f"its values are not {wanted} finite numbers"
            raise SpecError([unfit_shapes(f"{section}.{name}", reason, place)], [self.text.source])
        return Numbers(name, values, timed)

    def _rounded(self, seconds: float) -> int:
        """A duration in samples; 0 for infinite values, which fit no array."""
        steps = seconds / self.sample_time
        return round(steps) if abs(steps) < 1e15 else 0

    def operand(self, name: str) -> Value | None:
        """A parameter or constant as an operand of other relations; None for an array with more
        axes than window and elements, such as a matrix.
        """
        found = self.numbers(name)
        shape = list(found.values.shape)
        size = shape[-1] if shape else 1
        window = shape[0] if found.timed else 1
        if found.values.ndim > (2 if found.timed else 1):
            return None
        return Value(window, size, (self.term(name),))

    def is_matrix(self, name: str) -> bool:
        """True if the file has an array with that name for which `operand` returns None."""
        return self.has(name) and self.operand(name) is None

    def term(self, name: str) -> Term:
        """The array as a term; the spec then declares it."""
        if name not in self._terms:
            self._terms[name] = self._declare(name)
        return self._terms[name]

    def elements(self, name: str) -> Elements:
        """The array in nnodely's shape, with each element as a term."""
        found = self.numbers(name)
        out = np.empty(found.values.shape, dtype=object)
        whole = self.term(name)
        for index in np.ndindex(*found.values.shape):
            # the window moves from the first axis to the last
            turned = (*index[1:], index[0]) if found.timed else index
            sizes = found.values.shape[1:] + found.values.shape[:1] if found.timed else out.shape
            if name in self.across:
                turned, sizes = turned[::-1], sizes[::-1]
            kept = [i for i, n in zip(turned, sizes, strict=True) if n > 1]
            out[index] = self.element(whole, kept)
        return out

    def element(self, whole: Term, index: list[int]) -> Term:
        """One element of the array `whole` as a term; `index` has one entry per axis of
        the spec.
        """
        term = whole
        axes = whole.head.axes if isinstance(whole.head, Named) else ()
        for k, i in enumerate(index):
            # the last axis that is left needs no label
            last = k == len(index) - 1
            rest = f", {i}" if last else f", {self.dims.label(axes[k], i)}"
            term = Term(CallHead("part", rest), (term,), None, 1)
        return term

    def samples(self, whole: Term, first: int, end: int) -> Term:
        """The samples first … end − 1 of an array whose last axis is the window."""
        axes = whole.head.axes if isinstance(whole.head, Named) else ()
        found: list[Term] = []
        for k in range(first, end):
            rest = f", {k}" if len(axes) == 1 else f", {self.dims.label(axes[len(axes) - 1], k)}"
            found.append(Term(CallHead("part", rest), (whole,), None, whole.dim))
        return self.stacked(found)

    def stacked(self, samples: Sequence[Term]) -> Term:
        """Combines terms of consecutive samples to one term along a window; a single one is
        returned unchanged.
        """
        if len(samples) == 1:
            return samples[0]
        head = CallHead("stack", f", dim={self.dims.of(len(samples), 'tap')}", steady=False)
        return Term(head, tuple(samples), len(samples), samples[0].dim)

    def _declare(self, name: str) -> Term:
        if name == "SampleTime" and name in self.constants:
            return Term(Named("dt"))
        found = self.numbers(name)
        turned = found.turned.T if name in self.across else found.turned
        if turned.ndim == 0 and name in self.constants and _AUTOMATIC.fullmatch(name):
            return number(float(turned))
        new = self.names.of("array", name)
        shape = list(found.values.shape)
        size = shape[-1] if shape else 1
        window = shape[0] if found.timed and shape[0] > 1 else None
        kinds = ["dim"] * turned.ndim
        if window is not None and kinds:
            kinds[-1] = "tap"
        axes: list[str] = []
        for kind, length in zip(kinds, turned.shape, strict=True):
            # two axes of one length need two dimensions: an axis is known by its name
            while (axis := self.dims.of(length, kind)) in axes:
                # another kind makes another dimension of the same size
                kind = f"{kind}_"
            axes.append(axis)
        if name in self.constants:
            shown = entry_of(turned)
            self.fixed[new] = {"value": shown, "dims": _dims(axes)} if axes else shown
        else:
            self._learned(new, axes, turned)
        return Term(Named(new, tuple(axes), window is not None), (), window, size)

    def joined(self, names: list[str], dim: str) -> Term:
        """Declares one parameter along the dimension `dim` from the scalar parameters `names`, in
        that order; returns it as a term.
        """
        new = self.names.free(names[0])
        # of shape () or (1,), which both are one number
        values = np.concatenate([self.numbers(name).values.reshape(-1)[:1] for name in names])
        self._learned(new, [dim], values)
        return Term(Named(new, (dim,)), (), None, len(names))

    def _learned(self, new: str, axes: list[str], values: NDArray[np.float64]) -> None:
        # the numbers are in the weights, whatever the spec shows
        shown = entry_of(values) if values.size <= _SHOWN else 0
        self.declared[new] = {"init": shown} | ({"dims": _dims(axes)} if axes else {})
        self.weights[new] = values


def entry_of(values: NDArray[np.float64]) -> Any:
    """The values in the form of a spec: a number, a list of numbers, or nested lists as text; large
    arrays as a list of such texts.
    """
    if values.ndim == 0:
        return shortest(float(values))
    if values.ndim == 1:
        return [shortest(float(value)) for value in values]
    return _list_text(values) if values.size <= _IN_ONE_TEXT else [_list_text(v) for v in values]


def _list_text(values: NDArray[np.float64]) -> str:
    if values.ndim == 0:
        return number_text(float(values))
    return f"[{', '.join(_list_text(value) for value in values)}]"


def _dims(axes: list[str]) -> str | list[str]:
    return axes[0] if len(axes) == 1 else axes


def number_array(given: Any) -> NDArray[np.float64] | None:
    """Nested lists of numbers as an array; None for anything else, and for numbers that are not
    finite in single precision.
    """
    try:
        values = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
    # beyond single precision nnodely has an infinite number
    # false for NaN as well
    fits = bool(np.all(np.abs(values) <= LARGEST))
    return values if fits and not _has_words(given) else None


def _has_words(given: Any) -> bool:
    stack = [given]
    while stack:
        one = stack.pop()
        if isinstance(one, list):
            stack.extend(cast("list[Any]", one))
        elif isinstance(one, bool) or not isinstance(one, int | float):
            return True
    return False
