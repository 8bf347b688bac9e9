"""What `validate` says of errors: what they correlate with, where they are large, unseen inputs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from msnn.validation.judged_errors import JudgedErrors, extrapolation, regions
from msnn.validation.reports.errors_report import judged_record, regions_table, residuals_table
from msnn.validation.validate import ValidationReport, validate
from tests.training.cases import compiled, dataset, gain, gain_series

TRUE = {"a": np.array(0.8), "b": np.array(0.3)}
LATE = {"a": np.array(0.8), "b": np.array(0.0)}
"""What u does one sample later is left to the errors."""


def measured(
    rollout: str, weights: dict[str, np.ndarray], noise: float = 0.0, reach: float = 1.0
) -> ValidationReport:
    program, spec = gain(more=f"validate:\n  - {{of: x_next, rollout: {rollout}}}\n")
    series = gain_series(2000)
    random = np.random.default_rng(1)
    series["x"] = series["x"] + noise * random.normal(size=2000)
    series["u"][1000:] *= reach
    return validate(program, dataset(series, train=[1000], test=[500, 500]), spec.checks, weights)


def judged(report: ValidationReport) -> JudgedErrors:
    (found,) = report.measurements
    return found.judged


def test_the_errors_of_the_true_model_are_noise():
    found = judged(measured("record", TRUE, noise=0.01))
    (residuals,) = found.residuals
    assert residuals.itself is not None
    assert residuals.itself.is_noise
    assert residuals.inputs["u"].is_noise
    assert "x" not in residuals.inputs, "it is fed back"


def test_an_input_that_the_model_leaves_out_is_found_at_its_lag():
    """Over the whole record the errors are those of the rollout: u acts for many samples."""
    one_step = measured("1", LATE)
    (residuals,) = judged(one_step).residuals
    assert residuals.inputs["u"].largest == (1, pytest.approx(-1.0, abs=0.01))
    free = measured("record", LATE)
    (residuals,) = judged(free).residuals
    assert len(residuals.inputs["u"].beyond) > 3
    text = residuals_table(free.measurements)
    assert "depends on u: what it does 1 sample later is not in the model" in text
    assert "not white: one error tells of the next, the model lacks memory or a state" in text


def test_errors_of_two_records_are_no_pairs():
    """Lags reach over the end of no record: both records' errors are constant, of other signs."""
    program, spec = gain(more="validate:\n  - {of: x_next}\n")
    series = gain_series(400)
    series["x"][:] = np.repeat([1.0, -1.0], 200) + 0.01 * np.random.default_rng(0).normal(size=400)
    data = dataset(series, test=[200, 200])
    weights = {"a": np.array(0.0), "b": np.array(0.0)}
    (residuals,) = judged(validate(program, data, spec.checks, weights)).residuals
    assert residuals.itself is not None
    assert np.all(residuals.itself.values > 0.99)


@pytest.mark.parametrize(
    ("gap", "lag"), [(3.0, 4), (3.2, 4), (np.nan, None), (-5.0, None), (1e9, None)]
)
def test_a_gap_inside_a_record_counts_as_the_samples_that_it_lacks(gap: float, lag: int | None):
    """Rows around a gap are two apart: the last and the first that are scored are equal."""
    program, spec = gain(more="validate:\n  - {of: x_next}\n")
    series = gain_series(800)
    series["x"][:] = np.random.default_rng(5).normal(size=800)
    series["x"][5::4] = series["x"][3:-4:4]
    breaks = np.arange(800) % 4 == 0
    steps = np.where(breaks, gap, 1.0)
    data = dataset(series, test=[800])
    (record,) = data.records
    time = None if np.isnan(gap) else np.cumsum(steps) * program.sample_time
    record = replace(record, pieces=(replace(record.pieces[0], time=time),))
    data = replace(data, records=(record,), continues=data.continues & ~breaks)
    weights = {"a": np.array(0.0), "b": np.array(0.0)}
    (found,) = judged(validate(program, data, spec.checks, weights)).residuals
    assert found.count == 600
    assert found.itself is not None
    strong = found.itself.lags[np.abs(found.itself.values) > 0.5]
    assert strong.tolist() == ([] if lag is None else [lag])
    if lag is not None:
        assert found.itself.values[lag - 1] > 0.9


