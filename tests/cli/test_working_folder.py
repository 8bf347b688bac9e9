"""No verb runs what lies in the working folder: in CI that is the code of a pull request.

The folder of a spec has a module of every name that Python, msnn or an extra of it imports, and
files that libraries look for there.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import msnn as api
from msnn.cli.application import VERBS
from msnn.cli.exit_codes import ExitCode
from msnn.packages import OPTIONAL
from msnn.project.new_project import new_project
from tests.conditions import require_package, require_tool

SPEC = "plant.msnn.yaml"
MSNN = Path(sys.executable).parent / "msnn"
STRANGERS = "strangers.log"
"""Where a module that is run leaves its name."""
_OURS = ("numpy", "yaml", "pydantic", "pydantic_core", "jinja2", "typer", "click", "safetensors")
_OF_SERVERS = ("sitecustomize", "usercustomize", "pyocd_user", "setproctitle", "psutil", "pint")
NAMES = {
    *sys.stdlib_module_names,
    *(package.name for package in OPTIONAL),
    *_OURS,
    *_OF_SERVERS,
}
EXAMINE = """
from pathlib import Path

from msnn.features.language_server.checks import CheckProcess

if __name__ == "__main__":
    process = CheckProcess()
    path = Path("plant.msnn.yaml")
    print(process.examine(str(path), path.read_text(), {}, lambda: False).knowledge is not None)
    process.stop()
"""
_SHORT = ("--set", "train.0.epochs=1")
_TRIALS = (SPEC, *_SHORT, "--seeds", "2")
_PLATFORMS = ("--set", "export.fmu.platforms=[aarch64-linux]")
_NO_COMPILER = {"CC": "", "PATH": "/nowhere"}
COMMANDS: dict[str, tuple[str, ...]] = {
    "init": ("other", "--data", "data/train/run_01.csv", "--predict", "x"),
    "import": ("saved.json",),
    "check": (SPEC, "--data"),
    "data": (SPEC,),
    "compile": (SPEC, "-o", "plant.program.json"),
    "train": (SPEC, *_SHORT),
    "validate": (SPEC, "--plot", "plot.png"),
    "compare": (*_TRIALS, "--jobs", "2", "--out", "compared"),
    "sweep": (*_TRIALS, "--jobs", "2", "--out", "swept"),
    "simulate": (SPEC, "--plot", "simulated.png"),
    "export": (SPEC, "--to", "c,torch,casadi,onnx,fmu", "--check", "--out", "all", *_PLATFORMS),
    "verify": ("exported", "--misra"),
    "a2l": ("plant.elf", "--export", "exported"),
    "show": (SPEC, "--graph", "svg"),
    "report": ("runs/plant/latest",),
    "explain": ("E0101",),
    "schema": (),
    "diff": (SPEC, SPEC),
    "fmt": (SPEC,),
    "lsp": (),
    "doctor": (),
}
ENDS = {
    "import": ExitCode.DIAGNOSTICS,
    "a2l": ExitCode.DIAGNOSTICS,
    "validate": ExitCode.LIMIT_BROKEN,
}
"""Commands that end with another exit code than 0: the files that they read say nothing."""
ZIG = {"train", "report"}
"""Verbs that compile with zig where there is no other compiler."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with a trained run, and strangers beside its spec."""
    made = new_project(tmp_path_factory.mktemp("working") / "plant")
    model = api.load(made / SPEC, settings=["train.0.epochs=1"])
    trained = api.train(model, runs=made / "runs")
    api.export(model, "c", made / "exported", trained.weights)
    (made / "saved.json").write_text("{}")
    (made / "plant.elf").write_text("")
    for name in NAMES:
        plant(made, name)
    (made / "matplotlibrc").write_text("savefig.facecolor: red\nno.such.key: read\n")
    plant_library(made, "libcuda.so.1")
    return made


def plant(folder: Path, name: str) -> None:
    """A module that leaves its name in the log when it is run."""
    log = f"open({str(folder / STRANGERS)!r}, 'a').write(__name__ + '\\n')\n"
    path = folder / f"{name}.py"
    path.write_text(f"{log}raise ImportError('a module of the working folder')\n")


