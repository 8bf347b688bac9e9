"""Specs of several files: written to a folder, compiled and run, for tests of sub-models."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from textwrap import dedent

import numpy as np
from numpy.typing import ArrayLike, NDArray

from backends.files.safetensors_bytes import safetensors_bytes
from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Program
from msnn.model.load import load_model
from msnn.model.model import Model
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError

Array = NDArray[np.float64]


def model_of(folder: Path, text: str, **parts: str) -> Model:
    """The model in `text`, which uses `NAME.yaml` for each part; heads need not be written."""
    for name, part in parts.items():
        (folder / f"{name}.yaml").write_text(headed(name, part))
    (folder / "main.yaml").write_text(headed("main", text))
    return load_model(folder / "main.yaml")


def headed(name: str, text: str) -> str:
    """A whole spec with a sample time of 0.1 s where it has none."""
    body = dedent(text)
    time = "" if "sample_time" in body else "sample_time: 0.1 s\n"
    return f"msnn: 1\nname: {name}\n{time}{body}"


def diagnostics(folder: Path, text: str, **parts: str) -> list[Diagnostic]:
    """What is said about the model, errors and warnings."""
    try:
        return list(model_of(folder, text, **parts).warnings)
    except SpecError as error:
        return list(error.diagnostics)


def write_weights(file: Path, arrays: Mapping[str, ArrayLike], **metadata: str) -> None:
    """A safetensors file."""
    values = {name: np.asarray(array, dtype=np.float64) for name, array in arrays.items()}
    file.write_bytes(safetensors_bytes(values, metadata))


def run(
    program: Program,
    log: Mapping[str, ArrayLike],
    t0: int = 0,
    steps: int = 1,
    weights: Mapping[str, ArrayLike] | None = None,
    output: str = "y",
) -> Array:
    """An output over a run of the states that starts at row t0."""
    series = {name: np.asarray(values, dtype=float) for name, values in log.items()}
    found = Interpreter(program, weights).rollout(series, np.array([t0]), steps)
    return found.outputs[output][0]


def names(program: Program) -> dict[str, list[str]]:
    """What the program has, by kind."""
    return {
        "signals": [signal.name for signal in program.signals],
        "parameters": [parameter.name for parameter in program.parameters],
        "states": [state.name for state in program.states],
        "outputs": [output.name for output in program.outputs],
        "dims": [dimension.name for dimension in program.dimensions],
    }
