"""Compiles a spec to a program: links its sub-models, lowers every entry, reports all mistakes,
runs the passes.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Generator, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import field, replace
from functools import partial
from math import isclose
from typing import TypeVar

from compiler.elaboration.losses import checked_penalties
from compiler.elaboration.lower_spec import exported_equations, lower_spec
from compiler.elaboration.section import OtherProgram, SectionProblem, problem_of_class, section_of
from compiler.interpreter.operations import never_finite
from compiler.ir import ops
from compiler.ir.program import (
    Dimension,
    Formula,
    Graph,
    Node,
    NodeId,
    Program,
    Role,
    Signal,
    State,
    UsedPlugin,
)
from compiler.ir.types import Type
from compiler.linking.link import Linked, WeightsByPart, link
from compiler.lowering.constants import number
from compiler.lowering.context import Context, owner_of
from compiler.lowering.environment import START, STEP
from compiler.passes import run_passes
from compiler.passes.analyses.infinite_slopes import infinite_slopes
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError
from spec_schema.diagnostics.source import Span
from spec_schema.errors import units
from spec_schema.expressions.tree import Expression, Member, Name, Window, expression_text
from spec_schema.fields.leaf import Located
from spec_schema.late_dataclass import dataclass
from spec_schema.plugins import known_plugins, plugins_with
from spec_schema.reading.reader import ReadResult, all_specs
from spec_schema.sections.signals import Signal as SignalEntry
from spec_schema.sections.spec import Spec
from spec_schema.sections.values import Constant
from spec_schema.units.quantity import Quantity, report_unconverted
from spec_schema.units.unit import ONE, Unit

P = TypeVar("P", bound=SectionProblem)

UNIT_WARNINGS = ("W0504", "W0505", "W0509", "W0510", "W0737")
"""Warnings that become errors with `strict_units`."""


@dataclass(frozen=True, kw_only=True)
class Compiled:
    """The result of a compilation: the program of a spec, the warnings, and the compiled sections
    of features.
    """

    program: Program
    spec: Spec
    """The linked spec: entries of sub-models have their full names."""
    warnings: tuple[Diagnostic, ...]
    problems: Mapping[str, SectionProblem] = field(default_factory=dict[str, SectionProblem])
    """The compiled sections of features, such as `mpc`, by their keys; `of` selects one by
    class."""
    types: Mapping[str, Type] = field(default_factory=dict[str, Type])
    """Type of one sample of each equation and output, before passes merge or remove values."""

    def of(self, kind: type[P]) -> P | None:
        """The compiled section of the class `kind`, such as the optimal control problem of `mpc`;
        None if the spec has no such section.
        """
        return problem_of_class(self.problems, kind)


def compile_spec(
    spec: Spec,
    *,
    used: Mapping[str, ReadResult] | None = None,
    weights: WeightsByPart | None = None,
    numbers: Mapping[str, str] | None = None,
    strict_units: bool = False,
    spec_hash: str = "",
    draw: int = 0,
) -> Compiled:
    """Compiles a spec to a program in window form.

    `used` has the parsed files of sub-models and `weights` the arrays of those with `weights:`, by
    full name. A sub-model without them has its initial values. `numbers` maps paths of files of
    initial values to their contents; other files are read from disk. `draw` selects other random
    initial values, and `spec_hash` is stored in the program.

    Raises SpecError with every mistake found; with `strict_units` also for units that do not fit.
    """
    problems = Findings()
    try:
        linked = replace(link(spec, used or {}, weights or {}, problems), numbers=numbers or {})
        # before lowering: names that a broken link lacks would be reported as unknown
        problems.raise_errors()
        compile_it = partial(compile_linked, strict_units=strict_units, draw=draw)
        compiled = compile_it(linked, spec_hash=spec_hash)
        if known_plugins():
            plugins = {*compiled.program.plugins, *_used_plugins(spec, used or {})}
            plugins = tuple(sorted(plugins, key=lambda plugin: plugin.package))
            compiled = replace(compiled, program=replace(compiled.program, plugins=plugins))
        return _with_problems(linked, compiled, compile_it)
    except SpecError as error:
        raise SpecError(in_own_files(error.diagnostics, spec, used or {}, numbers)) from None


def compile_linked(
    linked: Linked, *, strict_units: bool = False, spec_hash: str = "", draw: int = 0
) -> Compiled:
    """Compiles a spec whose sub-models are already linked to one spec with full names. The other
    arguments are those of `compile_spec`. Raises SpecError with every mistake found.
    """
    spec = linked.spec
    # lowering recurses from a value into its operands: a chain of n equations is n calls deep
    with room_for(len(spec.equations) + len(spec.outputs)):
        lowered = lower_spec(linked, draw)
    elaborated, context = lowered.elaborated, lowered.elaborated.context
    report_unchecked_scales(context, lowered.states)
    refused = [d for d in context.findings.in_order if d.code in UNIT_WARNINGS]
    if strict_units and refused:
        context.findings.report(units.strict_units(len(refused)))
    parameters = elaborated.arrays.parameters
    losses = checked_penalties(lowered.losses, parameters, context.findings)
    diagnostics = context.findings.in_order
    if any(d.severity == "error" for d in diagnostics):
        raise SpecError(diagnostics)
    # a value that failed without a diagnostic would silently be missing
    wanted = {*spec.outputs, *exported_equations(spec)}
    assert {output.name for output in lowered.outputs} == wanted, "an output was lost"
    assert {state.name for state in lowered.states} >= spec.states.keys(), "a state was lost"
    for name in measured_targets(spec) & spec.states.keys():
        context.measured.setdefault(name, spec.states[name])
    program = Program(
        name=spec.name.value,
        sample_time=context.sampling.sample_time,
        signals=logged_signals(context, lowered.ranges),
        parameters=parameters,
        states=tuple(lowered.states),
        step=context.builder(STEP).graph(),
        start=context.builder(START).graph(),
        outputs=tuple(lowered.outputs),
        losses=tuple(losses),
        expected=tuple(lowered.expected),
        fits=tuple(elaborated.layers.fits.values()),
        dimensions=tuple(Dimension(n, d.size, d.labels) for n, d in spec.dims.items()),
        formulas=formulas_of(spec),
        plugins=_plugins_of({("function", name) for name in context.plugin_functions}),
        doc=spec.doc or "",
        spec_hash=spec_hash,
    )
    logged = program.signals
    program = run_passes(program)
    # passes remove signals that no value reads, but metrics need their targets
    kept = {signal.name for signal in program.signals} | measured_targets(spec)
    program = replace(program, signals=tuple(each for each in logged if each.name in kept))
    found = (*never_finite(program), *infinite_slopes(program))
    # types of the lowered entries: passes have merged and removed nodes of the program
    types = elaborated.entries.types()
    return Compiled(program=program, spec=spec, warnings=(*diagnostics, *found), types=types)


def _with_problems(
    linked: Linked, compiled: Compiled, compile_it: Callable[[Linked], Compiled]
) -> Compiled:
    """`compiled` with the compiled sections of features and their warnings. `compile_it` compiles
    other linked specs that a section needs.
    """

    def compile_other(other: Linked) -> OtherProgram:
        whole = compile_it(other)
        more = tuple(found for found in whole.warnings if found not in compiled.warnings)
        # all programs of a file have the hash of the file
        same = compiled.program
        program = replace(whole.program, spec_hash=same.spec_hash, plugins=same.plugins)
        return OtherProgram(program, more)

    problems: dict[str, SectionProblem] = {}
    warnings = list(compiled.warnings)
    for line, entry in linked.spec.sections():
        found = section_of(line).compile(entry, linked, compiled.program, compile_other)
        problems[line.key] = found.problem
        warnings += found.warnings
    return replace(compiled, problems=problems, warnings=tuple(warnings))


def _used_plugins(spec: Spec, used: Mapping[str, ReadResult]) -> Iterable[UsedPlugin]:
    """The plug-ins that bring sections, targets or layers of the spec or of its sub-models `used`;
    without them these cannot be read.
    """
    names: set[tuple[str, str]] = set()
    for each in (spec, *all_specs(used)):
        names |= {("section", line.key) for line, _ in each.sections()}
        names |= {("target", name) for name in (() if each.export is None else each.export.asked)}
        names |= {("layer", layer.kind) for layer in each.layers.values()}
    return _plugins_of(names)


def _plugins_of(names: Collection[tuple[str, str]]) -> tuple[UsedPlugin, ...]:
    return tuple(UsedPlugin(each.package, each.version) for each in plugins_with(names))


def in_own_files(
    diagnostics: Iterable[Diagnostic],
    spec: Spec,
    used: Mapping[str, ReadResult],
    numbers: Mapping[str, str] | None = None,
) -> tuple[Diagnostic, ...]:
    """Replaces diagnostics that point into a sub-model's file by those of compiling that file
    alone.

    These use the names of that file instead of full names; a note shows where `spec` uses the
    sub-model. `used` has the parsed files of sub-models by name, `numbers` the contents of files of
    initial values by path.
    """
    broken: dict[str, tuple[Diagnostic, ...]] = {}
    for name, file in used.items():
        path = file.source.path
        # a file used under two names is compiled and reported once
        if path in broken:
            continue
        try:
            # compiled alone, its diagnostics use names without the prefix of the sub-model
            compile_spec(file.spec, used=file.used, numbers=numbers)
        except SpecError as error:
            place, label = spec.use[name].file.span, f"used here as `{name}`"
            broken[path] = tuple(d.seen_from(place, label) for d in error.diagnostics)
    read = [file for file in used.values() if file.source.path in broken]
    files = {source.path for file in read for source in file.sources}
    # diagnostics of a broken file are not repeated under full names
    others = (d for d in diagnostics if d.span is None or d.span.file not in files)
    return (*(d for found in broken.values() for d in found), *others)


def logged_signals(
    context: Context, ranges: Mapping[str, tuple[float, float]]
) -> tuple[Signal, ...]:
    """The signals of the program: the inputs and targets of the spec, and as targets the states
    whose logs are read. `ranges` has their declared ranges.
    """
    declared = [
        *((Role.INPUT, name, entry) for name, entry in context.spec.inputs.items()),
        *((Role.TARGET, name, entry) for name, entry in _targets(context)),
        *((Role.TARGET, name, entry) for name, entry in context.measured.items()),
    ]
    return tuple(
        Signal(
            name=name,
            role=role,
            axes=context.axes_of(entry),
            unit=entry.unit.value if entry.unit else None,
            range=ranges.get(name),
            on_invalid=entry.on_invalid if isinstance(entry, SignalEntry) else "flag",
            doc=entry.doc or "",
            span=entry.place.key,
        )
        for role, name, entry in declared
    )


def measured_targets(spec: Spec) -> set[str]:
    """The names of the signals that `validate` entries give as `target:`: inputs, targets or states
    whose logs are read.
    """
    names: set[str] = set()
    for check in spec.checks:
        operand = check.target.operand if isinstance(check.target, Window) else check.target
        match operand:
            case Name(name=name):
                names.add(name)
            case Member(base=base, name=name):
                # an entry of a sub-model, or `x.meas`, the log of a state
                names |= {f"{base}.{name}", base}
            case _:
                pass
    return names


def _targets(context: Context) -> list[tuple[str, SignalEntry]]:
    """The entries of `targets:` by name; those of sub-models only if something reads them (R11)."""
    return [
        (name, entry)
        for name, entry in context.spec.targets.items()
        if not owner_of(name) or name in context.used
    ]


def formulas_of(spec: Spec) -> tuple[Formula, ...]:
    """The formulas, as text, of all states, equations and outputs of a linked spec, in
    its order.
    """
    written: list[tuple[str, Expression]] = []
    for name, state in spec.states.items():
        if state.der is not None:
            written.append((f"der({name})", state.der))
        if state.next is not None:
            written.append((f"next({name})", state.next))
    for section in (spec.equations, spec.outputs):
        written += [(name, entry.expr) for name, entry in section.items()]
    return tuple(Formula(left, expression_text(right), right.span) for left, right in written)


_FRAMES_PER_ENTRY = 400
"""Maximum number of Python frames between an entry and an entry that its expression names."""

_OTHER_FRAMES = 10_000
"""Frames for the surrounding code."""


@contextmanager
def room_for(entries: int) -> Generator[None]:
    """A context manager that raises Python's recursion limit for a chain of `entries` equations,
    each of which reads the next.

    Python frames are on the heap, a few hundred bytes each, and the size of a spec is limited.
    """
    before = sys.getrecursionlimit()
    sys.setrecursionlimit(max(before, _OTHER_FRAMES + _FRAMES_PER_ENTRY * entries))
    try:
        yield
    finally:
        sys.setrecursionlimit(before)


_WHY_UNCHECKED = "it meets a value without unit, and formulas convert nothing"


def report_unchecked_scales(context: Context, states: Iterable[State]) -> None:
    """Reports quantities with a scaled unit (`300 uH`) that a formula combines with values of
    unknown unit.

    There the unit check cannot find a wrong scale. `{init: 300, unit: uH}` states the 300
    explicitly, so it is not reported. A state of unknown unit accepts any unit.
    """
    written = _scaled_quantities(context)
    # most specs have none
    if not written:
        return
    reported: set[str] = set()
    unknown = [state for state in states if state.unit is None]
    for environment, ends in (
        (STEP, {state.next for state in unknown}),
        (START, {state.start for state in unknown}),
    ):
        graph = context.builder(environment).graph()
        carried = _unchecked_by_node(graph, written)
        for index, node in graph:
            names = carried[index] if index in ends else frozenset[str]()
            if _meets_unknown(context, graph, node):
                names |= {name for arg in node.args for name in carried[arg]}
            for name in sorted(names - reported):
                place = () if node.span is None else ((node.span, "here"),)
                report_unconverted(written[name], _WHY_UNCHECKED, context.findings, place)
            reported |= names


def _scaled_quantities(context: Context) -> dict[str, Quantity]:
    """The parameters and constants, by name, whose value is written as a number with a scaled unit,
    such as `300 uH`. Raises LoweringFailed after reporting a value that is no scalar.
    """
    found: dict[str, Quantity] = {}
    for name, entry in {**context.spec.parameters, **context.spec.constants}.items():
        value = entry.value if isinstance(entry, Constant) else entry.init.choice
        if entry.unit is None or not isinstance(value, Expression):
            continue
        if entry.unit.value.scale == 1.0 and not entry.unit.value.is_level:
            continue
        if _stands_behind(entry.unit, value.span):
            amount = number(context, value, f"`{name}`")
            # `3600 s/h` equals 1: it is a conversion factor
            unit = entry.unit.value
            is_ratio = len(unit.factors) > 1 and unit.same_dimension(ONE)
            if not (is_ratio and isclose(unit.in_si(amount), 1.0)):
                found[name] = Quantity(amount, unit, value.span.to(entry.unit.span))
    return found


def _stands_behind(unit: Located[Unit], value: Span) -> bool:
    """True if the unit is written after the number, as in `300 uH`, and not as a key `unit: uH`.
    `value` is the place of the number.
    """
    key, first, last = (
        (span.line, span.column) for span in (unit.key or unit.span, value, unit.span)
    )
    return unit.span.file == value.file and key < first < last


def _unchecked_by_node(graph: Graph, written: Mapping[str, Quantity]) -> list[frozenset[str]]:
    """For each node, the names of the quantities in `written` on which its value depends while its
    unit is scaled.

    A sum with another value of known unit, such as `max(level, 0.1 cm)`, confirms the scale.
    """
    found: list[frozenset[str]] = []
    for _, node in graph:
        unit, of_args = node.type.unit, [found[arg] for arg in node.args]
        match node.op:
            case ops.ReadParameter(name=name) | ops.Constant(name=name) if name in written:
                names = frozenset([name])
            case _ if unit is None or (isclose(unit.scale, 1.0) and not unit.is_level):
                names = frozenset[str]()
            case ops.Add() | ops.Subtract() | ops.Minimum() | ops.Maximum() | ops.Clamp() if any(
                not names and graph[arg].type.unit is not None and not _is_zero(graph, arg)
                for arg, names in zip(node.args, of_args, strict=True)
            ):
                names = frozenset[str]()
            case _:
                names = frozenset[str]().union(*of_args)
        found.append(names)
    return found


def _meets_unknown(context: Context, graph: Graph, node: Node) -> bool:
    """True if the node has several operands, and one of them has an unknown unit.

    Learned weights of a layer fit any scale and do not count, nor does 0.
    """
    for arg in node.args if len(node.args) > 1 else ():
        operand = graph[graph.unrepeated(arg)]
        is_weight = isinstance(operand.op, ops.ReadParameter) and (
            operand.op.name not in context.spec.parameters
        )
        if operand.type.unit is None and not is_weight and not _is_zero(graph, arg):
            return True
    return False


def _is_zero(graph: Graph, value: NodeId) -> bool:
    op = graph[graph.unrepeated(value)].op
    return isinstance(op, ops.Constant) and not any(op.values)
