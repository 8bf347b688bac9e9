"""Trainings and exports that are killed at random moments; `benchmarks/kills` kills hundreds."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.kills.cases import Kind, Subject, killed, subjects

MOST_LOST = 0.0
"""Every place is kept: the trainings are short."""


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[Kind, Subject]:
    return subjects(tmp_path_factory.mktemp("kills"), epochs=8, most_lost=MOST_LOST)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("kind", ["train", "folds", "export"])
def test_what_was_killed_becomes_what_nobody_disturbed(
    kind: Kind, seed: int, undisturbed: dict[Kind, Subject], tmp_path: Path
) -> None:
    outcome = killed(undisturbed[kind], tmp_path / "case", seed)
    assert outcome.right
    assert outcome.latest_stayed
