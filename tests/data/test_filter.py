"""Rule R10: `filter:` keeps the rows for which a comparison of signals holds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from msnn.data.dataset import Dataset
from msnn.data.reading.load import load_data
from msnn.data.reading.row_filter import row_filters
from msnn.model.load import load_model
from spec_schema.diagnostics.diagnostic import SpecError

SPEC = """
msnn: 1
name: plant
sample_time: 0.2 s
inputs: {{x: m, F: N}}
targets: {{quality: '1'}}
constants: {{least: 0.5}}
functions: {{twice: {{args: [a], expr: 2*a}}}}
outputs: {{y: {{expr: "x + 1"}}}}
losses: {{fit: "mse(y, x[t+1])"}}
data:
  source: {{train: a.csv}}
  filter: "{filter}"
"""
TABLE = "x,F,quality\n1,1,1\n2,1,0\n3,-1,1\n4,2,1\n5,2,\n6,2,1\n"


def load(folder: Path, condition: str) -> Dataset:
    (folder / "plant.yaml").write_text(SPEC.format(filter=condition))
    (folder / "a.csv").write_text(TABLE)
    model = load_model(folder / "plant.yaml")
    assert model.spec.data is not None
    return load_data(model.program, model.spec.data, folder, row_filters(model.spec))


@pytest.mark.parametrize(
    ("condition", "kept"),
    [
        ("F > 0", [[0, 2], [3, 6]]),
        ("quality >= least", [[0, 1], [2, 4], [5, 6]]),
        ("twice(abs(F)) <= 2", [[0, 3]]),
        ("min(x - 1, 5 - x) > 0", [[1, 4]]),
    ],
)
def test_a_filter_ends_episodes_where_it_fails(
    tmp_path: Path, condition: str, kept: list[list[int]]
) -> None:
    data = load(tmp_path, condition)
    assert data.episodes("train").tolist() == kept
    np.testing.assert_array_equal(data.series["x"], [1, 2, 3, 4, 5, 6])


def test_a_filter_that_keeps_nothing_says_so(tmp_path: Path) -> None:
    data = load(tmp_path, "x > 100")
    assert [warning.code for warning in data.warnings] == ["W0804"]


@pytest.mark.parametrize(
    ("condition", "code"),
    [
        ("x", "E0847"),
        ("speed > 2", "E0301"),
        ("x[t-1] > 2", "E0846"),
        ("x > F", "W0504"),
        ("x > 1 > 2", "E03"),
    ],
)
def test_filters_that_are_wrong(tmp_path: Path, condition: str, code: str) -> None:
    if code.startswith("W"):
        load(tmp_path, condition)
        return
    with pytest.raises(SpecError, match=code):
        load(tmp_path, condition)
