"""The page about plug-ins lists every name of `msnn.extending`."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from msnn import extending
from msnn.extending import Axis, GraphBuilder, parse_unit

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "extending.md").read_text(encoding="utf-8")


def test_the_page_has_a_sentence_for_every_name():
    table = PAGE.partition("| name | what it is |")[2].partition("\n\n")[0]
    rows = re.findall(r"^\| `(\w+)` \| ([A-Z].*\.) \|$", table, re.MULTILINE)
    assert [name for name, _ in rows] == extending.__all__


@pytest.mark.parametrize("text", ["m/s^2", "1", "N*m"])
def test_a_constant_has_the_unit_that_is_given(text: str):
    builder = GraphBuilder()
    unit = parse_unit(text)
    assert builder.type(builder.constant(9.81, unit=unit)).unit == unit
    assert builder.type(builder.constant([1.0, 2.0], (Axis("i", 2),))).unit == parse_unit("1")
    builder.add(builder.constant(9.81, unit=unit), builder.constant(0.0))
    assert not builder.conflicts
    builder.add(builder.constant(9.81, unit=unit), builder.constant(2.0, unit=parse_unit("K")))
    assert len(builder.conflicts) == 1
