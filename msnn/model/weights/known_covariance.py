"""Finds the covariance of weights, for every accepted form of weights."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Protocol, runtime_checkable

from msnn.data.dataset import FloatArray
from msnn.errors.results.intervals import no_covariance
from msnn.model.weights.covariance_file import Covariance, read_covariance
from msnn.model.weights.given_weights import Weights, weights_path
from spec_schema.diagnostics.diagnostic import SpecError


class _Errors(Protocol):
    """Standard errors of a training."""

    @property
    def covariance(self) -> Covariance | None: ...
    @property
    def reason(self) -> str | None: ...


@runtime_checkable
class _HasErrors(Protocol):
    """A result of `train`."""

    @property
    def standard_errors(self) -> _Errors | None: ...


def known_covariance(weights: Weights | None, known: Mapping[str, FloatArray]) -> Covariance:
    """The covariance of what a training has learned; `known` are the values of the weights.

    Of the path of a weights file or a run, or of a result of `train`. Raises SpecError where there
    is none, and where it is of other values.
    """
    if isinstance(weights, str | Path):
        return read_covariance(weights_path(weights), known)
    if weights is None:
        raise SpecError([no_covariance("initial values are not estimated from data")])
    if not isinstance(weights, _HasErrors):
        raise SpecError([no_covariance("numbers alone do not say how certain they are")])
    errors = weights.standard_errors
    if errors is None:
        raise SpecError([no_covariance("a training with `runs=None` does not estimate any")])
    if errors.covariance is None:
        why = errors.reason or "too few values were compared"
        raise SpecError([no_covariance(f"the training has no standard errors, since {why}")])
    return errors.covariance
