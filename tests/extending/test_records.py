"""Runs, program files and exports name the plug-ins that they need, and so do their readers."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from backends.files.export_identity import read_manifest
from msnn.api.models import load
from msnn.cli.application import run
from msnn.errors.failures import MissingExtraError
from msnn.model.program_file import write_program_file
from msnn.model.weights.weights_file import given_weights
from tests.conditions import require_tool
from tests.extending.conftest import Install
from tests.extending.test_plugins import BUDGET, PLAIN, spec_file
from tests.verification.test_files_check import findings

DATA = """targets: {z: {}}
data: {source: {train: log.csv}}
train: [{epochs: 1}]
validate: [{of: y}]
"""
LEARNS = BUDGET.replace("{y: k * u}", "{y: {expr: k * u, predicts: 'z[t]'}}") + DATA
NAMED = {"msnn-example": "0.1.0"}
RUN, PROGRAM = "{run}", "plain.program.json"


@pytest.fixture
def trained(example: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The run of a spec with a section of a plug-in; the working folder has the spec."""
    require_tool("gcc", install="apt install gcc")
    rows = "".join(f"{k / 10},{k / 5}\n" for k in range(-9, 10))
    (tmp_path / "log.csv").write_text(f"u,z\n{rows}")
    monkeypatch.chdir(tmp_path)
    assert run(["train", str(spec_file(tmp_path, LEARNS)), "--out", "runs"]) == 0
    (record,) = tmp_path.glob("runs/plain/2*/run.json")
    return record.parent


def test_a_run_names_its_plugins(trained: Path, capsys: pytest.CaptureFixture[str]):
    assert json.loads((trained / "run.json").read_text())["plugins"] == NAMED
    capsys.readouterr()
    assert run(["show", str(trained)]) == 0
    assert "plug-ins      msnn-example 0.1.0\n" in capsys.readouterr().out
    assert run(["show", str(trained), "--format", "json"]) == 0
    assert json.loads(capsys.readouterr().out)["run"]["plugins"] == NAMED
    assert run(["report", str(trained), "--out", "page.html"]) == 0
    assert "msnn-example 0.1.0" in Path("page.html").read_text(encoding="utf-8")


