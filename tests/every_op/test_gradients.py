"""Slopes of every operation by torch, CasADi and the Jacobian: against differences, each other."""

from __future__ import annotations

import pytest

from tests.every_op.agreement import assert_agrees
from tests.every_op.gradients import (
    Gradient,
    by_casadi,
    by_differences,
    by_jacobian,
    by_torch,
    problem,
)
from tests.every_op.record import Record
from tests.every_op.records import RECORDS

DIFFERENCES = 1e-6
"""Central differences lose about ε^(2/3) = 4e-11 of the value; slopes are smaller than values at
the ends of steep functions such as tan and exp by some thousands."""

EXACT = 1e-11
"""Both are exact derivatives; one may cancel where the other does not, as 1 − tanh² at 30."""

MODES: dict[str, Gradient] = {"torch": by_torch, "casadi": by_casadi, "jacobian": by_jacobian}


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.name)
@pytest.mark.parametrize("mode", MODES)
def test_slopes_agree_with_differences(record: Record, mode: str):
    p = problem(record.program, record.log, record.smooth_times)
    expected = by_differences(p)
    for key, slope in MODES[mode](p).items():
        assert_agrees(slope, expected[key], DIFFERENCES, f"{record.name} d/d {key}")


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: record.name)
@pytest.mark.parametrize("mode", ["casadi", "jacobian"])
def test_exact_slopes_agree(record: Record, mode: str):
    p = problem(record.program, record.log, record.smooth_times)
    expected = by_torch(p)
    for key, slope in MODES[mode](p).items():
        assert_agrees(slope, expected[key], EXACT, f"{record.name} d/d {key}")
