"""Solves least squares with many rows in constant memory.

The triangular factor of a QR decomposition contains all information about solutions and errors. The
factor of more rows is that of the previous factor stacked on the new rows (TSQR: Demmel et al.,
SIAM J. Sci. Comput. 34, 2012). Unlike normal equations, nothing is squared.
"""

from __future__ import annotations

import numpy as np

from msnn.data.dataset import FloatArray

ROWS_AT_ONCE = 1 << 13
"""Rows per block of a table."""
_NUMBERS_AT_ONCE = 1 << 13
"""Elements per block: small enough for the cache, and for BLAS to use one thread.

BLAS would distribute larger blocks over threads. Their synchronisation takes a hundred times longer
if other processes are busy.
"""


class Triangle:
    """R of the QR decomposition of all added rows."""

    def __init__(self, columns: int) -> None:
        self._found = np.zeros((0, columns))

    def add(self, rows: FloatArray) -> None:
        """Adds any number of rows."""
        columns = rows.shape[1]
        # twice the columns at least: less would leave as many rows as there were
        part = max(2 * columns, _NUMBERS_AT_ONCE // columns)
        while len(rows) > part:
            whole = len(rows) // part * part
            parts = _triangles(rows[:whole].reshape(-1, part, columns))
            rows = np.concatenate((parts.reshape(-1, columns), rows[whole:]))
        self._found = _triangles(np.concatenate((self._found, rows)))

    def above(self, columns: int) -> FloatArray:
        """Rows of R explained by the first `columns`."""
        return self._found[:columns]

    def below(self, columns: int) -> FloatArray:
        """Rows of R not explained by the first `columns`, independent of their coefficients."""
        return self._found[columns:, columns:]


def _triangles(tables: FloatArray) -> FloatArray:
    """R of one table, or of each table in a stack."""
    return np.asarray(np.linalg.qr(tables, mode="r"), dtype=np.float64)


def least_squares(columns: FloatArray, wanted: FloatArray) -> FloatArray:
    """The least-squares solution; with several solutions the one with the smallest norm."""
    return np.asarray(np.linalg.lstsq(columns, wanted, rcond=None)[0], dtype=np.float64)
