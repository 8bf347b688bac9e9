"""Simulates a linear system and solves least squares over many rows in constant memory.

The triangular factor of a QR decomposition contains all information about solutions and errors. The
factor of more rows is that of the previous factor stacked on the new rows (TSQR: Demmel et al.,
SIAM J. Sci. Comput. 34, 2012). Unlike normal equations, nothing is squared.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from msnn.data.dataset import FloatArray

_BLOCK = 32
"""Number of rows per matrix product."""
_AT_ONCE = 1 << 17
"""Number of multiplications up to which BLAS uses one thread."""


@dataclass(frozen=True, slots=True)
class LinearSystem:
    """A stable system x[t+1] = A x[t] + B u[t]."""

    matrix: FloatArray
    """A: (states, states)."""
    drive: FloatArray
    """B: (states, inputs)."""
    _driven: FloatArray = field(init=False, repr=False)
    _free: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        order, inputs = self.drive.shape
        powers = [np.eye(order)]
        for _ in range(_BLOCK):
            powers.append(self.matrix @ powers[-1])
        # driven[s, :, t] is what the input at row s of a block adds to x[t]
        driven = np.zeros((_BLOCK, inputs, _BLOCK + 1, order))
        for s in range(_BLOCK):
            for t in range(s + 1, _BLOCK + 1):
                driven[s, :, t] = (powers[t - 1 - s] @ self.drive).T
        free = np.stack([power.T for power in powers], axis=1)
        shape = (_BLOCK + 1) * order
        object.__setattr__(self, "_driven", driven.reshape(_BLOCK * inputs, shape))
        object.__setattr__(self, "_free", free.reshape(order, shape))

    def states(self, inputs: FloatArray, start: FloatArray) -> FloatArray:
        """x[0] … x[rows], one row each, from `start` with inputs (rows, inputs)."""
        rows, order = len(inputs), len(start)
        blocks = -(-rows // _BLOCK)
        padded = np.zeros((blocks * _BLOCK, inputs.shape[1]))
        padded[:rows] = inputs
        found = _product(padded.reshape(blocks, -1), self._driven)
        starts = np.empty((blocks, order))
        # of the end of each block, with which the next one begins
        ends, reach = found[:, -order:], self._free[:, -order:]
        state = start
        for block in range(blocks):
            starts[block] = state
            state = state @ reach + ends[block]
        found += _product(starts, self._free)
        # the last state of a block is the first of the next one
        within = found.reshape(blocks, _BLOCK + 1, order)[:, :_BLOCK].reshape(-1, order)
        return np.concatenate((within, state[None]))[: rows + 1]


def _product(rows: FloatArray, matrix: FloatArray) -> FloatArray:
    """rows @ matrix, computed in blocks that are small enough for BLAS to use one thread."""
    at_once = max(_AT_ONCE // matrix.size, 1)
    whole = len(rows) // at_once * at_once
    found = np.empty((len(rows), matrix.shape[1]))
    stack = rows[:whole].reshape(-1, at_once, rows.shape[1])
    np.matmul(stack, matrix, out=found[:whole].reshape(-1, at_once, matrix.shape[1]))
    np.matmul(rows[whole:], matrix, out=found[whole:])
    return found


def filtered(signal: FloatArray, denominator: FloatArray) -> FloatArray:
    """The signal filtered by 1/A from rest: y[t] = u[t] − Σ aⱼ y[t−j]."""
    order = len(denominator) - 1
    if not order:
        return signal
    # 1/A in companion form: the states are the last outputs, newest first
    companion = np.eye(order, k=-1)
    companion[0] = -denominator[1:]
    system = LinearSystem(companion, np.eye(order)[:, :1])
    return system.states(signal[:, None], np.zeros(order))[1:, 0]


ROWS_AT_ONCE = 1 << 13
"""Rows per block of a table."""
_NUMBERS_AT_ONCE = 1 << 13
"""Elements per block: small enough for the cache, and for BLAS to use one thread.

BLAS would distribute larger blocks over threads. Their synchronisation takes a hundred times longer
if other processes are busy.
"""


class Triangle:
    """The triangular factor R of a QR decomposition, to which rows are added in blocks."""

    def __init__(self, columns: int) -> None:
        self._found = np.zeros((0, columns))

    def add(self, rows: FloatArray) -> None:
        """Adds any number of rows, (rows, columns), to the decomposition."""
        columns = rows.shape[1]
        # twice the columns at least: less would leave as many rows as there were
        part = max(2 * columns, _NUMBERS_AT_ONCE // columns)
        while len(rows) > part:
            whole = len(rows) // part * part
            parts = _triangles(rows[:whole].reshape(-1, part, columns))
            rows = np.concatenate((parts.reshape(-1, columns), rows[whole:]))
        self._found = _triangles(np.concatenate((self._found, rows)))

    def above(self, columns: int) -> FloatArray:
        """The first `columns` rows of R: the equations that determine the first `columns`
        unknowns.
        """
        return self._found[:columns]

    def below(self, columns: int) -> FloatArray:
        """The other rows of R, without the first `columns` columns: what does not depend on those
        unknowns.
        """
        return self._found[columns:, columns:]


def _triangles(tables: FloatArray) -> FloatArray:
    """The factor R of a QR decomposition, of one table or of each table in a stack."""
    return np.asarray(np.linalg.qr(tables, mode="r"), dtype=np.float64)


def least_squares(columns: FloatArray, wanted: FloatArray) -> FloatArray:
    """The x that minimises |columns · x − wanted|; of several solutions the one with the smallest
    norm.
    """
    return np.asarray(np.linalg.lstsq(columns, wanted, rcond=None)[0], dtype=np.float64)
