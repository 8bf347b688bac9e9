"""The whole C source of a training kernel: prelude, math, the model's functions, the loops."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from backends.c.c_language import Argument, Call, Expression, Function, Real
from backends.c.c_literals import Dtype
from backends.c.functions import FunctionNames, FunctionTable
from backends.c.lowering import GraphLowering
from backends.c.places import Index
from backends.native.lane_functions import GRADIENT, PARAMETERS, LaneWriter, array
from backends.native.lane_kernels import lane_kernels
from backends.native.lane_memory import Memory, size_of
from backends.native.lane_printer import LanePrinter
from compiler.differentiate import StepGradients
from compiler.kernels.formats import DOUBLE, FLOAT
from compiler.scalar_functions import SCALAR_FUNCTIONS
from compiler.training_step import SCALE, TrainingStep

_TEMPLATES = Path(__file__).resolve().parents[2] / "templates" / "native"
_PREFIX = "msnn"


@dataclass(frozen=True, slots=True)
class KernelSource:
    """C text, and the order in which its arrays of signals and parameters stand."""

    text: str
    signals: tuple[str, ...]
    """Names of the logs that the kernel gathers from, in the order of `series`."""
    parameters: tuple[str, ...]
    losses: tuple[str, ...]


class _LaneFunctions(FunctionTable):
    """Calls of lane versions; the prelude defines those that are no kernels."""

    def apply(self, function: str, arguments: tuple[Expression, ...]) -> Expression:
        kernel = SCALAR_FUNCTIONS[function].kernel
        if kernel is None:
            return Call(f"lane_{function}", arguments)
        self.kernels.add(kernel)
        return Call(f"{_PREFIX}_{kernel}", arguments)


def kernel_source(step: TrainingStep, dtype: Dtype) -> KernelSource:
    """The kernel of one program whose loops are closed."""
    memory = Memory(step)
    functions = _LaneFunctions(FunctionNames(_PREFIX, dtype, "own"))
    printer = LanePrinter(_PREFIX, dtype)
    made = (
        _start(memory, functions),
        _step(memory, functions),
        _reverse_step(memory, functions),
        _reverse_start(memory, functions),
    )
    format = DOUBLE if dtype == "float64" else FLOAT
    losses = step.losses
    constants = [
        f"#define MSNN_DOUBLE {int(dtype == 'float64')}",
        f"#define PARAMETERS {memory.parameter_count}",
        f"#define LOSSES {len(losses)}",
        f"#define HAS_ROOT {int(any(term.is_root for term in losses))}",
    ]
    numbers = ", ".join(str(term.elements) for term in losses) or "0"
    roots = ", ".join(str(int(term.is_root)) for term in losses) or "0"
    tables = [
        f"static const double ELEMENTS[] = {{{numbers}}};",
        f"static const int IS_ROOT[] = {{{roots}}};",
    ]
    parts = [
        *constants,
        _text("prelude.c"),
        lane_kernels(functions.kernels, format, _PREFIX),
        *tables,
        *(printer.function(function) for function in made),
        _text("driver.c"),
        _group(memory),
        _text("batches.c"),
    ]
    return KernelSource(
        "\n".join(parts),
        tuple(memory.signals),
        tuple(memory.parameters),
        tuple(term.loss.name for term in losses),
    )


def _text(name: str) -> str:
    return (_TEMPLATES / name).read_text(encoding="utf-8")


# ---- the functions of the model


@dataclass(frozen=True, slots=True)
class _Passed:
    """An argument of one of the model's functions, and what is passed for it at time t."""

    argument: Argument
    value: str


def _common(memory: Memory, at: str) -> list[_Passed]:
    """Parameters, logs, tapes and states; `at` is the time, empty for t0."""

    def row(name: str, size: int) -> str:
        return f"{name} + {at} * {size}" if at else name

    found = [_Passed(Argument("const lanes *restrict", PARAMETERS), PARAMETERS)]
    for tape in memory.signals.values():
        found.append(_Passed(Argument("const lanes *", tape.name), row(tape.name, tape.elements)))
    for tape in memory.buffers.values():
        found.append(_Passed(Argument("lanes *", tape.name), row(tape.name, tape.elements)))
    for name, state in memory.plain.values():
        found.append(_Passed(Argument("lanes *", name), row(name, size_of(state.axes))))
    return found


def _step_arguments(memory: Memory) -> list[_Passed]:
    found = _common(memory, "t")
    for name, state in memory.plain.values():
        next_row = f"{name} + (t + 1) * {size_of(state.axes)}"
        found.append(_Passed(Argument("lanes *", f"next_{name}"), next_row))
    found += [_Passed(Argument("lanes *restrict", name), name) for name in ("total", "count")]
    return found


def _reverse_arguments(memory: Memory, at: str, after: str) -> list[_Passed]:
    """As `_common`, and the adjoints: of tapes at t, of plain states at t and at t+1."""
    found = _common(memory, at)
    for tape in memory.buffers.values():
        name = f"d_{tape.name}"
        value = f"{name} + {at} * {tape.elements}" if at else name
        found.append(_Passed(Argument("lanes *restrict", name), value))
    for name, state in memory.plain.values():
        size = size_of(state.axes)
        following = f"d_{name} + {after} * {size}" if after else f"d_{name}"
        found.append(_Passed(Argument("lanes *restrict", f"d_next_{name}"), following))
        if after:
            row = f"d_{name} + {at} * {size}"
            found.append(_Passed(Argument("lanes *restrict", f"d_{name}"), row))
    found.append(_Passed(Argument("lanes *restrict", GRADIENT), GRADIENT))
    return found


