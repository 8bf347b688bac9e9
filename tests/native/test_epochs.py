"""What kernels do for whole epochs against the Python that says what it is: orders and groups."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from backends.native.kernel import Kernel
from backends.native.kernel_data import lane_groups
from msnn.training.plans.epochs import order_key, shuffled
from tests.conditions import require_tool
from tests.language.compiled import compiled

GAIN = """
inputs: {x: m}
parameters: {a: 0.3}
outputs: {x_next: {expr: a * x, predicts: "x[t+1]"}}
"""


@pytest.fixture(scope="module", params=["float32", "float64"])
def kernel(request: pytest.FixtureRequest) -> Kernel:
    require_tool("gcc", install="apt install gcc")
    return Kernel(compiled(GAIN), request.param)


@pytest.mark.parametrize("count", [0, 1, 2, 17, 5000])
@pytest.mark.parametrize("key", [0, 1, 2**63 + 5, 2**64 - 1, order_key(3, 1, 4, 1)])
def test_orders(kernel: Kernel, count: int, key: int) -> None:
    found = kernel.shuffled(count, key)
    assert found.tolist() == shuffled(count, key).tolist()
    assert sorted(found.tolist()) == list(range(count))


@pytest.mark.parametrize("count", [1, 15, 16, 17, 64, 100])
@pytest.mark.parametrize("size", [1, 8, 16, 24, 100, 1000])
def test_groups_of_rollouts_of_one_length(kernel: Kernel, count: int, size: int) -> None:
    random = np.random.default_rng(1)
    starts, members = random.integers(0, 1000, 130), random.permutation(130)[:count]
    sizes = [min(size, count - begin) for begin in range(0, count, size)]
    steps = np.full(count, 7)
    expected, expected_bounds = lane_groups(kernel.group_type, starts[members], steps, sizes)
    groups, bounds = kernel.batches(starts, 7, size, members)
    assert bounds.tolist() == expected_bounds.tolist()
    for field in ("steps", "start", "used"):
        assert (groups[field] == expected[field]).all()


def test_every_seed_stage_epoch_and_attempt_has_an_order_of_its_own() -> None:
    places = list(product(range(3), repeat=4))
    assert len({order_key(*place) for place in places}) == len(places)
