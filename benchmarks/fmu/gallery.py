"""Exports units of the gallery, of controllers and of filters, and measures what was promised.

    python benchmarks/fmu/gallery.py [SOLVES]

For every spec of the gallery in float32 and float64, every control problem of the tests and every
filter of theirs: findings of FMPy in both versions of FMI (a unit with one is not run), values
whose bits differ from those of the C along a record, two instances in turn, a state that is saved,
restored and continued in another instance, the size of the archives, and by how much memory grows
over so many steps: a million of a model and a filter, SOLVES of a controller (a million unless it
is given). Exit code 1 where anything is not as promised.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from msnn.agreement.judgement import FloatType
from msnn.agreement.record import drawn_record
from msnn.exports.check import check_export
from msnn.exports.export import load_export, plan_exports, write_export
from msnn.exports.fmu_instance import FmuInstance, fmu_instance
from msnn.exports.target import Written
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights
from spec_schema.diagnostics.diagnostic import Findings
from tests.control.gallery_problems import PROBLEMS
from tests.examples.gallery import GALLERY, NAMES, spec_of
from tests.exports.test_online_units import SPECS, archives, plan_of, without_blocks

TYPES: tuple[FloatType, ...] = ("float32", "float64")
STEPS = 1_000_000
LARGEST = 100_000
"""Bytes of an archive."""
GROWTH = 1024
"""KiB: pages that the allocator of Python keeps, and none for each step."""
Set = Callable[[FmuInstance, int], None]


def main(solves: int) -> int:
    failed = 0
    for name in NAMES:
        for dtype in TYPES:
            with tempfile.TemporaryDirectory() as folder:
                failed += model(name, dtype, Path(folder))
    for name in (*PROBLEMS, *SPECS):
        for dtype in TYPES:
            with tempfile.TemporaryDirectory() as folder:
                failed += online(name, dtype, Path(folder), solves)
    print(f"{failed} not as promised")
    return 1 if failed else 0


def model(name: str, dtype: FloatType, folder: Path) -> int:
    """A spec of the gallery."""
    found: list[dict[str, bytes]] = []
    written: Written | None = None
    for target in ("c", "fmu"):
        settings = [f"export={{{target}: {{dtype: {dtype}}}}}"]
        (plan,) = plan_exports(load_model(spec_of(GALLERY, name), settings), [target], Findings())
        weights = initial_weights(plan.program)
        written = write_export(plan, weights, folder / target)
        record = drawn_record(plan.program, "drawn")
        judged = plan.target.judge(plan, weights, record, dtype)
        with load_export(plan, written) as loaded:
            run = loaded.run(judged.beginning, judged.inputs, judged.steps)
        found.append({key: np.asarray(values).tobytes() for key, values in run.items()})
    assert written is not None
    differing = sum(found[0][key] != found[1][key] for key in found[0])
    return told(f"{name} {dtype}", differing, archives(written), drawn, STEPS)


def online(name: str, dtype: FloatType, folder: Path, solves: int) -> int:
    """A controller or a filter, or both."""
    text = SPECS.get(name)
    if text is None:
        PROBLEMS[name].model(name, folder)
        text = without_blocks((folder / f"{name}.msnn.yaml").read_text(encoding="utf-8"))
    plan = plan_of(text, folder, dtype)
    weights = initial_weights(plan.program)
    written = write_export(plan, weights, folder / "out")
    agreement = check_export(plan, weights, written, drawn_record(plan.program, "drawn"))
    failed = 0
    for kind in ("mpc", "ekf"):
        units = [path for path in archives(written) if f"_{kind}_" in path.name]
        if units:
            steps = solves if kind == "mpc" else STEPS
            bits = agreement.bits or 0
            failed += told(f"{name} {kind} {dtype}", bits, units, drawn, steps)
    return failed


def drawn(unit: FmuInstance, step: int) -> None:
    """Other inputs at each step."""
    random = np.random.default_rng(step % 64)
    for variable in unit.description.modelVariables:
        if variable.causality == "input":
            size = int(np.prod([int(d.start) for d in variable.dimensions], dtype=int))
            unit.set(variable.valueReference, 0.1 * random.uniform(-1, 1, size))


def told(name: str, differing: int, units: list[Path], given: Set, steps: int) -> int:
    """Prints what was found of one model; 1 where it is not as promised."""
    largest = max(path.stat().st_size for path in units)
    with ExitStack() as stack:
        pairs = [[stack.enter_context(fmu_instance(path)) for _ in "ab"] for path in units]
        in_turn = sum(not alone_and_in_turn(one, other, given) for one, other in pairs)
        continued = sum(not goes_on(one, other, given) for one, other in pairs)
        began = time.process_time()
        growth = max(grown(pair[0], given, steps) for pair in pairs)
        seconds = time.process_time() - began
    bad = bool(differing or in_turn or continued or largest >= LARGEST or growth >= GROWTH)
    print(
        f"{name}: {differing} differ from C, {in_turn} in turn, {continued} continued, "
        f"{largest / 1000:.1f} kB, {growth} KiB more after {steps:,} steps ({seconds:.1f} s)"
        + (" <-" if bad else ""),
        flush=True,
    )
    return int(bad)


def stepped(unit: FmuInstance, given: Set, first: int, end: int) -> list[bytes]:
    """The whole state after each step."""
    every = float(unit.description.defaultExperiment.stepSize or 1.0)
    found: list[bytes] = []
    for k in range(first, end):
        given(unit, k)
        unit.step(k, every)
        found.append(unit.state)
    return found


def begin(unit: FmuInstance, given: Set, first: int) -> None:
    unit.initialise()
    given(unit, first)
    unit.begin()


def alone_and_in_turn(one: FmuInstance, other: FmuInstance, given: Set) -> bool:
    """Whether two instances that step in turn are as each alone."""
    alone: list[list[bytes]] = []
    for unit, first in ((one, 0), (other, 7)):
        begin(unit, given, first)
        alone.append(stepped(unit, given, first, first + 20))
    begin(one, given, 0)
    begin(other, given, 7)
    both = [
        (*stepped(one, given, k, k + 1), *stepped(other, given, k + 7, k + 8)) for k in range(20)
    ]
    return both == list(zip(*alone, strict=True))


def goes_on(one: FmuInstance, other: FmuInstance, given: Set) -> bool:
    """Whether a state that was saved goes on with the same bits, here and in another instance."""
    begin(one, given, 0)
    stepped(one, given, 0, 10)
    state = one.state
    continued = stepped(one, given, 10, 30)
    one.state = state
    again = stepped(one, given, 10, 30)
    begin(other, given, 3)
    other.state = state
    return continued == again == stepped(other, given, 10, 30)


def grown(unit: FmuInstance, given: Set, steps: int) -> int:
    """KiB by which the process is larger after so many steps, in calls of a thousand."""
    every = float(unit.description.defaultExperiment.stepSize or 1.0)
    is_static = unit.description.defaultExperiment.stepSize is None
    each = 1 if is_static else 1000
    begin(unit, given, 0)
    unit.step(0, each * every)
    before = resident()
    for k in range(steps // 1000):
        given(unit, k)
        unit.step(k, each * every)
    return resident() - before


def resident() -> int:
    """KiB that the process holds now."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1])
    raise AssertionError


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else STEPS))
