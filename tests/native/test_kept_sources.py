"""Sources of kernels are written once for a program, and anew for another one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from fractions import Fraction
from pathlib import Path

from backends.native.kernel_source import kept_source, kernel_source
from backends.native.rollout_kernel import rollout_source
from compiler.differentiation.training_step import training_step
from compiler.ir.program import Program
from msnn.model.load import load_model
from tests.language.compiled import compiled

ARM = Path(__file__).parent.parent.parent / "examples" / "gallery" / "arm_friction.msnn.yaml"
SPEC = """
sample_time: 0.1 s
inputs: {{u: "1"}}
parameters: {{p: {{init: 2}}}}
outputs: {{y: {{expr: "max(p * u, {floor})", predicts: "u[t+1]"}}}}
"""
BOUNDED = """
sample_time: 0.1 s
inputs: {{u: "1"}}
parameters: {{p: {{init: {init}, min: 0}}}}
outputs: {{y: {{expr: "sqrt(p) * u / p", predicts: "u[t+1]"}}}}
"""


def test_a_program_that_is_made_again_is_not_lowered_again():
    asked: list[str] = []

    @kept_source
    def write(program: object, dtype: str) -> str:
        asked.append(dtype)
        return f"{dtype} of {program}"

    first = write(compiled(SPEC.format(floor="0.0")), "float64")
    assert write(compiled(SPEC.format(floor="0.0")), "float64") == first
    assert asked == ["float64"]
    assert write(compiled(SPEC.format(floor="0.0")), "float32") != first
    assert asked == ["float64", "float32"]


def test_first_values_within_bounds_make_no_other_source():
    """A sweep over first values lowers one program; without bounds the first value says slopes."""
    asked: list[str] = []

    @kept_source
    def write(program: Program) -> str:
        asked.append(rollout_source(program).source.text)
        return asked[-1]

    for init in (2, 3):
        write(compiled(BOUNDED.format(init=init)))
    assert len(asked) == 1
    for init in (2, 3):
        write(compiled(BOUNDED.format(init=init).replace("min: 0", "learn: false")))
    assert len(asked) == 3


def test_a_kernel_says_nothing_of_first_values_within_bounds():
    texts: list[str] = []
    for init in (2, 3):
        spec = BOUNDED.format(init=init)
        texts.append(kernel_source(training_step(compiled(spec)), "float64").text)
    assert texts[0] == texts[1]


def test_numbers_that_are_equal_and_not_the_same_make_two_sources():
    asked: list[float] = []

    @kept_source
    def write(value: float) -> str:
        asked.append(value)
        return repr(value)

    assert [write(0.0), write(-0.0), write(0.0)] == ["0.0", "-0.0", "0.0"]
    assert len(asked) == 2


def test_only_the_last_sources_are_kept():
    asked: list[int] = []

    @kept_source
    def write(value: int) -> str:
        asked.append(value)
        return str(value)

    for value in (*range(17), 16, 0):
        write(value)
    assert asked == [*range(17), 0]


def test_the_text_of_a_program_leaves_nothing_out():
    """What `repr` does not show would make two programs one kernel."""
    program = load_model(ARM).program
    seen: set[type] = set()

    def look(value: object) -> None:
        if isinstance(value, tuple | list | frozenset | set):
            for one in value:
                look(one)
        elif isinstance(value, dict):
            look([*value.items()])
        elif is_dataclass(value) and not isinstance(value, type):
            shown = repr(value)
            for field in fields(value):
                part = getattr(value, field.name)
                assert f"{field.name}={part!r}" in shown, field
                look(part)
            seen.add(type(value))
        else:
            assert isinstance(value, str | int | float | Fraction | Enum | Mapping | None), value

    look(program)
    assert len(seen) > 10
