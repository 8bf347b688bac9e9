"""`msnn verify --board`: golden vectors on a core behind a gdb server, and on a serial line."""

from __future__ import annotations

import json
import os
import pty
import re
import select
import socket
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from textwrap import dedent

import pytest

from msnn.cli.application import run
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights, write_weights
from msnn.verification.exported_c import read_exported_c
from msnn.verification.on_board import serial_line
from msnn.verification.on_board.debugger import Packets, StubFailedError, gdb_server
from msnn.verification.on_board.link import Gdb, PyOcd, Serial, link_of
from msnn.verification.on_board.ram_program import core_of
from msnn.verification.proof_step import ARM_GCC, ARM_QEMU, GCC
from spec_schema.diagnostics.diagnostic import SpecError
from tests.verification.test_verify import exported, require, verified

PLANT = """
msnn: 1
name: plant
sample_time: 1 s
inputs:
  u: {range: [0, 2]}
parameters:
  gain: {init: 0.5}
states:
  x: {next: 0.9 * x + gain * u, range: [-20, 20]}
outputs:
  y: tanh(x) + u
"""
TINY = """
msnn: 1
name: tiny
inputs:
  u: {range: [0, 2]}
outputs:
  y: 2 * u
"""
BENT = """
msnn: 1
name: bent
sample_time: 100 ms
inputs: {u: {range: [-1, 1]}}
parameters: {k: 0.7}
states: {x: {next: "0.5 * x + where(u - x > 0, k, 0.5) * (u - x)", init: 0}}
outputs: {y: {expr: x}}
"""
# a board on which a whole run, a model's steps too, takes 10 cycles more than nothing
FIRMWARE = """
#include <stdint.h>
#include <stdio.h>
void plant_serve(int (*receive)(void), void (*send)(char letter));
uint32_t ticks(void);
uint32_t ticks(void)
{
    static uint32_t calls, now;
    calls++;
    if ((calls % 2U) == 0U) {
        now += (calls <= 4U) ? 10U : (110U + ((calls / 2U) % 2U));
    }
    return now;
}
static int receive(void) { return getchar(); }
static void send(char letter) { (void)putchar(letter); (void)fflush(stdout); }
int main(void) { plant_serve(receive, send); return 0; }
"""


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("board")
    spec = folder / "plant.msnn.yaml"
    spec.write_text(PLANT, encoding="utf-8")
    return exported(spec, folder)


def copied(folder: Path, place: Path) -> Path:
    """The export once more, to be changed."""
    (place / "c").mkdir()
    subprocess.run(["cp", "-r", f"{folder}/.", str(place / "c")], check=True)
    return place / "c"


@contextmanager
def emulated(machine: str) -> Generator[str]:
    """A board that has no program; what leads to it."""
    with socket.socket() as any:
        any.bind(("127.0.0.1", 0))
        port = any.getsockname()[1]
    shown = ["-display", "none", "-monitor", "none", "-serial", "none"]
    command = ["qemu-system-arm", "-M", machine, *shown, "-S", "-gdb", f"tcp:127.0.0.1:{port}"]
    with subprocess.Popen(command) as process:
        try:
            _wait_for(port, process)
            yield f"gdb:127.0.0.1:{port}"
        finally:
            process.kill()


def _wait_for(port: int, process: subprocess.Popen[bytes]) -> None:
    end = time.monotonic() + 60.0  # a machine that is busy starts QEMU slowly
    while True:
        try:
            socket.create_connection(("127.0.0.1", port)).close()
        except OSError:
            assert process.poll() is None, "QEMU has ended"
            assert time.monotonic() < end, "QEMU does not answer"
            time.sleep(0.05)
        else:
            return


def asked(
    capsys: pytest.CaptureFixture[str], folder: Path, link: str, *options: str
) -> tuple[int, dict[str, object]]:
    code, said = verified(capsys, folder, "--targets", "", "--board", link, *options)
    (result,) = [each for each in said["results"] if each["check"] != "files"]
    return code, result


def refused(capsys: pytest.CaptureFixture[str], folder: Path, link: str, *options: str) -> str:
    capsys.readouterr()
    assert run(["verify", str(folder), "--targets", "", "--board", link, *options]) == 1
    return capsys.readouterr().err


