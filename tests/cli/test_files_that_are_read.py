"""No command puts what it writes in the place of what it reads, or of what a run has kept."""

from __future__ import annotations

import os
import shutil
import sys
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import save_file

import msnn as api
from msnn.cli.application import VERBS, application
from msnn.cli.exit_codes import ExitCode
from msnn.cli.output_options import WRITTEN
from msnn.project.new_project import new_project
from tests.cli.command_line import CommandLine
from tests.cli.test_check import SPEC

RUN, MADE = "runs/plant/latest", "exported"
_SHORT = (SPEC, "--no-cost", "--jobs", "1", "--seeds", "1", "--out", "compared")
COMMANDS: dict[str, tuple[str, ...]] = {
    "init": ("other", "--data", "data/train/run_01.csv", "--predict", "x"),
    "import": ("saved.json",),
    "check": (SPEC, "--data"),
    "data": (SPEC,),
    "validate": (SPEC,),
    "compare": _SHORT,
    "sweep": (*_SHORT, "--grid", "train.0.epochs=1"),
    "simulate": (SPEC,),
    "verify": (MADE,),
    "a2l": ("plant.elf", "--export", MADE),
    "show": (RUN,),
    "report": (RUN, "--verification", "verified.json"),
    "diff": (RUN, SPEC),
    "fmt": (SPEC, "--check"),
}
"""Verbs with an option that names a file to write, and words with which each reads much."""
READS_NOTHING = {"explain", "schema", "lsp", "doctor"}
"""Verbs that read no file of a user."""
WRITES_FOLDERS = {"compare", "sweep", "compile", "train", "export"}
"""Verbs whose `--out` is a folder, in which files have names of their own."""
INPUTS = {
    *("spec", "specs", "files", "model", "folder", "elf", "export", "run", "old", "new", "data"),
    *("data_root", "weights", "runs", "verification"),
    # a folder that is written, with names of its own
    "serve",
}
"""Parameters with paths of what is read."""
ENDINGS = {"--plot": ".png", "report": ".html", "import": ".msnn.yaml"}
"""Of files, where the option or the verb wants one."""
PART = """\
msnn: 1
name: part
sample_time: 50 ms
inputs: {u: {unit: N}}
parameters: {gain: {init: {file: gain.txt}}}
outputs: {y: gain * u}
"""


def options_of(verb: str) -> dict[str, list[str]]:
    """The options of a verb with a path, by the name of the parameter."""
    (command,) = application([verb]).registered_commands
    assert command.callback is not None
    found: dict[str, list[str]] = {}
    for name, parameter in signature(command.callback).parameters.items():
        if "Path" in str(parameter.annotation):
            (told,) = parameter.annotation.__metadata__
            found[name] = [word for word in told.param_decls or () if word.startswith("--")] or [
                f"--{name}"
            ]
    return found


def file_options() -> list[tuple[str, str]]:
    """Every verb with each of its options that name a file to write."""
    return [
        (verb, words[0])
        for verb in VERBS
        for name, words in options_of(verb).items()
        if name in WRITTEN and verb not in READS_NOTHING
        if not (name == "out" and verb in WRITES_FOLDERS)
    ]


