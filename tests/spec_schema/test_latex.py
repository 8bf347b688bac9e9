"""Formulas as LaTeX: what each form becomes, and that TeX's subset of matplotlib can set all."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

import msnn
from msnn.features.report_page.tables import equations
from msnn.reports.latex import formulas
from spec_schema.diagnostics.diagnostic import Findings
from spec_schema.diagnostics.source import SourceText
from spec_schema.expressions.latex import expression_latex, name_latex
from spec_schema.expressions.parser import parse_expression
from spec_schema.reading.reader import read_spec
from spec_schema.yaml_tree.nodes import Positions
from tests.spec_schema.test_json_schema import GOOD


def _latex(text: str) -> str:
    findings = Findings()
    positions = Positions(SourceText("a.yaml", text), range(len(text) + 1))
    expression = parse_expression(text, positions, findings)
    assert expression is not None, findings.in_order
    return expression_latex(expression)


@pytest.mark.parametrize(
    ("text", "latex"),
    [
        ("a + b * c", r"a + b \, c"),
        ("(a + b) * c", r"\left(a + b\right) \, c"),
        ("a - (b - c)", r"a - \left(b - c\right)"),
        ("a / (b + c)", r"\frac{a}{b + c}"),
        ("-a**2", r"-{a}^{2}"),
        ("(-a)**2", r"{\left(-a\right)}^{2}"),
        ("2 * 3", r"2 \cdot 3"),
        ("1e-9 * a", r"1 \cdot 10^{-9} \, a"),
        ("W @ q", r"W \cdot q"),
        ("x[t-1]", "x_{t-1}"),
        ("x[t-4:t]", "x_{t-4{:}t}"),
        ("sin(θ_1)", r"\sin\left(\theta_{\mathrm{1}}\right)"),
        ("sqrt(abs(x))", r"\sqrt{\left|x\right|}"),
        ("relu(x)", r"\operatorname{relu}\left(x\right)"),
        ("where(x < 0, 1, 2)", r"\operatorname{where}\left(x < 0, 1, 2\right)"),
        ("x.meas", r"x^{\mathrm{meas}}"),
    ],
)
def test_forms(text: str, latex: str) -> None:
    assert _latex(text) == latex


@pytest.mark.parametrize(
    ("name", "latex"),
    [
        ("x", "x"),
        ("Ω", r"\Omega"),
        ("Α", r"\mathrm{Α}"),
        ("λ", r"\lambda"),
        ("tau_max", r"\mathrm{tau}_{\mathrm{max}}"),
        ("x_next_1", r"x_{\mathrm{next,1}}"),
    ],
)
def test_names(name: str, latex: str) -> None:
    assert name_latex(name) == latex


@pytest.mark.parametrize("path", GOOD, ids=lambda path: path.name)
def test_matplotlib_sets_every_formula(path: Path) -> None:
    mathtext = pytest.importorskip("matplotlib.mathtext", reason="pip install 'msnn[plot]'")
    parser = mathtext.MathTextParser("path")
    for left, right in formulas(read_spec(path).spec):
        parser.parse(f"${left} = {right}$")


def test_each_part_of_a_deep_product_is_written_once() -> None:
    """Written twice at every level it would take for ever."""
    depth = 90
    expression = parse_expression("a * (" * depth + "b" + ")" * depth)
    assert expression is not None
    assert expression_latex(expression).count("a") == depth


FITTED = """\
msnn: 1
name: oven
sample_time: 1 s
inputs: {P: {}}
states:
  a: {next: 0.9*a + P, init: INIT}
outputs: {y: {expr: a, predicts: "y_seen[t]"}}
targets: {y_seen: {}}
"""


@pytest.mark.parametrize(
    ("init", "words", "guess"),
    [
        ("{fit: {over: 20}}", "fitted to the first 20 samples of each run", None),
        ("{fit: {over: 2 min}}", "fitted to the first 2 min of each run", None),
        ("{fit: {over: record}}", "fitted to each run", None),
        (
            "{fit: {over: 20, from: 3 * y_seen.meas}}",
            "fitted to the first 20 samples of each run",
            "3",
        ),
        ("3 * y_seen.meas", None, "3"),
    ],
)
def test_a_fitted_start_is_not_shown_as_its_guess(
    tmp_path: Path, init: str, words: str | None, guess: str | None
) -> None:
    spec = tmp_path / "oven.msnn.yaml"
    spec.write_text(FITTED.replace("INIT", init))
    model = msnn.load(spec)
    latex = next(right for left, right in formulas(model.spec) if left == "a_{t_0}")
    shown = next(e.mathml for e in equations(model.spec, model.program) if "t₀" in e.mathml)
    for text in (latex, shown):
        before, found, after = text.partition("guess")
        assert (words in before) if words else ("fitted" not in text)
        assert bool(found) is bool(words and guess)
        assert guess is None or guess in (after or before)
    ElementTree.fromstring(shown)  # noqa: S314  (our own)
