"""`savitzky_golay`: units and mistakes; values are in `cases/`."""

import pytest

from tests.language.compiled import codes, compiled, warnings_of


def test_it_has_units_and_learns_nothing() -> None:
    spec = """
inputs: {q: rad}
layers:
  speed: {savitzky_golay: {window: 0.5 s, derivative: 1}}
equations: {dq: {expr: speed(q), unit: rad/s}}
outputs: {w: dq}
"""
    assert compiled(spec).parameters == ()
    assert warnings_of(spec) == []


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ("{window: 3, order: 3}", "E0313"),
        ("{window: 5, order: 1, derivative: 2}", "E0313"),
        ("{window: 5, lag: 5}", "E0313"),
        ("{window: 5, order: 65}", "E0210"),
        ("{}", "E0403"),
    ],
)
def test_mistake(options: str, code: str) -> None:
    spec = f"inputs: {{x: m}}\nlayers: {{d: {{savitzky_golay: {options}}}}}\noutputs: {{y: d(x)}}\n"
    assert codes(spec) == [code]
