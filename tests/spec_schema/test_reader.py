"""Good specs are read as they mean; any text at all is answered by a spec or by diagnostics."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import BaseModel

from msnn.features.control.keys import Estimator
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.diagnostics.source import SourceText, Span
from spec_schema.expressions.tree import (
    Binary,
    Call,
    Duration,
    ListLiteral,
    Name,
    Number,
    Samples,
    expression_text,
)
from spec_schema.fields.entry import Entry
from spec_schema.reading.reader import ReadResult, read_spec
from spec_schema.sections.data import Blocks, Split
from spec_schema.sections.spec import Integrator, Spec
from spec_schema.sections.values import NormalInitializer

GOOD = sorted((Path(__file__).parent / "good").iterdir())
BROKEN = sorted((Path(__file__).parents[1] / "bad_specs").glob("*.yaml"))
DRAFTS = Path(__file__).parents[3] / "shared" / "specs"
# The drafts that use only what this version reads.
DRAFT_NAMES = ("msd.msnn.yaml", "vehicle.msnn.yaml")
MINIMAL = "msnn: 1\nname: plant\nsample_time: 50 ms\ninputs: {x: m}\n"


@pytest.mark.parametrize("path", GOOD, ids=lambda path: path.name)
def test_good_spec_is_read_without_a_word(path: Path) -> None:
    assert read_spec(path).warnings == ()


@pytest.mark.skipif(not DRAFTS.is_dir(), reason="the drafts are not beside this checkout")
@pytest.mark.parametrize("name", DRAFT_NAMES)
def test_draft_is_read(name: str) -> None:
    assert read_spec(DRAFTS / name).spec.outputs


# A spec has one integrator, one way to split and one estimator only.
_ALTERNATIVES: dict[type[Entry], set[str]] = {
    Integrator: {"euler", "midpoint", "semi_implicit", "linear_implicit"},
    Split: {"k", "fold"},
    Estimator: {"ekf"},
}


def test_complete_spec_uses_every_key() -> None:
    spec = _complete()
    used = {type(entry): set[str]() for entry in _entries(spec)}
    for entry in _entries(spec):
        used[type(entry)] |= entry.model_fields_set
    for kind, fields in used.items():
        absent = _ALTERNATIVES.get(kind, set())
        unused = set(kind.model_fields) - absent - fields
        assert not unused, f"{kind.__name__}: use {unused} in tests/spec_schema/good/complete.yaml"
    every = {kind for kind in _subclasses(Entry) if _is_ours(kind)}
    never_written = {"OneOf", "Layout", "TargetEntry", "FloatTargetEntry", "Euler", "Midpoint"}
    never_written |= {"SemiImplicit", "LinearImplicit", "OptimizerOptions", "KalmanFilter"}
    missing = {kind.__name__ for kind in every - set(used)}
    assert missing == never_written, "use these in tests/spec_schema/good/complete.yaml"


def _is_ours(kind: type[Entry]) -> bool:
    return kind.__module__.startswith(("spec_schema.", "msnn.features."))


def test_places_point_at_key_and_value() -> None:
    result = read_spec(Path(__file__).parent / "good" / "complete.yaml")
    spec, source = result.spec, result.source
    drag = spec.functions["drag"]
    assert _text(source, drag.place.key) == "drag"
    assert _text(source, drag.place.value).startswith("{args: [v, kv]")
    assert _text(source, drag.args[1].span) == "kv"
    assert _text(source, drag.expr.span) == "kv * v * abs(v)"
    stiffness = spec.parameters["k"]
    assert stiffness.unit is not None
    assert _text(source, stiffness.unit.span) == "N/m"
    assert _text(source, spec.train[0].lr["W*"].span) == "0.1"


def test_shorthands_and_long_forms_are_the_same() -> None:
    short = _read("outputs: {y: x}\nparameters: {k: 5 N/m}\nintegrator: rk4\n")
    long = _read(
        "outputs: {y: {expr: x}}\nparameters: {k: {init: {value: 5}, unit: N/m}}\n"
        "integrator: {rk4: {substeps: 1}}\n"
    )
    assert short.outputs["y"].expr == long.outputs["y"].expr == Name("x", _anywhere())
    assert short.parameters["k"].init.choice == long.parameters["k"].init.choice
    assert short.parameters["k"].unit == long.parameters["k"].unit
    assert short.integrator is not None
    assert long.integrator is not None
    assert type(short.integrator.choice) is type(long.integrator.choice)


def test_values_of_the_complete_spec() -> None:
    spec = _complete()
    assert spec.sample_time is not None
    assert spec.sample_time.text == "0.05 s"
    assert [d.size for d in spec.dims.values()] == [2, 2, 3]
    assert spec.dims["joint"].labels == ("shoulder", "elbow")
    table = spec.constants["table"].value
    assert isinstance(table, ListLiteral)
    assert expression_text(table) == "[[1, 2], [3, 4]]"
    assert isinstance(spec.parameters["W"].init.choice, NormalInitializer)
    fir = spec.layers["h"].fir
    assert fir is not None
    assert isinstance(fir.window, Duration)
    assert fir.window.seconds == pytest.approx(0.15, rel=1e-15)  # one rounding of 150 * 1e-3
    fuzzify = spec.layers["φ"].fuzzify
    assert fuzzify is not None
    assert isinstance(fuzzify.centers, Call)
    prediction = spec.outputs["q_next"].predicts
    assert prediction is not None
    assert prediction.signal.value == "q"
    assert prediction.ahead == Samples(1, _anywhere())
    assert spec.data is not None
    assert [c.column for c in spec.data.columns["u"].column] == ["u1", "u2"]
    assert [c.column for c in spec.data.columns["q"].column] == ["shoulder", 4]
    assert spec.data.split is not None
    assert spec.data.split.train == Blocks((1, 3), _anywhere())
    assert [type(s.optimizer.choice).__name__ for s in spec.train] == [
        "Adam",
        "AdamW",
        "Sgd",
        "Lbfgs",
        "TorchOptimizer",
        "Adam",
        "Adam",
        "LevenbergMarquardt",
    ]
    horizons = [s.rollout.horizon for s in spec.train if s.rollout is not None]
    assert horizons[1:] == ["episode", "record"]
    assert spec.train[2].rollout is not None
    assert spec.train[2].rollout.close is None


def test_stage_without_optimizer_has_adam() -> None:
    assert _read("outputs: {y: x}\ntrain: [{}]\n").train[0].optimizer.adam is not None


def test_yaml_styles_give_the_same_expression() -> None:
    spec = read_spec(Path(__file__).parent / "good" / "styles.yaml").spec
    texts = {name: expression_text(output.expr) for name, output in spec.outputs.items()}
    assert texts.pop("single") == "2 * (λ + F)"
    assert texts.pop("exponent") == "0.001 * F - 0.5"
    assert set(texts.values()) == {"λ + F"}


def test_yaml_1_1_surprises_are_gone() -> None:
    spec = _read("outputs: {y: 1e3, z: -.5, w: 12}\nparameters: {no: 1e-3, on: 1}\n")
    assert isinstance(spec.outputs["y"].expr, Number)
    assert spec.outputs["y"].expr.value == 1000.0
    assert set(spec.parameters) == {"no", "on"}


def test_names_are_normalised_like_those_in_expressions() -> None:
    # The micro sign of a keyboard and the Greek letter.
    spec = _read("parameters: {\u00b5: 1}\noutputs: {y: \u00b5 * x}\n")
    expression = spec.outputs["y"].expr
    assert isinstance(expression, Binary)
    assert isinstance(expression.left, Name)
    assert expression.left.name in spec.parameters


def test_unreadable_file_is_a_diagnostic(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="no such file") as caught:
        read_spec(tmp_path / "absent.yaml")
    assert caught.value.diagnostics[0].code == "E1001"


# Fragments that reach deeper into the reader than arbitrary characters would.
_PIECES = (
    "msnn: 1|name: a|inputs:|  x: m|outputs:|  y: x[t-1 s:t] + |{|}|[|]|: |- |\n|  |&a |*a|'|\"|#|"
    "layers: {h: {fir: {window: 1 s}}}|states: {v: {der: x, init: 0}}|!!str|? |\r\n|\t|λ|\\x4|>-\n|"
    "<<: *a|1e999|null|---\n|...\n|x.past(3)|data: {source: {train: a}}|train: [{epochs: 1}]|\x85|"
    "\u2028|\ufeff|\x00|\ud800|%YAML 1.2\n|validate: [{of: y}]|export: {c: }|0.1 N/m^2| \n"
)
_FRAGMENTS = st.sampled_from(_PIECES.split("|"))
_TEXTS = st.lists(_FRAGMENTS | st.text(max_size=8), max_size=40).map("".join)


@settings(max_examples=400, deadline=None)
@given(_TEXTS)
def test_any_text_is_a_spec_or_diagnostics_inside_it(text: str) -> None:
    for path in ("any.yaml", "any.json"):
        _read_or_diagnose(path, text)


@settings(
    max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(st.data())
def test_damaged_spec_is_a_spec_or_diagnostics_inside_it(data: st.DataObject) -> None:
    path = data.draw(st.sampled_from([*GOOD, *BROKEN]))
    text = path.read_bytes().decode(errors="replace")
    start = data.draw(st.integers(0, len(text)))
    end = min(len(text), start + data.draw(st.integers(0, 12)))
    put = data.draw(_FRAGMENTS | st.text(max_size=3))
    _read_or_diagnose(path.name, text[:start] + put + text[end:])


def _read_or_diagnose(path: str, text: str) -> None:
    error = _failure(path, text)
    if error is not None:
        assert any(d.severity == "error" for d in error.diagnostics)
        for diagnostic in error.diagnostics:
            _assert_inside(diagnostic, error.sources[0])


def _failure(path: str, text: str) -> SpecError | None:
    try:
        read_spec(path, text)
    except SpecError as error:
        return error
    return None


def _assert_inside(diagnostic: Diagnostic, source: SourceText) -> None:
    spans = [span for span, _ in diagnostic.secondary]
    for span in [*spans, *([diagnostic.span] if diagnostic.span else [])]:
        assert span.file == source.path
        assert (1, 1) <= (span.line, span.column) <= (span.end_line, span.end_column)
        assert span.end_line <= source.line_count
        for line, column in ((span.line, span.column), (span.end_line, span.end_column)):
            # One column behind the line's end and its line break is still that line's.
            assert column <= len(source.line(line)) + 3


def _read(text: str) -> Spec:
    return read_spec("plant.yaml", MINIMAL + text).spec


def _complete() -> Spec:
    result: ReadResult = read_spec(Path(__file__).parent / "good" / "complete.yaml")
    return result.spec


def _entries(value: object) -> Iterator[Entry]:
    """All entries of a spec; the fields of a model, the items of mappings and tuples."""
    if isinstance(value, BaseModel):
        assert isinstance(value, Entry)
        yield value
        for name in type(value).model_fields:
            yield from _entries(getattr(value, name))
    elif isinstance(value, dict):
        for item in value.values():
            yield from _entries(item)
    elif isinstance(value, tuple):
        for item in value:
            yield from _entries(item)


def _subclasses(kind: type[Entry]) -> set[type[Entry]]:
    below = {sub for direct in kind.__subclasses__() for sub in _subclasses(direct)}
    return below | set(kind.__subclasses__())


def _text(source: SourceText, span: Span) -> str:
    assert span.line == span.end_line
    return source.line(span.line)[span.column - 1 : span.end_column - 1]


def _anywhere() -> Span:
    return Span(file="", line=1, column=1, end_line=1, end_column=1)


def test_a_key_is_read_by_its_old_name_in_files_and_in_settings():
    path = Path(__file__).parents[1] / "bad_specs" / "W0220_former_key.yaml"
    read = read_spec(path, settings=("train.0.schedule.plateau.least=0.5",))
    assert [each.code for each in read.warnings] == ["W0220"]
    (stage,) = read.spec.train
    assert stage.schedule is not None
    assert stage.schedule.plateau is not None
    assert stage.schedule.plateau.min == 0.5
    both = path.read_text(encoding="utf-8").replace("least: 0.01", "least: 0.01, min: 0.02")
    with pytest.raises(SpecError, match=r"`least` in .* is the old name of `min`"):
        read_spec(path, both)
