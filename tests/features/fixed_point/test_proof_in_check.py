"""`export --check` in fixed point finds what the C and its judge have wrong in common."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from compiler.ir.ops import Relation
from msnn.agreement.agreement import Agreement, BeyondProof, beyond_proof
from msnn.agreement.judgement import Proof
from msnn.agreement.report import AgreementReport, agreement_diagnostics
from msnn.features.fixed_point.compile import compile_integers
from msnn.features.fixed_point.compile.elementwise import ElementwiseForms
from msnn.features.fixed_point.compile.polynomials import PolynomialForm
from msnn.features.fixed_point.compile.thresholds import Decided, IntegerCondition
from msnn.features.fixed_point.integers.builder import IntegerBuilder
from tests.agreement.exported import checked
from tests.conditions import require_tool
from tests.features.fixed_point.exported import fixed_model, gallery_text, planned
from tests.features.fixed_point.random_specs import random_spec

SPEC = """\
msnn: 1
name: m
sample_time: 0.1 s
inputs: {u: {range: [-1, 1]}, w: {range: [-1, 1]}}
states:
  x: {next: "0.9 * x + 0.1 * u", range: [-2, 2], init: 0.5}
  kept: {next: 0.5 * kept + w, range: [-3, 3], init: "w.meas[t-1] / 4"}
outputs:
  share: {expr: u / 4}
  chosen: {expr: "where(u > w, u, -w)"}
  product: {expr: u * w}
  sum: {expr: "x + 0.3 * kept"}
"""


def _found(text: str, dtype: str, folder: Path) -> Agreement:
    require_tool("gcc", "apt-get install gcc")
    return checked(planned(fixed_model(folder, text, dtype)), {}, folder / "c")


@pytest.mark.parametrize("dtype", ["q15", "q31"])
@pytest.mark.parametrize("name", ["spec", "battery", "heater", "quarter_car", "motor"])
def test_no_step_is_farther_off_than_is_proved(name: str, dtype: str, tmp_path: Path) -> None:
    found = _found(SPEC if name == "spec" else gallery_text(name), dtype, tmp_path)
    assert found.agrees, found.faults


@pytest.mark.parametrize("seed", range(4))
def test_no_step_of_a_random_model_is_either(seed: int, tmp_path: Path) -> None:
    found = _found(random_spec(seed), "q15", tmp_path)
    assert found.agrees, found.faults


def _wrong_scale(patch: pytest.MonkeyPatch) -> None:
    plain = ElementwiseForms.quotient

    def quotient(
        self: ElementwiseForms, left: PolynomialForm, right: PolynomialForm
    ) -> PolynomialForm:
        return plain(self, left, right).times(1.001)

    patch.setattr(ElementwiseForms, "quotient", quotient)


def _other_choice(patch: pytest.MonkeyPatch) -> None:
    plain = ElementwiseForms.condition
    other = {Relation.GREATER: Relation.LESS}

    def condition(
        self: ElementwiseForms, relation: Relation, left: PolynomialForm, right: PolynomialForm
    ) -> IntegerCondition | Decided:
        return plain(self, other.get(relation, relation), left, right)

    patch.setattr(ElementwiseForms, "condition", condition)


def _shifted_product(patch: pytest.MonkeyPatch) -> None:
    plain = IntegerBuilder.product

    def product(self: IntegerBuilder, left: int, right: int, *most: float) -> int:
        made = plain(self, left, right, *most)
        found, more = self[made], 2**19
        bounds = found.low + more, found.high + more
        return self.weighted_sum(more, [(1, made)], found.fraction, bounds)

    patch.setattr(IntegerBuilder, "product", product)


def _other_format_of_states(patch: pytest.MonkeyPatch) -> None:
    plain = IntegerBuilder.memory

    def memory(
        self: IntegerBuilder, name: str, index: int, fraction: int, low: int, high: int
    ) -> int:
        return plain(self, name, index, fraction + 1, low, high)

    patch.setattr(IntegerBuilder, "memory", memory)


def _other_start(patch: pytest.MonkeyPatch) -> None:
    plain: Any = compile_integers._Compilation._window_words  # pyright: ignore[reportPrivateUsage]

    def window_words(self: Any, lowering: Any, node: Any) -> Any:
        made = plain(self, lowering, node)
        made.flat[0] = made.flat[0].times(1.1)
        return made

    patch.setattr(compile_integers._Compilation, "_window_words", window_words)  # pyright: ignore[reportPrivateUsage]


@pytest.mark.parametrize(
    ("broken", "of"),
    [
        (_wrong_scale, "`share`"),
        (_other_choice, "`chosen`"),
        (_shifted_product, "`product`"),
        (_other_format_of_states, "the state `kept`"),
        (_other_start, "the first state `kept`"),
    ],
)
def test_what_is_wrong_in_the_c_and_in_its_judge_is_found(
    broken: Callable[[pytest.MonkeyPatch], None],
    of: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    broken(monkeypatch)
    found = _found(SPEC, "q15", tmp_path)
    assert found.bits == 0, "the C has the bits of its judge"
    faults = {fault.of: fault for fault in found.faults}
    fault = faults[of]
    assert isinstance(fault, BeyondProof)
    assert fault.error > fault.bound
    said = [one.message for one in agreement_diagnostics(AgreementReport("", (found,), ()))]
    (mine,) = [message for message in said if f"in {of}:" in message]
    step = "a step beside the record" if fault.step is None else f"step {fault.step}"
    for part in (step, f"{fault.error:.3g}", f"{fault.bound:.3g}"):
        assert part in mine


@pytest.mark.parametrize("wrong", [math.nan, math.inf, 0.3])
def test_a_value_that_is_no_number_is_beyond_every_proof(wrong: float) -> None:
    exact, values = np.zeros((3, 1)), np.array([[0.1], [wrong], [0.1]])
    proof = Proof(
        values={"`y`": values}, exact={"`y`": exact}, bounds={"`y`": 0.2}, steps={"`y`": 3}
    )
    (fault,) = beyond_proof(proof)
    assert isinstance(fault, BeyondProof)
    assert (fault.of, fault.step) == ("`y`", 1)
