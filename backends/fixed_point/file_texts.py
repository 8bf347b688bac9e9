"""The text of every file of a folder with C in fixed point."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2

import templates
from backends.c.c_comments import string_literal
from backends.c.c_layout import comment, wrapped
from backends.c.c_printer import Printer
from backends.fixed_point.functions import FixedFunctions
from backends.fixed_point.golden_text import expected_text, golden_facts
from backends.fixed_point.names import FixedNames, fixed_names
from backends.fixed_point.structs import port_comment, structs
from compiler.fixed_point.deviation import OutputError
from compiler.fixed_point.golden import golden_run
from compiler.fixed_point.integer_program import IntegerProgram, WordPort
from compiler.fixed_point.run_integers import FixedStatus
from spec_schema.version import __version__

SELFTEST_STEPS = 16
_RUNS, _STEPS, _SEED = 10, 25, 2
_MEANING = {
    FixedStatus.OUT_OF_RANGE: "an input was outside its range",
    FixedStatus.CLAMPED: "an input was moved to the nearest limit",
    FixedStatus.HELD: "an input was replaced by its last valid value",
    FixedStatus.STATE_SATURATED: "a state was kept at the end of its range",
    FixedStatus.EQUATION_OUT_OF_RANGE: "an equation was kept at the end of its range",
    FixedStatus.UNINITIALISED: "the step began without values that only reset can give",
}


def file_texts(
    program: IntegerProgram, prefix: str, errors: Sequence[OutputError]
) -> dict[str, str]:
    """Texts by path in the folder, the same bytes for the same program."""
    names = fixed_names(program, prefix)
    prefix, bits = names.prefix, program.width.word
    functions = FixedFunctions(program, names)
    bodies = {"init": functions.init(), "reset": functions.reset(), "step": functions.step()}
    all_bodies = "".join(bodies.values())
    test_runs = [
        golden_run(program, _STEPS, _SEED + run, from_init=run == _RUNS - 1) for run in range(_RUNS)
    ]
    ports = _ports(program, names)
    made_by = f"msnn {__version__}"
    texts = {
        f"include/{prefix}.h": _filled(
            "header.h",
            names,
            program,
            "Interface",
            doc=comment(program.doc) if program.doc else "",
            word_type=f"int{bits}_t",
            sum_type=f"int{program.width.sum}_t",
            made_by=string_literal(made_by),
            spec_sha256=string_literal(program.spec_hash),
            ports=ports,
            status=[_bit(names, bit) for bit in FixedStatus],
            structs=structs(program, names),
            selftest_steps=SELFTEST_STEPS,
        ),
        f"include/{prefix}_real.h": _filled(
            "real.h", names, program, "Physical numbers", ports=ports, **_real_type(program)
        ),
        f"src/{prefix}.c": _filled(
            "source.c",
            names,
            program,
            "Step, init and reset",
            tables=[_table(name, values, names) for values, name in functions.tables.items()],
            uses_shift=f"{prefix}_shifted" in all_bodies or bool(functions.tables),
            uses_limit=f"{prefix}_limited" in all_bodies,
            **bodies,
        ),
        f"src/{prefix}_selftest.c": _filled(
            "selftest.c",
            names,
            program,
            "Self-test",
            steps=SELFTEST_STEPS,
            **golden_facts(program, names, [golden_run(program, SELFTEST_STEPS, 1)]),
        ),
        f"test/{prefix}_vectors.h": _filled(
            "vectors.h",
            names,
            program,
            "Golden vectors",
            **golden_facts(program, names, test_runs),
        ),
        f"test/{prefix}_sil.c": _filled(
            "main.c", names, program, "Test program", runs=_RUNS, steps=_STEPS
        ),
        f"test/{prefix}_expected.txt": expected_text(program, test_runs),
        "CMakeLists.txt": _filled("CMakeLists.txt", names, program, ""),
        "README.md": _filled(
            "README.md",
            names,
            program,
            "",
            dtype=program.width.name,
            ports=ports,
            errors=[_error_row(error) for error in errors],
            error_steps=errors[0].steps if errors else 0,
        ),
        f"{prefix}.json": _metadata(program, names, errors, made_by),
    }
    return dict(sorted(texts.items()))


def _filled(
    template: str, names: FixedNames, program: IntegerProgram, title: str, **facts: Any
) -> str:
    banner = comment(f"{title} of the model `{program.name}`. Made by msnn; do not edit.")
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(templates.__path__[0])),
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        autoescape=False,  # noqa: S701  (C; texts of a spec arrive as safe comments and literals)
    )
    found = environment.get_template(f"fixed_point/{template}.j2")
    text = found.render(banner=banner, prefix=names.prefix, macro=names.macro, **facts)
    if not template.endswith((".c", ".h")):
        return text
    return "\n".join(
        part
        for line in text.split("\n")
        for part in ([line] if line.startswith("#") else wrapped(line))
    )


def _ports(program: IntegerProgram, names: FixedNames) -> list[dict[str, Any]]:
    listed = [
        *(("input", e.port, names.inputs[e.port.name]) for e in program.inputs),
        *(("output", port, names.outputs[port.name]) for port, _ in program.outputs),
        *(("start", port, names.windows[port.name]) for port in program.windows),
    ]
    return [_port(kind, port, field, names, program) for kind, port, field in listed]


def _port(
    kind: str, port: WordPort, field: str, names: FixedNames, program: IntegerProgram
) -> dict[str, Any]:
    infix = "x0_" if kind == "start" else ""
    macro = f"{names.macro}_{infix.upper()}{field.upper()}"
    ending = "F" if program.width.word == 16 else ""
    step = math.ldexp(1.0, -port.fraction)
    return {
        "kind": kind,
        "name": port.name,
        "macro": macro,
        "function": f"{names.prefix}_{infix}{field}",
        "goes_in": kind != "output",
        "comment": comment(f"{kind} {port.name}: {port_comment(port)}"),
        "fraction": port.fraction,
        "low": port.low,
        "high": port.high,
        "step": f"{step:.3g}",
        "scale": f"{math.ldexp(1.0, port.fraction)!r}{ending}",
        "unscale": f"{step!r}{ending}",
    }


def _real_type(program: IntegerProgram) -> dict[str, str]:
    if program.width.word == 16:
        return {"real": "float", "zero": "0.0F", "half": "0.5F"}
    return {"real": "double", "zero": "0.0", "half": "0.5"}


def _bit(names: FixedNames, bit: FixedStatus) -> dict[str, object]:
    macro = f"{names.macro}_STATUS_{bit.name}"
    return {"comment": comment(_MEANING[bit]), "macro": macro, "value": int(bit)}


def _table(name: str, values: tuple[int, ...], names: FixedNames) -> str:
    text = Printer(names.prefix, "float32").braced([str(value) for value in values])
    return f"static const {names.prefix}_word_t {name}[{len(values)}] = {text};"


def _error_row(error: OutputError) -> dict[str, str]:
    return {
        "name": error.name,
        "largest": f"{error.largest:.2g}",
        "rms": f"{error.rms:.2g}",
        "span": f"{error.span:.4g}",
        "relative": f"{error.relative:.1e}",
    }


def _metadata(
    program: IntegerProgram, names: FixedNames, errors: Sequence[OutputError], made_by: str
) -> str:
    data = {
        "format": 1,
        "made_by": made_by,
        "model": program.name,
        "doc": program.doc,
        "spec_sha256": program.spec_hash,
        "sample_time": program.sample_time,
        "c": {
            "prefix": names.prefix,
            "dtype": program.width.name,
            "exact": True,
            "takes_parameters": False,
            "status": {f"{names.macro}_STATUS_{bit.name}": int(bit) for bit in FixedStatus},
            "structs": {
                struct["name"]: [field["about"] for field in struct["fields"]]
                for struct in structs(program, names)
            },
        },
        "errors": [
            {"output": e.name, "largest": e.largest, "rms": e.rms, "range": e.span} for e in errors
        ],
    }
    return json.dumps(data, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
