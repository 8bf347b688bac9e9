"""Parses an expression with Python's parser and a whitelist; nothing is evaluated."""

import ast
import math
from itertools import accumulate
from typing import Literal

from spec_schema.diagnostics.diagnostic import Diagnostic, Findings
from spec_schema.diagnostics.source import SourceText, Span
from spec_schema.errors import expressions as errors
from spec_schema.expressions.scanner import DEEPEST, ScannedExpression, scan_expression
from spec_schema.expressions.tree import (
    Binary,
    Call,
    Compare,
    Duration,
    Expression,
    Future,
    Keyword,
    Length,
    ListLiteral,
    Member,
    Name,
    Negate,
    Number,
    Operator,
    Past,
    Relation,
    Samples,
    TimeOffset,
    Window,
)
from spec_schema.names import normalised
from spec_schema.yaml_tree.nodes import Positions


class PythonPositions:
    r"""Converts places of nodes of Python's syntax tree to spans of the file.

    The tree is that of `ast.parse("(" + text + "\n)")`.
    """

    def __init__(self, text: str, positions: Positions) -> None:
        self._text = text
        self._positions = positions
        # A tuple without brackets ends behind the added parenthesis, on a line of its own.
        self._lines = [*text.split("\n"), ""]
        lengths = (len(line) + 1 for line in self._lines)
        self._starts = [0, *accumulate(lengths)]
        self._texts: dict[Span, str] = {}

    def of(self, node: ast.expr | ast.keyword | ast.Slice) -> Span:
        """The span of a node."""
        first, last = self.start(node), self.end(node)
        span = self._positions.span(first, last)
        self._texts[span] = self._text[first:last]
        return span

    def text_of(self, span: Span) -> str:
        """The text of a span that `of` returned."""
        return self._texts[span]

    def between(self, left: ast.expr, right: ast.expr, operator: str) -> Span:
        """The span of the operator between two operands."""
        # between the operands there are blanks, parentheses and the operator
        start = self._text.index(operator, self.end(left), self.start(right))
        return self._positions.span(start, start + len(operator))

    def syntax_fault(self, error: SyntaxError) -> Diagnostic:
        """The diagnostic of Python's syntax error, in wording independent of its version."""
        line, column = error.lineno or 1, (error.offset or 1) - 1
        if line >= len(self._lines):
            # It stumbled over the added parenthesis.
            last = len(self._text.rstrip())
            return errors.incomplete_expression(self._positions.span(last - 1, last))
        # Python may point behind the fault: what is shown lies within the text in any case
        start = self._starts[line - 1] + column - (1 if line == 1 else 0)
        start = min(max(start, 0), len(self._text) - 1)
        return errors.malformed_expression(self._positions.span(start, start + 1))

    def start(self, node: ast.expr | ast.keyword | ast.Slice) -> int:
        """The offset in the text at which a node starts."""
        return self._offset(node.lineno, node.col_offset)

    def end(self, node: ast.expr | ast.keyword | ast.Slice) -> int:
        """The offset in the text at which a node ends."""
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return self._offset(node.end_lineno, node.end_col_offset)

    def _offset(self, line: int, byte_column: int) -> int:
        added = 1 if line == 1 else 0
        line_text = self._lines[line - 1]
        # Python counts columns in bytes of UTF-8
        if not line_text.isascii():
            # of the bytes before it, as many characters as they decode to
            byte_column = len(line_text.encode()[: byte_column - added].decode()) + added
        offset = self._starts[line - 1] + byte_column - added
        return min(max(offset, 0), len(self._text))


_TIME_INDICES = {"k", "n", "i", "t"}
"""Names of the present sample in textbooks, including `t`, the name here."""


def time_elsewhere(node: ast.expr) -> str | None:
    """The time in this language for an index of another one: `t+1` for `k+1` and `1+t`, `t` for
    `k`.

    None if it is unclear, as for a number: `x[-1]` is the last element in Python and the previous
    sample in other tools.
    """
    match node:
        case ast.Name(id=name) if name in _TIME_INDICES:
            return "t"
        case ast.BinOp(left=ast.Name(id=name), op=op, right=ast.Constant(value=int(count))) if (
            name in _TIME_INDICES
        ):
            return _time_offset(op, count)
        case ast.BinOp(
            # not `1-k`: time that runs backwards is no sample of a log
            left=ast.Constant(value=int(count)),
            op=ast.Add() as op,
            right=ast.Name(id=name),
        ) if name in _TIME_INDICES:
            return _time_offset(op, count)
        case _:
            return None


def index_of(node: ast.expr) -> str | None:
    """The number in brackets where a time is required, as in `x[3]`; None for others."""
    match node:
        # `True` is an integer to Python
        case ast.Constant(value=int(index)) if not isinstance(index, bool):
            return str(index)
        case _:
            return None


def _time_offset(op: ast.operator, count: int) -> str | None:
    match op:
        case ast.Add():
            return f"t+{count}"
        case ast.Sub():
            return f"t-{count}"
        case _:
            return None


