"""Defines the communication between the processes of one training."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from msnn.data.dataset import FloatArray


class RankLostError(Exception):
    """Another process of the training has ended or cannot be reached."""


class TrainingRanks(Protocol):
    """The processes that share one training; kernels call it too (`backends.native.kernel.Ranks`).

    All methods that communicate raise RankLostError if a process is lost.
    """

    @property
    def rank(self) -> int:
        """The index of this rank, from 0."""
        ...

    @property
    def count(self) -> int:
        """The number of ranks."""
        ...

    def receive(self, sums: NDArray[np.uint8]) -> None:
        """Receives the sums of the previous rank into `sums`; the first rank keeps its own."""
        ...

    def hand_on(self, sums: NDArray[np.uint8]) -> None:
        """Sends `sums` to the next rank; then replaces them by those of the last rank, which has
        all.
        """
        ...

    @property
    def is_first(self) -> bool:
        """True if this process writes the run and shows progress."""
        ...

    def most(self, values: Sequence[float]) -> list[float]:
        """The maximum of each value over all ranks."""
        ...

    def agree(self, content: bytes) -> bool:
        """True if all ranks called this with the same content; each gets the same answer."""
        ...

    def from_first(self, content: bytes) -> bytes:
        """The content of the first rank; the content of the other ranks is ignored."""
        ...


def weights_of_first(
    ranks: TrainingRanks | None, weights: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """The weights of rank 0, sent to all ranks: fitted initial weights depend on the processor."""
    if ranks is None:
        return dict(weights)
    flat = np.frombuffer(ranks.from_first(weight_bytes(weights)), float)
    ends = np.cumsum([np.size(value) for value in weights.values()])
    parts = np.split(flat, ends[:-1])
    return {
        name: part.reshape(np.shape(value)).copy()
        for (name, value), part in zip(weights.items(), parts, strict=True)
    }


def weight_bytes(weights: Mapping[str, FloatArray]) -> bytes:
    """The bytes of weights, to compare them between ranks."""
    return b"".join(np.ascontiguousarray(value).tobytes() for value in weights.values())
