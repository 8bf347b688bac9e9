"""A target is one file and one line in the table: what else names targets follows or says so."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import pytest
from typer.main import get_command

from msnn.cli.application import application
from msnn.exports.describe import exports_text
from msnn.exports.export import target_named, target_names
from msnn.exports.table import EXTRAS, NAMES, TARGETS, ListedTarget
from msnn.model.load import load_model
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.fields.entry_kinds import kinds_of
from spec_schema.sections.exports import Export, Extra

VERB = "msnn/cli/verbs/export.py"
SCHEMA = "spec_schema/sections/exports.py"


@pytest.mark.parametrize("name", NAMES)
def test_a_line_of_the_table_is_a_target_in_a_file(name: str) -> None:
    target = target_named(name)
    assert target.name == name, f"msnn/exports/targets/{name}.py says `{target.name}`"


def test_every_key_of_export_is_a_target_of_the_table() -> None:
    keys = {key: kinds_of(field.annotation) for key, field in Export.model_fields.items()}
    entries = {key: kinds[0] for key, kinds in keys.items() if key != "place"}
    assert list(entries) == list(NAMES), f"{SCHEMA} and msnn/exports/table.py name other targets"
    for name, entry in entries.items():
        assert target_named(name).entry is entry, f"msnn/exports/targets/{name}.py has no {entry}"


def test_the_extras_of_the_command_line_are_those_of_the_spec() -> None:
    assert set(get_args(Extra)) == set(EXTRAS), f"{SCHEMA} and msnn/exports/table.py differ"


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_the_help_of_export_names_every_target(target: ListedTarget) -> None:
    command = get_command(application()).commands["export"]  # pyright: ignore[reportAttributeAccessIssue]
    (to,) = (option for option in command.params if option.name == "to")
    first, _, _ = command.help.partition("\n")
    assert f" {target.name} " in re.sub("[,;]", " ", f" {to.help}"), f"{VERB} forgets {target.name}"
    assert target.title in first, f"{VERB} forgets {target.title}"


def test_targets_are_written_in_the_order_of_the_table() -> None:
    assert target_names(["c", "torch"], None) == ("torch", "c")
    assert target_names([], None) == target_names(["all"], None) == NAMES
    with pytest.raises(SpecError) as caught:
        target_names(["foo"], None)
    assert [found.code for found in caught.value.diagnostics] == ["E1038"]


def test_the_interface_of_fixed_point_names_its_type(tmp_path: Path) -> None:
    spec = tmp_path / "m.msnn.yaml"
    spec.write_text(
        "msnn: 1\nname: m\nsample_time: 1 s\ninputs: {u: {range: [-1, 1]}}\noutputs: {y: u}\n"
        "export: {c: {dtype: q15}}\n"
    )
    assert exports_text(load_model(spec)).startswith("c, q15\n")