LONGEST = 4000

_OPERATORS: dict[type[ast.operator], Operator] = {
    ast.Add: Operator.ADD,
    ast.Sub: Operator.SUBTRACT,
    ast.Mult: Operator.MULTIPLY,
    ast.Div: Operator.DIVIDE,
    ast.MatMult: Operator.CONTRACT,
    ast.Pow: Operator.POWER,
}
_RELATIONS: dict[type[ast.cmpop], Relation] = {
    ast.Lt: Relation.LESS,
    ast.LtE: Relation.LESS_EQUAL,
    ast.Gt: Relation.GREATER,
    ast.GtE: Relation.GREATER_EQUAL,
}


def parse_expression(
    text: str,
    positions: Positions | None = None,
    findings: Findings | None = None,
    *,
    condition: bool = False,
) -> Expression | None:
    """Parses an expression to a tree; `positions` gives the place of each character in the file.

    A `condition` may be a comparison. Errors are reported to `findings`, and None is returned;
    without `findings` they raise SpecError.
    """
    if positions is None:
        positions = Positions(SourceText("<expression>", text), range(len(text) + 1))
    # findings of its own: an expression that fails must not make what was found before fail
    own = Findings()
    expression = _parse(text, positions, own, condition)
    if findings is None:
        own.raise_errors()
    else:
        findings.report(*own.in_order)
    return None if own.failed else expression


def _parse(
    text: str, positions: Positions, findings: Findings, condition: bool
) -> Expression | None:
    whole = positions.span(0, len(text))
    if len(text) > LONGEST:
        findings.report(errors.too_long(len(text), LONGEST, whole))
        return None
    scanned = scan_expression(text, positions, findings)
    if not scanned.text.strip():
        findings.report(errors.empty_expression(whole))
    if findings.failed:
        return None
    places = PythonPositions(scanned.text, positions)
    try:
        # Within parentheses a block scalar may break its lines; brackets are balanced by now.
        tree = ast.parse(f"({scanned.text}\n)", mode="eval").body
    except SyntaxError as error:
        findings.report(places.syntax_fault(error))
        return None
    except (RecursionError, MemoryError):
        findings.report(errors.too_deep(DEEPEST, whole))
        return None
    return _Admission(scanned, places, findings).expression(tree, 0, condition)


