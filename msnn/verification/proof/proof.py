"""Proves by abstract interpretation that a step has no run-time errors for all declared values.

Frama-C's Eva analyses one step from any state within the ranges of the spec and any ring-buffer
position, with any input. Inputs are within their ranges if the policy only flags violations; with
`clamp` or `hold` they may have any value, including infinity. A float that may become infinite or
NaN, an overflowing conversion and an index out of bounds are alarms. The project's math functions
are replaced by bounds (`assumptions`).

The proof of one step holds for all steps if the resulting state is within the assumed states; the
report states this for each state. See decision 0185.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from msnn.verification.exported_c import ExportedC
from msnn.verification.harness import write_harness
from msnn.verification.proof.assumptions import (
    ASSUMED,
    REPLACED,
    assumed_range,
    drawn,
    kernel_bounds,
    outside_ranges,
    shown,
)
from msnn.verification.proof.eva import (
    PRECISION,
    Alarm,
    Analysis,
    PossibleValues,
    analysed,
    roots_first,
)
from msnn.verification.proof.trace import place_of, traced
from msnn.verification.proof_step import FRAMA_C, ProofStep, Result


def proof_checks(model: ExportedC) -> Iterator[ProofStep]:
    """The proofs of a C export: one of the step, and one of the Jacobian if there is one."""
    yield _check("step", model)
    if model.linearizes:
        yield _check("linearize", model)


def _check(function: str, model: ExportedC) -> ProofStep:
    def run(folder: Path) -> Result:
        if model.fixed_point:
            detail = "the export proved the bounds of every integer; Eva is asked about floats only"
            return Result(check=check.name, target=check.target, verdict="left out", detail=detail)
        if model.constant_time:
            detail = (
                "not proved: constant-time code takes one of two values from an array, and "
                "intervals do not follow which; prove the export without constant_time, which has "
                "the same bits"
            )
            return Result(check=check.name, target=check.target, verdict="not done", detail=detail)
        return _proved(check, function, model, folder)

    check = ProofStep("proof", function, (FRAMA_C,), run)
    return check


def _proved(check: ProofStep, function: str, model: ExportedC, folder: Path) -> Result:
    results = model.outputs if function == "step" else model.slopes
    # counters and heads of rings are integers, which have alarms of their own
    reals = [("result", m) for m in results if not m.unsigned]
    if function == "step":
        reals += [("left", m) for m in model.state if not m.unsigned]
    # two analyses: one that lets infinities in can no longer tell them from those that a step makes
    runs = [_analysed(function, model, folder, infinite=False)]
    replaced = [member.name for member in model.inputs if member.policy in REPLACED]
    if replaced:
        runs.append(_analysed(function, model, folder, infinite=True))
    alarms = dict.fromkeys(alarm for run in runs for alarm in run.alarms)
    # one bad value raises alarms wherever it goes; where it arises is what the reader can mend
    ordered = roots_first(list(alarms), model.folder / "src")
    findings = [_shown_alarm(alarm, model) for alarm in ordered]
    found = [(kind, m, _joined(runs, f"{kind}_{m.field}")) for kind, m in reals]
    # values are shown after the call: there are none where every path ends at an alarm before
    if any(values is None for *_, values in found):
        findings.append("no call comes to its end")
    notes: list[str] = []
    for kind, member, values in found:
        if values is not None and not values.finite:
            after = "" if kind == "result" else " after a step"
            findings.append(f"{member.name} may be NaN or infinite{after}: {_interval(values)}")
        elif values is not None and function == "step" and kind == "result":
            notes.append(f"proved {member.name} in {_interval(values)}")
    detail = f"{len(findings)} alarms, Eva at precision {PRECISION}"
    if function == "step":
        kept, said = _inductive(model, runs)
        notes += said
        detail += f"; {kept} of {len(said)} states stay in the range assumed" if said else ""
    # a proof is worth what it assumes: bounds that nobody declared are said beside the result
    assumed = [m.name for m in (*model.state, *model.inputs) if not m.unsigned and not m.range]
    notes += [f"assumed |{name}| <= {ASSUMED:g}: the spec has no range" for name in assumed]
    if replaced:
        notes.append(f"any number and infinities taken at {', '.join(replaced)}")
        notes.append(
            "not proved: NaN there, as Eva does not follow comparisons with it; "
            "golden vectors and the fuzzer give it"
        )
    return check.of(findings, detail, notes=notes)


def _analysed(function: str, model: ExportedC, folder: Path, *, infinite: bool) -> Analysis:
    lines = [*drawn("s", model.state, model), *drawn("u", model.inputs, model)]
    lines += outside_ranges(model, infinite=infinite)
    results = ("y", model.outputs) if function == "step" else ("jac", model.slopes)
    begun = shown("begun", "begun", model.state)
    left = [*shown("result", *results), *shown("left", "s", model.state)]
    main = write_harness(
        "eva_main.c",
        model,
        folder,
        function=function,
        values=lines,
        begun=list(begun),
        shown=left,
        kernels=kernel_bounds(model),
    )
    return analysed(model, main, infinite=infinite, folder=folder)


def _inductive(model: ExportedC, runs: list[Analysis]) -> tuple[int, list[str]]:
    """The number of states that stay within the assumed range, and a sentence about each state."""
    said: list[str] = []
    kept = 0
    for member in model.state:
        if member.unsigned:
            continue
        low, high = assumed_range(member, model)
        assumed = f"{low:.6g} .. {high:.6g}"
        next = _joined(runs, f"left_{member.field}")
        begun = _joined(runs, f"begun_{member.field}")
        name = member.name
        if next is None or begun is None:
            said.append(f"inductive: no: {name}: no call comes to its end")
        # induction: the range holds after init and every step keeps it, so that it holds for ever
        elif not _within(next, low, high):
            said.append(f"inductive: no: a step takes {name} from {assumed} to {_interval(next)}")
        elif not _within(begun, low, high):
            said.append(f"inductive: no: init sets {name} to {_interval(begun)}, not in {assumed}")
        else:
            said.append(f"inductive: yes: {name} stays in {assumed}")
            kept += 1
    return kept, said


def _within(values: PossibleValues, low: float, high: float) -> bool:
    return not values.nan and low <= values.low and values.high <= high


def _interval(values: PossibleValues) -> str:
    nan = " or NaN" if values.nan else ""
    return (
        # -0 + 0 is 0: a bound is never shown as -0
        f"{values.low + 0.0:.6g} .. {values.high + 0.0:.6g}{nan}"
        if values.low <= values.high
        else "NaN"
    )


def _joined(runs: list[Analysis], name: str) -> PossibleValues | None:
    """The union of the values of all runs; None if a run never reaches the place."""
    found: PossibleValues | None = None
    for run in runs:
        values = run.values.get(name)
        if values is None:
            return None
        found = values if found is None else found.joined(values)
    return found


def _shown_alarm(alarm: Alarm, model: ExportedC) -> str:
    source = model.folder / "src" / alarm.file
    place = place_of(traced((source,)), alarm.file, alarm.line) if source.is_file() else None
    return f"{alarm.file}:{alarm.line}: {alarm.claim}" + (f" (spec {place})" if place else "")
