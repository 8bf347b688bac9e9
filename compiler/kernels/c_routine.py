"""C99 text of one traced routine: a single-use value stands where it is used, others are named.

The text keeps to what strict warnings and MISRA checkers ask for: one declaration and one statement
a line, no nested ?:, no implicit conversions, casts of plain variables only, unsigned literals with
U, complete else branches, one exit.
"""

from __future__ import annotations

from collections import Counter
from typing import assert_never

from compiler.kernels.c_choices import COMBINE, SELECT, TRUTH
from compiler.kernels.c_literals import bare, c_kind, literal, unsigned_literal
from compiler.kernels.trace.operand_uses import branch_values, operands, plain_operands
from compiler.kernels.trace.statements import (
    COMPARISONS,
    Assign,
    Binary,
    Block,
    Branch,
    Call,
    Constant,
    Convert,
    Function,
    Kind,
    Local,
    Lookup,
    Operand,
    Operation,
    Operator,
    Routine,
    Select,
    Table,
    Unary,
)

INLINE_LENGTH = 50
"""Longest text of a value that is written where it is used, in characters."""


class RoutineText:
    """Lines of a routine's body; `needs_math` tells whether they use <math.h>.

    In `constant_time` choices are calls of functions; `choices` has the names of those.
    """

    def __init__(self, routine: Routine, prefix: str, constant_time: bool = False) -> None:
        self.routine = routine
        self.format = routine.format
        self.constant_time = constant_time
        self.choices: set[str] = set()
        self.prefix = prefix
        self.lines: list[str] = []
        self.tables: dict[str, Table] = {}
        self.needs_math = False
        self._uses = Counter(operands(routine.body))
        self._plain = set(plain_operands(routine.body))
        self._names: dict[int, str] = {local.index: local.hint for local in routine.parameters}
        self._taken = {local.hint for local in routine.parameters}
        if len(routine.results) > 1:
            self._taken |= set(routine.results)
        self._inlined: dict[int, str] = {}
        self._whole = set(branch_values(routine.body))

    def c_type(self, kind: Kind) -> str:
        """The type of a value; truth values are integers in constant time."""
        integer = self.constant_time and kind is Kind.TRUTH
        return c_kind(Kind.UNSIGNED if integer else kind, self.format)

    def write_block(self, block: Block, depth: int) -> list[str]:
        """Appends the statements of a block; the texts of its values."""
        for statement in block.statements:
            match statement:
                case Assign(target, operation):
                    self._write_assign(target, operation, depth)
                case Call(targets, routine, arguments):
                    self._write_call(targets, routine, arguments, depth)
                case Branch():
                    self._write_branch(statement, depth)
                case _:
                    assert_never(statement)
        return [self._text(value) for value in block.values]

    def _line(self, depth: int, text: str) -> None:
        self.lines.append("    " * depth + text)

    def _write_assign(self, target: Local, operation: Operation, depth: int) -> None:
        if not self._inline(target, operation):
            kind = self.c_type(target.kind)
            text = bare(self._operation(operation, target.kind))
            self._line(depth, f"const {kind} {self._name(target)} = {text};")

    def _inline(self, target: Local, operation: Operation) -> bool:
        """Whether the value is written where it is used; if so its text is kept for that."""
        if target.hint or self._uses[target] != 1:
            return False
        if target in self._plain and not isinstance(operation, Unary):
            return False
        text = self._operation(operation, target.kind)
        part = len(text) <= INLINE_LENGTH and not isinstance(operation, Select | Lookup)
        if part or target in self._whole:
            self._inlined[target.index] = text
            return True
        return False

    def _write_call(
        self,
        targets: tuple[Local, ...],
        routine: Routine,
        arguments: tuple[Operand, ...],
        depth: int,
    ) -> None:
        texts = [bare(self._text(argument)) for argument in arguments]
        name = f"{self.prefix}_{routine.name}"
        if len(targets) == 1:
            kind = self.c_type(targets[0].kind)
            call = f"{name}({', '.join(texts)})"
            self._line(depth, f"const {kind} {self._name(targets[0])} = {call};")
            return
        for target in targets:
            self._line(depth, f"{self.c_type(target.kind)} {self._name(target)};")
        texts += [f"&{self._name(target)}" for target in targets]
        self._line(depth, f"{name}({', '.join(texts)});")

    def _write_branch(self, branch: Branch, depth: int, declared: bool = False) -> None:
        if not declared:
            for target in branch.targets:
                self._line(depth, f"{self.c_type(target.kind)} {self._name(target)};")
        opening = "if"
        chained: Branch | None = branch
        while chained is not None:
            branch = chained
            self._line(depth, f"{opening} ({bare(self._text(branch.condition))}) {{")
            self._write_arm(branch.then, branch.targets, depth + 1)
            chained = self._only_branch(branch.otherwise)
            if chained is not None:
                self._share_names(chained.targets, branch.targets)
                opening = "} else if"
        self._line(depth, "} else {")
        self._write_arm(branch.otherwise, branch.targets, depth + 1)
        self._line(depth, "}")

    def _only_branch(self, block: Block) -> Branch | None:
        """The branch that the block consists of, besides values that are written within it."""
        *before, last = block.statements or (None,)
        if not isinstance(last, Branch) or last.targets != block.values:
            return None
        for statement in before:
            if not isinstance(statement, Assign):
                return None
            if not self._inline(statement.target, statement.operation):
                return None
        return last

    def _share_names(self, inner: tuple[Local, ...], outer: tuple[Local, ...]) -> None:
        """The inner branch assigns the outer one's variables itself."""
        for one, other in zip(inner, outer, strict=True):
            self._names[one.index] = self._name(other)

    def _write_arm(self, block: Block, targets: tuple[Local, ...], depth: int) -> None:
        last = block.statements[-1] if block.statements else None
        if isinstance(last, Branch) and last.targets == block.values:
            self.write_block(Block(block.statements[:-1], ()), depth)
            self._share_names(last.targets, targets)
            self._write_branch(last, depth, declared=True)
            return
        values = self.write_block(block, depth)
        for target, value in zip(targets, values, strict=True):
            self._line(depth, f"{self._name(target)} = {bare(value)};")

    def _name(self, local: Local) -> str:
        if local.index not in self._names:
            base = local.hint or "t"
            number = 1
            name = base if local.hint else "t1"
            while name in self._taken:
                number += 1
                name = f"{base}_{number}" if local.hint else f"t{number}"
            self._taken.add(name)
            self._names[local.index] = name
        return self._names[local.index]

    def _text(self, operand: Operand) -> str:
        """The operand within an expression: a name, a literal or an inlined text in parentheses."""
        match operand:
            case Local():
                return self._inlined.get(operand.index) or self._name(operand)
            case Constant(kind, value):
                return self._constant(kind, value)
            case _:
                assert_never(operand)

    def _constant(self, kind: Kind, value: float | int) -> str:
        match kind:
            case Kind.REAL:
                text = literal(float(value), self.format)
                return f"({text})" if text.startswith("-") else text
            case Kind.UNSIGNED:
                return unsigned_literal(int(value), "U")
            case Kind.WIDE:
                return unsigned_literal(int(value), "ULL")
            case Kind.TRUTH:
                return self._truth(bool(value))
            case _:
                assert_never(kind)

    def _truth(self, value: bool) -> str:
        if self.constant_time:
            return "1U" if value else "0U"
        return "true" if value else "false"

    def _operation(self, operation: Operation, kind: Kind) -> str:
        match operation:
            case Unary(function, operand):
                return self._unary(function, self._text(operand))
            case Binary(operator, left, right):
                return self._binary(operator, left, right)
            case Select(condition, then, otherwise):
                texts = [self._text(part) for part in (condition, then, otherwise)]
                if self.constant_time:
                    return self._choice(SELECT[kind], *texts)
                return f"({texts[0]} ? {texts[1]} : {texts[2]})"
            case Convert(operand):
                return f"({self.c_type(kind)}){self._text(operand)}"
            case Lookup(table, index):
                self.tables[table.name] = table
                return f"{table.name}[{bare(self._text(index))}]"
            case _:
                assert_never(operation)

    def _binary(self, operator: Operator, left: Operand, right: Operand) -> str:
        first = self._text(left)
        if self.constant_time and operator in COMPARISONS:
            relation = f"{first} {operator.value} {self._text(right)}"
            return self._choice(TRUTH, relation)
        if self.constant_time and operator in COMBINE:
            return f"({first} {COMBINE[operator]} {self._text(right)})"
        match operator, left, right:
            case Operator.ADD, _, Constant(Kind.REAL, value) if value < 0.0:
                return f"({first} - {literal(-value, self.format)})"
            case Operator.SUBTRACT, _, Constant(Kind.REAL, value) if value < 0.0:
                return f"({first} + {literal(-value, self.format)})"
            case Operator.SHIFT_LEFT, Constant(Kind.UNSIGNED, _), _:
                # a literal alone would have 16 bits where int has
                return f"((uint32_t){first} << {self._text(right)})"
            case _:
                return f"({first} {operator.value} {self._text(right)})"

    def _choice(self, function: str, *arguments: str) -> str:
        self.choices.add(function)
        return f"{self.prefix}_{function}({', '.join(map(bare, arguments))})"

    def _unary(self, function: Function, operand: str) -> str:
        match function:
            case Function.NEGATE:
                return f"(-{operand})"
            case Function.NOT:
                return f"({operand} ^ 1U)" if self.constant_time else f"(!{operand})"
            case Function.MAGNITUDE:
                self.needs_math = True
                return f"fabs{self.format.c_suffix}({bare(operand)})"
            case Function.SQUARE_ROOT:
                self.needs_math = True
                return f"sqrt{self.format.c_suffix}({bare(operand)})"
            case _:
                assert_never(function)
