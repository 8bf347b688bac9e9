"""Arguments for the kernels: special values and random ones in every binade."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


def special_values(dtype: type[np.floating[Any]]) -> Array:
    info = np.finfo(dtype)
    positive = [
        0.0,
        info.smallest_subnormal,
        info.tiny,
        *(2.0**-30, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 7.0, 88.0, 104.0, 709.0, 745.0),
        *(np.pi / 4, np.pi / 2, np.pi, 1e5, 2.0**31, 2.0**53, 2.0**100),
        info.max,
        np.inf,
    ]
    with np.errstate(all="ignore"):  # the largest number and its neighbour above
        values = np.array(positive, dtype=dtype)
        neighbours = [np.nextafter(values, dtype(0)), np.nextafter(values, dtype(np.inf))]
    both = np.concatenate([values, *neighbours])
    return np.concatenate([both, -both, np.array([np.nan], dtype=dtype)])


def random_values(dtype: type[np.floating[Any]], count: int, seed: int) -> Array:
    """Half of them any bit pattern, half of the size that models meet."""
    random = np.random.default_rng(seed)
    unsigned = np.uint32 if dtype is np.float32 else np.uint64
    bits = random.integers(0, np.iinfo(unsigned).max, count // 2, unsigned, endpoint=True)
    scale = 10.0 ** random.uniform(-3.0, 3.0, count - count // 2)
    usual = random.standard_normal(count - count // 2) * scale
    # some bit patterns are signalling NaN: a sum makes them quiet before numpy warns of them
    with np.errstate(invalid="ignore"):
        return np.concatenate([bits.view(dtype) + dtype(0), usual.astype(dtype)])


def arguments(dtype: type[np.floating[Any]], arity: int, count: int) -> tuple[Array, ...]:
    """Columns of arguments; for two of them all pairs of special values come first."""
    special = special_values(dtype)
    if arity == 1:
        return (np.concatenate([special, random_values(dtype, count, 1)]),)
    first, second = (grid.reshape(-1) for grid in np.meshgrid(special, special))
    shuffled = np.random.default_rng(2).permutation(random_values(dtype, count, 3))
    return (
        np.concatenate([first, random_values(dtype, count, 1)]),
        np.concatenate([second, shuffled]),
    )
