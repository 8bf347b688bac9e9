"""Warnings of learned parameters reach who listens to a training, its result and its run."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import msnn
from spec_schema.diagnostics.diagnostic import Diagnostic, describe

TWINS = """
msnn: 1
name: twins
inputs: {u: 1}
targets: {y: 1}
parameters: {a: {init: 1, max: 2}, b: 1, d: {init: 1, min: 0, max: 1.5}}
outputs: {z: {expr: (a + b) * u + d}}
losses: {fit: 'mse(z, y)'}
train: [{engine: torch, optimizer: levenberg_marquardt}]
"""
U = np.linspace(-1, 1, 30)


@pytest.mark.parametrize("keeps", [True, False])
def test_warnings_at_the_end_reach_the_function_and_the_result(tmp_path: Path, keeps: bool) -> None:
    heard: list[object] = []
    model = msnn.load(TWINS)
    runs = tmp_path / "runs" if keeps else None
    series = {"u": U, "y": 3 * U + 2 + 0.01 * np.sin(40 * U)}
    found = msnn.train(model, series, runs=runs, progress=heard.append)
    # what needs standard errors is not known of a training without a run
    expected = {"W0904", "W0930"} if keeps else {"W0904"}
    assert {one.code for one in found.warnings} & {"W0904", "W0914", "W0930"} == expected
    assert [one for one in heard if isinstance(one, Diagnostic)] == list(found.warnings)
    assert len(set(found.warnings)) == len(found.warnings)
    if found.folder is not None:
        end = json.loads((found.folder / "run.json").read_text())["end"]
        assert end["warnings"] == [describe(one) for one in found.warnings]
