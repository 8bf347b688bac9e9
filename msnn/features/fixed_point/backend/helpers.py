"""Writes the helper functions of fixed-point C: limits, shifts, table interpolation."""

from __future__ import annotations

from collections.abc import Callable

from backends.c_language import tree as c


class FixedHelpers:
    """Writes calls of helper functions and records which helpers were called."""

    def __init__(self, prefix: str) -> None:
        self._prefix = prefix
        self._used: dict[str, Callable[[], c.Function]] = {}

    def limited(self, x: c.Expression, low: int, high: int) -> c.Expression:
        """The C expression of a call that limits x to the range low … high."""
        return self._call("limited", self._limited, (x, c.Integer(low), c.Integer(high)))

    def rounded(self, x: c.Expression, bits: int) -> c.Expression:
        """The C expression of a call that computes x / 2^bits, rounded to the nearest integer,
        halves upwards.
        """
        return self._call(f"rounded_{bits}", lambda: self._rounded(bits), (x,))

    def interpolated(self, table: c.Expression, distance: c.Expression, bits: int) -> c.Expression:
        """The C expression of a call that interpolates in a table linearly. Its cells are 2^bits
        wide; `distance` is that of the argument from the first point of the table.
        """
        if bits > 0:
            self.rounded(distance, bits)  # the definition calls it: it is to stand before
        name = f"interpolated_{bits}"
        return self._call(name, lambda: self._interpolated(bits), (table, distance))

    def definitions(self) -> tuple[c.Function, ...]:
        """The called helpers, each after the helpers that it calls."""
        # a dict keeps the order of first calls: a helper that another calls was called before it
        return tuple(make() for make in self._used.values())

    def _call(
        self, name: str, make: Callable[[], c.Function], arguments: tuple[c.Expression, ...]
    ) -> c.Expression:
        self._used.setdefault(name, make)
        return c.Call(f"{self._prefix}_{name}", arguments)

    def _limited(self) -> c.Function:
        x, low, high, above = (c.Name(text) for text in ("x", "low", "high", "above"))
        body = (
            _constant(c.CType.SUM, above, c.Conditional(c.Binary(">", x, low), x, low)),
            c.Return(c.Conditional(c.Binary("<", above, high), above, high)),
        )
        arguments = tuple(c.Argument(self._sum, name.text) for name in (x, low, high))
        return self._function("limited", arguments, body, "x moved to the nearest limit.")

    def _rounded(self, bits: int) -> c.Function:
        """The function x / 2^bits. It uses an exact division, as C leaves right shifts of negative
        numbers to the compiler; compilers turn the division into a shift.
        """
        x, raised, pattern, low_bits, rest = (
            c.Name(text) for text in ("x", "raised", "pattern", "low_bits", "rest")
        )
        unit = 1 << bits
        body = (
            # half a unit more, without its low bits: a multiple of the unit, halves upwards
            _constant(c.CType.SUM, raised, c.Binary("+", x, c.Integer(unit >> 1))),
            # modulo 2ⁿ by the standard: the low bits of a negative number are those of two's
            # complement
            _constant(c.CType.BITS, pattern, c.Convert(c.CType.BITS, raised)),
            _constant(c.CType.BITS, low_bits, c.Binary("&", pattern, c.Unsigned(unit - 1))),
            _constant(c.CType.SUM, rest, c.Convert(c.CType.SUM, low_bits)),
            c.Return(c.Binary("/", c.Binary("-", raised, rest), c.Integer(unit))),
        )
        doc = f"x / 2^{bits}, rounded to the nearest number, halves upwards."
        arguments = (c.Argument(self._sum, x.text),)
        return self._function(f"rounded_{bits}", arguments, body, doc)

    def _interpolated(self, bits: int) -> c.Function:
        table, distance, place, cell, inside, part, left, right = (
            c.Name(text)
            for text in ("table", "distance", "place", "cell", "inside", "part", "left", "right")
        )
        body: tuple[c.Statement, ...] = (
            _constant(c.CType.BITS, place, c.Convert(c.CType.BITS, distance)),
        )
        if bits == 0:
            body = (*body, c.Return(c.Convert(c.CType.SUM, c.Element(table, place))))
        else:
            after = c.Element(table, c.Binary("+", cell, c.Unsigned(1)))
            rise = c.Binary("*", c.Binary("-", right, left), part)
            body = (
                *body,
                _constant(c.CType.BITS, cell, c.Binary(">>", place, c.Unsigned(bits))),
                _constant(c.CType.BITS, inside, c.Binary("&", place, c.Unsigned((1 << bits) - 1))),
                _constant(c.CType.SUM, part, c.Convert(c.CType.SUM, inside)),
                _constant(c.CType.SUM, left, c.Convert(c.CType.SUM, c.Element(table, cell))),
                _constant(c.CType.SUM, right, c.Convert(c.CType.SUM, after)),
                c.Return(c.Binary("+", left, self.rounded(rise, bits))),
            )
        doc = f"The straight line between two values of a table whose cells are 2^{bits} wide."
        arguments = (
            c.Argument(f"const {self._prefix.upper()}_PLACED {self._prefix}_word_t *", table.text),
            c.Argument(self._sum, distance.text),
        )
        return self._function(f"interpolated_{bits}", arguments, body, doc)

    @property
    def _sum(self) -> str:
        return f"{self._prefix}_sum_t"

    def _function(
        self, name: str, arguments: tuple[c.Argument, ...], body: tuple[c.Statement, ...], doc: str
    ) -> c.Function:
        full_name = f"{self._prefix}_{name}"
        return c.Function(
            name=full_name,
            result=self._sum,
            arguments=arguments,
            body=body,
            doc=doc,
            static=True,
            inline=True,
        )


def _constant(type: c.CType, name: c.Name, value: c.Expression) -> c.Declare:
    return c.Declare(type, name.text, value, constant=True)
