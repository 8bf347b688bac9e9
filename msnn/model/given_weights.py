"""Takes weights in every form in which somebody gives them, and checks them against the model."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol, TypeAlias, cast, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compiler.ir.program import Program
from msnn.data.dataset import FloatArray
from msnn.errors import weights as errors
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError

WEIGHTS_FILE = "weights.safetensors"
"""What the folder of a run calls its weights."""


@runtime_checkable
class TensorLike(Protocol):
    """What a tensor of torch is here, which need not be installed."""

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

GIVEN = "the given mapping of weights"


def given_weights(program: Program, weights: Weights) -> dict[str, FloatArray]:
    """The array of every parameter of a program, in float64 (rule R12).

    A name that is missing or unknown, a wrong shape and values that are no finite real numbers are
    errors, raised together as SpecError; TypeError for what is no weights at all.
    """
    if isinstance(weights, str | Path):
        from msnn.model.weights_file import read_weights  # which checks by this module

        return read_weights(weights_path(weights), program)
    if not isinstance(weights, Mapping):
        found = weights.weights if isinstance(cast("object", weights), HasWeights) else None
        found = found() if callable(found) else found
        if not isinstance(found, Mapping):
            kind = type(weights).__name__
            message = f"weights are a mapping, a result of training or a path, not {kind}"
            raise TypeError(message)
        weights = cast("Mapping[str, Value]", found)
    arrays = {str(name): _array(value) for name, value in weights.items()}
    return checked_weights(program, arrays, GIVEN)


def weights_path(given: str | Path) -> Path:
    """The weights file that a path means: itself, or that of the folder of a run."""
    path = Path(given)
    return path / WEIGHTS_FILE if path.is_dir() else path


def checked_weights(
    program: Program, arrays: Mapping[str, NDArray[Any]], origin: str
) -> dict[str, FloatArray]:
    """The arrays of all parameters; SpecError with all that is wrong. `origin` names them."""
    faults: list[Diagnostic] = []
    known = [parameter.name for parameter in program.parameters]
    unknown = [name for name in arrays if name not in known]
    if unknown:
        faults.append(errors.unknown_weights(origin, unknown, known))
    missing = [name for name in known if name not in arrays]
    if missing:
        faults.append(errors.missing_weights(origin, missing, given=origin == GIVEN))
    found: dict[str, FloatArray] = {}
    for parameter in program.parameters:
        shape = tuple(axis.size for axis in parameter.axes)
        name, array = parameter.name, arrays.get(parameter.name)
        if array is None:
            continue
        if array.shape != shape:
            faults.append(
                errors.misshapen_weights(origin, name, array.shape, shape, parameter.span)
            )
        elif not np.issubdtype(array.dtype, np.floating):
            faults.append(errors.weights_not_floating(origin, name, str(array.dtype)))
        else:
            found[name] = array.astype(np.float64)
    wild = [name for name, array in found.items() if not np.all(np.isfinite(array))]
    if wild:
        faults.append(errors.weights_not_finite(origin, wild))
    if faults:
        raise SpecError(faults)
    return found


def _array(value: Value) -> NDArray[Any]:
    """A value as an array; whole numbers such as 15 are as good as 15.0."""
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
