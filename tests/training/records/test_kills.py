"""Trainings and exports that are killed at random moments; `benchmarks/kills` kills hundreds."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import pytest

from benchmarks.kills.cases import Kind, Outcome, Subject, killed, subjects

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


def fake(run: Callable[[Path, bool], None], seconds: float = 0.05) -> Subject:
    """An export that should leave one file."""
    return Subject("export", run, seconds, {"c/x": b"whole"}, lambda folder: None)


def leaves(folder: Path, content: bytes) -> None:
    (folder / "c").mkdir(exist_ok=True)
    (folder / "c" / "x").write_bytes(content)


def slow(folder: Path, resume: bool) -> None:
    del resume
    # from the second process on it is quick: the first is killed however slow the machine is
    if not (folder / "begun").exists():
        (folder / "begun").touch()
        time.sleep(60)
    leaves(folder, b"whole")


def test_what_is_over_before_its_kill_was_not_killed(tmp_path: Path) -> None:
    def quick(folder: Path, resume: bool) -> None:
        del resume
        leaves(folder, b"whole")

    outcome = killed(fake(quick, 8.0), tmp_path / "case", 2)
    assert outcome.right
    assert outcome.kills == 0


def test_what_ends_by_a_mistake_of_its_own_was_not_killed_and_is_not_right(tmp_path: Path) -> None:
    """Though the next try goes well."""

    def mistaken(folder: Path, resume: bool) -> None:
        if not (folder / "begun").exists():
            (folder / "begun").touch()
            raise ValueError
        leaves(folder, b"whole")

    outcome = killed(fake(mistaken, 8.0), tmp_path / "case", 2)
    assert not outcome.right
    assert outcome.kills == 0


def test_what_becomes_something_else_is_not_right(tmp_path: Path) -> None:
    def other(folder: Path, resume: bool) -> None:
        del resume
        leaves(folder, b"other")

    assert not killed(fake(other, 8.0), tmp_path / "case", 2).right


@pytest.mark.parametrize("part", [b"", b"who"])
def test_a_part_of_a_file_is_not_right(part: bytes, tmp_path: Path) -> None:
    def parted(folder: Path, resume: bool) -> None:
        leaves(folder, part)
        slow(folder, resume)

    # seed 5 kills at four fifths of the second
    outcome = killed(fake(slow, 1.0), tmp_path / "whole", 5)
    assert (outcome.right, outcome.kills) == (True, 1)
    assert not killed(fake(parted, 1.0), tmp_path / "parted", 5).right


def test_more_seconds_lost_than_promised_are_not_good() -> None:
    outcome = Outcome("train", 1, 0.4, right=True, latest_stayed=True)
    assert outcome.is_good(0.5)
    assert not outcome.is_good(0.3)
