"""ASAP2 files keep to their grammar, say what the spec says, and lead to the right memory."""

from __future__ import annotations

import ctypes
import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from textwrap import dedent
from typing import Any

import numpy as np
import pytest

from backends.asap2.text import a2l_text
from backends.c.folder.calibrated_model import calibrated_model
from backends.c.interface.interface import c_interface
from backends.c_lowering.options import COptions
from msnn.exports.export import plan_exports, write_export
from msnn.exports.target import AnyPlan, Written
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights
from spec_schema.diagnostics.diagnostic import Findings
from tests.cli.command_line import CommandLine
from tests.cli.conftest import msnn as msnn
from tests.conditions import require_package, require_tool
from tests.examples.gallery import GALLERY, NAMES, spec_of
from tests.exports.a2l_grammar import Block, read_a2l, string
from tests.exports.gdb_stub import cortex_m4
from tests.golden import assert_golden

GOLDEN = Path(__file__).parent.parent / "golden"
PLANT = """
msnn: 1
name: plant
doc: |
  it's "<b>" \\ of ρ */ /*
  and /end PROJECT on a second line
sample_time: 0.1 s
dims: {wheel: [front, rear], zone: 3}
constants: {tau: 1 s, T0: 1 N*m}
inputs:
  torque: {unit: N*m, dims: wheel, range: [-3, 3], doc: 'a "quoted" \\n \\ text'}
  slope: {unit: deg, range: [-9, 9]}
parameters:
  k: {init: [2, 3], dims: wheel, unit: 1/s, min: 0, max: 9, doc: "stiff\\"ness\\""}
  gain: {init: 1.5}
  block: {init: [[1, 2, 3], [4, 5, 6]], dims: [wheel, zone]}
layers:
  zones: {fuzzify: {centers: [-5, 0, 5], dim: zone}}
  moving: {fuzzify: {centers: [-4, 4], learn: true}}
  table: {interpolation: {x: [-9, 0, 9], y: [1, 2, 4], learn: true}}
states:
  w: {dims: wheel, unit: N*m, next: 0.5 * w + 0.1 * torque * k * tau, range: [-50, 50]}
outputs:
  w_next: {expr: next(w)}
  y: gain * table(slope) + sum(block * zones(slope) * torque / T0) + sum(moving(slope))
"""
MAIN = """
#include "plant.h"
typedef struct { int other; plant_params_t tuned; } controller_t;
static controller_t controller;
plant_state_t state;
plant_in_t in;
static plant_out_t out;
void begin(void) { controller.tuned = plant_params_default; plant_init(&state, &controller.tuned); }
float run(void) { (void)plant_step(&state, &controller.tuned, &in, &out); return out.y; }
void *origin(void) { return &state; }
int main(void) { begin(); return (int)run(); }
"""


def plan_of(spec: Path, *settings: str) -> AnyPlan:
    (plan,) = plan_exports(load_model(spec, settings), ["c"], Findings())
    return plan


def text_of(plan: AnyPlan, options: COptions | None = None) -> str:
    own = plan.options if options is None else options
    interface = c_interface(plan.program, replace(own, prefix=plan.prefix))
    return a2l_text(calibrated_model(plan.program, interface))


def named(module: Block, name: str) -> Block:
    return next(block for block in module.blocks if block.values[:1] == [name])


