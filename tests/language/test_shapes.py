"""R3: what operands whose axes do not fit are told; values are in `cases/shapes/`."""

import pytest

from tests.language.compiled import codes

HEAD = """
dims: {joint: [a, b, c], ch: 2}
inputs: {q: {unit: m, dims: joint}, s: m}
constants: {M: {value: [[1, 2, 3], [4, 5, 6]], dims: [ch, joint]}}
"""


@pytest.mark.parametrize(
    ("expression", "code"),
    [
        ("s.past(4) + s.past(5)", "E0401"),
        ("M @ s", "E0401"),
        ("stack(s, s, s, dim=ch)", "E0402"),
        ("concat(q, s)", "E0402"),
        ("[q, 1]", "E0402"),
        ("sum(q, over=ch)", "E0406"),
        ("part(q, 3)", "E0408"),
        ("softmax(s)", "E0402"),
        ("softmax(q, over=ch)", "E0406"),
        ("outer(q, q)", "E0402"),
        ("eye(ch, joint) @ q", "E0402"),
        ("eye(ch, 3)", "E0402"),
        ("eye(3)", "E0402"),
        ("eye(ch)", "E0312"),
    ],
)
def test_mistake(expression: str, code: str) -> None:
    assert code in codes(HEAD + f'outputs: {{y: "{expression}"}}')
