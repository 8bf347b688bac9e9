"""A row counts in every rollout of training that passes it, and once in `validate` (rule R2)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import msnn as package
from tests.cli.conftest import CommandLine

SPEC = """
msnn: 1
name: plant
sample_time: 1 s
inputs: {y: {}}
parameters: {a: {init: 0.5}}
outputs: {o: {expr: "a * y[t]", predicts: "y[t+1]"}}
data: {source: {train: a.csv}}
train: [{epochs: 20, optimizer: levenberg_marquardt, rollout: {horizon: 4, stride: STRIDE}}]
validate: [{of: o, metric: rmse, rollout: 4}]
"""


def write(folder: Path, stride: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    (folder / "plant.yaml").write_text(SPEC.replace("STRIDE", str(stride)))
    y = np.round(0.9 ** np.arange(21) + 0.1 * np.sin(1.7 * np.arange(21) ** 2), 6)
    np.savetxt(folder / "a.csv", y, header="y", comments="", fmt="%.6f")
    return y


@pytest.mark.parametrize("stride", [1, 2, 3, 4])
def test_the_loss_counts_overlaps_and_the_metric_does_not(tmp_path: Path, stride: int) -> None:
    y = write(tmp_path, stride)
    model = package.load(tmp_path / "plant.yaml")
    run = package.train(model, runs=None)
    a = float(run.weights["a"])
    starts = range(0, len(y) - 4, stride)
    errors = [a ** (k + 1) * y[s] - y[s + k + 1] for s in starts for k in range(4)]
    assert run.stages[0].best_value == pytest.approx(np.mean(np.square(errors)), rel=1e-5)
    (row,) = package.validate(model, run.weights).rows
    once = [a ** (k + 1) * y[s] - y[s + k + 1] for s in range(0, 17, 4) for k in range(4)]
    assert row.scored == 20
    assert row.value**2 == pytest.approx(np.mean(np.square(once)), rel=1e-9)
    # the advice of the page
    assert (stride == 4) == (run.stages[0].best_value == pytest.approx(row.value**2, rel=1e-5))


@pytest.mark.parametrize(("stride", "counted"), [(1, 4), (2, 2), (3, 2), (4, None)])
def test_the_line_of_the_stage_says_how_often_a_row_counts(
    msnn: CommandLine, stride: int, counted: int | None
) -> None:
    write(msnn.folder, stride)
    said = msnn("train", "plant.yaml")
    text = f"rollouts overlap: a row counts up to {counted} times, in `validate` once"
    assert (text in said.err) == (counted is not None)
    assert ("overlap" in said.err) == (counted is not None)
