"""On AVR constants take RAM unless they are placed in flash, and `double` has 4 bytes."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from backends.c import COptions, write_c
from backends.c_language.literals import Dtype
from compiler.interpreter.interpreter import Interpreter
from compiler.passes.to_step_form import to_step_form
from msnn.cli.application import run
from msnn.cli.exit_codes import ExitCode
from tests.conditions import require_tool
from tests.language.compiled import compiled

NET = """
inputs: {u: {range: [-1, 1]}, v: {range: [-1, 1]}}
layers: {net: {mlp: {hidden: [20, 26], init: {normal: {std: 0.3}}}}}
outputs: {y: {expr: "net(u, v)"}}
"""
"""633 weights: 2.5 KB, in a processor with 2 KB of RAM."""
MAIN = r"""
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include "net.h"
static net_state_t s;
static void put(char letter)
{
    while (!(UCSR0A & (1 << UDRE0))) {
    }
    UDR0 = letter;
}
int main(void)
{
    UCSR0B = 1 << TXEN0;
    net_init(&s, &net_params_default);
    for (int step = 0; step < 8; step++) {
        const net_in_t u = {step / 8.0f, -0.5f};
        net_out_t y;
        union { float real; uint32_t bits; } answer;
        (void)net_step(&s, &net_params_default, &u, &y);
        answer.real = y.y;
        for (int shift = 28; shift >= 0; shift -= 4) {
            put("0123456789abcdef"[(answer.bits >> shift) & 15]);
        }
        put('\n');
    }
    cli();
    sleep_enable();
    sleep_cpu(); /* ends the simulation */
    return 0;
}
"""


_DROPS = ("-fdata-sections", "-ffunction-sections", "-Wl,--gc-sections")
"""As the cores of Arduino have it: what nothing reads is left out, such as texts of the origin."""


def built(
    folder: Path, chip: str, *flags: str, main: str = MAIN
) -> subprocess.CompletedProcess[str]:
    compiler = require_tool("avr-gcc", install="apt install gcc-avr avr-libc")
    (folder / "main.c").write_text(main)
    sources = [p for p in sorted((folder / "src").glob("*.c")) if "_selftest" not in p.name]
    command = [
        compiler,
        f"-mmcu={chip}",
        "-std=gnu99",
        "-Os",
        "-ffp-contract=off",
        "-Wall",
        "-Werror",
        # without it a pointer into flash is silently one into RAM
        "-Waddr-space-convert",
        *_DROPS,
    ]
    return subprocess.run(
        [
            *command,
            *flags,
            f"-I{folder / 'include'}",
            folder / "main.c",
            *sources,
            "-o",
            folder / "a.elf",
            "-lm",
        ],
        capture_output=True,
        text=True,
        check=False,
    )


def answers(folder: Path, chip: str) -> list[str]:
    simulator = require_tool("simavr", install="apt install simavr")
    done = subprocess.run(
        [simulator, "-m", chip, "-f", "16000000", folder / "a.elf"],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    # it shows the end of a line as a dot, in colour
    return re.findall(r"([0-9a-f]{8})\.", done.stdout + done.stderr)


def test_weights_placed_in_flash_take_no_ram_and_keep_the_bits(tmp_path: Path) -> None:
    program = to_step_form(compiled(NET))
    write_c(program, {}, tmp_path, COptions(prefix="net"))
    (size,) = re.findall(r"has (\d+) bytes of constants", (tmp_path / "README.md").read_text())
    assert int(size) == 4 * 633
    judge = Interpreter(program, {}, "float32")
    u = np.arange(8, dtype=np.float32) / 8
    log = {"u": u, "v": np.full(8, -0.5, np.float32)}
    wanted = judge.step(log, np.arange(8), {}, losses=False).outputs["y"]
    expected = [f"{word:08x}" for word in wanted.astype(np.float32).view(np.uint32).ravel()]
    small, large = "atmega328p", "atmega2560"
    crowded = built(tmp_path, small)
    assert crowded.returncode != 0
    assert "is not within region" in crowded.stderr  # 2 KB
    placed = built(tmp_path, small, "-DNET_IN_FLASH")
    assert placed.returncode == 0, placed.stderr
    assert answers(tmp_path, small) == expected
    assert built(tmp_path, large).returncode == 0
    assert answers(tmp_path, large) == expected


TABLED = """
msnn: 1
name: net
sample_time: 1 s
inputs: {u: {range: [-1, 1]}, v: {range: [-1, 1]}}
layers: {net: {mlp: {hidden: [4, 3], init: {normal: {std: 0.3}}}}}
outputs: {y: {expr: "net(u, v) + sin(2 * u) + cosh(u) + exp(v)"}}
"""
KINDS = {
    "weights": {"params": "const"},
    "numbers in the code": {"params": "inline"},
    "fixed point of 16 bits": {"dtype": "q15"},
    "fixed point of 32 bits": {"dtype": "q31"},
}


@pytest.mark.parametrize("kind", KINDS)
def test_no_constant_takes_ram_where_it_is_placed_in_flash(kind: str, tmp_path: Path) -> None:
    """Weights, inlined parameters, and the tables of functions, in floats and in integers."""
    options = KINDS[kind]
    spec = tmp_path / "net.msnn.yaml"
    spec.write_text(TABLED)
    settings = [
        word for key, value in options.items() for word in ("--set", f"export.c.{key}={value}")
    ]
    words = ["export", str(spec), "--initial", "--to", "c", "--out", str(tmp_path), *settings]
    assert run(words) == ExitCode.OK
    folder = tmp_path / "c"
    main = MAIN
    if options.get("params") != "const":
        main = main.replace("&s, &net_params_default", "&s")
    if "dtype" in options:
        fraction = {"q15": 14, "q31": 30}[options["dtype"]]
        one = f"((net_word_t)1 << {fraction})"
        main = main.replace("step / 8.0f, -0.5f", f"step * ({one} / 8), -({one} / 2)")
        main = main.replace("answer.real = y.y", "answer.bits = (uint32_t)y.y")
    small, large = "atmega328p", "atmega1284p"
    copied = ram(folder, large, main)
    expected = answers(folder, large)
    placed = ram(folder, small, main, "-DNET_IN_FLASH")
    assert answers(folder, small) == expected
    assert len({*expected}) == 8
    # the digits of the program above and the state of the model
    assert placed <= 32 < copied


def ram(folder: Path, chip: str, main: str, *flags: str) -> int:
    """Bytes of RAM that a program has taken before it begins: `.data` and `.bss`."""
    size = require_tool("avr-size", install="apt install binutils-avr")
    done = built(folder, chip, *flags, main=main)
    assert done.returncode == 0, done.stderr
    told = subprocess.run([size, folder / "a.elf"], capture_output=True, text=True, check=True)
    _, data, bss = told.stdout.splitlines()[1].split()[:3]
    return int(data) + int(bss)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_a_double_of_4_bytes_is_an_error(dtype: Dtype, tmp_path: Path) -> None:
    write_c(to_step_form(compiled(NET)), {}, tmp_path, COptions(prefix="net", dtype=dtype))
    done = built(tmp_path, "atmega2560")
    assert (done.returncode == 0) == (dtype == "float32"), done.stderr
    said = '#error "double has fewer digits here than the model computes with'
    assert (said in done.stderr) == (dtype == "float64")
