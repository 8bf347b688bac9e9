"""Rollouts that start from a slow measurement, which most rows lack, are told and repaired."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import msnn
from msnn.validation.reports.report import broken_limits

SPEC = """
msnn: 1
name: tank
sample_time: 0.1 s
inputs: {u: {}}
parameters: {k: {init: 0.5}}
states: {T: {init: "T.meas", next: "0.9*T + k*u"}}
outputs: {o: {expr: "next(T)", predicts: "T[t+1]"}}
data: {source: {train: a.csv}, time: t, resample: linear}
train: [{rollout: ROLLOUT, epochs: 2, optimizer: levenberg_marquardt}]
validate: [{of: o, metric: rmse, max: 100, rollout: ROLLOUT}]
"""


def model(folder: Path, rollout: str, apart: int = 7, first: int = 0) -> msnn.Model:
    """A model of 100 rows with a value of `T` in every `apart`-th one."""
    rows = np.arange(100)
    there = (rows % apart == first) if apart else np.isin(rows, [0, 3, 4, 11, 30, 32, 50])
    lines = [f"{0.1 * k:.1f},{np.sin(k):.4f},{np.cos(k):.4f}" for k in rows]
    cells = [
        line if has else line.rsplit(",", 1)[0] + ","
        for line, has in zip(lines, there, strict=True)
    ]
    (folder / "a.csv").write_text("\n".join(["t,u,T", *cells]) + "\n")
    (folder / "tank.yaml").write_text(SPEC.replace("ROLLOUT", rollout))
    return msnn.load(folder / "tank.yaml")


@pytest.mark.parametrize(("apart", "first"), [(7, 0), (5, 0), (7, 3), (0, 0)])
@pytest.mark.parametrize("rollout", ["1", "4", "20"])
def test_the_rollout_that_the_help_names_scores_the_values(
    tmp_path: Path, rollout: str, apart: int, first: int
) -> None:
    report = msnn.validate(model(tmp_path, rollout, apart, first))
    told = [one for one in report.warnings if one.code == "W0836"]
    if (apart, rollout) == (5, "20"):
        assert not told
        assert report.rows[0].scored == 19
        return
    (one,) = told
    assert "`T`, from which they start, is not measured where they begin" in one.message
    assert one.help is not None
    named = re.findall(r"`rollout: (\w+)`", one.help)[0]
    assert named == ("record" if first or not apart else str(-(-int(rollout) // apart) * apart))
    again = msnn.validate(model(tmp_path, named, apart, first))
    assert not [one for one in again.warnings if one.code == "W0836"]
    values = len(range(first, 100, apart)) if apart else 7
    assert again.rows[0].scored == values - 1
    assert report.rows[0].scored < values - 1


def test_a_limit_without_a_value_names_the_reason(tmp_path: Path) -> None:
    (fault,) = broken_limits(msnn.validate(model(tmp_path, "1")))
    assert fault.message == "rmse of `o` is not known, and the limit is ≤ 100"
    assert "reach no measured value" in fault.notes[0]
    assert fault.help is not None
    assert "train again" not in fault.help


def test_training_that_scores_nothing_names_the_reason(tmp_path: Path) -> None:
    with pytest.raises(msnn.SpecError) as caught:
        msnn.train(model(tmp_path, "1"), runs=None)
    (fault,) = caught.value.diagnostics
    assert fault.code == "E0909"
    assert fault.notes[1] == "rollouts start where `T` is measured, and score one step from there"
    assert fault.help is not None
    assert "as long as the rows from one measured value to the next" in fault.help
    assert np.isfinite(float(msnn.train(model(tmp_path, "7"), runs=None).weights["k"]))
