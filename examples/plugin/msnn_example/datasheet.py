"""The target `datasheet`: inputs, outputs and trained parameters of a model in Markdown."""

from pathlib import Path
from typing import ClassVar

from msnn.extending import ExportPlan, FloatTargetEntry, Request, Target, Weights, float_plan


class DatasheetExport(FloatTargetEntry):
    """A data sheet."""

    noun: ClassVar[str] = "the data sheet"


def _prepare(request: Request, entry: DatasheetExport | None) -> ExportPlan[None] | None:
    return float_plan(TARGET, request, entry)


def _write(plan: ExportPlan[None], weights: Weights, folder: Path) -> tuple[Path, ...]:
    program = plan.program
    lines = [f"# {program.name}", "", program.doc, "", f"Made by {program.made_by}.", ""]
    lines += ["| input | unit | about |", "|---|---|---|"]
    lines += [
        f"| {signal.name} | {signal.unit.text if signal.unit else ''} | {signal.doc} |"
        for signal in program.signals
    ]
    lines += ["", "| parameter | values |", "|---|---|"]
    lines += [f"| {p.name} | {weights[p.name].tolist()} |" for p in program.parameters]
    file = folder / f"{plan.prefix}.md"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return (file,)


TARGET: Target[DatasheetExport, None] = Target(
    name="datasheet",
    entry=DatasheetExport,
    dtype="float64",
    options=None,
    prepare=_prepare,
    write=_write,
)
