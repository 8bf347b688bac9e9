"""Every scalar function of the language, one row each: meaning, derivative, units, spellings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from compiler.builder import GraphBuilder
    from compiler.program import NodeId

Array = NDArray[Any]
Derivative = Callable[["GraphBuilder", "tuple[NodeId, ...]", "NodeId"], "NodeId"]
Definition = Callable[["GraphBuilder", "tuple[NodeId, ...]"], "NodeId"]


class UnitRule(Enum):
    """How the unit of a function's value follows from those of its arguments."""

    NUMBER = "a dimensionless argument gives a dimensionless value"
    ANGLE = "an angle in rad gives a dimensionless value"
    TO_ANGLE = "a dimensionless argument gives rad"
    RATIO_TO_ANGLE = "two arguments of one unit give rad"
    SAME = "the value has the argument's unit"
    SIGN = "any argument gives a dimensionless value"
    ROOT = "the value has the square root of the argument's unit"


@dataclass(frozen=True, slots=True)
class ScalarFunction:
    """One row. `onnx` is None where onnxruntime has no exact double kernel: then `definition` is
    lowered instead. `kernel` names the project's own kernel for float32 and C; None means that the
    function is exact as it is (one IEEE operation). `domain` is where tests draw their samples."""

    name: str
    arity: int
    numpy: Callable[..., Array]
    derivatives: tuple[Derivative, ...]
    units: UnitRule
    torch: str
    casadi: str
    onnx: str | None
    definition: Definition | None
    kernel: str | None
    domain: tuple[tuple[float, float], ...]
    doc: str


def _sigmoid(x: Array) -> Array:
    # exp of a negative argument only, so that no intermediate overflows
    small = np.exp(-np.abs(x))
    return np.where(x >= 0, 1 / (1 + small), small / (1 + small))


def _softplus(x: Array) -> Array:
    return np.maximum(x, 0) + np.log1p(np.exp(-np.abs(x)))


def _define_tan(b: GraphBuilder, a: tuple[NodeId, ...]) -> NodeId:
    return b.divide(b.apply("sin", a[0]), b.apply("cos", a[0]))


def _define_sinh(b: GraphBuilder, a: tuple[NodeId, ...]) -> NodeId:
    # tanh keeps the small arguments that exp(x) - exp(-x) cancels; cosh ≥ 1 loses nothing
    return b.multiply(b.apply("tanh", a[0]), b.apply("cosh", a[0]))


def _define_cosh(b: GraphBuilder, a: tuple[NodeId, ...]) -> NodeId:
    grown = b.apply("exp", b.apply("abs", a[0]))
    half = b.constant(0.5)
    return b.add(b.multiply(half, grown), b.divide(half, grown))


def _define_sigmoid(b: GraphBuilder, a: tuple[NodeId, ...]) -> NodeId:
    # the bound is above every double's rounding; exp = ∞ would give the slope 0 · ∞
    grown = b.apply("exp", b.minimum(b.negate(a[0]), b.constant(700.0)))
    return b.divide(b.constant(1.0), b.add(b.constant(1.0), grown))


def _define_softplus(b: GraphBuilder, a: tuple[NodeId, ...]) -> NodeId:
    # a tie has the slope of the first operand: half of each order gives the right one at 0, 1/2
    zero, half = b.constant(0.0), b.constant(0.5)
    both = b.add(b.maximum(a[0], zero), b.maximum(zero, a[0]))
    tail = b.apply("exp", b.negate(b.apply("abs", a[0])))
    return b.add(b.multiply(half, both), b.apply("log", b.add(b.constant(1.0), tail)))


def _define_by_kernel(name: str) -> Definition:
    def definition(b: GraphBuilder, a: tuple[NodeId, ...]) -> NodeId:
        from compiler.kernel_expansion import expand_kernel

        return expand_kernel(b, name, a)

    return definition


def _one_minus_square(b: GraphBuilder, value: NodeId) -> NodeId:
    return b.subtract(b.constant(1.0), b.multiply(value, value))


def _one_plus_square(b: GraphBuilder, value: NodeId) -> NodeId:
    return b.add(b.constant(1.0), b.multiply(value, value))


def _inverse(b: GraphBuilder, value: NodeId) -> NodeId:
    return b.divide(b.constant(1.0), value)


def _squares(b: GraphBuilder, a: tuple[NodeId, ...]) -> NodeId:
    return b.add(b.multiply(a[0], a[0]), b.multiply(a[1], a[1]))


