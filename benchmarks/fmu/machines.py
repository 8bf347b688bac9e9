"""Runs units and exported C on other machines, Windows by Wine and AArch64 by QEMU.

    python benchmarks/fmu/machines.py [--write] [NAME ...]

For every spec of the gallery in float32 and float64, every control problem of the tests and every
estimator of theirs, or those that are named: the binaries of the units, made by zig, are loaded by
a small program in C that zig compiles too, and do what an importer does (two instances in turn, a
state that another instance goes on from, slopes, what is refused); every answer is compared with
that of this machine's binary, NaNs as such, numbers by their bits. The test programs of the
exported C run there as well, the self-tests of controllers and estimators likewise. Exit code 1
where anything differs.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from msnn.agreement.judgement import FloatType
from msnn.exports.export import plan_exports, write_export
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights
from spec_schema.diagnostics.diagnostic import Findings
from tests.examples.gallery import GALLERY, NAMES, spec_of
from tests.exports.other_machines.machines import Machine, aarch64, this_machine, windows
from tests.exports.other_machines.unit_script import (
    ALONE,
    OTHER,
    STEPS,
    TURN,
    answers,
    of_instance,
    read_unit,
)
from tests.features.control.gallery_problems import PROBLEMS
from tests.features.control.test_online_units import SPECS, archives

TYPES: tuple[FloatType, ...] = ("float32", "float64")
HERE = Path(__file__)
_TEXT = """\
# Units and exported C on other machines

Written by `python benchmarks/fmu/machines.py --write`. Windows: {wine}, a binary of x86-64 by the
zig wheel. AArch64: Linux by {qemu}. Answers are values, states that another instance
went on from, slopes, statuses and messages of both units of FMI 2.0 and 3.0 (FMI 2.0 has no name
for AArch64), each instance of two in turn as it was alone; compared with those of this machine's
binary, numbers by their bits. Self-tests are those of the exported C, golden vectors included.

{models} models: {failed} not as here. {units} units of Windows and {aarch64} of AArch64 gave
{answers:,} answers, {differ} of them others; {tests} self-tests, {failing} of them failed.

