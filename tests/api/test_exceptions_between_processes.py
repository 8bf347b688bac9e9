"""What the API raises crosses to another process whole: a pool hangs on what cannot."""

from __future__ import annotations

import pickle

import pytest

import msnn
from msnn.errors.failures import UnfitCompilerError
from msnn.training.training_result import TrainingResult
from spec_schema.diagnostics.diagnostic import Diagnostic


def _errors() -> list[Exception]:
    with pytest.raises(msnn.SpecError) as caught:
        msnn.load("msnn: 1\nname: a\n")
    (first, *_) = caught.value.diagnostics
    result = TrainingResult(weights={}, stages=(), folder=None, warnings=())
    return [
        caught.value,
        msnn.MissingExtraError("matplotlib, which draws plots,", "pip install matplotlib"),
        UnfitCompilerError("gcc", ["ld: cannot find -lvendor"], "set CC to another compiler"),
        msnn.TrainingDivergedError(first, result, is_latest=False, sources=caught.value.sources),
        msnn.TrainingInterruptedError(result),
    ]


@pytest.mark.parametrize("error", _errors(), ids=lambda error: type(error).__name__)
def test_it_crosses_whole(error: Exception) -> None:
    found = pickle.loads(pickle.dumps(error))  # noqa: S301 - our own bytes
    assert type(found) is type(error)
    assert str(found) == str(error)
    assert _carried(found) == _carried(error)


def _carried(error: Exception) -> list[object]:
    names = ("diagnostics", "diagnostic", "sources", "result", "is_latest")
    return [getattr(error, name, None) for name in names]


def test_diagnostics_are_where_the_page_says() -> None:
    spec, extra, unfit, diverged, _ = _errors()
    assert isinstance(spec, msnn.SpecError)
    assert all(isinstance(found, Diagnostic) for found in spec.diagnostics)
    for error in (extra, unfit, diverged):
        assert isinstance(error.diagnostic, Diagnostic)  # pyright: ignore[reportAttributeAccessIssue]