def _reverse_step_arguments(memory: Memory) -> list[_Passed]:
    scale = _Passed(Argument("const lanes *restrict", "scale"), "scale")
    return [*_reverse_arguments(memory, "t", "(t + 1)"), scale]


def _start(memory: Memory, functions: FunctionTable) -> Function:
    writer = LaneWriter(memory, memory.program.start, functions)
    lowered = writer.lowered(*(state.start for state in memory.program.states))
    for state in memory.program.states:
        lowered.store(state.start, writer.state_place(state))
    return writer.function(
        "kernel_start", [p.argument for p in _common(memory, "")], "States at t0."
    )


def _step(memory: Memory, functions: FunctionTable) -> Function:
    step = memory.step
    writer = LaneWriter(memory, step.program.step, functions)
    results = [
        (step.newest[state.name], memory.newest_row(state))
        if state.name in step.newest
        else (state.next, array(f"next_{memory.plain[state.name][0]}", writer.shape(state)))
        for state in step.program.states
    ]
    terms = [(term.total, index, "total") for index, term in enumerate(step.losses)]
    terms += [
        (term.count, index, "count")
        for index, term in enumerate(step.losses)
        if term.count is not None
    ]
    lowered = writer.lowered(*(node for node, _ in results), *(node for node, _, _ in terms))
    for node, place in results:
        lowered.store(node, place)
    for node, index, name in terms:
        lowered.store(node, array(name, (), Index(index)))
    for index, term in enumerate(step.losses):
        if term.count is None:
            target = array("count", (), Index(index)).element(())
            writer.scope.assign(target, Real(float(term.elements)))
    arguments = [p.argument for p in _step_arguments(memory)]
    return writer.function("kernel_step", arguments, "One step forward: states at t+1, loss terms.")


def _reverse_step(memory: Memory, functions: FunctionTable) -> Function:
    reverse = memory.step.reverse_step
    writer = LaneWriter(memory, reverse.graph, functions)
    found = reverse.gradients
    lowered = writer.lowered(*found.states.values(), *found.parameters.values())
    for state in memory.program.states:
        gradient = found.states.get(state.name)
        if state.name in memory.buffers:
            if gradient is not None:
                writer.add_to(lowered, gradient, memory.adjoint_rows(state))
        else:
            place = array(f"d_{memory.plain[state.name][0]}", writer.shape(state))
            if gradient is not None:
                lowered.store(gradient, place)
    _add_parameters(memory, writer, lowered, found)
    arguments = [p.argument for p in _reverse_step_arguments(memory)]
    return writer.function("kernel_reverse_step", arguments, "Adjoints at t from those at t+1.")


def _reverse_start(memory: Memory, functions: FunctionTable) -> Function:
    reverse = memory.step.reverse_start
    writer = LaneWriter(memory, reverse.graph, functions)
    lowered = writer.lowered(*reverse.gradients.parameters.values())
    _add_parameters(memory, writer, lowered, reverse.gradients)
    arguments = [p.argument for p in _reverse_arguments(memory, "", "")]
    return writer.function("kernel_reverse_start", arguments, "What the states at t0 owe to.")


def _add_parameters(
    memory: Memory, writer: LaneWriter, lowered: GraphLowering, gradients: StepGradients
) -> None:
    for name, node in gradients.parameters.items():
        if not name.startswith(SCALE):
            shape = tuple(axis.size for axis in memory.program.parameter(name).axes)
            place = array(GRADIENT, shape, Index(memory.parameters[name]))
            writer.add_to(lowered, node, place)


# ---- the loops around them


def _group(memory: Memory) -> str:
    arrays: list[dict[str, Any]] = []
    for index, tape in enumerate(memory.signals.values()):
        extra = tape.last - tape.first
        arrays.append(
            {"name": tape.name, "elements": tape.elements, "extra": extra, "adjoint": False}
            | {"signal": index, "first": tape.first}
        )
    for tape in memory.buffers.values():
        arrays.append(
            {"name": tape.name, "elements": tape.elements, "extra": tape.last, "adjoint": True}
            | {"signal": None}
        )
    for name, state in memory.plain.values():
        arrays.append(
            {"name": name, "elements": size_of(state.axes), "extra": 1, "adjoint": True}
            | {"signal": None}
        )
    environment = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=False,  # noqa: S701  (C, not HTML; every name is an identifier made here)
    )

    def values(passed: list[_Passed]) -> str:
        return ", ".join(p.value for p in passed)

    return environment.get_template("group.c.j2").render(
        arrays=arrays,
        start_arguments=values(_common(memory, "")),
        step_arguments=values(_step_arguments(memory)),
        reverse_step_arguments=values(_reverse_step_arguments(memory)),
        reverse_start_arguments=values(_reverse_arguments(memory, "", "")),
    )