class _Admission:
    """Converts Python's syntax tree; unlisted nodes are not part of the language."""

    def __init__(
        self, scanned: ScannedExpression, places: PythonPositions, findings: Findings
    ) -> None:
        self.durations = scanned.durations
        self.places = places
        self.findings = findings

    def decimal(self, node: ast.Tuple) -> str | None:
        """`2,5`, which may be a number where decimals have commas, or thousands."""
        match node.elts:
            case [ast.Constant(value=int()) as whole, ast.Constant(value=int()) as decimals]:
                # as written: zeros count
                return ",".join(self.places.text_of(self.places.of(e)) for e in (whole, decimals))
            case _:
                return None

    def expression(self, node: ast.expr, depth: int, condition: bool = False) -> Expression:
        span = self.places.of(node)
        # operators nest without brackets: `----x`
        if depth > DEEPEST:
            self.findings.report(errors.too_deep(DEEPEST, span))
            return _nothing(span)
        depth += 1
        match node:
            case ast.Constant(value=int() | float() as value):
                return self.number(value, span)
            case ast.Name():
                return self.name(node, span)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return Negate(self.expression(operand, depth), span)
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.expression(operand, depth)
            case ast.BinOp(left=left, op=operator, right=right) if type(operator) in _OPERATORS:
                kind = _OPERATORS[type(operator)]
                a, b = self.expression(left, depth), self.expression(right, depth)
                return Binary(
                    operator=kind,
                    left=a,
                    right=b,
                    span=span,
                    operator_span=self.places.between(left, right, kind.value),
                )
            case ast.Compare():
                return self.comparison(node, span, depth, condition)
            case ast.Attribute(value=owner, attr=name):
                # attributes of attributes are one name with dots; of anything else they are nothing
                base = _dotted(owner)
                if base is None:
                    return self.refuse(errors.long_member(span), span)
                return Member(base, normalised(name), span)
            case ast.Subscript():
                return self.window(node, span, depth)
            # `past` and `future` are no names of functions: their argument is a length, not an
            # expression
            case ast.Call(func=ast.Attribute(attr="past" | "future")):
                return self.window_of_length(node, span, depth)
            case ast.Call():
                return self.call(node, span, depth)
            case ast.List(elts=[]):
                return self.refuse(errors.empty_list(span), span)
            case ast.List(elts=elements):
                return ListLiteral(tuple(self.expression(e, depth) for e in elements), span)
            case ast.Tuple():
                return self.refuse(errors.several_values(span, self.decimal(node)), span)
            case _:
                return self.refuse(errors.foreign_construct(span), span)

    def number(self, value: int | float, span: Span) -> Expression:
        # integers of Python have no largest one
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            return self.refuse(errors.huge_number(self.places.text_of(span), span), span)
        return Number(number, span)

    # the scanner has put words in place of durations, whose offsets it knows
    def name(self, node: ast.Name, span: Span) -> Name | Duration:
        duration = self.durations.get(self.places.start(node))
        return Name(node.id, span) if duration is None else duration

    def comparison(self, node: ast.Compare, span: Span, depth: int, condition: bool) -> Expression:
        if not condition:
            return self.refuse(errors.stray_comparison(span), span)
        if len(node.ops) > 1:
            return self.refuse(errors.chained_comparison(span), span)
        relation = _RELATIONS.get(type(node.ops[0]))
        if relation is None:
            return self.refuse(errors.foreign_construct(span), span)
        left = self.expression(node.left, depth)
        return Compare(relation, left, self.expression(node.comparators[0], depth), span)

    def call(self, node: ast.Call, span: Span, depth: int) -> Expression:
        function = self.expression(node.func, depth)
        if not isinstance(function, Name | Member):
            return self.refuse(errors.calls_no_name(function.span), span)
        # a condition is no value: only `where` takes one
        has_condition = isinstance(function, Name) and function.name == "where"
        arguments: list[Expression] = []
        for index, argument in enumerate(node.args):
            if isinstance(argument, ast.Starred):
                self.findings.report(errors.unpacked_argument(self.places.of(argument)))
            else:
                condition = has_condition and index == 0
                arguments.append(self.expression(argument, depth, condition))
        keywords = self.keywords(node.keywords, depth)
        return Call(function, tuple(arguments), keywords, span)

    def keywords(self, nodes: list[ast.keyword], depth: int) -> tuple[Keyword, ...]:
        keywords: dict[str, Keyword] = {}
        for node in nodes:
            span = self.places.of(node)
            if node.arg is None:
                self.findings.report(errors.unpacked_argument(span))
                continue
            name = normalised(node.arg)
            if name in keywords:
                self.findings.report(errors.repeated_keyword(name, span, keywords[name].span))
            keywords[name] = Keyword(name, self.expression(node.value, depth), span)
        return tuple(keywords.values())

    def window_of_length(self, node: ast.Call, span: Span, depth: int) -> Expression:
        assert isinstance(node.func, ast.Attribute)
        method, operand = node.func.attr, node.func.value
        length = self.length(node.args[0]) if len(node.args) == 1 and not node.keywords else None
        if length is None:
            return self.refuse(errors.malformed_window_length(method, span), span)
        kind = Past if method == "past" else Future
        return kind(self.expression(operand, depth), length, span)

    def window(self, node: ast.Subscript, span: Span, depth: int) -> Expression:
        operand = self.expression(node.value, depth)
        match node.slice:
            case ast.Slice(lower=ast.expr() as lower, upper=ast.expr() as upper, step=None):
                return Window(operand, self.time(lower), self.time(upper), span)
            case ast.Slice():
                return self.refuse(errors.open_window(self.places.of(node.slice)), span)
            case time:
                return Window(operand, self.time(time), None, span)

    def time(self, node: ast.expr) -> TimeOffset:
        span = self.places.of(node)
        match node:
            case ast.Name(id="t"):
                return TimeOffset(1, Samples(0, span), span)
            # a time is t and a length: anything else would need the data to be known
            case ast.BinOp(left=ast.Name(id="t"), op=ast.Add() | ast.Sub(), right=right):
                sign: Literal[-1, 1] = 1 if isinstance(node.op, ast.Add) else -1
                length = self.length(right)
                if length is not None:
                    return TimeOffset(sign, length, span)
            case _:
                pass
        self.findings.report(errors.malformed_time(span, time_elsewhere(node), index_of(node)))
        return TimeOffset(1, Samples(0, span), span)

    def length(self, node: ast.expr) -> Length | None:
        span = self.places.of(node)
        match node:
            # `True` is an integer to Python
            case ast.Constant(value=bool()):
                return None
            case ast.Constant(value=int() as count) if count <= _LONGEST_WINDOW:
                return Samples(count, span)
            case ast.Name():
                return self.durations.get(self.places.start(node))
            case _:
                return None

    def refuse(self, diagnostic: errors.Diagnostic, span: Span) -> Expression:
        self.findings.report(diagnostic)
        return _nothing(span)


def _dotted(node: ast.expr) -> str | None:
    """`a.b.c` as text; None if it does not consist of names."""
    names: list[str] = []
    while isinstance(node, ast.Attribute):
        names.append(normalised(node.attr))
        node = node.value
    if not isinstance(node, ast.Name):
        return None
    return ".".join((normalised(node.id), *reversed(names)))


_LONGEST_WINDOW = 10**9


def _nothing(span: Span) -> Number:
    """A number that replaces a refused part, so that the rest of the expression is checked."""
    # a number that fits anything brings no report of its own
    return Number(0.0, span)
