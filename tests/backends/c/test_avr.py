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


def built(folder: Path, chip: str, *flags: str) -> subprocess.CompletedProcess[str]:
    compiler = require_tool("avr-gcc", install="apt install gcc-avr avr-libc")
    main = folder / "main.c"
    main.write_text(MAIN)
    sources = [p for p in sorted((folder / "src").glob("*.c")) if "_selftest" not in p.name]
    command = [compiler, f"-mmcu={chip}", "-std=gnu99", "-Os", "-ffp-contract=off", *flags]
    return subprocess.run(
        [*command, f"-I{folder / 'include'}", main, *sources, "-o", folder / "a.elf", "-lm"],
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


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_a_double_of_4_bytes_is_an_error(dtype: Dtype, tmp_path: Path) -> None:
    write_c(to_step_form(compiled(NET)), {}, tmp_path, COptions(prefix="net", dtype=dtype))
    done = built(tmp_path, "atmega2560")
    assert (done.returncode == 0) == (dtype == "float32"), done.stderr
    said = '#error "double has fewer digits here than the model computes with'
    assert (said in done.stderr) == (dtype == "float64")
