"""Records of the scalar functions: one a row of the table, over its domain and beyond."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from compiler.ir.builder import GraphBuilder
from compiler.ir.program import NodeId
from compiler.ir.scalars import SCALAR_FUNCTIONS
from tests.every_op.elementwise_records import elementwise
from tests.every_op.record import SMOOTH_ROWS, Array, Record
from tests.every_op.samples import with_special

NAN, INF = np.nan, np.inf

MEANINGS: dict[str, Callable[..., Array]] = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "sinh": np.sinh,
    "cosh": np.cosh,
    "tanh": np.tanh,
    "exp": np.exp,
    "log": np.log,
    "sqrt": np.sqrt,
    "abs": np.abs,
    "sign": np.sign,
    "sigmoid": lambda x: np.exp(-np.logaddexp(0.0, -x)),
    "softplus": lambda x: np.logaddexp(0.0, x),
    "pow": np.power,
}
"""numpy's own functions; where it has none, a formula that the product does not use."""

SPECIAL: dict[str, list[tuple[float, ...]]] = {
    "sin": [(NAN,), (INF,), (0.0,)],
    "cos": [(NAN,), (INF,), (0.0,)],
    "tan": [(NAN,), (INF,), (0.0,)],
    "asin": [(NAN,), (1.0,), (-1.0,), (0.0,), (1.5,), (-1.5,)],
    "acos": [(NAN,), (1.0,), (-1.0,), (0.0,), (1.5,), (-1.5,)],
    "atan": [(NAN,), (INF,), (-INF,), (0.0,), (1e30,)],
    "atan2": [(NAN, 1.0), (1.0, NAN), (0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 0.0)],
    "sinh": [(NAN,), (INF,), (-INF,), (0.0,), (800.0,), (-800.0,)],
    "cosh": [(NAN,), (INF,), (-INF,), (0.0,), (800.0,), (-800.0,)],
    "tanh": [(NAN,), (INF,), (-INF,), (0.0,), (800.0,), (-800.0,)],
    "exp": [(NAN,), (INF,), (-INF,), (0.0,), (800.0,), (-800.0,)],
    "log": [(NAN,), (INF,), (0.0,), (1.0,), (-1.0,)],
    "sqrt": [(NAN,), (INF,), (0.0,), (1.0,), (-1.0,)],
    "abs": [(NAN,), (INF,), (-INF,), (0.0,), (-0.0,)],
    "sign": [(NAN,), (INF,), (-INF,), (0.0,), (-0.0,)],
    "sigmoid": [(NAN,), (INF,), (-INF,), (0.0,), (800.0,), (-800.0,)],
    "softplus": [(NAN,), (INF,), (-INF,), (0.0,), (800.0,), (-800.0,)],
    "pow": [(NAN, 2.0), (2.0, NAN), (0.0, 2.0), (0.0, -1.0), (-2.0, 3.0), (-2.0, 0.5), (3.0, 0.0)],
}
"""Arguments at which the value is defined but not ordinary."""


EXACT = {"sqrt", "abs", "sign"}
"""Functions that every C has to the bit: they need no kernel."""


def function_records() -> dict[str, Record]:
    """Records by the function's name; a row of the table must have its meaning here."""
    missing = SCALAR_FUNCTIONS.keys() - (MEANINGS.keys() & SPECIAL.keys())
    assert not missing, f"give {missing} their MEANINGS and SPECIAL in {__file__}"
    bare = {name for name, row in SCALAR_FUNCTIONS.items() if row.kernel is None} - EXACT
    assert not bare, f"give {bare} their kernels in compiler/kernels/table.py: C has no others"
    with np.errstate(all="ignore"):
        return {name: _record(name) for name in SCALAR_FUNCTIONS}


def _record(name: str) -> Record:
    domain = SCALAR_FUNCTIONS[name].domain

    def emit(b: GraphBuilder) -> Callable[..., NodeId]:
        return lambda *args: b.apply(name, *args)

    series = [_samples(name, place) for place in range(len(domain))]
    return elementwise(f"Apply({name})", emit, MEANINGS[name], *series)


def _samples(name: str, place: int) -> Callable[..., Array]:
    low, high = SCALAR_FUNCTIONS[name].domain[place]
    special = np.array(
        [row[place] for row in SPECIAL[name]] + [1.0]
    )  # one row behind the last step

    def samples(*shape: int) -> Array:
        random = np.random.default_rng(place)
        count = SMOOTH_ROWS * int(np.prod(shape, dtype=int))
        # one sample a stratum, none at the kinks that lie on the middle of a domain
        strata = (random.permutation(count) + random.uniform(0.2, 0.8, count)) / count
        smooth = low + (high - low) * strata
        return with_special(smooth.reshape(SMOOTH_ROWS, *shape), special)

    return samples
