"""The variables of the optimisers that run inside a training kernel, and the choice of the
optimiser.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from backends.known_terms import KnownTerms
from backends.native.kernel_data import (
    CurvatureStruct,
    KnownStruct,
    OptimizerStruct,
    VariablesStruct,
)
from backends.raw_parameters import is_off_bounds, mapping_of, raw_value
from compiler.ir.program import Parameter, Program

FloatArray = NDArray[np.float64]


_VECTORS = 5
"""Work vectors of an L-BFGS step: gradient, variables, direction, and two more gradients."""


class Method(IntEnum):
    """The optimisers of kernels; their values are those in the C source."""

    ADAM = 0
    ADAMW = 1
    SGD = 2
    LBFGS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """The optimiser of a kernel: its method and constants. `beta1`, `beta2` and `epsilon` are those
    of Adam (`beta1` also the momentum of SGD), `decay` is the weight decay.
    """

    method: Method
    beta1: float = 0.0
    beta2: float = 0.0
    epsilon: float = 0.0
    decay: float = 0.0
    clip: float = 0.0
    """Maximum norm of a gradient; 0 for no limit."""
    history: int = 0
    """Number of L-BFGS steps from which the curvature is estimated."""
    iterations: int = 0
    """L-BFGS steps per batch."""


class KnownMemory:
    """Priors and penalties of all parameters in the kernel's memory layout; `struct` points into
    arrays that this object keeps alive.
    """

    def __init__(self, known: KnownTerms) -> None:
        ends = np.cumsum([0, *(len(one) for one in known.slices)]).astype(np.int64)
        numbers = np.concatenate([np.zeros(0, np.int64), *known.slices]).astype(np.int32)
        # keeps the arrays alive: the struct only has their addresses
        self._arrays = (known.mean, known.std, known.magnitude, numbers, ends, known.norms)
        addresses = (array.ctypes.data for array in self._arrays)
        self.struct = KnownStruct(*addresses, len(known.slices), 0.0)


class CurvatureMemory:
    """The memory of L-BFGS for `numbers` variables in the kernel's layout. `struct` points into
    arrays that this object keeps alive; those in `arrays` are needed to resume a training.
    """

    def __init__(self, rule: Rule, numbers: int) -> None:
        self.arrays = {
            "steps": np.zeros((rule.history, numbers)),
            "changes": np.zeros((rule.history, numbers)),
            "shares": np.zeros(rule.history),
        }
        self._room = (np.zeros(rule.history), np.zeros((_VECTORS, numbers)))
        addresses = (array.ctypes.data for array in (*self.arrays.values(), *self._room))
        # the default limit of function evaluations of torch.optim.LBFGS
        looks = rule.iterations * 5 // 4
        self.struct = CurvatureStruct(rule.history, rule.iterations, looks, 0, 0, *addresses)


class Variables:
    """The variables of an optimiser in a kernel: raw values, physical values and moments as flat
    arrays, in the order of the program's parameters. `weights` are initial physical arrays by name.
    `rates` are learning rates by name; a parameter without one, or with 0, is fixed. `known` are
    priors and penalties.
    """

    def __init__(
        self,
        *,
        program: Program,
        dtype: np.dtype[Any],
        rule: Rule,
        weights: Mapping[str, FloatArray],
        rates: Mapping[str, float],
        known: KnownTerms | None = None,
    ) -> None:
        self._program = program
        parameters = program.parameters
        held = {p.name for p in parameters if not rates.get(p.name)}
        raws = {p.name: raw_value(p, weights[p.name]) for p in parameters if p.name not in held}
        self.moved = tuple(name for name, (_, moved) in raws.items() if moved)
        """Parameters that were on a bound and had to be moved off it."""

        def numbers(of: Callable[[Parameter], ArrayLike]) -> FloatArray:
            parts = [np.broadcast_to(of(p), np.shape(weights[p.name])).ravel() for p in parameters]
            # np.concatenate needs an array, also without parameters
            return np.concatenate([np.zeros(0), *parts])

        arrays: dict[str, NDArray[Any]] = {
            "kind": numbers(lambda p: int(mapping_of(p))).astype(np.int32),
            # absent bounds are never read, by `kind`
            "low": numbers(lambda p: p.minimum or 0.0),
            "high": numbers(lambda p: p.maximum or 0.0),
            "scale": numbers(lambda p: p.scale),
            "rate": numbers(lambda p: rates.get(p.name, 0.0)).astype(dtype),
            # fixed parameters have no raw value and may stay on a bound
            "raw": numbers(lambda p: raws[p.name][0] if p.name in raws else 0.0).astype(dtype),
            "physical": numbers(lambda p: weights[p.name]).astype(dtype),
        }
        self._given = arrays["raw"].copy(), arrays["physical"].copy()
        off_bounds = numbers(lambda p: is_off_bounds(p, np.asarray(weights[p.name])))
        self._begins_as_given = off_bounds.astype(bool)
        # the initial rates: `scale_rates` multiplies these, so that rounding does not accumulate
        self._rates = numbers(lambda p: rates.get(p.name, 0.0))
        arrays["first"] = np.zeros_like(arrays["raw"])
        arrays["second"] = np.zeros_like(arrays["raw"])
        self.arrays = arrays
        # in the order of the struct's fields
        self.addresses = VariablesStruct(*(array.ctypes.data for array in arrays.values()))
        constants = (rule.beta1, rule.beta2, rule.epsilon, rule.decay, rule.clip)
        self.optimizer = OptimizerStruct(int(rule.method), 0, *constants, 0, 1.0, 1.0, 0)
        self.curvature: CurvatureMemory | None = None
        if rule.method is Method.LBFGS:
            self.curvature = CurvatureMemory(rule, len(arrays["raw"]))
            self.optimizer.curvature = ctypes.pointer(self.curvature.struct)
        self.known = None if known is None or known.is_empty else KnownMemory(known)
        if self.known is not None:
            self.optimizer.known = ctypes.pointer(self.known.struct)

    def keep_given(self) -> None:
        """Replaces the physical values of variables whose raw value has not changed by the initial
        ones, since mapping them to raw values and back rounds.
        """
        raw, physical = self._given
        begun = self._begins_as_given & (self.arrays["raw"] == raw)
        np.copyto(self.arrays["physical"], physical, where=begun)

    def scale_rates(self, factor: float) -> None:
        """Sets the learning rates to `factor` times their initial values."""
        self.arrays["rate"][:] = factor * self._rates

    def set_spread(self, spread: float) -> None:
        """Sets the weight of priors to `spread`, ŝ²/n: estimated variance of the residuals divided
        by their number. Does nothing without priors and penalties.
        """
        if self.known is not None:
            self.known.struct.spread = spread

    @property
    def remembered(self) -> dict[str, NDArray[Any]]:
        """The arrays, by name, that optimiser steps change. Storing and restoring them, with
        `counts`, resumes a training.
        """
        own = {name: self.arrays[name] for name in ("raw", "first", "second")}
        return own if self.curvature is None else own | self.curvature.arrays

    @property
    def counts(self) -> list[tuple[ctypes.Structure, str]]:
        """The counters that optimiser steps change, each as a C struct and the name of its
        field.
        """
        own: list[tuple[ctypes.Structure, str]] = [
            (self.optimizer, name) for name in ("steps", "first_decay", "second_decay")
        ]
        if self.curvature is not None:
            own += [(self.curvature.struct, name) for name in ("pairs", "newest")]
        return own

    @property
    def physical(self) -> FloatArray:
        """The current physical values of all parameters, flat, in the order of the program's
        parameters.
        """
        return self.arrays["physical"].astype(float)

    def weights(self) -> dict[str, FloatArray]:
        """The current physical values, arrays by name of parameter."""
        return by_parameter(self._program, self.physical)


def flat(program: Program, weights: Mapping[str, FloatArray]) -> FloatArray:
    """The elements of all weights (physical arrays by name) in one array, in the order of the
    program's parameters. Raises KeyError for a missing one.
    """
    return np.concatenate([np.zeros(0), *(weights[p.name].ravel() for p in program.parameters)])


def by_parameter(program: Program, numbers: FloatArray) -> dict[str, FloatArray]:
    """Splits a flat array of all parameters into arrays by name, in the shapes of the spec; the
    inverse of `flat`.
    """
    found: dict[str, FloatArray] = {}
    begin = 0
    for parameter in program.parameters:
        shape = tuple(axis.size for axis in parameter.axes)
        end = begin + int(np.prod(shape))
        found[parameter.name] = numbers[begin:end].reshape(shape)
        begin = end
    return found
