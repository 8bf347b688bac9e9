"""`verify` sees which export a folder holds, and every change of its files."""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from backends.files.export_identity import MANIFEST, read_manifest
from msnn.cli.application import run
from msnn.features.control.verification.exported_controller import read_exported_controller
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights, write_weights
from msnn.verification.exported_c import files_check, read_exported_c

SPEC = """
msnn: 1
name: plant
sample_time: 1 s
inputs:
  u: {range: [-1, 1]}
parameters:
  k: 0.5
states:
  x: {next: k * x + u, init: 0, range: [-3, 3]}
outputs:
  y: 3 * x
"""
CONTROL = """
mpc:
  horizon: 4
  controls: [u]
  cost: {stage: x ** 2 + 0.1 * u ** 2}
"""

BOTH = (
    SPEC.replace("parameters:", "targets: {p: {}}\nparameters:").replace(
        "y: 3 * x", "y: {expr: 3 * x, predicts: 'p[t]'}"
    )
    + CONTROL
    + "estimator: {ekf: {measured: {y: 0.1}, process: {x: 0.1}, initial: {x: 1}}}\n"
)


def exported(folder: Path, *words: str, k: float = 0.5, spec: str = SPEC, to: str = "c") -> Path:
    folder.mkdir(parents=True)
    path = folder / "plant.msnn.yaml"
    path.write_text(spec, encoding="utf-8")
    program = load_model(path).program
    weights = initial_weights(program) | {"k": np.array(k)}
    write_weights(folder / "w.safetensors", weights, program)
    given = ["--weights", str(folder / "w.safetensors")]
    assert run(["export", str(path), *given, "--to", to, "--out", str(folder), *words]) == 0
    return folder / to


def findings(folder: Path) -> tuple[str, ...]:
    model = read_exported_controller(folder) or read_exported_c(folder)
    check = files_check(model, model.identities)
    return check.result(folder.parent / "check").findings


def identities(folder: Path) -> set[str]:
    """What stands in each place that names the export."""
    texts = {
        "header": (folder / "include" / "plant.h").read_text(),
        "A2L": (folder / "plant.a2l").read_text(),
        "JSON": (folder / "plant.json").read_text(),
    }
    patterns = {
        "header": r'PLANT_EXPORT_SHA256 \\\n\s+"(\w{64})"',
        "A2L": r'EPK "(\w{64})"',
        "JSON": r'"export_sha256": "(\w{64})"',
    }
    return {re.findall(patterns[place], text)[0] for place, text in texts.items()}


@pytest.mark.parametrize("dtype", ["float32", "float64", "q15"])
def test_the_identity_of_an_export_has_program_weights_and_options(
    dtype: str, tmp_path: Path
) -> None:
    option = ("--set", f"export.c.dtype={dtype}")
    found = [
        identities(exported(tmp_path / "a", *option)),
        identities(exported(tmp_path / "same", *option)),
        identities(exported(tmp_path / "weights", *option, k=0.25)),
        identities(exported(tmp_path / "program", *option, spec=SPEC.replace("3 * x", "4 * x"))),
        identities(exported(tmp_path / "options", *option, "--set", "export.c.prefix=plant")),
    ]
    assert all(len(places) == 1 for places in found)
    assert found[0] == found[1] == found[4]  # the prefix is that of the model anyway
    assert len({*map(str, found)}) == 3
    if dtype != "q15":
        unrolled = identities(exported(tmp_path / "unroll", *option, "--set", "export.c.unroll=1"))
        inlined = identities(
            exported(tmp_path / "inline", *option, "--set", "export.c.params=inline")
        )
        assert inlined not in found
        assert unrolled == found[0] or unrolled not in found


def test_what_is_compiled_has_the_identity(tmp_path: Path) -> None:
    about = (exported(tmp_path / "a") / "src" / "plant_about.c").read_text()
    assert "const char plant_export_sha256[65] = PLANT_EXPORT_SHA256;" in about


