"""Every code has its explanation; what it shows as wrong gets that code, what is repaired none."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from msnn.data.reading.load import load_data
from msnn.project.workflow_checks import checked_model
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError
from spec_schema.diagnostics.explain import FOLDER, Example, explain, known_codes
from tests.docs.diagnostics import all_messages
from tests.golden import assert_golden

MEANINGS = {message.code: message.meaning for message in all_messages()}
# An example shows what matters; the rest of its spec is this, where it says nothing else.
FRAME = {
    "msnn": "1",
    "name": "example",
    "sample_time": "0.1 s",
    "inputs": "{u: {}}",
    "outputs": "{y: u}",
}
PLANT = """
msnn: 1
name: plant
sample_time: 0.1 s
inputs: {u: V}
parameters: {k: 2}
outputs: {y: k * u}
"""
"""The sub-model `plant.yaml` that stands beside every example."""

_MASS = '<mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>'
ROBOT = f"""
<robot name="arm">
  <link name="base"/>
  <link name="upper"><inertial>{_MASS}</inertial></link>
  <link name="lower"><inertial>{_MASS}</inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/></joint>
</robot>
"""
"""The robot `robot.urdf` that stands beside every example."""

DATA = "{source: {train: data.csv}, time: time}"
RAN = [code for code in known_codes() if explain(code).examples]


def test_every_code_is_explained_and_nothing_else() -> None:
    missing = sorted(set(MEANINGS) - set(known_codes()))
    assert not missing, [f"write spec_schema/explanations/{code}.md" for code in missing]
    assert {path.stem for path in FOLDER.iterdir()} == set(known_codes()) == set(MEANINGS)


@pytest.mark.parametrize("code", MEANINGS)
def test_a_page_is_the_meaning_an_explanation_and_an_example(code: str, accept: bool) -> None:
    path = FOLDER / f"{code}.md"
    assert path.is_file(), f"write {path.relative_to(FOLDER.parents[1])}, as its neighbours are"
    page = path.read_text(encoding="utf-8")
    assert_golden(path, f"# {code}: {MEANINGS[code]}\n{page.partition(chr(10))[2]}", accept)
    explanation = explain(code)
    shown = [example.repaired for example in explanation.examples]
    assert shown == sorted(shown)
    assert (False in shown and True in shown) or "**For example**: " in page
    assert "```" not in explanation.text, "an example that is neither wrong nor repaired"
    about = page.split("\n\n")[1]
    assert len(about) > 40
    assert about.endswith(".")


def test_the_grammar_and_the_schema_are_explained_by_specs_that_run() -> None:
    """What a spec can do wrong is shown by one; but for files too large or odd to show."""
    odd = {"E0108", "E0113", "E0114", "E0119", "E0324", "E0325", "E0503"}
    odd |= {"E0732", "E0735", "W0742", "W0747"}  # which take several files, or one of weights
    odd |= {"E0353", "E0506", "W0744"}  # of an option of the command line, of a training
    odd |= {"E0230", "W0222"}  # of a package that is installed
    first = {code for code in MEANINGS if code[1:] < "0800"}
    unshown = "give spec_schema/explanations/CODE.md a wrong example and a repaired one"
    assert first - set(RAN) == odd, unshown


@pytest.mark.parametrize("code", RAN)
def test_the_wrong_example_gets_its_code_and_the_repaired_one_none(
    code: str, tmp_path: Path
) -> None:
    examples = explain(code).examples
    assert {d.code for d in _said_of(_files(examples, repaired=False), tmp_path)} == {code}
    assert _said_of(_files(examples, repaired=True), tmp_path) == ()


def test_a_code_may_be_written_small_and_a_wrong_one_is_none() -> None:
    assert explain(" e0301 ").code == "E0301"
    with pytest.raises(KeyError):
        explain("E3001")


def test_the_text_for_a_terminal() -> None:
    text = explain("E0301").text
    assert text.startswith(f"E0301: {MEANINGS['E0301']}\n\nEvery name")
    assert "\n\nWrong:\n\n    parameters: {k: 4}\n    outputs: {y: kk * u}\n\nRepaired:" in text
    assert max(map(len, text.splitlines())) <= 88


def _files(examples: tuple[Example, ...], *, repaired: bool) -> dict[str, str]:
    """The files of a situation; what the repaired one leaves out is as in the wrong one."""
    found = {example.language: example for example in examples if not example.repaired}
    if repaired:
        found |= {example.language: example for example in examples if example.repaired}
    files = {"data.csv": found["csv"].text} if "csv" in found else {}
    if "json" in found:
        return files | {"spec.json": found["json"].text}
    spec = found.get("yaml")
    text = spec.text if spec else ""
    if spec is None or not spec.whole:
        frame = FRAME | ({"data": DATA} if files else {})
        given = set(re.findall(r"^([a-z_]+):", text, re.MULTILINE))
        rest = [f"{key}: {value}\n" for key, value in frame.items() if key not in given]
        text = "".join(rest) + text
    return files | {"spec.yaml": text}


def _said_of(files: dict[str, str], folder: Path) -> tuple[Diagnostic, ...]:
    for name, text in (files | {"plant.yaml": PLANT, "robot.urdf": ROBOT}).items():
        (folder / name).write_text(text, encoding="utf-8")
    path = next(folder / name for name in files if name.startswith("spec."))
    try:
        model = checked_model(path)
        if "data.csv" not in files:
            return model.warnings
        assert model.spec.data is not None
        data = load_data(model.program, model.spec.data, folder)
    except SpecError as error:
        return error.diagnostics
    return (*model.warnings, *data.warnings)
