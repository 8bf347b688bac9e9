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


class Triangle:
    """R of the QR decomposition of all rows that were added."""

    def __init__(self, columns: int) -> None:
        self._found = np.zeros((0, columns))

    def add(self, rows: FloatArray) -> None:
        """More rows, of any number."""
        table = np.concatenate((self._found, rows))
        self._found = np.asarray(np.linalg.qr(table, mode="r"), dtype=np.float64)

    def above(self, columns: int) -> FloatArray:
        """Rows of what the first `columns` explain."""
        return self._found[:columns]

    def below(self, columns: int) -> FloatArray:
        """Rows of what the first `columns` do not explain, whatever multiples of them are taken."""
        return self._found[columns:, columns:]


def least_squares(columns: FloatArray, wanted: FloatArray) -> FloatArray:
    """The solution of least squares; of many the smallest."""
    return np.asarray(np.linalg.lstsq(columns, wanted, rcond=None)[0], dtype=np.float64)
