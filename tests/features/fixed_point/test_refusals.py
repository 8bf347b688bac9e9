"""What fixed point refuses, at which line, and with which repair."""

from pathlib import Path

import pytest

from msnn.features.fixed_point.compile.tables import fitted_table
from msnn.features.fixed_point.integers.builder import CannotFitError
from msnn.features.fixed_point.integers.program import Q31
from tests.features.fixed_point.exported import fixed_model, gallery_text, planned

HEAD = "msnn: 1\nname: model\nsample_time: 1 s\n"


@pytest.mark.parametrize(
    ("text", "code", "line", "said"),
    [
        ("inputs:\n  u: {}\noutputs: {y: u}", "E0960", 5, "`u`"),
        (
            "inputs: {u: {range: [-1, 1]}}\nstates:\n  x: {next: x + u, init: 0}\noutputs: {y: x}",
            "E0961",
            6,
            "does not forget",
        ),
        (
            "inputs: {u: {range: [-1, 1]}}\nstates:\n  x: {next: tanh(x + u)}\noutputs: {y: x}",
            "E0961",
            6,
            "not linear",
        ),
        (
            "inputs: {u: {range: [-1, 1]}, w: {range: [-1, 1]}}\noutputs:\n  y: atan2(u, w)",
            "E0961",
            6,
            "more than one variable",
        ),
        ("inputs: {u: {range: [0, 1]}}\noutputs:\n  y: log(u)", "E0961", 6, "not finite"),
    ],
)
def test_refused(text: str, code: str, line: int, said: str, tmp_path: Path) -> None:
    plan = planned(fixed_model(tmp_path, HEAD + text, "q15"))
    (fault,) = plan.target.faults(plan)
    assert fault.code == code
    assert said in fault.message
    assert fault.span is not None
    assert fault.span.line == line
    assert fault.help


def test_a_function_that_is_infinite_between_the_points_that_are_tried_has_no_table() -> None:
    """Warnings are errors in tests: numpy said something of ∞ − ∞ before the message."""
    with pytest.raises(CannotFitError, match="a table of more than"):
        fitted_table("reciprocal", lambda x: 1.0 / x, Q31, (-1_000_001, 2_000_000_000, 20))


@pytest.mark.parametrize("name", ["two_tanks", "tyre", "cart_pole", "leg"])
def test_a_gallery_model_with_functions_that_no_table_follows(name: str, tmp_path: Path) -> None:
    plan = planned(fixed_model(tmp_path, gallery_text(name), "q15"))
    (fault,) = plan.target.faults(plan)
    assert fault.code == "E0961"
    assert fault.span is not None
