"""Lists the kinds of relations that are functions of values, and parses their options."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from msnn.features.nnodely.followed_python.torch_names import SAME, negative
from msnn.features.nnodely.terms.terms import Term, call, minus, plus, power, quotient, same, times
from msnn.features.nnodely.terms.values import ShapeError, Value

OF_TWO: Mapping[str, Callable[[Term, Term], Term]] = {
    "Add": plus,
    "Sub": minus,
    "Mul": times,
    "Div": quotient,
    "Pow": power,
}
"""Functions of two values, element by element."""
OF_ONE: Mapping[str, Callable[[Term], Term]] = {
    "Neg": negative,
    "Sign": SAME["sign"],
    "Sin": SAME["sin"],
    "Cos": SAME["cos"],
    "Tan": SAME["tan"],
    "Tanh": SAME["tanh"],
    "Cosh": SAME["cosh"],
    "Sech": lambda x: call("sech", x),
    "Relu": SAME["relu"],
    "ELU": SAME["elu"],
    "Sigmoid": SAME["sigmoid"],
    "Identity": same,
}
"""Functions of one value, element by element."""


class UnknownKindError(Exception):
    """An unsupported relation."""

    def __init__(self, what: str, repair: str) -> None:
        super().__init__(what)
        self.repair = repair


def unknown_form(kind: str) -> UnknownKindError:
    """An unsupported kind of relation, or unexpected arguments."""
    repair = "save it anew by `saveModel` of nnodely 1.x, or write its formula in a spec"
    if kind == "NeuralODE":
        repair = "write `states: {x: {der: …}}` with `integrator:` in a spec"
    return UnknownKindError(f"a relation `{kind}` of this form is not known", repair)


def counted(values: list[Value], wanted: int) -> list[Value]:
    """The operands, if their number is correct."""
    if len(values) != wanted:
        raise ShapeError(f"{len(values)} operands, where {wanted} are needed")
    return values


def one_name(rest: list[Any]) -> str:
    """The only option of a relation, a name."""
    if len(rest) == 1 and isinstance(rest[0], str):
        return rest[0]
    what, repair = "a `ParamFun` of this form is not known", "name one function after its operands"
    raise UnknownKindError(what, repair)


def dropout_share(rest: list[Any]) -> float:
    """The dropout fraction of a layer; 0 if not given."""
    match rest:
        case []:
            return 0.0
        case [int() | float() as share] if not isinstance(share, bool) and 0 <= share < 1:
            return float(share)
        case _:
            raise UnknownKindError("a dropout that is no share", "take 0 … 1, without 1")
