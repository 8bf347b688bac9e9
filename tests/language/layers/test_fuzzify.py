"""`fuzzify` and `local_model`: mistakes and what is learned; values are in `cases/`."""

import pytest

from tests.language.compiled import codes, compiled


def test_learned_centers_keep_their_order() -> None:
    """What is learned are the gaps between centres, and those are never negative."""
    text = """
inputs: {x: m}
layers: {learned: {fuzzify: {centers: [-1, 0, 3, 5], learn: true}}}
outputs: {y: learned(x)}
"""
    gaps = compiled(text).parameter("learned.gaps")
    assert gaps.minimum == 0
    assert gaps.initial == (1, 3, 2)


def test_a_membership_function_can_call_one_that_leaves_an_argument_out() -> None:
    """What is looked at for unknown names are expressions of the spec, not the layer's value."""
    text = """
inputs: {x: {}}
functions:
  square: {args: [a, b], expr: a * a}
  bell: {args: [d], expr: "exp(-square(d, 2 * d))"}
layers: {phi: {fuzzify: {centers: [-1, 0, 1], membership: {function: bell}}}}
outputs: {y: phi(x)}
"""
    assert codes(text) == []


@pytest.mark.parametrize(
    ("layers", "code"),
    [
        ("{fuzzify: {dim: ch}}", "E0203"),
        ("{fuzzify: {over: [phi], centers: [0, 1]}}", "E0228"),
        ("{fuzzify: {over: [plain, phi]}}", "E0313"),
        ("{fuzzify: {over: [phi, phi]}}", "E0225"),
        ("{fuzzify: {over: [h]}}", "E0313"),
        ("{fuzzify: {centers: [0, 1], membership: round}}", "E0207"),
        ("{fuzzify: {centers: [0, 1], membership: {shape: bell}}}", "E0204"),
        ("{fuzzify: {centers: [0, 1], membership: {function: bel}}}", "E0301"),
        ("{fuzzify: {centers: [0, 1], membership: rectangular, learn: true}}", "E0313"),
        ("{local_model: {by: [phi(x), phi(u)], cell: {fir: {window: 2}}}}", "E0402"),
        ("{local_model: {by: [x], cell: {fir: {window: 2}}}}", "E0402"),
    ],
)
def test_mistake(layers: str, code: str) -> None:
    spec = f"""
dims: {{ch: 2}}
inputs: {{x: m, u: m}}
functions: {{bell: {{args: [d], expr: exp(-d)}}}}
layers:
  phi: {{fuzzify: {{centers: [0, 5], dim: ch}}}}
  plain: {{fuzzify: {{centers: [0, 5]}}}}
  h: {{linear: {{}}}}
  bad: {layers}
outputs:
  y: sum(phi(x)) + sum(plain(x)) + h(x) + bell(1) + sum(bad(CALL))
"""
    arguments = "x, u" if "over: [p" in layers else "x"
    assert code in codes(spec.replace("CALL", arguments))
