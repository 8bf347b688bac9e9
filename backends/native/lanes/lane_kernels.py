"""C text of the project's math kernels for a group of lanes: both sides of a branch, then a choice.

A side that no lane takes is skipped, so that rare cases (angles beyond 2^17) cost nothing.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import assert_never

from backends.native.lanes.fused_kernels import FusedSum, fused_sums
from backends.native.lanes.fused_products import FUSED
from compiler.kernels.c_literals import literal, unsigned_literal
from compiler.kernels.table import KERNELS
from compiler.kernels.tables.formats import Format
from compiler.kernels.trace.statements import (
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
from compiler.kernels.trace.subroutine import trace

_TYPES = {Kind.REAL: "lanes", Kind.UNSIGNED: "words", Kind.WIDE: "wides", Kind.TRUTH: "mask"}
_SCALARS = {Kind.REAL: "real", Kind.UNSIGNED: "uint32_t", Kind.WIDE: "uint64_t"}
_CHOICES = {
    Kind.REAL: "choose",
    Kind.UNSIGNED: "choose_word",
    Kind.WIDE: "choose_wide",
    Kind.TRUTH: "choose_mask",
}
_LOGICAL = {Operator.BOTH: "&", Operator.EITHER: "|"}
_COMPARISONS = (Operator.LESS, Operator.LESS_EQUAL, Operator.GREATER, Operator.GREATER_EQUAL)


def lane_kernels(names: Iterable[str], format: Format, prefix: str) -> str:
    """Definitions of the kernels and of what they call, callees first."""
    written: dict[str, str] = {}
    for name in sorted(names):
        _write(trace(KERNELS[name].subroutine, format), prefix, written)
    return "\n".join(written.values())


def _write(routine: Routine, prefix: str, written: dict[str, str]) -> None:
    if routine.name in written:
        return
    text = _RoutineText(routine, prefix)
    values = text.block(routine.body, 1)
    for called in text.called:
        _write(called, prefix, written)
    arguments = [f"lanes v{local.index}" for local in routine.parameters]
    single = len(values) == 1
    if not single:
        kinds = [_kind(value) for value in routine.body.values]
        arguments += [f"{_TYPES[kind]} *r{i}" for i, kind in enumerate(kinds)]
    result = _TYPES[_kind(routine.body.values[0])] if single else "void"
    lines = [f"static {result} {prefix}_{routine.name}({', '.join(arguments)})", "{"]
    lines += [*text.tables.values(), *text.lines]
    if single:
        lines.append(f"    return {values[0]};")
    else:
        lines += [f"    *r{i} = {value};" for i, value in enumerate(values)]
    written[routine.name] = "\n".join([*lines, "}\n"])


def _kind(operand: Operand) -> Kind:
    return operand.kind


class _RoutineText:
    """Statements of one routine, every value a variable of its own."""

    def __init__(self, routine: Routine, prefix: str) -> None:
        self.lines: list[str] = []
        self.tables: dict[str, str] = {}
        self.called: list[Routine] = []
        self._fused = fused_sums(routine)
        self._format = routine.format
        self._prefix = prefix

    def block(self, block: Block, depth: int) -> list[str]:
        for statement in block.statements:
            match statement:
                case Assign(target) if target.index in self._fused.products:
                    pass  # where the sum is that it is added to
                case Assign(target) if (fused := self._fused.sums.get(target.index)) is not None:
                    self._line(depth, f"const lanes v{target.index} = {self._sum(fused)};")
                case Assign(target, operation):
                    text = self._operation(operation, target.kind)
                    self._line(depth, f"const {_TYPES[target.kind]} v{target.index} = {text};")
                case Call(targets, routine, arguments):
                    self._call(targets, routine, arguments, depth)
                case Branch():
                    self._branch(statement, depth)
                case _:
                    assert_never(statement)
        return [self._text(value) for value in block.values]

    def _line(self, depth: int, text: str) -> None:
        self.lines.append("    " * depth + text)

    def _call(
        self,
        targets: tuple[Local, ...],
        routine: Routine,
        arguments: tuple[Operand, ...],
        depth: int,
    ) -> None:
        self.called.append(routine)
        texts = [self._text(argument) for argument in arguments]
        name = f"{self._prefix}_{routine.name}"
        if len(targets) == 1:
            kind = _TYPES[targets[0].kind]
            self._line(depth, f"const {kind} v{targets[0].index} = {name}({', '.join(texts)});")
            return
        for target in targets:
            self._line(depth, f"{_TYPES[target.kind]} v{target.index};")
        texts += [f"&v{target.index}" for target in targets]
        self._line(depth, f"{name}({', '.join(texts)});")

    def _branch(self, branch: Branch, depth: int) -> None:
        condition = self._text(branch.condition)
        for target in branch.targets:
            zero = f"({_TYPES[target.kind]})all(0)"
            self._line(depth, f"{_TYPES[target.kind]} v{target.index} = {zero};")
        for taken, block in ((condition, branch.then), (f"~{condition}", branch.otherwise)):
            self._line(depth, f"if (any_lane({taken})) {{")
            values = self.block(block, depth + 1)
            for target, value in zip(branch.targets, values, strict=True):
                name = f"v{target.index}"
                choice = f"{_CHOICES[target.kind]}({taken}, {value}, {name})"
                self._line(depth + 1, f"{name} = {choice};")
            self._line(depth, "}")

    def _text(self, operand: Operand) -> str:
        match operand:
            case Local():
                return f"v{operand.index}"
            case Constant(kind, value):
                return self._constant(kind, value)
            case _:
                assert_never(operand)

    def _constant(self, kind: Kind, value: float | int) -> str:
        match kind:
            case Kind.REAL:
                return f"splat({literal(float(value), self._format)})"
            case Kind.UNSIGNED:
                return f"splat_word({unsigned_literal(int(value), 'U')})"
            case Kind.WIDE:
                return f"splat_wide({unsigned_literal(int(value), 'ULL')})"
            case Kind.TRUTH:
                return "every_lane" if value else "no_lane"
            case _:
                assert_never(kind)

    def _operation(self, operation: Operation, kind: Kind) -> str:
        match operation:
            case Unary(function, operand):
                return self._unary(function, self._text(operand))
            case Binary(operator, left, right):
                return self._binary(operator, left, right)
            case Select(condition, then, otherwise):
                texts = ", ".join(self._text(part) for part in (condition, then, otherwise))
                return f"{_CHOICES[kind]}({texts})"
            case Convert(operand):
                return f"__builtin_convertvector({self._text(operand)}, {_TYPES[kind]})"
            case Lookup(table, index):
                return self._look_up(table, self._text(index))
            case _:
                assert_never(operation)

    def _sum(self, fused: FusedSum) -> str:
        first, second, addend = map(self._text, (fused.first, fused.second, fused.addend))
        product = f"{'-' if fused.minus_product else ''}{first}, {second}"
        return f"{FUSED}({product}, {'-' if fused.minus_addend else ''}{addend})"

    def _unary(self, function: Function, operand: str) -> str:
        match function:
            case Function.NEGATE:
                return f"-{operand}"
            case Function.NOT:
                return f"~{operand}"
            case Function.MAGNITUDE:
                return f"lane_abs({operand})"
            case Function.SQUARE_ROOT:
                return f"lane_sqrt({operand})"
            case _:
                assert_never(function)

    def _binary(self, operator: Operator, left: Operand, right: Operand) -> str:
        first, second = self._text(left), self._text(right)
        kind = left.kind
        if operator in (Operator.SHIFT_LEFT, Operator.SHIFT_RIGHT):
            # lanes of the side not taken may hold any count
            second = f"({second} & {self._constant(kind, 63 if kind is Kind.WIDE else 31)})"
        text = f"({first} {_LOGICAL.get(operator, operator.value)} {second})"
        if operator in _COMPARISONS and kind is not Kind.REAL:
            return f"__builtin_convertvector({text}, mask)"
        return text

    def _look_up(self, table: Table, index: str) -> str:
        """A table entry a lane; lanes of the side not taken read entry 0."""
        name = f"{self._prefix}_{table.name}"
        scalar = _SCALARS[table.kind]
        if table.name not in self.tables:
            numbers = ", ".join(self._number(table.kind, value) for value in table.values)
            head = f"    static const {scalar} {name}[{len(table.values)}]"
            self.tables[table.name] = f"{head} = {{{numbers}}};"
        function = {Kind.REAL: "look_up", Kind.UNSIGNED: "look_up_word", Kind.WIDE: "look_up_wide"}
        return f"{function[table.kind]}({name}, {len(table.values)}, {index})"

    def _number(self, kind: Kind, value: float | int) -> str:
        if kind is Kind.REAL:
            return literal(float(value), self._format)
        return unsigned_literal(int(value), "ULL" if kind is Kind.WIDE else "U")
