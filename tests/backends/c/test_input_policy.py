"""What the step does about inputs outside their range, NaN and infinities."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from backends.c import COptions
from compiler.ir.program import InvalidPolicy
from tests.backends.c.c_programs import assert_same_bits, built, golden, replay
from tests.backends.c.small_programs import filtered, remembering

LIMITS = (-2.0, 3.0)
NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize("policy", ["clamp", "hold", "flag", "trust"])
@pytest.mark.parametrize("limits", [LIMITS, None, (0.5, INF)], ids=str)
@pytest.mark.parametrize("cells", [False, True], ids=["scalar", "array"])
@pytest.mark.parametrize("constant_time", [False, True])
def test_vectors_with_invalid_inputs(
    policy: InvalidPolicy,
    limits: tuple[float, float] | None,
    cells: bool,
    constant_time: bool,
    tmp_path: Path,
) -> None:
    for dtype in ("float32", "float64"):
        options = COptions(dtype=dtype, constant_time=constant_time)
        program = filtered(policy, limits, cells)
        vectors = golden(program, options, 60, seed=2)
        if policy in ("clamp", "hold"):
            assert np.isnan(vectors.inputs["u"]).any()
            assert np.isfinite(vectors.outputs["mean"]).all()
        step = built(program, tmp_path / dtype, options)
        outputs, status = replay(step, vectors)
        assert_same_bits(outputs, vectors.outputs)
        assert np.array_equal(status, vectors.status)


@pytest.mark.parametrize(
    ("policy", "value", "seen", "bits"),
    [
        ("clamp", 7.0, 3.0, ["CLAMPED"]),
        ("clamp", -INF, -2.0, ["CLAMPED"]),
        ("clamp", NAN, 0.0, ["CLAMPED", "NOT_A_NUMBER"]),
        ("clamp", 3.0, 3.0, []),
        ("hold", 7.0, 1.0, ["HELD"]),
        ("hold", NAN, 1.0, ["HELD", "NOT_A_NUMBER"]),
        ("hold", 2.0, 2.0, []),
        ("flag", 7.0, 7.0, ["OUT_OF_RANGE"]),
        ("flag", NAN, NAN, ["NOT_A_NUMBER"]),
        ("flag", -2.0, -2.0, []),
        ("trust", 7.0, 7.0, []),
        ("trust", NAN, NAN, []),
    ],
)
def test_one_value(
    policy: InvalidPolicy, value: float, seen: float, bits: list[str], tmp_path: Path
) -> None:
    step = built(filtered(policy, LIMITS, cells=False), tmp_path, COptions())
    step.reset({"u": np.zeros(2)})
    step.step({"u": 1.0})
    outputs, status = step.step({"u": value})
    np.testing.assert_array_equal(outputs["now"], np.float32(seen))
    assert status == sum(step.status_bits[f"SMALL_STATUS_{bit}"] for bit in bits)


@pytest.mark.parametrize("constant_time", [False, True])
@pytest.mark.parametrize("cells", [False, True], ids=["scalar", "array"])
@pytest.mark.parametrize(
    ("policy", "seen"),
    [
        # in place of NaN the valid value nearest to 0
        ("clamp", [2.0, 0.5, 2.0, 0.5, 1.5]),
        # the one before, as it was corrected: of two invalid ones in a row the second too
        ("hold", [0.5, 0.5, 0.5, 0.5, 1.5]),
        ("flag", [9.0, NAN, 8.0, -1.0, 1.5]),
    ],
)
def test_the_window_that_reset_takes(
    policy: InvalidPolicy, seen: list[float], cells: bool, constant_time: bool, tmp_path: Path
) -> None:
    options = COptions(constant_time=constant_time)
    step = built(remembering(policy, (0.5, 2.0), cells), tmp_path, options)
    given, valid = [9.0, NAN, 8.0, -1.0, 1.5], [1.0] * 5
    step.reset({"u": np.array([valid, given, valid] if cells else given)})
    found, _ = step.step({"u": np.ones(3) if cells else 1.0})
    wanted = np.array([valid, seen, valid] if cells else seen, np.float32)
    np.testing.assert_array_equal(found["past"], wanted)


def test_hold_begins_with_the_valid_value_nearest_to_zero(tmp_path: Path) -> None:
    step = built(filtered("hold", (0.5, 2.0), cells=False), tmp_path, COptions())
    step.init()
    assert step.step({"u": NAN})[0]["now"] == 0.5
