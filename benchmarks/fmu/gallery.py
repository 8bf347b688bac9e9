"""Exports units of the gallery, of controllers and of estimators, and measures what was promised.

    python benchmarks/fmu/gallery.py [SOLVES] [--write]

For every spec of the gallery in float32 and float64, every control problem of the tests and every
estimator of theirs: findings of FMPy in both versions of FMI (a unit with one is not run), values
whose bits differ from those of the C along a record, two instances in turn, a state that is saved,
restored and continued in another instance, the size of the archives, and by how much memory grows
over so many steps: a million of a model and a filter, SOLVES of a controller or a window (a million
unless it is given). Exit code 1 where anything is not as promised.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from msnn.agreement.judgement import FloatType, drawn_record
from msnn.exports.check import check_export
from msnn.exports.export import load_export, plan_exports, write_export
from msnn.exports.running.loaded_fmu import FmuInstance, fmu_instance
from msnn.exports.target import Written
from msnn.model.load import load_model
from msnn.model.weights.weights_file import initial_weights
from spec_schema.diagnostics.diagnostic import Findings
from tests.examples.gallery import GALLERY, NAMES, spec_of
from tests.features.control.gallery_problems import PROBLEMS
from tests.features.control.test_online_units import SPECS, archives, plan_of

TYPES: tuple[FloatType, ...] = ("float32", "float64")
STEPS = 1_000_000
LARGEST = 100_000
"""Bytes of an archive."""
GROWTH = 1024
"""KiB: pages that the allocator of Python keeps, and none for each step."""
Set = Callable[[FmuInstance, int], None]

_TEXT = """\
# Units of the gallery, of controllers and of estimators

Written by `python benchmarks/fmu/gallery.py {solves} --write`. Both units of FMI 2.0 and 3.0 of
each model passed FMPy's checks: a unit with a finding is not run. Values whose bits differ from
those of the C along a record; pairs of instances that are not in turn as each alone; units that do
not go on with the same bits in another instance; the larger archive; by how much the process is
larger after so many steps.

{models} models: {failed} not as promised. Archives have {least:.0f} to {largest:.0f} kB, memory
grows by at most {growth} KiB.

| model | differ | in turn | continued | archive, kB | steps | more memory, KiB |
|---|---|---|---|---|---|---|
{rows}
"""


@dataclass(frozen=True)
class Measured:
    """The measurements of one model."""

    name: str
    differing: int
    in_turn: int
    continued: int
    size: float
    """kB of the larger archive."""
    steps: int
    growth: int
    """KiB."""

    @property
    def is_as_promised(self) -> bool:
        wrong = self.differing or self.in_turn or self.continued
        return not wrong and 1000 * self.size < LARGEST and self.growth < GROWTH

    @property
    def row(self) -> str:
        """Its row of the table."""
        counts = f"{self.differing} | {self.in_turn} | {self.continued}"
        return f"| {self.name} | {counts} | {self.size:.1f} | {self.steps:,} | {self.growth} |"


def main() -> int:
    parser = argparse.ArgumentParser(description="Measures FMUs.")
    parser.add_argument("solves", nargs="?", type=int, default=STEPS)
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    found: list[Measured] = []
    for name in NAMES:
        for dtype in TYPES:
            with tempfile.TemporaryDirectory() as folder:
                found.append(model(name, dtype, Path(folder)))
    for name in (*PROBLEMS, *SPECS):
        for dtype in TYPES:
            with tempfile.TemporaryDirectory() as folder:
                found += online(name, dtype, Path(folder), given.solves)
    failed = sum(not one.is_as_promised for one in found)
    print(f"{failed} not as promised")
    if given.write:
        text = _TEXT.format(
            solves=given.solves,
            models=len(found),
            failed=failed,
            least=min(one.size for one in found),
            largest=max(one.size for one in found),
            growth=max(one.growth for one in found),
            rows="\n".join(one.row for one in found),
        )
        Path(__file__).with_name("RESULTS.md").write_text(text, encoding="utf-8")
    return 1 if failed else 0


def model(name: str, dtype: FloatType, folder: Path) -> Measured:
    """Exports and measures a spec of the gallery."""
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


def online(name: str, dtype: FloatType, folder: Path, solves: int) -> list[Measured]:
    """Exports and measures a controller, an estimator, or both."""
    text = SPECS.get(name)
    if text is None:
        PROBLEMS[name].model(name, folder)
        text = (folder / f"{name}.msnn.yaml").read_text(encoding="utf-8")
    plan = plan_of(text, folder, dtype)
    weights = initial_weights(plan.program)
    written = write_export(plan, weights, folder / "out")
    agreement = check_export(plan, weights, written, drawn_record(plan.program, "drawn"))
    found: list[Measured] = []
    for kind in ("mpc", "ekf", "mhe"):
        units = [path for path in archives(written) if f"_{kind}_" in path.name]
        if units:
            steps = STEPS if kind == "ekf" else solves
            bits = agreement.bits or 0
            found.append(told(f"{name} {kind} {dtype}", bits, units, drawn, steps))
    return found


def drawn(unit: FmuInstance, step: int) -> None:
    """Sets random inputs of a step."""
    random = np.random.default_rng(step % 64)
    for variable in unit.description.modelVariables:
        if variable.causality == "input":
            size = int(np.prod([int(d.start) for d in variable.dimensions], dtype=int))
            unit.set(variable.valueReference, 0.1 * random.uniform(-1, 1, size))


def told(name: str, differing: int, units: list[Path], given: Set, steps: int) -> Measured:
    """Measures the units of one model, and prints the result."""
    with ExitStack() as stack:
        pairs = [[stack.enter_context(fmu_instance(path)) for _ in "ab"] for path in units]
        in_turn = sum(not alone_and_in_turn(one, other, given) for one, other in pairs)
        continued = sum(not goes_on(one, other, given) for one, other in pairs)
        began = time.process_time()
        growth = max(grown(pair[0], given, steps) for pair in pairs)
        seconds = time.process_time() - began
    measured = Measured(
        name=name,
        differing=differing,
        in_turn=in_turn,
        continued=continued,
        size=max(path.stat().st_size for path in units) / 1000,
        steps=steps,
        growth=growth,
    )
    wrong = "" if measured.is_as_promised else " <-"
    print(f"{measured.row} {seconds:.1f} s{wrong}", flush=True)
    return measured


def stepped(unit: FmuInstance, given: Set, first: int, end: int) -> list[bytes]:
    """The complete serialised state after each step."""
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
    """True if two instances that step alternately compute the same as each alone."""
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
    """True if a saved state continues with the same bits, in the same and in another instance."""
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
    """KiB by which the memory of the process grows over `steps` steps."""
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
    """KiB of memory that the process uses now."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1])
    raise AssertionError


if __name__ == "__main__":
    sys.exit(main())
