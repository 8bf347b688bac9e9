"""Uses libFuzzer to find undefined behaviour of C, and inputs that violate their policy."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from msnn.verification.exported_c import ExportedC, Range, RangedField
from msnn.verification.harness import write_harness
from msnn.verification.host_builds import STANDARD
from msnn.verification.proof_step import (
    CLANG,
    LIBFUZZER,
    ProofStep,
    Result,
    ToolFailedError,
    UnansweredError,
    run_tool,
)

FUZZED = ("-O1", "-g", "-fsanitize=fuzzer,address,undefined,float-cast-overflow")
"""Flags of clang for a program with libFuzzer."""
_DONE = re.compile(r"Done (\d+) runs in (\d+) second")


def fuzz_check(model: ExportedC, seconds: int) -> ProofStep:
    """A check that fuzzes the C for `seconds`, from arbitrary bits as state and with any inputs.

    It also fuzzes from a valid start; there, invalid inputs must follow their policies and outputs
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


_UNBOUNDED = 1e3
"""Maximum magnitude of start values without a range in the spec."""


def fuzz_facts(model: ExportedC) -> dict[str, Any]:
    """The values for the template `fuzz_main.c`."""
    reals = [member for member in model.inputs if not member.unsigned]
    # after one of these bits a step has said that its answer may be anything
    told = ("STATE_OUT_OF_RANGE", "UNINITIALISED", "EQUATION_OUT_OF_RANGE")
    return {
        "held": [
            {
                "held": f"held_{member.field}",
                "size": member.size or 1,
                "instead": _literal(_stand_in(_limits(member, model)), model),
            }
            for member in reals
            if member.policy == "hold"
        ],
        "start": list(_start(model)),
        "within": [
            # flagged and trusted inputs are given valid
            _moved(member, "u", "u", member.range or (-_UNBOUNDED, _UNBOUNDED), model)
            for member in reals
            if member.policy not in ("clamp", "hold")
        ],
        "replaced": [line for member in reals for line in _replaced(member, model)],
        "outputs": [
            {
                "name": member.name,
                "first": member.field + ("" if member.size is None else "[0]"),
                "size": member.size or 1,
            }
            for member in model.outputs
            if not member.unsigned
        ],
        "mask": sum(model.status.get(f"{model.prefix.upper()}_STATUS_{bit}", 0) for bit in told),
    }


def _start(model: ExportedC) -> Iterator[str]:
    """C code that moves each argument of `reset` into the range of its state or input."""
    ranges = {m.name: m.range for m in (*model.inputs, *model.state) if m.range is not None}
    for member in model.start:
        if not member.unsigned:
            low, high = ranges.get(member.name, (-_UNBOUNDED, _UNBOUNDED))
            yield _moved(member, "x0", "x0", (low, high), model)


def _replaced(member: RangedField, model: ExportedC) -> Iterator[str]:
    limits = _limits(member, model)
    if member.policy == "clamp":
        yield _moved(member, "v", "u", limits, model)
    if member.policy == "hold":
        # the last valid value is kept beside the model, as its step keeps it inside
        place, low, high = _place(member, "u"), *(_literal(x, model) for x in limits)
        kept = f"held_{member.field}[i]"
        loop = f"for (int i = 0; i < {member.size or 1}; i++)"
        yield f"{loop} {{ if (valid({place}, {low}, {high})) {{ {kept} = {place}; }} }}"
        yield f"{loop} {{ {_place(member, 'v')} = {kept}; }}"


def _moved(member: RangedField, to: str, source: str, limits: Range, model: ExportedC) -> str:
    low, high, instead = (_literal(x, model) for x in (*limits, _stand_in(limits)))
    moved = f"nearest({_place(member, source)}, {low}, {high}, {instead})"
    loop = f"for (int i = 0; i < {member.size or 1}; i++)"
    return f"{loop} {{ {_place(member, to)} = {moved}; }}"


def _place(member: RangedField, struct: str) -> str:
    return f"{struct}.{member.field}" + ("" if member.size is None else "[i]")


def _limits(member: RangedField, model: ExportedC) -> Range:
    """The valid range: finite values within the declared range."""
    single = model.dtype == "float32"
    # in C every comparison is of this type: a larger literal would be infinite
    largest = float(np.finfo(np.float32).max) if single else sys.float_info.max
    low, high = member.range or (-largest, largest)
    return low, high


def _stand_in(limits: Range) -> float:
    """The replacement for NaN, and for `hold` before the first valid value."""
    return min(max(0.0, limits[0]), limits[1])


def _literal(value: float, model: ExportedC) -> str:
    return f"({value!r}f)" if model.dtype == "float32" else f"({value!r})"