_NUMBER, _ANGLE = UnitRule.NUMBER, UnitRule.ANGLE
_WIDE = ((-30.0, 30.0),)
# fmt: off  (a table reads by rows)
_ROWS = (
    ScalarFunction(
        "sin",
        1,
        np.sin,
        (lambda b, a, v: b.apply("cos", a[0]),),
        _ANGLE,
        "sin",
        "sin",
        "Sin",
        None,
        "sin",
        ((-100.0, 100.0),),
        "Sine of an angle in rad.",
    ),
    ScalarFunction(
        "cos",
        1,
        np.cos,
        (lambda b, a, v: b.negate(b.apply("sin", a[0])),),
        _ANGLE,
        "cos",
        "cos",
        "Cos",
        None,
        "cos",
        ((-100.0, 100.0),),
        "Cosine of an angle in rad.",
    ),
    ScalarFunction(
        "tan",
        1,
        np.tan,
        (lambda b, a, v: _one_plus_square(b, v),),
        _ANGLE,
        "tan",
        "tan",
        None,
        _define_tan,
        "tan",
        ((-1.5, 1.5),),
        "Tangent of an angle in rad.",
    ),
    ScalarFunction(
        "asin",
        1,
        np.arcsin,
        (lambda b, a, v: _inverse(b, b.apply("sqrt", _one_minus_square(b, a[0]))),),
        UnitRule.TO_ANGLE,
        "asin",
        "asin",
        None,
        _define_by_kernel("asin"),
        "asin",
        ((-0.99, 0.99),),
        "Arc sine in rad, −π/2 … π/2.",
    ),
    ScalarFunction(
        "acos",
        1,
        np.arccos,
        (lambda b, a, v: b.negate(_inverse(b, b.apply("sqrt", _one_minus_square(b, a[0])))),),
        UnitRule.TO_ANGLE,
        "acos",
        "acos",
        None,
        _define_by_kernel("acos"),
        "acos",
        ((-0.99, 0.99),),
        "Arc cosine in rad, 0 … π.",
    ),
    ScalarFunction(
        "atan",
        1,
        np.arctan,
        (lambda b, a, v: _inverse(b, _one_plus_square(b, a[0])),),
        UnitRule.TO_ANGLE,
        "atan",
        "atan",
        None,
        _define_by_kernel("atan"),
        "atan",
        ((-50.0, 50.0),),
        "Arc tangent in rad, −π/2 … π/2.",
    ),
    ScalarFunction(
        "atan2",
        2,
        np.arctan2,
        (
            lambda b, a, v: b.divide(a[1], _squares(b, a)),
            lambda b, a, v: b.negate(b.divide(a[0], _squares(b, a))),
        ),
        UnitRule.RATIO_TO_ANGLE,
        "atan2",
        "atan2",
        None,
        _define_by_kernel("atan2"),
        "atan2",
        ((-5.0, 5.0), (-5.0, 5.0)),
        "Angle of the point (x, y) = (second, first) in rad, −π … π.",
    ),
    ScalarFunction(
        "sinh",
        1,
        np.sinh,
        (lambda b, a, v: b.apply("cosh", a[0]),),
        _NUMBER,
        "sinh",
        "sinh",
        None,
        _define_sinh,
        "sinh",
        ((-10.0, 10.0),),
        "Hyperbolic sine.",
    ),
    ScalarFunction(
        "cosh",
        1,
        np.cosh,
        (lambda b, a, v: b.apply("sinh", a[0]),),
        _NUMBER,
        "cosh",
        "cosh",
        None,
        _define_cosh,
        "cosh",
        ((-10.0, 10.0),),
        "Hyperbolic cosine.",
    ),
    ScalarFunction(
        "tanh",
        1,
        np.tanh,
        (lambda b, a, v: _one_minus_square(b, v),),
        _NUMBER,
        "tanh",
        "tanh",
        "Tanh",
        None,
        "tanh",
        _WIDE,
        "Hyperbolic tangent.",
    ),
    ScalarFunction(
        "exp",
        1,
        np.exp,
        (lambda b, a, v: v,),
        _NUMBER,
        "exp",
        "exp",
        "Exp",
        None,
        "exp",
        ((-20.0, 20.0),),
        "Exponential.",
    ),
    ScalarFunction(
        "log",
        1,
        np.log,
        (lambda b, a, v: _inverse(b, a[0]),),
        _NUMBER,
        "log",
        "log",
        "Log",
        None,
        "log",
        ((1e-3, 1e3),),
        "Natural logarithm; NaN below 0.",
    ),
    ScalarFunction(
        "sqrt",
        1,
        np.sqrt,
        (lambda b, a, v: b.divide(b.constant(0.5), v),),
        UnitRule.ROOT,
        "sqrt",
        "sqrt",
        "Sqrt",
        None,
        None,
        ((1e-3, 1e3),),
        "Square root; NaN below 0.",
    ),
    ScalarFunction(
        "abs",
        1,
        np.abs,
        (lambda b, a, v: b.apply("sign", a[0]),),
        UnitRule.SAME,
        "abs",
        "fabs",
        "Abs",
        None,
        None,
        _WIDE,
        "Magnitude; slope 0 at 0.",
    ),
    ScalarFunction(
        "sign",
        1,
        np.sign,
        (lambda b, a, v: b.multiply(b.constant(0.0), a[0]),),
        UnitRule.SIGN,
        "sign",
        "sign",
        "Sign",
        None,
        None,
        _WIDE,
        "−1, 0 or 1; slope 0 everywhere.",
    ),
    ScalarFunction(
        "sigmoid",
        1,
        _sigmoid,
        (lambda b, a, v: b.multiply(v, b.subtract(b.constant(1.0), v)),),
        _NUMBER,
        "sigmoid",
        "",
        None,
        _define_sigmoid,
        "sigmoid",
        _WIDE,
        "1 / (1 + exp(−x)).",
    ),
    ScalarFunction(
        "softplus",
        1,
        _softplus,
        (lambda b, a, v: b.apply("sigmoid", a[0]),),
        _NUMBER,
        "",
        "",
        None,
        _define_softplus,
        "softplus",
        _WIDE,
        "log(1 + exp(x)), smooth max(x, 0).",
    ),
    ScalarFunction(
        "pow",
        2,
        np.power,
        (
            lambda b, a, v: b.multiply(
                a[1], b.apply("pow", a[0], b.subtract(a[1], b.constant(1.0)))
            ),
            lambda b, a, v: b.multiply(v, b.apply("log", a[0])),
        ),
        _NUMBER,
        "pow",
        "power",
        "Pow",
        None,
        "pow",
        ((0.1, 10.0), (-3.0, 3.0)),
        "x to a real power; NaN for a negative x and a power that is no integer.",
    ),
)
# fmt: on

SCALAR_FUNCTIONS: dict[str, ScalarFunction] = {row.name: row for row in _ROWS}
"""The table by name. An empty spelling means that the backend lowers `definition`."""
