"""Fits a stable linear system with several inputs or outputs by subspace identification.

Method: PO-MOESP (Verhaegen, Automatica 30, 1994). The part of the outputs that past rows explain
and the inputs do not spans the responses of the states. Poles and outputs of the states follow from
it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.training.starts.lattice import ComplexArray, lattice_of, reflections_of, stable
from msnn.training.starts.linear_fit import size_of
from msnn.training.starts.linear_system import ROWS_AT_ONCE, Triangle, least_squares
from msnn.training.starts.state_space_fit import (
    RowsWithoutGap,
    StateSpaceArrays,
    driven_by_all,
    with_drive,
    with_read,
)


def fitted_system(
    series: Sequence[RowsWithoutGap], order: int, *, radius: float, feedthrough: bool
) -> StateSpaceArrays | None:
    """The arrays of a `state_space` layer near the minimum output error; None if there are too few
    rows.
    """
    inputs, outputs = series[0].inputs.shape[1], series[0].outputs.shape[1]
    depth = _depth(series, order, inputs + outputs, outputs)
    if depth is None:
        return None
    gains = _sizes([each.inputs for each in series]), _sizes([each.outputs for each in series])
    scaled = [RowsWithoutGap(each.inputs / gains[0], each.outputs / gains[1]) for each in series]
    poles, read = _poles_and_read(scaled, order, depth, radius)
    reflection = reflections_of(poles / radius)
    found = with_drive(scaled, reflection, read, radius=radius, feedthrough=feedthrough)
    # a drive of 0 would leave no state to be read
    drive = found.drive if np.any(found.drive) else driven_by_all(reflection, inputs)
    found = with_read(scaled, reflection, drive, radius=radius, feedthrough=feedthrough)
    return replace(
        found,
        drive=found.drive / gains[0],
        read=found.read * gains[1][:, None],
        direct=found.direct * gains[1][:, None] / gains[0],
    )


def _sizes(parts: Sequence[FloatArray]) -> FloatArray:
    return np.array([size_of([part[:, i] for part in parts]) for i in range(parts[0].shape[1])])


def _depth(series: Sequence[RowsWithoutGap], order: int, signals: int, outputs: int) -> int | None:
    """Number of past and future rows per window; None if there are too few rows."""
    # all rows of responses but the last have to hold the order, as A follows from these
    least = -(-order // outputs) + 1
    # half as many again where there are enough rows
    for depth in range(least + -(-least // 2), least - 1, -1):
        windows = sum(max(len(each.inputs) - 2 * depth + 1, 0) for each in series)
        # as many windows as the table has columns
        if windows >= 2 * depth * signals:
            return depth
    return None


def _poles_and_read(
    series: Sequence[RowsWithoutGap], order: int, depth: int, radius: float
) -> tuple[ComplexArray, FloatArray]:
    """The poles, and C in the coordinates of the lattice with these poles."""
    outputs = series[0].outputs.shape[1]
    responses = _responses(series, order, depth)
    read = responses[:outputs]
    # the responses one row later are these times A
    matrix = least_squares(responses[:-outputs], responses[outputs:])
    values, vectors = np.linalg.eig(matrix)
    poles = stable(np.asarray(values, complex), radius)
    lattice = radius * lattice_of(reflections_of(poles / radius)).matrix
    modes = np.stack([_mode(lattice, pole) for pole in poles], axis=1)
    # C V of both is the same, and V of the lattice is known
    turned = np.linalg.lstsq(modes.T, (read @ vectors).T, rcond=None)[0].T
    return poles, np.asarray(np.real(turned), dtype=np.float64)


def _mode(matrix: FloatArray, pole: complex) -> ComplexArray:
    """The unit eigenvector of a pole, by inverse iteration."""
    order = len(matrix)
    # a little beside the pole, where the matrix would be singular
    shifted = matrix - (pole + 1e-10 * (1 + abs(pole))) * np.eye(order)
    vector = np.linspace(1.0, 2.0, order).astype(np.complex128)
    for _ in range(3):
        turned = np.asarray(np.linalg.solve(shifted, vector), np.complex128)
        vector = turned / np.linalg.norm(turned)
    return vector


def _responses(series: Sequence[RowsWithoutGap], order: int, depth: int) -> FloatArray:
    """The extended observability matrix: C, C A, C A² … stacked, in some coordinates of the
    state.
    """
    inputs, outputs = series[0].inputs.shape[1], series[0].outputs.shape[1]
    explained, before = depth * inputs, depth * (inputs + outputs)
    triangle = Triangle(explained + before + depth * outputs)
    for each in series:
        windows = len(each.inputs) - 2 * depth + 1
        for begin in range(0, windows, ROWS_AT_ONCE):
            stop = min(begin + ROWS_AT_ONCE, windows)
            u, y = (
                [part[begin + lag : stop + lag] for lag in range(2 * depth)]
                for part in (each.inputs, each.outputs)
            )
            # later inputs first: what they explain is then in the rows above
            columns = [*u[depth:], *u[:depth], *y[:depth], *y[depth:]]
            triangle.add(np.concatenate(columns, axis=1))
    # what the rows before say of later outputs
    reached = triangle.below(explained)[:before, before:].T
    left, sizes, _ = np.linalg.svd(reached, full_matrices=False)
    # singular values are shared out between responses and states
    return np.asarray(left[:, :order] * np.sqrt(sizes[:order]), dtype=np.float64)
