"""Changes the C of models in one place at a time and counts the changes that its test program sees.

`run.py [NAME…]`: specs of the gallery, `reference` without one. Needs gcc.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from benchmarks.mutation.equivalents import EQUIVALENTS
from benchmarks.mutation.mutants import Mutant, mutants
from compiler.interpreter.interpreter import physical_weights
from msnn.exports.export import plan_exports, write_export
from msnn.model.load import load_model
from spec_schema.diagnostics.diagnostic import Findings

GALLERY = Path(__file__).parents[2] / "examples" / "gallery"
_FLAGS = ("-std=c99", "-O0", "-w", "-ffp-contract=off")
_SECONDS = 20.0
"""After which a changed program counts as seen: it does not end."""


@dataclass(frozen=True, slots=True)
class Score:
    """How many of the changes were seen, and those that were not."""

    seen: int
    equivalent: tuple[Mutant, ...]
    missed: tuple[Mutant, ...]

    @property
    def share(self) -> float:
        return self.seen / (self.seen + len(self.missed))


def main() -> None:
    for name in sys.argv[1:] or ["reference"]:
        with tempfile.TemporaryDirectory() as place:
            export_with_drawn_weights(name, Path(place))
            score = mutation_score(Path(place), name)
        total = score.seen + len(score.missed)
        print(f"{name}: {score.seen} of {total} changes seen, {100 * score.share:.1f} %")
        for kind, those in (("equivalent", score.equivalent), ("missed", score.missed)):
            for mutant in those:
                print(f"  {kind}: {mutant.change}: {mutant.line}")


def export_with_drawn_weights(name: str, folder: Path) -> None:
    """Weights near the initial ones, not equal as these are: that would hide wrong indices."""
    model = load_model(GALLERY / f"{name}.msnn.yaml")
    (plan,) = plan_exports(model, ["c"], Findings())
    random = np.random.Generator(np.random.Philox(3))
    weights = physical_weights(plan.program, {})
    drawn = {k: w * random.uniform(0.9, 1.1, w.shape) for k, w in weights.items()}
    drawn = {k: w + (w == 0.0) * random.uniform(-0.1, 0.1, w.shape) for k, w in drawn.items()}
    write_export(plan, drawn, folder)


def mutation_score(export: Path, prefix: str, every: int = 1) -> Score:
    """Of every so many changes of the model's own source; what it calls stays as it is."""
    source = export / "src" / f"{prefix}.c"
    changed = list(mutants(source.read_text(encoding="utf-8")))[::every]
    with tempfile.TemporaryDirectory() as place:
        others = _objects(export, source, Path(place))
        folders = [Path(place) / str(number) for number in range(len(changed))]

        def found(mutant: Mutant, folder: Path) -> bool | None:
            return _seen(mutant, export, others, folder)

        with ThreadPoolExecutor(max_workers=2) as pool:
            outcomes = list(zip(changed, pool.map(found, changed, folders), strict=True))
    unseen = [mutant for mutant, seen in outcomes if seen is False]
    known = EQUIVALENTS.get(prefix, {})
    return Score(
        seen=sum(seen is True for _, seen in outcomes),
        equivalent=tuple(m for m in unseen if (m.line, m.change) in known),
        missed=tuple(m for m in unseen if (m.line, m.change) not in known),
    )


def _objects(export: Path, source: Path, folder: Path) -> list[Path]:
    """All but the source, compiled once."""
    files = [path for path in _sources(export) if path != source]
    objects = [folder / f"{path.stem}.o" for path in files]
    for path, compiled in zip(files, objects, strict=True):
        command = ["gcc", *_FLAGS, f"-I{export / 'include'}", "-c", path, "-o", compiled]
        subprocess.run(command, check=True)
    return objects


def _sources(export: Path) -> Iterator[Path]:
    yield from sorted((export / "src").glob("*.c"))
    yield from sorted((export / "test").glob("*.c"))


def _seen(mutant: Mutant, export: Path, others: list[Path], folder: Path) -> bool | None:
    """Whether the test program fails; None where the change is no C."""
    folder.mkdir()
    changed, program = folder / "changed.c", folder / "program"
    changed.write_text(mutant.text, encoding="utf-8")
    includes = [f"-I{export / 'include'}", f"-I{export / 'src'}"]
    command = ["gcc", *_FLAGS, *includes, changed, *others, "-o", program, "-lm"]
    if subprocess.run(command, capture_output=True, check=False).returncode != 0:
        return None
    try:
        done = subprocess.run([program], capture_output=True, check=False, timeout=_SECONDS)
    except subprocess.TimeoutExpired:
        return True
    return done.returncode != 0


if __name__ == "__main__":
    main()