@pytest.fixture(scope="module")
def spec(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("a2l") / "plant.msnn.yaml"
    path.write_text(dedent(PLANT), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def exported(spec: Path) -> Written:
    plan = plan_of(spec, "export.c.params=tunable")
    return write_export(plan, initial_weights(plan.program), spec.parent / "c")


@pytest.mark.parametrize("name", NAMES)
def test_every_parameter_input_and_output_of_the_gallery_is_in_its_file(name: str) -> None:
    plan = plan_of(spec_of(GALLERY, name))
    interface = c_interface(plan.program, plan.options)
    module = read_a2l(text_of(plan))
    parameters = [field.name for field in interface.parameters]
    assert len(module.of("CHARACTERISTIC")) == len(parameters) > 0
    least = len(interface.inputs) + len(interface.outputs)
    assert len(module.of("MEASUREMENT")) >= least


@pytest.mark.parametrize("name", ["reference", "engine_map"])
def test_golden_files(name: str, accept: bool) -> None:
    folder = GOLDEN / f"c_gallery_{name}"
    assert_golden(folder / f"{name}.a2l", text_of(plan_of(spec_of(GALLERY, name))), accept)


def test_texts_of_a_spec_stay_texts(spec: Path) -> None:
    plan = plan_of(spec)
    module = read_a2l(text_of(plan))
    said = 'it\'s "<b>" \\ of rho */ /* and /end PROJECT on a second line'
    assert string(module.values[1]) == said
    assert string(named(module, "plant.torque").values[1]) == 'a "quoted" \\n \\ text'
    assert string(named(module, "plant.k").values[1]) == 'stiff"ness"'


def test_units_limits_and_dims_are_those_of_the_spec(spec: Path) -> None:
    module = read_a2l(text_of(plan_of(spec)))
    methods = {block.name: block.values for block in module.of("COMPU_METHOD")}
    k, torque, gain = (named(module, f"plant.{name}") for name in ("k", "torque", "gain"))
    assert k.values[2:6] == ["VAL_BLK", "0x0", "plant.FLOAT32_IEEE_rows", "0"]
    assert (k.values[7:], k.keywords["MATRIX_DIM"]) == (["0.0", "9.0"], ["2", "1", "1"])
    assert [string(methods[name][4]) for name in (k.values[6], torque.values[3])] == ["1/s", "N*m"]
    assert torque.values[6:] == ["-3.0", "3.0"]
    largest = float(np.finfo(np.float32).max)
    assert [float(value) for value in gain.values[7:]] == [-largest, largest]
    # C has wheel x zone: neighbours in memory are zones, the x of ASAP2
    assert named(module, "plant.block").keywords["MATRIX_DIM"] == ["3", "2", "1"]
    assert named(module, "plant.w").keywords["SYMBOL_LINK"] == ['"plant_state_t.w"', "0"]


def test_a_table_is_a_curve_over_the_input_that_it_looks_up(spec: Path) -> None:
    module = read_a2l(text_of(plan_of(spec)))
    table = named(module, "plant.table.y")
    assert table.values[2] == "CURVE"
    (axis,) = table.blocks
    assert axis.values[1] == "plant.slope"
    assert axis.blocks[0].values == ["-9.0", "0.0", "9.0"]
    # learned centres move: no numbers of the file can say where they stand
    assert named(module, "plant.moving.gaps").values[2] == "VAL_BLK"


def test_a_map_has_its_first_argument_along_x() -> None:
    """C keeps y[speed][throttle]: for each x the numbers along y lie together, in columns."""
    module = read_a2l(text_of(plan_of(spec_of(GALLERY, "engine_map"))))
    table = named(module, "engine_map.map.y")
    assert table.values[2] == "MAP"
    assert [axis.values[1] for axis in table.blocks] == ["engine_map.speed", "engine_map.throttle"]
    layout = named(module, table.values[4])
    assert layout.keywords["FNC_VALUES"] == ["1", "FLOAT32_IEEE", "COLUMN_DIR", "DIRECT"]


def test_parameters_in_the_code_are_no_objects(spec: Path) -> None:
    module = read_a2l(text_of(plan_of(spec), COptions(params="inline")))
    assert not module.of("CHARACTERISTIC")
    assert module.of("MEASUREMENT")


def test_float64_is_told(spec: Path) -> None:
    module = read_a2l(text_of(plan_of(spec), COptions(dtype="float64")))
    assert named(module, "plant.slope").values[2] == "FLOAT64_IEEE"


@pytest.mark.parametrize(("dtype", "word"), [("q15", "SWORD"), ("q31", "SLONG")])
def test_words_have_the_scale_of_their_port(dtype: str, word: str, tmp_path: Path) -> None:
    plan = plan_of(spec_of(GALLERY, "reference"), f"export.c.dtype={dtype}")
    write_export(plan, initial_weights(plan.program), tmp_path)
    module = read_a2l((tmp_path / "reference.a2l").read_text(encoding="utf-8"))
    description = json.loads((tmp_path / "reference.json").read_text(encoding="utf-8"))
    (port,) = (f for f in description["c"]["structs"]["in"] if f["name"] == "u")
    u = named(module, "reference.u")
    assert u.values[2] == word
    method = named(module, u.values[3])
    assert float(method.keywords["COEFFS_LINEAR"][0]) == 2.0 ** -port["fraction"]
    assert [float(value) for value in u.values[6:]] == port["range"]


class Built:
    """The plant of a shared library, whose memory is read and written by its addresses."""

    def __init__(self, library: Path, module: Block) -> None:
        self.code: Any = ctypes.CDLL(str(library))
        self.code.run.restype = ctypes.c_float
        self.code.origin.restype = ctypes.c_void_p
        self._module = module
        self._base = self.code.origin() - self.address("plant.w")

    def address(self, name: str) -> int:
        block = named(self._module, name)
        measured = block.kind == "MEASUREMENT"
        return int(block.keywords["ECU_ADDRESS"][0] if measured else block.values[3], 16)

    def write(self, name: str, value: float, index: int = 0) -> None:
        at = self._base + self.address(name) + 4 * index
        ctypes.c_float.from_address(at).value = value


def compiled(compiler: str, flags: str, folder: Path, program: Path, main: str = MAIN) -> Path:
    source = program.with_suffix(".c")
    source.write_text(main, encoding="utf-8")
    sources = [str(path) for path in sorted((folder / "src").glob("*.c"))]
    command = [compiler, *flags.split(), f"-I{folder / 'include'}", str(source), *sources]
    subprocess.run([*command, "-o", str(program), "-lm"], check=True, capture_output=True)
    return program


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_a_parameter_written_at_its_address_changes_the_running_model(
    compiler: str, exported: Written, msnn: CommandLine
) -> None:
    require_tool(compiler, install=f"apt install {compiler}")
    require_package("elftools", install="pip install 'msnn[a2l]'")
    library = msnn.folder / "plant.so"
    compiled(compiler, "-g -O2 -fPIC -shared", exported.folder, library)
    said = msnn("a2l", library, "--export", exported.folder)
    assert (said.code, said.err) == (0, "")
    module = read_a2l((msnn.folder / "plant.a2l").read_text(encoding="utf-8"))
    assert named(module, "plant.gain").keywords["SYMBOL_LINK"][0] == '"controller.tuned.gain"'
    built = Built(library, module)
    built.code.begin()
    # without torque y = gain * table(slope) + 1, and the table has 1, 2, 4 at -9, 0, 9
    assert built.code.run() == 1.5 * 2 + 1
    built.write("plant.gain", 3.0)
    assert built.code.run() == 3 * 2 + 1
    built.write("plant.table.y", 10.0, index=1)
    assert built.code.run() == 3 * 10 + 1
    built.write("plant.slope", 9.0)
    assert built.code.run() == 3 * 4 + 1
    # the filled file is otherwise the one that was exported
    links = re.compile(r'0x[0-9A-F]+|"[^"]*"')
    kept = (exported.folder / "plant.a2l").read_text(encoding="utf-8")
    new = (msnn.folder / "plant.a2l").read_text(encoding="utf-8")
    new = new.replace("ADDR_EPK ", "")
    assert links.sub("", new).split() == links.sub("", kept).split()


def compiled_for_arm(exported: Written, msnn: CommandLine) -> Path:
    flags = "-g -Os -mcpu=cortex-m4 -mthumb --specs=nosys.specs"
    program = msnn.folder / "plant.elf"
    return compiled("arm-none-eabi-gcc", flags, exported.folder, program)


def test_addresses_for_a_microcontroller_are_those_of_its_linker(
    exported: Written, msnn: CommandLine
) -> None:
    require_tool("arm-none-eabi-gcc", install="apt install gcc-arm-none-eabi")
    require_package("elftools", install="pip install 'msnn[a2l]'")
    program = compiled_for_arm(exported, msnn)
    said = msnn("a2l", program, "--export", exported.folder, "--format", "json")
    assert (said.code, said.err) == (0, "")
    nm = ["arm-none-eabi-nm", str(program)]
    symbols = subprocess.run(nm, check=True, capture_output=True, text=True).stdout
    places = {name: int(at, 16) for at, _, name in map(str.split, symbols.splitlines())}
    found = json.loads(said.out)["instances"]
    assert found["state"] == {"variable": "state", "address": places["state"]}
    assert found["params"] == {"variable": "controller.tuned", "address": places["controller"] + 4}
    module = read_a2l((msnn.folder / "plant.a2l").read_text(encoding="utf-8"))
    slope = named(module, "plant.slope").keywords["ECU_ADDRESS"][0]
    assert int(slope, 16) == places["in"] + 8


def test_a_parameter_written_on_a_board_changes_what_it_computes(
    exported: Written, msnn: CommandLine
) -> None:
    """A Cortex-M4 in QEMU, read and written as a calibration tool does: by address alone."""
    require_tool("arm-none-eabi-gcc", install="apt install gcc-arm-none-eabi")
    require_tool("qemu-system-arm", install="apt install qemu-system-arm")
    require_package("elftools", install="pip install 'msnn[a2l]'")
    program = compiled_for_arm(exported, msnn)
    assert msnn("a2l", program, "--export", exported.folder).code == 0
    module = read_a2l((msnn.folder / "plant.a2l").read_text(encoding="utf-8"))
    gain, table = (
        int(named(module, f"plant.{name}").values[3], 16) for name in ("gain", "table.y")
    )
    y = int(named(module, "plant.y").keywords["ECU_ADDRESS"][0], 16)
    nm = ["arm-none-eabi-nm", str(program)]
    symbols = subprocess.run(nm, check=True, capture_output=True, text=True).stdout
    places = {name: int(at, 16) for at, _, name in map(str.split, symbols.splitlines())}
    with cortex_m4(program) as board:
        board.call(places["begin"])
        board.call(places["run"])
        assert (board.read_float(gain), board.read_float(y)) == (1.5, 1.5 * 2 + 1)
        board.write_float(gain, 3.0)
        board.write_float(table + 4, 10.0)
        board.call(places["run"])
        assert board.read_float(y) == 3 * 10 + 1


@pytest.fixture
def host(exported: Written, msnn: CommandLine) -> CommandLine:
    """The command line in a folder with programs of several faults."""
    require_tool("gcc", install="apt install gcc")
    require_package("elftools", install="pip install 'msnn[a2l]'")
    shutil.copytree(exported.folder, msnn.folder / "build" / "export" / "c")
    return msnn


def test_the_defaults_are_taken_where_no_other_parameters_are(host: CommandLine) -> None:
    main = '#include "plant.h"\nplant_state_t s; plant_in_t u;\nint main(void) '
    main += "{ plant_out_t y; return (int)plant_step(&s, &plant_params_default, &u, &y); }\n"
    folder = host.folder / "build" / "export" / "c"
    compiled("gcc", "-g", folder, host.folder / "p.elf", main)
    said = host("a2l", "p.elf")
    assert said.code == 0
    assert "plant_params_default at 0x" in said.out
    assert said.err.startswith(
        "warning[W1302]: no variable with a fixed address is a `plant_out_t`"
    )
    module = read_a2l((host.folder / "p.a2l").read_text(encoding="utf-8"))
    assert named(module, "plant.y").keywords["ECU_ADDRESS"] == ["0x0"]
    assert int(named(module, "plant.gain").values[3], 16) > 0


@pytest.mark.parametrize(("dtype", "types"), [("q15", {"word", "sum"}), ("q31", {"word"})])
def test_words_and_sums_of_a_program_get_addresses(
    dtype: str, types: set[str], msnn: CommandLine
) -> None:
    require_tool("gcc", install="apt install gcc")
    require_package("elftools", install="pip install 'msnn[a2l]'")
    plan = plan_of(spec_of(GALLERY, "heater"), f"export.c.dtype={dtype}")
    folder = write_export(plan, initial_weights(plan.program), msnn.folder / "c").folder
    description = json.loads((folder / "heater.json").read_text(encoding="utf-8"))["c"]
    assert types <= {member["type"] for member in description["structs"]["state"]}
    main = '#include "heater.h"\nheater_state_t s; heater_in_t u; heater_out_t y;\n'
    main += "int main(void) { heater_init(&s); return (int)heater_step(&s, &u, &y); }\n"
    said = msnn("a2l", compiled("gcc", "-g", folder, msnn.folder / "p.elf", main), "--export", "c")
    assert (said.code, said.err) == (0, "")
    module = read_a2l((msnn.folder / "p.a2l").read_text(encoding="utf-8"))
    measured = [block.keywords["ECU_ADDRESS"] for block in module.of("MEASUREMENT")]
    assert len(measured) >= 5
    assert all(int(at, 16) > 0 for (at,) in measured)


_TWO = '#include "plant.h"\nplant_params_t one, two;\nint main(void) { return 0; }\n'


def test_programs_that_do_not_fit_are_told(host: CommandLine) -> None:
    folder = host.folder / "build" / "export" / "c"
    two = compiled("gcc", "-g", folder, host.folder / "two.elf", _TWO)
    said = host("a2l", two)
    assert (said.code, "error[E1304]" in said.err) == (1, True)
    assert "`one`, `two`" in said.err
    assert "--params NAME" in said.err
    assert host("a2l", two, "--params", "two").code == 0
    said = host("a2l", two, "--params", "three")
    assert (said.code, "error[E1305]" in said.err) == (1, True)
    header = (folder / "include" / "plant.h").read_text(encoding="utf-8")
    other = host.folder / "other"
    shutil.copytree(folder, other)
    (other / "include" / "plant.h").write_text(header.replace("table_y[3]", "table_y[4]"))
    mixed = compiled("gcc", "-g", other, host.folder / "mixed.elf", MAIN)
    said = host("a2l", mixed)
    assert (said.code, "error[E1306]" in said.err) == (1, True)
    assert "`controller.tuned.table_y` has 16 bytes there and 12 in the export" in said.err


def test_a_program_with_other_weights_is_refused(host: CommandLine) -> None:
    """Its structs are the same, its numbers are not."""
    folder = host.folder / "build" / "export" / "c"
    right = compiled("gcc", "-g", folder, host.folder / "right.elf", MAIN)
    assert host("a2l", right).code == 0
    filled = (host.folder / "right.a2l").read_text(encoding="utf-8")
    (at, epk) = re.findall(r'ADDR_EPK 0x([0-9A-F]+) EPK "(\w{64})"', filled)[0]
    nm = subprocess.run(["nm", str(right)], check=True, capture_output=True, text=True).stdout
    assert int(at, 16) == int(re.findall(r"(\w+) R plant_export_sha256", nm)[0], 16)
    header = folder / "include" / "plant.h"
    assert epk in header.read_text(encoding="utf-8")
    header.write_text(header.read_text(encoding="utf-8").replace(epk, "0" * 64))
    said = host("a2l", compiled("gcc", "-g", folder, host.folder / "other.elf", MAIN))
    assert (said.code, "error[E1327]" in said.err) == (1, True)
    assert f"holds the export 000000000000, the folder is {epk[:12]}" in said.err


def test_files_without_what_is_needed_are_told(host: CommandLine) -> None:
    folder = host.folder / "build" / "export" / "c"
    (host.folder / "text.elf").write_text("no program")
    assert "error[E1303]" in host("a2l", "text.elf").err
    compiled("gcc", "", folder, host.folder / "bare.elf")
    assert "has no debug information" in host("a2l", "bare.elf").err
    compiled("gcc", "-g", folder, host.folder / "empty.elf", "int main(void) { return 0; }\n")
    said = host("a2l", "empty.elf", "--export", ".")
    assert (said.code, "error[E1302]" in said.err) == (1, True)
    (folder / "src" / "plant_params.c").unlink()
    for source in (folder / "src").glob("*selftest.c"):
        source.unlink()
    compiled("gcc", "-g", folder, host.folder / "empty.elf", "int main(void) { return 0; }\n")
    said = host("a2l", "empty.elf")
    assert (said.code, "error[E1307]" in said.err) == (1, True)
