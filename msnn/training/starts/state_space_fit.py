"""Fits the arrays of a `state_space` layer with given poles, by least squares of its outputs.

With A and B known, the outputs are linear in C, D and the initial state; with A and C known, in B,
D and the initial state. Alternating both ends near the minimum error, which suffices for an initial
point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.training.starts.lattice import lattice_of
from msnn.training.starts.linear_fit import FORGOTTEN
from msnn.training.starts.linear_system import ROWS_AT_ONCE, LinearSystem, Triangle, least_squares


@dataclass(frozen=True, slots=True)
class RowsWithoutGap:
    """Inputs and outputs at consecutive rows: (rows, inputs) and (rows, outputs)."""

    inputs: FloatArray
    outputs: FloatArray


@dataclass(frozen=True, slots=True)
class StateSpaceArrays:
    """The arrays of the layer: A is `radius` times the lattice of `reflection`."""

    reflection: FloatArray
    drive: FloatArray
    """B: (order, inputs)."""
    read: FloatArray
    """C: (outputs, order)."""
    direct: FloatArray
    """D: (outputs, inputs), 0 without feedthrough."""


def driven_by_all(reflection: FloatArray, inputs: int) -> FloatArray:
    """B by which each input drives the lattice like its own input, so that states have its
    scale.
    """
    return np.repeat(lattice_of(reflection).drive[:, None], inputs, axis=1)


def with_read(
    series: Sequence[RowsWithoutGap],
    reflection: FloatArray,
    drive: FloatArray,
    *,
    radius: float,
    feedthrough: bool,
) -> StateSpaceArrays:
    """The arrays of the layer for given A and B; C and D are computed by least squares."""
    matrix = radius * lattice_of(reflection).matrix
    system = LinearSystem(matrix, drive)
    order, inputs = drive.shape
    outputs = series[0].outputs.shape[1]
    known = order + (inputs if feedthrough else 0)
    triangle = Triangle(known + outputs)
    for each in series:
        head = Triangle(order + known + outputs)
        state, past = np.zeros(order), _cyclic(reflection)
        for begin in range(0, len(each.inputs), ROWS_AT_ONCE):
            u = each.inputs[begin : begin + ROWS_AT_ONCE]
            x = system.states(u, state)
            state = x[-1]
            direct = [u] if feedthrough else []
            y = each.outputs[begin : begin + ROWS_AT_ONCE]
            # x of each row beside its u and y; the last x belongs to the next part
            table = np.concatenate([x[:-1], *direct, y], axis=1)
            if begin == 0 or np.max(np.abs(past)) > FORGOTTEN:
                free = system.states(np.zeros_like(u), past)
                head.add(np.concatenate((free[:-1], table), axis=1))
                past = free[-1]
            else:
                triangle.add(table)
        triangle.add(head.below(order))
    found = least_squares(*np.split(triangle.below(0), [known], axis=1)).T
    direct = found[:, order:] if feedthrough else np.zeros((outputs, inputs))
    return StateSpaceArrays(reflection, drive, found[:, :order], direct)


def with_drive(
    series: Sequence[RowsWithoutGap],
    reflection: FloatArray,
    read: FloatArray,
    *,
    radius: float,
    feedthrough: bool,
) -> StateSpaceArrays:
    """The arrays of the layer for given A and C; B and D are computed by least squares.

    C Aᵗ B is Bᵀ (Aᵀ)ᵗ Cᵀ: an output is B times the states of the transposed system driven by Cᵀ.
    """
    matrix = radius * lattice_of(reflection).matrix
    outputs, order = read.shape
    inputs = series[0].inputs.shape[1]
    # B, one input after the other, then D, one output after the other
    known = order * inputs + (outputs * inputs if feedthrough else 0)
    triangle = Triangle(known + 1)
    systems = [LinearSystem(matrix.T, row[:, None]) for row in read]
    for each in series:
        head = Triangle(order + known + 1)
        states = np.zeros((outputs, inputs, order))
        past = read.copy()
        for begin in range(0, len(each.inputs), ROWS_AT_ONCE):
            u = each.inputs[begin : begin + ROWS_AT_ONCE]
            remembered = begin == 0 or bool(np.max(np.abs(past)) > FORGOTTEN)
            for k, system in enumerate(systems):
                table = np.zeros((len(u), order + known + 1))
                for j in range(inputs):
                    x = system.states(u[:, j : j + 1], states[k, j])
                    states[k, j] = x[-1]
                    table[:, order * (1 + j) : order * (2 + j)] = x[:-1]
                if feedthrough:
                    first = order * (1 + inputs) + k * inputs
                    table[:, first : first + inputs] = u
                table[:, -1] = each.outputs[begin : begin + ROWS_AT_ONCE, k]
                if remembered:
                    # the state at the first row is one for all outputs, each of which reads it by
                    # its row of C
                    free = system.states(np.zeros((len(u), 1)), past[k])
                    table[:, :order], past[k] = free[:-1], free[-1]
                    head.add(table)
                else:
                    triangle.add(table[:, order:])
        triangle.add(head.below(order))
    found = least_squares(triangle.below(0)[:, :-1], triangle.below(0)[:, -1])
    drive = found[: order * inputs].reshape(inputs, order).T
    direct = found[order * inputs :].reshape(-1, inputs) if feedthrough else None
    unread = np.zeros((outputs, inputs))
    return StateSpaceArrays(reflection, drive, read, unread if direct is None else direct)


def _cyclic(reflection: FloatArray) -> FloatArray:
    """A state whose elements generate every free response of the lattice."""
    return lattice_of(reflection).drive
