"""A file that is no model, or means harm, ends in a diagnostic with the place at fault."""

from __future__ import annotations

import json
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msnn.api.models import import_nnodely
from msnn.features.nnodely import json_text
from msnn.features.nnodely.json_text import read_json
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from tests.features.nnodely.recorded_model import recorded
from tests.features.nnodely.saved_model import imported_text, saved, with_function


def _first(model: dict[str, Any] | str) -> Diagnostic:
    with pytest.raises(SpecError) as caught:
        imported_text(model)
    return caught.value.diagnostics[0]


@pytest.mark.parametrize(
    ("text", "line", "column", "said"),
    [
        ("", 1, 1, "ends in the middle"),
        ("{", 1, 2, "a key is missing"),
        ('{"Info": {}}x', 1, 13, "follows the end"),
        ('{"Info": 1, "Info": 2}', 1, 13, "stands twice"),
        ('{"Parameters":\n {"k": {"values": [nan]}}}', 2, 20, "`nan` is no value"),
        ('{"a": NaN}', 1, 7, "`NaN` is no value"),
        ('{"a": 1e999}', 1, 7, "beyond what a double holds"),
        ('{"a": ' + "[" * 40 + "]" * 40 + "}", 1, 39, "nested more than 32 deep"),
        ('{"a" 1}', 1, 6, "a key has no value"),
        ('{"a": [1 2]}', 1, 10, "a list is not closed"),
        ('{"a": "x', 1, 7, "a text is not closed"),
        ('{"a": "\\q"}', 1, 8, "a text is faulty"),
        ('{"a": 01}', 1, 8, "an object is not closed"),
        ("{'a': 1}", 1, 2, "a key is missing"),
    ],
)
def test_what_is_no_json_has_its_place(text: str, line: int, column: int, said: str) -> None:
    found = _first(text)
    assert found.code == "E1308"
    assert said in found.message
    assert found.span is not None
    assert (found.span.line, found.span.column) == (line, column)


@pytest.mark.parametrize("filling", ["a", "\\n", "\\\\"])
def test_a_long_text_takes_no_more_than_itself(filling: str) -> None:
    text = f'{{"Info": "{filling * 1_000_000}"}}'
    tracemalloc.start()
    try:
        read_json(text, "model.json")
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    # the text, what of it is not escaped, and a copy of that
    assert most < 8 * len(text)


def test_places_are_kept_of_the_first_elements_of_a_list() -> None:
    found = read_json(f'{{"a": [{"0, " * 10_000}[7]], "b": 1}}', "model.json")
    assert len(found.places) < 100
    assert found.place("a", 3).column == 17
    assert found.place("a", 9_999).column == found.place("a").column == 7


