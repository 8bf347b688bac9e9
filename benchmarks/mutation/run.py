"""Puts faults into the C of models, one at a time, and counts those that verification sees.

`run.py [--every N] [--kinds KIND,…] [--jobs N] [NAME…]`: specs of the gallery, all without a name,
exported with their Jacobian. Needs gcc.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from benchmarks.mutation.digit_outcomes import changes_no_result
from benchmarks.mutation.equivalents import reason
from benchmarks.mutation.inside_ranges import alike_inside_ranges
from benchmarks.mutation.mutants import Mutant, mutants
from benchmarks.mutation.random_calls import answers, random_calls
from benchmarks.mutation.same_code import code_of
from benchmarks.mutation.schemata import CHOICE, program_with_all
from compiler.interpreter.interpreter import physical_weights
from msnn.exports.export import plan_exports, write_export
from msnn.model.load import load_model
from msnn.verification.exported_c import read_exported_c
from msnn.verification.host_checks import writable_objects
from msnn.verification.proof_step import ToolFailedError, ToolTimedOutError
from spec_schema.diagnostics.diagnostic import Findings

GALLERY = Path(__file__).parents[2] / "examples" / "gallery"
_FLAGS = ("-std=c99", "-O0", "-w", "-ffp-contract=off", "-ftrivial-auto-var-init=pattern")
"""What is read before it is written is no number that is there by chance."""
_INSIDE = ("value", "deleted", "raw", "last digit")
"""Classes of faults that are inside one function and add no memory."""
_CALLS = 30_000
"""Random calls that may not tell a change which is said to change no answer."""
_SECONDS = 20.0
"""After which a changed program counts as seen: it does not end."""


@dataclass(frozen=True, slots=True)
class Score:
    """The detected faults, those that change no result, and the undetected ones."""

    seen: tuple[Mutant, ...]
    equivalent: tuple[Mutant, ...]
    missed: tuple[Mutant, ...]

    def of(self, kind: str) -> Score:
        """The score of one class of faults."""
        parts = (self.seen, self.equivalent, self.missed)
        return Score(*(tuple(m for m in part if m.kind == kind) for part in parts))

    @property
    def total(self) -> int:
        """The number of faults that can be detected."""
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
        place = f"{mutant.file}: {mutant.function}: {mutant.change}: {mutant.line}"
        print(f"  missed: {mutant.kind}: {place}", flush=True)


def export_with_drawn_weights(name: str, folder: Path, extras: Collection[str] = ()) -> None:
    """Exports a model with random weights near the initial ones.

    Equal weights, as initial ones often are, would hide wrong indices.
    """
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
    """Tests every n-th fault of the given classes (default: all) in the model's own sources."""
    changed = [m for m in mutants(export, prefix) if not kinds or m.kind in kinds][::every]
    with tempfile.TemporaryDirectory() as place:
        objects = _objects(export, Path(place))
        inside = [mutant for mutant in changed if mutant.kind in _INSIDE]
        outside = [mutant for mutant in changed if mutant.kind not in _INSIDE]
        folders = [Path(place) / str(number) for number in range(len(outside))]

        # a source that is right must not be seen, else every change of it is
        for name in sorted({mutant.file for mutant in outside}):
            right = (export / "src" / name).read_text(encoding="utf-8")
            unchanged = Mutant("none", name, "", right, "", "")
            assert not _seen(unchanged, export, objects, Path(place) / f"right_{name}")

        def found(mutant: Mutant, folder: Path) -> bool | None:
            return _seen(mutant, export, objects, folder)

        with ThreadPoolExecutor(max_workers=jobs) as pool:
            outcomes = list(zip(outside, pool.map(found, outside, folders), strict=True))
            outcomes += _seen_together(inside, export, objects, Path(place), pool)
        unseen = [mutant for mutant, seen in outcomes if seen is False]
        alike = {id(m) for m in unseen if reason(prefix, m) is not None}
        proof = _Proof(export, prefix, objects, Path(place))
        alike |= {id(m) for m in unseen if id(m) not in alike and proof.no_answer_changes(m)}
    return Score(
        seen=tuple(mutant for mutant, seen in outcomes if seen),
        equivalent=tuple(m for m in unseen if id(m) in alike),
        missed=tuple(m for m in unseen if id(m) not in alike),
    )


