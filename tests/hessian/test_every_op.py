"""Second derivatives of every operation and every scalar function, against three judges."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from compiler.ir.program import Program
from tests.every_op.gradients import problem
from tests.every_op.random_programs import programs
from tests.every_op.record import Record
from tests.every_op.records import RECORDS
from tests.hessian.of_records import (
    by_compiler,
    by_differences,
    by_torch,
    derivatives_of,
    first_slopes,
)

LOG = {
    "u": np.random.default_rng(11).uniform(-1.5, 1.5, 12),
    "q": np.random.default_rng(12).uniform(-1.5, 1.5, (12, 3)),
}
TIMES = np.arange(4, 9)

of_every_record = pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.name)


@of_every_record
def test_curvatures_are_differences_of_slopes(record: Record) -> None:
    p = problem(record.program, record.log, record.smooth_times)
    found = derivatives_of(p)
    values = by_compiler(p, found).matrices["H"]
    expected = by_differences(p, found)
    # differences of step 1e-6 relative lose half of the digits
    scale = max(1.0, float(np.abs(expected).max(initial=0.0)))
    np.testing.assert_allclose(values, expected, atol=1e-6 * scale, rtol=1e-6)
    assert np.array_equal(values, values.transpose(0, 2, 1), equal_nan=True)


@of_every_record
def test_slopes_are_those_of_the_rows_one_by_one(record: Record) -> None:
    """At kinks and infinite slopes too: forward mode on arrays, reverse mode on single rows."""
    p = problem(record.program, record.log, record.times)
    found = by_compiler(p, derivatives_of(p)).matrices["J"]
    expected, _ = first_slopes(p, p.variables)
    finite = np.ones(p.members, bool)
    for (kind, _), value in p.variables.items():
        if kind != "parameter":
            finite &= np.isfinite(value.reshape(p.members, -1)).all(axis=1)
    np.testing.assert_allclose(found[finite], expected[finite], rtol=1e-12, atol=1e-13)


@of_every_record
def test_torch_finds_the_same_curvatures(record: Record) -> None:
    p = problem(record.program, record.log, record.smooth_times)
    found = derivatives_of(p)
    values = by_compiler(p, found).matrices["H"]
    moving = [
        member.first + i
        for member in found.variables.members
        if member.name not in {q.name for q in p.program.parameters}
        for i in range(member.size)
    ]
    expected = by_torch(p, found)[:, moving][:, :, moving]
    scale = max(1.0, float(np.abs(expected).max(initial=0.0)))
    # both are exact; terms of sums cancel in another order
    np.testing.assert_allclose(
        values[:, moving][:, :, moving], expected, atol=1e-11 * scale, rtol=1e-11
    )


@of_every_record
def test_entries_known_to_be_0_are(record: Record) -> None:
    p = problem(record.program, record.log, record.smooth_times)
    found = derivatives_of(p)
    values = by_compiler(p, found)
    for matrix in found.matrices:
        known = np.array([number == 0.0 for number in matrix.known], bool).reshape(matrix.shape)
        assert not values.matrices[matrix.name][:, known].any()


@settings(
    max_examples=40,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)
@given(programs())
def test_random_programs_bend_as_torch_finds(program: Program) -> None:
    p = problem(program, LOG, TIMES)
    found = derivatives_of(p)
    values = by_compiler(p, found).matrices
    moving = [
        member.first + i
        for member in found.variables.members
        if member.name not in {q.name for q in p.program.parameters}
        for i in range(member.size)
    ]
    slopes, _ = first_slopes(p, p.variables)
    _assert_close(values["J"], slopes)
    _assert_close(values["H"][:, moving][:, :, moving], by_torch(p, found)[:, moving][:, :, moving])


def _assert_close(found: np.ndarray, expected: np.ndarray) -> None:
    # chains of two dozen operations amplify rounding
    scale = max(1.0, float(np.abs(expected).max(initial=0.0)))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * scale)