@pytest.mark.parametrize(
    ("machine", "core"),
    [
        ("mps2-an385", "Cortex-M3"),
        ("mps2-an386", "Cortex-M4 with FPU"),
        ("mps2-an500", "Cortex-M7 with FPU"),
        ("mps2-an505", "Cortex-M33 with FPU"),
    ],
)
def test_a_core_behind_a_gdb_server_answers_to_the_bit(
    machine: str, core: str, plant: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    require(ARM_GCC, ARM_QEMU)
    with emulated(machine) as link:
        code, result = asked(capsys, plant, link, "--ram", RAM[machine])
    assert (code, result["verdict"]) == (0, "ok"), result
    steps = len(read_exported_c(plant).expected)
    assert result["detail"] == (
        f"{core} -O2: {steps} golden steps, 0 bits differ; no cycle counter"
    )


@pytest.mark.parametrize(
    ("machine", "core", "setting"),
    [
        ("microbit", "Cortex-M0", "export.c.dtype=q15"),  # which has 16 KiB of RAM
        ("mps2-an386", "Cortex-M4 with FPU", "export.c.unroll=4"),
        ("mps2-an386", "Cortex-M4 with FPU", "export.c.with=[jacobian]"),
    ],
)
def test_every_kind_of_c_answers(
    machine: str, core: str, setting: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    require(ARM_GCC, ARM_QEMU)
    spec = tmp_path / "tiny.msnn.yaml"
    spec.write_text(TINY, encoding="utf-8")
    options = ["--initial", "--to", "c", "--out", str(tmp_path), "--set", setting]
    assert run(["export", str(spec), *options]) == 0
    with emulated(machine) as link:
        code, result = asked(capsys, tmp_path / "c", link, "--ram", RAM[machine])
    assert (code, result["verdict"]) == (0, "ok"), result
    assert str(result["detail"]).startswith(f"{core} -O2: ")


RAM = dict.fromkeys(["mps2-an385", "mps2-an386", "mps2-an500"], "0x20000000:0x10000")
RAM["microbit"] = "0x20000000:0x4000"
RAM["mps2-an505"] = "0x38000000:0x10000"
"""The M33 starts in its secure world, which has RAM of its own."""


def test_another_constant_on_the_board_is_found(
    plant: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    require(ARM_GCC, ARM_QEMU)
    folder = copied(plant, tmp_path)
    source = folder / "src" / "plant.c"
    text = source.read_text(encoding="utf-8")
    assert "0.9f" in text
    source.write_text(text.replace("0.9f", "0.9000001f"), encoding="utf-8")
    with emulated("mps2-an386") as link:
        code, result = asked(capsys, folder, link)
        assert (code, result["verdict"]) == (1, "found")
        assert "golden steps or starts differ" in str(result["findings"])
        # the board is as it was: the right code runs on it
        assert asked(capsys, plant, link)[0] == 0


def test_another_state_left_on_the_board_is_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No golden run comes near the kink of the state; only the last write of single steps does."""
    require(ARM_GCC, ARM_QEMU)
    spec = tmp_path / "bent.msnn.yaml"
    spec.write_text(BENT, encoding="utf-8")
    assert run(["export", str(spec), "--initial", "--to", "c", "--out", str(tmp_path)]) == 0
    source = tmp_path / "c" / "src" / "bent.c"
    text = source.read_text(encoding="utf-8")
    wrong = text.replace("> 0.0f) ? ", "> 0.001f) ? ")
    assert wrong != text
    with emulated("mps2-an386") as link:
        assert asked(capsys, tmp_path / "c", link)[0] == 0
        source.write_text(wrong, encoding="utf-8")
        code, result = asked(capsys, tmp_path / "c", link)
    assert (code, result["verdict"]) == (1, "found"), result


def test_a_core_that_traps_or_has_no_such_memory_is_told(
    plant: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    require(ARM_GCC, ARM_QEMU)
    folder = copied(plant, tmp_path)
    source = folder / "src" / "plant.c"
    text = source.read_text(encoding="utf-8")
    wild = text.replace("    /* outputs */\n", "    *(volatile int *)0xF0000000U = 1;\n")
    assert wild != text
    source.write_text(wild, encoding="utf-8")
    with emulated("mps2-an386") as link:
        said = refused(capsys, plant, link, "--ram", "0x90000000:65536")
        assert "error[E1322]" in said
        assert "nothing can be kept at 0x90000000" in said
        said = refused(capsys, plant, link, "--ram", "0x20000000:4096")
        assert "error[E1323]" in said
        assert "bytes of RAM, and 4096 are given" in said
        said = refused(capsys, folder, link)
        assert "error[E1321]" in said
        assert "the core trapped" in said


def test_what_is_no_microcontroller_is_told(
    plant: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    require(ARM_GCC, ARM_QEMU)
    with emulated("vexpress-a9") as link:
        assert "error[E1321]" in refused(capsys, plant, link)
    with emulated("mps2-an386") as link:
        monkeypatch.setattr("msnn.verification.on_board.board_check.CPUID", 0x20000000)
        said = refused(capsys, plant, link)
    assert "error[E1324]" in said
    assert "its CPUID is 0x00000000" in said


def test_openocd_is_started_and_ended(
    plant: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By a command that takes OpenOCD's options and starts QEMU."""
    require(ARM_GCC, ARM_QEMU)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    script = tmp_path / "openocd"
    script.write_text(
        dedent(f"""\
        #!{sys.executable}
        import os, sys
        if sys.argv[-2:] != ["-f", "board.cfg"]:
            sys.exit("Error: no such file " + sys.argv[-1])
        (port,) = [w.split()[1] for w in sys.argv if w.startswith("gdb_port ")]
        open({str(tmp_path / "started")!r}, "w").write(str(os.getpid()))
        command = "qemu-system-arm -M mps2-an386 -display none -monitor none -serial none -S -gdb"
        os.execvp("qemu-system-arm", [*command.split(), "tcp:127.0.0.1:" + port])
        """),
        encoding="utf-8",
    )
    script.chmod(0o755)
    code, result = asked(capsys, plant, "openocd:board.cfg")
    assert (code, result["verdict"]) == (0, "ok"), result
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "started").read_text(encoding="utf-8")), 0)
    said = refused(capsys, plant, "openocd:other.cfg")
    assert "error[E1320]" in said
    assert "Error: no such file other.cfg" in said


