"""Plug-ins are found when a name is not ours, named when they fail, and needed by their files."""

from __future__ import annotations

import importlib.metadata
import json
import re
from pathlib import Path

import pytest

from msnn.api.models import load
from msnn.cli.application import run
from msnn.errors.failures import MissingExtraError
from msnn.model.program_file import write_program_file
from spec_schema import plugins
from spec_schema.diagnostics.diagnostic import SpecError
from spec_schema.reading.reader import read_spec
from spec_schema.reading.settings import workflow
from tests.extending.conftest import Install

PLAIN = (
    "msnn: 1\nname: plain\nsample_time: 1 s\ninputs: {u: {range: [-1, 1]}}\n"
    "parameters: {k: 2.0}\noutputs: {y: k * u}\n"
)
BUDGET = f"{PLAIN}budget: {{operations: 20}}\n"
RECORD = """
from msnn.extending import Entry, Feature, LateEntry, LateObject, Section, SectionLine

class Keys(Entry):
    pass

SECTION = Section(compile=print, text=print)
FEATURE = Feature(name="stranger", sections=(
    SectionLine("{key}", LateEntry("{module}", "Keys"), LateObject("{module}", "SECTION"), ""),
))
"""

TARGET = """
from types import SimpleNamespace
from msnn.extending import Feature, LateEntry, LateObject, TargetEntry, TargetLine

class Keys(TargetEntry):
    pass

TARGET = SimpleNamespace(name="{name}")
FEATURE = Feature(name="stranger", targets=(
    TargetLine("{key}", LateEntry(__name__, "Keys"), LateObject(__name__, "TARGET"), "", "", ""),
))
"""

VERB = """
from msnn.extending import Feature, LateObject, VerbLine

FEATURE = Feature(name="a", verbs=(VerbLine("weigh", "", LateObject(__name__, "{command}")),))
"""


def spec_file(folder: Path, text: str) -> Path:
    file = folder / "m.msnn.yaml"
    file.write_text(text)
    return file


@pytest.fixture
def no_look_up(monkeypatch: pytest.MonkeyPatch) -> None:
    entry_points = importlib.metadata.entry_points

    def refuse(**wanted: str) -> object:
        # pydantic looks for plug-ins of its own
        assert wanted.get("group") != plugins.GROUP, "entry points were looked up"
        return entry_points(**wanted)

    plugins.forget()
    monkeypatch.setattr(importlib.metadata, "entry_points", refuse)


@pytest.mark.usefixtures("no_look_up")
def test_a_spec_of_our_names_looks_up_nothing(tmp_path: Path):
    file = spec_file(tmp_path, f"{PLAIN}x-note: mine\nexport: {{c: {{}}}}\n")
    assert run(["check", str(file), "--set", "export.c.dtype=float32"]) == 0
    assert run(["show", str(file)]) == 0
    assert run(["check", "--help"]) == 0
    assert run(["--version"]) == 0
    out = str(tmp_path / "out")
    assert run(["export", str(file), "--initial", "--to", "c", "--out", out]) == 0


@pytest.mark.parametrize(
    ("text", "settings"),
    [
        (f"{PLAIN}budget: {{}}\n", ()),
        (f"{PLAIN}export: {{datasheet: {{}}}}\n", ()),
        (PLAIN, ("budget.operations=3",)),
        (PLAIN, ("export.datasheet.dtype=float32",)),
    ],
)
@pytest.mark.usefixtures("no_look_up")
def test_a_name_that_is_not_ours_is_looked_up(text: str, settings: tuple[str, ...], tmp_path: Path):
    with pytest.raises(AssertionError, match="looked up"):
        read_spec(spec_file(tmp_path, text), settings=settings)


@pytest.mark.usefixtures("example")
def test_a_section_of_a_plugin_is_compiled_and_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    file = spec_file(tmp_path, BUDGET)
    assert run(["show", str(file)]) == 0
    assert "budget: 3 of 20 operations" in capsys.readouterr().out
    assert run(["check", str(file), "--set", "budget.operations=2"]) == 1
    assert "a step has 3 operations, and the budget is 2" in capsys.readouterr().err
    assert "budget" in workflow()
    # a second reading finds the key without another look-up, and an unknown one stays unknown
    assert run(["check", str(file), "--set", "budget.work=2"]) == 1
    assert "unknown key `work` in the budget" in capsys.readouterr().err


