"""`params: calibration` keeps values and their checksum together, where tools find both."""

from __future__ import annotations

import ctypes
import json
import struct
import subprocess
import zlib
from itertools import chain
from pathlib import Path
from textwrap import dedent
from typing import Any

import pytest

from msnn.cli.application import run
from msnn.exports.export import write_export
from msnn.exports.target import Written
from msnn.model.weights.weights_file import initial_weights
from tests.cli.command_line import CommandLine
from tests.cli.conftest import msnn as msnn
from tests.conditions import require_package, require_tool
from tests.examples.gallery import GALLERY, spec_of
from tests.exports.a2l_grammar import Block, read_a2l
from tests.exports.gdb_stub import cortex_m4
from tests.exports.test_a2l import PLANT, compiled, named, plan_of

MAIN = """
#include "plant.h"
plant_state_t state;
plant_in_t in;
plant_out_t out;
uint32_t differs, selftest;
void begin(void) { plant_init(&state, &plant_calibration.values); }
void run(void) { (void)plant_step(&state, &plant_calibration.values, &in, &out); }
void look(void)
{
    differs = plant_checksum(&plant_calibration.values) != plant_calibration.checksum;
    selftest = plant_selftest();
}
void keep(void) { plant_calibration.checksum = plant_checksum(&plant_calibration.values); }
int main(void) { begin(); run(); look(); keep(); return (int)differs; }
"""
# 8192: what the header calls PLANT_SELFTEST_CHECKSUM_DIFFERS
CHECKSUM_DIFFERS = 8192


def exported(folder: Path, *settings: str) -> Written:
    spec = folder / "plant.msnn.yaml"
    spec.write_text(dedent(PLANT), encoding="utf-8")
    plan = plan_of(spec, *(f"export.c.{setting}" for setting in settings))
    return write_export(plan, initial_weights(plan.program), folder / "c")


def address(module: Block, name: str) -> int:
    block = named(module, name)
    measured = block.kind == "MEASUREMENT"
    return int(block.keywords["ECU_ADDRESS"][0] if measured else block.values[3], 16)


@pytest.mark.parametrize(("dtype", "letter"), [("float32", "f"), ("float64", "d")])
def test_the_checksum_is_that_of_zlib_over_the_values(
    dtype: str, letter: str, tmp_path: Path
) -> None:
    require_tool("gcc", install="apt install gcc")
    folder = exported(tmp_path, "params=calibration", f"dtype={dtype}").folder
    library = compiled("gcc", "-O2 -fPIC -shared", folder, tmp_path / "plant.so", MAIN)
    code: Any = ctypes.CDLL(str(library))
    about = json.loads((folder / "plant.json").read_text(encoding="utf-8"))
    values: list[float] = list(
        chain.from_iterable(_flat(entry["values"]) for entry in about["parameters"])
    )
    checksum = zlib.crc32(struct.pack(f"<{len(values)}{letter}", *values))
    code.plant_checksum.restype = ctypes.c_uint32
    assert code.plant_checksum(code.plant_params_default) == checksum
    size = struct.calcsize(letter) * len(values)
    there = (ctypes.c_char * (size + 4)).in_dll(code, "plant_calibration")
    assert bytes(there)[-4:] == struct.pack("<I", checksum)
    code.look()
    told = [ctypes.c_uint32.in_dll(code, name) for name in ("differs", "selftest")]
    assert [word.value for word in told] == [0, 0]
    # one bit of one value
    there[1] = bytes([there[1][0] ^ 1])
    code.look()
    assert [word.value for word in told] == [1, CHECKSUM_DIFFERS]
    code.keep()
    code.look()
    assert [word.value for word in told] == [0, 0]


def _flat(values: Any) -> list[float]:
    return list(chain.from_iterable(map(_flat, values))) if isinstance(values, list) else [values]


