"""Six light packages are enough for everything but torch, CasADi and ONNX - also as a wheel."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import packages_distributions, requires
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from safetensors.numpy import load_file

import msnn
from msnn import packages
from tests.conditions import require_tool
from tests.light.session import OURS
from tests.old_runs.keep import EXPECTED
from tests.old_runs.same import differences, kept
from tests.old_runs.test_old_runs import VERSIONS

ROOT = Path(__file__).resolve().parents[2]
SESSION = Path(__file__).with_name("session.py")
SITE = str(Path(np.__file__).parents[1])

SPEC = "plant/plant.msnn.yaml"
TRAIN = ("train", SPEC, "--set", "train.0.epochs=2")
SQUARES = "{epochs: 2, optimizer: levenberg_marquardt, rollout: {horizon: 1 s, stride: 1 s}}"
WORKS = {
    "init": ("init", "plant"),
    "check": ("check", SPEC),
    "show": ("show", SPEC),
    "fmt": ("fmt", SPEC),
    "data": ("data", SPEC),
    "compile": ("compile", SPEC),
    "train": (*TRAIN, "--device", "auto"),
    "lm": ("train", SPEC, "--set", f"train=[{SQUARES}]", "--out", "lm"),
    "lbfgs": (*TRAIN, "--set", "train.0.optimizer=lbfgs", "--out", "lbfgs"),
    "compare": ("compare", SPEC, "--set", "train.0.epochs=1", "--no-cost"),
    "validate": ("validate", SPEC, "--set", "validate=[]"),
    "simulate": ("simulate", SPEC, "--engine", "native"),
    "export": ("export", SPEC, "--check"),
    "all": ("export", SPEC, "--to", "all", "--out", "all"),
    "verify": ("verify", "build/export/c"),
    "diff": ("diff", SPEC, SPEC),
    "schema": ("schema",),
    "explain": ("explain", "E1037"),
    "doctor": ("doctor",),
}
"""Verbs by what they do, each after those above it."""

NEEDS = {
    "torch, which trains with `engine: torch`,": (*TRAIN, "--engine", "torch"),
    "torch, which has the torch optimizer,": (
        *TRAIN,
        "--set",
        "train.0.optimizer={torch: {name: Adam}}",
    ),
    "torch, which computes on graphics cards,": (*TRAIN, "--device", "cuda"),
    "torch, which runs models with `--engine torch`,": (
        "simulate",
        SPEC,
        "--engine",
        "torch",
    ),
    "torch, which writes torch exports,": ("export", SPEC, "--to", "c,torch"),
    "onnx, which writes ONNX exports,": ("export", SPEC, "--to", "onnx"),
    "casadi, which writes CasADi exports,": ("export", SPEC, "--to", "casadi"),
    "matplotlib, which draws plots,": ("validate", SPEC, "--plot", "a.png"),
}
"""What each asks for that is not there."""


@dataclass(frozen=True)
class Session:
    """What the commands of one process said, by their keys, and the packages that it loaded."""

    said: dict[str, dict[str, Any]]
    loaded: set[str]
    folder: Path


def _session(folder: Path, *places: Path) -> Session:
    commands = {**WORKS, **NEEDS}
    project = folder / "project"
    project.mkdir()
    answer = _answer(project, list(commands.values()), *places)
    return Session(dict(zip(commands, answer["said"], strict=True)), set(answer["loaded"]), project)


def _answer(project: Path, commands: Sequence[Sequence[str]], *places: Path) -> dict[str, Any]:
    """What commands say one after the other in this folder, with what is in `places` alone."""
    found = subprocess.run(
        [sys.executable, "-I", "-S", SESSION, *map(str, places), SITE],
        input="\n".join(map(json.dumps, (_heavy(), *commands))),
        cwd=project,
        capture_output=True,
        text=True,
        check=False,
    )
    assert found.returncode == 0, found.stderr
    return json.loads(found.stdout)


def light_packages() -> set[str]:
    """The packages that `pip install` of the wheel installs besides."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted, seen = [Requirement(text) for text in project["dependencies"]], set[str]()
    while wanted:
        one = wanted.pop()
        name = canonicalize_name(one.name)
        if name not in seen and (one.marker is None or one.marker.evaluate()):
            seen.add(name)
            wanted += map(Requirement, requires(one.name) or ())
    return seen


