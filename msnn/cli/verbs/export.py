"""`msnn export`: writes a model as C, FMU, ONNX, CasADi and torch, and compares what it wrote."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from msnn.cli.arguments import (
    RUNS,
    DataRoot,
    Initial,
    OutputFormat,
    ResultFormat,
    RunsFolder,
    Settings,
    SpecFile,
    WeightsFile,
    refuse_two_origins,
    words_of,
)
from msnn.cli.exit_codes import ExitCode
from msnn.exports.table import EXTRAS, TARGETS, every_target, names_for


def export(
    spec: SpecFile,
    to: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TARGET,…",
            help="c, fmu, mpc, onnx, casadi, torch or all; default: those of the spec's `export:`, "
            "else all.",
        ),
    ] = None,
    extra: Annotated[
        list[str] | None,
        typer.Option(
            "--with",
            metavar="EXTRA,…",
            help="What is generated besides, with those of the spec's `with:`: "
            + "; ".join(
                f"{', '.join(target.extras)} of {target.title}"
                for target in TARGETS
                if target.extras
            )
            + ".",
        ),
    ] = None,
    weights: WeightsFile = None,
    initial: Initial = False,
    runs: RunsFolder = RUNS,
    out: Annotated[
        Path, typer.Option("-o", "--out", metavar="FOLDER", help="Each target has a folder in it.")
    ] = Path("build/export"),
    check: Annotated[
        bool, typer.Option("--check", help="Run every target and compare it with the interpreter.")
    ] = False,
    data_root: DataRoot = None,
    settings: Settings = None,
    format: OutputFormat = ResultFormat.TEXT,
) -> None:
    """Write C, FMU, controllers, ONNX, CasADi and torch.

    Each target is written to a folder of its own, as the spec's `export` section says. With
    --check, exit code 3 if one of them computes other values than the interpreter.
    """
    from msnn.cli.console import json_result, note, report, report_model, result
    from msnn.exports.describe import left_out
    from msnn.exports.export import plan_exports, writable_targets, write_export
    from msnn.exports.target import AnyPlan, Written
    from msnn.model.load import load_model
    from msnn.model.model_weights import choose_weights
    from msnn.tables import count
    from spec_schema.diagnostics.diagnostic import Findings, SpecError
    from spec_schema.plugins import look_up

    refuse_two_origins(weights, initial)
    names = words_of(to)
    known = names_for(names)
    if not {*known, "all"}.issuperset(names):
        report(look_up().warnings, ())
    _refuse_unknown(names, (*known, "all"), "--to")
    extras = words_of(extra)
    if not {*EXTRAS}.issuperset(extras):
        look_up()
    every = every_target()
    _refuse_unknown(extras, [name for target in every for name in target.extras], "--with")
    model = load_model(spec, settings or ())
    report_model(model)
    findings = Findings()
    targets, missing = writable_targets(names, model.spec.export, sections=model.problems)
    for target in missing:
        note(target.left_out)
    for name in extras:
        having = [target.name for target in every if name in target.extras]
        if not set(having) & set(targets):
            message = f"of all targets only {' and '.join(having)} has `{name}`, and it is not "
            raise typer.BadParameter(f"{message}among those to be written", param_hint="'--with'")
    # planned without weights first: a spec that no target can take is told of before a missing
    # training is
    plan_exports(model, targets, findings, extras)
    # all targets at once: who has three of them wrong mends them in one go
    if findings.failed:
        raise SpecError(findings.in_order, model.sources)
    report(findings.in_order, model.sources)
    chosen = choose_weights(model, weights, runs, initial=initial)
    # again with them: slices that a penalty took to 0 are left out of what is written. What was
    # found is told already
    plans = plan_exports(model, targets, Findings(), extras, chosen.weights)
    report(chosen.warnings, model.sources)
    note(f"weights: {chosen.origin}")
    exports: list[tuple[AnyPlan, Written]] = []
    # a target that cannot be written keeps no other from being written and compared
    failures: list[Exception] = []
    for plan in plans:
        target = plan.target
        try:
            written = write_export(plan, chosen.weights, out / target.name)
        except SpecError as error:
            # a target knows no texts of the spec: with them the message shows its line
            failures.append(SpecError(error.diagnostics, model.sources))
            continue
        except Exception as error:  # noqa: BLE001  (raised again once the others are there)
            failures.append(error)
            continue
        exports.append((plan, written))
        if format is ResultFormat.TEXT:
            result(f"{target.name}: {count(len(written.files), 'file')} in {written.folder}")
            if said := left_out(plan):
                result(said)
            if said := target.tell(plan, written.folder):
                result(said)
    record: dict[str, Any] = {
        "files": {plan.target.name: [str(p) for p in to.files] for plan, to in exports}
    }
    found = None
    if check and exports:
        from msnn.agreement.report import (
            agreement_diagnostics,
            agreement_table,
            agreement_values,
        )
        from msnn.exports.check import check_exports

        found = check_exports(model, exports, chosen.weights, data_root or model.folder)
        record["agreement"] = agreement_values(found)
        if format is ResultFormat.TEXT:
            result(f"\n{agreement_table(found)}")
        report(agreement_diagnostics(found), ())
    if format is ResultFormat.JSON:
        json_result("export", record)
    if found is not None and found.first_error is not None:
        failures.append(found.first_error)
    if failures:
        # the first alone, as a command has one end; the others come up when it is run again
        raise failures[0]
    # not compared outweighs compared and unlike only in the code: the table has told both by now
    if found is not None and found.missing:
        report([error.diagnostic for error in found.missing], ())
        raise typer.Exit(ExitCode.MISSING_EXTRA)
    if found is not None and not found.agrees:
        raise typer.Exit(ExitCode.LIMIT_BROKEN)


def _refuse_unknown(names: Sequence[str], known: Sequence[str], option: str) -> None:
    """Raises BadParameter for the first word of an option that is not known."""
    for name in names:
        if name not in known:
            message = f"`{name}` is none of {', '.join(known)}"
            raise typer.BadParameter(message, param_hint=f"'{option}'")
