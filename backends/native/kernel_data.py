"""Arranges the logs in the memory layout of a kernel."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backends.files.disk_arrays import blocks, laid_out
from backends.native.kernel_source import KernelSource
from backends.native.kernel_structs import ProblemStruct, pointers

FloatArray = NDArray[np.float64]


class KernelData:
    """Series and masks of scored rows, kept alive for the kernel's pointers."""

    def __init__(
        self,
        source: KernelSource,
        dtype: np.dtype[Any],
        series: Mapping[str, FloatArray],
        skip: int,
        scored: Mapping[str, NDArray[np.bool_]] | None,
    ) -> None:
        self._names = source.signals
        self._series = [laid_out(series[name], dtype) for name in self._names]
        self._scored: list[NDArray[np.uint8]] = []
        gaps = any(bool(np.isnan(part).any()) for s in self._series for part in blocks(s))
        self.missing = scored is not None or source.has_factors or gaps
        table = None
        if scored is not None:
            self._scored = [np.ascontiguousarray(scored[name], np.uint8) for name in source.losses]
            table = pointers(self._scored)
        self._tables = (pointers(self._series), table)
        rows = len(self._series[0]) if self._series else 0
        self.problem = ProblemStruct(
            ctypes.cast(self._tables[0], ctypes.c_void_p),
            rows,
            None if table is None else ctypes.cast(table, ctypes.c_void_p),
            skip,
        )

    def write(self, series: Mapping[str, FloatArray]) -> None:
        """Replaces values of the series that the kernel reads; these must not be shared with
        other objects.
        """
        for name, values in series.items():
            if name in self._names:
                self._series[self._names.index(name)][...] = values
