"""Lets libFuzzer look for what C leaves undefined, and for inputs that break their policy."""

from __future__ import annotations

import re
from pathlib import Path

from msnn.verification.builds.harness import write_harness
from msnn.verification.exported_c import ExportedC
from msnn.verification.host.fuzz_values import fuzz_facts
from msnn.verification.proof_step import (
    ProofStep,
    Result,
    ToolFailedError,
    ToolTimedOutError,
    run_tool,
)
from msnn.verification.tools import CLANG, LIBFUZZER

_SANITIZERS = "-fsanitize=fuzzer,address,undefined,float-cast-overflow"
_OPTIONS = ("-max_len=65536", "-seed=1", "-len_control=0")
_DONE = re.compile(r"Done (\d+) runs in (\d+) second")


def fuzz_check(model: ExportedC, seconds: int) -> ProofStep:
    """For so many seconds: any bits as state, a corrupted one included, and any inputs; and from a
    valid start, where invalid inputs act as their policies say and outputs stay finite."""

    def run(folder: Path) -> Result:
        if model.fixed_point:
            detail = "integers are proved for states within their limits, which fuzzing would break"
            return Result(check=check.name, target=check.target, verdict="left out", detail=detail)
        try:
            runs = fuzz(model, folder, f"-max_total_time={seconds}", seconds + 60.0)
        except FuzzerFoundError as error:
            named = [line for line in error.lines if "error:" in line or "ERROR:" in line]
            found = named or error.lines or [str(error)]
            return check.of(found, "the fuzzer found an input")
        return check.of([], f"{runs:,} runs of 8 steps in {seconds} s, corrupted states included")

    check = ProofStep("fuzz", "clang", (CLANG, LIBFUZZER), run)
    return check


class FuzzerFoundError(ToolFailedError):
    """A run did what C leaves undefined; `lines` say what and where."""


def fuzz(model: ExportedC, folder: Path, limit: str, seconds: float) -> int:
    """Runs libFuzzer up to its limit (`-runs=10000`); how many runs it made.

    Raises FuzzerFoundError, and ToolFailedError where the fuzzer cannot be built.
    """
    main = write_harness("fuzz_main.c", model, folder, **fuzz_facts(model))
    program = folder / "fuzz"
    run_tool(
        [
            *(CLANG.command, "-std=c99", "-O1", "-g", "-ffp-contract=off", _SANITIZERS),
            *("-fno-sanitize-recover=all", f"-I{model.include}", main),
            *(*model.model_sources, "-o", program, "-lm"),
        ],
        folder,
    )
    try:
        said = run_tool([program, limit, *_OPTIONS], folder, seconds)
    # a failed tool too, but no finding: the fuzzer should have ended by itself
    except ToolTimedOutError:
        raise
    except ToolFailedError as error:
        raise FuzzerFoundError(str(error), "\n".join(error.lines)) from error
    done = _DONE.search(said)
    return int(done[1]) if done else 0
