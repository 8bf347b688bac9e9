"""Shows a comparison: progress, table, JSON values, and a plot of accuracy against cost."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any, TextIO

from msnn.features.comparison.compare import Comparison
from msnn.features.comparison.ranking import Criterion, Ranked, cheapest_as_good
from msnn.features.comparison.trial import Trial, TrialOutcome
from msnn.reports.plotting import COLORS, new_figure, saved_figure
from msnn.tables import Table
from spec_schema.diagnostics.source import printable


def comparison_table(found: Comparison, most: int | None = None) -> str:
    """The ranking as text in columns; `most` limits the rows as in `comparison_cells`."""
    return comparison_cells(found, most).text


def comparison_cells(found: Comparison, most: int | None = None) -> Table:
    """The ranking with one row per model, the most accurate first; empty columns are omitted.

    With `most`, only that many rows, and those of the Pareto front and of failed trainings.
    """
    others = _others(found)
    shown = (
        entry
        for place, entry in enumerate(found.entries)
        # what failed is listed whatever its place: it is what has to be acted on
        if most is None or place < most or entry.is_on_front or entry.failed
    )
    rows = [_row(entry, found, others) for entry in shown]
    core = next((line.cost.core for e in found.entries for line in e.lines if line.cost), "")
    header = (
        "model",
        found.criterion.heading,
        "±",
        "in training",
        *(each.heading for each in others),
        "AIC/n",
        "BIC/n",
        "numbers",
        "training",
        f"instructions, {core}",
        "flash",
        "",
    )
    return Table(header, rows, numbers=range(1, len(header) - 1))


def comparison_notes(found: Comparison) -> list[str]:
    """Sentences below the table: folder of the best model, the cheapest model that is as good,
    different scored rows, missing tools.
    """
    notes: list[str] = []
    best = found.best
    if best is not None and best.lines[0].folder is not None and found.folder is not None:
        notes.append(f"the best is kept in {found.folder / best.lines[0].folder}")
    cheaper = cheapest_as_good(found.entries, found.criterion)
    if cheaper is not None:
        notes.append(f"within one standard error of it, and the cheapest: {cheaper.variant.label}")
    scored = {
        # the same fold and way with another count: start rows that a window needs are not scored
        (line.fold, *m.way, m.scored)
        for e in found.entries
        for line in e.lines
        for m in line.training
    }
    if len(scored) > len({each[:-1] for each in scored}):
        notes.append("windows differ, and so do the rows that are scored at the start of records")
    if found.uncounted:
        notes.append(
            "instructions were not counted; this installs what counts them: apt-get install "
            + " ".join(found.uncounted)
        )
    return notes


def comparison_record(found: Comparison) -> dict[str, Any]:
    """The comparison as a JSON object with every training; unknown numbers are NaN."""
    drawn = {axis.path: str(axis.law) for axis in found.draws.axes}
    return {
        "draws": {"seed": found.draws.seed, "count": found.draws.count, "keys": drawn}
        if drawn
        else None,
        "criterion": found.criterion.heading,
        "higher_is_better": found.criterion.is_higher_better,
        "models": [
            {
                "model": entry.variant.label,
                "spec": str(entry.variant.spec),
                "settings": list(entry.variant.settings),
                "score": entry.score,
                "deviation": entry.deviation,
                "training_score": entry.training_score,
                "aic_per_value": entry.information(found.criterion.way)[0],
                "bic_per_value": entry.information(found.criterion.way)[1],
                "numbers": entry.parameters,
                "seconds": entry.seconds,
                "instructions": entry.instructions,
                "flash": entry.flash,
                "best": entry.is_best,
                "front": entry.is_on_front,
                "runs": [
                    {
                        "seed": line.seed,
                        "fold": line.fold,
                        "score": score,
                        "seconds": line.seconds,
                        "folder": line.folder,
                    }
                    for line, score in zip(entry.lines, entry.scores, strict=True)
                ],
                "failed": [
                    {"seed": line.seed, "fold": line.fold, "state": line.state, "why": line.reason}
                    for line in entry.failed
                ],
            }
            for entry in found.entries
        ],
    }


def _others(found: Comparison) -> list[Criterion]:
    """The criteria of further columns of the table: the fit of the ranked output, and for each
    other common measurement the metric that its spec requests first.
    """
    shown: list[Criterion] = []
    lines = [line for entry in found.entries for line in entry.lines]
    for way in found.ways:
        asked = next(each for each in lines[0].held_out if each.way == way)
        wanted = [asked.asked]
        if way == found.criterion.way and "fit" in asked.metrics:
            wanted.append("fit")
        shown += [Criterion(way, metric) for metric in wanted]
    return [each for each in dict.fromkeys(shown) if each != found.criterion]


def _row(entry: Ranked, found: Comparison, others: list[Criterion]) -> tuple[str, ...]:
    aic, bic = entry.information(found.criterion.way)
    means = [
        sum(each.of(line.held_out) for line in entry.lines) / len(entry.lines)
        if entry.lines
        else math.nan
        for each in others
    ]
    return (
        entry.variant.label,
        _number(entry.score),
        _number(entry.deviation, 2),
        _number(entry.training_score),
        *map(_number, means),
        _number(aic),
        _number(bic),
        str(entry.parameters) if entry.lines else "",
        f"{entry.seconds:.2f} s" if entry.lines else "",
        "" if math.isnan(entry.instructions) else f"{entry.instructions:.0f}",
        "" if entry.flash is None else f"{entry.flash} B",
        _marks(entry),
    )


def _marks(entry: Ranked) -> str:
    marks = [
        *(["best"] if entry.is_best else []),
        *(["Pareto front"] if entry.is_on_front else []),
        *(f"{line.state}{_which(line.seed, line.fold)}" for line in entry.failed),
    ]
    return ", ".join(marks)


def _which(seed: int, fold: int | None) -> str:
    return (f" seed {seed}" if seed else "") + (f" fold {fold}" if fold is not None else "")


def _number(value: float, digits: int = 5) -> str:
    return "" if math.isnan(value) else f"{value:.{digits}g}"


def plot_comparison(path: Path, found: Comparison) -> Path:
    """Plots accuracy over cost, one point per model, with the standard deviation over seeds and
    folds as error bar and the Pareto front as line. Returns the path of the file.

    The suffix of `path` selects the format, one of FORMATS.
    """
    figure = new_figure(2)
    axis: Any = figure.subplots()
    shown = [entry for entry in found.entries if not math.isnan(entry.score)]
    are_apart = len({entry.expense for entry in shown}) > 1  # labels of one column hide each other
    for entry in shown:
        deviation = None if math.isnan(entry.deviation) else entry.deviation
        color = COLORS[1] if entry.is_on_front else COLORS[0]
        axis.errorbar(
            entry.expense,
            entry.score,
            yerr=deviation,
            marker="o",
            color=color,
            capsize=3,
            zorder=4 if entry.is_on_front else 3,
        )
        if entry.is_on_front or (len(shown) <= 12 and are_apart):
            axis.annotate(
                entry.variant.label.replace("$", r"\$"),
                (entry.expense, entry.score),
                xytext=(5, 5),
                textcoords="offset points",
                fontsize="small",
            )
    # from cheap to dear: the order of the table would fold the line back
    front = sorted((e.expense, e.score) for e in shown if e.is_on_front)
    axis.plot([x for x, _ in front], [y for _, y in front], color=COLORS[1], label="Pareto front")
    counted = any(not math.isnan(entry.instructions) for entry in shown)
    axis.set_xlabel("instructions of a step" if counted else "learned numbers")
    axis.set_ylabel(found.criterion.heading.replace("$", r"\$"))
    axis.grid(alpha=0.3)
    axis.legend(fontsize="small")
    return saved_figure(figure, path)


class TrialLines:
    """Prints a line for every completed training, and each warning once.

    Lines are at least `pause` seconds apart; in between, only errors are printed.
    """

    def __init__(self, stream: TextIO, pause: float = 0.0) -> None:
        self._stream = stream
        # so that the first line is printed at once
        self._pause, self._printed = pause, -pause
        self._began = time.monotonic()
        self._all = self._ended = self._trained = 0
        self._said: set[str] = set()

    def began(self, trials: int) -> None:
        self._all, self._began = trials, time.monotonic()

    def ended(self, trial: Trial, outcome: TrialOutcome) -> None:
        self._ended += 1
        line = outcome.line
        which = printable(trial.variant.label)
        which += f", seed {trial.seed}" if trial.seed else ""
        which += f", fold {trial.fold}" if trial.fold is not None else ""
        left = self._left(outcome)
        now = time.monotonic()
        is_last = self._ended == self._all
        if is_last or line.state != "finished" or now - self._printed >= self._pause:
            self._print(f"{self._ended}/{self._all}  {which}: {_how(outcome)}{left}")
            self._printed = now
        new = [said for said in (*_reasons(outcome), *line.warnings) if said not in self._said]
        self._said.update(new)
        for said in new:
            self._print(said)

    def _left(self, outcome: TrialOutcome) -> str:
        self._trained += outcome.is_new
        left = self._all - self._ended
        if not left or not self._trained:
            return ""
        # of those that were trained here: what the log has costs no time, and others may still be
        # in it
        each = (time.monotonic() - self._began) / self._trained
        return f"; at most {left * each:.0f} s left"

    def _print(self, text: str) -> None:
        self._stream.write(f"{text}\n")
        self._stream.flush()


def _how(outcome: TrialOutcome) -> str:
    line = outcome.line
    if line.state != "finished":
        return line.state
    taken = "" if outcome.is_new else ", trained before"
    return f"{line.reason}, monitor {line.monitor:.5g}, {line.seconds:.2f} s{taken}"


def _reasons(outcome: TrialOutcome) -> tuple[str, ...]:
    return () if outcome.line.state == "finished" else (outcome.line.reason,)
