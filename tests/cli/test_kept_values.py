"""Every command that reads data says how many measured values resampling keeps."""

from __future__ import annotations

import pytest

from tests.cli.command_line import CommandLine

SPEC = """
msnn: 1
name: plant
sample_time: 10 ms
inputs: {u: {}}
targets: {y: {}}
parameters: {k: {init: 1}}
outputs: {o: {expr: k*u, predicts: "y[t]"}}
data: {source: {train: a.csv}, time: t, resample: linear}
train: [{epochs: 10, optimizer: levenberg_marquardt}]
validate: [{of: o, metric: rmse, data: train}]
"""


@pytest.mark.parametrize("command", ["train", "validate --initial", "check --data", "data"])
def test_a_command_tells_how_many_values_are_kept(msnn: CommandLine, command: str) -> None:
    rows = (f"{0.01 * i:.7g},{i % 7},{2 * (i % 7) if i % 5 == 0 else ''}" for i in range(100))
    (msnn.folder / "plant.yaml").write_text(SPEC)
    (msnn.folder / "a.csv").write_text("\n".join(["t,u,y", *rows]) + "\n")
    verb, *options = command.split()
    said = msnn(verb, "plant.yaml", *options)
    assert said.code == 0
    assert "note[W0830]: resampling keeps 20 of 20 measured values of column `y`" in said.err
    # advice that the spec follows already
    assert "`resample: linear`" not in said.err
    assert ("with a value of `y` in every row" in said.err) == (verb in ("check", "data"))
