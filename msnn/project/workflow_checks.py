"""Checks the workflow: do data, train, validate and export fit the model?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from msnn.data.formats.table_of_formats import format_of, warnings_of_plugins
from msnn.data.reading.file_sets import file_sections
from msnn.errors import workflow as errors
from msnn.errors.data import rows as data_formats
from msnn.model.load import load_model
from msnn.model.model import Model
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError
from spec_schema.sections.data import Column, Data
from spec_schema.sections.spec import Spec

# as where columns are read; that file is not opened here, for `check` is to start light
_LOG_SUFFIX = ".meas"


def checked_model(
    path: str | Path,
    settings: Sequence[str] = (),
    *,
    strict_units: bool = False,
    text: str | None = None,
    unsaved: Mapping[str, str] | None = None,
) -> Model:
    """The model in a file, or in `text` with that path, with all findings of `msnn check`.

    `unsaved` maps real paths of other specs to texts that replace their files. Raises SpecError if
    there is an error. Its `warnings` include those of reading, compiling and the workflow, and
    remarks.
    """
    model = load_model(path, settings, strict_units=strict_units, text=text, unsaved=unsaved)
    diagnostics = (*model.warnings, *model.remarks, *check_workflow(model))
    # all that is wrong at once, warnings too: they often are the reason
    if any(diagnostic.severity == "error" for diagnostic in diagnostics):
        raise SpecError(diagnostics, model.sources)
    return replace(model, warnings=diagnostics)


def check_workflow(model: Model) -> tuple[Diagnostic, ...]:
    """All findings in the sections that train, validate and export the model.

    No data are read and nothing is written. Stages, metrics and exports are planned as they would
    run, so that missing names are found here. The planner of a section is imported only if the spec
    has it.
    """
    findings = Findings()
    spec = model.spec
    if spec.train:
        from msnn.training.plans.stage_plan import fixed_starts, plan_stages

        for plan in plan_stages(model.program, spec.train, findings):
            if plan.rollout.horizon != "record":  # data of one rollout a record silence training
                findings.report(*fixed_starts(plan))
    if spec.checks:
        from msnn.validation.plan import plan_checks

        # planned for what it reports
        plan_checks(model.program, spec.checks, findings)
    sections = [*([] if spec.data is None else [spec.data]), *file_sections(spec).values()]
    _columns(model, sections, findings)
    for section in sections:
        _readers(section, findings)
        _filters(spec, section, findings)
    if spec.data is not None:
        _sets(model, spec.data, findings)
    else:
        measured = [check for check in spec.checks if check.files is None]
        for name, entries in (("train", spec.train), ("validate", measured)):
            if entries:
                findings.report(errors.needless_data(name, entries[0].place.key))
    if spec.export is not None:
        from msnn.exports.export import plan_exports, target_names

        # the targets of the spec: an entry that nobody exports yet is checked, too
        names = target_names((), spec.export, sections=model.problems)
        for plan in plan_exports(model, names, findings):
            findings.report(*plan.target.faults(plan))
    return findings.in_order


def _columns(model: Model, sections: Sequence[Data], findings: Findings) -> None:
    spec = model.spec
    # an input that nothing reads is no signal of the program any more, and yet no mistake here
    known = tuple(dict.fromkeys((*spec.inputs, *spec.targets, *spec.states)))
    named: list[Mapping[str, Column]] = [] if spec.data is None else [spec.data.columns]
    named += [source.columns for data in sections for source in data.source.values()]
    for columns in named:
        for name, column in columns.items():
            if name.removesuffix(_LOG_SUFFIX) not in known:
                findings.report(
                    errors.unknown_signal(name, column.place.key, known, _column_of(column))
                )


def _column_of(column: Column) -> str | None:
    """The only column that feeds a signal, as the spec names it."""
    keys = column.column
    return str(keys[0].column) if len(keys) == 1 else None


def _readers(data: Data, findings: Findings) -> None:
    """Reports formats that cannot be read here, before any slow operation."""
    for source in data.source.values():
        for pattern in source.files:
            kind = format_of(pattern.value)
            findings.report(*warnings_of_plugins(pattern.value))
            if kind.missing:
                names = " and ".join(package.name for package in kind.missing)
                what, install = f"{kind.name} files need {names}", kind.missing[0].install
                findings.report(data_formats.missing_reader(what, install, pattern.span))


def _filters(spec: Spec, data: Data, findings: Findings) -> None:
    if data.filter is None and all(source.filter is None for source in data.source.values()):
        return
    from msnn.data.reading.row_filter import row_filters

    try:
        row_filters(spec.model_copy(update={"data": data}))
    except SpecError as error:
        findings.report(*error.diagnostics)


def _sets(model: Model, data: Data, findings: Findings) -> None:
    known = data.sets
    for check in model.spec.checks:
        if check.data is not None and check.data.value not in known:
            findings.report(errors.unknown_set(check.data.value, check.data.span, known))
    if model.spec.train and "train" not in known:
        findings.report(errors.unknown_set("train", model.spec.train[0].place.key, known))
