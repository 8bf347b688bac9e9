"""C99 header and source of the kernels that a model uses, without the mathematical library."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from compiler.kernels.c_choices import choice_functions
from compiler.kernels.c_literals import c_kind, table_lines
from compiler.kernels.c_routine import RoutineText
from compiler.kernels.table import KERNELS
from compiler.kernels.tables.formats import FORMATS, RealName
from compiler.kernels.trace.statements import Block, Branch, Call, Routine
from compiler.kernels.trace.subroutine import trace
from compiler.kernels.trace.without_branches import without_branches


@dataclass(frozen=True, slots=True)
class CKernels:
    """Two C files and the functions they offer, kernel name → C name.

    Their bits need IEEE 754 arithmetic without contraction: compile with -ffp-contract=off and
    never with -ffast-math.
    """

    header_name: str
    header: str
    source_name: str
    source: str
    functions: Mapping[str, str]


def c_sources(
    names: Iterable[str], real: RealName, prefix: str, *, constant_time: bool = False
) -> CKernels:
    """The kernels named, as functions `<prefix>_<name>`; those they call become static functions.

    In `constant_time` they perform the same operations for every argument.

    The text does not depend on the order of `names`. Raises KeyError for a name not in `KERNELS`.
    """
    chosen = sorted(set(names))
    roots = [trace(KERNELS[name].subroutine, FORMATS[real]) for name in chosen]
    if constant_time:
        roots = [without_branches(root) for root in roots]
    routines = _callees_first(roots)
    functions = {name: f"{prefix}_{name}" for name in chosen}
    bodies = [RoutineText(routine, prefix, constant_time) for routine in routines]
    definitions = [_function(body, body.routine.name in functions) for body in bodies]
    choices = choice_functions(
        (name for body in bodies for name in body.choices), FORMATS[real], prefix
    )
    needs_math = any(body.needs_math for body in bodies)
    header_name = f"{prefix}_math.h"
    return CKernels(
        header_name,
        _header(roots, prefix),
        f"{prefix}_math.c",
        _source([*choices, *definitions], header_name, needs_math),
        functions,
    )


def c_definitions(names: Iterable[str], real: RealName, prefix: str) -> str:
    """The kernels named as static functions `<prefix>_<name>`, callees first, for a source that
    includes float.h, math.h, stdbool.h and stdint.h."""
    roots = [trace(KERNELS[name].subroutine, FORMATS[real]) for name in sorted(set(names))]
    bodies = [RoutineText(routine, prefix) for routine in _callees_first(roots)]
    return "\n".join(_function(body, public=False) for body in bodies)


def _callees_first(roots: list[Routine]) -> list[Routine]:
    ordered: dict[str, Routine] = {}

    def visit(routine: Routine) -> None:
        for callee in _called(routine.body):
            visit(callee)
        ordered.setdefault(routine.name, routine)

    for root in roots:
        visit(root)
    return list(ordered.values())


def _called(block: Block) -> list[Routine]:
    found: list[Routine] = []
    for statement in block.statements:
        if isinstance(statement, Call):
            found.append(statement.routine)
        elif isinstance(statement, Branch):
            found += _called(statement.then) + _called(statement.otherwise)
    return found


def _signature(routine: Routine, prefix: str) -> str:
    real = routine.format.c_type
    parameters = [f"{real} {parameter.hint}" for parameter in routine.parameters]
    if len(routine.results) == 1:
        result = real
    else:
        result = "void"
        parameters += [
            f"{c_kind(value.kind, routine.format)} *{name}"
            for name, value in zip(routine.results, routine.body.values, strict=True)
        ]
    return f"{result} {prefix}_{routine.name}({', '.join(parameters)})"


def _function(text: RoutineText, public: bool) -> str:
    """The definition of a routine."""
    routine, prefix = text.routine, text.prefix
    values = text.write_block(routine.body, 1)
    lines = [f"/* {routine.doc} */"]
    lines += [f"{'' if public else 'static '}{_signature(routine, prefix)}", "{"]
    for table in text.tables.values():
        lines += table_lines(table, routine.format)
    lines += text.lines
    if len(routine.results) == 1:
        lines.append(f"    return {values[0]};")
    else:
        lines += [
            f"    *{name} = {value};" for name, value in zip(routine.results, values, strict=True)
        ]
    lines.append("}")
    return "\n".join(lines) + "\n"


def _header(roots: list[Routine], prefix: str) -> str:
    guard = f"{prefix.upper()}_MATH_H"
    prototypes = [f"/* {root.doc} */\n{_signature(root, prefix)};\n" for root in roots]
    opening = _HEADER_OPENING.format(guard=guard)
    return "\n".join([opening, *prototypes, _HEADER_CLOSING.format(guard=guard)])


def _source(functions: list[str], header_name: str, needs_math: bool) -> str:
    includes = [f'#include "{header_name}"\n', "#include <float.h>"]
    if needs_math:
        includes.append("#include <math.h>")
    includes += ["#include <stdbool.h>", "#include <stdint.h>\n"]
    return "\n".join([*includes, _ENVIRONMENT, *functions])


_HEADER_OPENING = """\
/* Scalar functions with the same bits on every IEEE 754 machine. Compile with
   -ffp-contract=off and without -ffast-math. */

#ifndef {guard}
#define {guard}

#ifdef __cplusplus
extern "C" {{
#endif
"""

_HEADER_CLOSING = """\
#ifdef __cplusplus
}}
#endif

#endif /* {guard} */
"""

_ENVIRONMENT = """\
#ifdef __FAST_MATH__
#error these functions need IEEE 754 arithmetic
#endif

#ifdef FLT_EVAL_METHOD
#if FLT_EVAL_METHOD != 0 && FLT_EVAL_METHOD != 16
#error these functions need every operation rounded to the type of its operands
#endif
#endif

/* gcc does not know the pragma: -ffp-contract=off is its flag */
#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif
"""
