"""Random well-typed programs, and special ones: the interpreter's bits from the C."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis.strategies import sampled_from

from backends.c import COptions, write_c
from compiler.ir.program import Program
from compiler.passes.to_step_form import to_step_form
from tests.backends.c.c_programs import assert_same_bits, built, golden, program_said, replay
from tests.backends.c.small_programs import conditions, long_chain, nothing_to_do
from tests.every_op.random_programs import programs

OPTIONS = (
    COptions(),
    COptions(ring="double", params="inline", unroll=1),
    COptions(constant_time=True),
)


RANDOM = settings(
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)


@settings(RANDOM, max_examples=40)
@given(programs(), sampled_from(OPTIONS))
def test_random_programs_have_no_differing_bit(program: Program, options: COptions) -> None:
    with tempfile.TemporaryDirectory() as folder:
        _assert_bits(to_step_form(program), Path(folder), options)


@settings(RANDOM, max_examples=8)
@given(programs(), sampled_from(OPTIONS))
def test_their_test_programs_agree(program: Program, options: COptions) -> None:
    with tempfile.TemporaryDirectory() as folder:
        write_c(to_step_form(program), {}, Path(folder), options)
        assert "agree" in program_said(Path(folder))


@pytest.mark.parametrize("make", [conditions, nothing_to_do], ids=["if", "still"])
@pytest.mark.parametrize("options", OPTIONS, ids=["default", "inline", "constant"])
def test_special_programs(make: Callable[[], Program], options: COptions, tmp_path: Path) -> None:
    _assert_bits(make(), tmp_path / "library", options)
    write_c(make(), {}, tmp_path / "export", options)
    assert "agree" in program_said(tmp_path / "export")


def test_a_long_chain_needs_no_deep_stack(tmp_path: Path) -> None:
    program = long_chain(1100)  # Python's stack has 1,000 calls
    _assert_bits(program, tmp_path, OPTIONS[0])
    write_c(program, {}, tmp_path, OPTIONS[0])


def _assert_bits(program: Program, folder: Path, options: COptions) -> None:
    vectors = golden(program, options, 40, seed=1)
    outputs, status = replay(built(program, folder, options), vectors)
    assert_same_bits(outputs, vectors.outputs)
    assert np.array_equal(status, vectors.status)
