"""Writes the C files of a state estimator: extended Kalman filter or moving-horizon estimator."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from numpy.typing import ArrayLike

from backends.c_language.literals import Dtype
from backends.files.atomic_write import write_text
from msnn.features.control.backend.estimation import filter_texts
from msnn.features.control.backend.moving_horizon import horizon_texts
from msnn.features.control.problem.state_estimation.problem import EstimationProblem


def write_estimator(
    problem: EstimationProblem,
    weights: Mapping[str, ArrayLike],
    folder: Path,
    *,
    prefix: str,
    dtype: Dtype,
) -> tuple[Path, ...]:
    """Writes header, sources and description of an estimator into a folder; returns their paths.

    An extended Kalman filter has `include/<prefix>_ekf.h` and `src/<prefix>_ekf*.c`. Files of a
    moving-horizon estimator, a problem with a window, are named `<prefix>_mhe*`.
    """
    texts = filter_texts if problem.window is None else horizon_texts
    written = texts(problem, weights, prefix, dtype).items()
    return tuple(write_text(folder / name, text) for name, text in written)
