"""The page about predictive control: its loop runs, the level gets there, ipopt agrees."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.cli.command_line import ROOT, in_new_process

PAGE = (ROOT / "docs" / "mpc.md").read_text(encoding="utf-8")
RUN = "<!-- run by: tests/docs/test_mpc_page.py -->\n"


def blocks(language: str, mark: str) -> list[str]:
    """Those with this mark above them; what another mark says of others is checked elsewhere."""
    return re.findall(rf"\n\n{re.escape(mark)}```{language}\n(.*?)^```", PAGE, re.M | re.S)


def test_the_loop_around_a_controller(tmp_path: Path) -> None:
    (spec,) = blocks("yaml", "")
    (tmp_path / "tank.msnn.yaml").write_text(spec, encoding="utf-8")
    (tmp_path / "loop.py").write_text("".join(blocks("python", RUN)), encoding="utf-8")
    said = in_new_process((), tmp_path, start="import runpy; runpy.run_path('loop.py')")
    assert said.code == 0, said.err
    found = re.fullmatch(r"SOLVED (\S+) cm at (\S+) V\n(\S+) (\S+)\n", said.out)
    assert found is not None
    level, pump, own, other = map(float, found.groups())
    assert level == pytest.approx(12.0, abs=0.02)
    assert pump == pytest.approx(0.08 * 12**0.5 / 0.04, abs=0.1)
    assert own == pytest.approx(other, rel=1e-6, abs=1e-6)