def test_every_path_of_a_verb_is_read_or_written() -> None:
    """An option that is in neither list would be left out of the tests below."""
    for verb in VERBS:
        assert options_of(verb).keys() <= INPUTS | WRITTEN, verb
        assert not INPUTS & WRITTEN
    assert {verb for verb, _ in file_options()} == COMMANDS.keys()


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with a part, its weights, a file of numbers, a run and exported C."""
    folder = new_project(tmp_path_factory.mktemp("read") / "plant")
    (folder / "part.msnn.yaml").write_text(PART)
    (folder / "gain.txt").write_text("0.5\n")
    save_file({"gain": np.array(0.5)}, folder / "part.safetensors")
    text = (folder / SPEC).read_text()
    text += "use: {part: {spec: part.msnn.yaml, weights: part.safetensors}}\n"
    text += "connect: {part.u: F}\n"
    (folder / SPEC).write_text(text.replace("a: (F - c", "a: (F + 0*part.y - c"))
    model = api.load(folder / SPEC, settings=["train.0.epochs=1"])
    trained = api.train(model, runs=folder / "runs")
    api.export(model, "c", folder / MADE, trained.weights)
    (folder / "saved.json").write_text("{}")
    (folder / "plant.elf").write_text("no program")
    (folder / "verified.json").write_text("{}")
    return folder


class Opened:
    """The files that Python opens to read, while it listens: another witness than msnn's own."""

    def __init__(self) -> None:
        self.paths: list[Path] | None = None
        sys.addaudithook(self._heard)

    def _heard(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open" and self.paths is not None:
            path, _, flags = arguments
            if isinstance(path, str | Path) and not flags & (os.O_WRONLY | os.O_RDWR):
                self.paths.append(Path(path))


OPENED = Opened()


def all_bytes(folder: Path) -> dict[Path, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    return {path: path.read_bytes() for path in files}


@pytest.mark.parametrize(("verb", "option"), file_options())
def test_no_option_writes_to_a_file_that_its_verb_reads(
    made: Path, msnn: CommandLine, monkeypatch: pytest.MonkeyPatch, verb: str, option: str
) -> None:
    folder = msnn.folder / "plant"
    shutil.copytree(made, folder, symlinks=True)
    monkeypatch.chdir(folder)
    before = all_bytes(folder)
    if verb == "verify":  # what compilers make of the files that msnn has read takes seconds
        monkeypatch.setenv("PATH", "/nowhere")
    OPENED.paths = []
    msnn(verb, *COMMANDS[verb])
    read = {path.resolve() for path in OPENED.paths} & before.keys()
    OPENED.paths = None
    assert read
    for path in set(all_bytes(folder)) - before.keys():
        path.unlink()
    shutil.rmtree("other", ignore_errors=True)
    for path in one_of_a_kind(read):
        # by another name where the option wants an ending
        link = folder / f"link{ENDINGS.get(option if option == '--plot' else verb, '')}"
        link.symlink_to(path)
        said = msnn(verb, *COMMANDS[verb], option, link.name)
        assert (said.code, "overwritten" in said.err) == (ExitCode.USAGE, True), (path, said)
        link.unlink()
        found = all_bytes(folder)
        changed = {path for path, content in before.items() if found.get(path) != content}
        assert not changed, path


def one_of_a_kind(read: set[Path]) -> list[Path]:
    """Of files of one folder and ending, as logs are, the first."""
    kinds = {(path.parent, path.suffix): path for path in sorted(read, reverse=True)}
    return sorted(kinds.values())


@pytest.mark.parametrize(
    "words",
    [
        ("simulate", SPEC, "--initial", "-o", SPEC),
        ("simulate", SPEC, "--initial", "-o", "link"),
        ("simulate", SPEC, "--initial", "--data", "log.csv", "-o", "log.csv"),
        ("show", SPEC, "-o", f"./{SPEC}"),
        ("data", SPEC, "--data", "log.csv", "--json", "log.csv"),
        # what belongs to the model, though this verb leaves it closed
        ("check", SPEC, "-o", "FROM THE SPEC"),
        ("show", SPEC, "-o", "FROM THE SPEC"),
        ("diff", SPEC, SPEC, "-o", "FROM THE SPEC"),
    ],
    ids=" ".join,
)
def test_files_that_are_named_and_files_of_the_model_stay(
    words: tuple[str, ...], msnn: CommandLine, project: Path
) -> None:
    (project / "link").symlink_to(SPEC)
    log = sorted(project.rglob("*.csv"))[0]
    (project / "log.csv").write_bytes(log.read_bytes())
    before = all_bytes(project)
    said = msnn(*[str(log) if word == "FROM THE SPEC" else word for word in words])
    assert said.code == ExitCode.USAGE
    assert "is read here and would be overwritten" in said.err
    assert all_bytes(project) == before


@pytest.mark.parametrize("ending", ["h5", "parquet"])
def test_files_of_readers_in_c_stay(msnn: CommandLine, project: Path, ending: str) -> None:
    rows = np.arange(60.0)
    columns = {"time": 0.05 * rows, "F": rows, "x": rows, "v": rows}
    log = project / f"log.{ending}"
    if ending == "h5":
        import h5py

        with h5py.File(log, "w") as file:
            for name, values in columns.items():
                file[name] = values
    else:
        import pyarrow as arrow
        import pyarrow.parquet as parquet

        parquet.write_table(arrow.table(columns), log)
    before = log.read_bytes()
    (project / "link").mkdir()
    (project / "link" / "same").hardlink_to(log)
    said = msnn("simulate", SPEC, "--initial", "--data", log.name, "-o", "link/same")
    assert (said.code, "overwritten" in said.err) == (ExitCode.USAGE, True)
    # where a spec names it by a link that a stranger has planted
    text = (project / SPEC).read_text().replace("test: data/test/*.csv", f"test: {log.name}")
    (project / SPEC).write_text(text)
    said = msnn("validate", SPEC, "--initial", "--junit", "link/same")
    assert (said.code, "overwritten" in said.err) == (ExitCode.USAGE, True)
    assert log.read_bytes() == before


@pytest.mark.parametrize(
    "words",
    [
        ("show", SPEC, "-o", f"{RUN}/weights.safetensors"),
        ("check", SPEC, "--output", f"{RUN}/run.json"),
        ("simulate", SPEC, "--initial", "-o", f"{RUN}/metrics.jsonl"),
        ("data", SPEC, "--json", f"{RUN}/parts/part.safetensors"),
        ("explain", "E0101", "-o", f"{RUN}/spec.msnn.yaml"),
    ],
    ids=" ".join,
)
def test_what_a_run_has_kept_stays(
    made: Path, msnn: CommandLine, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    monkeypatch.chdir(made)
    before = all_bytes(made)
    said = msnn(*words)
    assert said.code == ExitCode.USAGE
    assert "belongs to a run and would be overwritten" in said.err
    assert all_bytes(made) == before


def test_a_picture_beside_the_weights_is_replaced(made: Path, msnn: CommandLine) -> None:
    picture = made / RUN / "run.svg"
    picture.write_text("old")
    assert msnn("show", made / RUN, "--plot", picture).code == ExitCode.OK
    assert "<svg" in picture.read_text()


def test_the_default_name_is_spared_where_it_is_data(msnn: CommandLine, project: Path) -> None:
    """A simulation may be the data of another model, and is called as `simulate` calls it."""
    assert msnn("simulate", SPEC, "--initial").code == ExitCode.OK
    before = (project / "simulation.csv").read_bytes()
    assert msnn("simulate", SPEC, "--initial").code == ExitCode.OK
    (project / "other.msnn.yaml").write_text(
        "msnn: 1\nname: other\nsample_time: 50 ms\ninputs: {x_next: {unit: m}}\n"
        "outputs: {y: 2*x_next}\ndata: {source: {test: simulation.csv}}\n"
    )
    said = msnn("simulate", "other.msnn.yaml")
    assert said.code == ExitCode.USAGE
    assert "`simulation.csv` is read here" in said.err
    assert (project / "simulation.csv").read_bytes() == before


def test_a_program_file_is_not_replaced_by_what_it_is_compiled_to(
    msnn: CommandLine, project: Path
) -> None:
    assert msnn("compile", SPEC).code == ExitCode.OK
    before = all_bytes(project)
    for out in ("build", "build/plant.program.json"):
        words = ("compile", "build/plant.program.json", "--set", "train.0.epochs=1", "-o", out)
        said = msnn(*words)
        assert (said.code, "overwritten" in said.err) == (ExitCode.USAGE, True)
    assert all_bytes(project) == before


@pytest.mark.parametrize("is_there", [True, False])
def test_one_file_is_not_written_twice(msnn: CommandLine, project: Path, is_there: bool) -> None:
    if is_there:
        (project / "found.txt").write_text("old")
    said = msnn("validate", SPEC, "--initial", "--junit", "found.txt", "-o", "./found.txt")
    assert (said.code, "would be written twice" in said.err) == (ExitCode.USAGE, True)
    assert (project / "found.txt").exists() is is_there


def test_a_command_that_fails_leaves_the_file_of_its_result(
    msnn: CommandLine, project: Path
) -> None:
    """What it would have read is not known then: this may be it."""
    (project / "part.yaml").write_text("msnn: 1\n")
    (project / SPEC).write_text("msnn: 1\nname: plant\nuse: {part: {spec: part.yaml}}\nodd: 1\n")
    assert msnn("show", SPEC, "-o", "part.yaml").code == ExitCode.DIAGNOSTICS
    assert (project / "part.yaml").read_text() == "msnn: 1\n"


def test_another_file_is_replaced(msnn: CommandLine, project: Path) -> None:
    (project / "old.csv").write_text("old")
    assert msnn("simulate", SPEC, "--initial", "-o", "old.csv").code == 0
    assert (project / "old.csv").read_text().startswith("file,")
