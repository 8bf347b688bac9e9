"""Writes the page of a run: one self-contained HTML file."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup, escape

import templates
from msnn.data.dataset import Dataset, FloatArray
from msnn.features.report_page import tables
from msnn.features.report_page.charts import (
    MOST_MEASUREMENTS,
    error_charts,
    function_charts,
    training_charts,
)
from msnn.features.report_page.live import LiveModel, NotLive, linear_inputs
from msnn.features.report_page.packing import Plain
from msnn.features.report_page.records import Ports, Records, records
from msnn.features.report_page.tables import equations
from msnn.model.model import Model, learned_numbers
from msnn.model.program_file import plugins_text
from msnn.model.saved_run import data_plugins, recorded_plugins
from msnn.reports.diagram.svg import architecture_svg
from msnn.reports.drawn import unit_of
from msnn.reports.learned_functions import MOST_FUNCTIONS, LearnedFunction
from msnn.reports.run_summary import Run
from msnn.reports.training_summary import errors_note, zeros_note
from msnn.simulation.simulate import Simulation
from msnn.training.records.run_log import RunLine
from msnn.validation.reports.words import measured_as
from msnn.validation.validate import ValidationReport

_FOLDER = Path(templates.__path__[0]) / "report"
_SCRIPTS = ("plot.js", "page.js", "live.js")


@dataclass(frozen=True, slots=True, kw_only=True)
class Contents:
    """Everything that the page of a run shows. `data` and `validation` are None if the data cannot
    be read, `line` and `verification` if there is none.
    """

    run: Run
    model: Model
    weights: Mapping[str, FloatArray]
    data: Dataset | None
    simulations: Sequence[Simulation]
    validation: ValidationReport | None
    functions: Sequence[LearnedFunction]
    live: LiveModel | NotLive
    line: RunLine | None
    """The line in the log of trainings."""
    verification: Mapping[str, Any] | None
    """The results of `msnn verify` for an export."""
    left_out: Sequence[str]
    """Texts about missing contents, with reasons."""


def page_text(contents: Contents) -> str:
    """The page as HTML text. All texts of a spec or a file are escaped, and only scripts and styles
    of msnn may run (Content-Security-Policy).
    """
    program = contents.model.program
    live = contents.live if isinstance(contents.live, LiveModel) else None
    shown = _records(contents, live)
    charts: dict[str, Plain] = {}
    validation = contents.validation
    rows = () if validation is None else validation.rows
    measurements = () if validation is None else validation.measurements
    values: Plain = {
        "name": program.name,
        "records": shown.shown,
        "charts": charts,
        "live": None if live is None else live.values,
    }
    known: dict[str, Any] = {
        "model": contents.model,
        "program": program,
        "run": contents.run,
        "facts": _facts(contents),
        "cards": _cards(contents),
        "records": shown,
        # a thinned record has not the samples that a step would read
        "playable": [(i, r["name"]) for i, r in enumerate(shown.shown) if r["whole"]],
        "error_tables": [tables.limits_table(rows), tables.measurements_table(measurements)]
        if measurements or rows
        else [],
        "errors": _titled(charts, "errors", error_charts(measurements, rows)),
        "training": _titled(charts, "training", training_charts(contents.run)),
        "functions": _titled(
            charts, "function", function_charts(contents.functions[:MOST_FUNCTIONS])
        ),
        "diagram": architecture_svg(contents.model.spec, styled=False),
        "equations": list(equations(contents.model.spec, program)),
        "parameters": _parameters(contents),
        "notes": _notes(contents.run),
        "data_tables": []
        if contents.data is None
        else list(tables.data_tables(program, contents.data)),
        "c_tables": _c_tables(contents, live),
        "live": live,
        "not_live": None if live is not None else contents.live,
        "left_out": [*contents.left_out, *_undrawn(contents, len(measurements))],
        # what the training warned of, but for what the data say again
        "warned": [
            text
            for text in contents.run.end.get("warnings", [])
            if not any(said in text for said in contents.left_out)
        ],
    }
    script = "".join((_FOLDER / name).read_text(encoding="utf-8") for name in _SCRIPTS)
    style = "".join(
        (_FOLDER / name).read_text(encoding="utf-8") for name in ("page.css", "diagram.css")
    )
    template = _environment().get_template("page.html.j2")
    return template.render(
        **known,
        script=script,
        style=style,
        # Content-Security-Policy: scripts and styles by hash, so that markup in a doc can run
        # nothing
        script_hash=_hash(script),
        style_hash=_hash(style),
        data=_json(values),
    )


def _records(contents: Contents, live: LiveModel | None) -> Records:
    if contents.data is None:
        return Records([], [])
    ports = Ports(back=0, ahead=0, signals=frozenset()) if live is None else live.ports
    linear = linear_inputs(contents.model)
    return records(contents.model.program, contents.data, contents.simulations, ports, linear)


def _undrawn(contents: Contents, measurements: int) -> Iterator[str]:
    """One text for each limit on charts that was exceeded: learned functions, and measurements,
    whose number is `measurements`. Recordings are counted elsewhere.
    """
    for found, most, what in (
        (len(contents.functions), MOST_FUNCTIONS, "learned functions"),
        (measurements, MOST_MEASUREMENTS, "measurements, whose metrics are all in the table,"),
    ):
        if found > most:
            yield f"charts of {found - most} of {found} {what} are not drawn"


def _titled(charts: dict[str, Plain], kind: str, found: Any) -> list[tuple[str, str]]:
    """Adds the charts of `found`, pairs of title and chart, to `charts` under the keys `kind-0`,
    `kind-1` and so on; returns keys and titles.
    """
    titles: list[tuple[str, str]] = []
    for title, chart in found:
        key = f"{kind}-{len(titles)}"
        charts[key] = chart
        titles.append((key, title))
    return titles


def _facts(contents: Contents) -> list[tuple[str, str]]:
    found = contents.run.description
    data = found["data"]
    rows = ", ".join(f"{name} {number}" for name, number in data["rows"].items())
    files = "1 file" if len(data["files"]) == 1 else f"{len(data['files'])} files"
    facts = [
        ("run", str(contents.run.folder.name)),
        ("state", contents.run.state),
        ("spec", f"{found.get('spec') or ''} · sha256 {found['spec_sha256'][:12]}"),
        ("settings", ", ".join(str(text) for text in found.get("settings", []))),
        ("data", f"{files} · rows: {rows}"),
        ("made with", ", ".join(f"{n} {v}" for n, v in found["versions"].items())),
        ("plug-ins", plugins_text(recorded_plugins(found))),
        ("data read by", plugins_text(data_plugins(found))),
    ]
    if contents.line is not None:
        facts.append(("training took", f"{contents.line.seconds:.3g} s"))
    return [(name, value) for name, value in facts if value]


def _cards(contents: Contents) -> list[tuple[str, str, str]]:
    """The main results at the top of the page, each as value, description, and the measured output
    with its simulation and data (empty for other results).
    """
    cards: list[tuple[str, str, str]] = []
    validation = contents.validation
    if validation is not None:
        for found in validation.measurements[:3]:
            unit = unit_of(found.unit)
            fit, rmse = found.metrics["fit"].value, found.metrics["rmse"].value
            what = ", ".join(measured_as(found))
            cards.append(
                (
                    f"{tables.short(fit, 4)} %",
                    f"fit · rmse {tables.short(rmse, 3)} {unit}".strip(),
                    what,
                )
            )
        limited = [row for row in validation.rows if row.passed is not None]
        if limited:
            kept = sum(row.passed is True for row in limited)
            cards.append((f"{kept} of {len(limited)}", "limits of the spec kept", ""))
    numbers = learned_numbers(contents.model.program, contents.model.spec.train)
    cards.append((str(numbers), "learned number" + ("" if numbers == 1 else "s"), ""))
    return cards


def _parameters(contents: Contents) -> tables.PageTable | None:
    if contents.run.parameters is None:
        return None
    return tables.parameters_table(contents.run.parameters, contents.model.program)


def _notes(run: Run) -> list[str]:
    if run.parameters is None:
        return []
    return [note for note in (errors_note(run.parameters), zeros_note(run.parameters)) if note]


def _c_tables(contents: Contents, live: LiveModel | None) -> list[tables.PageTable]:
    cost = None if contents.line is None else contents.line.cost
    found: list[tables.PageTable] = []
    if live is not None or cost is not None:
        found.append(tables.c_table({} if live is None else live.memory, cost))
    if contents.verification is not None:
        found.append(tables.verification_table(contents.verification))
    return found


def _json(values: Plain) -> str:
    """The values as JSON text without `<`, `>` and `&`, so that it cannot end its HTML element.
    Raises ValueError for NaN and infinity.
    """
    # allow_nan=False: browsers reject the NaN that Python would write
    text = json.dumps(values, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    # `</script>` ends the element wherever it stands; U+2028 and U+2029 end lines in older
    # JavaScript
    for sign in "<>&\u2028\u2029":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return text


def _hash(text: str) -> str:
    """SHA-256 of a script or a style in base64, as the page's content security policy lists it."""
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode("ascii")


@cache
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_FOLDER),
        # a name that the template has and the code has not is an error, not an empty place
        undefined=jinja2.StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["marked"] = marked
    return environment


def marked(text: str) -> Markup:
    """A message as escaped HTML; text between two backticks becomes `<code>`."""
    parts = text.split("`")
    # a backtick without another: no part is known to be code
    if len(parts) % 2 == 0:
        return escape(text)
    return Markup("").join(
        Markup("<code>{}</code>").format(part) if number % 2 else escape(part)
        for number, part in enumerate(parts)
    )
