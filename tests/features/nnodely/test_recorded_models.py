"""Imported models predict what nnodely recorded, and every export has their numbers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import msnn
from tests.features.nnodely.recorded_model import (
    TOLERANCE,
    RecordedModel,
    deviations,
    imported,
    recorded,
)

LAYERS = recorded("layers")
DRAWN = recorded("drawn")
ROUNDED = {
    "arithmetic",
    "closed_ahead",
    "closed_loop_inside",
    "connected",
    "dropout",
    "functions",
    "own_fields",
    "plain_functions",
}
"""Models with numbers that single precision does not have, as 0.1 or a dropout of 1e-9."""


def _far(record: RecordedModel, folder: Path, engine: str = "interpreter") -> dict[str, float]:
    found = deviations(record, imported(record, folder), engine)
    return {name: far for name, far in found.items() if far > TOLERANCE}


@pytest.mark.parametrize("name", LAYERS)
def test_every_layer_predicts_as_nnodely_does(name: str, tmp_path: Path) -> None:
    assert _far(LAYERS[name], tmp_path) == {}


@pytest.mark.parametrize("name", [name for name in LAYERS if LAYERS[name].doubles])
def test_in_double_precision_every_layer_is_that_of_nnodely(name: str, tmp_path: Path) -> None:
    """Numbers of a formula are written with the digits of single precision, which the peer rounds
    them to: each is off by 6e-8 of itself at most, and they add up to less than twice that."""
    record = replace(LAYERS[name], outputs=LAYERS[name].doubles)
    allowed = 1.2e-7 if name in ROUNDED else 1e-15
    assert max(deviations(record, imported(record, tmp_path)).values()) <= allowed


@pytest.mark.parametrize("name", DRAWN)
def test_drawn_models_predict_as_nnodely_does(name: str, tmp_path: Path) -> None:
    assert _far(DRAWN[name], tmp_path) == {}


@pytest.mark.parametrize("name", ["closed_loop", "local_models", "plain_functions"])
def test_an_import_runs_on_an_export_at_once(name: str, tmp_path: Path) -> None:
    assert _far(LAYERS[name], tmp_path, "c") == {}


def _spec(name: str, folder: Path) -> str:
    return imported(LAYERS[name], folder).spec.read_text(encoding="utf-8")


def test_local_models_are_one_layer_again(tmp_path: Path) -> None:
    spec = _spec("local_models", tmp_path)
    assert spec.count("local_model:") == 3
    assert "o1: local(x.past(4))" in spec
    assert 'by: ["Fuzzify2(v)", "Fuzzify3(x)"]' in spec


def test_local_functions_are_one_formula_over_the_sets(tmp_path: Path) -> None:
    spec = _spec("local_functions", tmp_path)
    assert 'expr: "k * x + c"' in spec
    assert 'o1: "sum(one_cell(x, FParamFun4k, FParamFun4c) * Fuzzify2(v), over=dim4)"' in spec


def test_integrals_and_derivatives_are_calls_again(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    spec = _spec("integrals", tmp_path)
    assert "o1: integral(x)" in spec
    assert "o3: integral(integral(x))" in spec
    assert "method=trapezoidal" in spec
    assert "states:" not in spec
    assert "o4: integral(der(" in _spec("derivatives", tmp_path / "other")


def test_loops_are_closed_by_what_predicts(tmp_path: Path) -> None:
    spec = _spec("connected", tmp_path)
    assert 'predicts: "x[t+1]"' in spec
    assert 'expr: "x * 0.8 + u + u[t-1] * 0.1"' in spec
    assert "command: u" in spec


def test_losses_read_targets_that_the_step_does_not(tmp_path: Path) -> None:
    written = imported(LAYERS["losses"], tmp_path)
    spec = written.spec.read_text(encoding="utf-8")
    assert 'first: "mse(out, y[t+1])"' in spec
    model = msnn.load(written.spec)
    assert [loss.name for loss in model.program.losses] == ["first", "second", "third"]


def test_a_model_that_is_only_trained_has_what_its_loss_compares_as_output(tmp_path: Path) -> None:
    spec = _spec("only_trained", tmp_path)
    assert "outputs:\n  Add20: Fir16 + PLinear4(x)\n" in spec
    assert 'fit: "mse(target[t+1], Add20)"' in spec


@pytest.mark.parametrize(
    ("name", "code"),
    [
        ("closed_with_target", "W1303"),
        ("tables", "W1304"),
        ("names", "W1305"),
        ("closed_window", "W1307"),
        ("closed_ahead", "W1307"),
        ("dropout", "W1308"),
        ("fuzzy_sets", "W1309"),
    ],
)
def test_what_nnodely_does_otherwise_is_said(name: str, code: str, tmp_path: Path) -> None:
    assert code in {warning.code for warning in imported(LAYERS[name], tmp_path).warnings}
