"""Adds the sums of several training processes in a fixed order (ranks)."""

from __future__ import annotations

import ctypes
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Sums = NDArray[np.uint8]
"""Bytes of sums, which are replaced in place."""


class Ranks(Protocol):
    """The processes of one training; this process is one of them."""

    @property
    def rank(self) -> int:
        """The index of this process, from 0."""
        ...

    @property
    def count(self) -> int:
        """The number of processes."""
        ...

    def receive(self, sums: Sums) -> None:
        """Replaces sums by those of the previous rank; the first rank keeps its own."""
        ...

    def hand_on(self, sums: Sums) -> None:
        """Sends sums to the next rank and replaces them by those of the last rank."""
        ...


class HandedSums:
    """Calls ranks from inside a kernel; their exceptions are raised after the kernel returns."""

    def __init__(self, ranks: Ranks) -> None:
        self._ranks = ranks
        self._failure: BaseException | None = None
        # a reference keeps the callback alive while C can call it
        self._function = _FUNCTION(self._called)
        self.address = ctypes.cast(self._function, ctypes.c_void_p).value

    def raise_failure(self) -> None:
        """Raises the exception that ended the kernel early, if any."""
        if self._failure is not None:
            failure, self._failure = self._failure, None
            raise failure

    def _called(self, whole: int, address: int, size: int) -> int:
        if self._failure is not None:  # a line search may call again before it ends
            return 0
        sums = np.ctypeslib.as_array((ctypes.c_uint8 * size).from_address(address))
        try:
            if whole:
                self._ranks.hand_on(sums)
            else:
                self._ranks.receive(sums)
        except BaseException as failure:  # noqa: BLE001  (C has no exceptions: it is raised later)
            self._failure = failure
            return 0
        return 1


def added_by(ranks: Ranks, own: NDArray[Any]) -> NDArray[Any]:
    """The sum of an array over all ranks, in their order: bit-identical on each rank."""
    found = np.zeros_like(own)
    ranks.receive(found.reshape(-1).view(np.uint8))
    found += own
    ranks.hand_on(found.reshape(-1).view(np.uint8))
    return found


_FUNCTION = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_int32, ctypes.c_void_p, ctypes.c_int64)
