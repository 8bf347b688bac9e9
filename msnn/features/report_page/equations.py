"""Formats the equations of a spec for the page, with units and docs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from compiler.ir.program import Program
from spec_schema.expressions.mathml import enclosed, expression_mathml, indexed, name_mathml
from spec_schema.expressions.tree import Expression, Samples, length_text
from spec_schema.fields.formulas import Prediction
from spec_schema.sections.signals import InitialState
from spec_schema.sections.spec import Spec


@dataclass(frozen=True, slots=True)
class ShownEquation:
    """A formula as MathML, with the unit and doc of its left side."""

    kind: str
    mathml: str
    unit: str = ""
    doc: str = ""


def equations(spec: Spec, program: Program) -> Iterator[ShownEquation]:
    """Functions, equations, states and outputs, in the order of the spec."""
    units = {o.name: program.step[o.node].type.unit for o in program.outputs}
    known = {name: "" if unit is None else unit.text for name, unit in units.items()}
    for name, function in spec.functions.items():
        arguments = "<mo>,</mo>".join(name_mathml(argument.value) for argument in function.args)
        left = f"<mrow>{name_mathml(name)}{enclosed(arguments)}</mrow>"
        yield ShownEquation("function", _equal(left, function.expr), doc=_doc(function))
    for name, equation in spec.equations.items():
        # declared, else as the compiler has found it, which is known of outputs alone
        unit = _unit(equation) or known.get(name, "")
        yield ShownEquation(
            "equation", _equal(name_mathml(name), equation.expr), unit, _doc(equation)
        )
    for name, state in spec.states.items():
        unit, doc = _unit(state), _doc(state)
        if state.der is not None:
            left = f"<mover>{name_mathml(name)}<mo>˙</mo></mover>"
            # of a state alone the derivative has another unit than the name
            yield ShownEquation("state", _equal(left, state.der), f"{unit}/s" if unit else "", doc)
        if state.next is not None:
            yield ShownEquation(
                "state", _equal(indexed(name_mathml(name), "t+1"), state.next), unit, doc
            )
        if state.init is not None:
            left = indexed(name_mathml(name), "t₀")
            yield ShownEquation("state", _row(left, _start(state.init)), unit, "")
    for name, output in spec.outputs.items():
        left = name_mathml(name)
        if output.predicts is not None:
            left = f"<mrow>{_predicted(output.predicts)}<mo>=</mo>{left}</mrow>"
        unit = _unit(output) or known.get(name, "")
        yield ShownEquation("output", _equal(left, output.expr), unit, _doc(output))


def _equal(left: str, right: Expression) -> str:
    return _row(left, expression_mathml(right))


def _row(left: str, right: str) -> str:
    return f"<mrow>{left}<mo>=</mo>{right}</mrow>"


def _start(init: InitialState) -> str:
    """The initial value of each run; for an estimated one also the initial guess."""
    begin = None if init.expression is None else expression_mathml(init.expression)
    if init.fit is None:
        assert begin is not None
        return begin
    words = f"<mtext>{init.fit.words}</mtext>"
    return words if begin is None else f"<mrow>{words}<mtext>, guess&#xA0;</mtext>{begin}</mrow>"


def _predicted(prediction: Prediction) -> str:
    """The predicted signal with a hat, at the predicted sample."""
    ahead = prediction.ahead
    now = isinstance(ahead, Samples) and ahead.count == 0
    index = "t" if now else f"t+{length_text(ahead)}"
    hat = f'<mover accent="true">{name_mathml(prediction.signal.value)}<mo>^</mo></mover>'
    return indexed(hat, index)


def _unit(entry: Any) -> str:
    unit = getattr(entry, "unit", None)
    return "" if unit is None else unit.value.text


def _doc(entry: Any) -> str:
    doc = getattr(entry, "doc", None)
    return "" if doc is None else str(getattr(doc, "value", doc)).strip()
