"""Evaluates the body of a generated C function with expressions in place of numbers.

It knows what generated code has: definitions, assignments, loops with constant bounds, choices and
bits of the status; anything else is not proved. Exact evaluation leaves every operation as it is,
so that only what is stored where counts; the other one takes both zeros for one number.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

Interval = tuple[np.float32, np.float32]
Node = int

_TOKEN = re.compile(
    r"\s*(?:(?P<real>\d+\.\d*(?:e[-+]?\d+)?)f|(?P<count>\d+)U?|(?P<name>[A-Za-z_]\w*(?:->\w+)*)"
    r"|(?P<name_of>&\w+)|(?P<sign>\|=|<=|>=|==|!=|&&|\|\||\+\+|[-+*/<>!?:;(){}\[\],=]))"
)
_LEVELS = (("||",), ("&&",), ("==", "!="), ("<", ">", "<=", ">="), ("+", "-"), ("*", "/"))
_SMOOTH = ("softplus", "sigmoid", "exp", "tanh", "sin", "cos")
"""Kernels that give both zeros the same number, but for the sign of a zero."""
_ARITHMETIC: dict[str, Callable[[np.float32, np.float32], np.float32]] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
}


class NotProvedError(Exception):
    """The code has a form that this module does not know, or a zero whose sign may matter."""


@dataclass
class _Expressions:
    """Expressions, each stored once, with the interval of their values; None if NaN is possible."""

    exact: bool
    nodes: dict[tuple[object, ...], Node] = field(default_factory=dict[tuple[object, ...], Node])
    bounds: list[Interval | None] = field(default_factory=list[Interval | None])

    def new(self, key: tuple[object, ...], bounds: Interval | None = None) -> Node:
        if bounds and bounds[0] == bounds[1] and not self.exact:
            key = "number", float(bounds[0]) + 0.0
        if key not in self.nodes:
            self.nodes[key] = len(self.bounds)
            self.bounds.append(bounds)
        return self.nodes[key]

    def number(self, value: float) -> Node:
        number = np.float32(value)
        return self.new(("number", float(number)), None if self.exact else (number, number))

    def is_number(self, node: Node, value: float) -> bool:
        bounds = self.bounds[node]
        return bounds is not None and bounds[0] == bounds[1] == value

    def truth(self, node: Node) -> bool | None:
        """The truth of a condition; None if it is undecided."""
        return None if self.bounds[node] is None else not self.is_number(node, 0.0)

    def arithmetic(self, sign: str, a: Node, b: Node) -> Node:
        if self.exact:
            return self.new((sign, a, b))
        left, right = self.bounds[a], self.bounds[b]
        neutral = 1.0 if sign in ("*", "/") else 0.0
        if self.is_number(b, neutral):
            return a
        if self.is_number(a, neutral) and sign in ("+", "*"):
            return b
        if sign == "/" and (right is None or right[0] <= 0.0 <= right[1]):
            raise NotProvedError
        bounds = None
        if left is not None and right is not None:
            with np.errstate(over="ignore", under="ignore"):
                ends = [_ARITHMETIC[sign](x, y) for x in left for y in right]
            if np.all(np.isfinite(ends)):
                bounds = min(ends), max(ends)
        return self.new((sign, a, b), bounds)

    def compared(self, sign: str, a: Node, b: Node) -> Node:
        left, right = self.bounds[a], self.bounds[b]
        if sign in (">", ">="):
            return self.compared("<" if sign == ">" else "<=", b, a)
        if left is not None and right is not None and sign in ("<", "<="):
            least, most = left[1] - right[0], left[0] - right[1]
            if least < 0 or (sign == "<=" and least == 0):
                return self.number(1.0)
            if most > 0 or (sign == "<" and most == 0):
                return self.number(0.0)
        return self.new((sign, a, b))

    def chosen(self, condition: Node, a: Node, b: Node) -> Node:
        known = self.truth(condition)
        if known is not None or a == b:
            return a if known or a == b else b
        left, right = self.bounds[a], self.bounds[b]
        if left is None or right is None:
            return self.new(("?", condition, a, b))
        return self.new(("?", condition, a, b), (min(left[0], right[0]), max(left[1], right[1])))

    def called(self, name: str, args: Sequence[Node]) -> Node:
        kernel = name.rsplit("_", 1)[-1]
        if self.exact:
            return self.new((name, *args))
        if kernel in ("minimum", "maximum"):
            a, b = args
            left, right = self.bounds[a], self.bounds[b]
            if left is None or right is None:
                return self.new((kernel, a, b))
            first, second = (a, b) if kernel == "maximum" else (b, a)
            if left[0] >= right[1]:
                return first
            if right[0] >= left[1]:
                return second
            larger = np.minimum if kernel == "minimum" else np.maximum
            return self.new((kernel, a, b), (larger(left[0], right[0]), larger(left[1], right[1])))
        if kernel not in _SMOOTH:
            raise NotProvedError
        return self.new((kernel, *args))


def answers_of(
    bodies: Sequence[str], inputs: Mapping[str, Interval], *, exact: bool = False
) -> list[dict[str, tuple[Node, ...]]]:
    """The final values of each function body in memory of its caller, and the bits of its status.

    Equal expressions of all bodies are the same node.
    """
    expressions = _Expressions(exact)
    return [_Run(body, expressions, inputs).answers() for body in bodies]


class _Run:
    def __init__(
        self, body: str, expressions: _Expressions, inputs: Mapping[str, Interval]
    ) -> None:
        self._tokens = [(m.lastgroup or "", m[m.lastgroup or 0]) for m in _TOKEN.finditer(body)]
        if "".join(text for _, text in self._tokens) != re.sub(r"(?<=\d)[fU]\b|\s", "", body):
            raise NotProvedError
        self._at, self._known = 0, expressions
        self._values = {name: expressions.new((name,), ends) for name, ends in inputs.items()}
        self._counts: dict[str, int] = {}
        self._status: list[Node] = []

    def answers(self) -> dict[str, tuple[Node, ...]]:
        while self._at < len(self._tokens):
            self._statement()
        left = {name: (node,) for name, node in self._values.items() if "->" in name}
        return left | {"status": tuple(self._status)}

    def _next(self) -> str:
        return self._tokens[self._at][1] if self._at < len(self._tokens) else ""

    def _take(self, *expected: str) -> str:
        text = self._next()
        if expected and text not in expected:
            raise NotProvedError
        self._at += 1
        return text

    def _statement(self) -> None:
        first = self._next()
        if first == "for":
            self._loop()
        elif first == "return":
            while self._take() != ";":
                pass
        elif first == "(":  # (void)s;
            for text in ("(", "void", ")"):
                self._take(text)
            self._at += 1
            self._take(";")
        elif first == "if":
            self._report()
        elif first in ("while", "switch", "do", "static", "{"):
            raise NotProvedError
        else:
            self._assignment()

    def _report(self) -> None:
        """Evaluates `if (…) { status |= BIT; }` and `if (…) { model_flagged(x, low, high, &status);
        }`.
        """
        for text in ("if", "("):
            self._take(text)
        condition = self._expression()
        for text in (")", "{"):
            self._take(text)
        if self._next() == "status":
            self._at += 1
            self._take("|=")
        said = self._expression()
        for text in (";", "}"):
            self._take(text)
        self._status.append(self._known.new(("if", condition, said)))

    def _assignment(self) -> None:
        words: list[str] = []
        while self._at < len(self._tokens) and self._tokens[self._at][0] == "name":
            words.append(self._take())
        if not words:
            raise NotProvedError
        place = words[-1]
        if self._next() == "[":
            place = self._indexed(place)
        sign = self._take(";", "=", "|=")
        if sign == ";":
            return
        value = self._expression()
        self._take(";")
        if words[-1] == "status":
            self._status.append(value)
        elif sign == "=":
            self._values[place] = value
        else:
            raise NotProvedError

    def _loop(self) -> None:
        """Evaluates `for (uint32_t i = 0U; i < 6U; i++) { … }`."""
        for text in ("for", "(", "uint32_t"):
            self._take(text)
        name = self._take()
        self._take("=")
        first = int(self._take())
        for text in (";", name, "<"):
            self._take(text)
        end = int(self._take())
        for text in (";", name, "++", ")", "{"):
            self._take(text)
        begin = self._at
        after = begin
        for count in range(first, end):
            self._counts[name], self._at = count, begin
            while self._next() != "}":
                self._statement()
            after = self._at + 1
        if end <= first:
            raise NotProvedError
        del self._counts[name]
        self._at = after

    def _indexed(self, name: str) -> str:
        self._take("[")
        index = self._index()
        self._take("]")
        return f"{name}[{index}]"

    def _index(self) -> int:
        total = self._product()
        while self._next() in ("+", "-"):
            total += self._product() if self._take() == "+" else -self._product()
        return total

    def _product(self) -> int:
        total = self._count()
        while self._next() == "*":
            self._take("*")
            total *= self._count()
        return total

    def _count(self) -> int:
        if self._next() == "(":
            self._take("(")
            inside = self._index()
            self._take(")")
            return inside
        kind, text = self._tokens[self._at]
        self._at += 1
        if kind == "count":
            return int(text)
        if text not in self._counts:
            raise NotProvedError
        return self._counts[text]

    def _expression(self) -> Node:
        condition = self._level(0)
        if self._next() != "?":
            return condition
        self._take("?")
        first = self._expression()
        self._take(":")
        return self._known.chosen(condition, first, self._expression())

    def _level(self, level: int) -> Node:
        if level == len(_LEVELS):
            return self._unary()
        left = self._level(level + 1)
        while self._next() in _LEVELS[level]:
            sign = self._take()
            right = self._level(level + 1)
            if sign in _ARITHMETIC:
                left = self._known.arithmetic(sign, left, right)
            elif self._known.exact:
                left = self._known.new((sign, left, right))
            elif sign in ("<", ">", "<=", ">="):
                left = self._known.compared(sign, left, right)
            else:
                raise NotProvedError
        return left

    def _unary(self) -> Node:
        if self._next() == "-":
            self._take("-")
            if self._known.exact:
                return self._known.new(("negative", self._unary()))
            return self._known.arithmetic("-", self._known.number(0.0), self._unary())
        if self._next() == "!" and self._known.exact:
            self._take("!")
            return self._known.new(("!", self._unary()))
        if self._next() == "(":
            self._take("(")
            inside = self._expression()
            self._take(")")
            return inside
        kind, text = self._tokens[self._at]
        self._at += 1
        if kind == "real":
            return self._known.number(float(text))
        if self._known.exact and kind in ("count", "name_of"):
            return self._known.new((kind, text))
        if kind != "name":
            raise NotProvedError
        if self._next() == "(":
            return self._called(text)
        name = self._indexed(text) if self._next() == "[" else text
        if name not in self._values:
            # exact: what was never written is a number like any other
            if "->" not in name and not name.isupper() and not self._known.exact:
                raise NotProvedError
            self._values[name] = self._known.new((name,))
        return self._values[name]

    def _called(self, name: str) -> Node:
        self._take("(")
        args = [self._expression()]
        while self._take(",", ")") == ",":
            args.append(self._expression())
        return self._known.called(name, args)