def test_regions_are_quarters_of_an_input():
    """The error grows with the input: rmse by hand in each quarter."""
    values = np.arange(100.0)
    found = regions((0.1 * values) ** 2, values)
    assert [(r.low, r.high, r.scored) for r in found] == [
        (0, 24, 25), (25, 49, 25), (50, 74, 25), (75, 99, 25)
    ]  # fmt: skip
    assert found[0].rmse == pytest.approx(0.1 * np.sqrt(np.mean(values[:25] ** 2)))
    assert found[3].rmse == pytest.approx(0.1 * np.sqrt(np.mean(values[75:] ** 2)))


@pytest.mark.parametrize(
    ("values", "parts"),
    [
        (np.zeros(50), 0),
        (np.repeat([0.0, 1.0], 25), 2),
        (np.tile([0.0, 1.0, 2.0], 20), 2),
        (np.full(50, np.nan), 0),
        (np.zeros(0), 0),
    ],
)
def test_values_that_repeat_make_fewer_regions(values: np.ndarray, parts: int):
    found = regions(np.ones(len(values)), values)
    assert len(found) == parts
    assert sum(region.scored for region in found) == (len(values) if parts else 0)


def test_inputs_that_were_never_trained_are_told():
    inside, outside = measured("1", TRUE), measured("1", TRUE, reach=2.0)
    assert not judged(inside).extrapolations
    assert not inside.warnings
    (far,) = judged(outside).extrapolations
    assert far.signal == "u"
    assert 0.4 < far.share < 0.6
    assert [warning.code for warning in outside.warnings] == ["W1004"]
    assert f"{far.share:.1%} of the rows scored in `test`" in outside.warnings[0].message
    # a declared range changes nothing here
    assert outside.warnings[0].help == (
        "train on records that reach as far, or choose the sets by `split` under `data:` so that "
        "each has its share"
    )


def test_inputs_outside_of_the_training_rows_are_one_line_of_a_set():
    """Of several entries over one set and several inputs."""
    program, spec = compiled(
        "msnn: 1\nname: many\nsample_time: 1 s\ninputs: {u: 1, v: 1, w: 1}\ntargets: {y: 1}\n"
        "parameters: {k: 1}\noutputs: {z: {expr: k * (u + v + w), predicts: y}}\n"
        "validate: [{of: z}, {of: z, rollout: 10}, {of: z, metric: mae, rollout: record}]\n"
    )
    random = np.random.default_rng(1)
    series = {name: random.uniform(-1, 1, 400) for name in ("u", "v", "w", "y")}
    for name in ("u", "w"):
        series[name][200:] *= 4
    series["v"][200:] *= 0.9
    data = dataset(series, train=[200], test=[200])
    warning, worse = validate(program, data, spec.checks, {"k": np.array(1.0)}).warnings
    assert worse.code == "W0842"
    assert warning.code == "W1004"
    assert warning.message.startswith("in rows scored in `test` inputs are outside of what was ")
    assert warning.message.count("`u` in ") == warning.message.count("`w` in ") == 1
    assert "`v`" not in warning.message


def test_the_training_rows_are_inside_by_definition():
    program, spec = gain(more="validate:\n  - {of: x_next, data: train}\n")
    data = dataset(gain_series(200), train=[100], test=[100])
    assert not judged(validate(program, data, spec.checks, TRUE)).extrapolations


def test_a_range_is_left_by_more_than_rounding():
    trained = np.array([0.0, 1.0, np.nan])
    assert extrapolation("u", np.array([0.0, 1.0 + 1e-12]), trained) is None
    far = extrapolation("u", np.array([0.5, 1.1, np.nan, 2.0]), trained)
    assert far is not None
    assert (far.share, far.low, far.high) == (pytest.approx(2 / 3), 0.0, 1.0)
    assert extrapolation("u", np.ones(3), np.full(3, np.nan)) is None


