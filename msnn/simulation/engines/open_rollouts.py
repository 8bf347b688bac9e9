"""Selects the engine of rollouts: kernels if the work justifies compiling, else the interpreter."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import get_args

import numpy as np

from backends.files.c_compiler import CompilerMissingError
from backends.native.kernel_cache import KernelFolder
from compiler.ir.nodes import needed
from compiler.ir.program import Program
from msnn.data.dataset import FloatArray
from msnn.data.rollout_rows import Runs
from msnn.errors.learning import engines
from msnn.errors.learning.engines import foreign_kernels, unusable_kernel_folder
from msnn.packages import TORCH
from msnn.simulation.engines.engine import (
    SIDE_BY_SIDE,
    Engine,
    EngineName,
    EngineToOpen,
    ExportName,
    OpenedRollouts,
    interpreted_rollouts,
)
from spec_schema.diagnostics.diagnostic import Diagnostic, SpecError

AUTO = "auto"
ENGINES: tuple[str, ...] = (AUTO, *get_args(EngineName), *get_args(ExportName))
"""All names of engines."""

_TO_COMPILE = 0.7
"""Seconds to import the code generator and to compile a kernel (decision 0218)."""

_TO_COMPILE_A_NODE = 1.5e-3
"""Additional seconds for each operation of the step."""

_SECONDS_A_NODE = 0.8e-6
"""Seconds per call of one numpy operation, measured 0.4 to 0.9 µs."""

_SECONDS_A_NUMBER = 1e-9
"""Additional seconds for each computed element."""

Arrays = Mapping[str, FloatArray]


def open_rollouts(
    engine: Engine, program: Program, weights: Arrays, series: Arrays, runs: Runs
) -> OpenedRollouts:
    """Opens the requested engine for a closed-loop program.

    `auto` selects a kernel if these rollouts justify compiling, and the interpreter without a
    compiler. Raises SpecError if a requested kernel is not possible.
    """
    match engine:
        case EngineToOpen():
            return engine.open(program, weights, series)
        case "interpreter":
            return OpenedRollouts(interpreted_rollouts(program, weights, series), engine)
        case "torch":
            from msnn.simulation.engines.torch_rollouts import torch_rollouts

            return OpenedRollouts(torch_rollouts(program, weights, series), engine)
        case "native":

            def refused(reason: str, by: Exception) -> OpenedRollouts:
                raise SpecError([engines.no_native_rollouts(reason)]) from by

            return _native(program, weights, series, runs, refused)
        case "auto":

            def interpreted(reason: str, by: Exception) -> OpenedRollouts:
                del by
                note = engines.interpreted_instead(reason)
                judge = interpreted_rollouts(program, weights, series)
                return OpenedRollouts(judge, "interpreter", (note,))

            # as if nothing were compiled yet: to ask the cache needs the text of the kernel, which
            # takes as long as short simulations
            if interpreter_seconds(program, runs) < kernel_seconds(program):
                return open_rollouts("interpreter", program, weights, series, runs)
            return _native(program, weights, series, runs, interpreted)
        case _:
            raise AssertionError("`known_engine` knows no other, and exports are opened elsewhere")


def known_engine(name: str, *more: str) -> str:
    """The name, if it is one of `ENGINES` or `more` and its packages are installed.

    Raises SpecError and MissingExtraError.
    """
    known = (*ENGINES, *more)
    if name not in known:
        raise SpecError([engines.unknown_engine(name, known)])
    if name == "torch":
        TORCH.require("runs models with `--engine torch`")
    return name


def kernel_seconds(program: Program) -> float:
    """Estimated time to compile a kernel."""
    return _TO_COMPILE + len(program.step) * _TO_COMPILE_A_NODE


def interpreter_seconds(program: Program, runs: Runs) -> float:
    """Estimated time of the reference interpreter."""
    wanted = [output.node for output in program.outputs]
    wanted += [state.next for state in program.states]
    wanted += [node for loss in program.losses for node in loss.nodes]
    live = needed(program.step, wanted)
    sizes = [node.type.size for index, node in program.step if live[index]]
    # numpy is called once a step for a whole group, as often as the longest of it has steps
    longest = np.sort(runs.steps)[::-1][::SIDE_BY_SIDE]
    # what numpy takes by call, and by number
    calls, steps = int(longest.sum()), int(runs.steps.sum())
    return calls * len(sizes) * _SECONDS_A_NODE + steps * sum(sizes) * _SECONDS_A_NUMBER


def _native(
    program: Program,
    weights: Arrays,
    series: Arrays,
    runs: Runs,
    otherwise: Callable[[str, Exception], OpenedRollouts],
) -> OpenedRollouts:
    # jinja2 and the emitter are loaded only where kernels are made
    from backends.native.kernel_cache import kernel_folder
    from msnn.simulation.engines.kernel_check import NO_FALLBACK
    from msnn.simulation.engines.native_rollouts import NativeRollouts

    try:
        made = NativeRollouts(program, weights, series)
        made.check(runs)
    except CompilerMissingError as error:
        return otherwise(str(error), error)
    # a wrong kernel must not cost the result: the interpreter can give it, and the fault is told
    except Exception as error:
        if os.environ.get(NO_FALLBACK):
            raise
        reason = f"{type(error).__name__}: {str(error).strip()}".partition("\n")[0]
        return otherwise(f"{reason} (a mistake of msnn: please report it with the spec)", error)
    return OpenedRollouts(made, "native", kernel_folder_warnings(kernel_folder()))


def kernel_folder_warnings(found: KernelFolder) -> tuple[Diagnostic, ...]:
    """A warning if the folder for compiled kernels cannot be used; empty otherwise."""
    refused = found.refused
    if refused is None:
        return ()
    # a folder in which others write is no place to load code from (decision 0183)
    of = foreign_kernels if refused.is_foreign else unusable_kernel_folder
    return (of(refused.folder, refused.reason, found.path),)
