"""Writes C99 header and source of the kernels that a model uses."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from backends.c_kernels.constant_time import ConstantTimeLowering, choice_functions
from backends.c_kernels.routine import RoutineLowering
from backends.c_language.literals import Dtype
from backends.c_language.printer import Printer, placement
from backends.c_language.tree import Convert, Expression, Function
from compiler.kernels.table import KERNELS
from compiler.kernels.tables.formats import FORMATS, Format, RealName
from compiler.kernels.trace.statements import Block, Branch, Call, Routine, without_branches
from compiler.kernels.trace.values import trace


@dataclass(frozen=True, slots=True)
class CKernels:
    """Header and source of some math kernels. `functions` maps names of kernels to their names in
    C. Exact bits require IEEE 754 arithmetic without contraction: compile with -ffp-contract=off
    and never with -ffast-math.
    """

    header_name: str
    header: str
    source_name: str
    source: str
    functions: Mapping[str, str]


def c_sources(
    names: Iterable[str], real: RealName, prefix: str, *, constant_time: bool = False
) -> CKernels:
    """Header and source with the kernels `names` as functions `<prefix>_<name>` of type `real`;
    kernels that they call are static functions. With `constant_time` they execute the same
    operations for every argument. The text does not depend on the order of `names`. Raises KeyError
    for a name not in `KERNELS`.
    """
    # sorted, so that the text does not depend on the order in the graph
    functions = {name: f"{prefix}_{name}" for name in sorted(set(names))}
    routines = callees_first(functions, FORMATS[real])
    if constant_time:
        # constant time: both arms are computed and one is selected
        routines = [without_branches(routine) for routine in routines]
    printer = KernelPrinter(prefix, dtype_of(FORMATS[real]), places_tables=True)
    lowering = ConstantTimeLowering if constant_time else RoutineLowering
    lowered = [lowering(routine, printer) for routine in routines]
    made = {x.routine.name: x.function(public=x.routine.name in functions) for x in lowered}
    choices = choice_functions({name for each in lowered for name in each.choices}, printer)
    needs_math = any(each.needs_math for each in lowered)
    header_name = f"{prefix}_math.h"
    return CKernels(
        header_name=header_name,
        header=_header([made[name] for name in functions], printer),
        source_name=f"{prefix}_math.c",
        source=_source(printer, (*choices, *made.values()), header_name, needs_math),
        functions=functions,
    )


def c_definitions(names: Iterable[str], real: RealName, prefix: str) -> str:
    """C text with the kernels `names` and those that they call as static functions
    `<prefix>_<name>` of type `real`, callees first. The file around it must include float.h,
    math.h, stdbool.h and stdint.h. Raises KeyError for a name not in `KERNELS`.
    """
    printer = KernelPrinter(prefix, dtype_of(FORMATS[real]))
    routines = callees_first(names, FORMATS[real])
    made = (RoutineLowering(routine, printer).function() for routine in routines)
    return "\n".join(map(printer.function, made))


def callees_first(names: Iterable[str], format: Format) -> list[Routine]:
    """The traced kernels with these names and all that they call, each once and after those that it
    calls. Raises KeyError for a name not in `KERNELS`.
    """
    ordered: dict[str, Routine] = {}

    def visit(routine: Routine) -> None:
        for callee in _called(routine.body):
            visit(callee)
        # after its callees; by name, so that a shared routine is defined once
        ordered.setdefault(routine.name, routine)

    for name in sorted(set(names)):
        visit(trace(KERNELS[name].subroutine, format))
    return list(ordered.values())


def _called(block: Block) -> Iterator[Routine]:
    for statement in block.statements:
        if isinstance(statement, Call):
            yield statement.routine
        elif isinstance(statement, Branch):
            yield from _called(statement.then)
            yield from _called(statement.otherwise)


def _header(functions: Iterable[Function], printer: KernelPrinter) -> str:
    guard = f"{printer.prefix.upper()}_MATH_H"
    prototypes = [f"/* {each.doc} */\n{printer.prototype(each)};\n" for each in functions]
    opening = _HEADER_OPENING.format(guard=guard)
    return "\n".join([opening, *prototypes, _HEADER_CLOSING.format(guard=guard)])


def _source(
    printer: KernelPrinter, functions: Iterable[Function], header_name: str, needs_math: bool
) -> str:
    texts = [printer.function(function) for function in functions]
    macro = f"{printer.prefix.upper()}_PLACED "
    has_tables = any(macro in text for text in texts)
    places = [f"{placement(printer.prefix)}\n", _inlined(printer.prefix)] if has_tables else []
    includes = [f'#include "{header_name}"\n', "#include <float.h>"]
    if needs_math:
        includes.append("#include <math.h>")
    includes += ["#include <stdbool.h>", "#include <stdint.h>\n"]
    return "\n".join([*includes, _ENVIRONMENT, *places, *texts])


def _inlined(prefix: str) -> str:
    return (
        "/* gcc for AVR takes a table of a function that it inlines for one without numbers */\n"
        f"#ifdef {prefix.upper()}_IN_FLASH\n"
        '#pragma GCC diagnostic ignored "-Wuninitialized"\n#endif\n'
    )


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


class KernelPrinter(Printer):
    """Prints math kernels for a file that does not include the program's header: reals are `float`
    or `double`, and long numbers are hexadecimal.
    """

    exact = True

    @property
    def real(self) -> str:
        return "float" if self.dtype == "float32" else "double"

    def operand(self, expression: Expression) -> str:
        if isinstance(expression, Convert):
            return self.expression(expression)
        return super().operand(expression)


def dtype_of(format: Format) -> Dtype:
    """The dtype of a floating-point format of kernels."""
    return "float32" if format.c_type == "float" else "float64"
