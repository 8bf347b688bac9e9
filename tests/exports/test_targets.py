"""A target is one file and one line in the table: what else names targets follows or says so."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import pytest
from typer.main import get_command

from msnn.cli.application import application
from msnn.exports.describe import exports_text
from msnn.exports.export import plan_exports, target_named, target_names, write_export
from msnn.exports.table import EXTRAS, NAMES, TARGETS, ListedTarget
from msnn.exports.target import AnyPlan
from msnn.features.control.keys import OnlineExtra
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights
from spec_schema.diagnostics.diagnostic import Findings, SpecError
from spec_schema.fields.entry import kinds_of
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
    assert list(entries) == list(NAMES), (
        f"{SCHEMA} and msnn/exports/table.py name other targets, or in another order"
    )
    for name, entry in entries.items():
        assert target_named(name).entry is entry, f"msnn/exports/targets/{name}.py has no {entry}"


def test_the_extras_of_the_command_line_are_those_of_the_spec() -> None:
    assert {*get_args(Extra), *get_args(OnlineExtra)} == set(EXTRAS), (
        f"{SCHEMA} and msnn/exports/table.py differ"
    )


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_the_help_of_export_names_every_target(target: ListedTarget) -> None:
    command = get_command(application()).commands["export"]  # pyright: ignore[reportAttributeAccessIssue]
    (to,) = (option for option in command.params if option.name == "to")
    first, _, _ = command.help.partition("\n")
    assert f" {target.name} " in re.sub("[,;]", " ", f" {to.help}"), f"{VERB} forgets {target.name}"
    assert target.title in first, f"{VERB} forgets {target.title}"


def test_targets_are_written_in_the_order_of_the_table() -> None:
    assert target_names(["c", "torch"], None) == ("torch", "c")
    every = target_names(["all"], None, sections=["mpc"])
    assert every == target_names([], None, sections=["mpc"]) == NAMES


def test_controllers_are_among_all_targets_where_the_spec_has_one() -> None:
    assert target_names([], None) == target_names(["all"], None)
    assert set(NAMES) - set(target_names([], None)) == {"mpc"}
    with pytest.raises(SpecError) as caught:
        target_names(["mpc"], None)
    assert [found.code for found in caught.value.diagnostics] == ["E1140"]


@pytest.mark.parametrize(
    ("section", "entry", "code"),
    [
        ("", "{}", "E1140"),
        ("horizon: 10", "{outputs: [y]}", "E1143"),
        ("horizon: 10", "{platforms: [x86_64-windows]}", "E1224"),
    ],
)
def test_controllers_that_are_not_written_are_refused(
    section: str, entry: str, code: str, tmp_path: Path
) -> None:
    spec = tmp_path / "m.msnn.yaml"
    mpc = "mpc: {controls: [u], cost: x**2 + u**2, horizon: 10}\n"
    spec.write_text(
        "msnn: 1\nname: m\nsample_time: 1 s\ninputs: {u: {between: hold}}\n"
        "states: {x: {next: 0.9 * x + u, init: 0}}\n"
        "outputs: {y: {expr: x, predicts: 'z[t]'}}\ntargets: {z: {}}\n"
        f"{mpc if section else ''}"
        f"export: {{mpc: {entry}}}\n"
    )
    findings = Findings()
    model = load_model(spec)
    assert plan_exports(model, ["mpc"], findings) == []
    assert [found.code for found in findings.in_order] == [code]


@pytest.mark.parametrize(
    ("deviations", "dtype", "named"),
    [
        ("initial: {x: 1e20}", "float32", "`x` has a variance of 1e+40"),
        ("initial: {x: 1e-20}", "float32", "`x` has a variance of 1e-40"),
        ("process: {x: 1e19}, initial: {x: 1}", "float32", "`x` has a variance of 4e+38"),
        ("parameters: {k: {std: 1, walk: 1e-20}}", "float32", "`k` has a variance of 4e-40"),
        ("initial: {x: 1e18}, process: {x: 0}", "float32", None),
        ("initial: {x: 1e20}", "float64", None),
    ],
)
def test_no_estimator_is_written_whose_variances_leave_its_numbers(
    deviations: str, dtype: str, named: str | None, tmp_path: Path
) -> None:
    spec = tmp_path / "m.msnn.yaml"
    spec.write_text(
        "msnn: 1\nname: m\nsample_time: 4 s\ninputs: {u: {}}\ntargets: {z: {}}\n"
        "parameters: {k: 0.5}\nstates: {x: {next: 0.9 * x + k * u, init: 0}}\n"
        "outputs: {y: {expr: x, predicts: 'z[t]'}}\n"
        f"estimator: {{ekf: {{measured: {{y: 0.1}}, {deviations}}}}}\n"
        f"export: {{mpc: {{dtype: {dtype}}}}}\n"
    )
    findings = Findings()
    plans = plan_exports(load_model(spec), ["mpc"], findings)
    assert [found.code for found in findings.in_order] == ([] if named is None else ["E1117"])
    assert (plans == []) == (named is not None)
    assert named is None or named in findings.in_order[0].message


def test_what_is_no_target_is_an_error() -> None:
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


@pytest.mark.parametrize("target", ["c", "fmu"])
def test_a_weight_that_float32_does_not_hold_is_refused(target: str, tmp_path: Path) -> None:
    spec = tmp_path / "large.msnn.yaml"
    spec.write_text(
        "msnn: 1\nname: large\nsample_time: 0.1 s\ninputs: {u: {}}\n"
        "parameters: {k: 1.0e39, m: 3.4e38}\noutputs: {y: m * u + k * u}\n"
    )
    (plan,) = plans_of(spec, target)
    with pytest.raises(SpecError) as refused:
        write_export(plan, initial_weights(plan.program), tmp_path / "out")
    (fault,) = refused.value.diagnostics
    assert fault.code == "E1134"
    assert "`k` is 1e+39" in fault.message
    assert not (tmp_path / "out").exists()
    spec.write_text(spec.read_text() + f"export: {{{target}: {{dtype: float64}}}}\n")
    (plan,) = plans_of(spec, target)
    assert write_export(plan, initial_weights(plan.program), tmp_path / "out").files


def plans_of(spec: Path, target: str) -> Sequence[AnyPlan]:
    model, findings = load_model(spec), Findings()
    plans = plan_exports(model, (target,), findings)
    assert not findings.in_order
    return plans
