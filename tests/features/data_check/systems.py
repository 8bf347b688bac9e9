"""Synthetic systems whose delays, time constants and inputs are known."""

from __future__ import annotations

import numpy as np

from msnn.data.dataset import BoolArray, FloatArray


def follows(rows: int) -> BoolArray:
    """One record without gap."""
    found = np.ones(rows, dtype=np.bool_)
    found[:1] = False
    return found


def held(rows: int, seed: int = 0, least: int = 6, most: int = 30) -> FloatArray:
    """Steps of random height and length."""
    random = np.random.default_rng(seed)
    values = np.empty(rows)
    row = 0
    while row < rows:
        length = int(random.integers(least, most + 1))
        values[row : row + length] = random.uniform(-1, 1)
        row += length
    return values


def multisine(rows: int, lines: int, first: int = 5, period: int = 400) -> FloatArray:
    """So many sines of one height, well apart in frequency."""
    t = np.arange(rows)
    waves = [np.sin(2 * np.pi * k * first * t / period + k * k) for k in range(1, lines + 1)]
    return np.sum(waves, axis=0)


def first_order(u: FloatArray, constant: float, delay: int) -> FloatArray:
    """y[t] = a y[t−1] + (1 − a) u[t−delay] with a = exp(−1/constant), from rest."""
    a = np.exp(-1 / constant)
    y, x = np.zeros(len(u)), 0.0
    for t in range(len(u)):
        x = a * x + ((1 - a) * u[t - delay] if t >= delay else 0.0)
        y[t] = x
    return y


def noisy(y: FloatArray, share: float, seed: int = 1) -> FloatArray:
    """y with white noise of so much of its deviation."""
    return y + share * np.std(y) * np.random.default_rng(seed).normal(size=len(y))


def clock(rows: int, step: float) -> FloatArray:
    """The seconds of evenly spaced rows."""
    found = np.arange(rows, dtype=np.float64)
    found *= step
    return found