class _Proof:
    """Tests if a fault changes no result, by the compiler and by random calls."""

    def __init__(
        self, export: Path, prefix: str, objects: Mapping[str, Path], folder: Path
    ) -> None:
        self._export, self._prefix, self._folder = export, prefix, folder
        self._objects = {name: path for name, path in objects.items() if not _is_test(name)}
        main = folder / "random_calls.c"
        main.write_text(random_calls(read_exported_c(export), _CALLS), encoding="utf-8")
        self._main = folder / "random_calls.o"
        command = ["gcc", *_FLAGS, f"-I{export / 'include'}", "-c", main, "-o", self._main]
        subprocess.run(command, check=True)
        self._code: dict[str, str] = {}
        self._right = answers(self._linked([*self._objects.values()]))

    def no_answer_changes(self, mutant: Mutant) -> bool:
        """By all arguments of a mathematical function, by bounds of inputs, or by the code of a
        compiler and calls with infinities and NaN."""
        source = (self._export / "src" / mutant.file).read_text(encoding="utf-8")
        if mutant.kind == "last digit" and changes_no_result(source, mutant.text, self._prefix):
            return True
        if alike_inside_ranges(source, mutant.text, mutant.function):
            return True
        includes = [self._export / "include", self._export / "src"]
        if mutant.file not in self._code:
            self._code[mutant.file] = code_of(source, includes, self._folder)
        if code_of(mutant.text, includes, self._folder) != self._code[mutant.file]:
            return False
        changed = self._folder / "changed.c"
        changed.write_text(mutant.text, encoding="utf-8")
        compiled = self._folder / "changed.o"
        paths = [f"-I{path}" for path in includes]
        subprocess.run(["gcc", *_FLAGS, *paths, "-c", changed, "-o", compiled], check=True)
        others = [path for name, path in self._objects.items() if name != mutant.file]
        return answers(self._linked([compiled, *others])) == self._right

    def _linked(self, objects: Sequence[Path]) -> Path:
        program = self._folder / "random_calls"
        subprocess.run(["gcc", self._main, *objects, "-o", program, "-lm"], check=True)
        return program


def _is_test(name: str) -> bool:
    return name.endswith(("_selftest.c", "_sil.c"))


def _objects(export: Path, folder: Path) -> dict[str, Path]:
    """Compiles all sources of an export; returns the object files by name."""
    objects = {path.name: folder / f"{path.stem}.o" for path in _sources(export)}
    for path in _sources(export):
        command = ["gcc", *_FLAGS, f"-I{export / 'include'}", "-c", path, "-o", objects[path.name]]
        subprocess.run(command, check=True)
    return objects


def _sources(export: Path) -> Iterator[Path]:
    yield from sorted((export / "src").glob("*.c"))
    yield from sorted((export / "test").glob("*.c"))


def _seen_together(
    changed: Sequence[Mutant],
    export: Path,
    objects: Mapping[str, Path],
    folder: Path,
    pool: ThreadPoolExecutor,
) -> Iterator[tuple[Mutant, bool]]:
    """Whether the test program fails with each change: all of a file are in one program."""
    for file in sorted({mutant.file for mutant in changed}):
        own = [mutant for mutant in changed if mutant.file == file]
        source = (export / "src" / file).read_text(encoding="utf-8")
        every, compiled, program = (folder / f"every_{end}" for end in (file, "one.o", "program"))
        every.write_text(program_with_all(source, own), encoding="utf-8")
        paths = [f"-I{export / 'include'}", f"-I{export / 'src'}"]
        subprocess.run(["gcc", *_FLAGS, *paths, "-c", every, "-o", compiled], check=True)
        others = [path for name, path in objects.items() if name != file]
        subprocess.run(["gcc", compiled, *others, "-o", program, "-lm"], check=True)
        assert not _fails(program, {})
        chosen = ({CHOICE: str(number)} for number in range(1, len(own) + 1))
        failed = pool.map(partial(_fails, program), chosen)
        yield from zip(own, failed, strict=True)


def _fails(program: Path, environment: Mapping[str, str]) -> bool:
    """Whether a test program does; also if it does not end."""
    try:
        done = subprocess.run(
            [program], env=environment, capture_output=True, check=False, timeout=_SECONDS
        )
    except subprocess.TimeoutExpired:
        return True
    return done.returncode != 0


def _seen(mutant: Mutant, export: Path, objects: dict[str, Path], folder: Path) -> bool | None:
    """True if the test program fails or there is static memory; None if the text does not
    compile.
    """
    folder.mkdir()
    changed, compiled, program = folder / "changed.c", folder / "changed.o", folder / "program"
    changed.write_text(mutant.text, encoding="utf-8")
    includes = [f"-I{export / 'include'}", f"-I{export / 'src'}"]
    try:
        if writable_objects([changed], ["-w", *includes], folder):
            return True
    except (ToolFailedError, ToolTimedOutError):
        return None
    others = [path for name, path in objects.items() if name != mutant.file]
    subprocess.run(["gcc", compiled, *others, "-o", program, "-lm"], check=True)
    return _fails(program, {})


if __name__ == "__main__":
    main()
