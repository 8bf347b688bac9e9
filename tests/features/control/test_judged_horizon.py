"""An exported moving-horizon estimator agrees with the one in Python, and a wrong one does not."""

from __future__ import annotations

from pathlib import Path

import pytest

from msnn.agreement.agreement import FarStep, SelfTestFails
from msnn.exports.export import plan_exports, write_export
from msnn.exports.running.built_c import built_folder
from msnn.features.control.export.judged_estimator import compare_horizon
from msnn.features.control.problem.state_estimation import EstimationProblem
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights
from spec_schema.diagnostics.diagnostic import Findings
from tests.conditions import require_tool
from tests.features.control.test_moving_horizon import BOUNDED, window


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_it_agrees_and_a_wrong_arrival_does_not(dtype: str, tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    path = tmp_path / "spec.msnn.yaml"
    path.write_text(window(BOUNDED, 6), encoding="utf-8")
    model = load_model(path, [f"export.mpc.dtype={dtype}"])
    (plan,) = plan_exports(model, ["mpc"], Findings())
    weights = initial_weights(model.program)
    written = write_export(plan, weights, tmp_path / "out")
    estimation = model.of(EstimationProblem)
    assert estimation is not None

    def faults() -> tuple[object, ...]:
        estimation = model.of(EstimationProblem)
        assert estimation is not None
        with built_folder(written, "controller.so") as folder:
            found = compare_horizon(estimation, weights, folder, plan.float_type, "mpc")
        return found.faults

    assert faults() == ()
    source = next(path for path in written.files if path.name.endswith("_mhe.c"))
    text = source.read_text(encoding="utf-8")
    assert text.count("part = root;") == 1
    source.write_text(text.replace("part = root;", "part = root + root;"), encoding="utf-8")
    assert [type(fault) for fault in faults()] == [FarStep, SelfTestFails]


WRONG = {
    "an estimate that is never called solved": (
        "keep_within(out->x);\n    return status",
        "out->x[0] += 0.5;\n    return {prefix}_CAPPED + 0 * status",
    ),
    "a standard deviation": ("out->std[i] = filtered.std[i];", "out->std[i] = 1;"),
    "a window that is stopped without a residual": (
        "keep_within(out->x);\n    return status",
        "out->residual = INFINITY;\n    return {prefix}_CAPPED + 0 * status",
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_not_compared_as_solved_is_compared(what: str, tmp_path: Path) -> None:
    """The self-test has bits of the C itself: what is wrong in all C, it does not find."""
    require_tool("gcc", install="apt install gcc")
    path = tmp_path / "spec.msnn.yaml"
    path.write_text(window(BOUNDED, 2), encoding="utf-8")
    model = load_model(path)
    (plan,) = plan_exports(model, ["mpc"], Findings())
    weights = initial_weights(model.program)
    written = write_export(plan, weights, tmp_path / "out")
    estimation = model.of(EstimationProblem)
    assert estimation is not None
    source = next(path for path in written.files if path.name.endswith("_mhe.c"))
    text = source.read_text(encoding="utf-8")
    right, wrong = WRONG[what]
    assert text.count(right) == 1
    wrong = wrong.replace("{prefix}", source.stem.upper())
    source.write_text(text.replace(right, wrong), encoding="utf-8")
    with built_folder(written, "controller.so") as folder:
        found = compare_horizon(estimation, weights, folder, plan.float_type, "mpc")
    assert FarStep in [type(fault) for fault in found.faults]
