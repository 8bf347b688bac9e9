"""What `export --check` and `msnn verify` do with C in fixed point."""

from pathlib import Path

import numpy as np
import pytest

from compiler.interpreter.interpreter import physical_weights
from msnn.exports.export import write_export
from msnn.verification.exported_c import read_exported_c
from msnn.verification.fuzz import fuzz_check
from msnn.verification.proof.proof import proof_checks
from tests.agreement.exported import checked
from tests.conditions import require_tool
from tests.features.fixed_point.exported import fixed_model, gallery_text, planned


@pytest.mark.parametrize("dtype", ["q15", "q31"])
@pytest.mark.parametrize("name", ["reference", "engine_map"])
def test_no_bit_differs(name: str, dtype: str, tmp_path: Path) -> None:
    require_tool("gcc", "apt-get install gcc")
    plan = planned(fixed_model(tmp_path, gallery_text(name), dtype))
    found = checked(plan, {}, tmp_path / "c")
    assert found.agrees
    assert (found.bits, found.dtype) == (0, dtype)
    assert found.steps > 100
    # the part of the range that rounding to words takes
    assert 0 < found.free_run < (2e-3 if dtype == "q15" else 2e-5)


def test_other_weights_give_other_words(tmp_path: Path) -> None:
    require_tool("gcc", "apt-get install gcc")
    plan = planned(fixed_model(tmp_path, gallery_text("reference"), "q15"))
    weights = physical_weights(plan.program, {})
    others = {name: np.asarray(value) * 1.01 for name, value in weights.items()}
    found = checked(plan, weights, tmp_path / "c", written=others)
    assert found.bits
    assert not found.agrees


@pytest.mark.parametrize("formula", ["where(k <= 0, w[t-2], 0.5 * u)", "0.5 * u + 0 * w[t-2]"])
def test_an_input_that_the_numbers_make_needless_is_left_out(formula: str, tmp_path: Path) -> None:
    require_tool("gcc", "apt-get install gcc")
    text = f"""msnn: 1
name: m
sample_time: 10 ms
inputs: {{u: {{range: [-1, 1]}}, w: {{range: [-1, 1]}}}}
parameters: {{k: {{init: 0.6, learn: false}}}}
outputs: {{y: "{formula}", z: "k * u"}}
"""
    plan = planned(fixed_model(tmp_path, text, "q15"))
    assert checked(plan, {}, tmp_path / "c").agrees


@pytest.mark.parametrize("dtype", ["q15", "q31"])
def test_integers_are_neither_fuzzed_nor_proved_as_floats(dtype: str, tmp_path: Path) -> None:
    plan = planned(fixed_model(tmp_path, gallery_text("reference"), dtype))
    write_export(plan, {}, tmp_path / "c")
    exported = read_exported_c(tmp_path / "c")
    assert exported.number == "reference_word_t"
    results = [check.run(tmp_path) for check in (fuzz_check(exported, 1), *proof_checks(exported))]
    assert {(found.check, found.verdict) for found in results} == {
        ("fuzz", "left out"),
        ("proof", "left out"),
    }
