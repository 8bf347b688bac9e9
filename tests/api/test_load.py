"""`msnn.load` takes paths, text and mappings, with settings as mappings or texts."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

import msnn

TEXT = """\
msnn: 1
name: gain
inputs: {u: V}
parameters: {k: {init: 2, unit: N/V}}
outputs: {y: {expr: k * u, unit: N}}
"""


def test_path_text_and_mapping_are_one_model(tmp_path: Path) -> None:
    path = tmp_path / "gain.msnn.yaml"
    path.write_text(TEXT)
    programs = [msnn.load(spec).program for spec in (path, str(path), TEXT, yaml.safe_load(TEXT))]
    texts = [program.outputs for program in programs]
    assert all(outputs == texts[0] for outputs in texts)
    assert programs[2] == programs[0]
    assert msnn.compile(TEXT) == programs[0]


def test_a_mapping_may_hold_numbers_of_numpy() -> None:
    spec = {**yaml.safe_load(TEXT), "parameters": {"k": {"init": np.float64(2.5), "unit": "N/V"}}}
    assert msnn.load(spec).program.parameter("k").initial == (2.5,)
    vector = {"dims": {"i": 3}, "parameters": {"k": {"init": np.arange(3), "dims": ("i",)}}}
    spec = {"msnn": 1, "name": "v", "inputs": {"u": {}}, **vector, "outputs": {"y": "sum(k) * u"}}
    assert msnn.load(spec).program.parameter("k").initial == (0.0, 1.0, 2.0)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), object()], ids=["nan", "inf", "object"])
def test_values_that_no_spec_can_hold_are_named(value: object) -> None:
    spec = {**yaml.safe_load(TEXT), "parameters": {"k": {"init": value}}}
    with pytest.raises(TypeError, match="a spec has no word for"):
        msnn.load(spec)


def test_mistakes_in_a_mapping_have_lines_to_show() -> None:
    with pytest.raises(msnn.SpecError) as caught:
        msnn.load({**yaml.safe_load(TEXT), "outputs": {"y": "kk * u"}})
    text = re.sub(r"\x1b\[[0-9;]*m", "", "\n".join(caught.value._render_traceback_()))
    assert "  y: kk * u" in text
    assert "help: did you mean `k`?" in text


def test_settings_are_a_mapping_or_texts() -> None:
    by_mapping = msnn.load(TEXT, {"parameters.k.init": 3.5, "parameters.k.doc": "a gain: yes"})
    by_texts = msnn.load(TEXT, ["parameters.k.init=3.5", 'parameters.k.doc="a gain: yes"'])
    assert by_mapping.program == by_texts.program
    assert by_mapping.program.parameter("k").initial == (3.5,)
    assert by_mapping.program.parameter("k").doc == "a gain: yes"
    with pytest.raises(msnn.SpecError, match="`kk`"):
        msnn.load(TEXT, {"parameters.kk.init": 3.5})


def test_the_grid_of_a_comparison_may_be_a_mapping(tmp_path: Path) -> None:
    path = tmp_path / "gain.msnn.yaml"
    path.write_text(
        TEXT.replace("unit: N}}", 'unit: N, predicts: "y_meas[t]"}}').replace(
            "u: V", "u: V, y_meas: N"
        )
        + "train: [{epochs: 1}]\nvalidate: [{of: y, metric: rmse}]\n"
    )
    u = np.linspace(-1, 1, 50)
    data = {name: {"u": u, "y_meas": 3 * u} for name in ("train", "val")}
    found = msnn.compare(path, grid={"train.0.epochs": [1, 3]}, data=data, runs=None, cost=False)
    assert found.to_frame()["model"].to_list() == ["epochs=3", "epochs=1"]
    assert repr(found).startswith("<Comparison: 2 models by y rmse")
    assert found._repr_html_().count("<tr>") == 3


def test_only_what_is_public_is_listed() -> None:
    assert dir(msnn) == sorted([*msnn.__all__, "__doc__", "__version__"])
