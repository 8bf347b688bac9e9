"""Packs all learned parameters of a stage into one vector of raw variables, and unpacks them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from backends.raw_parameters import physical_slope, physical_value, raw_value
from compiler.ir.program import Parameter
from msnn.data.dataset import FloatArray


class LearnedNumbers:
    """The elements of parameters, one parameter after the other; further elements are ignored."""

    def __init__(self, parameters: Sequence[Parameter], given: Mapping[str, FloatArray]) -> None:
        self._parameters, self._given = parameters, dict(given)
        sizes = [self._given[p.name].size for p in parameters]
        self._ends = np.cumsum(sizes, dtype=np.int64)

    def begin(self) -> tuple[FloatArray, tuple[str, ...]]:
        """The raw variables of the given values, and the parameters that were moved off a bound."""
        raws = [raw_value(p, self._given[p.name]) for p in self._parameters]
        moved = tuple(p.name for p, (_, off) in zip(self._parameters, raws, strict=True) if off)
        return np.concatenate([raw.ravel() for raw, _ in raws]), moved

    def weights(self, raw: FloatArray) -> dict[str, FloatArray]:
        """Physical values of all parameters; parameters that are not learned keep their given
        values.
        """
        weights = dict(self._given)
        for parameter, part in self.parts(raw):
            weights[parameter.name] = physical_value(parameter, part)
        return weights

    def slopes(self, raw: FloatArray) -> FloatArray:
        """The derivatives of physical values with respect to their raw variables."""
        return np.concatenate([physical_slope(p, part).ravel() for p, part in self.parts(raw)])

    def parts(self, raw: FloatArray) -> list[tuple[Parameter, FloatArray]]:
        """Each parameter with its section of a vector, reshaped to the parameter's shape."""
        parts = np.split(raw[: int(self._ends[-1])], self._ends[:-1])
        return [
            (parameter, part.reshape(self._given[parameter.name].shape))
            for parameter, part in zip(self._parameters, parts, strict=True)
        ]
