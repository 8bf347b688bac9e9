"""The self-test that runs on the target, and the test program for the host."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from backends.c.functions.function_writer import Weights
from backends.c.interface.interface import Interface
from backends.c.selftest.drawn_inputs import Outside, Place
from backends.c.selftest.golden_jacobian import slopes_function
from backends.c.selftest.golden_text import differs_function, golden_functions, kernels_function
from backends.c.selftest.golden_vectors import GoldenVectors, expected_text, golden_vectors
from backends.c.selftest.kernel_cases import kernel_cases
from backends.c_language.literals import hex_literal, real_literal
from backends.c_language.printer import Printer
from backends.c_language.rendering import render
from compiler.ir.program import Program

SELFTEST_STEPS = 16
"""Golden steps that travel with the code to the target."""

_PARTS = 7
_STARTS: tuple[Place | Outside | None, ...] = (
    *(Place(part, _PARTS) for part in range(_PARTS)),
    *(Place(part, _PARTS, "at") for part in range(_PARTS)),
    *(Place(part, _PARTS, "below") for part in range(_PARTS)),
    "above",
    "below",
    "far above",
    "nan",
    None,
)
"""Where the golden runs of the test program begin: the last without a past."""

_TEST_STEPS = 16
"""Golden steps of each."""

_SELFTEST_SEED, _TEST_SEED = 1, 2


def selftest_text(
    program: Program, interface: Interface, weights: Weights, kernels: Collection[str]
) -> str:
    """`src/<prefix>_selftest.c`: golden steps, kernels, and what a compiler may do wrong."""
    dtype, prefix = interface.options.dtype, interface.prefix
    printer = Printer(prefix, dtype)
    golden = golden_vectors(program, interface, weights, SELFTEST_STEPS, _SELFTEST_SEED)
    functions = _golden(interface, [golden])
    if kernels:
        if not interface.outputs and interface.jacobian is None:
            functions.append(printer.function(differs_function(prefix)))
        check = kernels_function(prefix, kernel_cases(kernels, dtype))
        functions.append(printer.function(check))
    # 1 + ε' squared is 1 + 2ε' + ε'²: for this ε' the last term is lost when the product is rounded
    small = 2.0**-12 if dtype == "float32" else 2.0**-27
    return render(
        "selftest.c.j2",
        interface,
        "Self-test",
        functions=functions,
        kernels=bool(kernels),
        jacobian=interface.jacobian is not None,
        steps=SELFTEST_STEPS,
        factor=hex_literal(1.0 + small, dtype),
        square=hex_literal(1.0 + 2.0 * small, dtype),
        smallest=hex_literal(float(np.finfo(dtype).tiny), dtype),
        half=real_literal(0.5, dtype),
        zero=real_literal(0.0, dtype),
    )


def test_texts(program: Program, interface: Interface, weights: Weights) -> dict[str, str]:
    """`test/<prefix>_sil.c`, the vectors that it replays, and the bits that it must answer."""
    prefix = interface.prefix
    runs = [
        golden_vectors(
            program,
            interface,
            weights,
            _TEST_STEPS,
            _TEST_SEED + run,
            start=start,
        )
        for run, start in enumerate(_STARTS)
    ]
    vectors = render(
        "vectors.h.j2",
        interface,
        "Golden vectors",
        guard=f"{prefix.upper()}_VECTORS_H",
        functions=_golden(interface, runs),
    )
    main = render(
        "main.c.j2",
        interface,
        "Test program",
        jacobian=interface.jacobian is not None,
        letters=[vector.letter for vector in interface.jacobian.vectors]
        if interface.jacobian is not None
        else [],
        runs=len(_STARTS),
        steps=_TEST_STEPS,
    )
    return {
        f"test/{prefix}_sil.c": main,
        f"test/{prefix}_vectors.h": vectors,
        f"test/{prefix}_expected.txt": expected_text(interface, runs),
    }


def _golden(interface: Interface, runs: Sequence[GoldenVectors]) -> list[str]:
    printer = Printer(interface.prefix, interface.options.dtype)
    functions = [*golden_functions(interface, runs)]
    if interface.jacobian is not None:
        if not interface.outputs:
            functions.insert(0, differs_function(interface.prefix))
        functions.append(slopes_function(interface, interface.jacobian, runs))
    return [printer.function(function) for function in functions]
