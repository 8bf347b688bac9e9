"""`msnn export`: writes a model as C, ONNX, CasADi and torch, and compares what it wrote."""

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
)
from msnn.cli.exit_codes import ExitCode


def export(
    spec: SpecFile,
    to: Annotated[
        str,
        typer.Option(
            metavar="TARGET,…",
            help="c, onnx, casadi, torch or all; default: those of the spec's `export:`, else all.",
        ),
    ] = "",
    extra: Annotated[
        str,
        typer.Option(
            "--with",
            metavar="EXTRA,…",
            help="jacobian, state_jacobian, parameter_jacobian: what C has beside the step "
            "and the spec's `with:`.",
        ),
    ] = "",
    weights: WeightsFile = None,
    initial: Initial = False,
    runs: RunsFolder = RUNS,
    out: Annotated[
        Path, typer.Option("--out", metavar="FOLDER", help="Each target has a folder in it.")
    ] = Path("build/export"),
    check: Annotated[
        bool, typer.Option("--check", help="Run every target and compare it with the interpreter.")
    ] = False,
    data_root: DataRoot = None,
    settings: Settings = None,
    format: OutputFormat = ResultFormat.TEXT,
) -> None:
    """Write C, ONNX, CasADi and torch.

    Each target into a folder of its own, as the spec's `export` section says. With --check exit
    code 3 when one of them computes something else than the interpreter.
    """
    from msnn.cli.console import json_result, note, report, result
    from msnn.exports.export import EXTRAS, TARGETS, plan_exports, target_names, write_export
    from msnn.exports.fixed_point import error_table
    from msnn.model.load import load_model
    from msnn.model.model_weights import choose_weights
    from msnn.tables import count
    from spec_schema.diagnostics.diagnostic import Findings, SpecError

    refuse_two_origins(weights, initial)
    names = _listed(to, (*TARGETS, "all"), "--to")
    extras = _listed(extra, EXTRAS, "--with")
    model = load_model(spec, settings or ())
    report(model.warnings, model.sources)
    findings = Findings()
    targets = target_names(names, model.spec.export)
    if extras and "c" not in targets:
        message = "of all targets only c has extras, and it is not among those to be written"
        raise typer.BadParameter(message, param_hint="'--with'")
    plans = plan_exports(model, targets, findings, extras)
    if findings.failed:
        raise SpecError(findings.in_order, model.sources)
    report(findings.in_order, model.sources)
    chosen = choose_weights(model, weights, runs, initial=initial)
    report(chosen.warnings, model.sources)
    note(f"weights: {chosen.origin}")
    written: dict[str, tuple[Path, Sequence[Path]]] = {}
    for plan in plans:
        folder = out / plan.target
        try:
            paths = write_export(plan, chosen.weights, folder)
        except SpecError as error:
            raise SpecError(error.diagnostics, model.sources) from None
        written[plan.target] = folder, paths
        if format is ResultFormat.TEXT:
            result(f"{plan.target}: {count(len(paths), 'file')} in {folder}")
            if plan.fixed_point is not None:
                result(error_table(folder, plan.prefix))
    record: dict[str, Any] = {"files": {t: [str(p) for p in ps] for t, (_, ps) in written.items()}}
    found = None
    if check:
        from msnn.agreement.report import (
            agreement_diagnostics,
            agreement_table,
            agreement_values,
            check_exports,
        )

        found = check_exports(model, plans, chosen.weights, written, data_root or model.folder)
        record["agreement"] = agreement_values(found)
        if format is ResultFormat.TEXT:
            result(f"\n{agreement_table(found)}")
        report(agreement_diagnostics(found), ())
    if format is ResultFormat.JSON:
        json_result("export", record)
    if found is not None and found.first_error is not None:
        raise found.first_error
    if found is not None and found.missing:
        report([error.diagnostic for error in found.missing], ())
        raise typer.Exit(ExitCode.MISSING_EXTRA)
    if found is not None and not found.agrees:
        raise typer.Exit(ExitCode.LIMIT_BROKEN)


def _listed(text: str, known: Sequence[str], option: str) -> list[str]:
    """The words of an option that takes several, each of them known."""
    names = [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        if name not in known:
            message = f"`{name}` is none of {', '.join(known)}"
            raise typer.BadParameter(message, param_hint=f"'{option}'")
    return names
