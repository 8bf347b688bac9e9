"""Checks that a kernel has only those parts of its optimisers that its program can use."""

from __future__ import annotations

import pytest

from backends.native.kernel_source import kernel_source, losses_source
from compiler.differentiation.training_step import losses_alone, training_step
from tests.language.compiled import compiled

SPEC = """
inputs: {u: "1"}
targets: {y: "1"}
parameters: {gain: {init: 1%s}}
outputs: {out: {expr: gain * u, predicts: "y[t]"}}
%s
"""
MAPPED, NEAR = "static double double_softplus(", "static void approach("


@pytest.mark.parametrize(
    ("of_parameter", "losses", "has"),
    [
        ("", "", ()),
        (", min: 0", "", (MAPPED,)),
        (", prior: {mean: 1, std: 0.1}", "", (NEAR,)),
        ("", "losses: {fit: 'mse(out, y)', small: {expr: l1(gain), weight: 0.1}}", (NEAR,)),
        (", max: 9, prior: {mean: 1, std: 0.1}", "", (MAPPED, NEAR)),
    ],
    ids=["free", "bounded", "prior", "penalty", "both"],
)
def test_a_kernel_compiles_what_its_parameters_need(
    of_parameter: str, losses: str, has: tuple[str, ...]
) -> None:
    source = kernel_source(training_step(compiled(SPEC % (of_parameter, losses))), "float32")
    assert tuple(each for each in (MAPPED, NEAR) if each in source.text) == has
    assert source.takes_known == (NEAR in has)


def test_a_kernel_of_losses_alone_takes_nothing_known() -> None:
    program = compiled(SPEC % (", prior: {mean: 1, std: 0.1}", ""))
    assert not losses_source(losses_alone(program), "float32").takes_known


@pytest.mark.parametrize("lbfgs", [False, True])
def test_a_kernel_has_the_optimisers_of_its_stage(lbfgs: bool) -> None:
    text = kernel_source(training_step(compiled(SPEC % ("", ""))), "float32", lbfgs=lbfgs).text
    assert ("search_along(" in text, "static void move(" in text) == (lbfgs, not lbfgs)
