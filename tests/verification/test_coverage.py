"""Golden steps and self-test reach all of the gallery's C but what is listed here with a reason."""

from __future__ import annotations

from pathlib import Path

import pytest

from msnn.cli.application import run
from msnn.verification.exported_c import read_exported_c
from msnn.verification.host.coverage import coverage
from msnn.verification.tools import GCC, GCOV
from tests.conditions import miss
from tests.examples.gallery import GALLERY, NAMES, spec_of

CLIPPED = "the next state is clipped to its range: only NaN leaves it, and that is not >="
LIMITED = "the policy of the inputs leaves neither NaN nor a number beyond the table"
NO_NAN = "the policy of the inputs leaves no NaN"
REPLACED = "the policy of the samples that reset takes leaves only numbers of their range"
CONSTANT = "reset sets it to a number inside its range"
NOT_NEGATIVE = "atan serves atan2 alone, which gives it no negative number"
NOT_POSITIVE = "exp serves softplus alone, which gives it no positive number"

_REACHED_BY_NAN = "return (x > 0.0f) ? 1.0f : ((x < 0.0f) ? (-1.0f) : ((x >= 0.0f) ? 0.0f : x));"

UNREACHED: dict[str, dict[str, str]] = {
    "arm_friction": {
        "arm_friction_reset: 1 branch not reached: "
        "if (!(fabsf(s->rate_tape[(i * 5U) + j]) <= 3.4028235e+38f)) {": REPLACED,
        "arm_friction_reset: line not reached: status |= ARM_FRICTION_STATUS_STATE_NOT_FINITE;": (
            REPLACED
        ),
    },
    "battery": {
        f"battery_sign: 1 branch not reached: {_REACHED_BY_NAN}": NO_NAN,
        "battery_step: 1 branch not reached: "
        "if (!((s->charge >= 0.0f) && (s->charge <= 1.0f))) {": CLIPPED,
        "battery_reset: 1 branch not reached: "
        "if (!(fabsf(s->polarisation_state[0U]) <= 3.4028235e+38f)) {": CONSTANT,
        "battery_reset: 1 branch not reached: "
        "if (!(fabsf(s->polarisation_state[1U]) <= 3.4028235e+38f)) {": CONSTANT,
        "battery_reset: line not reached: status |= BATTERY_STATUS_STATE_NOT_FINITE;": CONSTANT,
    },
    "cart_pole": {
        "cart_pole_reset: 1 branch not reached: if (!(fabsf(s->x) <= 5.0f)) {": CONSTANT,
        "cart_pole_reset: 1 branch not reached: if (!(fabsf(s->speed) <= 10.0f)) {": CONSTANT,
        "cart_pole_reset: line not reached: status |= CART_POLE_STATUS_STATE_OUT_OF_RANGE;": (
            CONSTANT
        ),
        "cart_pole_atan: 1 branch not reached: result = (x < 0.0f) ? (-t4) : t4;": NOT_NEGATIVE,
    },
    "engine_map": {
        "engine_map_minimum: 3 branches not reached: "
        "return (a <= b) ? a : ((a > b) ? b : (a + b));": LIMITED,
        "engine_map_maximum: 1 branch not reached: "
        "return (a >= b) ? a : ((a < b) ? b : (a + b));": LIMITED,
        "engine_map_step: line not reached: "
        "? engine_map_maximum(((throttle - 0.0f) * 0.0f) + 1.0f, 0.0f)": LIMITED,
        "engine_map_step: 1 branch not reached: "
        ": engine_map_maximum(0.0f, ((throttle - 0.2f) * (-5.0f)) + 0.0f);": LIMITED,
        "engine_map_step: line not reached: "
        "? engine_map_maximum(((speed - 800.0f) * 0.0f) + 1.0f, 0.0f)": LIMITED,
        "engine_map_step: 1 branch not reached: "
        ": engine_map_maximum(0.0f, ((speed - 2000.0f) * (-0.00083333335f)) + 0.0f);": LIMITED,
        "engine_map_exp: 1 branch not reached: if (x <= 0x1.62e43p+6f) {": NOT_POSITIVE,
        "engine_map_exp: line not reached: result = x * 0x1p+127f;": NOT_POSITIVE,
    },
    "heater": {
        "heater_reset: 1 branch not reached: if (!(fabsf(s->error_sum) <= 500.0f)) {": CONSTANT,
        "heater_reset: line not reached: status |= HEATER_STATUS_STATE_OUT_OF_RANGE;": CONSTANT,
        "heater_reset: line not reached: status |= HEATER_STATUS_STATE_NOT_FINITE;": CONSTANT,
    }
    | {
        "heater_reset: 1 branch not reached: "
        f"if (!(fabsf(s->element_state[{i}U]) <= 3.4028235e+38f)) {{": CONSTANT
        for i in range(3)
    },
    "lane_keeper": {
        "lane_keeper_reset: 1 branch not reached: "
        "if (!(fabsf(s->steering_tape[i]) <= 3.4028235e+38f)) {": REPLACED,
        "lane_keeper_reset: line not reached: status |= LANE_KEEPER_STATUS_STATE_NOT_FINITE;": (
            REPLACED
        ),
    },
    "leg": {
        "leg_minimum: 3 branches not reached: return (a <= b) ? a : ((a > b) ? b : (a + b));": (
            LIMITED
        ),
        "leg_maximum: 3 branches not reached: return (a >= b) ? a : ((a < b) ? b : (a + b));": (
            LIMITED
        ),
        "leg_atan: 1 branch not reached: result = (x < 0.0f) ? (-t4) : t4;": NOT_NEGATIVE,
    },
}
"""By model: the function, the line, and why nothing reaches it."""


@pytest.mark.parametrize("name", NAMES)
def test_golden_steps_reach_all_but_what_has_a_reason(name: str, tmp_path: Path) -> None:
    for tool in (GCC, GCOV):
        if not tool.is_there:
            miss(f"{tool.command} is not installed: apt-get install {tool.package}")
    out = tmp_path / "out"
    spec = str(spec_of(GALLERY, name))
    assert run(["export", spec, "--initial", "--to", "c", "--out", str(out)]) == 0
    found = coverage(read_exported_c(out / "c"), tmp_path)
    unreached = {str(place).split(": ", 1)[1] for place in found.unreached}
    assert unreached == set(UNREACHED.get(name, {}))
    assert found.branches > 0