@pytest.mark.usefixtures("install")
def test_a_section_of_no_plugin_is_an_unknown_key(tmp_path: Path):
    with pytest.raises(SpecError) as caught:
        load(spec_file(tmp_path, BUDGET))
    assert [found.code for found in caught.value.diagnostics] == ["E0201"]


@pytest.mark.usefixtures("example")
def test_tools_know_the_keys_of_plugins(capsys: pytest.CaptureFixture[str]):
    assert run(["schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert "budget" in schema["properties"]
    plugins.forget()
    assert run(["schema"]) == 0
    assert "budget" in json.loads(capsys.readouterr().out)["properties"]


@pytest.mark.usefixtures("example")
def test_doctor_lists_all_that_plugins_bring(capsys: pytest.CaptureFixture[str]):
    brings = [
        ("format", ".jsonl"),
        ("format", ".ndjson"),
        ("function", "lerp"),
        ("layer", "dead_zone"),
        ("section", "budget"),
        ("target", "datasheet"),
        ("verb", "operations"),
    ]
    assert run(["doctor"]) == 0
    listed = ", ".join(f"{kind} {name}" for kind, name in brings)
    assert re.search(f"^msnn-example +0.1.0 +plug-in: {listed}$", capsys.readouterr().out, re.M)
    assert run(["doctor", "--format", "json"]) == 0
    assert json.loads(capsys.readouterr().out)["plugins"] == [
        {
            "package": "msnn-example",
            "version": "0.1.0",
            "brings": [{"kind": kind, "name": name} for kind, name in brings],
        }
    ]


def test_a_plugin_that_is_gone_leaves_no_key(
    example: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    plugins.look_up()
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda **wanted: ())
    plugins.forget()
    assert run(["schema"]) == 0
    assert "budget" not in json.loads(capsys.readouterr().out)["properties"]


OURS = "msnn has a section or a word of its own with this name"


@pytest.mark.parametrize(
    ("key", "reason"),
    [
        *((key, OURS) for key in ("train", "mpc", "checks", "of", "model_fields")),
        ("x-mine", "it is no name, which has letters, digits and `_`"),
        ("", "it is no name, which has letters, digits and `_`"),
        ("budget", "the package msnn-example has this section already"),
    ],
)
def test_a_name_that_is_taken_is_left_out_with_a_warning(
    key: str, reason: str, example: None, install: Install, tmp_path: Path
):
    record = RECORD.format(key=key, module="stranger")
    install("stranger", {"stranger.py": record}, "stranger:FEATURE")
    found = plugins.look_up()
    (warning,) = found.warnings
    assert warning.code == "W0222"
    assert warning.message == (f"the section `{key}` of the package stranger is left out: {reason}")
    # the others work
    assert load(spec_file(tmp_path, BUDGET)).problems.keys() == {"budget"}


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("raise RuntimeError('no licence')", "RuntimeError: no licence"),
        ("print('{}')\nraise RuntimeError('printed')", "RuntimeError: printed"),
        ("import not_there_at_all", "ModuleNotFoundError"),
        ("raise SystemExit(3)", "SystemExit: 3"),
        ("FEATURE = 3", "is no `msnn.extending.Feature`"),
        ("", "has no attribute 'FEATURE'"),
        ("FEATURE = (", "SyntaxError"),
        (RECORD.format(key="fine", module="gone"), "No module named 'gone'"),
        (
            "from msnn.extending import Feature\nFEATURE = Feature(name='a', sections=3)",
            "`sections` of its record is no tuple of SectionLine",
        ),
        (
            RECORD.format(key="fine", module="broken").replace("sections=", "layers="),
            "`layers` of its record is no tuple of LayerLine",
        ),
        (
            RECORD.format(key="fine", module="broken").replace('"Keys")', '"SECTION")'),
            "`broken:SECTION` is no class with the base Entry",
        ),
        (
            RECORD.format(key="fine", module="broken").replace("    pass", "    size: 'Gone'"),
            "name 'Gone' is not defined",
        ),
        (TARGET.format(key="fine", name="other"), "the target of the line `fine` has another name"),
        (
            VERB.format(command="VerbLine"),
            "the verb of the line `weigh` is no function and no typer.Typer",
        ),
    ],
)
def test_a_plugin_that_fails_is_named_and_left_out(
    text: str,
    reason: str,
    example: None,
    install: Install,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
):
    install("broken", {"broken.py": text}, "broken:FEATURE")
    assert run(["check", str(spec_file(tmp_path, BUDGET))]) == 0
    said = capsys.readouterr().err
    (warning,) = plugins.look_up().warnings
    part = "the (plug-in `example`|(section|target) `fine`|verb `weigh`)"
    assert re.match(f"{part} of the package broken is left out: ", warning.message)
    assert f"warning[W0222]: {warning.message}" in said
    assert reason in said
    assert "Traceback" not in said
    assert "broken" in plugins.look_up().failed


