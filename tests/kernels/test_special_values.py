"""Zeros with their sign, infinities, NaN, denormal numbers, saturation and symmetry."""

import itertools

import numpy as np
import pytest

from compiler.kernels.table import KERNELS, evaluate
from tests.kernels.builds import same_bits
from tests.kernels.samples import arguments

NAN = np.nan
INF = np.inf

# name: values at −∞, −0, +0, +∞ (C99, annex F)
ENDS = {
    "exp": (0.0, 1.0, 1.0, INF),
    "log": (NAN, -INF, -INF, INF),
    "sqrt": (NAN, -0.0, 0.0, INF),
    "sin": (NAN, -0.0, 0.0, NAN),
    "cos": (NAN, 1.0, 1.0, NAN),
    "tan": (NAN, -0.0, 0.0, NAN),
    "asin": (NAN, -0.0, 0.0, NAN),
    "acos": (NAN, np.pi / 2, np.pi / 2, NAN),
    "atan": (-np.pi / 2, -0.0, 0.0, np.pi / 2),
    "sinh": (-INF, -0.0, 0.0, INF),
    "cosh": (INF, 1.0, 1.0, INF),
    "tanh": (-1.0, -0.0, 0.0, 1.0),
    "sigmoid": (0.0, 0.5, 0.5, 1.0),
    "softplus": (0.0, np.log(2.0), np.log(2.0), INF),
}

ODD = ("sin", "tan", "asin", "atan", "sinh", "tanh")
EVEN = ("cos", "cosh")
ONE_ARGUMENT = [name for name, kernel in KERNELS.items() if kernel.arity == 1]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name", ENDS)
def test_ends(name: str, dtype: type[np.float32]) -> None:
    value = evaluate(name, np.array([-INF, -0.0, 0.0, INF], dtype=dtype))
    assert same_bits(value, np.array(ENDS[name], dtype=dtype)).all(), value


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name", ONE_ARGUMENT)
def test_nan_stays_nan(name: str, dtype: type[np.float32]) -> None:
    assert np.isnan(evaluate(name, np.array([NAN], dtype=dtype))).all()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("name", ["pow", "atan2"])
def test_pairs_of_special_values_are_those_of_c(name: str, dtype: type[np.float32]) -> None:
    special = np.array([0.0, 0.5, 1.0, 2.0, 3.0, 2.5, INF], dtype=dtype)
    values = np.concatenate([special, -special, np.array([NAN], dtype=dtype)])
    first, second = (grid.reshape(-1) for grid in np.meshgrid(values, values))
    with np.errstate(all="ignore"):
        wanted = {"pow": np.power, "atan2": np.arctan2}[name](first, second)
    value = evaluate(name, first, second)
    # finite values may differ by the kernel's error, everything special is exact
    plain = np.isfinite(wanted) & (wanted != 0) & (np.abs(wanted) != 1)
    assert same_bits(value, wanted)[~plain].all()
    assert np.allclose(value[plain], wanted[plain], rtol=4 * np.finfo(dtype).eps, atol=0.0)


@pytest.mark.parametrize("name", [*ODD, *EVEN])
def test_symmetry(name: str) -> None:
    for dtype in (np.float32, np.float64):
        (x,) = arguments(dtype, 1, 20_000)
        mirrored = evaluate(name, -x)
        wanted = -evaluate(name, x) if name in ODD else evaluate(name, x)
        assert same_bits(mirrored, wanted).all()


@pytest.mark.parametrize("name", ODD)
def test_denormal_numbers_are_kept(name: str) -> None:
    for dtype in (np.float32, np.float64):
        smallest = np.finfo(dtype).smallest_subnormal
        x = np.arange(1, 2000).astype(dtype) * smallest
        assert same_bits(evaluate(name, x), x).all()


def test_exp_underflows_gradually() -> None:
    x = np.linspace(-104.0, -87.0, 4001).astype(np.float32)
    value = evaluate("exp", x).astype(np.float64)
    exact = np.exp(x.astype(np.float64))
    # in units of the smallest number, which is the last place of every denormal one: half a unit
    # of the last rounding and up to half of what the kernel errs for normal results
    assert np.abs(value / 2.0**-149 - exact / 2.0**-149)[exact < 2.0**-126].max() <= 1.0
    assert value[0] == 0.0


@pytest.mark.parametrize("name", ["tanh", "sigmoid", "exp", "softplus", "sinh", "atan"])
def test_a_rising_function_rises_over_the_seams(name: str) -> None:
    # around every limit between two formulas; one unit down is the rounding of a kernel
    for seam in (2.0**-12, 0.55, 0.92, 1.0, 0.4375, 2.4375, 9.01, 17.33, 18.02, 18.72, 88.7):
        for sign in (-1.0, 1.0):
            start = np.float32(sign * seam)
            x = np.sort(start + np.arange(-200, 200) * np.spacing(start))
            value = evaluate(name, x.astype(np.float32))
            assert (value[1:] >= np.nextafter(value[:-1], np.float32(-INF))).all(), seam


def test_saturation_is_exact() -> None:
    x = np.array([9.1, 20.0, 1e3, 3e38], dtype=np.float32)
    assert (evaluate("tanh", x) == 1.0).all()
    assert (evaluate("tanh", -x) == -1.0).all()
    assert (evaluate("sigmoid", 2 * x[:3]) == 1.0).all()
    assert same_bits(evaluate("softplus", 2 * x[:3]), 2 * x[:3]).all()
    assert (evaluate("exp", np.array([-104.0, -1e30], dtype=np.float32)) == 0.0).all()


def test_types_and_shapes() -> None:
    for dtype, shape in itertools.product((np.float32, np.float64), ((), (0,), (2, 3))):
        result = evaluate("sin", np.zeros(shape, dtype=dtype))
        assert result.dtype == dtype
        assert result.shape == shape
    assert evaluate("atan2", np.ones((2, 1)), np.ones(3)).shape == (2, 3)
    with pytest.raises(TypeError, match="float32 or of float64, not float32, float64"):
        evaluate("pow", np.ones(2, dtype=np.float32), np.ones(2))
    with pytest.raises(TypeError, match="not int64"):
        evaluate("sin", np.ones(2, dtype=np.int64))
    with pytest.raises(TypeError, match="takes 1 arguments, not 2"):
        evaluate("sin", np.ones(2), np.ones(2))
