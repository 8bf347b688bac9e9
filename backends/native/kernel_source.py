"""Writes the C source of a training kernel: prelude, math, the model's functions, the loops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from backends.c_kernels.sources import c_definitions
from backends.c_language.functions import FunctionNames, FunctionTable
from backends.c_language.literals import Dtype
from backends.c_language.tree import Call, Expression
from backends.files.text_templates import text_templates
from backends.native.kernel_functions import ModelFunction, ModelFunctions
from backends.native.lanes.fused_products import with_fused_products
from backends.native.lanes.lane_kernels import lane_kernels
from backends.native.lanes.lane_memory import LaneMemory, size_of
from backends.native.lanes.lane_printer import LanePrinter
from compiler.differentiation.training_step import TrainingStep
from compiler.ir.program import Program
from compiler.ir.scalars.slope_products import LARGEST_SLOPE
from compiler.ir.scalars.table import SCALAR_FUNCTIONS
from compiler.kernels.tables.formats import DOUBLE, FLOAT

_TEMPLATES = Path(__file__).resolve().parents[2] / "templates" / "native"
PREFIX = "msnn"


@dataclass(frozen=True, slots=True, kw_only=True)
class KernelSource:
    """C text, and the order in which its arrays of signals and parameters stand."""

    text: str
    signals: tuple[str, ...]
    """Names of the logs that the kernel gathers from, in the order of `series`."""
    parameters: tuple[str, ...]
    losses: tuple[str, ...]
    has_infinite_slopes: bool = False
    """Whether a gradient can be infinite where the losses are finite."""
    has_factors: bool = False
    """Whether rows have factors, so that only the data tells how much is scored."""
    takes_known: bool = False
    """Whether its optimisers heed priors and penalties."""


class LaneFunctions(FunctionTable):
    """Calls of lane versions; the prelude defines those that are no kernels."""

    def apply(self, function: str, arguments: tuple[Expression, ...]) -> Expression:
        kernel = SCALAR_FUNCTIONS[function].kernel
        if kernel is None:
            return Call(f"lane_{function}", arguments)
        self.kernels.add(kernel)
        return Call(f"{PREFIX}_{kernel}", arguments)


def kernel_source(
    step: TrainingStep, dtype: Dtype, *, reproducible: bool = False, lbfgs: bool = False
) -> KernelSource:
    """The kernel of one program whose loops are closed.

    A `reproducible` one fuses by many instructions where a processor has none for it. One with
    `lbfgs` has that optimiser alone, others do without it: it takes gcc 0.08 s.
    """
    takes_known = _has_known(step.program)
    training = _training(step.program, takes_known=takes_known, lbfgs=lbfgs)
    found = _source(step, dtype, training)
    text = f"#define REPRODUCIBLE\n{found.text}" if reproducible else found.text
    return replace(found, text=text, takes_known=takes_known)


def losses_source(step: TrainingStep, dtype: Dtype) -> KernelSource:
    """The same without optimisers, which take a compiler as long as the losses of a small model."""
    return _source(step, dtype, ())


def _has_known(program: Program) -> bool:
    priors = any(parameter.prior is not None for parameter in program.parameters)
    return priors or any(loss.penalty is not None for loss in program.losses)


def _training(program: Program, *, takes_known: bool, lbfgs: bool) -> tuple[str, ...]:
    """The optimisers, with bounds and what is known of parameters only where a program has such.

    Both take gcc an eighth of its time for a small model.
    """
    bounded = any(p.minimum is not None or p.maximum is not None for p in program.parameters)
    # optimisers move raw variables, which bounds map to physical values, in double precision always
    bounds = c_definitions(("sigmoid", "softplus"), "double", "double") if bounded else ""
    has = {"BOUNDED": bounded, "KNOWN": takes_known, "LBFGS": lbfgs}
    said = "\n".join(f"#define {name} {int(value)}" for name, value in has.items())
    known = ("known.c",) if takes_known else ()
    steps = ("line_search.c", "lbfgs.c") if lbfgs else ("optimizers.c",)
    files = ("variables.c", *known, "raw_slopes.c", *steps, "training.c")
    return said, bounds, *map(_text, files)


def _source(step: TrainingStep, dtype: Dtype, training: Sequence[str]) -> KernelSource:
    memory = LaneMemory(step)
    functions = LaneFunctions(FunctionNames(PREFIX, dtype, "own"))
    writer = ModelFunctions(memory, functions)
    made = {
        "start": writer.start(),
        "ahead": writer.ahead(),
        "step": writer.step(),
        "reverse_step": writer.reverse_step(),
        "after": writer.after(),
        "reverse_start": writer.reverse_start(),
    }
    losses = step.losses
    # C has no empty arrays
    numbers = ", ".join(str(term.elements) for term in losses) or "0"
    roots = ", ".join(str(int(term.is_root)) for term in losses) or "0"
    tables = [
        f"#define INFINITE_SLOPES {int(step.has_infinite_slopes)}",
        f"#define LARGEST_SLOPE {LARGEST_SLOPE:g}",
        f"#define HAS_ROOT {int(any(term.is_root for term in losses))}",
        f"static const double ELEMENTS[] = {{{numbers}}};",
        f"static const int IS_ROOT[] = {{{roots}}};",
    ]
    late_adjoints = [
        ArrayRows(tape.name, tape.elements, tape.last) for tape in memory.late_adjoints.values()
    ]
    group = rendered("group.c.j2", made, **forward_arrays(memory), late_adjoints=late_adjoints)
    batches = map(_text, ("threads.c", "batches.c", "epochs.c"))
    return whole_source(memory, dtype, functions, made, tables, (group, *batches, *training))


def whole_source(
    memory: LaneMemory,
    dtype: Dtype,
    functions: LaneFunctions,
    made: Mapping[str, ModelFunction],
    tables: Sequence[str],
    loops: Sequence[str],
) -> KernelSource:
    """Prelude, math, tables, the model's functions and the loops around them as one text."""
    printer = LanePrinter(PREFIX, dtype)
    losses = memory.step.losses
    parts = [
        # macros first: the prelude chooses the types of lanes by them
        f"#define MSNN_DOUBLE {int(dtype == 'float64')}",
        f"#define PARAMETERS {memory.parameter_count}",
        f"#define LOSSES {len(losses)}",
        _text("prelude.c"),
        # after the model's functions are lowered: only then it is known which kernels they call
        lane_kernels(functions.kernels, DOUBLE if dtype == "float64" else FLOAT, PREFIX),
        *tables,
        *(printer.function(with_fused_products(one.function)) for one in made.values()),
        _text("driver.c"),
        *loops,
    ]
    return KernelSource(
        text="\n".join(parts),
        signals=tuple(memory.signals),
        parameters=tuple(memory.parameters),
        losses=tuple(term.loss.name for term in losses),
        has_infinite_slopes=memory.step.has_infinite_slopes,
        has_factors=any(term.loss.rows is not None for term in losses),
    )


