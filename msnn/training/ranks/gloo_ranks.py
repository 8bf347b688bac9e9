"""Connects the processes started by torchrun to one training, with gloo."""

from __future__ import annotations

import atexit
import hashlib
from collections.abc import Generator, Sequence
from contextlib import contextmanager, suppress
from datetime import timedelta

import numpy as np
import torch
import torch.distributed as gloo
from numpy.typing import NDArray
from torch.distributed.rendezvous import rendezvous

from msnn.training.ranks.training_ranks import RankLostError

PATIENCE = timedelta(minutes=10)
"""Maximum lag of a process behind the others before it counts as lost."""

_SPEAKER = "msnn speaker"

_LAST_QUESTIONS = timedelta(seconds=10)
"""Time that the process with the store waits for the others to ask who reports."""


class GlooRanks:
    """The processes of one training, which exchange bytes by gloo, a library that torch contains.

    All methods that communicate raise RankLostError if a process is lost.
    """

    def __init__(self) -> None:
        with _reached():
            self._store, self.rank, self.count = next(rendezvous("env://", timeout=PATIENCE))
            gloo.init_process_group(
                "gloo",
                store=self._store,
                rank=self.rank,
                world_size=self.count,
                timeout=PATIENCE,
            )
        # threads of gloo drop the tensors of an exchange after it has returned: one that waits for
        # Python's lock to do so while Python ends aborts the process (pytorch/pytorch#179291)
        atexit.register(gloo.destroy_process_group)

    @property
    def is_first(self) -> bool:
        """True if this process writes the run and shows progress."""
        return self.rank == 0

    def receive(self, sums: NDArray[np.uint8]) -> None:
        """Receives the sums of the previous rank into `sums`; the first rank keeps its own."""
        # sums go through ranks in a row: added in one order, they have the same bits for any number
        if self.rank:
            with _reached():
                gloo.recv(torch.from_numpy(sums), self.rank - 1)

    def hand_on(self, sums: NDArray[np.uint8]) -> None:
        """Sends `sums` to the next rank; then replaces them by those of the last rank, which has
        all.
        """
        last = self.count - 1
        with _reached():
            # the last has all sums, and tells them to everybody
            if self.rank < last:
                gloo.send(torch.from_numpy(sums), self.rank + 1)
            gloo.broadcast(torch.from_numpy(sums), last)

    def most(self, values: Sequence[float]) -> list[float]:
        """The maximum of each value over all ranks."""
        found = torch.tensor(values, dtype=torch.float64)
        with _reached():
            gloo.all_reduce(found, gloo.ReduceOp.MAX)
        return found.tolist()

    def agree(self, content: bytes) -> bool:
        """True if all ranks called this with the same content; each gets the same answer."""
        digest = hashlib.sha256(content).digest()
        # 48 bits, which float64 holds exactly; the most of −x is the least of x
        number = float(int.from_bytes(digest[:6]))
        most, least = self.most((number, -number))
        return most == -least

    def from_first(self, content: bytes) -> bytes:
        """The content of the first rank; the content of the other ranks is ignored."""
        size = torch.tensor([len(content)])
        with _reached():
            gloo.broadcast(size, 0)
            found = torch.zeros(int(size), dtype=torch.uint8)
            if self.is_first and content:
                found.copy_(torch.frombuffer(bytearray(content), dtype=torch.uint8))
            # gloo refuses tensors without elements
            if len(found):
                gloo.broadcast(found, 0)
        return found.numpy().tobytes()

    def is_speaker(self) -> bool:
        """True for the one process that reports to the user why the training ends."""
        try:
            said = self._store.compare_set(_SPEAKER, "", str(self.rank))
            self._store.set(f"{_SPEAKER} {self.rank}", "has asked")
        except RuntimeError:  # the process that has the store is lost too
            return True
        if self.is_first:
            # the store ends with this process: a later question would fail as if it were lost
            atexit.register(self._answer_the_others)
        return said.decode() == str(self.rank)

    def _answer_the_others(self) -> None:
        asked = [f"{_SPEAKER} {rank}" for rank in range(self.count)]
        with suppress(RuntimeError):  # one that is lost never asks
            self._store.wait(asked, _LAST_QUESTIONS)


@contextmanager
def _reached() -> Generator[None]:
    try:
        yield
    except RuntimeError as error:
        # the lines behind are a stack of C++
        raise RankLostError(str(error).partition("\n")[0]) from error
