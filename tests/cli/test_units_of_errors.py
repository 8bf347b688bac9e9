"""An error of an output in degC is a difference of temperatures: in K wherever it is shown."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

import msnn as package
from msnn.reports.drawn import channels, output_channels
from tests.cli.conftest import CommandLine

SPEC = """
msnn: 1
name: plant
sample_time: 1 s
inputs: {T: UNIT}
targets: {z: UNIT}
parameters: {T0: {init: 20, unit: UNIT}}
outputs: {o: {expr: T0 + 0 * T, predicts: "z[t]"}}
data: {source: {train: a.csv}}
train: [{epochs: 3, optimizer: levenberg_marquardt}]
validate:
  - {of: o, metric: rmse, data: train, max: 2 DIFFERENCE}
  - {of: o, metric: mae, data: train, rollout: 10}
  - {of: o, metric: max_abs, data: train}
"""
UNITS = {"degC": "K", "degF": "degR", "K": "K", "bar": "bar"}


def write(folder: Path, unit: str) -> None:
    text = SPEC.replace("UNIT", unit).replace("DIFFERENCE", UNITS[unit])
    (folder / "plant.yaml").write_text(text)
    time = np.arange(200.0)
    table = np.column_stack((20 + time / 100, 20 + np.round(3 * np.sin(time), 1)))
    np.savetxt(folder / "a.csv", table, delimiter=",", header="T,z", comments="", fmt="%.4f")


@pytest.mark.parametrize("unit", UNITS)
def test_metrics_are_in_the_unit_of_differences(msnn: CommandLine, unit: str) -> None:
    write(msnn.folder, unit)
    said = msnn("validate", "plant.yaml", "--initial", "--junit", "a.xml")
    assert f"2.11906 {UNITS[unit]}" in said.out + said.err
    shown = msnn("validate", "plant.yaml", "--initial", "--format", "json")
    found = json.loads(shown.out)
    for rows in (found["metrics"], found["outputs"]):
        assert {row["unit"] for row in rows} == {UNITS[unit]}
    texts = said.out + said.err + shown.out + (msnn.folder / "a.xml").read_text()
    assert not re.search(r"\bdeg[CF]\b", texts)


def test_the_report_has_errors_and_deviations_in_kelvin(msnn: CommandLine) -> None:
    write(msnn.folder, "degC")
    said = msnn("train", "plant.yaml")
    assert re.search(r"^T0 +degC +20 +20.016 +0.15 K", said.out, re.MULTILINE)
    msnn("report", "runs/plant/latest", "--out", "report.html")
    page = (msnn.folder / "report.html").read_text()
    assert '"unit": "degC"' in page.replace('":"', '": "')
    assert '"error_unit": "K"' in page.replace('":"', '": "')
    tables = re.sub(r"<[^>]*>", " ", page)
    # the deviation of a signal, the standard error of a parameter
    assert len(re.findall(r"\d K\b", tables)) >= 3


def test_pictures_have_both_units(tmp_path: Path) -> None:
    write(tmp_path, "degC")
    program = package.load(tmp_path / "plant.yaml").program
    for drawn in (*output_channels(program), *channels(program.signals)):
        assert (drawn.unit, drawn.error_unit) == ("degC", "K")


def test_the_check_of_data_has_deviations_and_steps_in_kelvin(msnn: CommandLine) -> None:
    write(msnn.folder, "degC")
    said = msnn("data", "plant.yaml", "--json", "found.json")
    (row,) = re.findall(r"^z +degC .*$", said.out, re.MULTILINE)
    assert " K " in row
    assert "steps of 0.1 K" in said.out + said.err
    assert "steps of 0.1 degC" not in said.out + said.err
    found = json.loads((msnn.folder / "found.json").read_text())
    assert '"difference_unit": "K"' in json.dumps(found)
