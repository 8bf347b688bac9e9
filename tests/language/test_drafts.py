"""The specs that the language was designed on are read without a word, units included."""

from pathlib import Path

import pytest

from msnn.project.workflow_checks import checked_model

DRAFTS = sorted((Path(__file__).parent / "drafts").glob("*.msnn.yaml"))


@pytest.mark.parametrize("path", DRAFTS, ids=lambda path: path.name.removesuffix(".msnn.yaml"))
def test_draft_checks_clean(path: Path) -> None:
    assert checked_model(path, strict_units=True).warnings == ()
