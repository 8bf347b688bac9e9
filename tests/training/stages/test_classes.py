"""Numbers that are no class of a cross-entropy are refused with their row before training."""

from __future__ import annotations

import numpy as np
import pytest

from msnn.training.train import TrainingOptions, train
from spec_schema.diagnostics.diagnostic import SpecError
from tests.training.cases import compiled, dataset

MODEL = """
msnn: 1
name: sorter
dims: {kind: 3, side: 2}
inputs: {u: 1}
targets: {z: 1, w: {dims: side}}
layers: {h: {linear: {out: kind}}}
parameters: {a: {init: [0.1, -0.2], dims: side}}
outputs: {logits: h(u)}
losses:
  of_one: cross_entropy(logits, z)
  of_two: cross_entropy(a * logits, w)
train: [{epochs: 1, engine: torch}]
"""


def series(rows: int = 40) -> dict[str, np.ndarray]:
    random = np.random.default_rng(2)
    return {
        "u": random.normal(size=rows),
        "z": random.integers(0, 3, rows).astype(float),
        "w": random.integers(0, 3, (rows, 2)).astype(float),
    }


def refused(values: dict[str, np.ndarray]) -> str:
    program, spec = compiled(MODEL)
    with pytest.raises(SpecError) as caught:
        train(
            program, dataset(values, train=[30], val=[10]), spec.train, TrainingOptions(runs=None)
        )
    (found,) = {one.message: one for one in caught.value.diagnostics}.values()
    assert found.code == "E1131"
    return found.message


@pytest.mark.parametrize("value", [3.0, -1.0, 1.5, 1e300])
def test_a_number_that_is_no_class_is_told_with_its_row(value: float) -> None:
    values = series()
    values["z"][17] = value
    assert refused(values) == f"{value:g} is no class of the loss `of_one`, in row 17 of train0.csv"


def test_every_element_and_every_set_is_looked_at() -> None:
    values = series()
    values["w"][33:, 1] = 9.0
    wanted = "9 is no class of the loss `of_two`, in row 3 of val1.csv, one of 7 such numbers"
    assert refused(values) == wanted


def test_rounded_and_missing_classes_are_no_mistakes() -> None:
    program, spec = compiled(MODEL)
    values = series()
    values["z"] += 1e-7
    values["z"][5:9] = np.nan
    values["w"][5:20, 0] = np.nan
    data = dataset(values, train=[30], val=[10])
    result = train(program, data, spec.train, TrainingOptions(runs=None))
    assert np.isfinite(result.stages[0].best_value)
