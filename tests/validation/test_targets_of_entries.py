"""`target:` of an entry is any logged sample, whether or not the rest of the model reads it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import msnn

SPEC = """
msnn: 1
name: plant
sample_time: 0.1 s
inputs: {u: m, v: m}
targets: {z: m}
states: {s: {next: u, init: 0, unit: m}}
outputs: {o: {expr: "s * 1", unit: m}}
data: {source: {train: a.csv}, time: time}
validate: [{of: o, metric: rmse, target: TARGET, data: train, rollout: episode}]
"""
TIME = 0.1 * np.arange(50)
COLUMNS = {
    "time": TIME,
    "u": np.sin(TIME),
    "v": np.cos(TIME),
    "z": TIME,
    "s": np.sin(TIME) + 2.0,
}


@pytest.mark.parametrize(
    ("target", "column", "ahead"),
    [
        ("z", "z", 0),
        ("z[t]", "z", 0),
        ("z[t+1]", "z", 1),
        ("v[t]", "v", 0),
        ("s.meas", "s", 0),
        ("s.meas[t+2]", "s", 2),
        ("u[t-1]", "u", -1),
    ],
)
@pytest.mark.parametrize("losses", ["", 'losses: {l: "mse(o, u)"}\n'])
def test_a_target_that_nothing_else_reads_is_measured(
    tmp_path: Path, target: str, column: str, ahead: int, losses: str
) -> None:
    text = SPEC.replace("TARGET", f'"{target}"') + losses
    (tmp_path / "plant.yaml").write_text(text)
    table = np.column_stack(list(COLUMNS.values()))
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header=",".join(COLUMNS), comments="")
    (row,) = msnn.validate(msnn.load(tmp_path / "plant.yaml")).rows
    output = np.concatenate(([0.0], COLUMNS["u"][:-1]))
    wanted = COLUMNS[column]
    match ahead:
        case 0:
            both = output, wanted
        case -1:
            # the run begins in the first row that has the row before
            both = np.concatenate(([0.0], COLUMNS["u"][1:-1])), wanted[:-1]
        case _:
            both = output[:-ahead], wanted[ahead:]
    assert row.scored == len(both[0])
    assert row.value == pytest.approx(np.sqrt(np.mean((both[0] - both[1]) ** 2)), rel=1e-12)


def test_an_export_has_no_port_for_it(tmp_path: Path) -> None:
    (tmp_path / "plant.yaml").write_text(SPEC.replace("TARGET", '"z[t]"'))
    model = msnn.load(tmp_path / "plant.yaml")
    assert [signal.name for signal in model.program.signals] == ["u", "z"]
    files = msnn.export(model, "c", tmp_path / "c")
    header = next(file for file in files if file.suffix == ".h")
    ports = re.findall(r"plant_real (\w+);", header.read_text())
    assert "u" in ports
    assert "z" not in ports
