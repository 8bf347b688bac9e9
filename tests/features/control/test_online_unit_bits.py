"""Units of controllers and estimators compute the bits of the C that lies beside them."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

from msnn.agreement.judgement import drawn_record
from msnn.exports.check import check_export
from msnn.model.weights.weights_file import initial_weights
from tests.conditions import require_package, require_tool
from tests.features.control.test_online_units import SPECS, archives, plan_of, written


@pytest.mark.parametrize(
    ("name", "dtype"), list(zip(SPECS, itertools.cycle(("float32", "float64")), strict=False))
)
def test_they_have_the_bits_of_their_c(name: str, dtype: str, tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    require_package("fmpy", install="pip install 'msnn[fmu]'")
    plan = plan_of(SPECS[name], tmp_path, dtype)
    files = written(plan, tmp_path / "out")
    record = drawn_record(plan.program, "drawn")
    found = check_export(plan, initial_weights(plan.program), files, record)
    assert found.bits == 0
    assert found.agrees, found
    assert max(path.stat().st_size for path in archives(files)) < 100_000
