"""Lets libFuzzer look for a state and inputs that make a step do what C leaves undefined."""

from __future__ import annotations

import re
from pathlib import Path

from msnn.verification.check import Check, Result, ToolFailedError, run_tool
from msnn.verification.exported_c import ExportedC
from msnn.verification.harness import write_harness
from msnn.verification.tools import CLANG, LIBFUZZER

_SANITIZERS = "-fsanitize=fuzzer,address,undefined,float-cast-overflow"
_DONE = re.compile(r"Done (\d+) runs in (\d+) second")


def fuzz_check(model: ExportedC, seconds: int) -> Check:
    """For so many seconds: any bits as state, a corrupted one included, and any inputs."""

    def run(folder: Path) -> Result:
        main = write_harness("fuzz_main.c", model, folder)
        program = folder / "fuzz"
        run_tool(
            [
                *(CLANG.command, "-std=c99", "-O1", "-g", "-ffp-contract=off", _SANITIZERS),
                *("-fno-sanitize-recover=all", f"-I{model.include}", main),
                *(*model.model_sources, "-o", program, "-lm"),
            ],
            folder,
        )
        limits = [f"-max_total_time={seconds}", "-max_len=65536", "-seed=1", "-len_control=0"]
        try:
            said = run_tool([program, *limits], folder, seconds + 60.0)
        except ToolFailedError as error:
            return check.of(error.lines or [str(error)], "the fuzzer found an input")
        done = _DONE.search(said)
        runs = f"{int(done[1]):,} runs" if done else "runs"
        return check.of([], f"{runs} of 8 steps in {seconds} s, corrupted states included")

    check = Check("fuzz", "clang", (CLANG, LIBFUZZER), run)
    return check