def _text(name: str) -> str:
    return (_TEMPLATES / name).read_text(encoding="utf-8")


# ---- the loops around them


@dataclass(frozen=True, slots=True)
class ArrayRows:
    """One array over the time of a group."""

    name: str
    elements: int
    extra: int
    """Rows more than steps: of a state, those that the next step begins with."""
    first: int = 0
    """The sample of its first row, counted from the first step."""


def forward_arrays(memory: LaneMemory) -> dict[str, list[ArrayRows]]:
    """The arrays over time that the functions of the step forward work on."""
    return {
        "logs": [
            # a log has rows before the first step for its past and behind the last for what lies
            # ahead
            ArrayRows(tape.name, tape.elements, tape.last - tape.first, tape.first)
            for tape in memory.signals.values()
        ],
        "states": [
            *(ArrayRows(tape.name, tape.elements, tape.last) for tape in memory.buffers.values()),
            *(ArrayRows(name, size_of(state.axes), 1) for name, state in memory.plain.values()),
        ],
        "rows": [ArrayRows(tape.name, tape.elements, 0) for tape in memory.rows.values()],
    }


def rendered(template: str, made: Mapping[str, ModelFunction], **values: object) -> str:
    """The loops of a template around the model's functions, called with their arguments."""
    arguments = {f"{name}_arguments": ", ".join(one.values) for name, one in made.items()}
    loops = text_templates("native", strips=True).get_template(template)
    # the parts of a kernel are joined by line ends
    return loops.render(**values, **arguments).removesuffix("\n")
