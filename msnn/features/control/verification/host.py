"""Checks a controller and a filter on this machine: golden solves, sanitizers, drawn numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from msnn.features.control.verification.exported_controller import ExportedController, KnownLimits
from msnn.verification.exported_c import includes
from msnn.verification.fuzz import FUZZED, FuzzerFoundError, run_fuzzer
from msnn.verification.harness import write_template
from msnn.verification.host_builds import (
    LEVELS,
    SANITIZERS,
    STANDARD,
    SharedObjects,
    levels_check,
    sanitizers_check,
)
from msnn.verification.host_checks import source_checks
from msnn.verification.proof_step import (
    CLANG,
    GCC,
    LIBFUZZER,
    ProofStep,
    Result,
    Tool,
    ToolFailedError,
    run_tool,
)

_RUNS = 400
"""Of drawn numbers, of 8 calls each."""
_ACCEPTED = ("-Wno-float-equal",)
"""`x * 0 == 0` is how the solver tells finite numbers from others."""
_SAID = re.compile(r"^(\w+) ([0-9a-f]{8})$", re.MULTILINE)


def online_host_checks(model: ExportedController) -> Iterator[ProofStep]:
    """Yields the checks on this machine, which only need gcc and clang and take seconds: self-tests
    at several optimisation levels, sanitizers, random numbers.
    """
    yield from source_checks(model, _ACCEPTED)

    shared = SharedObjects(model)

    def faults(tool: Tool, flags: Sequence[str], folder: Path) -> list[str]:
        return selftest_faults(model, _selftest(tool, model, folder, flags, shared))

    said = f"self-tests at {' '.join(LEVELS)}: {promise(model)}"
    for tool in (GCC, CLANG):
        yield levels_check("golden solves", tool, faults, said)
    yield sanitizers_check("golden solves", faults)
    yield _drawn(model, shared)


def online_fuzz_check(model: ExportedController, seconds: int) -> ProofStep:
    """The check that libFuzzer searches for inputs that break a promise of `_drawn`, for this
    number of seconds.
    """

    def run(folder: Path) -> Result:
        flags = (*FUZZED, "-DFUZZER", "-fno-sanitize-recover=all")
        program = _drawn_program(model, folder, CLANG, flags, SharedObjects(model))
        command = [program, f"-max_total_time={seconds}", "-max_len=4096"]
        try:
            runs = run_fuzzer(command, folder, seconds + 60.0)
        except FuzzerFoundError as error:
            return check.of(error.complaints, "the fuzzer found an input")
        return check.of([], f"{runs:,} runs of up to 8 calls in {seconds} s")

    check = ProofStep("fuzz", "clang", (CLANG, LIBFUZZER), run)
    return check


def no_proof(model: ExportedController) -> ProofStep:
    """A step that reports that there is no proof: the number of iterations depends on the data."""

    def run(folder: Path) -> Result:
        detail = "no analysis bounds what iterations compute; drawn numbers and sanitizers look"
        return Result(check=check.name, target=check.target, verdict="left out", detail=detail)

    check = ProofStep("proof", model.prefix, (), run)
    return check


def prefixes(model: ExportedController) -> list[str]:
    """The C prefixes of the controller and the estimator in the export."""
    return [part.prefix for part in (model.controller, model.filter) if part is not None]


def selftest_faults(model: ExportedController, said: str) -> list[str]:
    """A sentence for each self-test that returned other than 0 or did not end; `said` is the output
    of the test program.
    """
    # the program prints a line for each self-test as it returns: one that crashed left none, which
    # is another fault than one that returned bits
    answers = dict(_SAID.findall(said))
    return [
        f"the self-test of {prefix} returned 0x{answers[prefix]}"
        if prefix in answers
        else f"the self-test of {prefix} did not end"
        for prefix in prefixes(model)
        if answers.get(prefix) != "00000000"
    ]


def promise(model: ExportedController) -> str:
    """A text about the meaning of self-tests that return 0."""
    return "0 bits differ" if model.has_bits else "no bits were recorded: refusals and limits"


def _drawn(model: ExportedController, shared: SharedObjects) -> ProofStep:
    """The check with random calls and numbers, including NaN, infinite, huge and denormal ones:
    controls stay within limits and rates, and no byte outside the structs changes.
    """

    def run(folder: Path) -> Result:
        program = _drawn_program(model, folder, GCC, SANITIZERS, shared)
        try:
            run_tool([program], folder)
        except ToolFailedError as error:
            return check.of(error.complaints, "drawn numbers broke a promise")
        return check.of(
            [], f"{_RUNS} runs of 8 calls: limits and rates hold, no byte outside the structs"
        )

    check = ProofStep("drawn numbers", "gcc", (GCC,), run)
    return check


def _selftest(
    tool: Tool,
    model: ExportedController,
    folder: Path,
    flags: Sequence[str],
    shared: SharedObjects,
) -> str:
    main = write_template("online/selftest_main.c", folder, prefixes=prefixes(model))
    return run_tool([_linked(tool, model, folder, flags, main, shared)], folder)


def _drawn_program(
    model: ExportedController,
    folder: Path,
    tool: Tool,
    flags: Sequence[str],
    shared: SharedObjects,
) -> Path:
    single = model.dtype == "float32"
    controller, size = model.controller, 4 if single else 8
    # the most numbers that one call takes say how many bytes a run of 8 calls draws
    numbers = max(
        0 if controller is None else controller.inputs,
        0 if model.filter is None else model.filter.inputs + model.filter.measured,
    )
    main = write_template(
        "online/drawn_main.c",
        folder,
        controller=controller,
        filter=model.filter,
        real=model.real,
        tolerance=None if controller is None else repr(controller.tolerance),
        window_tolerance=None if model.filter is None else repr(model.filter.tolerance),
        limits=[] if controller is None else [_limits(limit, model) for limit in controller.limits],
        # squares of these overflow, and these lie below the smallest normal number
        huge="1e30" if single else "1e300",
        denormal="1e-40" if single else "1e-310",
        largest="3.4028234e38" if single else "1.797693134862315e308",
        bytes=8 * (3 + (numbers + 8) * (1 + size)),
        runs=_RUNS,
    )
    return _linked(tool, model, folder, flags, main, shared)


def _linked(
    tool: Tool,
    model: ExportedController,
    folder: Path,
    flags: Sequence[str],
    main: Path,
    shared: SharedObjects,
) -> Path:
    program = folder / main.stem
    objects = shared.of(tool, flags, folder)
    command = [tool.command, *STANDARD, *flags, *includes(model), main, *objects]
    run_tool([*command, "-o", program, "-lm"], folder)
    return program


def _limits(limit: KnownLimits, model: ExportedController) -> dict[str, Any]:
    """The limits as C literals, rounded to the floating-point type of the code."""
    rounded = np.float32 if model.dtype == "float32" else np.float64
    numbers = {"low": limit.low, "high": limit.high, "rate": limit.rate}
    return {
        **{key: None if x is None else repr(float(rounded(x))) for key, x in numbers.items()},
        "before": limit.before,
        "moves": limit.moves,
    }
