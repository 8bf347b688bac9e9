"""Says how far measurements may lie from a simulation: uncertain numbers and what errors leave.

The interval of an output ŷ at one sample is ŷ ± z √(v + σ²): v is the variance that the covariance
of the learned numbers makes there, by the exact slopes of the whole rollout (`output_variances`),
σ² that of the errors of the same kind of rollout over the training rows, by n − p of n values and p
numbers. z is of the normal distribution. It promises that a measured value lies inside with that
probability, at each sample by itself, if errors are like those in training; not that a whole record
does: errors with memory leave the band in stretches.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from compiler.differentiation.output_variances import ROOT, VARIANCE, with_variances
from compiler.ir.program import Program
from msnn.data.dataset import FloatArray
from msnn.model.weights.covariance_file import Covariance


@dataclass(frozen=True, slots=True, kw_only=True)
class Intervals:
    """The widths of the intervals of a model's outputs."""

    level: float
    """The probability that a measured value lies inside, between 0 and 1."""
    covariance: Covariance
    noise: Mapping[str, FloatArray]
    """σ² of each output that has an interval, of each of its elements."""

    def half_width(self, output: str, variance: FloatArray) -> FloatArray:
        """The half width of intervals at samples where the learned numbers make this variance."""
        # errors of numbers and of measurements taken as independent: variances add
        return quantile(self.level) * np.sqrt(variance + self.noise[output])


@dataclass(frozen=True, slots=True)
class UncertainProgram:
    """A program that simulates the variances of its outputs too, and the weights that it needs."""

    program: Program
    weights: Mapping[str, FloatArray]

    def variance(self, output: str, outputs: Mapping[str, FloatArray]) -> FloatArray:
        """The variance of an output of the program; 0 where no learned number reaches it."""
        found = outputs.get(f"{VARIANCE}{output}")
        return np.zeros_like(outputs[output]) if found is None else found


def uncertain_program(
    program: Program, intervals: Intervals, weights: Mapping[str, FloatArray]
) -> UncertainProgram:
    """The program, its loops closed, with the variances of the outputs that have an interval."""
    there = {parameter.name for parameter in program.parameters}
    # a simulation drops what only losses use
    learned = [name for name in intervals.covariance.values if name in there]
    if not learned:
        return UncertainProgram(program, weights)
    whole = with_variances(program, learned, intervals.noise.keys())
    return UncertainProgram(whole, {**weights, ROOT: intervals.covariance.root(learned)})


def quantile(level: float) -> float:
    """So many standard deviations about the mean hold this share of a normal distribution."""
    return NormalDist().inv_cdf(0.5 + level / 2.0)
