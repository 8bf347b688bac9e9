"""Rules R2 and R9 of metrics: which rows are scored, in which unit, with which limit."""

from __future__ import annotations

import numpy as np
import pytest

from msnn.data.dataset import Dataset
from msnn.metrics import score
from msnn.validation import MetricRow, ValidationReport, validate
from spec_schema.diagnostics import SpecError
from tests.training.cases import compiled, dataset, gain, gain_series, in_blocks

TRUE = {"a": np.array(0.8), "b": np.array(0.3)}
HALF = {"a": np.array(0.5), "b": np.array(0.3)}


def measured(checks: str, data: Dataset, weights: dict[str, np.ndarray]) -> ValidationReport:
    program, spec = gain(more=f"validate:\n{checks}" if checks else "")
    return validate(program, data, spec.checks, weights)


def one(check: str, data: Dataset, weights: dict[str, np.ndarray] = HALF) -> MetricRow:
    (row,) = measured(f"  - {check}\n", data, weights).rows
    return row


def test_metrics_by_hand() -> None:
    prediction = np.array([1.0, 2.0, 5.0, 9.0])
    target = np.array([0.0, 2.0, 4.0, np.nan])
    expected = {
        "rmse": np.sqrt(2 / 3),
        "mae": 2 / 3,
        "max_abs": 1.0,
        "fvu": 2 / 8,
        "r2": 1 - 2 / 8,
        "fit": 100 * (1 - 0.5),
    }
    for metric, value in expected.items():
        found = score(metric, prediction, target)  # pyright: ignore[reportArgumentType]
        assert found.value == pytest.approx(value, rel=1e-15)
        assert found.count == 3


def test_reference_case_11_of_nnodely() -> None:
    """Its values, with n the number of scored elements; its FVU takes the variance of e instead."""
    prediction = np.array([0.0, 2.0, 4.0, 6.0, 8.0])
    target = np.array([0.5, 2.0, 3.5, 6.5, 8.0])
    assert score("rmse", prediction, target).value == pytest.approx(0.387298, abs=1e-6)
    assert score("mae", prediction, target).value == pytest.approx(0.3)
    assert score("aic", prediction, target, 1).value == pytest.approx(6.715964, abs=1e-6)
    missing = np.append(target, np.nan)
    assert score("aic", np.append(prediction, 9.0), missing, 1).value == pytest.approx(6.715964)


def test_vectors_have_a_metric_for_each_element() -> None:
    prediction = np.array([[1.0, 0.0], [1.0, 0.0]])
    found = score("rmse", prediction, np.zeros((2, 2)))
    assert found.elements.tolist() == [1.0, 0.0]
    assert found.value == pytest.approx(np.sqrt(0.5))


def test_r2_one_step_scores_every_row_that_has_a_past_and_says_which() -> None:
    data = dataset(gain_series(50), test=[50])
    row = one("{of: x_next}", data)
    assert (row.rows, row.scored) == ("rows 1…49 of 50", 49)
    x, u = data.series["x"], data.series["u"]
    error = 0.5 * x[:-1] + 0.3 * u[:-1] - x[1:]
    assert row.value == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-13)


def test_r2_rollouts_score_each_row_once() -> None:
    data = dataset(gain_series(50), test=[50])
    row = one("{of: x_next, rollout: 7 s}", data)
    assert (row.horizon, row.closed, row.scored) == ("7", ("x",), 49)
    x, u = data.series["x"], data.series["u"]
    errors: list[float] = []
    for t0 in range(0, 49, 7):
        state = x[t0]
        for t in range(t0, min(t0 + 7, 49)):
            state = 0.5 * state + 0.3 * u[t]
            errors.append(state - x[t + 1])
    assert row.value == pytest.approx(np.sqrt(np.mean(np.square(errors))), rel=1e-13)


def test_r4_skip_leaves_the_transient_out() -> None:
    data = dataset(gain_series(50), test=[50])
    row = one("{of: x_next, rollout: {horizon: 7, skip: 2}}", data)
    assert row.scored == 49 - 2 * 7  # seven rollouts


def test_r10_a_whole_record_is_simulated_and_only_the_set_is_scored() -> None:
    data = in_blocks(dataset(gain_series(60), train=[60]), "test", slice(20, 40))
    row = one("{of: x_next, rollout: record}", data)
    assert (row.rows, row.scored) == ("rows 20…39 of 60", 20)
    x, u = data.series["x"], data.series["u"]
    state, simulated = x[0], [x[0]]
    for t in range(59):
        state = 0.5 * state + 0.3 * u[t]
        simulated.append(state)
    error = np.array(simulated)[20:40] - x[20:40]
    assert row.value == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-13)


def test_several_records_are_counted() -> None:
    row = one("{of: x_next}", dataset(gain_series(50), test=[30, 20]))
    assert row.rows == "48 of 50 rows in 2 records"


