"""Uses libFuzzer to find undefined behaviour of C, and inputs that violate their policy."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from msnn.verification.builds.harness import write_harness
from msnn.verification.exported_c import ExportedC
from msnn.verification.host.fuzz_values import fuzz_facts
from msnn.verification.host.levels import STANDARD
from msnn.verification.proof_step import (
    ProofStep,
    Result,
    ToolFailedError,
    UnansweredError,
    run_tool,
)
from msnn.verification.tools import CLANG, LIBFUZZER

FUZZED = ("-O1", "-g", "-fsanitize=fuzzer,address,undefined,float-cast-overflow")
"""Flags of clang for a program with libFuzzer."""
_DONE = re.compile(r"Done (\d+) runs in (\d+) second")


def fuzz_check(model: ExportedC, seconds: int) -> ProofStep:
    """Fuzzes for `seconds`: arbitrary bits as state, including corrupted ones, and any inputs.

    Also fuzzes from a valid start; there, invalid inputs must follow their policies and outputs
    must stay finite.
    """

    def run(folder: Path) -> Result:
        # arbitrary bits are no state that a run can reach, and the proof is about those
        if model.fixed_point:
            detail = "integers are proved for states within their limits, which fuzzing would break"
            return Result(check=check.name, target=check.target, verdict="left out", detail=detail)
        try:
            runs = fuzz(model, folder, f"-max_total_time={seconds}", seconds + 60.0)
        except FuzzerFoundError as error:
            return check.of(error.complaints, "the fuzzer found an input")
        return check.of([], f"{runs:,} runs of 8 steps in {seconds} s, corrupted states included")

    check = ProofStep("fuzz", "clang", (CLANG, LIBFUZZER), run)
    return check


class FuzzerFoundError(ToolFailedError):
    """A run has undefined behaviour; `lines` describe it and its place."""


def fuzz(model: ExportedC, folder: Path, limit: str, seconds: float) -> int:
    """Runs libFuzzer up to its limit (`-runs=10000`); returns the number of runs.

    Raises the errors of `run_fuzzer`, and ToolFailedError if the fuzzer cannot be built.
    """
    main = write_harness("fuzz_main.c", model, folder, **fuzz_facts(model))
    program = folder / "fuzz"
    run_tool(
        [
            *(CLANG.command, *STANDARD, *FUZZED),
            *("-fno-sanitize-recover=all", f"-I{model.include}", main),
            *(*model.model_sources, "-o", program, "-lm"),
        ],
        folder,
    )
    return run_fuzzer([program, limit, "-max_len=65536"], folder, seconds)


def run_fuzzer(command: Sequence[str | Path], folder: Path, seconds: float) -> int:
    """Runs a program with libFuzzer; returns the number of runs.

    Raises FuzzerFoundError, and UnansweredError if the program ends without a summary.
    """
    try:
        # long inputs from the beginning on: a run of 8 calls reads many bytes
        said = run_tool([*command, "-seed=1", "-len_control=0"], folder, seconds)
    except ToolFailedError as error:
        raise FuzzerFoundError(str(error), "\n".join(error.lines)) from error
    done = _DONE.search(said)
    if done is None:
        raise UnansweredError("the fuzzer ended before it had made its runs")
    return int(done[1])
