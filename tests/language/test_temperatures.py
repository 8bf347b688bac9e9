"""Temperatures in degC and degF: differences, sums with differences, means, rates, layers."""

from pathlib import Path

import numpy as np
import pytest

import msnn
from tests.language.compiled import codes, evaluated, simulated, warnings_of

HEAD = """
dims: {set: 3, room: 2}
inputs: {T: degC, Ta: degC, F: degF, R: {unit: degC, dims: room}}
constants:
  zero: -273.15 degC
  warmer: 5 K
  up: {value: 9, unit: degR}
  G: {value: 3, unit: W/K}
  Gc: {value: 3, unit: W/degC}
parameters: {tau: {init: 10, unit: s}, C: {init: 10, unit: J/K}}
layers:
  triangles: {fuzzify: {centers: [0, 10, 20], dim: set}}
  bells: {fuzzify: {centers: [0, 10, 20], dim: set, membership: gaussian, learn: true}}
  boxes: {fuzzify: {centers: [0, 10, 20], dim: set, membership: rectangular}}
  standard: {normalize: {mean: 10, std: 4, unit: degC}}
  table: {interpolation: {x: [0, 10, 30], y: [1, 2, 3], unit: degC}}
states:
  X: {unit: degC, init: 20, der: (Ta - X)/tau}
"""


@pytest.mark.parametrize(
    ("expression", "unit"),
    [
        ("T - Ta", "K"),
        ("-Ta + T", "K"),
        ("T + (-Ta)", "K"),
        ("T - warmer", "degC"),
        ("T + warmer", "degC"),
        ("warmer + T", "degC"),
        ("T - zero", "K"),
        ("T - Ta + X", "degC"),
        ("(T + Ta)/2", "degC"),
        ("0.9*T + 0.1*Ta", "degC"),
        ("mean(R)", "degC"),
        ("[0.5, 0.5] @ R", "degC"),
        ("T + X - 2*Ta", "K"),
        ("(T - Ta)/tau", "K/s"),
        ("(T - Ta)**2", "K^2"),
        ("G*(T - Ta)", "W"),
        ("Gc*(T - Ta)", "W"),
        ("abs(T - Ta)", "K"),
        ("max(T, Ta) - min(T, Ta)", "K"),
        ("clip(T, Ta, X)", "degC"),
        ("where(T > Ta, T, Ta)", "degC"),
        ("der(X)", "K/s"),
        ("next(X) - X", "K"),
        ("T - T[t-1]", "K"),
        ("integral(T - Ta)", "K*s"),
        ("integral((Ta - T)/tau, init=20)", "K"),
        ("F - F[t-1]", "degR"),
        ("F + up", "degF"),
        ("F - up", "degF"),
        ("elu(T)", "degC"),
        ("sum(triangles(T)) + sum(bells(T)) + sum(boxes(T))", "1"),
        ("standard(T)", "1"),
        ("standard.inverse(standard(T))", "degC"),
        ("table(T) - T", "K"),
    ],
)
def test_an_expression_has_its_unit(expression: str, unit: str) -> None:
    outputs = f'outputs: {{y: {{expr: "{expression}", unit: {unit}}}, x: X}}\n'
    assert [code for code in warnings_of(HEAD + outputs) if code not in _UNUSED] == []
    # the unit is known: another one is reported
    other = outputs.replace(f"unit: {unit}}}", "unit: kg}")
    assert "W0505" in warnings_of(HEAD + other)


_UNUSED = frozenset(["W0301", "W0748"])


@pytest.mark.parametrize(
    ("expression", "code"),
    [
        # an absolute temperature in K is no difference
        ("K0 - T", "W0504"),
        ("max(T, K0)", "W0504"),
        ("where(T > K0, T, Ta)", "W0504"),
        # scales of other degrees
        ("T + F", "W0504"),
        ("T - up", "W0504"),
        ("T + 5", "W0504"),
    ],
)
def test_what_does_not_fit_is_still_reported(expression: str, code: str) -> None:
    inputs = HEAD.replace("F: degF,", "F: degF, K0: K,")
    outputs = f'outputs: {{y: "{expression}"}}\n'
    assert code in warnings_of(inputs + outputs)


