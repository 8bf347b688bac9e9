"""Computes prediction intervals from parameter uncertainty and residual variance.

The interval of an output ŷ at one sample is ŷ ± z √(v + σ²). Here v is the variance due to the
covariance of the parameters, by the exact derivatives of the whole rollout (`output_variances`). σ²
is the residual variance of the same kind of rollout over the training rows, with n − p degrees of
freedom. z is a quantile of the normal distribution.

Each single sample lies inside with the given probability, if errors are like those in training.
This does not hold for a whole recording, because autocorrelated errors leave the band for longer
periods.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from compiler.differentiation.sensitivities import ROOT, VARIANCE, with_variances
from compiler.ir.program import Program
from msnn.data.dataset import FloatArray
from msnn.model.weights.covariance import Covariance


@dataclass(frozen=True, slots=True, kw_only=True)
class Intervals:
    """The level and variances from which prediction intervals of a model's outputs are computed."""

    level: float
    """The probability that a measured value lies inside, between 0 and 1."""
    covariance: Covariance
    noise: Mapping[str, FloatArray]
    """σ² of each output with an interval, per element."""

    def half_width(self, output: str, variance: FloatArray) -> FloatArray:
        """Half the width of intervals at samples with this variance due to the parameters."""
        # errors of numbers and of measurements taken as independent: variances add
        return quantile(self.level) * np.sqrt(variance + self.noise[output])


@dataclass(frozen=True, slots=True)
class UncertainProgram:
    """A program that also computes the variances of its outputs, and the weights that it needs."""

    program: Program
    weights: Mapping[str, FloatArray]

    def variance(self, output: str, outputs: Mapping[str, FloatArray]) -> FloatArray:
        """The variance of an output; 0 if it depends on no learned parameter."""
        found = outputs.get(f"{VARIANCE}{output}")
        return np.zeros_like(outputs[output]) if found is None else found


def uncertain_program(
    program: Program, intervals: Intervals, weights: Mapping[str, FloatArray]
) -> UncertainProgram:
    """The closed-loop program with the variances of the outputs that have an interval."""
    there = {parameter.name for parameter in program.parameters}
    # a simulation drops what only losses use
    learned = [name for name in intervals.covariance.values if name in there]
    if not learned:
        return UncertainProgram(program, weights)
    whole = with_variances(program, learned, intervals.noise.keys())
    return UncertainProgram(whole, {**weights, ROOT: intervals.covariance.root(learned)})


def quantile(level: float) -> float:
    """Number of standard deviations around the mean that contain this share of a normal
    distribution.
    """
    return NormalDist().inv_cdf(0.5 + level / 2.0)
