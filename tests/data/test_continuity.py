"""Where rows go on from one another, and what is said of those that do not (rule R10)."""

from __future__ import annotations

import numpy as np
import pytest

from msnn.data.reading.rows import RowRange, continuity

NAN = float("nan")


@pytest.mark.parametrize(
    ("time", "continues", "fault"),
    [
        ([0, 1, 2, 3], [False, True, True, True], None),
        # a hundredth of the sample time is rounding, more is not
        ([0, 1.009, 2], [False, True, True], None),
        ([0, 1, 2.02, 3.02], [False, True, False, True], ("gap", 14, 1.02, 0)),
        ([0, 1, 3, 4, 5, 8, 9], [False, True, False, True, True, False, True], ("gap", 14, 2, 1)),
        ([0, 2, 4, 5], [False, False, False, True], ("sample time", 12, 2, 1)),
        # a clock that stands, is set back, or has no number
        ([0, 1, 1, 2], [False, True, False, True], ("order", 14, 0, 0)),
        ([0, 1, 0, 1], [False, True, False, True], ("order", 14, -1, 0)),
        ([0, 1, NAN, 3, 4], [False, True, False, False, True], ("order", 14, NAN, 1)),
        ([NAN, NAN], [False, False], ("order", 12, NAN, 0)),
        ([5], [False], None),
        ([], [], None),
    ],
)
def test_rows_of_every_second_one(
    time: list[float], continues: list[bool], fault: tuple[str, int, float, int] | None
) -> None:
    """Rows 10, 12, … of a file, whose sample time is 1 s."""
    picked = RowRange(10, 10 + 2 * len(time), 2)
    found, faults = continuity(np.array(time, float), picked, 1.0)
    assert found.tolist() == continues
    if fault is None:
        assert faults == []
    else:
        (one,) = faults
        kind, row, step, more = fault
        assert (one.kind, one.row, one.more) == (kind, row, more)
        assert one.step == pytest.approx(step, nan_ok=True)