def plant_library(folder: Path, name: str) -> None:
    """A shared library that leaves its name in the log when it is loaded."""
    require_tool("gcc", install="apt install gcc")
    log, source = folder / STRANGERS, folder / "stranger.c"
    source.write_text(
        "#include <stdio.h>\n__attribute__((constructor)) static void ran(void) {\n"
        f'    FILE *log = fopen("{log}", "a");\n'
        f'    fputs("{name}\\n", log);\n    fclose(log);\n}}\n'
    )
    asked = ["gcc", "-shared", "-fPIC", str(source), "-o", str(folder / name)]
    subprocess.run(asked, check=True)


def run_by(folder: Path, *command: str | Path, **environment: str) -> tuple[int, str]:
    """The exit code of a command and what it says; AssertionError where a stranger was run."""
    done = subprocess.run(
        command,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": "", "MSNN_CACHE": str(folder / "cache"), **environment},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    log = folder / STRANGERS
    strangers = log.read_text() if log.exists() else ""
    log.unlink(missing_ok=True)
    assert not strangers, f"{strangers}{done.stdout}"
    return done.returncode, done.stdout


@pytest.mark.parametrize("verb", VERBS)
def test_a_verb_runs_no_module_of_the_working_folder(folder: Path, verb: str):
    environment = _NO_COMPILER if verb in ZIG else {}
    code, said = run_by(folder, MSNN, verb, *COMMANDS[verb], **environment)
    assert "matplotlibrc" not in said
    assert code == ENDS.get(verb, ExitCode.OK), said
    assert verb not in ZIG or "zig" not in said, said


def test_a_trained_run_loads_no_library_of_the_working_folder(folder: Path):
    """NVIDIA's libraries look for the driver there before they look in the system."""
    words = ("train", SPEC, *_SHORT, "--set", "train.0.batch=100", "--engine", "torch")
    code, said = run_by(folder, MSNN, *words)
    assert code == ExitCode.OK, said


def test_pictures_do_not_depend_on_the_working_folder(folder: Path, tmp_path: Path):
    """A `matplotlibrc` there would decide on colours, fonts, and whether LaTeX is run."""
    pictures = [tmp_path / "with.png", tmp_path / "without.png"]
    for picture in pictures:
        run = (folder / "runs" / "plant" / "latest", "--plot", picture)
        code, said = run_by(folder if picture is pictures[0] else tmp_path, MSNN, "show", *run)
        assert code == ExitCode.OK, said
    assert pictures[0].read_bytes() == pictures[1].read_bytes()


def test_sweeps_on_ray_run_none(folder: Path):
    require_package("ray", install="pip install 'msnn[ray]'")
    code, said = run_by(folder, MSNN, "sweep", *_TRIALS, "--ray", "local", "--out", "on_ray")
    assert code == ExitCode.OK, said


def test_the_process_that_checks_for_editors_runs_none(folder: Path, tmp_path: Path):
    program = tmp_path / "examine.py"
    program.write_text(EXAMINE)
    code, said = run_by(folder, sys.executable, program)
    assert (code, said) == (0, "True\n")


def test_a_module_of_python_that_is_named_runs_none(tmp_path: Path):
    """`python -m` looks in the working folder itself, for what Python needs to begin.

    So does torchrun: tests/training/test_ranks.py.
    """
    made = new_project(tmp_path / "plant")
    for name in NAMES - set(sys.stdlib_module_names):
        plant(made, name)
    code, said = run_by(made, sys.executable, "-m", "msnn", "train", SPEC, *_SHORT)
    assert code == ExitCode.OK, said


@pytest.mark.parametrize(
    "command", [[str(MSNN)], [sys.executable, "-m", "msnn"]], ids=["msnn", "-m"]
)
def test_a_plugin_of_the_working_folder_is_not_loaded(tmp_path: Path, command: list[str]):
    metadata = tmp_path / "stranger-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: stranger\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("[msnn.features]\nx = stranger:FEATURE\n")
    (tmp_path / "stranger.py").write_text(f"open({STRANGERS!r}, 'w').close()\n")
    spec = "msnn: 1\nname: plain\ninputs: {u: {}}\noutputs: {y: 2 * u}\nstranger: 1\n"
    (tmp_path / SPEC).write_text(spec)
    # an unknown key is looked for among plug-ins
    done = subprocess.run(
        [*command, "check", SPEC], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert "E0201" in done.stderr
    assert not (tmp_path / STRANGERS).exists()