def _heavy() -> list[str]:
    """What is installed here and not by `pip install` of the wheel, as Python imports it."""
    seen = light_packages()
    found = packages_distributions().items()
    heavy = {name for name, brought in found if not seen & set(map(canonicalize_name, brought))}
    return sorted(heavy - {"msnn", *OURS})


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Session:
    require_tool("gcc", install="apt install gcc")
    return _session(tmp_path_factory.mktemp("checkout"), ROOT)


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory, wheel: zipfile.ZipFile) -> Session:
    """The wheel's files beside packages of a stranger that have the names of our folders."""
    require_tool("gcc", install="apt install gcc")
    folder = tmp_path_factory.mktemp("installed")
    wheel.extractall(folder / "site")
    for name in OURS:
        (folder / "site" / name).mkdir()
        (folder / "site" / name / "__init__.py").write_text("raise SystemExit('a stranger')\n")
    return _session(folder, folder / "site")


@pytest.mark.parametrize("command", WORKS)
def test_a_verb_works_in_the_checkout(checkout: Session, command: str) -> None:
    said = checkout.said[command]
    assert said["code"] == 0, said["err"]


@pytest.mark.parametrize("command", WORKS)
def test_a_verb_works_installed_beside_strangers(installed: Session, command: str) -> None:
    said = installed.said[command]
    assert said["code"] == 0, said["err"]
    assert not installed.loaded & OURS


@pytest.mark.parametrize("missing", NEEDS)
def test_what_needs_more_ends_with_5_and_the_line_that_installs_it(
    checkout: Session, missing: str
) -> None:
    said = checkout.said[missing]
    assert said["code"] == 5, said
    assert f"error[E1037]: {missing} is not installed\n = help: pip install " in said["err"]


def test_nothing_is_begun_without_what_it_needs(checkout: Session) -> None:
    assert not (checkout.folder / "a.png").exists()
    assert not list((checkout.folder / "build" / "export").glob("[!c]*"))


def test_targets_that_nobody_named_are_left_out_in_words(checkout: Session) -> None:
    said = checkout.said["all"]["err"]
    for target in ("torch", "onnx", "casadi"):
        assert f"{target} is left out: {target} is not installed; pip install " in said
    assert {path.name for path in (checkout.folder / "all").iterdir()} >= {"c"}


@pytest.mark.parametrize("version", VERSIONS, ids=lambda folder: folder.name)
def test_the_wheel_reads_what_older_versions_kept(
    version: Path, wheel: zipfile.ZipFile, tmp_path: Path
) -> None:
    wheel.extractall(tmp_path / "site")
    expected = json.loads((version / EXPECTED).read_text())
    asked = [one["arguments"] for one in expected]
    answer = _answer(kept(version, tmp_path / "kept"), asked, tmp_path / "site")
    for one, said in zip(expected, answer["said"], strict=True):
        assert said["code"] == 0, said["err"]
        assert not differences(one["numbers"], json.loads(said["out"])), one["arguments"]


def test_the_wheel_computes_the_bits_of_the_checkout(checkout: Session, installed: Session) -> None:
    for run in ("runs", "lm", "lbfgs"):
        ours, theirs = (
            load_file(session.folder / run / "plant" / "latest" / "weights.safetensors")
            for session in (checkout, installed)
        )
        assert ours.keys() == theirs.keys()
        assert all(np.array_equal(ours[name], theirs[name]) for name in ours)
    sources = sorted((checkout.folder / "build" / "export" / "c").rglob("*.[ch]"))
    assert {"plant.c", "plant.h"} <= {path.name for path in sources}
    for path in sources:
        other = installed.folder / path.relative_to(checkout.folder)
        assert path.read_bytes() == other.read_bytes(), path.name


def test_a_loss_as_a_module_needs_torch(monkeypatch: pytest.MonkeyPatch) -> None:
    model = msnn.load(ROOT / "examples" / "mass_spring_damper" / "msd.msnn.yaml")
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(msnn.MissingExtraError, match="torch, which gives the loss of a stage"):
        msnn.stage_loss(model)


@pytest.mark.parametrize(
    ("origin", "line"),
    [
        (None, "pip install casadi"),
        (
            {"url": "file:///home/a%20b/msnn", "dir_info": {}},
            "pip install '/home/a b/msnn[casadi]'",
        ),
        (
            {"url": "file:///src/msnn", "dir_info": {"editable": True}},
            "pip install -e '/src/msnn[casadi]'",
        ),
        (
            {"url": "file:///dist/msnn-1.whl", "archive_info": {}},
            "pip install 'msnn[casadi] @ file:///dist/msnn-1.whl'",
        ),
        (
            {
                "url": "https://git.example/msnn.git",
                "vcs_info": {"vcs": "git", "commit_id": "a1b2"},
            },
            "pip install 'msnn[casadi] @ git+https://git.example/msnn.git@a1b2'",
        ),
    ],
)
def test_the_line_names_what_msnn_was_installed_from(
    monkeypatch: pytest.MonkeyPatch, origin: dict[str, Any] | None, line: str
) -> None:
    monkeypatch.setattr(packages, "_origin", lambda: origin)
    assert packages.CASADI.install == line
