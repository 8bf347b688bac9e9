"""Long rollouts: segments computed again in little memory give the bits of rows that are kept."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from backends.c_language.literals import Dtype
from backends.native.kernel import Kernel
from backends.native.variables import flat
from compiler.passes.close_loop import close_loop
from tests.conditions import require_tool
from tests.language.compiled import compiled
from tests.native.long_rollouts import calm
from tests.native.test_kernel import MODELS, log_of, reference

STEPS = 600
"""Three segments, the last one shorter."""

NOTHING, EVERYTHING = 0, 1 << 40


@pytest.fixture(autouse=True)
def _compiler() -> None:
    require_tool("gcc", install="apt install gcc")


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("name", MODELS)
def test_segments_give_the_same_bits(name: str, dtype: Dtype) -> None:
    text, closed = MODELS[name]
    program = close_loop(compiled(text), closed)
    log = log_of(program, rows=700)
    weights = flat(program, calm(program))
    scale = [loss.weight for loss in program.losses]
    t0 = np.arange(10, 31)
    steps = np.where(t0 % 3, STEPS, 90)  # some end within the first segment
    rows = {loss.name: np.arange(700) % 7 > 2 for loss in program.losses}
    found = [
        kernel.losses(kernel.data(log, 300, rows), kernel.groups(t0, steps), weights, scale)
        for kernel in (Kernel(program, dtype, kept_bytes=kept) for kept in (NOTHING, EVERYTHING))
    ]
    segments, kept = found
    assert np.isfinite(kept.gradient).all()
    assert np.any(kept.gradient)
    np.testing.assert_array_equal(segments.gradient, kept.gradient)
    np.testing.assert_array_equal(segments.sums, kept.sums)
    np.testing.assert_array_equal(segments.counts, kept.counts)


@pytest.mark.parametrize("name", MODELS)
def test_losses_and_slopes_over_several_segments(name: str) -> None:
    text, closed = MODELS[name]
    program = close_loop(compiled(text), closed)
    log = log_of(program, rows=700)
    weights = calm(program)
    numbers = flat(program, weights)
    t0 = np.array([10, 20, 30])
    scale = [loss.weight for loss in program.losses]
    kernel = Kernel(program, "float64", kept_bytes=NOTHING)
    data, groups = kernel.data(log), kernel.groups(t0, np.full(3, STEPS))
    found = kernel.losses(data, groups, numbers, scale)
    sums, _ = reference(program, log, t0, STEPS, 0, weights)
    np.testing.assert_allclose(found.sums, list(sums.values()), rtol=1e-10)
    along = found.gradient / np.linalg.norm(found.gradient)

    def total(values: np.ndarray) -> float:
        moved = kernel.losses(data, groups, values, scale, gradient=False)
        return float(np.dot(scale, moved.sums / moved.counts))

    slope = (total(numbers + 1e-6 * along) - total(numbers - 1e-6 * along)) / 2e-6
    # central differences of step 1e-6 keep half of the digits
    assert slope == pytest.approx(float(np.linalg.norm(found.gradient)), rel=1e-5)


def test_long_rollouts_take_little_memory() -> None:
    """25,000 steps of 16 lanes; all rows of the arms would take some 170 MiB more."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.native.long_rollouts"],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) < 256 << 20
