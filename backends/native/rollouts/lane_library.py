"""Loads a compiled kernel that runs rollouts on lanes, in float64."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from backends.native.compile_kernel import compiled_kernel
from backends.native.kernel_data import KernelData
from backends.native.kernel_source import KernelSource
from backends.native.kernel_structs import aligned
from backends.native.lanes.lane_groups import LANES

DTYPE = np.dtype(np.float64)
WIDTH = LANES["float64"]
"""Rollouts per group."""


class LaneLibrary:
    """A compiled kernel, with the memory and logs for its functions.

    Raises CompilerMissingError.
    """

    def __init__(self, source: KernelSource) -> None:
        self.source, self.dtype, self.lanes = source, DTYPE, WIDTH
        self.built = compiled_kernel(source.text, on_lanes=True)
        self._library = self.built.library
        # ctypes assumes int, but long rollouts need more than 2 GiB
        self._library.msnn_work_lanes.restype = ctypes.c_int64
        self._library.msnn_work_lanes.argtypes = [ctypes.c_int64]

    def data(
        self,
        series: Mapping[str, NDArray[np.float64]],
        skip: int = 0,
        scored: Mapping[str, NDArray[np.bool_]] | None = None,
    ) -> KernelData:
        """The logs in the kernel's layout; `skip` and `scored` affect the losses."""
        return KernelData(self.source, DTYPE, series, skip, scored)

    def _work(self, steps: int) -> NDArray[np.uint8]:
        """Memory for rollouts of at most `steps` steps."""
        return aligned(self._library.msnn_work_lanes(steps) * WIDTH * DTYPE.itemsize)
