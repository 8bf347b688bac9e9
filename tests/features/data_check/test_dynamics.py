"""What columns show together, on systems whose delays and time constants are known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats
from scipy.signal import lfilter

from msnn.data.dataset import FloatArray
from msnn.features.data_check.dynamics.arx import feedback
from msnn.features.data_check.dynamics.check import TargetCheck, check_inputs, check_target
from msnn.features.data_check.dynamics.distributions import f_survival
from msnn.features.data_check.dynamics.excitation import Excitation, excitation
from msnn.features.data_check.dynamics.impulse_response import FALSE_ALARMS, power_series, responses
from msnn.features.data_check.dynamics.influence import SIGNIFICANCE, influences
from msnn.features.data_check.dynamics.orders import proposed_orders
from msnn.features.data_check.dynamics.pieces import Piece, pieces_of
from tests.features.data_check.systems import first_order, follows, held, multisine, noisy

ROWS = 4_000
INPUTS = {"white": np.random.default_rng(0).normal(size=ROWS), "steps": held(ROWS)}


def checked(y: FloatArray, *inputs: FloatArray) -> TargetCheck:
    table = np.stack(inputs, axis=1)
    about = check_inputs(table, follows(len(y)), [None] * len(inputs))
    return check_target(y, table, follows(len(y)), about)


@pytest.mark.parametrize("name", INPUTS)
@pytest.mark.parametrize("delay", [0, 1, 3, 10])
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_the_delay_is_found(name: str, delay: int, noise: float):
    y = noisy(first_order(INPUTS[name], 20, delay), noise)
    assert checked(y, INPUTS[name]).delays == (delay,)


@pytest.mark.parametrize("name", INPUTS)
@pytest.mark.parametrize("constant", [5, 20, 80, 300])
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_the_time_constant_is_found_to_a_tenth(name: str, constant: int, noise: float):
    """Of 300 rows, it takes means of 16 rows; the record has 13 time constants."""
    found = checked(noisy(first_order(INPUTS[name], constant, 1), noise), INPUTS[name]).constants
    assert found is not None
    assert found.slowest == pytest.approx(constant, rel=0.1)


@pytest.mark.parametrize("hold", [1, 20])
@pytest.mark.parametrize("delay", [0, 3, 12])
@pytest.mark.parametrize("constants", [(40,), (100, 20), (200, 8)])
def test_modes_are_those_of_the_system_also_of_means(
    hold: int, delay: int, constants: tuple[int, ...]
):
    """Means of rows begin to respond before they decay, which is no mode; they hide fast ones."""
    u = np.repeat(np.random.default_rng(3).normal(size=3_000 // hold), hold)
    shares = (0.6, 0.4)[: len(constants)]
    y = sum(
        (share * first_order(u, one, delay) for share, one in zip(shares, constants, strict=True)),
        np.zeros(len(u)),
    )
    found = checked(noisy(y, 0.01), u).constants
    assert found is not None
    assert found.modes == pytest.approx(constants, rel=0.2)
    assert all(np.isinf(found.periods))


def test_an_oscillation_has_its_period_and_its_damping():
    """y″ + 2 d y′ + w² y = w² u with zeros of none: poles exp(−d ± i w₁)."""
    u, period, decay = held(6_000), 40.0, 60.0
    pole = np.exp(-1 / decay + 2j * np.pi / period)
    y = np.zeros(len(u))
    for t in range(2, len(u)):
        y[t] = 2 * pole.real * y[t - 1] - abs(pole) ** 2 * y[t - 2] + u[t - 1]
    found = checked(noisy(y, 0.02), u).constants
    assert found is not None
    assert found.modes == pytest.approx((decay, decay), rel=0.1)
    assert found.periods == pytest.approx((period, period), rel=0.02)


def test_the_impulse_response_lies_in_its_band():
    """99 % of the lags lie within 2.6 errors; 5 of 101 beyond would be one in 700."""
    u = INPUTS["white"]
    y = noisy(first_order(u, 20, 3), 0.1)
    found = responses(pieces_of(y, u[:, None], follows(ROWS)))
    assert found is not None
    truth = first_order(np.eye(1, found.lags)[0], 20, 3)
    off = np.abs(found.values[0] - truth) / found.errors[0]
    assert np.sum(off > 2.6) <= 5
    assert found.values[0] == pytest.approx(truth, abs=0.01)


def test_two_inputs_are_told_apart_though_they_are_correlated():
    first = INPUTS["steps"]
    second = 0.8 * first + 0.6 * held(ROWS, seed=5)
    y = first_order(first, 15, 2) - 2 * first_order(second, 15, 6)
    assert checked(noisy(y, 0.02), first, second).delays == (2, 6)


def test_errors_of_a_response_are_those_of_its_slopes():
    rng = np.random.default_rng(1)
    u = rng.standard_normal(2000)
    y = np.zeros(2000)
    for t in range(1, 2000):
        y[t] = 0.9 * y[t - 1] + u[t - 1] + 0.3 * rng.standard_normal()
    found = responses(pieces_of(y, u[:, None], follows(2000)))
    assert found is not None
    model, own = found.model, found.model.orders.own
    numbers = np.concatenate((-model.denominator[1:], model.numerators[0]))

    def response(theta: FloatArray) -> FloatArray:
        series = power_series(np.concatenate(([1.0], -theta[:own])), found.lags)
        return np.convolve(series, theta[own:])[: found.lags]

    step = 1e-6
    slopes = np.stack(
        [
            (response(numbers + d) - response(numbers - d)) / (2 * step)
            for d in step * np.eye(len(numbers))
        ]
    )
    wanted = np.sqrt(np.diag(slopes.T @ model.covariance @ slopes))
    # central differences of a step of 1e-6 leave 1e-9 or so, and lag 0 has the error of b₀ alone
    np.testing.assert_allclose(found.errors[0], wanted, rtol=1e-5)


def test_responses_shorter_than_the_memory_of_the_output_have_their_band():
    rng = np.random.default_rng(0)
    inputs = rng.standard_normal((400, 4))
    output = np.zeros(400)
    for t in range(1, 400):
        output[t] = 0.9 * output[t - 1] + inputs[t - 1, 0] + 0.1 * rng.standard_normal()
    found = responses(pieces_of(output, inputs, follows(400)))
    assert found is not None
    assert found.lags < found.model.orders.own
    assert [found.delay(number) for number in range(4)] == [1, None, None, None]
    true = np.concatenate(([0.0], 0.9 ** np.arange(found.lags - 1)))
    assert np.all(np.abs(found.values[0] - true) <= found.factor * found.errors[0])


@pytest.mark.parametrize("colour", ["white", "coloured"])
def test_no_delay_is_claimed_for_noise(colour: str):
    """At 1 % false alarms, 7 of 100 are one in 15,000 (binomial)."""
    alarms = 0
    for seed in range(100):
        random = np.random.default_rng(seed)
        u, y = random.normal(size=(2, 1_000))
        if colour == "coloured":
            u, y = np.convolve(u, np.ones(5), "same"), np.cumsum(y)
        found = responses(pieces_of(y, u[:, None], follows(1_000)))
        assert found is not None
        alarms += found.delay(0) is not None
    assert alarms < 7
    assert FALSE_ALARMS == 0.01


def excited(series: FloatArray, step: float | None = None) -> Excitation:
    found = excitation(
        pieces_of(np.zeros(len(series)), series[:, None], follows(len(series))), 0, step
    )
    assert found is not None
    return found


@pytest.mark.parametrize("lines", [1, 3, 10])
def test_a_multisine_excites_two_numbers_a_line(lines: int):
    found = excited(multisine(ROWS, lines))
    assert found.order == 2 * lines
    assert found.highest == pytest.approx(
        lines * 5 / 400, abs=2 / 1024
    )  # two lines of the spectrum


def test_rounding_is_no_excitation():
    step = 20 / 4096
    series = np.round(multisine(ROWS, 3) / step) * step
    assert excited(series, step).order == 6


@pytest.mark.parametrize("name", INPUTS)
def test_random_inputs_excite_everything(name: str):
    found = excited(INPUTS[name])
    assert (found.order, found.covered) == (60, 1.0)


def test_a_slow_input_has_no_power_at_high_frequencies():
    found = excited(np.cumsum(np.convolve(INPUTS["white"], np.hanning(200), "same")))
    assert found.highest < 0.02
    assert found.covered < 0.2


@pytest.mark.parametrize("delay", [1, 3, 10])
def test_a_response_begins_sharply_where_it_is_largest_at_once(delay: int):
    found = checked(noisy(first_order(INPUTS["steps"], 20, delay), 0.02), INPUTS["steps"])
    assert found.sharp == (True,)


def test_a_response_that_rises_slowly_gives_a_limit_of_the_delay():
    """Four lags of 10 rows one after the other answer like t³ at first, from row 1 on."""
    y = INPUTS["white"]
    for delay in (1, 0, 0, 0):
        y = first_order(y, 10, delay)
    found = checked(noisy(y, 0.02), INPUTS["white"])
    (delay,) = found.delays
    assert delay is not None
    assert delay > 1
    assert found.sharp == (False,)


def test_what_weak_inputs_do_is_not_claimed():
    u = multisine(ROWS, 3)
    assert checked(noisy(first_order(u, 20, 4), 0.02), u).delays == (None,)


def closed_loop(lag: int, *, integral: bool) -> tuple[FloatArray, FloatArray]:
    """A first order system under a controller that acts `lag` rows later."""
    random = np.random.default_rng(2)
    reference, y, u, sum_of_errors = held(3_000, 4, 30, 90), np.zeros(3_000), np.zeros(3_000), 0.0
    for t in range(lag, 3_000):
        y[t] = 0.9 * y[t - 1] + 0.1 * u[t - 1] + 0.02 * random.normal()
        error = reference[t] - y[t - lag]
        sum_of_errors += 0.05 * error * integral
        u[t] = 2 * error + sum_of_errors
    return y, u


@pytest.mark.parametrize("lag", [1, 2])
@pytest.mark.parametrize("integral", [False, True])
def test_feedback_is_found(lag: int, integral: bool):
    (share,) = checked(*closed_loop(lag, integral=integral)).feedback
    assert share is not None
    assert 0.01 < share < 0.2


def test_a_controller_in_the_same_row_looks_like_feedthrough():
    assert checked(*closed_loop(0, integral=False)).delays == (0,)


@pytest.mark.parametrize("u", [*INPUTS.values(), multisine(ROWS, 10)], ids=[*INPUTS, "multisine"])
def test_open_loops_have_no_feedback(u: FloatArray):
    assert checked(noisy(first_order(u, 20, 2), 0.05), u).feedback == (None,)


def test_feedback_is_seldom_claimed_without_one():
    """In a thousandth of the cases; 2 of 50 would be one in 800."""
    claims = 0
    for seed in range(50):
        u = held(600, seed)
        y = noisy(first_order(u, 20, 2), 0.05, seed)
        claims += feedback(pieces_of(y, u[:, None], follows(600)), 0) is not None
    assert claims < 2


def test_dependent_inputs_are_named_with_their_factors():
    random = np.random.default_rng(0)
    table = random.normal(size=(1_000, 3)) * [1, 10, 0.1]
    table = np.column_stack((table, 2 * table[:, 0] - 5 * table[:, 2]))
    (found,) = check_inputs(table, follows(1_000), [None] * 4).dependences
    assert (found.number, found.share) == (3, pytest.approx(1))
    assert [(n, pytest.approx(f)) for n, f in found.factors] == [(0, 2), (2, -5)]


def test_many_rows_are_looked_at_in_blocks():
    u = np.random.default_rng(0).normal(size=1_000_000)
    pieces = pieces_of(u, u[:, None], follows(1_000_000))
    assert sum(map(len, pieces)) == 200_000
    assert len(pieces) == 20


ANY = st.one_of(st.just(np.nan), st.floats(-1e9, 1e9), st.sampled_from([0.0, 1.0]))


@given(arrays(np.float64, st.tuples(st.integers(0, 80), st.just(3)), elements=ANY))
@settings(max_examples=50, deadline=None)
def test_no_table_breaks_the_checks(table: FloatArray):
    found = checked(table[:, 0], table[:, 1], table[:, 2])
    assert found.rows == np.sum(np.isfinite(table).all(axis=1))


@given(st.floats(1e-6, 1e6), st.floats(1e-6, 1e6))
@settings(max_examples=10, deadline=None)
def test_delays_and_constants_do_not_depend_on_units(of_input: float, of_target: float):
    u = INPUTS["steps"]
    y = noisy(first_order(u, 20, 3), 0.02)
    here, there = checked(y, u), checked(of_target * y, of_input * u)
    assert there.delays == here.delays == (3,)
    assert here.constants is not None
    assert there.constants is not None
    assert there.constants.slowest == pytest.approx(here.constants.slowest, rel=1e-3)


@pytest.mark.parametrize("seed", range(1, 6))
def test_a_response_that_no_single_lag_shows_is_seen_by_all_together(seed: int) -> None:
    """An oscillator behind steps of 25 rows, with noise of 0.1: the F test has p < 1e-10."""
    random = np.random.default_rng(seed)
    u = np.repeat(random.uniform(-1, 1, 20), 25)
    x, v, y = 0.0, 0.0, np.zeros(500)
    for t in range(500):
        y[t] = x + random.normal(0, 0.1)
        v += 0.1 * (u[t] - x) - 0.3 * v
        x += 0.3 * v
    (piece,) = pieces_of(y, u[:, None], follows(500))
    found = responses([piece])
    assert found is not None
    assert found.p_value(0) < 0.01


NOISE = {
    "white": [1.0],
    "moving average": [1.0, 0.8, 0.6, 0.3],
    "autoregressive": 0.95 ** np.arange(100),
    "resonance": (0.98 ** np.arange(200)) * np.cos(0.6 * np.arange(200)),
    "random walk": np.ones(600),
}


@pytest.mark.parametrize("colour", NOISE)
@pytest.mark.parametrize("input", ["steps", "random walk"])
def test_a_joint_test_has_as_many_false_alarms_as_it_says(colour: str, input: str) -> None:
    """One in a hundred; of 60 draws 4 or fewer with a chance of 99.7 %."""
    alarms = 0
    for seed in range(60):
        random = np.random.default_rng(seed)
        u = held(600, seed) if input == "steps" else np.cumsum(random.normal(size=600))
        y = np.convolve(random.normal(size=1_200), NOISE[colour])[600:1_200]
        (answer,) = checked(y, u).answers
        assert answer is not None
        alarms += answer.p_value < SIGNIFICANCE
    assert alarms <= 4


def test_a_controller_alone_is_no_response() -> None:
    """The input is computed from the target, and the target does not read it."""
    alarms = 0
    for seed in range(30):
        random = np.random.default_rng(seed)
        y = np.convolve(random.normal(size=900), 0.9 ** np.arange(100))[:900]
        u = 2 * (held(900, seed, 30, 90) - np.concatenate(([0.0], y[:-1])))
        found = checked(y, u)
        (answer,) = found.answers
        assert answer is not None
        assert found.feedback[0] is not None
        alarms += answer.seen
    assert alarms <= 3


def test_one_dead_input_of_two_is_told_apart() -> None:
    u, w = held(3_000, 1), held(3_000, 2)
    seen, dead = checked(noisy(first_order(u, 15, 2), 0.1), u, w).answers
    assert seen is not None
    assert dead is not None
    assert (seen.seen, dead.seen, dead.limited) == (True, False, False)


def test_a_copy_that_hides_an_input_is_not_called_dead() -> None:
    """Each predicts nothing beside the other, and both predict."""
    u = held(2_000, 1)
    w = u + 1e-5 * np.random.default_rng(0).normal(size=2_000)
    answers = checked(noisy(first_order(u, 15, 2), 0.1), u, w).answers
    assert all(answer is None or answer.seen for answer in answers)


@pytest.mark.parametrize(
    ("ratio", "numbers", "freedom"),
    [(1.0, 5, 100), (3.0, 8, 400), (40.0, 7, 3_000), (0.3, 99, 2_000), (200.0, 3, 500)],
)
def test_the_f_distribution_is_that_of_scipy(ratio: float, numbers: int, freedom: int) -> None:
    """Also where the probability is 1e-85."""
    wanted = float(stats.f.sf(ratio, numbers, freedom))
    assert f_survival(ratio, numbers, freedom) == pytest.approx(wanted, rel=1e-9)


def resonance(decay: float, period: float, seed: int) -> TargetCheck:
    random = np.random.default_rng(seed)
    u, pole = random.normal(size=2_000), np.exp(-1 / decay + 2j * np.pi / period)
    y = np.zeros(2_000)
    for t in range(2, 2_000):
        y[t] = 2 * pole.real * y[t - 1] - abs(pole) ** 2 * y[t - 2] + u[t - 1]
    return checked(noisy(y, 0.2, seed), u)


def test_the_slowest_time_of_an_oscillation_is_its_decay() -> None:
    """A period of 9 rows that decays in 29: 1/|ln z| would be 1.4."""
    found = resonance(29, 9, 1).constants
    assert found is not None
    assert found.slowest == pytest.approx(29, rel=0.1)
    assert found.fastest == pytest.approx(9 / (2 * np.pi), rel=0.02)
    assert found.damping == pytest.approx((1 / 29 / (2 * np.pi / 9),) * 2, rel=0.1)


def test_the_range_of_a_time_constant_contains_it() -> None:
    """Of ten recordings in eight at least; the upper ends are of use, a quarter above it."""
    inside = 0
    upper: list[float] = []
    for seed in range(10):
        u = held(1_500, seed)
        found = checked(noisy(first_order(u, 20, 1), 0.1, seed), u).constants
        assert found is not None
        inside += found.interval[0] <= 20 <= found.interval[1]
        upper.append(found.interval[1])
    assert inside >= 8
    assert np.median(upper) < 25


@pytest.mark.parametrize("seed", range(4))
def test_a_resonance_that_outlasts_the_lags_has_a_range(seed: int) -> None:
    """The slowest mode comes from the rows, other modes from means of rows: so does its range."""
    random = np.random.default_rng(seed)
    u, pole = random.normal(size=4_000), np.exp(-1 / 63.7 + 2j * np.pi / 20)
    y = np.zeros(4_000)
    for t in range(2, 4_000):
        y[t] = 2 * pole.real * y[t - 1] - abs(pole) ** 2 * y[t - 2] + 0.1 * u[t - 1]
    found = checked(noisy(y, 0.05, 100 + seed), u).constants
    assert found is not None
    assert found.interval[0] < 63.7 < found.interval[1]
    assert found.has_range
    assert found.slowest == pytest.approx(63.7, rel=0.1)


def test_an_integrator_is_not_given_a_time_constant() -> None:
    u = held(2_000, 3)
    y = np.cumsum(np.concatenate(([0.0], u[:-1])))
    found = checked(noisy(y, 0.01), u).constants
    assert found is not None
    assert found.integrates
    assert not found.growing


def test_a_vibration_gets_the_order_that_it_needs() -> None:
    """Five modes have ten poles; a first-order system is content with few."""
    random = np.random.default_rng(0)
    u, t = random.normal(size=4_000), np.arange(400)
    modes = [0.98**t * np.sin(2 * np.pi * (0.03 + 0.08 * k) * t) for k in range(5)]
    y = np.convolve(u, np.sum(np.stack(modes).real, axis=0))[:4_000].astype(np.float64)
    pieces = pieces_of(noisy(y, 1e-4), u[:, None], follows(4_000))
    assert proposed_orders(pieces)[-1] >= 10
    assert proposed_orders(pieces)[:4] == (1, 2, 3, 4)
    assert proposed_orders(pieces_of(random.normal(size=400), u[:400, None], follows(400)))[-1] <= 6


@pytest.mark.parametrize("seed", [2, 17, 18, 45, 57])
def test_noise_that_grows_with_an_input_is_no_response(seed: int):
    # the F test alone, which assumes equal variances, has p < 0.01 for all of these
    random = np.random.default_rng(seed)
    u = np.asarray(lfilter([1], [1, -0.9], random.normal(size=600)), np.float64)
    y = np.append(0.0, u[:-1]) ** 2 * random.normal(size=600)
    piece = Piece(y - y.mean(), (u - u.mean())[:, None])
    (found,) = influences([piece])
    assert found is not None
    assert found.p_value >= SIGNIFICANCE
