"""The notebook runs from its first cell to its last, and shows what a reader is promised."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

from tests.conditions import require_tool

NOTEBOOK = Path(__file__).parents[2] / "examples" / "notebook" / "pendulum.ipynb"


@pytest.fixture(scope="module")
def cells(tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    """Its cells of code, run in an empty folder by a kernel of this Python."""
    require_tool("gcc", install="apt install gcc")
    folder = tmp_path_factory.mktemp("notebook")
    notebook: Any = nbformat.read(NOTEBOOK, as_version=4)
    resources = {"metadata": {"path": str(folder)}}
    NotebookClient(notebook, timeout=300, kernel_name="python3", resources=resources).execute()
    assert not list(folder.iterdir()), "it says that nothing is written"
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def test_it_is_kept_without_outputs() -> None:
    notebook: Any = nbformat.read(NOTEBOOK, as_version=4)
    kept = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(not cell.outputs and cell.execution_count is None for cell in kept)


def _outputs(cells: list[Any], source: str) -> list[Any]:
    (cell,) = [cell for cell in cells if source in cell.source]
    return list(cell.outputs)


def test_training_shows_how_far_it_is_and_then_its_tables(cells: list[Any]) -> None:
    progress, tables = _outputs(cells, "result = msnn.train(model, log")
    assert "stage 1/1 fit" in progress.data["text/plain"]
    assert "best" in progress.data["text/plain"].splitlines()[-1]
    assert "<th" in tables.data["text/html"]
    assert re.match(r"<TrainingResult: 1 stage, best \S+, kept nowhere>", tables.data["text/plain"])


def test_what_was_learned_is_what_made_the_record(cells: list[Any]) -> None:
    (frame,) = _outputs(cells, "result.to_frame()")
    text = frame.data["text/plain"]
    (friction,) = re.findall(r"friction .*? 0\.5 +(\S+)", text)
    # 0.15 and 4.905 made the record; the noise leaves a hundredth
    assert float(friction) == pytest.approx(0.15, abs=0.01)


def test_plots_are_pictures(cells: list[Any]) -> None:
    for source in ("result.plot()", "runs.plot()"):
        (picture,) = _outputs(cells, source)
        assert "image/png" in picture.data


def test_a_mistake_is_shown_with_its_line_and_its_repair(cells: list[Any]) -> None:
    (shown,) = _outputs(cells, "fricton*w")
    text = re.sub(r"\x1b\[[0-9;]*m", "", "\n".join(shown.traceback))
    assert text.startswith("error[E0301]: unknown name `fricton`")
    assert "der: (u - fricton*w - weight*sin(q)) / inertia" in text
    assert text.endswith("= help: did you mean `friction`?")
    assert "Traceback" not in text
