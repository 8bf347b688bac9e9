"""Saved states of units: damage is told, and no bits of one lead outside of its memory."""

from __future__ import annotations

import subprocess
import zipfile
from pathlib import Path
from textwrap import dedent

import pytest

from backends.fmu.binary import HEADERS
from msnn.exports.export import plan_exports, write_export
from msnn.exports.running.loaded_fmu import fmu_instance
from msnn.exports.target import Written
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights
from spec_schema.diagnostics.diagnostic import Findings
from tests.conditions import require_package, require_tool
from tests.features.control.test_online_units import HEATED, WINDOW

PLANT = """
msnn: 1
name: plant
sample_time: 0.1 s
inputs: {u: {range: [-3, 3]}}
parameters: {k: 0.9}
layers:
  map: {interpolation: {x: [-1, 0, 2, 5], y: [0, 1, -1, 3]}}
  w: {fir: {window: 40}}
states: {x: {next: k * x + map(u), init: 0, history: 0, range: [-9, 9], on_range: saturate}}
outputs: {y: "w(x) + map(x[t-3]) + sin(x)"}

"""

DRIVER = """
#include "fmi3Functions.h"
#include "PREFIX_fmu.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void hear(fmi3InstanceEnvironment e, fmi3Status s, fmi3String c, fmi3String m)
{
    (void)e; (void)s; (void)c; (void)m;
}

/* Spoils saved states in ever other ways and goes on from each. */
int main(void)
{
    fmi3Instance i = fmi3InstantiateCoSimulation("i", PREFIX_MACRO_FMU_TOKEN, "", 0, 0, 0, 0, NULL,
        0U, NULL, hear, NULL);
    if (i == NULL) return 1;
    fmi3EnterInitializationMode(i, 0, 0.0, 0.0, 0, 0.0);
    fmi3ExitInitializationMode(i);
    fmi3Boolean event, end, early;
    fmi3Float64 last;
    uint64_t drawn = 12U;
    for (int round = 0; round < ROUNDS; round++) {
        fmi3FMUState state = NULL;
        fmi3GetFMUState(i, &state);
        unsigned char *bytes = state;
        for (size_t k = 0U; k < sizeof(PREFIX_fmu_memory_t); k++) {
            drawn = drawn * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
            const unsigned char new = (round % 3 == 0) ? 0xFFU : (unsigned char)(drawn >> 40);
            if ((round % 3 != 2) || ((drawn >> 56) < 9U)) bytes[k] = new;
        }
        ((PREFIX_fmu_memory_t *)state)->phase = PREFIX_MACRO_FMU_STEPPING;
        fmi3SetFMUState(i, state);
        fmi3FreeFMUState(i, &state);
        for (int k = 0; k < 3; k++) (void)fmi3DoStep(i, 0.0, EVERY, 0, &event, &end, &early, &last);
        fmi3Reset(i);
        fmi3EnterInitializationMode(i, 0, 0.0, 0.0, 0, 0.0);
        fmi3ExitInitializationMode(i);
    }
    fmi3FreeInstance(i);
    puts("done");
    return 0;
}
"""


ROUNDS = 30


def exported(text: str, folder: Path, target: str) -> Written:
    path = folder / "spec.msnn.yaml"
    path.write_text(dedent(text), encoding="utf-8")
    settings = ["export.mpc.with=fmu"] if target == "mpc" else []
    (plan,) = plan_exports(load_model(path, settings), [target], Findings())
    return write_export(plan, initial_weights(plan.program), folder / "out")


@pytest.mark.parametrize(
    ("text", "target", "suffix", "step"),
    [
        (PLANT, "fmu", "plant", 0.1),
        (HEATED, "mpc", "heated_mpc", 2.0),
        (HEATED, "mpc", "heated_ekf", 2.0),
        (WINDOW, "mpc", "heated_mhe", 2.0),
    ],
    ids=["model", "controller", "filter", "window"],
)
def test_no_bits_of_a_state_lead_outside_of_its_memory(
    text: str, target: str, suffix: str, step: float, tmp_path: Path
) -> None:
    require_tool("gcc", install="apt install gcc")
    written = exported(text, tmp_path, target)
    (unit,) = (p for p in written.files if p.name == f"{suffix}_fmi3.fmu")
    with zipfile.ZipFile(unit) as archive:
        names = [name for name in archive.namelist() if name.startswith("sources/")]
        archive.extractall(tmp_path / "unit", names)
    driver = DRIVER.replace("PREFIX_MACRO", suffix.upper()).replace("PREFIX", suffix)
    (tmp_path / "driver.c").write_text(driver, encoding="utf-8")
    sources = [str(tmp_path / "unit" / name) for name in names if name.endswith(".c")]
    flags = ["-std=c99", "-O0", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    flags += [f"-DEVERY={step}", f"-DROUNDS={ROUNDS}"]
    included = [f"-I{tmp_path / 'unit' / 'sources'}", f"-I{HEADERS}"]
    program = tmp_path / "driver"
    command = ["gcc", *flags, *included, str(tmp_path / "driver.c"), *sources, "-o", str(program)]
    subprocess.run([*command, "-lm"], check=True, capture_output=True)
    found = subprocess.run([program], capture_output=True, text=True, timeout=300, check=False)
    assert (found.stderr, found.stdout) == ("", "done\n")


def test_a_damaged_state_is_refused(tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    require_package("fmpy", install="pip install 'msnn[fmu]'")
    written = exported(PLANT, tmp_path, "fmu")
    for path in sorted(path for path in written.files if path.suffix == ".fmu"):
        with fmu_instance(path) as unit:
            unit.initialise()
            unit.begin()
            unit.step(0, 0.1)
            state = unit.state
            for place in range(0, len(state), 7):
                spoiled = bytearray(state)
                spoiled[place] ^= 1
                with pytest.raises(Exception, match="erialize"):
                    unit.state = bytes(spoiled)
                assert unit.messages[-1] == "the bytes are no state of this unit, or damaged"
            unit.state = state


def test_a_terminated_unit_says_so(tmp_path: Path) -> None:
    require_tool("gcc", install="apt install gcc")
    require_package("fmpy", install="pip install 'msnn[fmu]'")
    written = exported(PLANT, tmp_path, "fmu")
    for path in sorted(path for path in written.files if path.suffix == ".fmu"):
        with fmu_instance(path) as unit:
            with pytest.raises(Exception, match="DoStep"):
                unit.step(0, 0.1)
            assert unit.messages[-1] == "the initialisation has to end before the first step"
            unit.initialise()
            unit.begin()
            unit.end()
            with pytest.raises(Exception, match="DoStep"):
                unit.step(0, 0.1)
            assert unit.messages[-1] == "the simulation was terminated: a reset begins another"
