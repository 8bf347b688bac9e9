"""Adds weight decay and priors to least squares, as quadratic functions of the raw variables.

Weight decay λ is λ/2 · Σ raw²; its gradient λ · raw is what other optimisers add to the gradient. A
prior is ŝ²/n · ((p − mean)/std)², the square of an additional residual of the physical value p.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from backends.known_terms import KnownTerms, deviations
from backends.raw_parameters import Mapping, mapping_of, physical_slope, raw_value
from compiler.ir.program import Parameter
from msnn.data.dataset import FloatArray


@dataclass(frozen=True, slots=True)
class QuadraticTerms:
    """A quadratic near given raw variables: value + 2 slopeᵀδ + Σ curvature · δ²."""

    value: float
    slope: FloatArray
    curvature: FloatArray


def quadratic_terms(
    known: KnownTerms, variables: FloatArray, decay: Decay, spread: float
) -> QuadraticTerms:
    """The terms at these variables; priors are weighted by `spread`, ŝ²/n."""
    half = 0.5 * decay.factor
    raw, by_variable = decay.raw(variables)
    away, steep = deviations(known, variables)
    return QuadraticTerms(
        value=half * float(raw @ raw) + spread * float(away @ away),
        slope=half * raw * by_variable + spread * away * steep,
        curvature=half * by_variable * by_variable + spread * steep * steep,
    )


@dataclass(frozen=True, slots=True)
class Decay:
    """Weight decay λ in the raw variables of other optimisers, for bounded values too."""

    factor: float
    parameters: Sequence[Parameter]
    """The parameters with their bounds."""

    def raw(self, variables: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Raw variables and their derivatives with respect to the physical values of bounded
        parameters.
        """
        raw, by_variable = variables.copy(), np.ones_like(variables)
        begin = 0
        for parameter in self.parameters if self.factor else ():
            part = slice(begin, begin := begin + len(parameter.initial))
            if mapping_of(parameter) is not Mapping.LINEAR:
                raw[part], _ = raw_value(parameter, variables[part])
                by_variable[part] = 1.0 / physical_slope(parameter, raw[part])
        return raw, by_variable
