"""What is said of names of Python's libraries can be written."""

from __future__ import annotations

import re

import pytest

import msnn
from compiler.ir.scalars import SIGNATURES
from spec_schema.expressions.language import ELSEWHERE, FORMULAS

SPEC = """msnn: 1
name: m
sample_time: 10 ms
dims: {axis: 2}
inputs: {x: {}, y: {}, a: {dims: axis}, b: {dims: axis}}
constants: {low: {value: -1}, high: {value: 1}}
outputs: {z: "%s"}
"""
WRITTEN = sorted({text for said in FORMULAS.values() for text in re.findall("`([^`:]+)`", said)})


@pytest.mark.parametrize("formula", WRITTEN)
def test_a_formula_is_one_of_the_language(formula: str) -> None:
    assert msnn.load(SPEC % formula).program.outputs


def test_what_is_said_of_a_name_is_never_said_of_one_of_the_language() -> None:
    assert not {*FORMULAS, *ELSEWHERE} & {*SIGNATURES}
    assert {*ELSEWHERE.values()} <= {*SIGNATURES}
