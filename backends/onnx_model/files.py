"""Writes a program's ONNX models to a folder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import ArrayLike, DTypeLike

from backends.files.atomic_write import write_bytes, write_text
from backends.files.readme import one_line, readme_text
from backends.onnx_model.model import build_initial_state, build_model, build_rollout
from compiler.ir.program import Program


def write_onnx(
    program: Program,
    weights: Mapping[str, ArrayLike] | None,
    folder: Path,
    prefix: str,
    dtype: DTypeLike = np.float64,
) -> tuple[Path, ...]:
    """Writes the ONNX models of a program in step form; returns the paths.

    The files are `<prefix>.onnx`, `<prefix>_rollout.onnx`, a README `<prefix>_onnx.md`, and for a
    program with states `<prefix>_initial_state.onnx`. `weights` or the initial values become
    initialisers. Raises OSError if the folder is not writable, ValueError for a dtype other than
    float32 and float64 or a weight of a wrong shape.
    """
    models = {
        f"{prefix}.onnx": build_model(program, weights, dtype),
        f"{prefix}_rollout.onnx": build_rollout(program, weights, dtype),
    }
    # runtimes refuse a model without results
    if program.states:
        models[f"{prefix}_initial_state.onnx"] = build_initial_state(program, weights, dtype)
    readme = readme_text(
        "onnx",
        model=one_line(program.name),
        prefix=prefix,
        precision=np.dtype(dtype).name,
        has_states=bool(program.states),
    )
    written = [write_bytes(folder / name, _bytes(model)) for name, model in models.items()]
    return (*written, write_text(folder / f"{prefix}_onnx.md", readme))


def _bytes(model: onnx.ModelProto) -> bytes:
    # otherwise protobuf may write maps in any order
    return model.SerializeToString(deterministic=True)
