"""Formats the equations of a spec as LaTeX."""

from __future__ import annotations

from collections.abc import Iterator

from spec_schema.expressions.latex import expression_latex, name_latex
from spec_schema.expressions.tree import Duration, Samples, length_text
from spec_schema.fields.formulas import Prediction
from spec_schema.sections.signals import InitialState
from spec_schema.sections.spec import Spec


def latex_text(spec: Spec) -> str:
    """An `align*` environment: functions, equations, states, outputs, losses, in spec order."""
    lines = [f"  {left} &= {right}" for left, right in formulas(spec)]
    body = " \\\\\n".join(lines)
    return f"\\begin{{align*}}\n{body}\n\\end{{align*}}"


def formulas(spec: Spec) -> Iterator[tuple[str, str]]:
    """Yields the left and the right side of each formula of the spec in LaTeX."""
    for name, function in spec.functions.items():
        arguments = ", ".join(name_latex(argument.value) for argument in function.args)
        yield rf"{name_latex(name)}\left({arguments}\right)", expression_latex(function.expr)
    for name, equation in spec.equations.items():
        yield name_latex(name), expression_latex(equation.expr)
    for name, state in spec.states.items():
        # a state may have both: `der` for training, `next` in its place at commits (R4, step 3)
        if state.der is not None:
            yield rf"\dot{{{name_latex(name)}}}", expression_latex(state.der)
        if state.next is not None:
            yield _indexed(name, "t+1"), expression_latex(state.next)
        if state.init is not None:
            yield _indexed(name, "t_0"), _start(state.init)
    for name, output in spec.outputs.items():
        left = name_latex(name)
        if output.predicts is not None:
            left += rf" = {_predicted(output.predicts)}"
        yield left, expression_latex(output.expr)
    for name, loss in spec.losses.items():
        yield rf"L_{{{name_latex(name)}}}", expression_latex(loss.expr)


def _start(init: InitialState) -> str:
    """The initial value of each run; for an estimated one also the initial guess."""
    begin = None if init.expression is None else expression_latex(init.expression)
    if init.fit is None:
        assert begin is not None
        return begin
    words = init.fit.words
    return rf"\text{{{words}}}" if begin is None else rf"\text{{{words}, guess }} {begin}"


def _predicted(prediction: Prediction) -> str:
    """The predicted signal with a hat, at the predicted sample."""
    ahead: Samples | Duration = prediction.ahead
    # `predicts: y` means y[t]
    is_now = isinstance(ahead, Samples) and ahead.count == 0
    index = "t" if is_now else rf"t+\mathrm{{{length_text(ahead).replace(' ', chr(92) + ',')}}}"
    return rf"\hat{{{name_latex(prediction.signal.value)}}}_{{{index}}}"


def _indexed(name: str, index: str) -> str:
    # a name with an index has a subscript already; TeX refuses a second one
    if "_" in name:
        return rf"\left({name_latex(name)}\right)_{{{index}}}"
    return f"{name_latex(name)}_{{{index}}}"
