"""Writes the C source of a training kernel: prelude, math, model functions, loops."""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import wraps
from pathlib import Path
from typing import ParamSpec, TypeVar

from backends.c_kernels.sources import c_definitions
from backends.c_language.functions import FunctionNames, FunctionTable
from backends.c_language.literals import Dtype
from backends.c_language.tree import Call, Expression
from backends.files.text_templates import text_templates
from backends.native.kernel_functions import ModelFunction, ModelFunctions
from backends.native.lane_kernels import LanePrinter, lane_kernels, with_fused_products
from backends.native.lane_memory import LaneMemory, size_of
from compiler.differentiation.sensitivities import Sensitivities
from compiler.differentiation.training_step import TrainingStep
from compiler.ir.kept_results import kept_for_same
from compiler.ir.program import Parameter, Program
from compiler.ir.scalars import SCALAR_FUNCTIONS
from compiler.ir.slopes import LARGEST_SLOPE
from compiler.kernels.tables.formats import DOUBLE, FLOAT

_TEMPLATES = Path(__file__).resolve().parents[2] / "templates" / "native"
PREFIX = "msnn"


@dataclass(frozen=True, slots=True, kw_only=True)
class KernelSource:
    """The C source of a kernel, and the names of signals, parameters and losses in the order of its
    arrays.
    """

    text: str
    signals: tuple[str, ...]
    """Names of the logs that the kernel reads, in the order of `series`."""
    parameters: tuple[str, ...]
    losses: tuple[str, ...]
    has_infinite_slopes: bool = False
    """True if a gradient can be infinite where the losses are finite."""
    has_factors: bool = False
    """True if rows have factors, so that the scored count depends on the data."""
    takes_known: bool = False
    """True if its optimisers use priors and penalties."""


class LaneFunctions(FunctionTable):
    """The table of C functions that a kernel calls, in their versions on SIMD vectors. A function
    without a math kernel is in the prelude, as `lane_<name>`.
    """

    def apply(self, function: str, arguments: tuple[Expression, ...]) -> Expression:
        kernel = SCALAR_FUNCTIONS[function].kernel
        if kernel is None:
            return Call(f"lane_{function}", arguments)
        self.kernels.add(kernel)
        return Call(f"{PREFIX}_{kernel}", arguments)


def kernel_source(
    step: TrainingStep, dtype: Dtype, *, reproducible: bool = False, lbfgs: bool = False
) -> KernelSource:
    """The source of the kernel that computes losses and gradients of a training step and contains
    optimisers. A `reproducible` kernel emulates a·b + c with one rounding on processors without
    that instruction. With `lbfgs` it contains only that optimiser; other kernels omit it, since it
    takes gcc 0.08 s.
    """
    takes_known = _has_known(step.program)
    training = _training(step.program, takes_known=takes_known, lbfgs=lbfgs)
    found = _source(step, dtype, training)
    text = f"#define REPRODUCIBLE\n{found.text}" if reproducible else found.text
    return replace(found, text=text, takes_known=takes_known)


def losses_source(step: TrainingStep, dtype: Dtype) -> KernelSource:
    """The source of a kernel without optimisers, for the losses of a training step only. Optimisers
    take as long to compile as the losses of a small model.
    """
    return _source(step, dtype, ())


def _has_known(program: Program) -> bool:
    priors = any(parameter.prior is not None for parameter in program.parameters)
    return priors or any(loss.penalty is not None for loss in program.losses)


def _training(program: Program, *, takes_known: bool, lbfgs: bool) -> tuple[str, ...]:
    """The C texts of the optimisers. Code for bounds and for priors is included only if the program
    has such, as each takes gcc an eighth of its time for a small model.
    """
    bounded = any(p.minimum is not None or p.maximum is not None for p in program.parameters)
    # the mapping from raw to bounded physical values is always in double precision
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
    """Joins prelude, math kernels, `tables`, the model's functions `made` (by name) and the texts
    `loops` to one C source.
    """
    printer = LanePrinter(PREFIX, dtype)
    losses = memory.step.losses
    parts = [
        # macros first: the prelude chooses the types of lanes by them
        f"#define MSNN_DOUBLE {int(dtype == 'float64')}",
        f"#define PARAMETERS {memory.parameter_count}",
        f"#define LOSSES {len(losses)}",
        _text("prelude.c"),
        # after lowering the model's functions, which collects the kernels that they call
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
    """A C array over time for one vector of rollouts, with `elements` values per row."""

    name: str
    elements: int
    extra: int
    """Rows in addition to the steps: for a state, the initial ones."""
    first: int = 0
    """The sample of its first row, relative to the first step."""


def forward_arrays(memory: LaneMemory) -> dict[str, list[ArrayRows]]:
    """Variables of the templates of loops: the arrays over time of logs, of states and of stored
    nodes (`rows`), each as a list.
    """
    return {
        "logs": [
            # a log has rows before the first step for the past and after the last for previews
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
    """The C text of a template of loops. `made` are the model's functions by name: the template
    calls them with `<name>_arguments`. `values` are its other variables.
    """
    arguments = {f"{name}_arguments": ", ".join(one.values) for name, one in made.items()}
    loops = text_templates("native", strips=True).get_template(template)
    # the parts of a kernel are joined by line ends
    return loops.render(**values, **arguments).removesuffix("\n")


P = ParamSpec("P")
Source = TypeVar("Source")

_KEPT = 16
"""Number of sources, some hundred kB each: training, standard errors and metrics need six."""


def kept_source(write: Callable[P, Source]) -> Callable[P, Source]:
    """Decorator: caches the latest 16 results of a function that writes a source. The key is the
    text of the arguments, as equality would confuse 0.0 with -0.0. It omits facts that do not
    affect the source, so programs that differ only in initial parameters share one.
    """
    found: OrderedDict[bytes, Source] = OrderedDict()

    @wraps(write)
    def written(*args: P.args, **kwargs: P.kwargs) -> Source:
        said = repr((*map(_argument_text, args), sorted(kwargs.items())))
        key = hashlib.sha256(said.encode()).digest()
        source = found.pop(key, None)
        if source is None:
            source = write(*args, **kwargs)
        # moved to the end: the oldest use is evicted first
        found[key] = source
        if len(found) > _KEPT:
            found.popitem(last=False)
        return source

    return written


@kept_for_same(_KEPT)
def _argument_text(value: object) -> str:
    return repr(_said(value))


def _said(value: object) -> object:
    """An argument of a cached function without the parts that do not affect the source: spec hash
    and initial values of some parameters.
    """
    if isinstance(value, Program):
        return replace(value, parameters=tuple(map(_any_value, value.parameters)), spec_hash="")
    if isinstance(value, Sensitivities):
        return replace(value, program=_said(value.program))
    return value


def _any_value(parameter: Parameter) -> Parameter:
    """The parameter without its initial value, if it is learned and bounded. Other initial values
    affect the analysis of derivatives and stay.
    """
    bounded = parameter.minimum is not None or parameter.maximum is not None
    return replace(parameter, initial=()) if parameter.learn and bounded else parameter
