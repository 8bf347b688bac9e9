"""Converts weights from every accepted form, and checks them against the model."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol, TypeAlias, cast, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compiler.ir.program import Program
from msnn.data.dataset import FloatArray
from msnn.errors.learning import training as errors
from msnn.model.saved_run import WEIGHTS, followed
from msnn.model.weights.checked_weights import GIVEN, checked_weights
from msnn.model.weights.weights_file import initial_weights, read_weights
from spec_schema.diagnostics.diagnostic import SpecError


@runtime_checkable
class TensorLike(Protocol):
    """A torch tensor; torch need not be installed."""

    def detach(self) -> Any: ...


Value: TypeAlias = "ArrayLike | TensorLike"


@runtime_checkable
class HasWeights(Protocol):
    """A result of `train`, of `train_folds`, or the loss of a stage."""

    @property
    def weights(self) -> Any: ...


Weights: TypeAlias = "Mapping[str, Value] | HasWeights | str | Path"
"""Physical values of every parameter, in the units of the spec, by name; a result that has them;
or the path of a weights file or of the folder of a run."""


def given_weights(program: Program, weights: Weights) -> dict[str, FloatArray]:
    """The array of every parameter of a program, in float64 (rule R12).

    A name that is missing or unknown, a wrong shape and values that are no finite real numbers are
    errors, raised together as SpecError; TypeError for what is no weights at all.
    """
    if isinstance(weights, str | Path):
        return read_weights(weights_path(weights), program)
    if not isinstance(weights, Mapping):
        found = weights.weights if isinstance(cast("object", weights), HasWeights) else None
        # of the loss of a stage it is a method
        found = found() if callable(found) else found
        if not isinstance(found, Mapping):
            kind = type(weights).__name__
            message = f"weights are a mapping, a result of training or a path, not {kind}"
            raise TypeError(message)
        weights = cast("Mapping[str, Value]", found)
    # names that are no text, of a numpy array of names
    arrays = {str(name): _array(value) for name, value in weights.items()}
    return checked_weights(program, arrays, GIVEN)


def known_weights(program: Program, weights: Weights | None) -> Mapping[str, FloatArray]:
    """The weights that are given, by default the initial values.

    Raises SpecError where the given ones do not fit, or initial ones are not known (R12).
    """
    if weights is not None:
        return given_weights(program, weights)
    unknown = [p for p in program.parameters if p.statistic is not None]
    if unknown:
        names = [parameter.name for parameter in unknown]
        raise SpecError((errors.unknown_statistics(names, unknown[0].span),))
    return initial_weights(program)


def weights_path(given: str | Path) -> Path:
    """The weights file that a path means: itself, or that of the folder of a run."""
    path = Path(given)
    # where links are refused `latest` is a file that leads to a folder
    path = path if path.is_dir() else followed(path)
    return path / WEIGHTS if path.is_dir() else path


def _array(value: Value) -> NDArray[Any]:
    """A value as array; integers such as 15 are accepted."""
    if isinstance(value, TensorLike):
        tensor = value.detach().cpu()
        # numpy has no bfloat16
        value = cast(
            "NDArray[Any]", (tensor.double() if tensor.is_floating_point() else tensor).numpy()
        )
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        array = np.asarray(value, dtype=object)
    return array.astype(np.float64) if array.dtype.kind in "iu" else array