def test_a_module_that_fails_takes_its_own_names_along_alone(
    install: Install, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    lines = "".join(
        f"    SectionLine('{key}', LateEntry('{module}', 'Keys'), LateObject('{module}',"
        " 'SECTION'), ''),\n"
        for key, module in (("bad", "gone"), ("fine", "stranger"))
    )
    record = f"{RECORD.format(key='first', module='stranger')}"
    record = record.replace("FEATURE = Feature(", f"LINES = (\n{lines})\nFEATURE = Feature(")
    record = record.replace("sections=(", "sections=(*LINES,")
    install("stranger", {"stranger.py": record}, "stranger:FEATURE")
    (warning,) = plugins.look_up().warnings
    assert warning.message == (
        "the section `bad` of the package stranger is left out: ModuleNotFoundError: "
        "No module named 'gone'"
    )
    (found,) = plugins.known_plugins()
    assert found.keys == {("section", "fine"), ("section", "first")}
    assert plugins.look_up().failed == {}
    assert run(["check", str(spec_file(tmp_path, f"{PLAIN}bad: {{}}\n"))]) == 1
    said = capsys.readouterr().err
    assert warning.message in said
    assert "unknown key `bad`" in said


def test_a_target_cannot_be_called_all(install: Install):
    install("stranger", {"stranger.py": TARGET.format(key="all", name="all")}, "stranger:FEATURE")
    (warning,) = plugins.look_up().warnings
    assert warning.message.endswith("is left out: `all` means every target of msnn")


def test_a_name_that_a_package_brings_twice_is_left_out(install: Install):
    text = RECORD.format(key="fine", module="stranger").replace("sections=(", "sections=2 * (")
    install("stranger", {"stranger.py": text}, "stranger:FEATURE")
    (warning,) = plugins.look_up().warnings
    assert warning.message.endswith("is left out: the package brings it twice")


def test_a_program_file_names_the_package_that_is_missing(example: None, tmp_path: Path):
    model = load(spec_file(tmp_path, BUDGET))
    file = write_program_file(model, tmp_path)
    kept = json.loads(file.read_text())
    assert kept["plugins"] == [{"package": "msnn-example", "version": "0.1.0"}]
    assert load(file).problems.keys() == {"budget"}
    assert "plugins" not in json.loads(write_program_file(_plain(tmp_path), tmp_path).read_text())


def _plain(folder: Path):
    return load(spec_file(folder, PLAIN))


def test_files_of_a_missing_plugin_say_which_package_is_needed(
    example: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    rows = "".join(f"{k / 10},{k / 5}\n" for k in range(-9, 10))
    (tmp_path / "log.csv").write_text(f"u,z\n{rows}")
    text = BUDGET.replace("{y: k * u}", "{y: {expr: k * u, predicts: 'z[t]'}}\ntargets: {z: {}}")
    text += "data: {source: {train: log.csv}}\ntrain: [{epochs: 1}]\n"
    file = spec_file(tmp_path, text)
    program = write_program_file(load(file), tmp_path)
    assert run(["train", str(file), "--out", str(tmp_path / "run")]) == 0
    (record,) = tmp_path.glob("run/**/run.json")
    assert json.loads(record.read_text())["plugins"] == {"msnn-example": "0.1.0"}
    load(record.parent)
    monkeypatch.setattr(importlib.metadata, "entry_points", lambda **wanted: ())
    plugins.forget()
    for made in (program, record.parent):
        with pytest.raises(MissingExtraError, match=r"the plug-in msnn-example 0.1.0, which"):
            load(made)
