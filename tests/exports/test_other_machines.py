"""Units and exported C compute on Windows and on AArch64 what they compute here, bit for bit.

`benchmarks/fmu/machines.py` does this for the whole gallery, controllers and estimators.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from msnn.exports.export import plan_exports, write_export
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights
from spec_schema.diagnostics.diagnostic import Findings
from tests.conditions import require_package, require_tool
from tests.examples.gallery import GALLERY, spec_of
from tests.exports.other_machines.machines import Machine, aarch64, this_machine, windows
from tests.exports.other_machines.unit_script import (
    ALONE,
    OTHER,
    STEPS,
    TURN,
    Unit,
    answers,
    of_instance,
    read_unit,
)

MACHINES = {"x86_64-windows": windows, "aarch64-linux": aarch64}
NAME = "heater"
"""Has parameters that are tuned, a declared state and functions of the kernels."""


@pytest.fixture(params=MACHINES)
def other(request: pytest.FixtureRequest) -> Machine:
    require_tool("gcc", install="apt install gcc")
    make: Callable[[], Machine] = MACHINES[request.param]
    return make()


def exported(target: str, setting: str, folder: Path) -> Path:
    model = load_model(spec_of(GALLERY, NAME), [f"export={{{target}: {setting}}}"])
    (plan,) = plan_exports(model, [target], Findings())
    write_export(plan, initial_weights(plan.program), folder / target)
    return folder / target


def test_units_answer_as_here(other: Machine, tmp_path: Path) -> None:
    require_package("fmpy", install="pip install 'msnn[fmu]'")
    platform = other.platform.fmi3
    folder = exported("fmu", f"{{dtype: float64, platforms: [{platform}]}}", tmp_path)
    here = this_machine()
    hosts = {machine: machine.unit_host(tmp_path) for machine in (here, other)}
    units = [read_unit(path) for path in sorted(folder.glob("*.fmu"))]
    # FMI 2.0 has no name for AArch64
    ran = [unit for unit in units if unit.version == 3 or other.platform.fmi2 is not None]
    for unit in ran:
        expected = answers(here, hosts[here], unit, tmp_path)
        assert expected is not None
        is_an_importers_run(expected, unit)
        assert answers(other, hosts[other], unit, tmp_path) == expected


def is_an_importers_run(told: list[str], unit: Unit) -> None:
    """What two binaries could have in common without computing anything."""
    assert told[1].startswith("log 3 the")
    assert told[2] == "refused"
    assert [line for line in told if line.endswith("= 3")] == [" = 3"], "a step of half a sample"
    one, other, alone = (of_instance(told, instance) for instance in (TURN, OTHER, ALONE))
    begun = len(alone)
    each = begun // STEPS
    assert one[:begun] == alone
    assert one[begun:] == other[begun:], "both go on from one state"
    assert one[:begun] != other[:begun]
    assert len({str(alone[k : k + each]) for k in range(0, begun, each)}) == STEPS
    assert unit.has_slopes == any(line.startswith("slope") for line in told)


def test_exported_c_passes_its_tests(other: Machine, tmp_path: Path) -> None:
    folder = exported("c", "{dtype: float32}", tmp_path)
    program = other.self_test(folder, tmp_path / "test.exe")
    assert other.said(program) == this_machine_said(folder, tmp_path)
    vectors = next((folder / "test").glob("*_vectors.h"))
    text = vectors.read_text(encoding="utf-8")
    broken = text.replace("0x1.", "0x1.8", 40)
    assert broken != text
    vectors.write_text(broken, encoding="utf-8")
    assert "exit code 1" in other.said(other.self_test(folder, tmp_path / "broken.exe"))


def this_machine_said(folder: Path, place: Path) -> str:
    here = this_machine()
    said = here.said(here.self_test(folder, place / "here"))
    assert "exit code" not in said
    return said
