"""Kernels written in core ops give what the kernels give."""

from __future__ import annotations

import numpy as np
import pytest

from compiler.interpreter.interpreter import Interpreter
from compiler.ir.builder import GraphBuilder
from compiler.ir.program import Graph, Output, Program, Role, Signal
from compiler.ir.types import Axis, Type
from compiler.ir.verifier import verify
from compiler.kernels.expand import expand_kernel
from compiler.kernels.table import evaluate

SPECIAL = np.array(
    [0.0, -0.0, 1.0, -1.0, 0.5, -0.5, 2.0, 1e-300, 1e300, np.inf, -np.inf, np.nan, 0.4375, 2.4375]
)


@pytest.mark.parametrize(("name", "arity"), [("asin", 1), ("acos", 1), ("atan", 1), ("atan2", 2)])
def test_expansion_has_the_bits_of_the_kernel(name: str, arity: int) -> None:
    random = np.random.default_rng(4)
    samples = np.concatenate([SPECIAL, random.uniform(-1, 1, 500), random.normal(0, 30, 500)])
    pairs = np.stack([np.repeat(SPECIAL, len(samples)), np.tile(samples, len(SPECIAL))])
    axis = (Axis("k", 1),)
    b = GraphBuilder()
    names = ("a", "b")[:arity]
    value = expand_kernel(b, name, tuple(b.signal(n, 0, 0, Type(axis)) for n in names))
    signals = tuple(Signal(n, Role.INPUT, axis) for n in names)
    program = Program(name, None, signals, (), (), b.graph(), Graph(), (Output("y", value),))
    verify(program)
    columns = pairs if arity == 2 else [samples]
    log = {n: column[:, np.newaxis] for n, column in zip(names, columns, strict=True)}
    found = Interpreter(program).step(log, np.arange(len(columns[0])), {}).outputs["y"][:, 0]
    expected = evaluate(name, *columns)
    assert np.array_equal(found, expected, equal_nan=True)
    assert np.array_equal(
        np.signbit(found)[~np.isnan(found)], np.signbit(expected)[~np.isnan(found)]
    )


def test_kernels_with_integers_are_refused() -> None:
    b = GraphBuilder()
    with pytest.raises(ValueError, match="`exp` needs integer operations"):
        expand_kernel(b, "exp", (b.signal("x", 0, 0, Type()),))
