"""Residual correlations: against the definition, at their false-alarm rates, on known faults."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from msnn.data.dataset import FloatArray, IntArray
from msnn.validation.statistics.correlations import (
    Correlation,
    dispersion,
    lags_of,
    most_beyond,
    residuals,
)


def judged(
    errors: FloatArray, inputs: dict[str, FloatArray] | None = None, lags: int = 25
) -> tuple[Correlation | None, dict[str, Correlation]]:
    rows = np.arange(len(errors))
    (found,) = residuals(errors, rows, np.zeros_like(rows), inputs or {}, lags)
    return found.itself, dict(found.inputs)


def by_definition(
    e: FloatArray, x: FloatArray, rows: IntArray, records: IntArray, lags: range
) -> list[float]:
    """Σ over pairs of one record, written out."""
    e, x = e - np.nanmean(e), x - np.nanmean(x)
    scale = math.sqrt(np.nanmean(e * e) * np.nanmean(x * x))
    found: list[float] = []
    for lag in lags:
        pairs = [
            e[i] * x[j]
            for i in range(len(e))
            for j in range(len(x))
            if rows[i] - rows[j] == lag and records[i] == records[j]
            if not math.isnan(e[i] * x[j])
        ]
        found.append(sum(pairs) / max(len(pairs), 1) / scale)
    return found


@given(st.integers(0, 2**32 - 1))
def test_correlations_are_those_of_the_definition(seed: int):
    generator = np.random.default_rng(seed)
    rows = np.sort(generator.choice(60, 50, replace=False))
    records = np.repeat([0, 1], [20, 30])
    e, x = generator.normal(3, 2, 50), generator.normal(-1, 5, 60)
    e[generator.choice(50, 5, replace=False)] = np.nan
    x[generator.choice(60, 5, replace=False)] = np.nan
    (found,) = residuals(e, rows, records, {"x": x[rows]}, 3)
    assert found.itself is not None
    assert found.itself.values == pytest.approx(by_definition(e, e, rows, records, range(1, 4)))
    expected = by_definition(e, x[rows], rows, records, range(-3, 4))
    both = np.concatenate([found.feedback["x"].values, found.inputs["x"].values])
    assert both == pytest.approx(expected, abs=1e-12)
    assert found.count == 45


def test_noise_is_called_noise():
    """Of 400 runs of noise against a slow input as few are accused as one lag in 100 allows."""
    generator = np.random.default_rng(1)
    accused = {"itself": 0, "u": 0}
    for _ in range(400):
        slow = np.convolve(generator.normal(size=1050), np.ones(50) / 50, "valid")[:1000]
        itself, inputs = judged(generator.normal(size=1000), {"u": slow})
        assert itself is not None
        accused["itself"] += not itself.is_noise
        accused["u"] += not inputs["u"].is_noise
    # 25 lags, one allowed: two or more beyond has a probability of 2.6 %
    assert accused["itself"] <= 20
    assert accused["u"] <= 20


@pytest.mark.parametrize(("rows", "of_record"), [(1000, 1000), (4000, 4000), (4400, 220)])
def test_noise_is_called_noise_at_many_lags(rows: int, of_record: int):
    """Two seconds of 100 Hz: of far lags few pairs are left, of short records fewest."""
    generator = np.random.default_rng(1)
    places, records = np.arange(rows), np.arange(rows) // of_record
    accused = {"itself": 0, "u": 0}
    for _ in range(200):
        errors, u = generator.normal(size=(2, rows))
        (found,) = residuals(errors, places, records, {"u": u}, 200)
        assert found.itself is not None
        accused["itself"] += not found.itself.is_noise
        accused["u"] += not found.inputs["u"].is_noise
    assert accused["itself"] <= 14
    assert accused["u"] <= 14


@pytest.mark.parametrize(
    ("rows", "lags", "memory"), [(2000, 200, 0.9), (2000, 200, 0.98), (20_000, 2000, 0.99)]
)
def test_noise_beside_a_slow_input_is_called_noise(rows: int, lags: int, memory: float):
    """Lags of a slow input leave the band in clumps, of which one alone is more than five lags."""
    from scipy.signal import lfilter  # a second to import, in each process that collects

    generator = np.random.default_rng(2)
    places = np.arange(rows)
    accused = missed = 0
    for _ in range(200):
        drawn = generator.normal(size=rows + 1000)
        u = np.asarray(lfilter([1.0], [1.0, -memory], drawn), np.float64)[1000:]
        errors = generator.normal(size=rows)
        caused = errors + 9 / math.sqrt(rows) * np.roll(u / u.std(), 7)
        (found,) = residuals(errors, places, np.zeros_like(places), {"u": u}, lags)
        accused += not found.inputs["u"].is_noise
        (found,) = residuals(caused, places, np.zeros_like(places), {"u": u}, lags)
        missed += found.inputs["u"].is_noise
    assert accused <= 10
    assert missed <= 10


def test_clumps_have_the_variance_of_normal_values_that_leave_a_band():
    """Against drawn values of a moving average, whose correlation falls on a line."""
    width, lags = 10, 400
    drawn = np.random.default_rng(1).normal(size=(4000, lags + width - 1))
    windows = np.lib.stride_tricks.sliding_window_view(drawn, width, axis=1)
    values = windows.sum(axis=2) / math.sqrt(width)
    number = np.sum(np.abs(values) > 2.5758293, axis=1)
    white = np.zeros(lags + 1)
    white[0] = 1.0
    falling = np.maximum(1.0 - np.arange(lags + 1) / width, 0.0)
    wanted = float(np.var(number)) / (lags * 0.01 * 0.99)
    assert dispersion(white, falling, 2.5758293, 0.01) == pytest.approx(wanted, rel=0.1)
    assert dispersion(white, white, 2.5758293, 0.01) == pytest.approx(1.0)
    most = most_beyond(lags, wanted, 0.01, 0.03)
    assert np.mean(number > most) <= 0.035 < np.mean(number > most - 3)


def test_lags_are_no_more_than_a_quarter_of_the_values():
    """Two seconds of a converter are more samples than it has."""
    errors = np.random.default_rng(9).normal(size=(2000, 2))
    errors[200:, 1] = np.nan
    rows = np.arange(2000)
    found = residuals(errors, rows, np.zeros_like(rows), {"u": np.sin(rows)}, 20000)
    assert [len(each.itself.lags) for each in found if each.itself] == [500, 50]
    assert [each.inputs["u"].lags[-1] for each in found] == [500, 50]


def test_the_band_is_wider_where_fewer_pairs_are():
    errors = np.random.default_rng(9).normal(size=300)
    (found,) = residuals(errors, np.arange(300), np.arange(300) // 60, {}, 25)
    assert found.itself is not None
    # at lag k each of five records has 60 - k pairs
    pairs = 300 - 5 * np.arange(1, 26)
    assert found.itself.bands == pytest.approx(2.5758293 / np.sqrt(300) * np.sqrt(300 / pairs))


def test_errors_with_memory_are_not_white():
    generator = np.random.default_rng(2)
    error = np.zeros(2000)
    for t in range(1, 2000):
        error[t] = 0.3 * error[t - 1] + generator.normal()
    itself, _ = judged(error)
    assert itself is not None
    assert not itself.is_noise
    assert itself.largest == (1, pytest.approx(0.3, abs=0.06))


def test_what_an_input_does_later_is_found_at_its_lag():
    generator = np.random.default_rng(3)
    u = generator.normal(size=3000)
    error = generator.normal(size=3000) + 0.2 * np.roll(u, 4)
    _, inputs = judged(error, {"u": u, "other": generator.normal(size=3000)})
    assert not inputs["u"].is_noise
    assert inputs["u"].largest[0] == 4
    assert inputs["u"].beyond.tolist()[-1] >= 4
    assert inputs["other"].is_noise


def test_an_input_that_follows_the_output_is_feedback_and_no_fault():
    generator = np.random.default_rng(7)
    error = generator.normal(size=3000)
    u = generator.normal(size=3000) + 0.5 * np.roll(error, 2)
    rows = np.arange(3000)
    (found,) = residuals(error, rows, np.zeros_like(rows), {"u": u}, 25)
    assert found.inputs["u"].is_noise
    assert not found.feedback["u"].is_noise
    assert found.feedback["u"].largest[0] == -2


def test_two_records_are_not_one():
    """Errors that are constant within a record and jump between them are correlated in both."""
    generator = np.random.default_rng(4)
    first, second = generator.normal(size=500), generator.normal(size=500)
    both = np.concatenate([first, second])
    rows, records = np.arange(1000), np.repeat([0, 1], 500)
    (apart,) = residuals(both, rows, records, {}, 25)
    (together,) = residuals(both, rows, np.zeros_like(records), {}, 25)
    assert apart.itself is not None
    assert together.itself is not None
    assert not np.allclose(apart.itself.values, together.itself.values, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    "errors",
    [
        np.zeros(1000),
        np.full(1000, np.nan),
        np.ones(50),
        np.zeros(0),
        np.full(1000, np.inf),
        1e200 * np.cos(np.arange(1000)),  # of a model that diverged: squares are no numbers
    ],
)
def test_of_too_little_nothing_is_said(errors: FloatArray):
    itself, inputs = judged(errors, {"u": np.ones(len(errors))})
    assert itself is None
    assert not inputs


def test_inputs_that_do_not_vary_are_left_out():
    errors = np.random.default_rng(5).normal(size=1000)
    assert not judged(errors, {"u": np.ones(1000)})[1]


def test_every_element_of_a_vector_is_judged():
    generator = np.random.default_rng(6)
    errors = generator.normal(size=(1000, 2, 3))
    errors[:, 1, 2] = np.cumsum(errors[:, 1, 2])
    rows = np.arange(1000)
    found = residuals(errors, rows, np.zeros_like(rows), {}, 25)
    assert [each.element for each in found] == list(np.ndindex(2, 3))
    accused = [each.element for each in found if each.itself and not each.itself.is_noise]
    assert (1, 2) in accused
    assert len(accused) <= 2


def test_lags_are_25_samples_or_two_seconds():
    assert [lags_of(None), lags_of(0.1), lags_of(0.01)] == [25, 25, 200]


def test_errors_and_inputs_with_memory_have_the_band_of_bartlett():
    rng = np.random.default_rng(3)
    n, memory = 40_000, 0.9
    both = np.zeros((n, 2))
    for t in range(1, n):
        both[t] = memory * both[t - 1] + rng.standard_normal(2)
    (found,) = residuals(both[:, 0], np.arange(n), np.zeros(n, np.int64), {"u": both[:, 1]}, 50)
    # P = Σ a^|k| a^|k| over all lags; estimated from n values it has a deviation of some 6 %
    wanted = n * (1 - memory**2) / (1 + memory**2)
    assert found.inputs["u"].effective == pytest.approx(wanted, rel=0.2)


def test_the_band_is_that_of_as_many_values_as_there_are():
    """2.5758 deviations hold 99 % of a normal distribution."""
    rng = np.random.default_rng(8)
    error, u = np.zeros(1000), np.zeros(1000)
    for t in range(1, 1000):
        error[t] = 0.6 * error[t - 1] + rng.standard_normal()
        u[t] = 0.8 * u[t - 1] + rng.standard_normal()
    error[rng.choice(1000, 400, replace=False)] = np.nan
    u[rng.choice(1000, 100, replace=False)] = np.nan
    itself, inputs = judged(error, {"u": u})
    of_input, _ = judged(u)
    assert itself is not None
    assert of_input is not None
    assert itself.band == pytest.approx(2.5758293 / math.sqrt(600), rel=1e-7)
    # Σ over lags of both signs, 1 at lag 0; what is there in both is a pair
    memory = 1 + 2 * float(itself.values @ of_input.values)
    pairs = int(np.sum(np.isfinite(error) & np.isfinite(u)))
    assert inputs["u"].effective == pytest.approx(pairs / memory, rel=1e-12)
    band = 2.5758293 / math.sqrt(pairs / memory)
    assert inputs["u"].band == pytest.approx(band, rel=1e-7)


@pytest.mark.parametrize(
    ("lags", "beyond", "is_noise"),
    [
        (25, [0.12], True),
        (25, [0.12, -0.12], False),  # one of 25 is allowed, not two
        # of 101 more than 2 leave it 8 % of the time, more than 3 2 %
        (101, [0.12, -0.12, 0.11], True),
        (101, [0.12, 0.11, 0.12, 0.11], False),
        # of 25 lags together 3.5401 deviations hold 99 %: 3.5401 / 2.5758 of the band
        (25, [-0.1374], True),
        (25, [0.1375], False),
    ],
)
def test_noise_leaves_the_band_at_few_lags_and_never_by_far(
    lags: int, beyond: list[float], is_noise: bool
):
    values = np.full(lags, 0.09)
    values[3 : 3 + len(beyond)] = beyond
    found = Correlation(
        lags=np.arange(1, lags + 1),
        values=values,
        band=0.1,
        shares=np.ones(lags),
        effective=663.5,
    )
    assert found.is_noise == is_noise
    assert found.beyond.tolist() == list(range(4, 4 + len(beyond)))
