"""Metrics of two models are compared where they are of the same thing, measured alike."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from msnn.features.changes.model_changes import metric_changes
from msnn.validation.validate import MetricRow, ValidationReport
from spec_schema.units.parser import parse_unit

ROW = MetricRow(
    of="y",
    metric="rmse",
    value=2.0,
    unit=parse_unit("m"),
    elements=np.array(2.0),
    horizon="one step",
    closed=(),
    details=(),
    data="val",
    rows="rows 0…9 of 10",
    scored=10,
    minimum=None,
    maximum=None,
    span=None,
)


def changes(old: tuple[MetricRow, ...], new: tuple[MetricRow, ...]):
    return metric_changes(*(ValidationReport(rows, (), ()) for rows in (old, new)))


def test_values_in_other_units_are_no_growth() -> None:
    """2 m and 1000 mm: the numbers tell nothing."""
    (found,) = changes((ROW,), (replace(ROW, unit=parse_unit("mm"), value=1000.0),))
    assert (found.old, found.new, found.growth, found.note) == (2.0, 1000.0, None, "in m before")


def test_each_set_rollout_and_output_is_compared_with_itself() -> None:
    rows = (
        ROW,
        replace(ROW, data="test", value=3.0),
        replace(ROW, horizon="record", value=5.0),
        replace(ROW, details=("skip 20",), value=7.0),
        replace(ROW, of="z", value=11.0),
        replace(ROW, metric="mae", value=13.0),
    )
    found = changes(rows, tuple(replace(row, value=2 * row.value) for row in reversed(rows)))
    assert [(each.old, each.new) for each in found] == [
        (row.value, 2 * row.value) for row in reversed(rows)
    ]
    assert {each.growth for each in found} == {1.0}


def test_what_one_of_them_measures_alone_is_said() -> None:
    other = replace(ROW, of="z", scored=9)
    found = changes((ROW, other), (replace(ROW, scored=8), replace(ROW, metric="mae")))
    assert [(each.note, each.growth) for each in found] == [
        ("10 values before, 8 now", 0.0),
        ("only in the new spec", None),
        ("only in the old spec", None),
    ]
