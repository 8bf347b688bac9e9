"""Parts of the native path that differ on Windows, tested on a POSIX system."""

from __future__ import annotations

import ast

import numpy as np
import pytest

from backends.files import c_compiler
from msnn.api import models
from msnn.simulation.engines import kernel_check
from tests.cli.command_line import ROOT

POSIX_ONLY = {
    *("geteuid", "getuid", "getgid", "killpg", "getpgid", "fork", "setsid", "sysconf", "mkfifo"),
    *("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC", "O_DIRECTORY", "sched_getaffinity"),
}
"""Attributes of `os` that Python on Windows does not have."""


def _asks(tree: ast.AST) -> bool:
    """Whether a file asks for the system or catches that an attribute is missing."""
    text = ast.unparse(tree)
    checks = ("sys.platform", "os.name", "AttributeError", "ImportError")
    return any(check in text for check in checks)


@pytest.mark.parametrize("folder", ["backends", "compiler", "msnn", "spec_schema"])
def test_attributes_of_posix_systems_are_used_behind_a_check(folder: str):
    unguarded: list[str] = []
    for path in sorted((ROOT / folder).rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        used = {
            node.attr
            for node in ast.walk(tree)
            if isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Name)
            and node.value.id == "os"
        }
        if used & POSIX_ONLY and not _asks(tree):
            unguarded.append(f"{path.relative_to(ROOT)}: os.{', os.'.join(used & POSIX_ONLY)}")
    assert not unguarded, unguarded


def test_a_path_in_cc_keeps_its_backslashes_on_windows():
    words = c_compiler.words_of(r'"C:\Program Files\zig\zig.exe" cc -O1', on_windows=True)
    assert c_compiler.words_of(r"C:\zig\zig.exe cc", on_windows=True) == [r"C:\zig\zig.exe", "cc"]
    assert words == [r"C:\Program Files\zig\zig.exe", "cc", "-O1"]
    assert c_compiler.words_of("gcc '-I/a b'", on_windows=False) == ["gcc", "-I/a b"]


def test_trials_of_a_kernel_need_no_numpy_2(monkeypatch: pytest.MonkeyPatch):
    """Before numpy 2.1 `clip` refuses two limits that are None; it did so in every training."""
    text = "msnn: 1\nname: a\ninputs: {u: V}\nparameters: {k: 2}\noutputs: {y: k * u}\n"
    model = models.load(text)
    clip = np.clip

    def before(values: object, low: object, high: object) -> object:
        if low is None and high is None:
            raise ValueError("One of max or min must be given")
        return clip(values, low, high)  # pyright: ignore

    monkeypatch.setattr(np, "clip", before)
    moved = kernel_check.nearby(
        model.program, models.initial_weights(model), np.random.default_rng(0)
    )
    assert set(moved) == {"k"}
