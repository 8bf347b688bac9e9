"""The page about Python: its examples run, and the car reaches its speed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.cli.command_line import ROOT, in_new_process
from tests.conditions import require_tool

PAGE = (ROOT / "docs" / "python.md").read_text()


LOOP = PAGE[PAGE.index("## A step at a time") :]


def block(language: str, page: str = LOOP) -> str:
    (found,) = re.findall(rf"^```{language}\n(.*?)^```", page, re.M | re.S)
    return found


def test_models_trainings_and_tables(tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    section = PAGE[: PAGE.index("## First and second derivatives")]
    (tmp_path / "lag.msnn.yaml").write_text(block("yaml", section))
    (tmp_path / "lag.py").write_text(block("python", section))
    said = in_new_process((), tmp_path, start="import runpy; runpy.run_path('lag.py')")
    assert (said.code, said.err) == (0, "")
    assert re.search(r"^y_next +rmse +.*≤ 1e-06 +kept", said.out, re.M), said.out


def test_second_derivatives(tmp_path: Path) -> None:
    section = PAGE[PAGE.index("## First and second") : PAGE.index("## A step at a time")]
    (tmp_path / "plant.msnn.yaml").write_text(block("yaml", section))
    (tmp_path / "slopes.py").write_text(block("python", section))
    said = in_new_process((), tmp_path, start="import runpy; runpy.run_path('slopes.py')")
    assert said.code == 0, said.err


def test_the_loop_around_a_stepper(tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    (tmp_path / "cruise.msnn.yaml").write_text(block("yaml"))
    (tmp_path / "loop.py").write_text(block("python"))
    said = in_new_process((), tmp_path, start="import runpy; runpy.run_path('loop.py')")
    assert said.code == 0, said.err
    speed = re.fullmatch(r"(\S+) m/s, \S+ m behind\n", said.out)
    assert speed is not None
    assert float(speed[1]) == pytest.approx(30.0, abs=0.05)
