"""An exported moving-horizon estimator agrees with the one in Python, and a wrong one does not."""

from __future__ import annotations

from pathlib import Path

import pytest

from msnn.agreement.faults import FarStep, SelfTestFails
from msnn.exports.export import plan_exports, write_export
from msnn.exports.judged_horizon import compare_horizon
from msnn.exports.targets.mpc import built_controller
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights
from spec_schema.diagnostics.diagnostic import Findings
from tests.conditions import require_tool
from tests.control.test_moving_horizon import BOUNDED, window


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_it_agrees_and_a_wrong_arrival_does_not(dtype: str, tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    path = tmp_path / "spec.msnn.yaml"
    path.write_text(window(BOUNDED, 6), encoding="utf-8")
    model = load_model(path, [f"export.mpc.dtype={dtype}"])
    (plan,) = plan_exports(model, ["mpc"], Findings())
    weights = initial_weights(model.program)
    written = write_export(plan, weights, tmp_path / "out")
    assert model.estimation is not None

    def faults() -> tuple[object, ...]:
        assert model.estimation is not None
        with built_controller(written) as folder:
            found = compare_horizon(model.estimation, weights, folder, plan.float_type, "mpc")
        return found.faults

    assert faults() == ()
    source = next(path for path in written.files if path.name.endswith("_mhe.c"))
    text = source.read_text(encoding="utf-8")
    assert text.count("part = root;") == 1
    source.write_text(text.replace("part = root;", "part = root + root;"), encoding="utf-8")
    assert [type(fault) for fault in faults()] == [FarStep, SelfTestFails]