def test_a_row_that_two_rollouts_score_is_one_row() -> None:
    data = dataset(gain_series(50), test=[50])
    row = one("{of: x_next, rollout: {horizon: 3, stride: 1}}", data)
    assert (row.rows, row.scored) == ("rows 1…49 of 50", 47 * 3)


def test_r9_a_missing_target_is_not_scored() -> None:
    program, spec = compiled(
        "msnn: 1\nname: p\nsample_time: 1 s\ninputs: {u: 1}\ntargets: {y: 1}\n"
        "parameters: {a: 0.5}\n"
        'outputs: {z: {expr: a*u, predicts: "y[t]"}}\nvalidate: [{of: z}]\n'
    )
    series = {"u": np.ones(10), "y": np.ones(10)}
    series["y"][3:5] = np.nan
    (row,) = validate(program, dataset(series, test=[10]), spec.checks, {"a": np.array(3.0)}).rows
    assert (row.value, row.scored) == (2.0, 8)


@pytest.mark.parametrize(
    ("check", "passed"),
    [
        ("{of: x_next, max: 1}", True),
        ("{of: x_next, max: 1 mm}", False),
        ("{of: x_next, max: 2 km}", True),
        ("{of: x_next, min: 2 km}", False),
        ("{of: x_next, metric: r2, min: 0.99}", False),
        ("{of: x_next, metric: fit, min: 10}", True),
        ("{of: x_next, metric: fit, min: 10 %}", True),
        ("{of: x_next, metric: fit, min: 99 %}", False),
        ("{of: x_next}", None),
    ],
)
def test_limits_are_compared_in_the_unit_of_the_metric(check: str, passed: bool | None) -> None:
    data = dataset(gain_series(50), test=[50])
    row = one(check, data)
    assert row.passed is passed
    report = measured(f"  - {check}\n", data, HALF)
    assert report.passed is (passed is not False)


def test_a_value_that_is_not_finite_breaks_its_limit() -> None:
    data = dataset(gain_series(50), test=[50])
    row = one("{of: x_next, max: 1}", data, {"a": np.array(np.nan), "b": np.array(0.0)})
    assert row.passed is False


def test_a_target_may_be_another_logged_sample() -> None:
    data = dataset(gain_series(50), test=[50])
    row = one('{of: x_next, target: "x[t+2 s]", metric: mae}', data, TRUE)
    assert row.rows == "rows 2…49 of 50"
    x, u = data.series["x"], data.series["u"]
    error = 0.8 * x[:-2] + 0.3 * u[:-2] - x[2:]
    assert row.value == pytest.approx(np.mean(np.abs(error)), rel=1e-13)


def test_a_loss_is_measured_under_its_name() -> None:
    program, spec = gain(
        more='losses: {gap: "mae(x_next, x[t+1])"}\nvalidate: [{of: gap, rollout: 5}]\n'
    )
    data = dataset(gain_series(51), test=[51])
    (row,) = validate(program, data, spec.checks, HALF).rows
    direct = measured("  - {of: x_next, metric: mae, rollout: 5}\n", data, HALF).rows[0]
    assert row.metric == "loss"
    assert row.value == pytest.approx(direct.value, rel=1e-12)


def test_a_loss_has_no_other_metric() -> None:
    program, spec = gain(
        more='losses: {gap: "mae(x_next, x[t+1])"}\nvalidate: [{of: gap, metric: r2}]\n'
    )
    with pytest.raises(SpecError, match="a loss is a number already"):
        validate(program, dataset(gain_series(50), test=[50]), spec.checks, HALF)


def test_sets_are_chosen_by_name_and_test_comes_first() -> None:
    data = dataset(gain_series(90), train=[30], val=[30], test=[30])
    assert one("{of: x_next}", data).data == "test"
    assert one("{of: x_next, data: val}", data).data == "val"
    assert one("{of: x_next}", dataset(gain_series(30), train=[30])).data == "train"


def test_without_entries_every_prediction_has_its_rmse() -> None:
    report = measured("", dataset(gain_series(50), test=[50]), TRUE)
    (row,) = report.rows
    assert (row.of, row.metric) == ("x_next", "rmse")
    assert row.value < 1e-14


@pytest.mark.parametrize(
    ("check", "code"),
    [
        ("{of: x_nxt}", "E0919"),
        ("{of: x_next, max: 1 kg}", "E0920"),
        ("{of: x_next, target: 2*x}", "E0917"),
        ("{of: x_next, target: nothing}", "E0917"),
        ("{of: x_next, data: val}", "E0820"),
        ("{of: x_next, rollout: {horizon: 2, close: [u]}}", "E0902"),
    ],
)
def test_faults_of_an_entry_have_a_code(check: str, code: str) -> None:
    with pytest.raises(SpecError) as caught:
        one(check, dataset(gain_series(50), test=[50]))
    assert [diagnostic.code for diagnostic in caught.value.diagnostics] == [code]
