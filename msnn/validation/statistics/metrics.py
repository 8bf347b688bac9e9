"""Computes metrics of predictions, for all elements together and for each."""

from __future__ import annotations

from dataclasses import dataclass
from math import prod
from typing import assert_never

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray, IntArray
from spec_schema.sections.training import Metric


@dataclass(frozen=True, slots=True)
class Scores:
    """A metric over all elements, and per element of a vector (its shape; scalar: ())."""

    value: float
    elements: FloatArray
    count: int
    """Number of elements with a target."""


@dataclass(frozen=True, slots=True)
class Spread:
    """Number, mean and Σ(x − mean)² of values per element; merged by the formulas of Chan et al.

    (1979).
    """

    count: IntArray
    mean: FloatArray
    squares: FloatArray

    @staticmethod
    def of(values: FloatArray, there: BoolArray) -> Spread:
        """The statistics of values (samples, elements) where `there`; exactly 0 for equal
        values.
        """
        count = np.asarray(there.sum(axis=0), np.int64)
        if not len(values):
            return Spread(count, np.zeros(len(count)), np.zeros(len(count)))
        # from the first value on: the mean of small differences loses no digits, and equal values
        # spread by 0
        first = np.take_along_axis(values, there.argmax(axis=0)[np.newaxis], axis=0)[0]
        away = np.where(there, values - first, 0.0)
        mean = away.sum(axis=0) / np.maximum(count, 1)
        away = np.where(there, away - mean, 0.0)
        return Spread(count, np.where(count > 0, first + mean, 0.0), (away * away).sum(axis=0))

    def __add__(self, other: Spread) -> Spread:
        # joined by means and squares about them: sums of squares alone lose digits (Chan et al.
        # 1979)
        count = self.count + other.count
        share = other.count / np.maximum(count, 1)
        apart = np.where(self.count * other.count > 0, other.mean - self.mean, 0.0)
        mean = np.where(self.count > 0, self.mean + apart * share, other.mean)
        squares = self.squares + other.squares + apart * apart * self.count * share
        return Spread(count, mean, squares)

    def joined(self) -> Spread:
        """The statistics over all elements together, instead of one for each."""
        found = Spread(self.count[:1], self.mean[:1], self.squares[:1])
        for i in range(1, len(self.count)):
            part = slice(i, i + 1)
            found = found + Spread(self.count[part], self.mean[part], self.squares[part])
        return found


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """The sums from which all metrics follow, per element; two of them can be added.

    Errors are e = prediction − target.
    """

    shape: tuple[int, ...]
    absolute: FloatArray
    """Σ|e|."""
    squares: FloatArray
    """Σe²."""
    largest: FloatArray
    """max |e|."""
    error: Spread
    target: Spread

    @staticmethod
    def of(prediction: FloatArray, target: FloatArray) -> Errors:
        """The sums for (samples, *shape) arrays; elements with a NaN target are ignored."""
        wanted = target.reshape(len(target), prod(target.shape[1:]))
        there = ~np.isnan(wanted)
        with np.errstate(all="ignore"):  # a prediction that has left the numbers shows as such
            error = np.where(there, prediction.reshape(wanted.shape) - wanted, 0.0)
            size = np.abs(error)
            return Errors(
                shape=target.shape[1:],
                absolute=size.sum(axis=0),
                squares=(error * error).sum(axis=0),
                largest=size.max(axis=0, initial=0.0),
                error=Spread.of(error, there),
                target=Spread.of(wanted, there),
            )

    def __add__(self, other: Errors) -> Errors:
        with np.errstate(all="ignore"):
            return Errors(
                shape=self.shape,
                absolute=self.absolute + other.absolute,
                squares=self.squares + other.squares,
                largest=np.maximum(self.largest, other.largest),
                error=self.error + other.error,
                target=self.target + other.target,
            )

    def joined(self) -> Errors:
        """The sums of all elements together; the variance of targets is about each element's
        mean.
        """
        # elements may have units of their own sizes: a common mean of targets would make `fit` look
        # better than it is
        about_own = self.target.joined()
        target = Spread(about_own.count, about_own.mean, self.target.squares.sum(keepdims=True))
        return Errors(
            shape=(1,),
            absolute=self.absolute.sum(keepdims=True),
            squares=self.squares.sum(keepdims=True),
            largest=self.largest.max(keepdims=True),
            error=self.error.joined(),
            target=target,
        )


def score(metric: Metric, errors: Errors, parameters: int = 0) -> Scores:
    """The metric of errors of a model with `parameters` learned parameters.

    rmse = √(mean e²), mae = mean |e|, max_abs = max |e| with e = prediction − target. fvu = Σe² /
    Σ(target − its mean)², r2 = 1 − fvu, fit = 100·(1 − √fvu) in percent (Ljung). aic = n ln(2π var
    e) + Σe²/var e + 2p with the variance about the mean of e, n scored elements and p =
    `parameters` (Akaike 1974). Its limit is −∞ without errors, and ∞ for a constant error. Means
    are per element. NaN if nothing is scored or the target is constant.
    """
    with np.errstate(all="ignore"):
        each = _values(metric, errors, parameters)
        value = _values(metric, errors.joined(), parameters)
    count = int(errors.error.count.sum())
    return Scores(float(value[0]), each.reshape(errors.shape), count)


def _values(metric: Metric, errors: Errors, parameters: int) -> FloatArray:
    # nothing scored is NaN, not 0: it keeps no limit
    count = np.where(errors.error.count > 0, errors.error.count, np.nan)
    targets = errors.target.squares
    # a target that stands still has no variance to explain
    unexplained = errors.squares / np.where(targets > 0, targets, np.nan)
    match metric:
        case "rmse":
            return np.sqrt(errors.squares / count)
        case "mae":
            return errors.absolute / count
        case "max_abs":
            return np.where(errors.error.count > 0, errors.largest, np.nan)
        case "fvu":
            return unexplained
        case "r2":
            return 1.0 - unexplained
        case "fit":
            return 100.0 * (1.0 - np.sqrt(unexplained))
        case "aic":
            variance = errors.error.squares / count
            likely = count * np.log(2 * np.pi * variance) + errors.squares / variance
            # both terms are infinite there
            limit = np.where(errors.squares > 0, np.inf, -np.inf)
            return np.where(variance == 0, limit, likely) + 2 * parameters
        case _:
            assert_never(metric)