def test_vector_inputs_and_outputs_are_judged_by_element():
    program, spec = compiled(
        """
msnn: 1
name: two
sample_time: 1 s
dims: {axis: 2}
inputs: {u: {dims: axis}, x: {dims: axis}}
parameters: {a: 0.5, b: 0}
outputs: {x_next: {expr: "a*x + b*u", predicts: "x[t+1]"}}
validate: [{of: x_next}]
"""
    )
    random = np.random.default_rng(0)
    u = random.normal(size=(600, 2))
    x = np.zeros((600, 2))
    for t in range(599):
        x[t + 1] = 0.5 * x[t] + u[t] * [1.0, 0.0] + 0.01 * random.normal(size=2)
    data = dataset({"u": u, "x": x}, test=[600])
    (found,) = validate(
        program, data, spec.checks, {"a": np.array(0.5), "b": np.array(0.0)}
    ).measurements
    first, second = found.judged.residuals
    assert (first.element, second.element) == ((0,), (1,))
    assert first.inputs["u[0]"].largest[0] == 1
    assert not first.inputs["u[0]"].is_noise
    assert second.inputs["u[0]"].is_noise
    assert set(found.judged.regions) == {"u[0]", "u[1]", "x[0]", "x[1]"}


def test_the_record_for_machines_has_what_the_tables_say():
    report = measured("record", LATE)
    record = judged_record(judged(report))
    (residuals,) = record["residuals"]
    assert residuals["inputs"]["u"]["verdict"] == "not noise"
    assert residuals["itself"]["lags"] == list(range(1, 26))
    assert len(record["regions"]["u"]) == 4
    assert regions_table(report.measurements).splitlines()[1].startswith("x_next, record")


def test_inputs_are_those_at_the_step_that_predicted():
    """Errors of -0.3 u[t] at the row t + 1: each quarter of u has them as large as its u."""
    (found,) = measured("1", LATE).measurements
    quarters = found.judged.regions["u"]
    assert len(quarters) == 4
    for quarter in quarters:
        ends = sorted((abs(quarter.low), abs(quarter.high)))
        nearest = 0.0 if quarter.low < 0 < quarter.high else ends[0]
        assert 0.3 * nearest <= quarter.rmse <= 0.3 * ends[1]
    rmse = found.metrics["rmse"].value
    assert max(quarter.rmse for quarter in quarters) > 1.2 * rmse


@pytest.mark.parametrize(("row", "share"), [(1000, 1 / 998), (1499, 0.0), (1999, 0.0)])
def test_what_no_step_has_read_is_not_beyond_the_training_range(row: int, share: float):
    """From the last row of a record nothing is predicted."""
    program, spec = gain(more="validate:\n  - {of: x_next, rollout: 1}\n")
    series = gain_series(2000)
    series["u"][row] = 1e3
    data = dataset(series, train=[1000], test=[500, 500])
    report = validate(program, data, spec.checks, TRUE)
    far = [each for each in judged(report).extrapolations if each.signal == "u"]
    # a new range is told from its first value on, of 998 that were scored
    assert [each.share for each in far if each.high < 1e3] == ([share] if share else [])


@pytest.mark.parametrize(("scale", "worse"), [(1.0, False), (-3.0, True)])
def test_a_model_that_is_worse_than_the_mean_of_the_training_rows_is_told(
    scale: float, worse: bool
):
    """A weight of the wrong sign; the mean is that of the rows of the training."""
    report = measured("record", {name: scale * value for name, value in TRUE.items()})
    (found,) = report.measurements
    x = gain_series(2000)["x"]
    constant = np.mean(x[:1000])
    assert found.mean.of == "training"
    assert found.mean.rmse == pytest.approx(np.sqrt(np.mean((x[1000:] - constant) ** 2)), rel=0.01)
    said = [warning.message for warning in report.warnings if warning.code == "W0842"]
    assert len(said) == worse
    if worse:
        assert "`x_next` is worse than predicting the mean: rmse " in said[0]
        assert "(rollout `record`, set `test`), the mean of the training rows has" in said[0]
