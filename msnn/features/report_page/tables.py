"""Fills the tables and equations of the page: measurements, parameters, signals, memory."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from compiler.ir.program import Program
from msnn.data.dataset import UNASSIGNED, Dataset
from msnn.exports.describe import range_text
from msnn.reports.drawn import channels
from msnn.training.records.learned.parameters_record import has_unidentified
from msnn.training.records.run_log import Cost
from msnn.validation.measurement import Measurement
from msnn.validation.reports.report import limits
from msnn.validation.reports.words import difference_text, rollout_text, unit_of_record, unit_text
from msnn.validation.validate import MetricRow
from spec_schema.expressions.mathml import enclosed, expression_mathml, indexed, name_mathml
from spec_schema.expressions.tree import Expression, Samples, length_text
from spec_schema.fields.formulas import Prediction
from spec_schema.sections.signals import InitialState
from spec_schema.sections.spec import Spec

_MOST_NUMBERS = 6
_MOST_LISTED = 256


@dataclass(frozen=True, slots=True)
class PageRow:
    """The cells of a table row as text. `verdict` (`good`, `bad` or empty) colours the last cell;
    `more` is text that is shown when the user opens the row.
    """

    cells: tuple[str, ...]
    verdict: str = ""
    more: str = ""


@dataclass(frozen=True, slots=True)
class PageTable:
    """A table with its caption; the columns whose indices are in `numbers` are right-aligned."""

    caption: str
    header: tuple[str, ...]
    rows: tuple[PageRow, ...]
    numbers: tuple[int, ...] = ()


def short(value: float | None, digits: int = 5) -> str:
    """A number as text with `digits` digits; a dash for None, NaN and infinity."""
    return "–" if value is None or not math.isfinite(value) else f"{value:.{digits}g}"


def limits_table(rows: Sequence[MetricRow]) -> PageTable:
    """One row for each metric of the spec's `validate` section: value, limit, and `kept` or
    `broken`.
    """
    verdicts = {True: "kept", False: "broken", None: ""}
    return PageTable(
        "What the spec asks",
        ("of", "metric", "value", "unit", "limit", "how", "data", "verdict"),
        tuple(
            PageRow(
                (
                    row.of,
                    row.metric,
                    short(row.value),
                    unit_text(row.unit),
                    limits(row),
                    rollout_text(row),
                    row.data,
                    verdicts[row.passed],
                ),
                {True: "good", False: "bad", None: ""}[row.passed],
            )
            for row in rows
        ),
        (2,),
    )


def measurements_table(measurements: Sequence[Measurement]) -> PageTable:
    """Every metric of each output and kind of simulation."""
    metrics = ("fit", "rmse", "mae", "max_abs", "r2")
    return PageTable(
        "Every metric",
        ("of", "how", "data", "fit %", "rmse", "mae", "max", "r²", "unit", "values"),
        tuple(
            PageRow(
                (
                    found.of,
                    rollout_text(found),
                    found.data,
                    *(short(found.metrics[metric].value) for metric in metrics),
                    unit_text(found.unit),
                    str(found.scored),
                )
            )
            for found in measurements
        ),
        (3, 4, 5, 6, 7, 9),
    )


def parameters_table(record: Mapping[str, Any], program: Program) -> PageTable:
    """One row per parameter: value, standard error, unit, initial value, remark, doc. `record` is
    the parameter report of the run. Elements of long arrays are shown when the row is opened.
    """
    docs = {parameter.name: parameter.doc for parameter in program.parameters}
    rows: list[PageRow] = []
    for found in record["parameters"]:
        values, errors = found["values"], found["standard_errors"]
        remark = "" if found["learn"] else "fixed"
        if found["at_bound"]:
            remark = "at its bound"
        elif found["learn"] and has_unidentified(record, found):
            remark = "not identifiable"
        rows.append(
            PageRow(
                (
                    found["name"],
                    _numbers(values),
                    difference_text(_errors(errors), unit_of_record(found["unit"])),
                    found["unit"] or "",
                    _numbers(found["initial"]),
                    remark,
                    docs.get(found["name"], "").strip().partition("\n")[0],
                ),
                "bad" if remark in ("at its bound", "not identifiable") else "",
                _listed(values, errors),
            )
        )
    header = ("parameter", "value", "± std. error", "unit", "initial", "remark", "doc")
    return PageTable("Parameters", header, tuple(rows))


def _numbers(values: Sequence[float | None]) -> str:
    if len(values) <= _MOST_NUMBERS:
        return ", ".join(short(value) for value in values)
    known = [value for value in values if value is not None]
    if not known:
        return f"{len(values)} numbers"
    return f"{len(values)} numbers, {short(min(known), 4)} … {short(max(known), 4)}"


def _errors(errors: Sequence[float | None] | None) -> str:
    if errors is None or not any(error is not None for error in errors):
        return ""
    if len(errors) <= _MOST_NUMBERS:
        return ", ".join(short(error, 2) for error in errors)
    known = [error for error in errors if error is not None]
    return f"{short(min(known), 2)} … {short(max(known), 2)}"


def _listed(values: Sequence[float | None], errors: Sequence[float | None] | None) -> str:
    if len(values) <= _MOST_NUMBERS:
        return ""
    shown = [
        short(value) + ("" if errors is None or errors[i] is None else f" ± {short(errors[i], 2)}")
        for i, value in enumerate(values[:_MOST_LISTED])
    ]
    rest = len(values) - len(shown)
    return ", ".join(shown) + (f", … {rest} more" if rest else "")


def data_tables(program: Program, data: Dataset) -> Iterator[PageTable]:
    """Yields two tables: recordings and rows of each set, then minimum, mean, maximum, standard
    deviation and number of missing values of each signal.
    """
    sets = [*data.sets, *(["no set"] if (data.set_of_row == UNASSIGNED).any() else [])]
    rows = tuple(
        PageRow((name, str(records), str(count), _duration(program, count)))
        for name in sets
        for records, count in [_in_set(data, name)]
        if count
    )
    yield PageTable("Sets", ("set", "records", "rows", "time"), rows, (1, 2, 3))
    signals = [signal for signal in program.signals if signal.name in data.series]
    units = {signal.name: signal.unit for signal in signals}
    found: list[PageRow] = []
    for channel in channels(signals):
        values = channel.of(data.series[channel.source])
        known = values[np.isfinite(values)]
        low, mean, high, spread = (
            (known.min(), known.mean(), known.max(), known.std()) if len(known) else [math.nan] * 4
        )
        found.append(
            PageRow(
                (
                    channel.name,
                    channel.unit,
                    *(short(float(value), 4) for value in (low, mean, high)),
                    difference_text(short(float(spread), 4), units[channel.source]),
                    str(len(values) - len(known)),
                    "" if channel.low is None else range_text((channel.low, channel.high or 0.0)),
                )
            )
        )
    header = ("signal", "unit", "least", "mean", "most", "deviation", "missing", "declared range")
    yield PageTable("Signals", header, tuple(found), (2, 3, 4, 5, 6))


def _in_set(data: Dataset, name: str) -> tuple[int, int]:
    wanted = data.in_set(name) if name in data.sets else data.set_of_row == UNASSIGNED
    records = sum(bool(wanted[r.start : r.stop].any()) for r in data.records)
    return records, int(wanted.sum())


def _duration(program: Program, rows: int) -> str:
    if program.sample_time is None:
        return ""
    seconds = rows * program.sample_time
    return f"{seconds / 60:.4g} min" if seconds >= 120 else f"{seconds:.4g} s"


def c_table(memory: Mapping[str, int], cost: Cost | None) -> PageTable:
    """The bytes in `memory`, by description, and with `cost` instructions, flash and RAM of a step
    on the core on which they were measured.
    """
    rows = [PageRow((what, str(size), "bytes")) for what, size in memory.items()]
    if cost is not None:
        core = f" ({cost.core})"
        rows += [
            PageRow((f"a step{core}", f"{cost.instructions:.0f}", "instructions")),
            PageRow((f"code and constants{core}", str(cost.flash), "bytes")),
            PageRow((f"variables{core}", str(cost.ram), "bytes")),
        ]
    return PageTable("Footprint of the C", ("what", "size", "unit"), tuple(rows), (1,))


def verification_table(found: Mapping[str, Any]) -> PageTable:
    """The results of `msnn verify`; `found` is the object that `msnn verify --format
    json` prints.
    """
    rows = tuple(
        PageRow(
            (
                str(result["check"]),
                str(result["target"]),
                str(result["detail"]),
                str(result["verdict"]),
            ),
            {"ok": "good", "found": "bad"}.get(str(result["verdict"]), ""),
        )
        for result in found["results"]
    )
    caption = f"What `msnn verify` found of the C of {found['model']}"
    return PageTable(caption, ("check", "target", "detail", "verdict"), rows)


@dataclass(frozen=True, slots=True)
class ShownEquation:
    """A formula as MathML. `kind` is `function`, `equation`, `state` or `output`; `unit` and `doc`
    are those of the left side.
    """

    kind: str
    mathml: str
    unit: str = ""
    doc: str = ""


def equations(spec: Spec, program: Program) -> Iterator[ShownEquation]:
    """Functions, equations, states and outputs, in the order of the spec."""
    units = {o.name: program.step[o.node].type.unit for o in program.outputs}
    known = {name: "" if unit is None else unit.text for name, unit in units.items()}
    for name, function in spec.functions.items():
        arguments = "<mo>,</mo>".join(name_mathml(argument.value) for argument in function.args)
        left = f"<mrow>{name_mathml(name)}{enclosed(arguments)}</mrow>"
        yield ShownEquation("function", _equal(left, function.expr), doc=_doc(function))
    for name, equation in spec.equations.items():
        # declared, else as the compiler has found it, which is known of outputs alone
        unit = _unit(equation) or known.get(name, "")
        yield ShownEquation(
            "equation", _equal(name_mathml(name), equation.expr), unit, _doc(equation)
        )
    for name, state in spec.states.items():
        unit, doc = _unit(state), _doc(state)
        if state.der is not None:
            left = f"<mover>{name_mathml(name)}<mo>˙</mo></mover>"
            # of a state alone the derivative has another unit than the name
            yield ShownEquation("state", _equal(left, state.der), f"{unit}/s" if unit else "", doc)
        if state.next is not None:
            yield ShownEquation(
                "state", _equal(indexed(name_mathml(name), "t+1"), state.next), unit, doc
            )
        if state.init is not None:
            left = indexed(name_mathml(name), "t₀")
            yield ShownEquation("state", _row(left, _start(state.init)), unit, "")
    for name, output in spec.outputs.items():
        left = name_mathml(name)
        if output.predicts is not None:
            left = f"<mrow>{_predicted(output.predicts)}<mo>=</mo>{left}</mrow>"
        unit = _unit(output) or known.get(name, "")
        yield ShownEquation("output", _equal(left, output.expr), unit, _doc(output))


def _equal(left: str, right: Expression) -> str:
    return _row(left, expression_mathml(right))


def _row(left: str, right: str) -> str:
    return f"<mrow>{left}<mo>=</mo>{right}</mrow>"


def _start(init: InitialState) -> str:
    """The right side of a state's initial value as MathML: its formula, or the words for an
    estimated one, with the initial guess if there is one.
    """
    begin = None if init.expression is None else expression_mathml(init.expression)
    if init.fit is None:
        assert begin is not None
        return begin
    words = f"<mtext>{init.fit.words}</mtext>"
    return words if begin is None else f"<mrow>{words}<mtext>, guess&#xA0;</mtext>{begin}</mrow>"


def _predicted(prediction: Prediction) -> str:
    """The predicted signal as MathML: its name with a hat and the index of the sample,
    such as t+1.
    """
    ahead = prediction.ahead
    now = isinstance(ahead, Samples) and ahead.count == 0
    index = "t" if now else f"t+{length_text(ahead)}"
    hat = f'<mover accent="true">{name_mathml(prediction.signal.value)}<mo>^</mo></mover>'
    return indexed(hat, index)


def _unit(entry: Any) -> str:
    unit = getattr(entry, "unit", None)
    return "" if unit is None else unit.value.text


def _doc(entry: Any) -> str:
    doc = getattr(entry, "doc", None)
    return "" if doc is None else str(getattr(doc, "value", doc)).strip()
