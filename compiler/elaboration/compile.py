"""Compiles a spec: lowers every entry, reports all mistakes, verifies the program."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import field, replace
from functools import partial
from typing import TypeVar

from compiler.elaboration.deep_recursion import room_for
from compiler.elaboration.formulas import formulas_of
from compiler.elaboration.losses.penalties import checked_penalties
from compiler.elaboration.lower_spec import exported_equations, lower_spec
from compiler.elaboration.section import OtherProgram, SectionProblem, problem_of_class, section_of
from compiler.elaboration.signals import logged_signals, measured_targets
from compiler.elaboration.unchecked_scales import report_unchecked_scales
from compiler.interpreter.never_finite import never_finite
from compiler.ir.program import Dimension, Program, UsedPlugin
from compiler.ir.types import Type
from compiler.linking.link import Linked, WeightsByPart, link
from compiler.lowering.environment import START, STEP
from compiler.passes import run_passes
from compiler.passes.analyses.infinite_slopes import infinite_slopes
from spec_schema.diagnostics.diagnostic import Diagnostic, Findings, SpecError
from spec_schema.errors import units
from spec_schema.late_dataclass import dataclass
from spec_schema.plugins import known_plugins, plugins_with
from spec_schema.reading.one_file import ReadResult, all_specs
from spec_schema.sections.spec import Spec

P = TypeVar("P", bound=SectionProblem)

UNIT_WARNINGS = ("W0504", "W0505", "W0509", "W0510", "W0737")
"""Warnings that become errors with `strict_units`."""


@dataclass(frozen=True, kw_only=True)
class Compiled:
    """The program of a spec, its warnings, and the compiled sections of features."""

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
        """The problem of this class; None if no section of the spec has one."""
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
    initial values.

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
    """Compiles a spec in which every name is a full name; otherwise like `compile_spec`."""
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
    """Adds the compiled sections of features."""

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
    """The plug-ins without which the spec and its sub-models cannot be read."""
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
    """Replaces diagnostics of a broken sub-model by those of compiling its file alone.

    These use the names of that file; a note shows where the sub-model is used.
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
