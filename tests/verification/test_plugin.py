"""Checks that QEMU's counter of instructions is compiled once, and taken from where it may run."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace

import pytest

from msnn.verification import qemu
from msnn.verification.proof_step import GCC
from msnn.verification.qemu import instructions_plugin
from tests.verification.test_verify import require


@pytest.fixture(autouse=True)
def _own_cache(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    require(GCC)
    monkeypatch.setenv("MSNN_CACHE", str(tmp_path / "cache"))


def test_the_plugin_is_compiled_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    first = instructions_plugin(tmp_path)
    assert first.parent == tmp_path / "cache"

    def unexpected(*words: object) -> str:
        raise AssertionError(words)

    monkeypatch.setattr("msnn.verification.qemu.run_tool", unexpected)
    assert instructions_plugin(tmp_path) == first


def test_a_plugin_that_was_cut_off_is_compiled_again(tmp_path: Path) -> None:
    library = instructions_plugin(tmp_path)
    whole = library.read_bytes()
    library.write_bytes(whole[: len(whole) // 2])
    assert instructions_plugin(tmp_path).read_bytes() == whole


def test_where_nothing_may_be_executed_no_plugin_is_kept(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    closed = SimpleNamespace(f_flag=os.ST_NOEXEC)
    monkeypatch.setattr(qemu.os, "statvfs", lambda folder: closed)
    assert instructions_plugin(tmp_path) == tmp_path / "instructions_plugin.so"
