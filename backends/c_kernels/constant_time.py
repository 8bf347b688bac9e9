"""Lowers selections to functions that a compiler cannot turn into branches.

Even if both values of `c ? a : b` are computed, compilers may move the work into the arms. Reading
an array element at an index that depends on c takes the same instructions for every c. Compilers
may also duplicate the code after a comparison, once per result. A bool is therefore an integer, 0
or 1, that was stored in a volatile object, whose value a compiler cannot know.
"""

from __future__ import annotations

from backends.c_kernels.routine import RoutineLowering
from backends.c_language import tree as c
from backends.c_language.printer import Printer
from compiler.kernels.trace.statements import COMPARISONS, Operand, Operator, ValueKind

_SELECT = {
    ValueKind.REAL: "select_real",
    ValueKind.UNSIGNED: "select_word",
    ValueKind.WIDE: "select_wide",
    ValueKind.TRUTH: "select_word",
}
"""Replacement of `condition ? then : otherwise`, by the kind of its value."""

_COMBINE = {Operator.BOTH: "&", Operator.EITHER: "|"}
"""Replacement of `&&` and `||`, which skip their second operand."""

_TRUTH = "truth_word"
"""The function around a comparison."""


class ConstantTimeLowering(RoutineLowering):
    """Translates a traced math kernel to C without branches. `choices` collects the names of the
    functions that it calls for selections and comparisons.
    """

    def type(self, kind: ValueKind) -> c.CType:
        # converting to a C `bool` is a comparison, which a compiler may branch on
        return super().type(ValueKind.UNSIGNED if kind is ValueKind.TRUTH else kind)

    def constant(self, kind: ValueKind, value: float) -> c.Expression:
        return super().constant(ValueKind.UNSIGNED if kind is ValueKind.TRUTH else kind, value)

    def opposite(self, condition: c.Expression) -> c.Expression:
        # `!` may become a branch; exclusive or of 0 or 1 does not
        return c.Binary("^", condition, c.Unsigned(1))

    def binary(self, operator: Operator, left: Operand, right: Operand) -> c.Expression:
        if operator in _COMBINE:
            return c.Binary(_COMBINE[operator], self.operand(left), self.operand(right))
        result = super().binary(operator, left, right)
        return self._helper(_TRUTH, result) if operator in COMPARISONS else result

    def select(
        self, kind: ValueKind, condition: c.Expression, then: c.Expression, otherwise: c.Expression
    ) -> c.Expression:
        return self._helper(_SELECT[kind], condition, then, otherwise)

    def _helper(self, function: str, *arguments: c.Expression) -> c.Expression:
        self.choices.add(function)
        return c.Call(f"{self.printer.prefix}_{function}", arguments)


def choice_functions(names: set[str], printer: Printer) -> list[c.Function]:
    """C definitions of those functions for selections and comparisons that are in `names`, in a
    fixed order.
    """
    types = {"real": c.CType.REAL, "word": c.CType.UNSIGNED, "wide": c.CType.WIDE}
    truth = [_truth(printer)] if _TRUTH in names else []
    return truth + [
        _selecting(f"select_{kind}", type, printer)
        for kind, type in types.items()
        if f"select_{kind}" in names
    ]


def _truth(printer: Printer) -> c.Function:
    condition, yes, no, known = map(c.Name, ("condition", "yes", "no", "known"))
    word = c.CType.UNSIGNED
    value = c.Conditional(condition, yes, no)
    return c.Function(
        name=f"{printer.prefix}_{_TRUTH}",
        result=printer.type(word),
        arguments=(c.Argument("bool", condition.text),),
        body=(
            c.Declare(word, yes.text, c.Unsigned(1), constant=True),
            c.Declare(word, no.text, c.Unsigned(0), constant=True),
            # volatile, so that the compiler cannot know the value
            c.Declare(word, known.text, value, constant=True, volatile=True),
            c.Return(known),
        ),
        static=True,
        inline=True,
    )


def _selecting(name: str, type: c.CType, printer: Printer) -> c.Function:
    truth, then, otherwise, both = map(c.Name, ("truth", "then", "otherwise", "both"))
    written = printer.type(type)
    # index 0 is selected if the bool is 0
    values = (otherwise, then)
    return c.Function(
        name=f"{printer.prefix}_{name}",
        result=written,
        arguments=(
            c.Argument(printer.type(c.CType.UNSIGNED), truth.text),
            c.Argument(written, then.text),
            c.Argument(written, otherwise.text),
        ),
        body=(
            c.Declare(type, both.text, size=len(values), elements=values, constant=True),
            c.Return(c.Element(both, truth)),
        ),
        static=True,
        inline=True,
    )
