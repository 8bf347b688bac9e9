"""Rules R2 and R9 of metrics: which rows are scored, in which unit, with which limit."""

from __future__ import annotations

import numpy as np
import pytest

from msnn.data.dataset import Dataset
from msnn.validation.measurement import METRICS, CurveSums, ErrorCurve, ErrorRange, ErrorTrace
from msnn.validation.reports.report import curves_table, metrics_record
from msnn.validation.statistics.metrics import Errors, score
from msnn.validation.validate import MetricRow, ValidationReport, validate
from spec_schema.diagnostics.diagnostic import SpecError
from tests.training.cases import compiled, dataset, gain, gain_series, in_blocks

TRUE = {"a": np.array(0.8), "b": np.array(0.3)}
HALF = {"a": np.array(0.5), "b": np.array(0.3)}


def measured(checks: str, data: Dataset, weights: dict[str, np.ndarray]) -> ValidationReport:
    program, spec = gain(more=f"validate:\n{checks}" if checks else "")
    return validate(program, data, spec.checks, weights)


def one(check: str, data: Dataset, weights: dict[str, np.ndarray] = HALF) -> MetricRow:
    (row,) = measured(f"  - {check}\n", data, weights).rows
    return row


def error_curve(
    prediction: np.ndarray, target: np.ndarray, number: np.ndarray
) -> ErrorCurve | None:
    sums = CurveSums(0, int(number.max()) + 1, len(number), few=False)
    sums.add(prediction, target, number)
    return sums.curve()


def error_trace(prediction: np.ndarray, target: np.ndarray) -> ErrorTrace:
    found = ErrorRange(len(prediction))
    found.add(prediction, target, np.arange(len(prediction)))
    return found.trace()


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
        found = score(metric, Errors.of(prediction, target))  # pyright: ignore[reportArgumentType]
        assert found.value == pytest.approx(value, rel=1e-15)
        assert found.count == 3


def test_reference_case_11_of_nnodely() -> None:
    """Its values, with n the number of scored elements; its FVU takes the variance of e instead."""
    prediction = np.array([0.0, 2.0, 4.0, 6.0, 8.0])
    target = np.array([0.5, 2.0, 3.5, 6.5, 8.0])
    assert score("rmse", Errors.of(prediction, target)).value == pytest.approx(0.387298, abs=1e-6)
    assert score("mae", Errors.of(prediction, target)).value == pytest.approx(0.3)
    assert score("aic", Errors.of(prediction, target), 1).value == pytest.approx(6.715964, abs=1e-6)
    missing = np.append(target, np.nan)
    longer = np.append(prediction, 9.0)
    assert score("aic", Errors.of(longer, missing), 1).value == pytest.approx(6.715964)


def test_vectors_have_a_metric_for_each_element() -> None:
    prediction = np.array([[1.0, 0.0], [1.0, 0.0]])
    found = score("rmse", Errors.of(prediction, np.zeros((2, 2))))
    assert found.elements.tolist() == [1.0, 0.0]
    assert found.value == pytest.approx(np.sqrt(0.5))


def test_one_step_scores_every_row_that_has_a_past_and_says_which() -> None:
    """docs/language.md, Rollouts (R2)."""
    data = dataset(gain_series(50), test=[50])
    row = one("{of: x_next}", data)
    assert (row.rows, row.scored) == ("rows 1…49 of 50", 49)
    x, u = data.series["x"], data.series["u"]
    error = 0.5 * x[:-1] + 0.3 * u[:-1] - x[1:]
    assert row.value == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-13)


def test_rollouts_score_each_row_once() -> None:
    """docs/language.md, Rollouts (R2)."""
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


def test_skip_leaves_the_transient_out() -> None:
    """docs/language.md, Rollouts (R4)."""
    data = dataset(gain_series(50), test=[50])
    row = one("{of: x_next, rollout: {horizon: 7, skip: 2}}", data)
    assert row.scored == 49 - 2 * 7  # seven rollouts


def test_a_whole_record_is_simulated_and_only_the_set_is_scored() -> None:
    """docs/language.md, Data (R10)."""
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


def test_a_missing_target_is_not_scored() -> None:
    """docs/language.md, Losses (R9)."""
    program, spec = compiled(
        "msnn: 1\nname: p\nsample_time: 1 s\ninputs: {u: 1}\ntargets: {y: 1}\n"
        "parameters: {a: 0.5}\n"
        'outputs: {z: {expr: a*u, predicts: "y[t]"}}\nvalidate: [{of: z}]\n'
    )
    series = {"u": np.ones(10), "y": np.ones(10)}
    series["y"][3:5] = np.nan
    (row,) = validate(program, dataset(series, test=[10]), spec.checks, {"a": np.array(3.0)}).rows
    assert (row.value, row.scored) == (2.0, 8)
    assert row.rows == "8 of rows 0…9 of 10"


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


