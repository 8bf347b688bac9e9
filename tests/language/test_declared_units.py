"""Units that equations and outputs declare in other words than their formulas have."""

from tests.language.compiled import compiled


def test_a_declared_unit_is_shown_in_its_own_word() -> None:
    program = compiled("""
inputs: {v: V, i: A, r: {unit: 1}}
equations: {loss: {expr: v * i, unit: W}}
outputs:
  torque: {expr: "2 * v * i", unit: N*m/s}
  heat: loss
  angle: {expr: r, unit: rad}
  other: r * v
""")
    units = {each.name: program.step[each.node].type.unit for each in program.outputs}
    texts = {name: unit.text for name, unit in units.items() if unit}
    # what is read as it is keeps the unit of its own declaration
    assert texts == {"torque": "N*m/s", "heat": "W", "angle": "1", "other": "V"}