| model | units, Windows | units, AArch64 | answers | differ | self-tests | failed |
|---|---|---|---|---|---|---|
{rows}
"""


@dataclass
class Measured:
    """The results of one model on all machines."""

    name: str
    units: dict[str, int] = field(default_factory=dict[str, int])
    """How many ran, by platform."""
    answers: int = 0
    differ: int = 0
    tests: int = 0
    failed: int = 0

    @property
    def is_as_here(self) -> bool:
        return self.units.get("x86_64-windows") != 0 and not self.differ and not self.failed

    @property
    def row(self) -> str:
        """Its row of the table."""
        ran = " | ".join(
            str(self.units.get(name, 0)) for name in ("x86_64-windows", "aarch64-linux")
        )
        counts = f"{self.answers:,} | {self.differ} | {self.tests} | {self.failed}"
        return f"| {self.name} | {ran} | {counts} |"


def main() -> int:
    parser = argparse.ArgumentParser(description="Runs units on other machines.")
    parser.add_argument("names", nargs="*")
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    here, others = this_machine(), (windows(), aarch64())
    with tempfile.TemporaryDirectory() as temporary:
        hosts = {m.platform.fmi3: m.unit_host(Path(temporary)) for m in (here, *others)}

        def measure(task: tuple[str, str, FloatType]) -> Measured:
            name, text, dtype = task
            folder = Path(temporary) / f"{name}_{dtype}"
            folder.mkdir()
            measured = on_machines(name, text, dtype, folder, hosts, here, others)
            print(measured.row, "" if measured.is_as_here else "<-", flush=True)
            return measured

        tasks = [
            (name, text, dtype)
            for name, text in specs(Path(temporary))
            if name in given.names or not given.names
            for dtype in TYPES
        ]
        # Wine mostly waits for its own server
        with ThreadPoolExecutor(3) as pool:
            found = list(pool.map(measure, tasks))
    failed = sum(not one.is_as_here for one in found)
    print(f"{failed} not as here")
    if given.write:
        HERE.with_name("MACHINES.md").write_text(page(found, others), encoding="utf-8")
    return 1 if failed else 0


def specs(folder: Path) -> Iterator[tuple[str, str]]:
    """Yields name and text of every spec: the gallery, controllers, estimators."""
    for name in NAMES:
        yield name, spec_of(GALLERY, name).read_text(encoding="utf-8")
    for name in PROBLEMS:
        place = folder / f"problem_{name}"
        place.mkdir()
        PROBLEMS[name].model(name, place)
        text = (place / f"{name}.msnn.yaml").read_text(encoding="utf-8")
        yield f"{name} with mpc", text
    yield from SPECS.items()


def on_machines(
    name: str,
    text: str,
    dtype: FloatType,
    folder: Path,
    hosts: dict[str, Path],
    here: Machine,
    others: Sequence[Machine],
) -> Measured:
    """Runs one model in one dtype on every machine, and compares the results."""
    is_online = name not in NAMES
    units, tested = exported(text, dtype, folder, is_online)
    found = Measured(f"{name} {dtype}")
    for path in units:
        unit = read_unit(path)
        expected = answers(here, hosts[here.platform.fmi3], unit, folder)
        assert expected is not None
        found.differ += disagreements(expected)
        for machine in others:
            told = answers(machine, hosts[machine.platform.fmi3], unit, folder)
            if told is not None:
                kind = machine.platform.fmi3
                found.units[kind] = found.units.get(kind, 0) + 1
                found.answers += len(told)
                found.differ += abs(len(told) - len(expected))
                found.differ += sum(a != b for a, b in zip(told, expected, strict=False))
    for machine in others:
        for program in self_tests(machine, tested, folder, is_online):
            found.tests += 1
            found.failed += "exit code" in machine.said(program)
    return found


def exported(text: str, dtype: FloatType, folder: Path, is_online: bool) -> tuple[list[Path], Path]:
    """Exports a spec; returns the paths of its FMUs, and the folder of its C code."""
    path = folder / "spec.msnn.yaml"
    path.write_text(text, encoding="utf-8")
    platforms = "platforms: [x86_64-windows, aarch64-linux]"
    settings = {
        "mpc": f"export={{mpc: {{dtype: {dtype}, with: fmu, {platforms}}}}}",
        "fmu": f"export={{fmu: {{dtype: {dtype}, {platforms}}}}}",
        "c": f"export={{c: {{dtype: {dtype}}}}}",
    }
    units: list[Path] = []
    for target in ("mpc",) if is_online else ("fmu", "c"):
        (plan,) = plan_exports(load_model(path, [settings[target]]), [target], Findings())
        units += archives(write_export(plan, initial_weights(plan.program), folder / target))
    return units, folder / ("mpc" if is_online else "c")


def disagreements(told: list[str]) -> int:
    """The number of wrong answers: refused calls, shared memory, states from which a run does not
    continue.
    """
    one, other, alone = (of_instance(told, instance) for instance in (TURN, OTHER, ALONE))
    # one step is refused on purpose: its length is half of one
    refused = max(0, sum(line.endswith("= 3") for line in told) - 1)
    each = len(alone) // STEPS
    in_turn = sum(a != b for a, b in zip(one, alone, strict=False))
    after = each * STEPS
    goes_on = sum(a != b for a, b in zip(one[after:], other[after:], strict=True))
    return refused + in_turn + goes_on


def self_tests(machine: Machine, code: Path, folder: Path, is_online: bool) -> Iterator[Path]:
    """Yields the test programs of an export: one for a model, one each for controller and
    estimator.
    """
    kind = machine.platform.fmi3
    if not is_online:
        yield machine.self_test(code, folder / f"{kind}.test.exe")
        return
    for source in sorted((code / "src").glob("*_selftest.c")):
        prefix = source.stem.removesuffix("_selftest")
        main = folder / "main.c"
        main.write_text(
            f"int {prefix}_selftest(void);\nint main(void) {{ return {prefix}_selftest(); }}\n"
        )
        # kernels stand in files of their own, by the name of the C that calls them
        texts = [*(code / "src").glob(f"{prefix}*.c"), main]
        yield machine.program(code, texts, folder / f"{prefix}.{kind}.exe")


def page(found: list[Measured], others: Sequence[Machine]) -> str:
    wine, qemu = (
        subprocess.run([m.emulator[0], "--version"], check=True, capture_output=True, text=True)
        .stdout.partition("\n")[0]
        .partition(" (")[0]
        for m in others
    )
    return _TEXT.format(
        wine=wine.replace("wine-", "Wine "),
        qemu=qemu.replace("qemu-aarch64 version", "QEMU"),
        models=len(found),
        failed=sum(not one.is_as_here for one in found),
        units=sum(one.units.get("x86_64-windows", 0) for one in found),
        aarch64=sum(one.units.get("aarch64-linux", 0) for one in found),
        answers=sum(one.answers for one in found),
        differ=sum(one.differ for one in found),
        tests=sum(one.tests for one in found),
        failing=sum(one.failed for one in found),
        rows="\n".join(one.row for one in found),
    )


if __name__ == "__main__":
    sys.exit(main())