def test_a_file_that_is_too_long_is_refused_before_it_is_read(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(json_text, "LARGEST", 1_000)
    found = _first(f'{{"Info": "{"a" * 1_000}')
    assert found.code == "E1308"
    assert "it has more than 1,000 characters" in found.message


@pytest.mark.parametrize("value", ["0", "[]", "{}", '""'])
def test_too_many_values_are_refused(value: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(json_text, "MOST_VALUES", 1_000)
    found = _first(f'{{"a": [{", ".join([value] * 1_000)}]}}')
    assert found.code == "E1308"
    assert "it has more than 1,000 values" in found.message


def _part(*path: str, value: object) -> Callable[[dict[str, Any]], None]:
    def change(model: dict[str, Any]) -> None:
        for step in path[:-1]:
            model = model[step]
        model[path[-1]] = value

    return change


@pytest.mark.parametrize(
    ("change", "code", "said"),
    [
        (_part("Inputs", value=[]), "E1309", "`Inputs`"),
        (_part("Outputs", value={}), "E1309", "`Outputs`"),
        (_part("Inputs", "x", "dim", value="1"), "E1309", "`Inputs.x.dim`"),
        (_part("Inputs", "x", "dim", value=True), "E1309", "`Inputs.x.dim`"),
        (_part("Inputs", "x", "dim", value=10**18), "E1309", "`Inputs.x.dim`"),
        (_part("Inputs", "x", "sw", value=[-1]), "E1309", "`Inputs.x.sw`"),
        (_part("Inputs", "x", "sw", value=[0, -1]), "E1311", "is empty"),
        (_part("Inputs", "x", value={"dim": 1}), "E1311", "has no window"),
        (_part("Inputs", "x", "sw", value=[-(10**6) - 1, 0]), "E1309", "`Inputs.x.sw[0]`"),
        (_part("Info", "SampleTime", value=0), "E1309", "`Info.SampleTime`"),
        (_part("Relations", "y", value=["Mul"]), "E1309", "`Relations.y`"),
        (_part("Relations", "y", value=[["Mul"], ["now", "c"]]), "E1309", "`Relations.y`"),
        (_part("Relations", "y", value=["Mul", [["now"], "c"]]), "E1309", "`Relations.y`"),
        (_part("Outputs", "out", value="z"), "E1310", "`Outputs.out` names `z`"),
        (_part("Relations", "y", value=["Mul", ["now", "d"]]), "E1310", "`Relations.y[1][1]`"),
        (_part("Relations", "y", value=["Fir", ["now"], "W", None, 0]), "E1310", "names `W`"),
        (_part("Relations", "y", value=["Mul", ["now"]]), "E1311", "1 operands"),
        (_part("Relations", "y", value=["Mul", ["x", "c"]]), "E1311", "without a window"),
        (_part("Relations", "y", value=["Select", ["now"], 1, 5]), "E1311", "element 5"),
        (_part("Relations", "now", value=["SamplePart", ["x"], -1, [-3, 0]]), "E1311", "no part"),
        (_part("Constants", "c", "values", value=[1.0, 2.0]), "E1311", "not 1 finite numbers"),
        (_part("Constants", "c", "values", value=["os.system('id')"]), "E1311", "`Constants.c`"),
        (_part("Constants", "c", "values", value=[1e300]), "E1311", "`Constants.c`"),
        (_part("Relations", "y", value=["NeuralODE", ["now"], "F"]), "E1312", "`NeuralODE`"),
        (_part("Relations", "y", value=["Fir", ["now"], "c", None, 2]), "E1312", "dropout"),
        (_part("Minimizers", value={"l": {"A": "y", "B": "y", "loss": "eval"}}), "E1312", "eval"),
        (_part("Relations", "y", value=["Mul", ["y", "c"]]), "E1314", "`y` → `y`"),
        (_part("Parameters", value={"c": {"dim": 1}}), "E1315", "`c` has no values"),
    ],
)
def test_a_wrong_value_is_named_by_its_path(
    change: Callable[[dict[str, Any]], None], code: str, said: str
) -> None:
    model = saved()
    change(model)
    found = _first(model)
    assert (found.code, said in found.message) == (code, True), found.message
    assert found.span is not None


def test_a_connection_in_a_circle_is_told_where_nnodely_never_ends() -> None:
    model = saved(Inputs={"x": {"dim": 1, "sw": [-1, 0], "connect": "y", "local": 0}})
    found = _first(model)
    assert found.code == "E1314"
    assert found.message.endswith("`y` → `now` → `y`")


@pytest.mark.parametrize("kind", ["TimeConcatenate", "Concatenate"])
def test_values_that_double_are_cut_short(kind: str) -> None:
    relations = {"y0": ["SamplePart", ["x"], -1, [-1, 0]]}
    for i in range(1, 40):
        relations[f"y{i}"] = [kind, [f"y{i - 1}", f"y{i - 1}"]]
    found = _first(saved(Relations=relations, Outputs={"out": "y39"}))
    assert found.code == "E1311"
    assert "more than 10,000 values are joined" in found.message


def test_a_spec_that_does_not_compile_is_not_written(tmp_path: Path) -> None:
    """A part of a thousand elements is longer than an expression may be."""
    relations = {
        "now": ["SamplePart", ["x"], -1, [-1, 0]],
        "y": ["Part", ["now"], 2000, [0, 1000]],
    }
    inputs = {"x": {"dim": 2000, "sw": [-1, 0]}}
    file = tmp_path / "model.json"
    file.write_text(json.dumps(saved(Inputs=inputs, Relations=relations)), encoding="utf-8")
    with pytest.raises(SpecError) as caught:
        import_nnodely(file)
    (found,) = caught.value.diagnostics
    assert found.code == "E1317"
    assert found.help is not None
    assert found.help.startswith("where the reason is a limit, make the model smaller")
    assert [path.name for path in tmp_path.iterdir()] == ["model.json"]


def test_nothing_that_exists_is_replaced(tmp_path: Path) -> None:
    file = tmp_path / "model.json"
    file.write_text(json.dumps(saved()), encoding="utf-8")
    for there in ("model.msnn.yaml", "model.safetensors"):
        (tmp_path / there).write_text("mine", encoding="utf-8")
        with pytest.raises(SpecError) as caught:
            import_nnodely(file)
        assert caught.value.diagnostics[0].code == "E1316"
        assert (tmp_path / there).read_text(encoding="utf-8") == "mine"
        (tmp_path / there).unlink()
        assert [path.name for path in tmp_path.iterdir()] == ["model.json"]


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "model.json"
    file.write_bytes(b"\xff\xfe{}")
    with pytest.raises(SpecError) as caught:
        import_nnodely(file)
    assert caught.value.diagnostics[0].code == "E1308"


def test_names_that_a_spec_cannot_have_are_changed_and_said(tmp_path: Path) -> None:
    names = ["dt", "sin", "x dot", "class", "1st", "größe", "a\nb", "", "${HOME}", "x" * 300]
    inputs = {name: {"dim": 1, "sw": [-1, 0]} for name in names}
    relations: dict[str, list[Any]] = {}
    total = None
    for i, name in enumerate(names):
        relations[f"part {i}"] = ["SamplePart", [name], -1, [-1, 0]]
        if total is not None:
            relations[f"sum: {i}"] = ["Add", [total, f"part {i}"]]
        total = f"part {i}" if total is None else f"sum: {i}"
    file = tmp_path / "model.json"
    text = json.dumps(saved(Inputs=inputs, Relations=relations, Outputs={"# out": total}))
    file.write_text(text, encoding="utf-8")
    written = import_nnodely(file)
    said = [warning for warning in written.warnings if warning.code == "W1305"]
    assert len(said) == len(names) + 1
    assert len(set(written.model.names["input"].values())) == len(names)


def test_a_window_that_is_no_whole_number_of_samples_is_said() -> None:
    relations = {
        "now": ["TimePart", ["x"], -1, [-0.25, 0]],
        "y": ["Mul", ["now", "c"]],
    }
    found = imported_text(saved(Inputs={"x": {"dim": 1, "tw": [-0.25, 0]}}, Relations=relations))
    assert [warning.code for warning in found.warnings] == ["W1306"]
    assert found.spec["outputs"] == {"out": "x.past(2) * c"}


def test_code_in_texts_is_never_run(tmp_path: Path) -> None:
    trap = tmp_path / "run"
    code = f"def f(x, y=open({str(trap)!r}, 'w')):\n    return x\n"
    assert _first(with_function(code)).code == "E1313"
    opened = f"open({str(trap)!r}, 'w')"
    assert _first(with_function(opened)).code == "E1313"
    assert _first(with_function("def f(x):\n    return x\n", opened)).code == "E1313"
    assert _first(with_function(f"def f(x):\n    return {opened}\n")).code == "E1313"
    assert not trap.exists()


SAVED = [record.model for record in recorded("layers").values()]
ODD = [None, True, -1, 0, 1e308, "", "x", [], {}, [[]], [1, 2], {"a": 1}, "SampleTime", 3.5]


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_any_change_of_a_model_is_read_or_refused(data: st.DataObject) -> None:
    model: Any = json.loads(data.draw(st.sampled_from(SAVED)))
    spot = model
    while True:
        keys = list(spot) if isinstance(spot, dict) else list(range(len(spot)))
        key = data.draw(st.sampled_from(keys))
        inner = spot[key]
        if not inner or not isinstance(inner, dict | list) or data.draw(st.booleans()):
            break
        spot = inner
    spot[key] = data.draw(st.sampled_from(ODD))
    codes: list[str] = []
    try:
        imported_text(model)
    except SpecError as refused:
        codes = [one.code for one in refused.diagnostics]
    assert set(codes) <= {f"E13{n:02d}" for n in range(8, 18)}


def test_a_folder_without_a_name_is_named_as_it_was_written() -> None:
    with pytest.raises(SpecError, match=r"`?\.`? is no saved model: is a directory"):
        import_nnodely(".")


@pytest.mark.parametrize(
    ("change", "repair"),
    [
        (
            _part("Relations", "y", value=["NeuralODE", ["now"], "F"]),
            "write `states: {x: {der: …}}`",
        ),
        (_part("Relations", "y", value=["Fir", ["now"], "c", None, 2]), "take 0 … 1, without 1"),
        (_part("Relations", "y", value=["Fir", ["now"], 7]), "save it anew by `saveModel`"),
        (_part("Relations", "y", value=["ParamFun", ["now"], "F", 1]), "name one function"),
        (
            _part("Minimizers", value={"l": {"A": "y", "B": "y", "loss": "eval"}}),
            "train for `mse`, `rmse`, `mae` or `cross_entropy`",
        ),
    ],
)
def test_what_specs_do_not_express_has_a_repair_of_its_own(
    change: Callable[[dict[str, Any]], None], repair: str
) -> None:
    model = saved()
    change(model)
    found = _first(model)
    assert found.code == "E1312"
    assert (found.help or "").startswith(repair)
