"""Formats a verification: tables for the terminal, REPORT.md, and JSON values."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

from msnn.tables import table_text
from msnn.verification.proof.trace import by_spec_line, traced
from msnn.verification.proof_step import Figures, Result, Verdict
from msnn.verification.verify import Verification

_CHECKS = ("check", "target", "", "detail")
_FIGURES = (
    "target",
    "instructions min",
    "median",
    "mean",
    "max",
    "flash",
    "data",
    "bss",
    "stack painted",
    "stack bound",
)
_VERDICTS: dict[Verdict, str] = {
    "ok": "ok",
    "found": "FOUND",
    "missing": "MISSING",
    "left out": "left out",
    "not done": "NOT DONE",
}
_LEGEND = (
    "Instructions of one call, counted in QEMU: not cycles. Flash, .data and .bss in bytes: a "
    "linked program less the same one without the model. Stack in bytes: painted words that a "
    "call overwrote, and the bound from the call graph (none where a library routine's is unknown)."
)


def verification_text(verification: Verification) -> str:
    """Tables of results and measurements, then all findings."""
    parts = [table_text(_CHECKS, [_check_row(result) for result in verification.results])]
    figures = list(_figure_rows(verification))
    if figures:
        parts.append(table_text(_FIGURES, figures, numbers=range(1, len(_FIGURES))))
        parts.append(_LEGEND)
    parts += [_listed(result) for result in verification.results if result.findings]
    return "\n\n".join(parts)


def verification_markdown(verification: Verification) -> str:
    """The same results and measurements as a Markdown page, `REPORT.md`."""
    parts = [
        f"# Verification of `{verification.model.prefix}`",
        _markdown(_CHECKS, [_check_row(result) for result in verification.results]),
    ]
    figures = list(_figure_rows(verification))
    if figures:
        parts += ["## Figures", _markdown(_FIGURES, figures), _LEGEND]
    for result in verification.results:
        lines = [*result.findings, *result.notes]
        if lines:
            # a backtick would end the code that the line is shown as
            listed = "\n".join(f"- `{line.replace('`', chr(39))}`" for line in lines)
            parts += [f"## {result.check}, {result.target}", listed]
    parts += _trace_parts(verification)
    if verification.missing:
        parts.append(f"Missing tools: `{verification.install_line}`")
    return "\n\n".join(parts) + "\n"


def verification_values(verification: Verification) -> dict[str, Any]:
    """The results as JSON values."""
    return {
        "model": verification.model.prefix,
        "results": [asdict(result) for result in verification.results],
        "found": verification.found,
        "undone": verification.undone,
        "install": verification.install_line if verification.missing else None,
    }


def _check_row(result: Result) -> tuple[str, ...]:
    return result.check, result.target, _VERDICTS[result.verdict], result.detail


def _figure_rows(verification: Verification) -> Iterator[tuple[str, ...]]:
    for result in verification.results:
        for figures in result.figures:
            yield f"{result.target} {figures.of}".strip(), *_figure_cells(figures)


def _figure_cells(figures: Figures) -> tuple[str, ...]:
    least, mean, most = figures.instructions
    return (
        str(least),
        f"{figures.median:.1f}",
        f"{mean:.1f}",
        str(most),
        str(figures.flash),
        str(figures.data),
        str(figures.bss),
        str(figures.stack_painted),
        "" if figures.stack_bound is None else str(figures.stack_bound),
    )


def _trace_parts(verification: Verification) -> list[str]:
    """The lines of C for each line of the spec, and vice versa."""
    blocks = traced(verification.model.sources)
    if not blocks:
        return []
    backward = [(block.lines, block.place, block.name) for block in blocks]
    return [
        "## From the spec to C",
        _markdown(("spec", "computes", "C"), by_spec_line(blocks)),
        "## From C to the spec",
        _markdown(("C", "spec", "computes"), backward),
    ]


def _listed(result: Result) -> str:
    return "\n".join([f"{result.check}, {result.target}:", *(f"  {f}" for f in result.findings)])


def _markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(cell.replace('|', '/') for cell in row)} |" for row in lines)
