"""Grids: their values, and what variants are called."""

from __future__ import annotations

from pathlib import Path

import pytest

from msnn.features.comparison.variants import GridAxis, grid_axis, variants
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.reading.setting_values import one_form, setting_texts, shown_value, value_text


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("a.b=5,10, 20", ("5", "10", "20")),
        ("a.b=10 ms,0.5 s", ("10 ms", "0.5 s")),
        ("a.b=[1, 2],{c: [3, 4]}", ("[1, 2]", "{c: [3, 4]}")),
        ('a.b="x, y",z', ('"x, y"', "z")),
        ("a.b=k * u,k * u + c", ("k * u", "k * u + c")),
        ("a.b=true", ("true",)),
    ],
)
def test_values_are_yaml_between_commas(text: str, values: tuple[str, ...]):
    axis = grid_axis(text)
    assert (axis.path, axis.values) == ("a.b", values)


@pytest.mark.parametrize("text", ["", "a", "a=", "=1", "a=[1", "a=1\n2", "a=1]", "a={b: 1", "a=]["])
def test_what_is_no_path_and_values_is_refused(text: str):
    with pytest.raises(SpecError) as caught:
        grid_axis(text)
    assert [found.code for found in caught.value.diagnostics] == ["E0973"]


def test_every_choice_of_every_axis_is_a_variant():
    axes = [grid_axis("layers.f.fir.window=5,10"), grid_axis("train.0.epochs=1,2")]
    found = variants([Path("a.msnn.yaml")], axes, ["sample_time=1"])
    assert [each.label for each in found] == [
        "window=5 epochs=1",
        "window=5 epochs=2",
        "window=10 epochs=1",
        "window=10 epochs=2",
    ]
    assert found[3].settings == ("sample_time=1", "layers.f.fir.window=10", "train.0.epochs=2")


def test_labels_tell_paths_and_specs_apart():
    axes = [grid_axis("layers.f.fir.window=5"), grid_axis("layers.g.fir.window=6")]
    (found,) = variants([Path("a.msnn.yaml")], axes, [])
    assert found.label == "f.fir.window=5 g.fir.window=6"
    several = variants([Path("a.msnn.yaml"), Path("b.msnn.yaml")], [], [])
    assert [each.label for each in several] == ["a", "b"]
    alike = variants([Path("x/a.msnn.yaml"), Path("y/a.msnn.yaml")], [grid_axis("k.init=1")], [])
    assert [each.label for each in alike] == ["x/a.msnn.yaml init=1", "y/a.msnn.yaml init=1"]


def test_a_model_that_is_named_twice_is_one():
    found = variants([Path("a.msnn.yaml")] * 2, [grid_axis("k.init=1,1,2")], [])
    assert [each.label for each in found] == ["a init=1", "a init=2"]


def test_a_value_that_is_written_twice_is_one():
    """Two processes would train it in one folder."""
    found = variants([Path("a.msnn.yaml")], [grid_axis("k.init=0.1,1e-1,'0.1',0.10")], [])
    assert [each.settings for each in found] == [("k.init=0.1",), ("k.init='0.1'",)]


@pytest.mark.parametrize(
    ("text", "values", "labels"),
    [
        ("5,10", [5, 10], ["window=5", "window=10"]),
        ("1e-3,0.50", [1e-3, 0.5], ["window=0.001", "window=0.5"]),
        ("20 ms,adam", ["20 ms", "adam"], ["window=20 ms", "window=adam"]),
        ("true,null", [True, None], ["window=true", "window=null"]),
        ("[1,2],{lr: 1}", [[1, 2], {"lr": 1}], ["window=[1, 2]", 'window={"lr": 1}']),
    ],
)
def test_labels_do_not_tell_the_command_line_from_python(
    text: str, values: list[object], labels: list[str]
):
    of_text = grid_axis(f"layers.f.fir.window={text}")
    of_python = GridAxis("layers.f.fir.window", tuple(map(value_text, values)))
    for axis in (of_text, of_python):
        found = variants([Path("a.msnn.yaml")], [axis], [])
        assert [each.label for each in found] == labels


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("a=1e-3", 1e-3),
        ("a = 5", 5),
        ("a='20 ms'", "20 ms"),
        ('a="5"', "5"),
        ("a='true'", "true"),
        ("a='a: b # c'", "a: b # c"),
        ("a=[1, 0x10]", [1, 16]),
        ("a={b: c}", {"b": "c"}),
        ("a={b: [1.0, x]}", {"b": [1.0, "x"]}),
        ("a=", None),
        ("a=x", "x"),
    ],
)
def test_settings_have_one_form(setting: str, value: object):
    (of_python,) = setting_texts({"a": value})
    found = one_form(setting)
    assert found == one_form(of_python) == one_form(found)
    assert shown_value(found[2:]) == shown_value(setting.partition("=")[2])


def test_the_form_tells_texts_from_numbers():
    assert one_form("a='5'") == 'a="5"' != one_form("a=5")
    assert one_form("a=.inf") == "a=.inf"
    inside = "a={init: 1, max: .inf, b: [-.inf, .nan]}"
    assert one_form(inside) == 'a={"init": 1, "max": .inf, "b": [-.inf, .nan]}'
    assert one_form(one_form(inside)) == one_form(inside)
    assert one_form("no setting") == "no setting"


def test_one_number_and_one_path_have_one_form():
    """`1` and `1.0` of one key are one training, as are a path with quotes and without."""
    assert one_form("a=1.0") == one_form("a=1e0") == one_form('"a" = 1') == "a=1"
    assert one_form("a=[0.0, 2.50, 1e15]") == "a=[0, 2.5, 1000000000000000.0]"
    assert one_form("a=-0.0") == "a=-0.0" != one_form("a=0")
    assert one_form('"a: b"=1') == '"a: b"=1'  # without quotes it would be another key
    (only,) = variants([Path("a.yaml")], [grid_axis('"x.y"=1,1.0')], ())
    assert only.settings == ("x.y=1",)


def test_one_quantity_has_one_form():
    """`1 kg` and `1.0 kg` are one training; what is no quantity keeps its digits."""
    assert one_form("a=1.0 kg") == one_form("a='1e0kg'") == one_form("a = +1  kg") == "a=1 kg"
    assert one_form("a={init: 2.50 N/m, b: [1.0 s]}") == 'a={"init": "2.5 N/m", "b": ["1 s"]}'
    assert one_form("a=-0.0 m") == "a=-0.0 m" != one_form("a=0 m")
    for text in ("1.0 parrots", "1e999 kg", "a 1.0 kg", "1.0 kg of lead", "v1.0"):
        assert one_form(f"a={text}") == f"a={text}"
    assert one_form("a=1000 g") == "a=1000 g", "as it is written: rounding may tell units apart"
    (only,) = variants([Path("a.yaml")], [grid_axis("m=1 kg,1.0 kg,1e0 kg")], ())
    assert only.settings == ("m=1 kg",)
