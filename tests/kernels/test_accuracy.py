"""The kernels stay within the errors that their table rows state."""

from collections.abc import Iterator

import numpy as np
import pytest
from mpmath import mp, mpf

from compiler.kernels.table import KERNELS, evaluate
from tests.kernels import references
from tests.kernels.references import EXACT, NUMPY, double_error, float_errors
from tests.kernels.samples import arguments

DOUBLE_ERROR = 2.0
"""What every kernel promises in double precision, in units in the last place."""

FULL_RANGE = mpf(2) ** 1024


@pytest.mark.parametrize("name", KERNELS)
def test_float_against_float64(name: str) -> None:
    assert name in NUMPY.keys() & EXACT.keys(), f"give {name} its values in {references.__file__}"
    columns = arguments(np.float32, KERNELS[name].arity, 200_000)
    value = evaluate(name, *columns)
    with np.errstate(all="ignore"):
        exact = NUMPY[name](*(column.astype(np.float64) for column in columns))
        rounded = exact.astype(np.float32)
    finite = np.isfinite(rounded)
    assert (np.isnan(value) == np.isnan(exact)).all()
    infinite = np.isinf(rounded) & (np.abs(exact) > 2.0**128)
    assert (value[infinite] == rounded[infinite]).all()
    # float64 functions err by about 2⁻²⁹ of a float32 unit: the bound needs no allowance for it
    assert float_errors(value[finite], exact[finite]).max() <= KERNELS[name].error


@pytest.mark.parametrize("name", KERNELS)
def test_double_against_mpmath(name: str) -> None:
    worst = 0.0
    for point in _double_points(name):
        value = float(evaluate(name, *(np.asarray(x) for x in point)))
        # softplus and pow of extreme arguments cancel all but the last bits of a long number
        with mp.workprec(1200 if name == "softplus" else 300):
            exact = EXACT[name](*(mpf(x) for x in point))
            if exact != 0 and abs(exact) < FULL_RANGE:
                worst = max(worst, double_error(value, exact))
    assert worst <= DOUBLE_ERROR


def _double_points(name: str) -> Iterator[tuple[float, ...]]:
    random = np.random.default_rng(7)
    for _ in range(400):
        x = random.standard_normal() * 10.0 ** random.uniform(-4.0, 3.0)
        y = random.standard_normal() * 10.0 ** random.uniform(-2.0, 2.0)
        match name:
            case "asin" | "acos":
                yield (random.uniform(-1.0, 1.0),)
            case "log" | "sqrt":
                yield (abs(x),)
            case "pow":
                yield (abs(x), y)
            case "atan2":
                yield (x, y)
            case _:
                yield (x,)


@pytest.mark.parametrize("name", ["sin", "cos", "tan"])
def test_angles_next_to_multiples_of_a_quarter_turn(name: str) -> None:
    # the rest of the reduction is smallest there; the last number is the worst double of all
    # (J.-M. Muller, "Elementary Functions", table of worst cases for range reduction)
    turns = [float(k) * np.pi / 2 for k in [1, 2, 3, 22, 127, 128, 129, 1023, 1024, 1025, 10**6]]
    angles = [*turns, 2.0**500, 1e300, 6381956970095103.0 * 2.0**797]
    for angle in [*angles, *(-angle for angle in angles)]:
        value = float(evaluate(name, np.asarray(angle)))
        with mp.workprec(1400):
            exact = EXACT[name](mpf(angle))
        assert double_error(value, exact) <= DOUBLE_ERROR
        if abs(angle) < 3e38:
            single = np.float32(angle)
            with mp.workprec(400):
                exact = EXACT[name](mpf(float(single)))
            error = float_errors(evaluate(name, np.asarray(single)), np.asarray(float(exact)))
            assert float(error) <= KERNELS[name].error
