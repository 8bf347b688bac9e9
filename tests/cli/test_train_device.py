"""`msnn train --device`: what it says where there is no CUDA."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from tests.cli.command_line import CommandLine
from tests.cli.test_check import SPEC


def test_without_cuda_it_ends_with_5(
    msnn: CommandLine, project: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    said = msnn("train", SPEC, "--device", "cuda")
    assert said.code == 5
    assert "CUDA that torch can use is not installed" in said.err
    assert not (project / "runs").exists()


def test_an_unknown_device_is_said_before_data_are_read(msnn: CommandLine, project: Path):
    said = msnn("train", SPEC, "--device", "gpu", "--data-root", "nowhere")
    assert said.code == 1
    assert "error[E0971]: `gpu` is no device" in said.err
    assert "nowhere" not in said.err


def test_kernels_are_not_for_cuda(
    msnn: CommandLine, project: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
    said = msnn("train", SPEC, "--device", "cuda", "--engine", "native")
    assert said.code == 1
    assert "error[E0970]: the stage `fit` cannot run on cuda" in said.err
    assert not (project / "runs").exists()
