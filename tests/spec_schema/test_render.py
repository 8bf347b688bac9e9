"""Diagnostics are printed in four forms, each pinned to the character."""

import json
from pathlib import Path

import pytest

from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError, describe
from spec_schema.diagnostics.render import Format, render
from spec_schema.diagnostics.source import SourceText
from tests.golden import assert_golden

GOLDEN = Path(__file__).parent / "rendered"
PLANT = SourceText(
    "plant.yaml",
    "name: plant\nacc: (F[t] - kk*x[t]) / 2\n"
    "\ttab:\tk^2\nwide: '漢字' + kk\ntext: |\n  a\n  b\n" + "\n" * 95 + "last: kk\n",
)
DRAG = SourceText("drag.yaml", "k: N\n")


def _found() -> list[Diagnostic]:
    text = PLANT.text
    name = PLANT.span(text.index("kk"), text.index("kk") + 2)
    tab = PLANT.span(text.index("^"), text.index("^") + 1)
    wide = PLANT.span(text.index("'漢"), text.index("'漢") + 4)
    block = PLANT.span(text.index("|\n"), text.index("b\n") + 1)
    last = PLANT.span(text.rindex("kk"), text.rindex("kk") + 2)
    end = PLANT.span(len(text), len(text))
    absent = SourceText("absent.csv", "a;b\n").span(0, 3)
    return [
        Diagnostic(
            code="E0301",
            severity="error",
            message="unknown name `kk`",
            span=name,
            label="not an input, parameter, layer or equation",
            help="did you mean `k`?",
        ),
        Diagnostic(
            code="E0321", severity="error", message="a tab is four columns", span=tab, label="here"
        ),
        Diagnostic(
            code="W0501",
            severity="warning",
            message="wide characters are two columns",
            span=wide,
            label="four of them",
        ),
        Diagnostic(
            code="E0338",
            severity="error",
            message="several lines: the first is underlined",
            span=block,
            label="block",
        ),
        Diagnostic(
            code="E0502",
            severity="error",
            message="other places: 100 %, a:b,c",
            span=last,
            label="again here",
            secondary=((name, "first here"), (tab, "and here"), (DRAG.span(3, 4), "in N there")),
            notes=("a fact", "another fact"),
        ),
        Diagnostic(code="E0111", severity="note", message="the end of the file", span=end),
        Diagnostic(
            code="E0801",
            severity="error",
            message="a file whose text is not at hand",
            span=absent,
            label="unseen",
        ),
        Diagnostic(
            code="E1001", severity="error", message="no place at all", span=None, help="try again"
        ),
    ]


@pytest.mark.parametrize("format", ["full", "concise", "json", "github"])
def test_printed_form(format: Format, accept: bool) -> None:
    text = render(_found(), format, (PLANT, DRAG))
    assert_golden(GOLDEN / f"{format}.txt", text + "\n", accept)


def test_colour_changes_nothing_but_colour(accept: bool) -> None:
    text = render(_found(), "full", (PLANT, DRAG), color=True)
    assert_golden(GOLDEN / "color.txt", text.replace("\x1b", "ESC") + "\n", accept)


def test_json_is_json() -> None:
    record = json.loads(render(_found(), "json"))
    assert record["version"] == 1
    assert [found["code"] for found in record["diagnostics"]][:2] == ["E0301", "E0321"]


def test_nothing_to_say() -> None:
    assert render([], "full") == ""
    assert json.loads(render([], "json"))["diagnostics"] == []


def test_findings_are_in_the_order_of_the_file_and_said_once() -> None:
    findings = Findings()
    findings.report(*reversed(_found()), *_found())
    places = [d.span for d in findings.in_order if d.span is not None]
    assert places == sorted(places)
    assert len(findings.in_order) == len(_found())
    assert findings.in_order[-1].span is None
    with pytest.raises(SpecError, match="unknown name") as caught:
        findings.raise_errors()
    assert caught.value.diagnostics == findings.in_order


def test_warnings_alone_raise_nothing() -> None:
    findings = Findings()
    findings.report(
        Diagnostic(code="W0501", severity="warning", message="only a warning", span=None)
    )
    findings.raise_errors()
    assert describe(findings.in_order[0]) == "warning[W0501]: only a warning"
