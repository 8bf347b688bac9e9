"""Leaf types of the schema that hold mathematics: expressions, arrays, predictions."""

import math
from dataclasses import field
from typing import Annotated, TypeAlias

from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import Span
from spec_schema.errors import schema as errors
from spec_schema.expressions import tree
from spec_schema.expressions.parser import parse_expression
from spec_schema.fields.entry import RefusedError
from spec_schema.fields.leaf import Located
from spec_schema.fields.plain import reads, scalar
from spec_schema.late_dataclass import dataclass
from spec_schema.yaml_tree.nodes import Listing, Node, Scalar, Table, kind


@dataclass(frozen=True)
class Prediction:
    """`predicts: signal[t+ahead]`: the recorded sample that an output predicts."""

    signal: Located[str]
    ahead: tree.Length
    span: Span = field(compare=False)


def read_expression(node: Node, findings: Findings, *, condition: bool = False) -> tree.Expression:
    """The expression that a node writes; with `condition`, it may be a comparison.

    Reports an error and raises RefusedError for others.
    """
    if isinstance(node, Listing | Table):
        findings.report(errors.list_for_expression(node.span))
        raise RefusedError
    found = scalar(node, findings, "an expression")
    # YAML reads `yes` as text and `true` as a switch: a formula `true` is a mistake
    if isinstance(found.value, bool):
        findings.report(errors.wrong_kind("an expression", kind(found), found.span))
        raise RefusedError
    # `.inf` is a number of YAML and no formula
    if isinstance(found.value, float) and not math.isfinite(found.value):
        findings.report(errors.out_of_range(found.text, found.span, "finite"))
        raise RefusedError
    expression = parse_expression(found.text, found.positions, findings, condition=condition)
    if expression is None:
        raise RefusedError
    return expression


def _read_condition(node: Node, findings: Findings) -> tree.Expression:
    return read_expression(node, findings, condition=True)


def read_array(node: Node, findings: Findings) -> tree.Expression:
    """The expression of an array: a number, nested lists, an expression or `{linspace: …}`."""
    match node:
        case Scalar():
            return read_expression(node, findings)
        case Listing(items=()):
            findings.report(errors.empty_section("a list of numbers", node.span))
            raise RefusedError
        case Listing(items=items):
            return tree.ListLiteral(tuple(read_array(item, findings) for item in items), node.span)
        # as YAML has it; the call that it becomes is lowered like one in a formula
        case Table(entries={"linspace": Listing(items=items)}) if len(node.entries) == 1:
            arguments = tuple(read_expression(item, findings) for item in items)
            return tree.Call(tree.Name("linspace", node.keys["linspace"]), arguments, (), node.span)
        case Table():
            repair = "write numbers in [ ], an expression, or `{linspace: [0, 1, 5]}`"
            findings.report(errors.wrong_kind("numbers", "a mapping", node.span, repair))
            raise RefusedError


def _read_prediction(node: Node, findings: Findings) -> Prediction:
    expression = read_expression(node, findings)
    match expression:
        case tree.Name(name=name, span=span):
            return Prediction(Located(name, span, node.key), tree.Samples(0, span), span)
        # a window of one sample: `x[t+1]`
        case tree.Window(
            operand=tree.Name(name=name, span=span), first=tree.TimeOffset() as ahead, last=None
        ) if ahead.sign == 1:
            signal = Located(name, span, node.key)
            return Prediction(signal, ahead.length, expression.span)
        # `plant.x` of a sub-model
        case tree.Member():
            name = Located(f"{expression.base}.{expression.name}", expression.span, node.key)
            return Prediction(name, tree.Samples(0, expression.span), expression.span)
        case tree.Window(
            operand=tree.Member() as member, first=tree.TimeOffset() as ahead, last=None
        ) if ahead.sign == 1:
            signal = Located(f"{member.base}.{member.name}", member.span, node.key)
            return Prediction(signal, ahead.length, expression.span)
        case _:
            findings.report(errors.malformed_prediction(expression.span))
            raise RefusedError


EXPRESSION = {"type": ["string", "number"]}
_NUMBERS = {"type": ["string", "number", "array"]}
ARRAY = {
    "type": ["string", "number", "array", "object"],
    "items": _NUMBERS,
    "minItems": 1,
    "properties": {"linspace": {"type": "array", "items": EXPRESSION}},
    "additionalProperties": False,
}
_PREDICTION = {"type": "string", "examples": ["x[t+1]"]}
ExpressionField: TypeAlias = Annotated[tree.Expression, reads(read_expression, EXPRESSION)]
ConditionField: TypeAlias = Annotated[tree.Expression, reads(_read_condition, {"type": "string"})]
ArrayField: TypeAlias = Annotated[tree.Expression, reads(read_array, ARRAY)]
PredictionField: TypeAlias = Annotated[Prediction, reads(_read_prediction, _PREDICTION)]
