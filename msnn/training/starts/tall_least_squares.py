"""Solves least squares of many rows in memory that does not grow with them.

The triangle of a QR decomposition holds all that the rows say about solutions and errors. That of
more rows is the one of the triangle before with the new rows below it (TSQR: Demmel et al., SIAM J.
Sci. Comput. 34, 2012), so that nothing is squared as in normal equations.
"""

from __future__ import annotations

import numpy as np

from msnn.data.dataset import FloatArray

ROWS_AT_ONCE = 1 << 13
"""Of a table whose triangle is taken."""
_NUMBERS_AT_ONCE = 1 << 13
"""Of a part whose triangle is taken: they stay in the cache, and BLAS computes them itself.

It would share larger ones among threads, whose waiting for each other takes a hundred times the
time of the computing where other processes are at work.
"""


class Triangle:
    """R of the QR decomposition of all rows that were added."""

    def __init__(self, columns: int) -> None:
        self._found = np.zeros((0, columns))

    def add(self, rows: FloatArray) -> None:
        """More rows, of any number."""
        columns = rows.shape[1]
        # twice the columns at least: less would leave as many rows as there were
        part = max(2 * columns, _NUMBERS_AT_ONCE // columns)
        while len(rows) > part:
            whole = len(rows) // part * part
            parts = _triangles(rows[:whole].reshape(-1, part, columns))
            rows = np.concatenate((parts.reshape(-1, columns), rows[whole:]))
        self._found = _triangles(np.concatenate((self._found, rows)))

    def above(self, columns: int) -> FloatArray:
        """Rows of what the first `columns` explain."""
        return self._found[:columns]

    def below(self, columns: int) -> FloatArray:
        """Rows of what the first `columns` do not explain, whatever multiples of them are taken."""
        return self._found[columns:, columns:]


def _triangles(tables: FloatArray) -> FloatArray:
    """R of one table, or of each of a stack."""
    return np.asarray(np.linalg.qr(tables, mode="r"), dtype=np.float64)


def least_squares(columns: FloatArray, wanted: FloatArray) -> FloatArray:
    """The solution of least squares; of many the smallest."""
    return np.asarray(np.linalg.lstsq(columns, wanted, rcond=None)[0], dtype=np.float64)
