"""Changes derivatives and training kernels in one place at a time, and tries right ones.

`kernels.py rules`: rules of reverse and forward mode and of the table of derivatives, judged by
the suite's comparison of graphs. `kernels.py emitter [MODEL…]`: the C that the emitter writes,
judged by the check of fresh kernels. None of the right kernels may be refused by it:
`kernels.py alarms [COUNT [FIRST]]`, those of random stages by their numbers, 1,000 by default, so
that a run of many is divided into several; `kernels.py gallery`. Needs gcc.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from backends.c_language.literals import Dtype
from backends.native import compile_kernel
from backends.native import kernel as kernel_module
from backends.native.kernel import Kernel
from backends.native.kernel_source import KernelSource, kernel_source
from benchmarks.mutation.derivative_mutants import derivative_mutants
from benchmarks.mutation.kernel_equivalents import kernel_reason
from benchmarks.mutation.kernel_problems import COVERING, covering_problems
from benchmarks.mutation.mutants import value_mutants
from benchmarks.mutation.right_kernels import alarms, gallery
from benchmarks.mutation.schemata import CHOICE, with_all
from compiler.differentiation.interpreted_training import InterpretedLosses
from compiler.differentiation.training_step import TrainingStep, training_step
from compiler.interpreter.rounding import Rollouts
from compiler.passes.close_loop import close_loop
from msnn.data.rollout_rows import Runs
from msnn.simulation.engines import kernel_check
from msnn.simulation.engines.kernel_check import WrongKernelError, check_kernel
from tests.language.compiled import compiled
from tests.native.graph_slopes import Problem, assert_slopes_agree
from tests.native.test_kernel import MODELS, initial, log_of

_SECONDS = 10
"""After which a changed kernel counts as found: it does not end."""


@dataclass(frozen=True, slots=True)
class Score:
    """The number of detected faults, and the undetected ones."""

    found: int
    missed: tuple[str, ...]
    alike: int = 0
    """Of those that change no answer, each with its reason in `kernel_equivalents.py`."""


def main() -> None:
    verb, *rest = sys.argv[1:] or ["rules"]
    if verb == "rules":
        _tell("rules", rules_score())
    elif verb == "emitter":
        with tempfile.TemporaryDirectory() as cache:
            os.environ["MSNN_CACHE"] = cache
            for name in rest or COVERING:
                _tell(name, emitter_score(name))
    elif verb == "alarms":
        count, first = (int(rest[i]) if len(rest) > i else d for i, d in enumerate((1000, 0)))
        with tempfile.TemporaryDirectory() as cache:
            os.environ["MSNN_CACHE"] = cache
            alarms(range(first, first + count))
    elif verb == "gallery":
        with tempfile.TemporaryDirectory() as place:
            os.environ["MSNN_CACHE"] = str(Path(place) / "cache")
            gallery(Path(place))


def _tell(name: str, score: Score) -> None:
    count = score.found + len(score.missed)
    alike = f", {score.alike} change no answer" if score.alike else ""
    print(f"{name}: {score.found} of {count} changes found{alike}", flush=True)
    for change in score.missed:
        print(f"  missed: {change}")


# ---- rules of derivatives


def rules_score(every: int = 1) -> Score:
    """Tests every n-th fault of rules of differentiation: does the suite's comparison of graphs
    detect it?
    """
    problems = covering_problems()
    assert not _disagree(problems), "what is right must agree, else every change is found"
    found, missed = 0, list[str]()
    for mutant in [*derivative_mutants()][::every]:
        with mutant.applied():
            if _disagree(problems):
                found += 1
            else:
                missed.append(f"{mutant.where}: {mutant.change}")
    return Score(found, tuple(missed))


def _disagree(problems: Iterable[Problem]) -> bool:
    for problem in problems:
        try:
            assert_slopes_agree(problem, directions=1)
        except Exception:  # noqa: BLE001  (whatever a changed rule breaks is found)
            return True
    return False


# ---- C of the emitter


def emitter_score(name: str, every: int = 1, dtype: Dtype = "float32") -> Score:
    """Tests every n-th fault in the C of a model's kernel: does the check of new kernels
    detect it?
    """
    text, closed = MODELS[name]
    program = close_loop(compiled(text), closed)
    log, weights = log_of(program), initial(program)
    # inside the sets of fuzzy logic and beyond the outermost
    logs = [{name: size * values for name, values in log.items()} for size in (1.0, 3.0)]
    runs = Runs(np.arange(10, 70), np.full(60, 12), 0, 90)
    whole = kernel_source(training_step(program), dtype)
    head, model, tail = _of_model(whole.text)
    changed = [*value_mutants(model)][::every]
    all_in_one = replace(whole, text=head + with_all(model, changed) + tail)
    with _source(all_in_one), _fast_compiler():
        kernel = Kernel(program, dtype)
    choice = ctypes.c_int.in_dll(kernel.built.library, CHOICE)
    found, missed, alike = 0, list[str](), 0
    with _judged_once():

        def checked(number: int) -> None:
            choice.value = number
            for each in logs:
                check_kernel(kernel, each, runs, weights)

        checked(0)
        for number, mutant in enumerate(changed, start=1):
            if _in_a_process(partial(checked, number)):
                found += 1
            elif kernel_reason(name, mutant) is not None:
                alike += 1
            else:
                missed.append(f"{mutant.change}: {mutant.line}")
    return Score(found, tuple(missed), alike)


def _of_model(text: str) -> tuple[str, str, str]:
    """Splits the text of a kernel: the text before the model's functions, these, and the rest."""
    begin, end = text.index("kernel_start("), text.index("struct problem {")
    begin = text.rindex("\n/*", 0, begin) + 1
    end = text.rindex("}\n", 0, end) + 2
    return text[:begin], text[begin:end], text[end:]


