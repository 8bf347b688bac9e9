"""Writes the text of every file of a fixed-point C export."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from typing import Any

from backends.asap2.text import a2l_text
from backends.c.folder.file_texts import NUMBER, ffi_texts, package_texts
from backends.c.folder.header_text import about_text, defined, origin
from backends.c.interface.status import MEANING, SelfTestBit, StatusBit, status_macro
from backends.c_language.printer import Printer
from backends.c_language.rendering import comment, render
from backends.c_language.tree import Function
from backends.files.export_identity import OPEN, with_identity, with_manifest
from msnn.features.fixed_point.backend.functions import FixedFunctions
from msnn.features.fixed_point.backend.selftest import (
    SELFTEST_STEPS,
    selftest_functions,
    test_texts,
)
from msnn.features.fixed_point.backend.structs import (
    FixedNames,
    calibrated_model,
    fixed_names,
    fixed_printer,
    port_facts,
    real_type,
    structs,
)
from msnn.features.fixed_point.deviation import OutputError
from msnn.features.fixed_point.integers.interpret import FixedStatus
from msnn.features.fixed_point.integers.program import IntegerProgram, StepError, WordPort

_MEANING = {
    FixedStatus.OUT_OF_RANGE: "an input was outside its range",
    FixedStatus.CLAMPED: "an input was moved to the nearest limit",
    FixedStatus.HELD: "an input was replaced by its last valid value",
    FixedStatus.STATE_SATURATED: "a state left its range: it is at the end of it, or back at init",
    FixedStatus.EQUATION_OUT_OF_RANGE: "an equation was kept at the end of its range",
    FixedStatus.UNINITIALISED: MEANING[StatusBit.UNINITIALISED],
}


def file_texts(
    program: IntegerProgram, prefix: str, errors: Sequence[OutputError]
) -> dict[str, str]:
    """The text of each file of the export, by its path in the folder; the same arguments give the
    same bytes.

    `prefix` begins all C names; `errors` are the measured errors of the outputs, for README and
    description.
    """
    names = fixed_names(program, prefix)
    # `fixed_names` may have numbered a prefix that is a word of C: every file takes the one it gave
    prefix = names.prefix
    texts = {
        **step_texts(program, prefix, errors),
        f"src/{prefix}_selftest.c": _filled(
            "selftest.c",
            names,
            "Self-test",
            has_state=bool(program.memories or names.held),
            steps=SELFTEST_STEPS,
            # a seed of its own: the test program replays other numbers than the self-test
            functions=selftest_functions(program, names),
        ),
        **test_texts(program, names),
        f"{prefix}.a2l": a2l_text(calibrated_model(program, names)),
    }
    texts["README.md"] = _readme(program, names, errors, texts)
    texts |= package_texts(names, texts, in_reals=False)
    return with_manifest(with_identity(dict(sorted(texts.items()))))


def step_texts(
    program: IntegerProgram, prefix: str, errors: Sequence[OutputError] = ()
) -> dict[str, str]:
    """The files that a program needs to call the step, by path: headers, sources, JSON description,
    foreign-function interface. They contain no tests.
    """
    names = fixed_names(program, prefix)
    prefix = names.prefix
    # the functions come first: the helpers that `definitions` prints are those that they called
    writer = FixedFunctions(program, names)
    functions = writer.all()
    printer = fixed_printer(program, names)
    ports, differs = port_facts(program, names), SelfTestBit.STEP_DIFFERS
    texts = {
        f"include/{prefix}.h": _filled(
            "header.h",
            names,
            "Interface",
            doc=comment(program.doc) if program.doc else "",
            word_type=f"int{program.width.word}_t",
            sum_type=f"int{program.width.sum}_t",
            **origin(program),
            # no float may stand in the header, not even a macro: code in fixed point builds where
            # there is none
            sample_time=None,
            status=[defined(names.status(bit), bit, _MEANING[bit]) for bit in writer.status_bits()],
            selftest=[defined(status_macro(prefix, differs), differs, MEANING[differs])],
            structs=structs(program, names),
            prototypes={name: printer.prototype(made) for name, made in functions.items()},
            selftest_steps=SELFTEST_STEPS,
            selftest_checks="",
            late=program.late,
        ),
        f"include/{prefix}_real.h": _filled(
            "real.h", names, "Physical numbers", ports=ports, **real_type(program)
        ),
        f"src/{prefix}.c": _filled(
            "source.c",
            names,
            "Step, init and reset",
            restarts=any(memory.restarts for memory in program.memories),
            functions=_printed(printer, [*writer.definitions(), *functions.values()]),
        ),
        f"src/{prefix}_about.c": about_text(names, program, None),
        f"{prefix}.json": _metadata(program, names, errors, writer.status_bits()),
    }
    bits = program.width
    return texts | ffi_texts(names, {"word": f"c_int{bits.word}", "sum": f"c_int{bits.sum}"})


def _readme(
    program: IntegerProgram,
    names: FixedNames,
    errors: Sequence[OutputError],
    paths: Iterable[str],
) -> str:
    zero = real_type(program)["zero"]
    return _filled(
        "README.md",
        names,
        "",
        headers=[f"{names.prefix}.h", f"{names.prefix}_real.h"],
        in_reals=False,
        version=NUMBER,
        sources=sorted(p for p in paths if p.startswith("src/") and p.endswith(".c")),
        input_names=[entry.port.name for entry in program.inputs],
        assignments=[
            _assignment("u", names.inputs[e.port.name], names.prefix, e.port, zero)
            for e in program.inputs
        ],
        starts=[
            _assignment("x0", names.windows[port.name], f"{names.prefix}_x0", port, zero)
            for port in program.windows
        ],
        outputs=[_shown(names, port) for port, _ in program.outputs],
        dtype=program.width.name,
        late=program.late,
        ports=port_facts(program, names),
        errors=[_error_row(error) for error in errors],
        error_steps=errors[0].steps if errors else 0,
        step_errors=[_step_row(error) for error in program.step_errors if error.largest],
    )


def _assignment(base: str, field: str, begin: str, port: WordPort, zero: str) -> str:
    word = f"{begin}_{field}_from_real({zero});"
    if not port.axes:
        return f"{base}.{field} = {word}"
    return f"for (int i = 0; i < {port.size}; i++) {base}.{field}[i] = {word}"


def _shown(names: FixedNames, port: WordPort) -> str:
    field = names.outputs[port.name]
    return f"(double){names.prefix}_{field}_to_real(y.{field}{'[0]' if port.axes else ''})"


def _printed(printer: Printer, functions: Iterable[Function]) -> list[str]:
    return [printer.function(function) for function in functions]


def _filled(template: str, names: FixedNames, title: str, **facts: Any) -> str:
    return render(f"{template}.j2", names, title, "fixed_point", **facts)


def _error_row(error: OutputError) -> dict[str, str]:
    return {
        "name": error.name,
        "largest": f"{error.largest:.2g}",
        "rms": f"{error.rms:.2g}",
        "span": f"{error.span:.4g}",
        "relative": f"{error.relative:.1e}",
    }


def _step_row(error: StepError) -> dict[str, str]:
    return {
        "kind": "state" if error.is_state else "output",
        "name": error.name,
        "largest": f"{error.largest:.2g}" if math.isfinite(error.largest) else "not proved",
    }


def _metadata(
    program: IntegerProgram,
    names: FixedNames,
    errors: Sequence[OutputError],
    bits: Sequence[FixedStatus],
) -> str:
    data = {
        "format": 1,
        "made_by": program.made_by,
        "model": program.name,
        "doc": program.doc,
        "spec_sha256": program.spec_hash,
        "export_sha256": OPEN,
        "sample_time": program.sample_time,
        **({"late": program.late} if program.late else {}),
        "c": {
            "prefix": names.prefix,
            "dtype": program.width.name,
            "exact": True,
            "takes_parameters": False,
            "status": {names.status(bit): int(bit) for bit in bits},
            "structs": {
                struct["name"]: [field["about"] for field in struct["fields"]]
                for struct in structs(program, names)
            },
        },
        "errors": [
            {
                "output": e.name,
                "largest": e.largest,
                "rms": e.rms,
                "range": e.span,
                "steps": e.steps,
            }
            for e in errors
        ],
        "step_errors": [
            {
                "name": e.name,
                "kind": "state" if e.is_state else "output",
                "largest": e.largest if math.isfinite(e.largest) else None,
            }
            for e in program.step_errors
        ],
    }
    # floats are written by their shortest text that reads back alike, so the bytes depend on no
    # machine
    # JSON has no infinity: what is not proved is null above
    return json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
