"""Saves the covariance of learned parameters next to their weights, and finds it again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, cast, runtime_checkable

import numpy as np

from backends.files.atomic_write import write_bytes
from backends.files.safetensors_bytes import safetensors_bytes
from msnn.data.dataset import FloatArray, IntArray
from msnn.errors.learning.weights import no_covariance
from msnn.model.saved_run import PARAMETERS, read_json
from msnn.model.weights.safetensors_file import WeightsFault, arrays_in
from msnn.model.weights.weights_file import Weights, weights_path
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.reading.reader import refuse_endless

COVARIANCE = "covariance.safetensors"
_MATRIX = "covariance"
_VALUE = "value of "


@dataclass(frozen=True, slots=True)
class Covariance:
    """The covariance matrix of the parameters that a training has learned, with their values."""

    values: Mapping[str, FloatArray]
    """The estimated values of the parameters; the covariance is valid for these values only."""
    matrix: FloatArray
    """Rows and columns: all elements of `values`, one parameter after the other.

    It is 0 for an element at a bound or set to 0 by a penalty, and in unidentifiable directions.
    """

    @classmethod
    def sorted_by_name(
        cls, names: Sequence[str], weights: Mapping[str, FloatArray], matrix: FloatArray
    ) -> Covariance:
        """Builds the covariance from `matrix`, (n, n), over all elements of the parameters `names`
        in turn.

        Parameters are sorted by name in the result.
        """
        places = _places(names, weights)
        # as safetensors sorts its arrays: rows are found again by the order of the file
        order = sorted(names)
        numbers = np.concatenate([places[name] for name in order])
        return cls({name: weights[name] for name in order}, matrix[np.ix_(numbers, numbers)])

    def root(self, names: Sequence[str]) -> FloatArray:
        """A square root L, (n, n), of the covariance of these parameters: L Lᵀ is their part of the
        matrix.
        """
        places = _places(list(self.values), self.values)
        numbers = np.concatenate([places[name] for name in names])
        part = self.matrix[np.ix_(numbers, numbers)]
        # eigenvalues, not Cholesky: the matrix is singular wherever a number is held
        values, vectors = np.linalg.eigh((part + part.T) / 2.0)
        # rounding makes eigenvalues that should be 0 slightly negative
        return vectors * np.sqrt(np.maximum(values, 0.0))

    @property
    def free(self) -> int:
        """The number of elements that were free to change."""
        # a number that is held has a row of zeros
        return int(np.count_nonzero(np.diagonal(self.matrix)))

    def belongs_to(self, weights: Mapping[str, FloatArray]) -> bool:
        """True if the covariance was estimated at these weights."""
        return all(
            name in weights and np.array_equal(weights[name], value)
            for name, value in self.values.items()
        )


def _places(names: Sequence[str], weights: Mapping[str, FloatArray]) -> dict[str, IntArray]:
    """The indices of each parameter's elements in the concatenation of all parameters."""
    ends = np.cumsum([weights[name].size for name in names])
    return {
        name: np.arange(end - weights[name].size, end)
        for name, end in zip(names, ends.tolist(), strict=True)
    }


def write_covariance(path: Path, found: Covariance) -> Path:
    """Writes matrix and values as a safetensors file."""
    arrays = {_MATRIX: found.matrix}
    arrays |= {f"{_VALUE}{name}": np.asarray(value) for name, value in found.values.items()}
    return write_bytes(path, safetensors_bytes(arrays, {"format": "msnn-covariance-1"}))


def read_covariance(weights_file: Path, weights: Mapping[str, FloatArray]) -> Covariance:
    """The covariance next to a weights file. Raises SpecError if there is none for its values."""
    path = weights_file.with_name(COVARIANCE)
    try:
        refuse_endless(path)
        content = path.read_bytes()
    except OSError:
        # the run says why it has none, which helps more than the name of a file
        errors = read_json(weights_file.with_name(PARAMETERS)).get("standard_errors")
        known = cast("dict[str, object]", errors) if isinstance(errors, dict) else {}
        reason = known.get("reason")
        why = f"there is no {path}" if reason is None else f"no standard errors, since {reason}"
        raise SpecError([no_covariance(why)]) from None
    # untrusted, like every file: shapes and finiteness are checked before anything is computed
    try:
        arrays = arrays_in(content)
    except WeightsFault as fault:
        raise SpecError([no_covariance(f"{path} cannot be read: {fault}")]) from fault
    values = {
        name.removeprefix(_VALUE): arrays[name]
        for name in sorted(arrays)
        if name.startswith(_VALUE)
    }
    matrix, size = arrays.get(_MATRIX), sum(value.size for value in values.values())
    if matrix is None or matrix.shape != (size, size) or not np.all(np.isfinite(matrix)):
        raise SpecError([no_covariance(f"{path} cannot be read")])
    found = Covariance(values, matrix)
    # weights that went on learning without a new covariance
    if not found.belongs_to(weights):
        raise SpecError([no_covariance(f"{path} belongs to other weights")])
    return found


class _Errors(Protocol):
    """An object like `StandardErrors`, as far as the covariance is concerned."""

    @property
    def covariance(self) -> Covariance | None: ...
    @property
    def reason(self) -> str | None: ...


@runtime_checkable
class _HasErrors(Protocol):
    """An object like the result of `train`, with standard errors."""

    @property
    def standard_errors(self) -> _Errors | None: ...


def known_covariance(weights: Weights | None, known: Mapping[str, FloatArray]) -> Covariance:
    """The covariance that belongs to weights; `known` are their values.

    `weights` is the path of a weights file or of a run, or a result of `train`. Raises SpecError if
    there is no covariance, or if it belongs to other values.
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