def test_the_error_is_known_at_every_step_of_a_rollout() -> None:
    data = dataset(gain_series(50), test=[50])
    (found,) = measured(
        "  - {of: x_next, rollout: {horizon: 7, skip: 2}}\n", data, HALF
    ).measurements
    x, u = data.series["x"], data.series["u"]
    errors: dict[int, list[float]] = {}
    for t0 in range(0, 49, 7):
        state = x[t0]
        for k in range(1, 8):
            state = 0.5 * state + 0.3 * u[t0 + k - 1]
            errors.setdefault(k, []).append(state - x[t0 + k])
    assert found.curve is not None
    assert found.curve.first.tolist() == found.curve.last.tolist() == [3, 4, 5, 6, 7]
    assert found.curve.scored.tolist() == [7] * 5
    expected = [np.sqrt(np.mean(np.square(errors[k]))) for k in range(3, 8)]
    np.testing.assert_allclose(found.curve.rmse, expected, rtol=1e-13)


def test_the_curve_of_a_record_has_points_of_about_twenty_samples() -> None:
    data = dataset(gain_series(121), test=[61, 60])
    (found,) = measured("  - {of: x_next, rollout: record}\n", data, HALF).measurements
    curve = found.curve
    assert curve is not None
    assert (curve.first[0], curve.last[-1]) == (1, 60)
    assert curve.first[1:].tolist() == (curve.last[:-1] + 1).tolist()
    assert curve.scored.tolist() == [24, 24, 24, 24, 23]
    total = np.sum(curve.rmse**2 * curve.scored) / np.sum(curve.scored)
    assert np.sqrt(total) == pytest.approx(found.metrics["rmse"].value, rel=1e-13)


def test_one_step_has_no_curve() -> None:
    (found,) = measured("", dataset(gain_series(50), test=[50]), TRUE).measurements
    assert found.curve is None


def test_the_trace_keeps_the_extremes_and_leaves_gaps_out() -> None:
    prediction = np.zeros(1000)
    target = np.sin(np.arange(1000.0))
    target[100:300] = np.nan
    found = error_trace(prediction, target)
    assert len(found.sample) == 200
    assert (found.low.min(), found.high.max()) == (-np.nanmax(target), -np.nanmin(target))
    assert found.sample[-1] == 796
    assert len(error_trace(prediction, np.full(1000, np.nan)).sample) == 0


def test_predictions_that_leave_the_numbers_show_in_the_curve() -> None:
    target = np.zeros(6)
    target[2] = np.nan
    number = np.array([0, 1, 2, 0, 1, 2])
    prediction = np.array([1.0, 1e200, 5.0, 1.0, 2.0, np.nan])
    curve = error_curve(prediction, target, number)
    assert curve is not None
    assert curve.scored.tolist() == [2, 2, 1]
    assert curve.rmse[:2].tolist() == [1.0, np.inf]
    assert np.isnan(curve.rmse[2])
    assert error_curve(prediction, np.full(6, np.nan), number) is None
    trace = error_trace(prediction, target)
    assert trace.high.tolist() == [1.0, 1e200, 1.0, 2.0]


def test_every_metric_is_measured_once_for_each_way_to_simulate() -> None:
    checks = (
        "  - {of: x_next, max: 1}\n  - {of: x_next, metric: fit, min: 1}\n"
        "  - {of: x_next, rollout: 7}\n  - {of: x_next, metric: aic, rollout: 7}\n"
    )
    report = measured(checks, dataset(gain_series(50), test=[50]), HALF)
    assert [found.horizon for found in report.measurements] == ["1", "7"]
    for row in report.rows:
        (found,) = (found for found in report.measurements if found.horizon == row.horizon)
        assert found.metrics[row.metric].value == row.value  # pyright: ignore[reportArgumentType]
    assert set(report.measurements[0].metrics) == set(METRICS)


def test_the_tables_read_curves_at_round_steps_and_at_their_end() -> None:
    checks = "  - {of: x_next, rollout: 7}\n  - {of: x_next, rollout: 12}\n"
    report = measured(checks, dataset(gain_series(50), test=[50]), HALF)
    header, first, second = curves_table(report).splitlines()
    assert " ".join(header.split()) == "rmse at step 1 2 5 7 10 12 unit rollout data"
    way = len("m 7 steps, closing x test".split())  # noqa: SIM905  (how it is printed)
    assert [len(line.split()) for line in (first, second)] == [1 + 4 + way, 1 + 5 + way]
    (record, _) = metrics_record(report)["outputs"]
    assert record["curve"]["first"] == list(range(1, 8))
    assert record["metrics"]["rmse"] == report.rows[0].value
    late = in_blocks(dataset(gain_series(60), train=[60]), "test", slice(20, 60))
    header = curves_table(measured("  - {of: x_next, rollout: record}\n", late, HALF)).split()
    assert header[3:6] == ["20", "50", "unit"]  # 20 … 39 and 40 … 59 are of the set
    one_step = measured("", dataset(gain_series(50), test=[50]), HALF)
    assert curves_table(one_step) == ""
    assert metrics_record(one_step)["outputs"][0]["curve"] is None


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
