"""A field that no spec can fill leaves the plug-in's name out, with the field and the repair."""

from __future__ import annotations

from pathlib import Path

import pytest

from msnn.cli.application import run
from spec_schema import plugins, registry
from spec_schema.fields.entry import kinds_within
from spec_schema.fields.field_faults import fault_of_fields
from spec_schema.sections.spec import Spec
from tests.extending.conftest import Install
from tests.extending.test_plugins import PLAIN, spec_file

RECORD = """
from msnn.extending import *

class Inner(Entry):
    size: PositiveCount = 1

class Keys(Entry):
    {field}

def compile(entry, linked, program, compile_other):
    return CompiledSection(Problem())

class Problem:
    program = None

SECTION = Section(compile=compile, text=lambda problem: "a")
FEATURE = Feature(name="keyed", sections=(
    SectionLine("keyed", LateEntry("keyed", "Keys"), LateObject("keyed", "SECTION"), ""),
))
"""
SPEC = f"{PLAIN}keyed: {{}}\n"


@pytest.mark.parametrize(
    ("field", "message"),
    [
        ("n: int", "the field `n` of Keys has the type `int`: use `PositiveCount` or"),
        ("n: int = 3", "the field `n` of Keys has the type `int`"),
        ("n: float | None = None", "has the type `float`: use `PositiveNumber`"),
        ("n: str = ''", "has the type `str`: use `Text`"),
        ("n: bool = False", "has the type `bool`: use `Switch`"),
        ("n: list[int] = []", "has the type `list`: use `ManyOf[...]`"),
        ("n: ManyOf[float] = ()", "has the type `float`"),
        ("n: dict[str, float] = {}", "has the type `dict`: use `EntriesOf[...]`"),
        ("n: Located[str] | None = None", "has the type `Located`: use `NewName`"),
        ("place: PositiveCount", "the field `place` of Keys has the name of the entry's place"),
        ("n: PositiveCount = None", "the field `n` of Keys has the default None"),
        ("n: PositiveCount = 'three'", "has the default 'three'"),
        ("n: PositiveCount = 0", "has the default 0"),
        ("n: PositiveCount = True", "has the default True"),
        ("n: PositiveNumber = -1.0", "has the default -1.0"),
        ("n: ManyOf[PositiveNumber] = [1.0]", "has the default [1.0]"),
        ("n: PositiveLength | None = '30 ms'", "has the default '30 ms'"),
        ("n: choice('a', 'b') = 'c'", "has the default 'c'"),
    ],
)
def test_a_field_that_no_spec_can_fill_is_named(
    field: str, message: str, install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    install("keyed", {"keyed.py": RECORD.replace("{field}", field)}, "keyed:FEATURE")
    assert run(["check", str(spec_file(tmp_path, SPEC))]) == 1
    said = capsys.readouterr().err
    left_out = "warning[W0222]: the section `keyed` of the package keyed is left out"
    assert f"{left_out}: TypeError: " in said
    assert message in said
    assert "of its own" not in said


@pytest.mark.parametrize(
    "field",
    [
        "n: PositiveCount = 3",
        "n: PositiveNumber = 3",
        "n: PositiveLength | None = None",
        "n: ManyOf[PositiveNumber] = (1.0, 2)",
        "n: choice('a', 'b') = 'a'",
        "n: Switch = True",
        "n: QuantityField | None = None",
        "n: ExpressionField | None = None",
        "n: References = ()",
        "n: Text = 'a'",
        "n: Inner | None = None",
        "n: EntriesOf[Inner] = ()",
    ],
)
def test_other_fields_are_read(field: str, install: Install):
    install("keyed", {"keyed.py": RECORD.replace("{field}", field)}, "keyed:FEATURE")
    assert plugins.look_up().warnings == ()


def test_the_entries_of_msnn_have_no_fault():
    lines = (*registry.SECTIONS, *registry.TARGETS, *registry.LAYERS)
    kinds = {
        each for kind in (Spec, *(line.entry.kind for line in lines)) for each in kinds_within(kind)
    }
    assert len(kinds) > 60
    assert [fault for kind in kinds if (fault := fault_of_fields(kind)) is not None] == []