@pytest.mark.parametrize(("expression", "unit"), [("T - Ta", "degC"), ("T + warmer", "K")])
def test_a_difference_is_no_temperature(expression: str, unit: str) -> None:
    outputs = f'outputs: {{y: {{expr: "{expression}", unit: {unit}}}}}\n'
    assert "W0505" in warnings_of(HEAD + outputs)


def test_a_term_of_unknown_unit_never_conflicts() -> None:
    head = HEAD.replace("parameters: {", "parameters: {off: 2, ")
    for unit in ("K", "degC"):
        outputs = f'outputs: {{y: {{expr: "T - off", unit: {unit}}}}}\n'
        assert not {"W0504", "W0505"} & set(warnings_of(head + outputs))


@pytest.mark.parametrize(
    "integrator", ["euler", "semi_implicit", "midpoint", "rk4", "linear_implicit"]
)
@pytest.mark.parametrize(("unit", "rate"), [("degC", "K/s"), ("degF", "degR/s"), ("K", "K/s")])
def test_newtons_law_of_cooling_is_silent(integrator: str, unit: str, rate: str) -> None:
    spec = f"""
    integrator: {integrator}
    inputs: {{Ta: {unit}}}
    parameters: {{tau: {{init: 10, unit: s}}}}
    states: {{T: {{unit: {unit}, init: 20, der: (Ta - T)/tau}}}}
    outputs: {{y: T, w: {{expr: der(T), unit: {rate}}}}}
    """
    assert set(warnings_of(spec)) <= _UNUSED
    air = np.full(5, 30.0)
    found = simulated(spec, {"Ta": air}, 0, 4)
    assert found[1] == pytest.approx(30 - 10 * np.exp(-0.01), abs=2e-3)


PARAMETER = """
inputs: {u: K}
parameters: {p: {init: VALUE, unit: UNIT}}
outputs: {y: u * p}
"""


@pytest.mark.parametrize(
    ("value", "unit", "number"),
    [
        ("300 K", "degC", 26.85),
        ("26.85 degC", "K", 300.0),
        ("9 degR", "K", 5.0),
        ("5 N/mm", "N/m", 5000.0),
        ("300 uH", "H", 3e-4),
        ("1 kWh", "J", 3.6e6),
        ("-3 mm", "m", -3e-3),
        ("5 m", "m", 5.0),
    ],
)
@pytest.mark.parametrize("section", ["parameters", "constants"])
def test_a_value_converts_to_the_unit_of_its_entry(
    section: str, value: str, unit: str, number: float
) -> None:
    text = PARAMETER.replace("VALUE", value).replace("UNIT", unit)
    if section == "constants":
        text = text.replace("parameters", "constants").replace("init", "value")
    # rounded once: the number that the spec means
    assert evaluated(text, {"u": np.ones(2)}) == number


def test_a_setting_of_the_command_line_converts(tmp_path: Path) -> None:
    path = tmp_path / "p.msnn.yaml"
    text = PARAMETER.replace("VALUE", "20").replace("UNIT", "degC")
    path.write_text(f"msnn: 1\nname: p\nsample_time: 1 s\n{text}")
    model = msnn.load(path, {"parameters.p.init": "300 K"})
    (parameter,) = model.program.parameters
    assert parameter.initial == (26.85,)


def test_a_value_of_another_quantity_is_refused() -> None:
    assert codes(PARAMETER.replace("VALUE", "300 N").replace("UNIT", "degC")) == ["E0502"]
    assert codes(PARAMETER.replace("VALUE", "50 Hz").replace("UNIT", "rpm")) == ["E0507"]