def test_a_tuned_parameter_on_a_board_changes_output_and_checksum(
    tmp_path: Path, msnn: CommandLine
) -> None:
    """A Cortex-M4 in QEMU, read and written by the addresses that the A2L file tells."""
    require_tool("arm-none-eabi-gcc", install="apt install gcc-arm-none-eabi")
    require_tool("qemu-system-arm", install="apt install qemu-system-arm")
    require_package("elftools", install="pip install 'msnn[a2l]'")
    folder = exported(tmp_path, "params=calibration").folder
    flags = "-g -Os -ffp-contract=off -mcpu=cortex-m4 -mthumb --specs=nosys.specs"
    program = compiled("arm-none-eabi-gcc", flags, folder, msnn.folder / "plant.elf", MAIN)
    own = program.with_suffix(".a2l")
    own.write_text("of the user\n")
    said = msnn("a2l", program, "--export", folder)
    assert (said.code, "error[E1054]" in said.err) == (1, True), said.err
    assert own.read_text() == "of the user\n"
    own.unlink()
    assert msnn("a2l", program, "--export", folder).code == 0
    said = msnn("a2l", program, "--export", folder)
    assert (said.code, said.err) == (0, "")
    module = read_a2l((msnn.folder / "plant.a2l").read_text(encoding="utf-8"))
    assert named(module, "plant.gain").keywords["SYMBOL_LINK"][0] == (
        '"plant_calibration.values.gain"'
    )
    nm = ["arm-none-eabi-nm", str(program)]
    symbols = subprocess.run(nm, check=True, capture_output=True, text=True).stdout
    places = {name: int(at, 16) for at, _, name in map(str.split, symbols.splitlines())}
    (about,) = module.of("MOD_PAR")
    (segment,) = about.blocks
    name, section, *_, begin, size = segment.values[:7]
    assert (name, section) == ("plant_calibration_t", '"section .data.plant_calibration"')
    assert int(begin, 16) == places["plant_calibration"]
    # the checksum is the last word of the segment
    assert address(module, "plant.checksum") == int(begin, 16) + int(size, 16) - 4
    gain, y = address(module, "plant.gain"), address(module, "plant.y")
    with cortex_m4(program) as board:
        board.call(places["begin"])
        board.call(places["run"])
        board.call(places["look"])
        # without torque y = gain * table(slope) + 1, and the table has 2 at 0
        assert (board.read_float(gain), board.read_float(y)) == (1.5, 1.5 * 2 + 1)
        assert board.read_word(places["differs"]) == 0
        board.write_float(gain, 3.0)
        board.call(places["run"])
        board.call(places["look"])
        assert board.read_float(y) == 3 * 2 + 1
        assert board.read_word(places["differs"]) == 1
        board.call(places["keep"])
        board.call(places["look"])
        assert board.read_word(places["differs"]) == 0


def test_calibration_computes_as_tunable_does(tmp_path: Path) -> None:
    texts: list[str] = []
    for kind in ("tunable", "calibration"):
        (tmp_path / kind).mkdir()
        folder = exported(tmp_path / kind, f"params={kind}").folder
        texts.append((folder / "src" / "plant.c").read_text(encoding="utf-8"))
        assert (folder / "src" / "plant_calibration.c").exists() == (kind == "calibration")
    assert texts[0] == texts[1]


def test_the_values_lie_in_their_section(tmp_path: Path) -> None:
    for tool in ("gcc", "objdump"):
        require_tool(tool, install=f"apt install {tool}")
    folder = exported(tmp_path, "params=calibration").folder
    source = folder / "src" / "plant_calibration.c"
    command = ["gcc", "-std=c99", "-c", f"-I{folder / 'include'}", str(source), "-o"]
    for options, section in (
        ([], ".data.plant_calibration"),
        (['-DPLANT_CALIBRATION_SECTION=__attribute__((section(".tuned")))'], ".tuned"),
    ):
        subprocess.run([*command, str(tmp_path / "a.o"), *options], check=True)
        listed = subprocess.run(
            ["objdump", "-t", str(tmp_path / "a.o")], check=True, capture_output=True, text=True
        ).stdout
        (line,) = [line for line in listed.splitlines() if line.endswith(" plant_calibration")]
        assert f"\t{section}" in line or f" {section}\t" in line


def test_verification_finds_nothing_in_the_values_and_their_checksum(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    # all five have their turn in tests/verification
    monkeypatch.setattr("msnn.verification.host_builds.LEVELS", ("-O2",))
    for tool in ("gcc", "gcov", "clang", "cppcheck"):
        require_tool(tool, install=f"apt install {tool}")
    spec = spec_of(GALLERY, "engine_map")
    settings = ["--set", "export.c.params=calibration"]
    options = ["--initial", "--to", "c", "--out", str(tmp_path), *settings]
    assert run(["export", str(spec), *options]) == 0
    capsys.readouterr()
    assert run(["verify", str(tmp_path / "c"), "--misra", "--format", "json"]) == 0
    results = json.loads(capsys.readouterr().out)["results"]
    (memory,) = [result for result in results if result["check"] == "memory"]
    assert "but the parameters for calibration" in memory["detail"]


def test_fixed_point_has_no_parameters_to_tune(tmp_path: Path, msnn: CommandLine) -> None:
    spec = tmp_path / "plant.msnn.yaml"
    spec.write_text(dedent(PLANT), encoding="utf-8")
    settings = ("--set", "export.c.dtype=q15", "--set", "export.c.params=calibration")
    said = msnn("export", spec, "--initial", "--to", "c", *settings)
    assert (said.code, "error[E0962]" in said.err) == (1, True)