@pytest.mark.parametrize("named", [None, "project"])
def test_pyocd_runs_no_script_of_the_working_folder(
    named: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It would run a `pyocd_user.py` of its project folder, which the user alone may name."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("PYOCD_PROJECT_DIR", raising=False)
    if named is not None:
        monkeypatch.setenv("PYOCD_PROJECT_DIR", named)
    script = tmp_path / "pyocd"
    seen = "import os; place = os.environ['PYOCD_PROJECT_DIR']; print(place, os.listdir(place))"
    script.write_text(f"#!{sys.executable}\n{seen}\n", encoding="utf-8")
    script.chmod(0o755)
    (tmp_path / "project").mkdir()
    with pytest.raises(SpecError) as caught, gdb_server(PyOcd("0123")):
        pass
    (said,) = caught.value.diagnostics[0].notes
    assert str(tmp_path) not in said
    assert re.search(r"project \[\]" if named else r"msnn-pyocd-\w+ \[\]", said), said


@pytest.mark.parametrize("link", ["openocd:board.cfg", "pyocd:0123"])
def test_a_missing_server_is_named(
    link: str,
    plant: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    code, result = asked(capsys, plant, link)
    assert (code, result["verdict"]) == (5, "missing")
    command = link.partition(":")[0]
    assert result["detail"] == f"arm-none-eabi-gcc, {command} not installed"


@contextmanager
def on_a_line(program: Path, damage: bytes = b"") -> Generator[str]:
    """Firmware behind a pseudo-terminal; its first byte `damage` arrives as another."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    ended = threading.Event()
    with subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        ways = {ours: process.stdin.fileno(), process.stdout.fileno(): ours}

        def forward() -> None:
            left = damage
            while not ended.is_set():
                for end in select.select(list(ways), [], [], 0.05)[0]:
                    part = os.read(end, 4096)
                    if end != ours and left and left in part:
                        part, left = part.replace(left, b"?", 1), b""
                    os.write(ways[end], part)

        thread = threading.Thread(target=forward)
        thread.start()
        try:
            yield f"serial:{os.ttyname(theirs)}"
        finally:
            ended.set()
            thread.join()
            process.kill()
    os.close(ours)
    os.close(theirs)


@pytest.fixture(scope="module")
def firmware(plant: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What serves the plant on a line, built by the files that `--serve` writes."""
    require(GCC)
    folder = tmp_path_factory.mktemp("firmware")
    assert run(["verify", str(plant), "--serve", str(folder / "serve")]) == 0
    main = folder / "main.c"
    main.write_text(FIRMWARE, encoding="utf-8")
    includes = [f"-I{plant / 'include'}", f"-I{plant / 'src'}", f"-I{plant / 'test'}"]
    flags = [
        "-std=c99",
        "-O1",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-ffp-contract=off",
        "-DBOARD_CYCLES=ticks",
    ]
    sources = [str(path) for path in (main, *sorted((plant / "src").glob("*.c")))]
    served = str(folder / "serve" / "plant_serve.c")
    program = folder / "firmware"
    command = ["gcc", *flags, *includes, *sources, served, "-o", str(program), "-lm"]
    subprocess.run(command, check=True)
    return program


def test_firmware_on_a_serial_line_answers_with_its_cycles(
    plant: Path, firmware: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with on_a_line(firmware) as link:
        code, result = asked(capsys, plant, link)
        assert (code, result["verdict"]) == (0, "ok"), result
        # 110 and 111 in turn, less the 10 of an empty step
        least, mean, most = json.loads(json.dumps(result["cycles"]))
        assert (least, most) == (100, 101)
        assert 100.4 < mean < 100.6
        assert "100 to 101 cycles a step, 100.5 in the mean" in str(result["detail"])
        # it is asked as often as one likes
        assert asked(capsys, plant, link)[0] == 0


def test_a_damaged_answer_is_no_difference_of_the_model(
    plant: Path, firmware: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with on_a_line(firmware, damage=b"3") as link:
        code, result = asked(capsys, plant, link)
    assert (code, result["findings"]) == (
        1,
        ["the answer was damaged on its way: its checksum differs"],
    )


def test_firmware_with_other_weights_is_told(
    firmware: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The spec is the same, to the byte: only the weights are others."""
    spec = tmp_path / "plant.msnn.yaml"
    spec.write_text(PLANT, encoding="utf-8")
    program = load_model(spec).program
    weights = {name: 0.5 * value for name, value in initial_weights(program).items()}
    write_weights(tmp_path / "w.safetensors", weights, program)
    given = ["--weights", str(tmp_path / "w.safetensors")]
    assert run(["export", str(spec), *given, "--to", "c", "--out", str(tmp_path)]) == 0
    capsys.readouterr()
    with on_a_line(firmware) as link:
        code, result = asked(capsys, tmp_path / "c", link)
    assert code == 1
    assert ": other firmware" in str(result["findings"])


def test_a_silent_or_missing_line_is_told(
    plant: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serial_line, "_SILENCE", 0.2)
    ours, theirs = pty.openpty()
    said = refused(capsys, plant, f"serial:{os.ttyname(theirs)}")
    assert "error[E1321]" in said
    assert "silence for 0.2 s" in said
    assert "error[E1320]" in refused(capsys, plant, "serial:/dev/no_such_line")
    assert "no serial line" in refused(capsys, plant, "serial:/dev/null")
    assert "no line runs at 7 baud" in refused(capsys, plant, f"serial:{os.ttyname(theirs)}@7")
    assert "error[E1320]" in refused(capsys, plant, "gdb:127.0.0.1:1")
    os.close(ours)
    os.close(theirs)


@pytest.mark.parametrize(
    "link", ["jlink:1", "gdb:host", "gdb::3333", "gdb:h:70000", "serial:", "openocd:", "serial:a@b"]
)
def test_what_is_no_link_is_a_usage_error(link: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert link_of(link) is None
    assert run(["verify", ".", "--board", link]) == 2
    assert "is none of openocd:CFG" in capsys.readouterr().err


def test_links_and_memory_are_read_as_written(capsys: pytest.CaptureFixture[str]) -> None:
    assert link_of("gdb:::1:3333") == Gdb("::1", 3333)
    assert link_of("serial:/dev/ttyACM0") == Serial("/dev/ttyACM0", 115200)
    assert link_of("serial:COM3@9600") == Serial("COM3", 9600)
    assert run(["verify", ".", "--board", "gdb:h:1", "--ram", "0x20000010:64"]) == 2
    assert "multiple of 512" in capsys.readouterr().err


def test_cores_are_compiled_for_as_their_registers_say() -> None:
    soft = core_of(0x410FC241, 0)
    single, double = core_of(0x411FC272, 0x10110021), core_of(0x411FC272, 0x10110221)
    assert soft is not None
    assert soft.flags == ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=soft")
    assert single is not None
    assert single.flags[-1] == "-mfpu=fpv5-sp-d16"
    assert double is not None
    assert double.flags[-1] == "-mfpu=fpv5-d16"
    assert core_of(0x412FC09A, 0) is None


def test_packets_are_expanded_repeated_and_their_checksum_is_read() -> None:
    def packet(text: bytes) -> bytes:
        return b"$%s#%02x" % (text, sum(text) % 256)

    ours, theirs = socket.socketpair(socket.AF_INET if os.name == "nt" else socket.AF_UNIX)
    with ours, theirs:
        packets = Packets(ours)
        # `0* ` is four zeros, `}` escapes the `#` that would end a packet
        theirs.sendall(b"+$bad#00" + packet(b"O6869") + packet(b"0* }\x03"))
        assert packets.ask(b"m0,4") == b"0000#"
        assert theirs.recv(100) == b"$m0,4#fd-++"
        theirs.shutdown(socket.SHUT_WR)
        with pytest.raises(StubFailedError, match="closed the connection"):
            packets.ask(b"?")


def test_a_controller_is_not_asked_on_a_board(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = tmp_path / "plant.msnn.yaml"
    control = """\
mpc:
  horizon: 4
  controls: [u]
  cost: (x - 1)**2 + u**2
  bounds: {u: {min: 0, max: 2}}
"""
    spec.write_text(PLANT + control, encoding="utf-8")
    assert run(["export", str(spec), "--initial", "--to", "mpc", "--out", str(tmp_path)]) == 0
    said = refused(capsys, tmp_path / "mpc", "gdb:127.0.0.1:1")
    assert "error[E1325]" in said
