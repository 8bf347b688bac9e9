"""What a column shows by itself, on series whose faults are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from msnn.data.dataset import FileRows, FloatArray
from msnn.features.data_check.sampling import StepsOfTime, sampling_of
from msnn.features.data_check.signals import check_series, doubt, quantisation, saturation, spikes
from spec_schema.units.parser import parse_unit
from tests.features.data_check.systems import first_order, follows, held

SLOW = np.sin(0.003 * np.arange(20_000))


def noise(rows: int, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).normal(size=rows)


@pytest.mark.parametrize("seed", range(3))
def test_clean_noise_of_a_hundred_thousand_rows_has_no_spike(seed: int):
    """A false alarm in a hundred such records is allowed; these three have none."""
    assert len(spikes(noise(100_000, seed), follows(100_000))) == 0


@pytest.mark.parametrize("width", [1, 2, 3])
def test_all_spikes_are_found_with_their_rows(width: int):
    values = 0.1 * noise(100_000) + np.sin(0.01 * np.arange(100_000))
    rows = [10, 500, 5_000, 50_000, 99_990]
    for row, height in zip(rows, (3, -3, 4, -5, 3), strict=True):
        values[row : row + width] += height
    found = spikes(values, follows(100_000))
    assert found.rows.tolist() == rows
    assert found.heights == pytest.approx([3, 3, 4, 5, 3], abs=0.5)  # noise of 0.1 at both ends


@pytest.mark.parametrize(
    "values",
    [
        held(5_000),
        np.sign(noise(5_000)),
        np.repeat(noise(2_000), 2),
        first_order(held(5_000), 5, 0),
        np.cumsum(noise(20_000)),
        SLOW,
        np.round(SLOW, 1),
    ],
    ids=["steps", "random telegraph", "short steps", "a filter", "a walk", "a wave", "rounded"],
)
def test_signals_that_jump_or_move_have_no_spikes(values: FloatArray):
    assert len(spikes(values, follows(len(values)))) == 0


def test_a_spike_in_a_signal_of_steps_is_found_if_it_is_higher_than_these():
    values = held(2_000)
    values[[300, 1_500]] += 12
    assert spikes(values, follows(2_000)).rows.tolist() == [300, 1_500]


def test_a_jump_between_records_is_no_spike():
    values = 0.1 * noise(200)
    values[100:101] += 50
    apart = follows(200)
    apart[[100, 101]] = False
    assert len(spikes(values, apart)) == 0


def test_saturation_at_both_ends():
    found = saturation(np.clip(SLOW, -0.8, 0.9), follows(20_000))
    assert [(one.side, one.value) for one in found] == [("largest", 0.9), ("smallest", -0.8)]
    # a quarter period beyond 0.9: (π − 2 asin 0.9) / 0.003 rows
    assert found[0].longest == pytest.approx((np.pi - 2 * np.arcsin(0.9)) / 0.003, abs=1)
    assert SLOW[found[0].first] >= 0.9 > SLOW[found[0].first - 1]


@pytest.mark.parametrize("bits", [3, 5, 8, 12])
def test_the_rounded_top_of_a_wave_is_not_saturation(bits: int):
    step = 2 / 2**bits
    for values in (np.round(SLOW / step) * step, np.floor(0.97 * SLOW / step) * step):
        assert saturation(values, follows(20_000)) == ()


@pytest.mark.parametrize(
    "values", [held(5_000), np.sign(noise(5_000)), noise(5_000), SLOW], ids=str
)
def test_signals_that_nothing_cuts(values: FloatArray):
    assert saturation(values, follows(len(values))) == ()


def test_twelve_bits_are_twelve_bits():
    step = 20 / 4096
    found = quantisation(np.round(10 * SLOW / step) * step)
    assert found is not None
    assert found.step == pytest.approx(step, rel=1e-9)
    assert found.bits == pytest.approx(12, abs=0.001)  # both ends of the span are values
    assert found.share == pytest.approx(step / np.sqrt(12) / (10 / np.sqrt(2)), rel=0.01)


def test_steps_that_were_printed_with_few_digits_are_found():
    step = 10 / 4096
    printed = np.array([float(f"{v:.4f}") for v in np.round(SLOW / step) * step])
    found = quantisation(printed)
    assert found is not None
    assert found.step == pytest.approx(step, rel=1e-3)


def test_numbers_of_full_precision_have_no_step():
    assert quantisation(noise(5_000)) is None


def test_missing_values_are_counted_with_their_longest_run():
    values = noise(100)
    values[[3, 50, 51, 52, 99]] = np.nan
    found = check_series(values, follows(100), np.isnan(values))
    assert (found.missing, found.first_missing, found.longest_missing) == (5, 3, 3)


def sampled(times: list[float]) -> StepsOfTime:
    rows = range(10, 10 + len(times))
    piece = FileRows(file="a.csv", start=0, stop=len(times), rows=rows, time=np.array(times))
    found = sampling_of(piece)
    assert found is not None
    return found


def test_gaps_repeats_and_steps_back_are_told_with_rows_of_the_file():
    found = sampled([0.0, 0.1, 0.2, 0.9, 1.0, 1.0, 1.1, 0.5, 0.6])
    assert found.step == pytest.approx(0.1)
    assert (found.gaps, found.repeated, found.backward) == ((13,), (15,), (17,))
    assert (found.longest, found.longest_row) == (pytest.approx(0.7), 13)


def test_jitter_is_that_of_steps_that_are_no_gaps():
    random = np.random.default_rng(0)
    times = np.cumsum(0.1 + 0.002 * random.normal(size=5_000))
    times[2_000:] += 7
    found = sampled(times.tolist())
    assert found.jitter == pytest.approx(0.02, rel=0.1)  # a deviation of 5,000 numbers: 1 %
    assert len(found.gaps) == 1


@pytest.mark.parametrize(
    ("unit", "low", "high", "rather"),
    [
        ("rad", -170, 175, "deg"),
        ("rad", -3, 3, None),
        ("rad", 0, 5_000, None),  # a wheel that turns
        ("K", 15, 40, "degC"),
        ("K", 280, 320, None),
        ("degC", 285, 310, "K"),
        ("Pa", 0.9, 2.4, "bar"),
        ("m", -1, 1, None),
    ],
)
def test_units_that_are_doubted(unit: str, low: float, high: float, rather: str | None):
    found = doubt(parse_unit(unit), low, high)
    assert (None if found is None else found[0]) == rather


ANY = st.one_of(st.just(np.nan), st.floats(-1e9, 1e9), st.sampled_from([0.0, 1.0, 50.0]))


@given(arrays(np.float64, st.integers(0, 60), elements=ANY))
@settings(max_examples=200, deadline=None)
def test_no_series_breaks_the_checks(values: FloatArray):
    found = check_series(values, follows(len(values)), np.isnan(values))
    assert found.missing == np.sum(~np.isfinite(values))
    assert all(0 <= row < len(values) for row in found.spikes.rows.tolist())
    for limit in found.saturations:
        assert np.all(values[limit.first : limit.first + limit.longest] == limit.value)


@given(arrays(np.float64, st.integers(0, 20), elements=st.floats(-1e6, 1e6)))
@settings(max_examples=100, deadline=None)
def test_no_times_break_the_sampling(times: FloatArray):
    found = sampled(times.tolist())
    assert len(found.repeated) + len(found.backward) == np.sum(np.diff(times) <= 0)


@given(st.floats(1e-3, 1e3), st.floats(-1e3, 1e3), st.integers(2, 10))
@settings(max_examples=50, deadline=None)
def test_what_is_found_does_not_depend_on_units(factor: float, offset: float, bits: int):
    """Steps scale with the unit, places stay. Offsets are as large as the signal at most."""
    step = 2 / 2**bits
    values = np.round(np.clip(SLOW[:8_000] + 1e-3 * noise(8_000), -0.7, 0.7) / step) * step
    values[4_000] += 9
    here = check_series(values, follows(8_000), np.isnan(values))
    there = check_series(factor * (values + offset * 1e-3), follows(8_000), np.isnan(values))
    assert there.spikes.rows.tolist() == here.spikes.rows.tolist() == [4_000]
    assert here.quantisation is not None
    assert there.quantisation is not None
    assert there.quantisation.step == pytest.approx(factor * here.quantisation.step, rel=1e-6)
