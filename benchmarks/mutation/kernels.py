"""Changes derivatives and training kernels in one place at a time, and tries right ones at random.

`kernels.py rules`: rules of reverse and forward mode and of the table of derivatives, judged by
the suite's comparison of graphs. `kernels.py emitter [MODEL…]`: the C that the emitter writes,
judged by the check of fresh kernels. `kernels.py alarms [COUNT [FIRST]]`: kernels of random stages,
1,000 by default, none of which the check may refuse. Needs gcc.
"""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from backends.c_language.literals import Dtype
from backends.native import compile_kernel
from backends.native import kernel as kernel_module
from backends.native.compile_kernel import KernelBuildError
from backends.native.kernel import Kernel
from backends.native.kernel_source import KernelSource, kernel_source
from backends.native.sensitivity_kernel import SensitivityKernel
from benchmarks.mutation.derivative_mutants import derivative_mutants
from benchmarks.mutation.kernel_problems import COVERING, covering_problems
from benchmarks.mutation.mutants import Mutant, mutants
from benchmarks.mutation.random_stages import RandomStage, random_stage
from compiler.differentiation.sensitivities import sensitivities
from compiler.differentiation.training_step import TrainingStep
from compiler.passes.close_loop import close_loop
from msnn.data.starts import Runs
from msnn.training.engines.native.kernel_check import (
    WrongKernelError,
    check_kernel,
    check_sensitivities,
)
from tests.language.compiled import compiled
from tests.native.graph_slopes import Problem, assert_slopes_agree
from tests.native.test_kernel import MODELS, initial, log_of

_SECONDS = 60
"""After which a changed kernel counts as found: it does not end."""


@dataclass(frozen=True, slots=True)
class Score:
    """How many of the changes were found, and those that were not."""

    found: int
    missed: tuple[str, ...]


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


def _tell(name: str, score: Score) -> None:
    print(f"{name}: {score.found} of {score.found + len(score.missed)} changes found", flush=True)
    for change in score.missed:
        print(f"  missed: {change}")


# ---- rules of derivatives


def rules_score(every: int = 1) -> Score:
    """Of every so many changes of a rule: the suite's comparison of graphs finds it."""
    problems = covering_problems()
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
    """Of every so many changes of the functions of a model's kernel: the check finds it."""
    text, closed = MODELS[name]
    program = close_loop(compiled(text), closed)
    made: list[KernelSource] = []

    def kept(step: TrainingStep, dtype: Dtype) -> KernelSource:
        made.append(kernel_source(step, dtype))
        return made[-1]

    log, weights = log_of(program), initial(program)
    runs = Runs(np.arange(10, 70), np.full(60, 12), 0, 90)
    with _source(kept), _fast_compiler():
        check_kernel(Kernel(program, dtype), log, runs, weights)
    (right,) = made
    found, missed = 0, list[str]()
    for mutant in [*_of_model(right.text)][::every]:
        changed = replace(right, text=mutant.text)

        def checked(changed: KernelSource = changed) -> None:
            with _source(lambda step, dtype: changed), _fast_compiler():
                check_kernel(Kernel(program, dtype), log, runs, weights)

        outcome = _in_a_process(checked)
        found += outcome is True
        if outcome is False:
            missed.append(f"{mutant.change}: {mutant.line}")
    return Score(found, tuple(missed))


def _of_model(text: str) -> Iterator[Mutant]:
    """Changes of what the emitter writes: the functions of the model, not the loops around them."""
    begin, end = text.index("kernel_start("), text.index("struct problem {")
    begin = text.rindex("\n\n", 0, begin)
    head, model, tail = text[:begin], text[begin:end], text[end:]
    for mutant in mutants(model):
        yield replace(mutant, text=head + mutant.text + tail)


def _in_a_process(check: Callable[[], None]) -> bool | None:
    """Whether the check refuses; a changed kernel may crash. None where the change is no C."""
    child = os.fork()
    if child == 0:
        signal.alarm(_SECONDS)
        code = 0
        try:
            check()
        except WrongKernelError:
            code = 1
        except KernelBuildError:
            code = 2
        os._exit(code)
    _, status = os.waitpid(child, 0)
    code = os.waitstatus_to_exitcode(status)
    return None if code == 2 else code != 0


@contextmanager
def _source(source: Callable[[TrainingStep, Dtype], KernelSource]) -> Iterator[None]:
    """Kernels are made of another source."""
    before = kernel_module.kernel_source
    kernel_module.kernel_source = source
    try:
        yield
    finally:
        kernel_module.kernel_source = before


@contextmanager
def _fast_compiler() -> Iterator[None]:
    """Changed kernels run once: building them takes longer than running them."""
    before = compile_kernel.FLAGS
    quick = ("-O1" if flag == "-O3" else flag for flag in before if flag != "-funroll-loops")
    compile_kernel.FLAGS = tuple(quick)
    try:
        yield
    finally:
        compile_kernel.FLAGS = before


# ---- right kernels


def alarms(seeds: Iterable[int]) -> int:
    """How many right kernels the check refuses."""
    tried = refused = 0
    began = time.monotonic()
    for seed in seeds:
        stage = random_stage(seed)
        tried += 1
        try:
            check_stage(stage)
        except WrongKernelError as error:
            refused += 1
            print(f"  {seed}: {error}\n{stage.text}", flush=True)
    seconds = time.monotonic() - began
    print(f"{refused} of {tried} random stages refused, {seconds:.0f} s")
    return refused


def check_stage(stage: RandomStage) -> None:
    """Checks the kernel of a random stage, and that of its sensitivities if it is to have one."""
    kernel = Kernel(stage.program, stage.dtype)
    check_kernel(kernel, stage.log, stage.runs, stage.weights)
    if stage.second_order:
        found = sensitivities(stage.program, [p.name for p in stage.program.parameters])
        products = SensitivityKernel(found)
        check_sensitivities(products, found, stage.log, stage.runs, stage.weights)


if __name__ == "__main__":
    main()
