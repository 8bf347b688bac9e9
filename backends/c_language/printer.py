"""Prints the C tree: one statement per line, nested operations in parentheses."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar, Literal, assert_never

from backends.c_language import tree as c
from backends.c_language.literals import Dtype, exact_literal, hex_literals, real_literal
from backends.c_language.rendering import WIDTH, comment, comment_text, wrapped

_INDENT = "    "


@dataclass(frozen=True, slots=True)
class Printer:
    """Prints the C tree for one program. Names of types begin with the prefix: `<prefix>_real` and
    `<prefix>_status_t`, in fixed point `<prefix>_word_t` and `<prefix>_sum_t`.
    """

    prefix: str
    dtype: Dtype = "float32"
    sum_bits: Literal[32, 64] = 32
    """Bits of a sum in fixed point."""
    places_tables: bool = False
    """True to declare constant arrays with the macro that places them in flash (`placement`)."""

    exact: ClassVar[bool] = False
    """True to write long numbers in hexadecimal."""

    @property
    def real(self) -> str:
        return f"{self.prefix}_real"

    def type(self, type: c.CType) -> str:
        match type:
            case c.CType.REAL:
                return self.real
            case c.CType.STATUS | c.CType.WORD | c.CType.SUM:
                return f"{self.prefix}_{type.value}_t"
            case c.CType.BITS:
                return f"uint{self.sum_bits}_t"
            case c.CType.BOOL | c.CType.UNSIGNED | c.CType.WIDE:
                return type.value
            case _:
                assert_never(type)

    def function(self, function: c.Function) -> str:
        """The definition of a function as text, after its comment; long lines are wrapped."""
        doc = f"{comment(function.doc)}\n" if function.doc else ""
        head = self.prototype(function)
        # wrapped last, when the indent is known
        lines = [part for line in self._block(function.body, 1) for part in wrapped(line)]
        body = "\n".join(lines)
        return f"{doc}{head}\n{{\n{body}\n}}\n"

    def prototype(self, function: c.Function) -> str:
        """Return type, name and arguments of a function as text without semicolon, wrapped if
        long.
        """
        storage = f"{'static ' if function.static else ''}{'inline ' if function.inline else ''}"
        head = f"{storage}{function.result} {function.name}("
        arguments = [_argument(argument) for argument in function.arguments] or ["void"]
        line = f"{head}{', '.join(arguments)})"
        if len(line) < WIDTH:
            return line
        return f"{head}\n{_INDENT}" + f",\n{_INDENT}".join(arguments) + ")"

    def expression(self, expression: c.Expression) -> str:
        match expression:
            case c.Name(text):
                return text
            case c.Real(value):
                return self.number(value)
            case c.Integer(value):
                # INT64_C, since a 16-bit int would truncate constants of 64-bit sums
                return str(value) if self.sum_bits == 32 else _wide_literal(value)
            case c.Unsigned(value, wide):
                # masks and bit patterns in hexadecimal, counters in decimal
                digits = f"0x{value:X}" if self.exact and value >= 1000 else str(value)
                return f"{digits}{'ULL' if wide else 'U'}"
            case c.Truth(value):
                return "true" if value else "false"
            case c.Member(base, field, pointer):
                return f"{base}{'->' if pointer else '.'}{field}"
            case c.Element(array, index):
                return f"{self.operand(array)}[{self.expression(index)}]"
            case c.Unary(operator, operand):
                return f"{operator}{self.operand(operand)}"
            case c.Binary(operator, left, right):
                return f"{self.operand(left)} {operator} {self.operand(right)}"
            case c.Conditional(condition, then, otherwise):
                chosen = f"{self.operand(then)} : {self.operand(otherwise)}"
                return f"{self.operand(condition)} ? {chosen}"
            case c.Convert(type, operand):
                return f"({self.type(type)}){self.operand(operand)}"
            case c.Call(function, arguments):
                return f"{function}({', '.join(self.expression(a) for a in arguments)})"
            case _:
                assert_never(expression)

    def number(self, value: float) -> str:
        """The literal of a real number in the program's type."""
        return (exact_literal if self.exact else real_literal)(value, self.dtype)

    def operand(self, expression: c.Expression) -> str:
        """The text of an expression as an operand of another one, in parentheses if needed."""
        text = self.expression(expression)
        match expression:
            case c.Unary() | c.Binary() | c.Conditional() | c.Convert():
                return f"({text})"
            # negative literals, for readability; "(" starts a cast, such as `(double)NAN`
            case c.Real() | c.Integer() if text.startswith(("-", "(")):
                return f"({text})"
            case _:
                return text

    def table(self, table: c.ConstantTable) -> str:
        """The definition of a constant array as text, several values per line."""
        if table.type is c.CType.REAL:
            numbers = (
                hex_literals(table.values, self.dtype)
                if table.hexadecimal
                else [self.number(value) for value in table.values]
            )
        elif table.type is c.CType.UNSIGNED:
            numbers = [self.expression(c.Unsigned(int(value))) for value in table.values]
        else:
            numbers = [str(int(value)) for value in table.values]
        place = f"{self.prefix.upper()}_PLACED " if self.places_tables else ""
        head = f"static const {place}{self.type(table.type)} {table.name}[{len(numbers)}]"
        return f"{head} = {self.braced(numbers)};"

    def braced(self, numbers: Iterable[str], indent: str = "") -> str:
        """The texts of numbers in braces, as many per line as fit. Lines have an indent of `indent`
        and one more step, the closing brace only `indent`.
        """
        lines: list[str] = []
        current = begin = f"{indent}{_INDENT}"
        for number in numbers:
            if len(current) + len(number) + len(_INDENT) + 1 > WIDTH:  # it may be inside a function
                lines.append(current.rstrip())
                current = begin
            current += f"{number}, "
        lines.append(current.rstrip().rstrip(","))
        return "{\n" + "\n".join(lines) + f"\n{indent}}}"

    def _block(self, statements: Iterable[c.Statement], depth: int) -> Iterable[str]:
        for statement in statements:
            for line in self.statement(statement):
                yield f"{_INDENT * depth}{line}"

    def statement(self, statement: c.Statement) -> Iterable[str]:
        """The lines of a statement, without the indent of its block."""
        match statement:
            case c.Declare(type, name, value, size, elements, constant, volatile, static):
                words = "static " if static else ""
                words += f"{'const ' if constant else ''}{'volatile ' if volatile else ''}"
                head = f"{words}{self.type(type)} {name}"
                if size is not None:
                    head = f"{head}[{size}]"
                if elements:
                    head = f"{head} = {{{', '.join(map(self.expression, elements))}}}"
                yield f"{head};" if value is None else f"{head} = {self.expression(value)};"
            case c.ConstantTable():
                yield from self.table(statement).split("\n")
            case c.Assign(target, value):
                yield f"{self.expression(target)} = {self.expression(value)};"
            case c.SetBits(target, bits):
                yield f"{self.expression(target)} |= {self.expression(bits)};"
            case c.Evaluate(value):
                yield f"{self.expression(value)};"
            case c.Discard(name):
                # unused arguments cause warnings, which are errors in strict builds
                yield f"(void){name};"
            case c.Loop(variable, start, stop, body, step):
                counter = f"uint32_t {variable} = {start}U"
                onward = f"{variable}++" if step == 1 else f"{variable} += {step}U"
                yield f"for ({counter}; {variable} < {stop}U; {onward}) {{"
                yield from self._block(body, 1)
                yield "}"
            case c.If():
                yield from self._if(statement)
            case c.Return(value):
                yield f"return {self.expression(value)};"
            case c.Comment(text):
                yield f"/* {comment_text(text)} */"
            case _:
                assert_never(statement)

    def _if(self, choice: c.If) -> Iterable[str]:
        yield f"if ({self.expression(choice.condition)}) {{"
        yield from self._block(choice.then, 1)
        match choice.otherwise:
            case ():
                yield "}"
            case (c.If() as following,):
                # `else if` on one line keeps the indent of chains constant
                first, *rest = self._if(following)
                yield f"}} else {first}"
                yield from rest
            case others:
                yield "} else {"
                yield from self._block(others, 1)
                yield "}"


def _wide_literal(value: int) -> str:
    text = f"INT64_C({abs(value)})"
    return f"-{text}" if value < 0 else text


def placement(prefix: str) -> str:
    """C lines that define the macro `<PREFIX>_PLACED` for constant arrays. If `<PREFIX>_IN_FLASH`
    is defined, it is `__flash`, with which gcc for AVR keeps them in flash; otherwise it is empty.
    """
    macro = prefix.upper()
    return (
        f"#if defined({macro}_IN_FLASH) && !defined(__cplusplus)\n"
        f"#define {macro}_PLACED __flash\n#else\n#define {macro}_PLACED\n#endif"
    )


def _argument(argument: c.Argument) -> str:
    space = "" if argument.type.endswith("*") else " "
    return f"{argument.type}{space}{argument.name}"
