"""Compiles specs with robots and reads what they compute, for tests."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from textwrap import dedent

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.program import Program
from msnn.model.load import load_model
from msnn.model.model import Model

Array = NDArray[np.float64]

HERE = Path(__file__).parent
URDF = HERE / "urdf"
Z1 = HERE.parents[2] / "examples" / "z1_friction" / "z1.urdf"


def model_of(folder: Path, text: str) -> Model:
    """The model of a spec in a folder; its head need not be written."""
    path = folder / "robot.msnn.yaml"
    head = "msnn: 1\nname: robot\nsample_time: 10 ms\n"
    path.write_text(head + dedent(text), encoding="utf-8")
    return load_model(path)


def outputs_at(
    program: Program,
    log: Mapping[str, ArrayLike],
    weights: Mapping[str, ArrayLike] | None = None,
) -> dict[str, Array]:
    """Every output at every row of a log."""
    interpreter = Interpreter(program, weights)
    series = {name: np.asarray(values, dtype=float) for name, values in log.items()}
    rows = np.arange(len(next(iter(series.values()))))
    return dict(interpreter.step(series, rows, interpreter.start(series, rows)).outputs)
