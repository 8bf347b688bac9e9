"""Says what the processes of one training do together, beside adding their sums."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from msnn.data.dataset import FloatArray


class RankLostError(Exception):
    """Another process of the training has ended or cannot be reached."""


class TrainingRanks(Protocol):
    """The processes of one training, as kernels know them (`backends.native.handed_sums.Ranks`).

    Whatever they do together raises RankLostError.
    """

    @property
    def rank(self) -> int:
        """The number of this rank, from 0."""
        ...

    @property
    def count(self) -> int:
        """The number of ranks."""
        ...

    def receive(self, sums: NDArray[np.uint8]) -> None:
        """Replaces sums by those of the rank before; the first one keeps its own."""
        ...

    def hand_on(self, sums: NDArray[np.uint8]) -> None:
        """Gives sums to the next rank and replaces them by those of the last."""
        ...

    @property
    def is_first(self) -> bool:
        """Whether this process keeps the run and says how it goes."""
        ...

    def most(self, values: Sequence[float]) -> list[float]:
        """The largest of each value over all ranks."""
        ...

    def agree(self, content: bytes) -> bool:
        """Whether all ranks have the same content; the answer is the same on each."""
        ...

    def from_first(self, content: bytes) -> bytes:
        """The content that the first rank has; that of the others is not looked at."""
        ...


def weights_of_first(
    ranks: TrainingRanks | None, weights: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """Weights with the bits that they have on the first rank: fits depend on the processor."""
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
    """The bits of weights, to compare them between ranks."""
    return b"".join(np.ascontiguousarray(value).tobytes() for value in weights.values())
