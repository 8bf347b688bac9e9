"""A part of the changes of `benchmarks/mutation`: the generated test program sees each of them."""

from __future__ import annotations

from pathlib import Path

from benchmarks.mutation.run import export_with_drawn_weights, mutation_score
from msnn.verification.tools import GCC
from tests.conditions import miss


def test_the_test_program_sees_changes_of_the_reference_model(tmp_path: Path) -> None:
    if not GCC.is_there:
        miss(f"gcc is not installed: apt-get install {GCC.package}")
    export_with_drawn_weights("reference", tmp_path)
    kinds = ("value", "raw", "shared", "static", "sample time")
    score = mutation_score(tmp_path, "reference", every=4, kinds=kinds)
    assert not score.missed
    assert len(score.seen) > 12