def test_a_run_of_no_plugin_names_none(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    text = LEARNS.replace("budget: {operations: 20}\n", "")
    assert run(["train", str(spec_file(tmp_path, text)), "--out", "others"]) == 0
    (other,) = tmp_path.glob("others/plain/2*/run.json")
    assert "plugins" not in json.loads(other.read_text())
    capsys.readouterr()
    assert run(["show", str(other.parent)]) == 0
    assert "plug-ins" not in capsys.readouterr().out
    assert run(["diff", str(other.parent), str(trained), "--format", "json"]) == 1
    assert json.loads(capsys.readouterr().out)["plugins"] == [
        {"package": "msnn-example", "old": None, "new": "0.1.0"}
    ]


def test_another_version_is_accepted_and_said(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    record = trained / "run.json"
    changed = json.loads(record.read_text()) | {"plugins": {"msnn-example": "0.0.9"}}
    before = tmp_path / "before"
    trained.rename(before)
    (before / "run.json").write_text(json.dumps(changed))
    assert run(["train", "m.msnn.yaml", "--out", "runs"]) == 0
    (now,) = tmp_path.glob("runs/plain/2*")
    capsys.readouterr()
    assert run(["show", str(before)]) == 0
    assert "plug-ins      msnn-example 0.0.9 (0.1.0 is installed)\n" in capsys.readouterr().out
    # a plug-in changes no key of the spec
    assert run(["diff", str(before), str(now)]) == 0
    assert "plug-in       old    new\nmsnn-example  0.0.9  0.1.0\n" in capsys.readouterr().out
    assert run(["diff", str(now), str(now)]) == 0
    assert "plug-in" not in capsys.readouterr().out


GAIN = """
from msnn.extending import Feature, FunctionLine, LateObject, Signature

def expand(builder, value):
    return builder.multiply(value, builder.constant({factor}))

FEATURE = Feature(name="gain", functions=(
    FunctionLine("gain", Signature(1, 1, doc=""), LateObject("gain", "expand")),
))
"""
LEARNS_GAIN = LEARNS.replace("budget: {operations: 20}\n", "").replace("k * u", "gain(k * u)")


@pytest.fixture
def gained(install: Install, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The run of a spec with a function of version 1.0, of which now 2.0 is installed."""
    require_tool("gcc", install="apt install gcc")
    rows = "".join(f"{k / 10},{k / 5}\n" for k in range(-9, 10))
    (tmp_path / "log.csv").write_text(f"u,z\n{rows}")
    monkeypatch.chdir(tmp_path)
    install("gain", {"gain.py": GAIN.format(factor=1.0)}, "gain:FEATURE", "1.0")
    assert run(["train", str(spec_file(tmp_path, LEARNS_GAIN)), "-q"]) == 0
    install("gain", {"gain.py": GAIN.format(factor=2.0)}, "gain:FEATURE", "2.0")
    (record,) = tmp_path.glob("runs/plain/2*/run.json")
    return record.parent


WEIGHTS = "{weights}"


@pytest.mark.parametrize(
    "words",
    [
        ["validate", RUN],
        ["simulate", RUN, "--out", "simulated.csv"],
        ["export", RUN, "--to", "c", "--out", "out"],
        ["train", RUN],
        ["diff", RUN, "m.msnn.yaml"],
        ["diff", "m.msnn.yaml", RUN],
        ["report", RUN, "--out", "page.html"],
        ["check", RUN],
        ["validate", "m.msnn.yaml", "--weights", WEIGHTS],
        ["export", "m.msnn.yaml", "--to", "c", "--out", "out"],
    ],
    ids=" ".join,
)
def test_commands_warn_of_another_version(
    words: list[str], gained: Path, capsys: pytest.CaptureFixture[str]
):
    meant = {RUN: str(gained), WEIGHTS: str(gained / "weights.safetensors")}
    capsys.readouterr()
    assert run([meant.get(word, word) for word in words]) == 0
    said = capsys.readouterr().err
    assert said.count("warning[W0956]") == 1
    assert "with gain 1.0, and 2.0 is installed: results may differ" in said
    assert "help: install gain 1.0 for the values of that time, or train again with 2.0" in said


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [("k: 2.0", "k: 2.0, j: 3.0", "E0911"), ("k: 2.0", "j: 3.0", "E0959")],
)
def test_weights_that_do_not_fit_name_both_versions(
    old: str, new: str, code: str, gained: Path, capsys: pytest.CaptureFixture[str]
):
    # outside of the spec's text: weights are compared with the arrays that the model has now
    (gained / "spec.msnn.yaml").unlink()
    text = LEARNS_GAIN.replace(old, new).replace("k * u", f"{new[0]} * u")
    if code == "E0911":
        text = text.replace("k * u", "k * u * j")
    spec = str(spec_file(gained.parents[2], text))
    assert run(["validate", spec, "--weights", str(gained / "weights.safetensors")]) == 1
    said = capsys.readouterr().err
    assert f"error[{code}]" in said
    assert "note: it was trained with gain 1.0, and 2.0 is installed" in said
    assert "help: install gain 1.0, or train again with 2.0" in said


def test_a_program_file_names_its_plugins(trained: Path, capsys: pytest.CaptureFixture[str]):
    assert run(["compile", "m.msnn.yaml", "--out", "old"]) == 0
    file = Path("old/plain.program.json")
    kept = json.loads(file.read_text())
    assert kept["plugins"] == [{"package": "msnn-example", "version": "0.1.0"}]
    kept["plugins"][0]["version"] = "0.0.9"
    file.write_text(json.dumps(kept))
    capsys.readouterr()
    assert run(["diff", str(file), "m.msnn.yaml"]) == 0
    captured = capsys.readouterr()
    assert "plug-in       old    new\nmsnn-example  0.0.9  0.1.0\n" in captured.out
    # its program is that of the file, but the section of the plug-in is compiled anew
    assert "warning[W0956]: old/plain.program.json was made with msnn-example 0.0.9" in captured.err


@pytest.mark.parametrize(
    ("options", "folder"), [([], "c"), (["--set", "export.c.dtype=q15"], "c"), ([], "datasheet")]
)
def test_manifests_name_the_plugins(
    options: list[str], folder: str, trained: Path, capsys: pytest.CaptureFixture[str]
):
    names = ["--to", folder, "--out", "out"]
    assert run(["export", str(trained), *names, *options]) == 0
    said = capsys.readouterr().out
    manifest = Path("out", folder, "manifest.sha256")
    text = manifest.read_text()
    assert text.startswith("# made by msnn 0.1.0 with msnn-example 0.1.0\n")
    assert text.count("#") == 1
    files = {path for path in Path("out", folder).rglob("*") if path.is_file()}
    listed = {Path("out", folder, name) for name in read_manifest(manifest.parent)}
    assert listed == files - {manifest}
    assert f"{folder}: {len(files)} files" in said
    check = ["sha256sum", "--check", "--strict", "--quiet", manifest.name]
    subprocess.run(check, cwd=manifest.parent, check=True)
    if folder == "c":
        assert findings(manifest.parent) == ()


def test_a_manifest_without_plugins_is_plain(tmp_path: Path, example: None):
    file, out = spec_file(tmp_path, PLAIN), tmp_path / "out"
    assert run(["export", str(file), "--initial", "--to", "c", "--out", str(out)]) == 0
    assert "#" not in (out / "c" / "manifest.sha256").read_text()


@pytest.mark.parametrize(
    "words",
    [
        ["train", RUN, "--resume"],
        ["train", RUN],
        ["validate", RUN],
        ["simulate", RUN],
        ["export", RUN],
        ["report", RUN],
        ["show", RUN, "--program"],
        ["show", RUN, "--plot", "losses.svg"],
        ["compare", RUN],
        ["sweep", RUN, "--grid", "train.0.epochs=1,2"],
        ["data", RUN],
        ["diff", RUN, RUN],
        ["check", PROGRAM],
        ["train", PROGRAM],
        ["validate", PROGRAM],
        ["export", PROGRAM],
    ],
    ids=" ".join,
)
def test_readers_say_which_package_is_missing(
    words: list[str], trained: Path, remove: Callable[[], None], capsys: pytest.CaptureFixture[str]
):
    if PROGRAM in words:
        write_program_file(load("m.msnn.yaml"), Path())
    remove()
    assert run([str(trained) if word == RUN else word for word in words]) == 5
    said = capsys.readouterr().err
    needing = PROGRAM if PROGRAM in words else str(trained / "run.json")
    assert f"the plug-in msnn-example 0.1.0, which {needing} needs, is not installed" in said
    assert "help: pip install msnn-example" in said


def test_a_run_is_shown_without_its_plugin(
    trained: Path, remove: Callable[[], None], capsys: pytest.CaptureFixture[str]
):
    remove()
    assert run(["show", str(trained)]) == 0
    missing = "plug-ins      msnn-example 0.1.0 (not installed: pip install msnn-example)\n"
    assert missing in capsys.readouterr().out


def test_a_plugin_that_fails_is_not_called_missing(
    trained: Path, install: Install, capsys: pytest.CaptureFixture[str]
):
    install("msnn-example", {"broken.py": "raise ValueError('no licence')"}, "broken:FEATURE")
    assert run(["validate", str(trained)]) == 5
    said = capsys.readouterr().err
    assert "needs, does not work: ValueError: no licence\n" in said
    assert "help: install a version of msnn-example that fits this msnn" in said
    assert "not installed" not in said
    assert run(["show", str(trained)]) == 0
    assert "msnn-example 0.1.0 (it fails: ValueError: no licence)\n" in capsys.readouterr().out
    with pytest.raises(MissingExtraError, match="does not work"):
        load(trained)


OTHER = GAIN.replace('"gain", "expand"', '"aother", "expand"')
"""Another package with the function `gain`, before `gain` in the alphabet."""


@pytest.mark.parametrize(
    "words",
    [
        ["validate", RUN],
        ["simulate", RUN, "--out", "simulated.csv"],
        ["export", RUN, "--to", "c", "--out", "out"],
        ["train", RUN],
        ["report", RUN, "--out", "page.html"],
        ["check", RUN],
        ["validate", "m.msnn.yaml", "--weights", WEIGHTS],
        ["simulate", "m.msnn.yaml", "--out", "simulated.csv"],
        ["export", "m.msnn.yaml", "--to", "c", "--out", "out"],
    ],
    ids=" ".join,
)
def test_a_name_that_another_package_has_now_is_refused(
    words: list[str], gained: Path, install: Install, capsys: pytest.CaptureFixture[str]
):
    install("gain", {"gain.py": GAIN.format(factor=1.0)}, "gain:FEATURE", "1.0")
    install("aother", {"aother.py": OTHER.format(factor=3.0)}, "aother:FEATURE", "3.0")
    meant = {RUN: str(gained), WEIGHTS: str(gained / "weights.safetensors")}
    capsys.readouterr()
    assert run([meant.get(word, word) for word in words]) == 5
    said = capsys.readouterr().err
    assert "error[E1037]: the plug-in gain 1.0, which " in said
    assert "needs, does not work: the package aother 3.0 has the function `gain` now" in said
    assert "help: remove aother, or make the file again with it" in said
    assert not Path("simulated.csv").exists()
    assert not Path("out").exists()


@pytest.mark.parametrize("name", ["", "weights.safetensors"])
def test_weights_of_a_run_are_refused_in_python_if_another_package_has_a_name(
    name: str, gained: Path, install: Install
):
    install("gain", {"gain.py": GAIN.format(factor=1.0)}, "gain:FEATURE", "1.0")
    model = load("m.msnn.yaml")
    given_weights(model.program, gained / name)
    install("aother", {"aother.py": OTHER.format(factor=3.0)}, "aother:FEATURE", "3.0")
    model = load("m.msnn.yaml")
    with pytest.raises(MissingExtraError, match=r"aother 3\.0 has the function `gain` now"):
        given_weights(model.program, gained / name)


def test_a_name_that_moved_to_another_package_is_refused(
    gained: Path, install: Install, capsys: pytest.CaptureFixture[str]
):
    moved = GAIN.format(factor=1.0).replace('"gain", Sig', '"other_gain", Sig')
    install("gain", {"gain.py": moved}, "gain:FEATURE", "1.0")
    install("aother", {"aother.py": OTHER.format(factor=3.0)}, "aother:FEATURE", "3.0")
    with pytest.raises(MissingExtraError, match=r"aother 3\.0 takes its place now"):
        load(gained)


def test_the_other_package_of_a_name_is_refused_for_its_settings_too(
    trained: Path, install: Install
):
    other = """
from msnn.extending import Entry, Feature, LateEntry, LateObject, Section, SectionLine

class Keys(Entry):
    pass

SECTION = Section(compile=print, text=print)
FEATURE = Feature(name="aother", sections=(
    SectionLine("budget", LateEntry("aother", "Keys"), LateObject("aother", "SECTION"), ""),
))
"""
    write_program_file(load("m.msnn.yaml"), Path())
    install("aother", {"aother.py": other}, "aother:FEATURE", "3.0")
    for file in (trained, Path(PROGRAM)):
        with pytest.raises(MissingExtraError, match=r"aother 3\.0 has the section `budget` now"):
            load(file)


def test_another_package_that_has_no_name_of_the_run_is_accepted(
    gained: Path, install: Install, capsys: pytest.CaptureFixture[str]
):
    both = GAIN.replace(
        "    FunctionLine",
        """    FunctionLine("further", Signature(1, 1, doc=""),
        LateObject("gain", "expand")),
    FunctionLine""",
        1,
    ).format(factor=1.0)
    install("gain", {"gain.py": both}, "gain:FEATURE", "1.0")
    other = OTHER.replace('"gain", Sig', '"further", Sig').format(factor=3.0)
    install("aother", {"aother.py": other}, "aother:FEATURE", "3.0")
    capsys.readouterr()
    assert run(["validate", str(gained)]) == 0
    assert "aother" not in capsys.readouterr().err


@pytest.mark.parametrize("damaged", ["3", "[]", '["msnn-example"]', '{"x": null}', "null"])
def test_a_damaged_record_is_read(damaged: str, trained: Path, capsys: pytest.CaptureFixture[str]):
    file = trained / "run.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"plugins": json.loads(damaged)}))
    assert run(["show", str(trained)]) == 0
    code = run(["validate", str(trained)])
    assert code == (5 if "null}" in damaged else 0)
    assert "Traceback" not in capsys.readouterr().err
