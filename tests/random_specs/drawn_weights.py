"""Draws the weights with which a random spec is exported: large, tiny, zero, at bounds."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping

import numpy as np

from compiler.ir.program import Parameter, Program
from msnn.data.dataset import FloatArray
from msnn.model.weights.weights_file import checked_weights, initial_weights

Draw = Callable[[random.Random, float, Parameter], float]
"""One element, from its initial value."""


def _signed(chance: random.Random, low: float, high: float) -> float:
    """A number of either sign whose decimal exponent is uniform in [low, high]."""
    return chance.choice((-1.0, 1.0)) * 10.0 ** chance.uniform(low, high)


def _at_a_bound(chance: random.Random, initial: float, parameter: Parameter) -> float:
    bounds = _bounds(parameter)
    return chance.choice(bounds) if bounds else initial


def _bounds(parameter: Parameter) -> list[float]:
    return [b for b in (parameter.minimum, parameter.maximum) if b is not None]


_KINDS: tuple[tuple[Draw, int], ...] = (
    (lambda chance, initial, _: initial * chance.uniform(-2.0, 2.0), 6),
    (lambda chance, initial, _: initial + chance.gauss(0.0, 1.0), 6),
    (lambda _, __, ___: 0.0, 3),
    (_at_a_bound, 4),
    (lambda chance, _, __: _signed(chance, -6.0, -3.0), 2),
    (lambda chance, _, __: _signed(chance, 1.0, 4.0), 3),
)
"""Ways to draw an element, and how often."""
_EXTREME: tuple[tuple[Draw, int], ...] = (
    (lambda chance, initial, _: initial + chance.gauss(0.0, 1.0), 6),
    (lambda chance, _, __: _signed(chance, -45.0, -30.0), 3),
    (lambda chance, _, __: _signed(chance, 34.0, 38.5), 2),
)
"""The same of every fourth seed: 1e-45 lies outside single precision; 1e39 is refused (E1134)."""


def drawn_weights(program: Program, seed: int) -> Mapping[str, FloatArray]:
    """Weights that a weights file may hold; every fourth seed has the initial ones.

    They depend on the seed and the name of a parameter: a smaller spec keeps those of the rest.
    """
    weights: dict[str, FloatArray] = initial_weights(program)
    if seed % 4 == 0:
        return weights
    kinds = _EXTREME if seed % 4 == 1 else _KINDS
    for parameter in program.parameters:
        chance = random.Random(f"weights {seed} {parameter.name}")
        if chance.random() < 0.25:
            continue
        array = weights[parameter.name]
        draw = _kind(chance, kinds)
        mixed = chance.random() < 0.3  # else all elements are of one kind
        values = [
            _within(parameter, one(chance, initial, parameter))
            for initial in array.ravel().tolist()
            for one in [_kind(chance, kinds) if mixed else draw]
        ]
        weights[parameter.name] = np.array(values, np.float64).reshape(array.shape)
    return checked_weights(program, weights, "drawn weights")


def _kind(chance: random.Random, kinds: tuple[tuple[Draw, int], ...]) -> Draw:
    draws, counts = zip(*kinds, strict=True)
    return chance.choices(draws, counts)[0]


def _within(parameter: Parameter, value: float) -> float:
    low = -np.inf if parameter.minimum is None else parameter.minimum
    high = np.inf if parameter.maximum is None else parameter.maximum
    return float(min(max(value, low), high))
