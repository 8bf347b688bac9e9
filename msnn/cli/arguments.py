"""Arguments shared by several commands."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from msnn.cli.output_options import NOW

SpecFile: TypeAlias = Annotated[
    Path,
    typer.Argument(
        metavar="SPEC",
        help="A spec (.yaml, .json), what `msnn compile` wrote, or the folder of a run.",
    ),
]


# refused while words are read, as a mistake of the command line (exit 2), before any file is opened
def _wants_value(settings: list[str] | None) -> list[str] | None:
    for setting in settings or ():
        path, equals, _ = setting.partition("=")
        if not path.strip() or not equals:
            message = f"`{setting}` is not a path, `=` and a value, such as `train.0.epochs=5`"
            raise typer.BadParameter(message)
    return settings


WeightsFile: TypeAlias = Annotated[
    Path | None,
    typer.Option("--weights", metavar="FILE", help="Weights; default: those of the last training."),
]

Initial: TypeAlias = Annotated[
    bool,
    typer.Option("--initial", help="Take the initial values of the spec instead of weights."),
]

RunsFolder: TypeAlias = Annotated[
    Path,
    typer.Option("--runs", metavar="FOLDER", help="Where trainings are kept."),
]

DataRoot: TypeAlias = Annotated[
    Path | None,
    typer.Option("--data-root", metavar="FOLDER", help="Data paths start here, not at the spec."),
]

Settings: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Replace a value of the spec: train.0.epochs=5, parameters.k.init=2.",
        callback=_wants_value,
    ),
]

OldSettings: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--set-old",
        metavar="KEY=VALUE",
        help="Replace a value of OLD alone.",
        callback=_wants_value,
    ),
]

NewSettings: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--set-new",
        metavar="KEY=VALUE",
        help="Replace a value of NEW alone.",
        callback=_wants_value,
    ),
]


def words_of(texts: Sequence[str] | None) -> list[str]:
    """The words of an option that takes several, separated by commas or given by repeating the
    option; empty for None.
    """
    return [word.strip() for text in texts or () for word in text.split(",") if word.strip()]


def refuse_two_origins(weights: Path | None, initial: bool) -> None:
    """Raises BadParameter if both a weights file and the initial values are requested."""
    if weights is not None and initial:
        message = "takes other weights than `--weights`: give one of the two"
        raise typer.BadParameter(message, param_hint="'--initial'")


PlotFile: TypeAlias = Annotated[
    Path | None,
    typer.Option("--plot", metavar="FILE", help="Also draw it: .png, .svg or .pdf."),
]


def refuse_undrawable(plot: Path | None) -> None:
    """Raises BadParameter for an unknown plot format, MissingExtraError without matplotlib. Does
    nothing without a plot.
    """
    if plot is None:
        return
    from msnn.reports.plotting import FORMATS, require_plotting

    if plot.suffix.removeprefix(".") not in FORMATS:
        message = f"`{plot}` does not end with one of .{', .'.join(FORMATS)}"
        raise typer.BadParameter(message, param_hint="'--plot'")
    require_plotting()


# of trainings alone: simulations also run on exports, whose names `known_engine` checks with a hint
class EngineName(StrEnum):
    """The engine that computes a training stage."""

    AUTO = "auto"
    NATIVE = "native"
    TORCH = "torch"


RolloutEngine: TypeAlias = Annotated[
    str,
    typer.Option(
        "--engine",
        metavar="auto|interpreter|native|torch|onnx|casadi|c|fmu",
        help="What simulates, also an export; auto: native kernels where they save time.",
    ),
]


EVERY_ENGINE = "all"
"""For `validate`: evaluates with every engine and compares them."""

ValidationEngine: TypeAlias = Annotated[
    str,
    typer.Option(
        "--engine",
        metavar="auto|interpreter|native|torch|onnx|casadi|c|fmu|all",
        help="What simulates, also an export; auto: native kernels where they save time; all: each "
        "of them, with one table of how they agree.",
    ),
]


class ResultFormat(StrEnum):
    """The format in which a result and messages are printed."""

    TEXT = "text"
    JSON = "json"
    GITHUB = "github"
    SARIF = "sarif"


def tell_messages(format: StrEnum) -> StrEnum:
    """Sets the format of messages from `--format`, and returns it. `text` and `json` only affect
    the result.
    """
    match format.value:
        # `text` and `json` say how the result looks; messages stay in full on stderr beside both
        case "concise" | "github" | "sarif" as chosen:
            NOW.messages = chosen
        case _:
            pass
    return format


OutputFormat: TypeAlias = Annotated[
    ResultFormat,
    typer.Option(
        "--format",
        help="The result as text or as JSON; github: messages as annotations; sarif: one log of "
        "messages alone.",
        callback=tell_messages,
    ),
]

SummaryFile: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--summary", metavar="FILE", help="Also append tables in Markdown: $GITHUB_STEP_SUMMARY."
    ),
]

RUNS = Path("runs")

Grid: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--grid",
        metavar="KEY=V1,V2,...",
        help="Every choice of a value of a spec; several span a grid.",
    ),
]

Seeds: TypeAlias = Annotated[
    int, typer.Option(min=1, help="Train each so often, from other initial values and orders.")
]

Folds: TypeAlias = Annotated[
    bool, typer.Option("--folds", help="Train every fold of `split: {by: kfold, k}`.")
]

HeldOut: TypeAlias = Annotated[
    str, typer.Option(metavar="SET", help="The rows held out that they are compared on.")
]

RankedBy: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="METRIC",
        help="What ranks them: fit, y.fit, y.rmse:record; default: the first of `validate`.",
    ),
]

CountsCost: TypeAlias = Annotated[
    bool, typer.Option("--cost/--no-cost", help="Count instructions and bytes of the C.")
]

Jobs: TypeAlias = Annotated[
    int | None, typer.Option(min=1, help="Trainings at once; default: one a processor.")
]

ComparedRuns: TypeAlias = Annotated[
    Path,
    typer.Option("-o", "--out", metavar="FOLDER", help="Trainings are kept below, with a log."),
]
