"""Threads share a batch: the same bits for any number of them, whatever else the process does."""

from __future__ import annotations

import os
import signal
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numpy.typing import NDArray

from backends.c_language.literals import Dtype
from backends.native.kernel import Kernel
from backends.native.variables import Method, Rule
from compiler.ir.program import Program
from compiler.passes.close_loop import close_loop
from tests.conditions import require_tool
from tests.language.compiled import compiled
from tests.native.test_kernel import MODELS, initial, log_of


@pytest.fixture(autouse=True)
def _compiler() -> None:
    require_tool("gcc", install="apt install gcc")


def model(name: str) -> Program:
    text, closed = MODELS[name]
    return close_loop(compiled(text), closed)


def trained(program: Program, dtype: Dtype, threads: int) -> tuple[NDArray[np.float64], ...]:
    """Losses and raw variables after two epochs of batches of 300 and 200 rollouts."""
    log = log_of(program, rows=600)
    kernel = Kernel(program, dtype, threads)
    rates = {parameter.name: 0.01 for parameter in program.parameters}
    variables = kernel.variables(
        Rule(method=Method.ADAM, beta1=0.9, beta2=0.999, epsilon=1e-8), initial(program), rates
    )
    t0 = np.arange(10, 510)
    steps = 3 + t0 % 5
    groups, bounds = kernel.batches(t0, steps, 300)
    data = kernel.data(log)
    weights = [1.0] * len(program.losses)
    found = [kernel.train(data, groups, bounds, variables, weights) for _ in range(2)]
    assert [done for done, _, _ in found] == [2, 2]
    evaluated = kernel.losses(data, kernel.groups(t0, steps), variables.physical, weights)
    return (*(sums for _, sums, _ in found), variables.arrays["raw"], evaluated.gradient)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("name", MODELS)
def test_any_number_of_threads_gives_the_same_bits(name: str, dtype: Dtype) -> None:
    program = model(name)
    alone = trained(program, dtype, 1)
    for threads in (2, 4, 7):
        for ours, one in zip(trained(program, dtype, threads), alone, strict=True):
            np.testing.assert_array_equal(ours, one)


def test_several_engines_train_at_once() -> None:
    names = ["fir", "arm", "vehicle", "joints"]
    alone = [trained(model(name), "float32", 1) for name in names]
    with ThreadPoolExecutor(len(names)) as pool:
        beside = list(pool.map(lambda name: trained(model(name), "float32", 3), names))
    for ours, one in zip(beside, alone, strict=True):
        for mine, other in zip(ours, one, strict=True):
            np.testing.assert_array_equal(mine, other)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="a system without fork")
@pytest.mark.filterwarnings("ignore:.*use of fork.*:DeprecationWarning")
def test_a_fork_after_training_trains_too() -> None:
    program = model("fir")
    alone = trained(program, "float32", 2)
    child = os.fork()
    if child == 0:
        again = trained(program, "float32", 2)
        os._exit(0 if all(map(np.array_equal, again, alone)) else 1)
    _, status = os.waitpid(child, 0)
    assert os.waitstatus_to_exitcode(status) == 0


def test_signals_reach_the_thread_of_python() -> None:
    """The members of a team block signals: a handler of Python is called as always."""
    program = model("arm")
    seen: list[int] = []
    before = signal.signal(signal.SIGALRM, lambda number, _: seen.append(number))
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.001, 0.001)
        threaded = trained(program, "float32", 4)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert seen
    for ours, one in zip(threaded, trained(program, "float32", 1), strict=True):
        np.testing.assert_array_equal(ours, one)
