"""Parses an expression with Python's parser and a whitelist; nothing is evaluated."""

import ast
import math
from typing import Literal

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import SourceText, Span
from spec_schema.errors import expressions as errors
from spec_schema.expressions.python_positions import PythonPositions
from spec_schema.expressions.scanner import DEEPEST, ScannedExpression, scan_expression
from spec_schema.expressions.times_elsewhere import index_of, time_elsewhere
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
    """The tree of an expression; `positions` says where its characters stand.

    A `condition` may be a comparison.

    Faults are reported to `findings`, and None returned; without `findings` they raise SpecError.
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
    """A placeholder for refused parts, so that the rest of the expression is checked."""
    # a number that fits anything brings no report of its own
    return Number(0.0, span)