def test_a_unit_has_the_identity_as_its_version(tmp_path: Path) -> None:
    versions = list[str]()
    for name, k in (("a", 0.5), ("b", 0.25)):
        folder = exported(tmp_path / name, k=k, to="fmu")
        for unit in sorted(folder.glob("*.fmu")):
            with zipfile.ZipFile(unit) as archive:
                description = archive.read("modelDescription.xml").decode()
                header = archive.read("sources/plant.h").decode()
            (version,) = re.findall(r' version="(\w{64})"', description)
            assert version in header
            versions.append(version)
    assert len(versions) == 4
    assert len({*versions}) == 2  # both versions of FMI hold the same C


def changed(path: str, old: str, new: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        text = (folder / path).read_text()
        assert old in text
        (folder / path).write_text(text.replace(old, new, 1))

    return change


CHANGES: dict[str, tuple[Callable[[Path], object], str]] = {
    "the header's hash": (
        changed("include/plant.h", 'EXPORT_SHA256 \\\n    "', 'EXPORT_SHA256 \\\n    "0'),
        "include/plant.h was changed after it was exported",
    ),
    "the header's hash of the spec": (
        changed("include/plant.h", 'SPEC_SHA256 \\\n    "', 'SPEC_SHA256 \\\n    "0'),
        "include/plant.h was changed after it was exported",
    ),
    "a range in the JSON": (
        changed("plant.json", "-3.0", "-4.0"),
        "plant.json was changed after it was exported",
    ),
    "a name in the A2L": (
        changed("plant.a2l", "plant.y", "plant.z"),
        "plant.a2l was changed after it was exported",
    ),
    "a weight": (
        changed("src/plant_params.c", "0.5f", "0.6f"),
        "src/plant_params.c was changed after it was exported",
    ),
    "a file left out": (
        lambda folder: (folder / "CMakeLists.txt").unlink(),
        "CMakeLists.txt is missing",
    ),
    "a file that builds take": (
        lambda folder: (folder / "src" / "other.c").write_text(""),
        "src/other.c is no file of the export",
    ),
    "no manifest": (
        lambda folder: (folder / MANIFEST).unlink(),
        "manifest.sha256 is missing or damaged: export again",
    ),
    "an empty manifest": (
        lambda folder: (folder / MANIFEST).write_text("nothing\n"),
        "manifest.sha256 is missing or damaged: export again",
    ),
}


@pytest.mark.parametrize("name", CHANGES)
def test_every_change_of_a_file_is_found(name: str, tmp_path: Path) -> None:
    folder = exported(tmp_path / "a")
    assert findings(folder) == ()
    (tmp_path / "a" / "check").rmdir()
    change, finding = CHANGES[name]
    change(folder)
    assert findings(folder) == (finding,)


def test_a_manifest_made_again_does_not_hide_a_change(tmp_path: Path) -> None:
    folder = exported(tmp_path / "a")
    changed("plant.json", "-3.0", "-4.0")(folder)
    paths = [line[66:] for line in (folder / MANIFEST).read_text().splitlines()]
    hashes = {path: hashlib.sha256((folder / path).read_bytes()).hexdigest() for path in paths}
    (folder / MANIFEST).write_text("".join(f"{hashes[path]}  {path}\n" for path in paths))
    (finding,) = findings(folder)
    identity = json.loads((folder / "plant.json").read_text())["export_sha256"]
    assert re.fullmatch(
        rf"the files that manifest.sha256 lists have the identity \w{{12}}, their description "
        rf"{identity[:12]}: a file was changed, added or left out, and manifest.sha256 with it",
        finding,
    )


def test_a_file_that_is_left_out_with_its_line_is_missed(tmp_path: Path) -> None:
    folder = exported(tmp_path / "a")
    lines = (folder / MANIFEST).read_text().splitlines(keepends=True)
    (folder / MANIFEST).write_text("".join(line for line in lines if "README.md" not in line))
    (folder / "README.md").unlink()
    (finding,) = findings(folder)
    assert finding.startswith("the files that manifest.sha256 lists have the identity ")


def bsd(line: str) -> str:
    return f"SHA256 ({line[66:]}) = {line[:64]}"


SPELLINGS: dict[str, Callable[[str], str]] = {
    "capital letters": lambda line: line[:64].upper() + line[64:],
    "the mark of binary files": lambda line: f"{line[:64]} *{line[66:]}",
    "doubled lines": lambda line: f"{line}\n{line}",
    "doubled in two ways": lambda line: f"{line}\n{line[:64].upper()} *{line[66:]}",
    "comments": lambda line: f"# {line[66:]}\n{line}",
    "from the folder itself": lambda line: f"{line[:66]}./{line[66:]}",
    "one blank": lambda line: f"{line[:64]} {line[66:]}",
    "a blank in front": lambda line: f" {line}",
    "as BSD writes them": bsd,
    "a backslash for escapes": lambda line: f"\\{line}",
}


@pytest.mark.parametrize("how", SPELLINGS)
def test_a_manifest_that_sha256sum_accepts_is_accepted(how: str, tmp_path: Path) -> None:
    folder = exported(tmp_path / "a")
    lines = (folder / MANIFEST).read_text().splitlines()
    (folder / MANIFEST).write_text("".join(f"{SPELLINGS[how](line)}\n" for line in lines))
    asked = ["sha256sum", "--check", "--strict", MANIFEST]
    said = subprocess.run(asked, cwd=folder, check=False, capture_output=True, text=True)
    assert said.returncode == 0, said.stderr
    assert findings(folder) == ()
    (tmp_path / "a" / "check").rmdir()
    changed("src/plant_params.c", "0.5f", "0.6f")(folder)
    assert "src/plant_params.c was changed after it was exported" in findings(folder)


@pytest.mark.parametrize("several", [False, True])
def test_other_ends_of_lines_are_found_as_by_sha256sum(tmp_path: Path, several: bool) -> None:
    folder = exported(tmp_path / "a")
    listed = [folder / path for path in read_manifest(folder)]
    for path in listed if several else [folder / "src" / "plant.c"]:
        path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    (finding,) = findings(folder)
    assert "src/plant.c" in finding
    assert "CRLF at the ends of lines where the export has LF; `* -text`" in finding
    asked = ["sha256sum", "--check", "--quiet", MANIFEST]
    assert subprocess.run(asked, cwd=folder, check=False, capture_output=True).returncode == 1


@pytest.mark.parametrize(
    "path",
    [
        "../../../etc/hostname",
        "/etc/hostname",
        "/dev/zero",
        "C:/Windows/win.ini",
        "..\\secret",
        "src/../../w.safetensors",
        "link",
        "linked/hostname",
    ],
)
def test_no_file_outside_of_the_export_is_read(path: str, tmp_path: Path) -> None:
    """The right hash would say what a file has that its reader may not show."""
    folder = exported(tmp_path / "a")
    (folder / "link").symlink_to("/etc/hostname")
    (folder / "linked").symlink_to("/etc")
    digest = hashlib.sha256(Path("/etc/hostname").read_bytes()).hexdigest()
    with (folder / MANIFEST).open("a") as manifest:
        manifest.write(f"{digest}  {path}\n")
    assert findings(folder) == (f"{MANIFEST} names {path}, which is outside of the export",)
    for spelt in (f"{digest.upper()} *./{path}", bsd(f"{digest}  {path}"), f"\\{digest}  {path}"):
        (folder / MANIFEST).write_text(f"{spelt}\n")
        (tmp_path / "a" / "check").rmdir()
        said = findings(folder)
        assert len(said) > 0
        assert not any("was changed" in line for line in said)


def test_a_pipe_and_a_folder_of_somebody_else_are_not_read(tmp_path: Path) -> None:
    folder = exported(tmp_path / "a")
    (folder / "README.md").unlink()
    os.mkfifo(folder / "README.md")
    assert findings(folder) == ("README.md is missing",)
    (tmp_path / "a" / "check").rmdir()
    (folder / "src").rename(folder / "old")
    (folder / "src").symlink_to(tmp_path)
    assert all("outside of the export" in line or "missing" in line for line in findings(folder))


def test_a_path_has_one_hash(tmp_path: Path) -> None:
    folder = exported(tmp_path / "a")
    lines = (folder / MANIFEST).read_text()
    (folder / MANIFEST).write_text(f"{'0' * 64}  plant.json\n{lines}")
    assert findings(folder) == ("manifest.sha256 is missing or damaged: export again",)


def test_the_files_of_a_controller_are_compared_too(tmp_path: Path) -> None:
    folder = exported(tmp_path / "a", spec=SPEC + CONTROL, to="mpc")
    assert findings(folder) == ()
    other = exported(tmp_path / "b", spec=SPEC + CONTROL, to="mpc", k=0.25)
    texts = [(each / "include" / "plant_mpc.h").read_text() for each in (folder, other)]
    hashes = [re.findall(r'EXPORT_SHA256 \\\n\s+"(\w{64})"', text) for text in texts]
    assert hashes[0] != hashes[1]
    (tmp_path / "a" / "check").rmdir()
    changed("plant_mpc.json", '"horizon": 4', '"horizon": 5')(folder)
    assert findings(folder) == ("plant_mpc.json was changed after it was exported",)


@pytest.mark.parametrize("part", ["mpc", "ekf"])
def test_a_manifest_made_again_hides_no_change_of_a_controller(part: str, tmp_path: Path) -> None:
    folder = exported(tmp_path / "a", spec=BOTH, to="mpc")
    changed(f"src/plant_{part}.c", "do not edit", "do edit")(folder)
    paths = read_manifest(folder)
    hashes = {path: hashlib.sha256((folder / path).read_bytes()).hexdigest() for path in paths}
    (folder / MANIFEST).write_text("".join(f"{hashes[path]}  {path}\n" for path in paths))
    (finding,) = findings(folder)
    assert finding.startswith(f"the files plant_{part}*.[chj]* have the identity ")


DAMAGED: dict[str, Callable[[Path], object]] = {
    "no JSON": lambda path: path.write_text("{"),
    "deep": lambda path: path.write_text("[" * 100_000),
    "a list": lambda path: path.write_text("[]"),
    "not there": lambda path: path.unlink(),
    "a pipe": lambda path: (path.unlink(), os.mkfifo(path)),
    "no hash": lambda path: path.write_text(re.sub(r'"\w{64}"', '""', path.read_text())),
    "a number": lambda path: path.write_text(re.sub(r'"\w{64}"', "1", path.read_text())),
    "endless": lambda path: path.write_text(
        re.sub(r'"size": 1|"shape": \[\]', '"size": 1e999, "shape": 7', path.read_text())
    ),
}


@pytest.mark.parametrize("how", DAMAGED)
@pytest.mark.parametrize(("to", "name"), [("c", "plant"), ("mpc", "plant_mpc")])
def test_a_damaged_description_is_named_with_its_target(
    how: str, to: str, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = exported(tmp_path / "a", spec=SPEC + CONTROL, to=to)
    DAMAGED[how](folder / f"{name}.json")
    capsys.readouterr()
    assert run(["verify", str(folder)]) == 1
    said = capsys.readouterr().err
    assert f"export it again: `msnn export SPEC --to {to}`" in said
    # nothing says how the description of a model was called
    assert (f"`{name}.json` is missing, damaged or of another version" in said) is not (
        how == "not there" and to == "c"
    )


def test_a_controller_is_not_served(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = exported(tmp_path / "a", spec=SPEC + CONTROL, to="mpc")
    assert run(["verify", str(folder), "--serve", str(tmp_path / "served")]) == 1
    assert "error[E1325]" in capsys.readouterr().err
