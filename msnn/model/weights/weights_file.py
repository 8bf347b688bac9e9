"""Converts weights from every accepted form, checks them against the model, and saves them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol, TypeAlias, cast, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from backends.files.atomic_write import write_bytes
from backends.files.safetensors_bytes import safetensors_bytes
from compiler.ir.program import Parameter, Program, UsedPlugin
from msnn.data.dataset import FloatArray
from msnn.errors.learning import training as training_errors
from msnn.errors.learning import weights as errors
from msnn.model.saved_run import DESCRIPTION, WEIGHTS, followed, read_json, recorded_plugins
from msnn.model.weights.safetensors_file import WeightsFault, arrays_in
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.reading.reader import refuse_endless


def initial_weights(program: Program) -> dict[str, FloatArray]:
    """The initial values of all parameters by name, each in its shape."""
    return {
        parameter.name: np.array(parameter.initial, dtype=np.float64).reshape(
            tuple(axis.size for axis in parameter.axes)
        )
        for parameter in program.parameters
    }


def write_weights(
    path: Path, weights: Mapping[str, FloatArray], program: Program, *, named_later: bool = False
) -> Path:
    """Writes weights as a safetensors file, with program name, spec hash and units as metadata.

    It is replaced atomically. `named_later` is that of `write_bytes`: the file may be missing after
    a power failure, for callers that would train again.
    """
    units = {p.name: p.unit.text for p in program.parameters if p.unit is not None}
    metadata = {
        "format": "msnn-weights-1",
        "program": program.name,
        "spec_sha256": program.spec_hash,
        "units": json.dumps(units, ensure_ascii=False, sort_keys=True),
    }
    arrays = {name: np.asarray(value, np.float64) for name, value in weights.items()}
    content = safetensors_bytes(arrays, metadata)
    # hours of training lie in it
    return write_bytes(path, content, durable=True, named_later=named_later)


def read_weights(path: Path, program: Program) -> dict[str, FloatArray]:
    """The weights of a program in a file.

    Raises SpecError with all errors (rule R12), and MissingPluginError if another plug-in has a
    name of the model than when the weights were trained.
    """
    shown = str(path)
    refuse_taken_names(path, program)
    try:
        refuse_endless(path)
        arrays = arrays_in(path.read_bytes())
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise SpecError((errors.unreadable_weights(shown, reason),)) from error
    except WeightsFault as fault:
        raise SpecError((errors.unreadable_weights(shown, str(fault)),)) from fault
    try:
        return checked_weights(program, arrays, shown)
    except SpecError as error:
        changed = changed_plugins(path, program)
        raise SpecError([_of_other_plugins(f, changed) for f in error.diagnostics]) from error


def refuse_taken_names(weights: Path, program: Program) -> None:
    """Raises MissingPluginError if another package has a name of the model than in the run of a
    weights file.
    """
    then = recorded_plugins(read_json(weights.parent / DESCRIPTION))
    if then:
        from msnn.model.program_file import refuse_other_packages

        refuse_other_packages(then, str(weights), now=program.plugins)


def changed_plugins(weights: Path, program: Program) -> list[tuple[str, UsedPlugin]]:
    """The program's plug-ins of which the run of a weights file had another version.

    Each with that version before it.
    """
    then = recorded_plugins(read_json(weights.parent / DESCRIPTION))
    return [
        (then[now.package], now)
        for now in program.plugins
        if then.get(now.package, now.version) != now.version
    ]


_OF_ARRAYS = ("E0911", "E0912", "E0959")
"""The codes of arrays that are missing, unknown, or of another shape."""


def _of_other_plugins(fault: Diagnostic, changed: Sequence[tuple[str, UsedPlugin]]) -> Diagnostic:
    """A fault of the arrays in a weights file, with the plug-ins that had another version then."""
    if fault.code not in _OF_ARRAYS or not changed:
        return fault
    notes = [
        f"it was trained with {p.package} {then}, and {p.version} is installed"
        for then, p in changed
    ]
    then, first = changed[0]
    repair = f"install {first.package} {then}, or train again with {first.version}"
    return replace(fault, notes=(*fault.notes, *notes), help=repair)


_ROUNDING = float(np.finfo(np.float32).eps)

GIVEN = "the given mapping of weights"
"""Origin of weights in messages if they are not from a file."""


def checked_weights(
    program: Program, arrays: Mapping[str, NDArray[Any]], origin: str
) -> dict[str, FloatArray]:
    """The arrays as weights in float64, checked: one for each parameter, with its shape and bounds.

    `origin` names them in messages. Raises SpecError with all errors.
    """
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
        # a cast would take bits, texts and complex numbers without a word
        elif not np.issubdtype(array.dtype, np.floating):
            faults.append(errors.weights_not_floating(origin, name, str(array.dtype)))
        else:
            found[name] = array.astype(np.float64)
    wild = [name for name, array in found.items() if not np.all(np.isfinite(array))]
    if wild:
        faults.append(errors.weights_not_finite(origin, wild))
    for parameter in program.parameters:
        outside = _outside(parameter, found.get(parameter.name))
        if outside is not None:
            faults.append(errors.weights_outside_bounds(origin, parameter, outside))
    if faults:
        raise SpecError(faults)
    return found


def _outside(parameter: Parameter, array: FloatArray | None) -> float | None:
    """The value that is furthest outside the bounds of its parameter; None if all are inside."""
    low = -np.inf if parameter.minimum is None else parameter.minimum
    high = np.inf if parameter.maximum is None else parameter.maximum
    if array is None or not array.size or not np.all(np.isfinite(array)):
        return None
    beyond = np.maximum(low - array, array - high)
    worst = np.unravel_index(np.argmax(beyond), beyond.shape)
    # a bound that single precision rounded may lie outside itself
    nearest = np.clip(array[worst], low, high)
    return float(array[worst]) if beyond[worst] > _ROUNDING * abs(nearest) else None


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
    """Converts weights of any accepted form to an array in float64 for every parameter (rule R12).

    The forms are a path, a mapping of arrays or tensors, and a result of `train`. Missing or
    unknown names, wrong shapes and values that are not finite real numbers are raised together as
    SpecError. TypeError for an object of another kind.
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
    """The given weights, checked; by default the initial values of the spec.

    Raises SpecError if they do not fit, or if an initial value is unknown before training (R12).
    """
    if weights is not None:
        return given_weights(program, weights)
    unknown = [p for p in program.parameters if p.statistic is not None]
    if unknown:
        names = [parameter.name for parameter in unknown]
        raise SpecError((training_errors.unknown_statistics(names, unknown[0].span),))
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
