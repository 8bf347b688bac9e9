"""`weight:` and `bias:` that name parameters: sharing and units; values are in `cases/`."""

from tests.language.compiled import compiled

HEAD = """
dims: {tap: 3}
inputs: {x: m, v: m}
parameters:
  taps: {dims: tap, init: [1, 2, 4], unit: N/m}
  offset: {init: 7, unit: N}
layers:
  h: {fir: {window: 3, weight: taps, bias: offset}}
  g: {fir: {window: 3, weight: taps}}
"""


def test_layers_and_expressions_share_one_parameter():
    program = compiled(HEAD + 'outputs: {y: "h(x) + g(v) + taps @ v.past(3)"}')
    assert [parameter.name for parameter in program.parameters] == ["taps", "offset"]


def test_the_unit_of_a_result_follows_from_that_of_its_weights():
    program = compiled(HEAD + "outputs: {y: h(x)}")
    unit = program.step[program.outputs[0].node].type.unit
    assert unit is not None
    assert unit.text == "N"
