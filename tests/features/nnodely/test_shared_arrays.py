"""Arrays that nnodely shares among layers and formulas are one parameter of the spec."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import msnn
from msnn.api.models import import_nnodely
from tests.features.nnodely.saved_model import imported_text, saved

FORMULA = "def f(x, w, b):\n    return torch.matmul(x, w) + b\n"


def shared(weights: np.ndarray[Any, np.dtype[np.float64]], offset: list[float]) -> dict[str, Any]:
    """A `Linear` and a function of the same arrays, added."""
    size, out = weights.shape
    function = {"code": FORMULA, "name": "f", "params_and_consts": ["W", "b"]}
    return saved(
        Inputs={"x": {"dim": size, "sw": [-1, 0]}},
        Constants={},
        Parameters={
            "W": {"dim": [size, out], "values": weights.tolist()},
            "b": {"dim": out, "values": offset},
        },
        Functions={"FParamFun1": {**function, "map_over_dim": False}},
        Relations={
            "now": ["SamplePart", ["x"], -1, [-1, 0]],
            "layer": ["Linear", ["now"], "W", "b", 0],
            "formula": ["ParamFun", ["now"], "FParamFun1"],
            "y": ["Add", ["layer", "formula"]],
        },
    )


@pytest.mark.parametrize(("size", "out"), [(3, 2), (3, 1), (3, 3), (1, 2)])
def test_a_linear_and_a_formula_compute_with_one_matrix(
    size: int, out: int, tmp_path: Path
) -> None:
    draw = np.random.default_rng(size * 10 + out)
    weights, offset = draw.normal(size=(size, out)), draw.normal(size=out)
    file = tmp_path / "model.json"
    file.write_text(json.dumps(shared(weights, offset.tolist())), encoding="utf-8")
    written = import_nnodely(file)
    copies = [warning.message.split("`")[1] for warning in written.warnings]
    assert [warning.code for warning in written.warnings] == ["W1205"] * len(copies)
    if 1 < size != out:
        assert (copies, set(written.model.weights)) == ([], {"W", "b"})
    else:
        assert copies == ["W"]
    x = draw.normal(size=(4, size))
    model = msnn.load(written.spec)
    (run,) = msnn.simulate(model, {"x": x if size > 1 else x[:, 0]}, written.weights)
    found = run.outputs["out"].reshape(4, out)
    np.testing.assert_allclose(found, 2.0 * (x @ weights + offset), rtol=1e-12)


def test_two_layers_of_one_square_matrix_leave_no_parameter_unused() -> None:
    """Each has its own, and the spec no third one that nothing reads."""
    model = shared(np.eye(3), [0.0, 0.0, 0.0])
    model["Relations"]["formula"] = ["Linear", ["now"], "W", None, 0]
    found = imported_text(model)
    assert [warning.code for warning in found.warnings] == ["W1205"]
    assert "W" not in found.spec.get("parameters", {})
