"""Writes the small functions of C in fixed point: limits, shifts, tables."""

from __future__ import annotations

from collections.abc import Callable

from backends.c_language.tree import (
    Argument,
    Binary,
    Call,
    Conditional,
    Convert,
    CType,
    Declare,
    Element,
    Expression,
    Function,
    Integer,
    Name,
    Return,
    Statement,
    Unsigned,
)


class FixedHelpers:
    """Spells calls and remembers what was called."""

    def __init__(self, prefix: str) -> None:
        self._prefix = prefix
        self._used: dict[str, Callable[[], Function]] = {}

    def limited(self, x: Expression, low: int, high: int) -> Expression:
        """x moved to the nearest limit."""
        return self._call("limited", self._limited, (x, Integer(low), Integer(high)))

    def rounded(self, x: Expression, bits: int) -> Expression:
        """x / 2^bits, rounded."""
        return self._call(f"rounded_{bits}", lambda: self._rounded(bits), (x,))

    def interpolated(self, table: Expression, distance: Expression, bits: int) -> Expression:
        """The value of a table with cells of 2^bits, at a distance from its first place."""
        if bits > 0:
            self.rounded(distance, bits)  # the definition calls it: it is to stand before
        name = f"interpolated_{bits}"
        return self._call(name, lambda: self._interpolated(bits), (table, distance))

    def definitions(self) -> tuple[Function, ...]:
        """What was called, each after what it calls."""
        return tuple(make() for make in self._used.values())

    def _call(
        self, name: str, make: Callable[[], Function], arguments: tuple[Expression, ...]
    ) -> Expression:
        self._used.setdefault(name, make)
        return Call(f"{self._prefix}_{name}", arguments)

    def _limited(self) -> Function:
        x, low, high, above = (Name(text) for text in ("x", "low", "high", "above"))
        body = (
            _constant(CType.SUM, above, Conditional(Binary(">", x, low), x, low)),
            Return(Conditional(Binary("<", above, high), above, high)),
        )
        arguments = tuple(Argument(self._sum, name.text) for name in (x, low, high))
        return self._function("limited", arguments, body, "x moved to the nearest limit.")

    def _rounded(self, bits: int) -> Function:
        """A right shift of a negative number would be each compiler's own affair; the division is
        exact, so that compilers make it that shift."""
        x, raised, pattern, low_bits, rest = (
            Name(text) for text in ("x", "raised", "pattern", "low_bits", "rest")
        )
        unit = 1 << bits
        body = (
            # half a unit more, without its low bits: a multiple of the unit, halves upwards
            _constant(CType.SUM, raised, Binary("+", x, Integer(unit >> 1))),
            # modulo 2ⁿ by the standard: the low bits of a negative number are those of two's
            # complement
            _constant(CType.BITS, pattern, Convert(CType.BITS, raised)),
            _constant(CType.BITS, low_bits, Binary("&", pattern, Unsigned(unit - 1))),
            _constant(CType.SUM, rest, Convert(CType.SUM, low_bits)),
            Return(Binary("/", Binary("-", raised, rest), Integer(unit))),
        )
        doc = f"x / 2^{bits}, rounded to the nearest number, halves upwards."
        arguments = (Argument(self._sum, x.text),)
        return self._function(f"rounded_{bits}", arguments, body, doc)

    def _interpolated(self, bits: int) -> Function:
        table, distance, place, cell, inside, part, left, right = (
            Name(text)
            for text in ("table", "distance", "place", "cell", "inside", "part", "left", "right")
        )
        body: tuple[Statement, ...] = (_constant(CType.BITS, place, Convert(CType.BITS, distance)),)
        if bits == 0:
            body = (*body, Return(Convert(CType.SUM, Element(table, place))))
        else:
            after = Element(table, Binary("+", cell, Unsigned(1)))
            rise = Binary("*", Binary("-", right, left), part)
            body = (
                *body,
                _constant(CType.BITS, cell, Binary(">>", place, Unsigned(bits))),
                _constant(CType.BITS, inside, Binary("&", place, Unsigned((1 << bits) - 1))),
                _constant(CType.SUM, part, Convert(CType.SUM, inside)),
                _constant(CType.SUM, left, Convert(CType.SUM, Element(table, cell))),
                _constant(CType.SUM, right, Convert(CType.SUM, after)),
                Return(Binary("+", left, self.rounded(rise, bits))),
            )
        doc = f"The straight line between two values of a table whose cells are 2^{bits} wide."
        arguments = (
            Argument(f"const {self._prefix}_word_t *", table.text),
            Argument(self._sum, distance.text),
        )
        return self._function(f"interpolated_{bits}", arguments, body, doc)

    @property
    def _sum(self) -> str:
        return f"{self._prefix}_sum_t"

    def _function(
        self, name: str, arguments: tuple[Argument, ...], body: tuple[Statement, ...], doc: str
    ) -> Function:
        full_name = f"{self._prefix}_{name}"
        return Function(
            name=full_name,
            result=self._sum,
            arguments=arguments,
            body=body,
            doc=doc,
            static=True,
            inline=True,
        )


def _constant(type: CType, name: Name, value: Expression) -> Declare:
    return Declare(type, name.text, value, constant=True)
