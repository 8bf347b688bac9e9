"""A part of the changes of `benchmarks/mutation`: the generated test program sees each of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.mutation import run
from benchmarks.mutation.run import export_with_drawn_weights, mutation_score
from msnn.verification.proof_step import GCC
from tests.conditions import miss


def test_the_test_program_sees_changes_of_the_reference_model(tmp_path: Path) -> None:
    if not GCC.is_there:
        miss(f"gcc is not installed: apt-get install {GCC.package}")
    export_with_drawn_weights("reference", tmp_path)
    assert not mutation_score(tmp_path, "reference", every=4, kinds=("value",)).missed
    kinds = ("shared", "static", "sample time")
    score = mutation_score(tmp_path, "reference", kinds=kinds)
    assert not score.missed
    # a class of which nothing is changed would miss nothing
    assert {mutant.kind for mutant in score.seen} == {*kinds}


def test_the_test_program_sees_a_raw_sample_in_the_place_of_a_held_one(tmp_path: Path) -> None:
    if not GCC.is_there:
        miss(f"gcc is not installed: apt-get install {GCC.package}")
    export_with_drawn_weights("cart_pole", tmp_path)
    score = mutation_score(tmp_path, "cart_pole", kinds=("raw",))
    assert not score.missed
    assert score.seen


def test_a_right_source_that_is_seen_is_no_score(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else every change of it would count as seen."""
    if not GCC.is_there:
        miss(f"gcc is not installed: apt-get install {GCC.package}")
    export_with_drawn_weights("reference", tmp_path)
    monkeypatch.setattr(run, "writable_objects", lambda *_: ["of another tool"])
    with pytest.raises(AssertionError):
        mutation_score(tmp_path, "reference", kinds=("shared",))


def test_last_digits_of_a_kernel_are_seen_unless_no_float_shows_them(tmp_path: Path) -> None:
    """One of them shows at -0 alone: the hyperbolic tangent of it is 0 with the other sign."""
    if not GCC.is_there:
        miss(f"gcc is not installed: apt-get install {GCC.package}")
    export_with_drawn_weights("reference", tmp_path)
    score = mutation_score(tmp_path, "reference", kinds=("last digit",))
    assert not score.missed
    assert {mutant.function for mutant in score.seen} == {"reference_tanh"}


def test_each_statement_that_tells_of_an_infinite_slope_is_needed(tmp_path: Path) -> None:
    if not GCC.is_there:
        miss(f"gcc is not installed: apt-get install {GCC.package}")
    export_with_drawn_weights("tyre", tmp_path, ["jacobian"])
    score = mutation_score(tmp_path, "tyre", kinds=("deleted",))
    assert not score.missed
    assert sum("SLOPE_NOT_FINITE" in mutant.line for mutant in score.seen) == 2


def test_limits_of_a_linearised_model_are_seen_one_by_one(tmp_path: Path) -> None:
    if not GCC.is_there:
        miss(f"gcc is not installed: apt-get install {GCC.package}")
    export_with_drawn_weights("two_tanks", tmp_path, ["jacobian"])
    assert not mutation_score(tmp_path, "two_tanks", kinds=("value",)).missed