@contextmanager
def _judged_once() -> Iterator[None]:
    """A context in which the interpreter caches its results, because each fault needs the same
    ones.
    """
    right = kernel_check.InterpretedTraining
    answers: dict[tuple[bytes, bytes, int], InterpretedLosses] = {}

    class Remembering(right):
        def losses(self, runs: Rollouts, loss_weights: Mapping[str, float]) -> InterpretedLosses:
            rows = b"".join(np.asarray(values).tobytes() for values in runs.log.values())
            asked = (rows, runs.t0.tobytes(), runs.steps)
            if asked not in answers:
                answers[asked] = super().losses(runs, loss_weights)
            return answers[asked]

    kernel_check.InterpretedTraining = Remembering
    try:
        yield
    finally:
        kernel_check.InterpretedTraining = right


def _in_a_process(check: Callable[[], None]) -> bool:
    """True if the check fails, in a process of its own: a faulty kernel may crash, or never end."""
    child = os.fork()
    if child == 0:
        signal.alarm(_SECONDS)
        code = 0
        try:
            check()
        except WrongKernelError:
            code = 1
        os._exit(code)
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status) != 0


@contextmanager
def _source(source: KernelSource) -> Iterator[None]:
    """A context in which kernels are built from this source."""
    before = kernel_module.kernel_source

    def other(
        step: TrainingStep, dtype: Dtype, *, reproducible: bool = False, lbfgs: bool = False
    ) -> KernelSource:
        del step, dtype, reproducible, lbfgs
        return source

    kernel_module.kernel_source = other
    try:
        yield
    finally:
        kernel_module.kernel_source = before


@contextmanager
def _fast_compiler() -> Iterator[None]:
    """A context with a quick compilation: faulty kernels run only once."""
    before = compile_kernel.LANES_BY_GCC
    compile_kernel.LANES_BY_GCC = ("-O1",)
    try:
        yield
    finally:
        compile_kernel.LANES_BY_GCC = before


if __name__ == "__main__":
    main()
