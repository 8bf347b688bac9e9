"""Formulas as MathML: what binds less stands in parentheses, names and texts are escaped."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from spec_schema.expressions.mathml import expression_mathml
from spec_schema.reading.reader import read_spec

X = "<mi>x</mi>"


def enclosed(inner: str) -> str:
    return f"<mrow><mo>(</mo><mrow>{inner}</mrow><mo>)</mo></mrow>"


def mathml(text: str) -> str:
    head = "msnn: 1\nname: n\nsample_time: 0.1 s\ninputs: {x: {}}\n"
    spec = f"{head}outputs: {{y: {{expr: '{text}'}}}}"
    return expression_mathml(read_spec(Path("n.yaml"), spec, ()).spec.outputs["y"].expr)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x", X),
        ("theta_1", "<msub><mtext>theta</mtext><mtext>1</mtext></msub>"),
        ("1e-6", "<mrow><mn>1</mn><mo>·</mo><msup><mn>10</mn><mn>-6</mn></msup></mrow>"),
        ("sqrt(x)", f"<msqrt>{X}</msqrt>"),
        ("abs(x)", f"<mrow><mo>|</mo>{X}<mo>|</mo></mrow>"),
        ("x[t-1]", f"<msub>{X}<mtext>t-1</mtext></msub>"),
        ("x**2", f"<msup>{X}<mrow><mn>2</mn></mrow></msup>"),
        ("x / 2", f"<mfrac><mrow>{X}</mrow><mrow><mn>2</mn></mrow></mfrac>"),
        ("tanh(x)", f"<mrow><mtext>tanh</mtext><mrow><mo>(</mo>{X}<mo>)</mo></mrow></mrow>"),
        ("2 * (x - 1)", f"<mrow><mn>2</mn><mo>·</mo>{enclosed(f'{X}<mo>−</mo><mn>1</mn>')}</mrow>"),
        ("-(x + 1)", f"<mrow><mo>−</mo>{enclosed(f'{X}<mo>+</mo><mn>1</mn>')}</mrow>"),
    ],
)
def test_a_formula(text: str, expected: str):
    assert mathml(text) == expected


@pytest.mark.parametrize(
    "text",
    ["where(x < 1, 0, x)", "mean(x[t-3:t])", "clip(x, -1, 1)", "sum(x.past(3))", "[1, x] @ [x, 2]"],
)
def test_all_of_it_is_well_formed(text: str):
    found = ElementTree.fromstring(f"<math>{mathml(text)}</math>")  # noqa: S314  (ours)
    assert len(list(found.iter())) > 2
