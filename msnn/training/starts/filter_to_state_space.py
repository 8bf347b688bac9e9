"""Converts a stable filter to the arrays of the layers that are stable by construction."""

from __future__ import annotations

import numpy as np

from msnn.data.dataset import FloatArray
from msnn.training.starts.linear_fit import Filter, convolved, power_series

LARGEST = 1 - 1e-7
"""Of a reflection coefficient: it stays off its bound in single precision too."""


def reflection_of(denominator: FloatArray) -> FloatArray:
    """Reflection coefficients of a stable A, by Levinson's recursion stepped down."""
    a = denominator[1:]
    found = np.zeros(len(a))
    for order in reversed(range(len(a))):
        r = found[order] = np.clip(a[order], -LARGEST, LARGEST)
        a = (a[:order] - r * a[:order][::-1]) / (1 - r * r)
    return found


def state_space_of(found: Filter, radius: float) -> dict[str, FloatArray]:
    """`reflection`, `B`, `C` and `D` of the lattice with the response of the filter.

    B drives the first state alone, which every lattice spreads over all others: C then follows
    from as many samples of the response as there are states.
    """
    order = len(found.denominator) - 1
    reflection = reflection_of(found.denominator / radius ** np.arange(order + 1))
    lattice = radius * _lattice(reflection)
    driven = np.eye(order)[0]
    states: list[FloatArray] = []
    for _ in range(order):
        states.append(driven)
        driven = lattice @ driven
    response = convolved(found.numerator, power_series(found.denominator, order + 1), order + 1)
    read = np.asarray(np.linalg.lstsq(np.array(states), response[1:], rcond=None)[0])
    scale = float(np.prod(np.sqrt(1 - reflection**2)))
    # with this B the states have the size of a white input, so that C has that of the gain
    return {
        "reflection": reflection,
        "B": scale * np.eye(order)[0],
        "C": np.asarray(read / scale, dtype=np.float64),
        "D": response[:1],
    }


def _lattice(reflection: FloatArray) -> FloatArray:
    """The normalised lattice as a matrix, as the layer `state_space` turns its state."""
    order = len(reflection)
    state = np.eye(order)
    forward = -reflection[-1] * state[-1]
    rows: list[FloatArray] = []
    for i in reversed(range(order - 1)):
        r, cosine = reflection[i], np.sqrt(1 - reflection[i] ** 2)
        rows.append(r * forward + cosine * state[i])
        forward = cosine * forward - r * state[i]
    return np.array([forward, *reversed(rows)])
