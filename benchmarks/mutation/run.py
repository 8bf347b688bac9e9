"""Puts faults into the C of models, one at a time, and counts those that verification sees.

`run.py [--every N] [--kinds KIND,…] [--jobs N] [NAME…]`: specs of the gallery, all without a name,
exported with their Jacobian. Needs gcc.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Collection, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from benchmarks.mutation.equivalents import reason
from benchmarks.mutation.mutants import Mutant, mutants
from compiler.interpreter.interpreter import physical_weights
from msnn.exports.export import plan_exports, write_export
from msnn.model.load import load_model
from msnn.verification.host.host_checks import writable_objects
from msnn.verification.proof_step import ToolFailedError
from spec_schema.diagnostics.diagnostic import Findings

GALLERY = Path(__file__).parents[2] / "examples" / "gallery"
_FLAGS = ("-std=c99", "-O0", "-w", "-ffp-contract=off")
_SECONDS = 20.0
"""After which a changed program counts as seen: it does not end."""


@dataclass(frozen=True, slots=True)
class Score:
    """How many of the changes were seen, and those that were not."""

    seen: tuple[Mutant, ...]
    equivalent: tuple[Mutant, ...]
    missed: tuple[Mutant, ...]

    def of(self, kind: str) -> Score:
        """Of one class of faults."""
        parts = (self.seen, self.equivalent, self.missed)
        return Score(*(tuple(m for m in part if m.kind == kind) for part in parts))

    @property
    def total(self) -> int:
        """All that can be seen."""
        return len(self.seen) + len(self.missed)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("names", nargs="*", default=[])
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--kinds", default="")
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    every = sorted(path.name.split(".")[0] for path in GALLERY.glob("*.msnn.yaml"))
    kinds = [kind for kind in given.kinds.split(",") if kind]
    for name in given.names or every:
        with tempfile.TemporaryDirectory() as place:
            export_with_drawn_weights(name, Path(place), ["jacobian"])
            _show(name, mutation_score(Path(place), name, given.every, kinds, given.jobs))


def _show(name: str, score: Score) -> None:
    kinds = sorted({m.kind for part in (score.seen, score.equivalent, score.missed) for m in part})
    for kind in kinds:
        of = score.of(kind)
        line = f"{name}, {kind}: {len(of.seen)} of {of.total} seen, {len(of.missed)} missed"
        print(f"{line}, {len(of.equivalent)} equivalent", flush=True)
    for mutant in score.missed:
        print(f"  missed: {mutant.kind}: {mutant.file}: {mutant.change}: {mutant.line}", flush=True)


def export_with_drawn_weights(name: str, folder: Path, extras: Collection[str] = ()) -> None:
    """Weights near the initial ones, not equal as these are: that would hide wrong indices."""
    model = load_model(GALLERY / f"{name}.msnn.yaml")
    (plan,) = plan_exports(model, ["c"], Findings(), extras)
    random = np.random.Generator(np.random.Philox(3))
    weights = physical_weights(plan.program, {})
    drawn = {k: w * random.uniform(0.9, 1.1, w.shape) for k, w in weights.items()}
    drawn = {k: w + (w == 0.0) * random.uniform(-0.1, 0.1, w.shape) for k, w in drawn.items()}
    write_export(plan, drawn, folder)


def mutation_score(
    export: Path, prefix: str, every: int = 1, kinds: Collection[str] = (), jobs: int = 2
) -> Score:
    """Of every so many changes of the model's own sources, of these classes or of all."""
    changed = [m for m in mutants(export, prefix) if not kinds or m.kind in kinds][::every]
    with tempfile.TemporaryDirectory() as place:
        objects = _objects(export, Path(place))
        folders = [Path(place) / str(number) for number in range(len(changed))]

        def found(mutant: Mutant, folder: Path) -> bool | None:
            return _seen(mutant, export, objects, folder)

        with ThreadPoolExecutor(max_workers=jobs) as pool:
            outcomes = list(zip(changed, pool.map(found, changed, folders), strict=True))
    unseen = [mutant for mutant, seen in outcomes if seen is False]
    return Score(
        seen=tuple(mutant for mutant, seen in outcomes if seen),
        equivalent=tuple(m for m in unseen if reason(prefix, m) is not None),
        missed=tuple(m for m in unseen if reason(prefix, m) is None),
    )


def _objects(export: Path, folder: Path) -> dict[str, Path]:
    """All sources, compiled once."""
    objects = {path.name: folder / f"{path.stem}.o" for path in _sources(export)}
    for path in _sources(export):
        command = ["gcc", *_FLAGS, f"-I{export / 'include'}", "-c", path, "-o", objects[path.name]]
        subprocess.run(command, check=True)
    return objects


def _sources(export: Path) -> Iterator[Path]:
    yield from sorted((export / "src").glob("*.c"))
    yield from sorted((export / "test").glob("*.c"))


def _seen(mutant: Mutant, export: Path, objects: dict[str, Path], folder: Path) -> bool | None:
    """Whether the test program fails or there is memory of its own; None if it is no C."""
    folder.mkdir()
    changed, compiled, program = folder / "changed.c", folder / "changed.o", folder / "program"
    changed.write_text(mutant.text, encoding="utf-8")
    includes = [f"-I{export / 'include'}", f"-I{export / 'src'}"]
    try:
        if writable_objects([changed], ["-w", *includes], folder):
            return True
    except ToolFailedError:
        return None
    others = [path for name, path in objects.items() if name != mutant.file]
    subprocess.run(["gcc", compiled, *others, "-o", program, "-lm"], check=True)
    try:
        done = subprocess.run([program], capture_output=True, check=False, timeout=_SECONDS)
    except subprocess.TimeoutExpired:
        return True
    return done.returncode != 0


if __name__ == "__main__":
    main()
