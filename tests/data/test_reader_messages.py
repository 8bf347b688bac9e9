"""Processes that read files are asked, and answer, in JSON and raw arrays that run no code."""

from __future__ import annotations

import ast
import io
import json
from pathlib import Path

import numpy as np
import pytest

from msnn.data.formats.isolation.message import ReadRequest, read_message, write_message
from msnn.data.formats.table import ColumnTable, TimeSource, WantedColumns
from msnn.data.formats.text.csv_header import Dialect
from spec_schema.diagnostics.source import Span
from spec_schema.fields.leaf import Located
from spec_schema.units.parser import parse_unit

ROOT = Path(__file__).resolve().parents[2]
RUN_CODE = {"pickle", "_pickle", "marshal", "shelve", "cloudpickle", "dill", "joblib"}
"""Modules that make objects, and with them code, of bytes."""
PLACE = Span(file="plant.msnn.yaml", line=3, column=7, end_line=3, end_column=9)
REQUEST = ReadRequest(
    of="msnn.data.formats.streams.mdf_file",
    path=Path("/logs/läuft \udcff.mf4"),
    shown="läuft \udcff.mf4",
    wanted=WantedColumns(
        users={"x": "`x`", 3: "`F`"},
        optional=frozenset({"x", 3}),
        spare=frozenset({3}),
        moments=frozenset({"t"}),
        time=TimeSource("t", PLACE, Located(parse_unit("1/min"), PLACE, None)),
    ),
    dialect=Dialect(
        delimiter=";", is_usual=True, decimal=",", thousands=".", comment="#", header=False, skip=2
    ),
    memory=1 << 40,
    seconds=20,
)


def test_a_request_comes_back_as_it_was():
    pipe = io.BytesIO()
    write_message(pipe, REQUEST)
    sent = pipe.getvalue()
    assert json.loads(sent[8:])["class"] == "ReadRequest"
    found = read_message(io.BytesIO(sent))
    assert found == REQUEST
    # of places, which do not count where values are compared
    assert found.wanted.time.unit.span == PLACE
    assert found.wanted.time.unit.value.text == "1/min"


def test_an_object_of_another_class_is_not_written():
    with pytest.raises(TypeError):
        write_message(io.BytesIO(), (REQUEST, object()))
    with pytest.raises(TypeError):
        write_message(io.BytesIO(), ColumnTable(columns={"x": np.ones(2)}, begins={"x": object()}))  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("package", ["spec_schema", "compiler", "backends", "msnn", "templates"])
def test_no_module_makes_objects_of_bytes(package: str):
    for path in sorted((ROOT / package).rglob("*.py")):
        imported: list[str] = []
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            match node:
                case ast.Import(names=names):
                    imported += [alias.name for alias in names]
                case ast.ImportFrom(module=str(name)):
                    imported.append(name)
                case _:
                    pass
        assert not {name.partition(".")[0] for name in imported} & RUN_CODE, path
