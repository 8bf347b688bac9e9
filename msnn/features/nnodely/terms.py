"""Builds expressions as trees whose windows can be sliced."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from operator import add, mul, sub
from typing import TypeAlias

import numpy as np

LARGEST = float(np.finfo(np.float32).max)
"""Largest number in single precision, in which nnodely computes."""
ATOM, POWER, SIGN, PRODUCT, SUM = 5, 4, 3, 2, 1
"""Precedence of a text."""


@dataclass(frozen=True, slots=True)
class Number:
    """A number in a term."""

    value: float


@dataclass(frozen=True, slots=True)
class Signal:
    """The window t + first … t + last of an input, a state or an equation, in a term."""

    name: str
    first: int
    last: int


@dataclass(frozen=True, slots=True)
class Named:
    """A parameter, a constant, the sample time or an argument of a function."""

    name: str
    axes: tuple[str, ...] = ()
    timed: bool = False
    """True if its last axis is the window."""


@dataclass(frozen=True, slots=True)
class Held:
    """An equation that is referred to by its name, because a gradient is taken with
    respect to it.
    """

    name: str


@dataclass(frozen=True, slots=True)
class Infix:
    """A binary operator, left-associative; `binding` is its precedence."""

    sign: str
    binding: int


@dataclass(frozen=True, slots=True)
class Minus:
    """The unary minus."""


@dataclass(frozen=True, slots=True)
class Call:
    """A call of a function; `rest` is the text of the arguments after the operands, such as `,
    dim=x`.
    """

    name: str
    rest: str = ""
    steady: bool = True
    """True if each sample of the result depends on the same sample of the operands."""


Head: TypeAlias = Number | Signal | Named | Held | Infix | Minus | Call


@dataclass(frozen=True, slots=True, eq=False)
# eq=False: a term is its identity. Parts are shared by it, and comparing trees would be exponential
class Term:
    """An expression of the spec as a tree: an operation and its operands."""

    head: Head
    args: tuple[Term, ...] = ()
    window: int | None = None
    """Number of samples along its window; None for a single value."""
    dim: int = 1
    """Number of elements along its dimension; 1 for a scalar."""


_FOLDED = {"+": add, "-": sub, "*": mul}


class CutError(Exception):
    """A window of a term cannot be sliced, because its samples are not available separately."""


@dataclass(slots=True)
class Cutter:
    """Takes slices of the windows of terms; equal slices of one term are shared."""

    samples: Callable[[Term, int, int], Term]
    """A slice of a parameter along its last axis."""
    stacked: Callable[[Sequence[Term]], Term]
    """Samples as a slice of a parameter along the window."""
    _known: dict[tuple[int, int, int], tuple[Term, Term]] = field(
        default_factory=dict[tuple[int, int, int], "tuple[Term, Term]"]
    )

    def cut(self, term: Term, first: int, end: int) -> Term:
        """The samples first … end − 1 of a term's window, counted from 0 at the oldest. Raises
        CutError if its samples are not available separately.
        """
        for node in after_operands(term, lambda t: (id(t), first, end) in self._known):
            # the node is kept beside its part: while it lives no other node has its id
            self._known[(id(node), first, end)] = (node, self._cut_node(node, first, end))
        return self._known[(id(term), first, end)][1]

    def _cut_node(self, term: Term, first: int, end: int) -> Term:
        if term.window is None or (first == 0 and end == term.window):
            return term
        window = end - first if end - first > 1 else None
        match term.head:
            case Signal(name, start):
                head = Signal(name, start + first, start + end - 1)
                return Term(head, (), window, term.dim)
            case Named():
                return self.samples(term, first, end)
            case Call("stack", steady=False) if len(term.args) == term.window:
                return self.stacked(term.args[first:end])
            # a window of these is known as a whole alone
            case Held() | Call(steady=False):
                raise CutError
            # element by element: a part of the result is made of the same part of the operands
            case head:
                args = tuple(self._known[(id(arg), first, end)][1] for arg in term.args)
                return Term(head, args, window, term.dim)


def after_operands(root: Term, is_done: Callable[[Term], bool]) -> Iterator[Term]:
    """Yields the terms of a tree, operands first, each once. Terms for which `is_done` returns True
    are left out with their operands.
    """
    # a stack of our own: chains of relations are longer than Python lets functions nest
    stack = [(root, False)]
    seen: set[int] = set()
    while stack:
        term, ready = stack.pop()
        if ready:
            yield term
            continue
        if id(term) in seen or is_done(term):
            continue
        seen.add(id(term))
        stack.append((term, True))
        stack.extend((arg, False) for arg in reversed(term.args))


def number(value: float) -> Term:
    """A number as a term."""
    return Term(Number(value))


def joined(head: Head, *args: Term, dim: int | None = None) -> Term:
    """A term for an operation that is applied to each sample and element of its operands. It has
    their window, and `dim` elements, by default as many as the largest operand.
    """
    windows = [arg.window for arg in args if arg.window is not None]
    size = max((arg.dim for arg in args), default=1) if dim is None else dim
    return Term(head, args, windows[0] if windows else None, size)


def infix(sign: str, left: Term, right: Term) -> Term:
    """The term `left sign right`; operations on two numbers are computed, and + 0, − 0, · 1 and / 1
    are dropped.
    """
    if isinstance(left.head, Number) and isinstance(right.head, Number) and sign in _FOLDED:
        return number(_FOLDED[sign](left.head.value, right.head.value))
    if sign == "+" and _is(left, 0.0) and right.args:
        return right
    if (sign in "+-" and _is(right, 0.0)) or (sign in "*/" and _is(right, 1.0)):
        return left
    return joined(Infix(sign, PRODUCT if sign in "*/@" else SUM), left, right)


def plus(left: Term, right: Term) -> Term:
    """The sum of two terms."""
    return infix("+", left, right)


def minus(left: Term, right: Term) -> Term:
    """The difference of two terms."""
    return infix("-", left, right)


def times(left: Term, right: Term) -> Term:
    """The product of two terms."""
    return infix("*", left, right)


def quotient(left: Term, right: Term) -> Term:
    """The quotient of two terms."""
    return infix("/", left, right)


def larger(left: Term, right: Term) -> Term:
    """The elementwise maximum of two terms."""
    return call("max", left, right)


def smaller(left: Term, right: Term) -> Term:
    """The elementwise minimum of two terms."""
    return call("min", left, right)


def same(term: Term) -> Term:
    """Returns the term unchanged, as the function of relations that change nothing."""
    return term


def power(base: Term, exponent: Term) -> Term:
    """The term base to the exponent: `x ** 2` for a number as exponent, else `pow(x, y)`."""
    if _is(exponent, 1.0):
        return base
    if isinstance(exponent.head, Number):
        return joined(Infix("**", POWER), base, exponent)
    return joined(Call("pow"), base, exponent)


def call(name: str, *args: Term, rest: str = "", dim: int | None = None) -> Term:
    """A call of a function that works elementwise, or along the dimension only, so that windows can
    be sliced. `rest` is the text of further arguments, `dim` the number of elements.
    """
    return joined(Call(name, rest), *args, dim=dim)


def _is(term: Term, value: float) -> bool:
    return isinstance(term.head, Number) and term.head.value == value


def number_text(value: float) -> str:
    """A number as text: the shortest that is equal in single precision.

    A value saved in single precision is then written as its author wrote it: 9.81, not
    9.8100004196167.
    """
    if float(value).is_integer() and abs(value) < 1e15:
        # from 1e15 on a double does not hold every whole number that would be written
        return str(int(value))
    return "pi" if value == math.pi else repr(shortest(value))


def shortest(value: float) -> float:
    """The number with the fewest digits that is equal to `value` in single precision; `value`
    itself if it is no single-precision number.
    """
    if abs(value) > LARGEST:
        return float(value)
    single = np.float32(value)
    # numpy writes a float32 with as few digits as tell it from its neighbours
    return float(str(single)) if float(single) == value else float(value)


def text_of(term: Term, operands: Sequence[tuple[str, int]]) -> tuple[str, int]:
    """The text of a term and its precedence, from those of its operands."""
    match term.head:
        case Number(value):
            return number_text(value), SIGN if value < 0 else ATOM
        case Signal(name, first, last):
            return _signal_text(name, first, last, term.window is not None), ATOM
        case Named(name) | Held(name):
            return name, ATOM
        case Minus():
            return f"-{_closed(operands[0], POWER)}", SIGN
        case Infix("**"):
            return f"{_closed(operands[0], ATOM)} ** {_closed(operands[1], ATOM)}", POWER
        case Infix(sign, binding):
            # on the right what binds alike needs brackets: a − (b − c)
            left, right = _closed(operands[0], binding), _closed(operands[1], binding + 1)
            return f"{left} {sign} {right}", binding
        case Call(name, rest):
            inner = ", ".join(text for text, _ in operands)
            return f"{name}({inner}{rest})", ATOM


def text_of_whole(root: Term) -> str:
    """The text of a term in the language of specs, with all its operands."""
    texts: dict[int, tuple[str, int]] = {}
    for node in after_operands(root, lambda one: False):
        texts[id(node)] = text_of(node, [texts[id(arg)] for arg in node.args])
    return texts[id(root)][0]


def _closed(operand: tuple[str, int], binding: int) -> str:
    text, own = operand
    return text if own >= binding else f"({text})"


def _signal_text(name: str, first: int, last: int, is_window: bool) -> str:
    if not is_window:
        return name if first == 0 else f"{name}[{_time(first)}]"
    if last == 0:
        return f"{name}.past({1 - first})"
    return f"{name}[{_time(first)}:{_time(last)}]"


def _time(offset: int) -> str:
    return "t" if offset == 0 else f"t{offset:+d}"
