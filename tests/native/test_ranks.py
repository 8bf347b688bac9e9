"""Ranks share a batch: the same bits for any number of them, as they add one after the other."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from queue import Queue
from typing import TypeVar

import numpy as np
import pytest
from numpy.typing import NDArray

from backends.c_language.literals import Dtype
from backends.native.kernel import Kernel, Ranks, Sums, added_by
from backends.native.variables import Method, Rule
from compiler.ir.program import Program
from tests.conditions import require_tool
from tests.native.test_kernel import initial, log_of
from tests.native.test_threads import model

Found = TypeVar("Found")


@pytest.fixture(autouse=True)
def _compiler() -> None:
    require_tool("gcc", install="apt install gcc")


@dataclass(frozen=True)
class ThreadRanks:
    """Ranks that are threads of one process."""

    rank: int
    count: int
    queues: list[Queue[bytes]]

    def receive(self, sums: Sums) -> None:
        if self.rank:
            sums[:] = np.frombuffer(self.queues[self.rank].get(timeout=60), np.uint8)

    def hand_on(self, sums: Sums) -> None:
        if self.rank + 1 < self.count:
            self.queues[self.rank + 1].put(sums.tobytes())
            sums[:] = np.frombuffer(self.queues[self.rank].get(timeout=60), np.uint8)
        else:
            for queue in self.queues[:-1]:
                queue.put(sums.tobytes())


def on_ranks(count: int, work: Callable[[Ranks | None], Found]) -> list[Found]:
    """What every rank finds."""
    queues: list[Queue[bytes]] = [Queue() for _ in range(count)]
    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(lambda rank: work(ThreadRanks(rank, count, queues)), range(count)))


def trained(program: Program, dtype: Dtype, ranks: Ranks | None) -> tuple[NDArray[np.float64], ...]:
    """Losses and raw variables after two epochs of batches of 300 and 200 rollouts."""
    log = log_of(program, rows=600)
    kernel = Kernel(program, dtype)
    rates = {parameter.name: 0.01 for parameter in program.parameters}
    variables = kernel.variables(
        Rule(method=Method.ADAM, beta1=0.9, beta2=0.999, epsilon=1e-8), initial(program), rates
    )
    t0 = np.arange(10, 510)
    steps = 3 + t0 % 5
    groups, bounds = kernel.batches(t0, steps, 300)
    data = kernel.data(log)
    weights = [1.0] * len(program.losses)
    found = [kernel.train(data, groups, bounds, variables, weights, ranks=ranks) for _ in range(2)]
    assert [done for done, _, _ in found] == [2, 2]
    every = kernel.groups(t0, steps)
    last = kernel.losses(data, every, variables.physical, weights, ranks=ranks)
    counts = (sums for one in found for sums in one[1:])
    return (*counts, variables.arrays["raw"], last.sums, last.counts, last.gradient)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("name", ["fir", "vehicle"])
def test_any_number_of_ranks_gives_the_bits_of_one_process(name: str, dtype: Dtype) -> None:
    program = model(name)
    alone = trained(program, dtype, None)
    for count in (2, 3, 40):  # with 40 some have no block
        for found in on_ranks(count, lambda ranks: trained(program, dtype, ranks)):
            for ours, one in zip(found, alone, strict=True):
                np.testing.assert_array_equal(ours, one)


def test_a_rank_that_is_lost_ends_the_call_before_anything_moves() -> None:
    class Lost(ThreadRanks):
        def hand_on(self, sums: Sums) -> None:
            raise ConnectionError

    program = model("fir")
    kernel = Kernel(program, "float32")
    variables = kernel.variables(
        Rule(method=Method.SGD, beta1=0.0), initial(program), {"h.weight": 0.1}
    )
    before = variables.arrays["raw"].copy()
    groups, bounds = kernel.batches(np.arange(10, 74), 3, 64)
    data = kernel.data(log_of(program, rows=200))
    with pytest.raises(ConnectionError):
        kernel.train(data, groups, bounds, variables, [1.0], ranks=Lost(0, 2, []))
    np.testing.assert_array_equal(variables.arrays["raw"], before)
    done, _, _ = kernel.train(data, groups, bounds, variables, [1.0])
    assert done == 1


def test_an_array_is_added_in_the_order_of_the_ranks() -> None:
    parts = np.random.default_rng(1).normal(size=(5, 7))

    def added(ranks: Ranks | None) -> NDArray[np.float64]:
        assert ranks is not None
        return added_by(ranks, parts[ranks.rank])

    right = np.zeros(7)
    for part in parts:
        right += part
    for found in on_ranks(5, added):
        np.testing.assert_array_equal(found, right)
