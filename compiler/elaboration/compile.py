"""Compiles a spec: lowers every entry, reports every mistake of the stage, verifies the program."""

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
"""What `strict_units` refuses."""


@dataclass(frozen=True, kw_only=True)
class Compiled:
    """A program and what is worth saying about the spec that it came from."""

    program: Program
    spec: Spec
    """With the entries of sub-models under their full names."""
    warnings: tuple[Diagnostic, ...]
    problems: Mapping[str, SectionProblem] = field(default_factory=dict[str, SectionProblem])
    """The compiled sections of features, such as `mpc`, by their keys; `of` gives one by class."""
    types: Mapping[str, Type] = field(default_factory=dict[str, Type])
    """Of one sample of every equation and output, as it was written: passes share and drop some."""

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
    """The program of a spec, in window form.

    `used` is what was read for its sub-models and `weights` the arrays of those with `weights:`, by
    their full names; without them a sub-model has its initial values. `numbers` has the texts of
    files of initial values, by path; those that are not there are read.
    Raises SpecError with every mistake found; with `strict_units` units that do not fit are errors.
    Another `draw` has other initial values where they are drawn.
    """
    problems = Findings()
    try:
        linked = replace(link(spec, used or {}, weights or {}, problems), numbers=numbers or {})
        # before anything is lowered: each name that a broken link leaves out would be reported as
        # unknown
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
    """The program of a spec in which everything has its full name; otherwise as `compile_spec`."""
    spec = linked.spec
    # lowering recurses from an output into what it reads: a chain of equations is as deep as it is
    # long
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
    # What failed without a diagnostic would silently be missing.
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
    # no value of the program reads what a metric alone compares with
    kept = {signal.name for signal in program.signals} | measured_targets(spec)
    program = replace(program, signals=tuple(each for each in logged if each.name in kept))
    found = (*never_finite(program), *infinite_slopes(program))
    # asked of what was lowered, not of the program: passes have shared and dropped nodes of it
    types = elaborated.entries.types()
    return Compiled(program=program, spec=spec, warnings=(*diagnostics, *found), types=types)


def _with_problems(
    linked: Linked, compiled: Compiled, compile_it: Callable[[Linked], Compiled]
) -> Compiled:
    """The same with the problems of the sections that features bring."""

    def compile_other(other: Linked) -> OtherProgram:
        whole = compile_it(other)
        more = tuple(found for found in whole.warnings if found not in compiled.warnings)
        # the file has one hash, whichever of its programs is asked
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
    """The diagnostics with those of a broken sub-model as its own file alone brings them.

    There names are as its author wrote them; beside each stands where the file is used.
    """
    broken: dict[str, tuple[Diagnostic, ...]] = {}
    for name, file in used.items():
        path = file.source.path
        # a file may be used under two names: it is compiled and told once
        if path in broken:
            continue
        try:
            # compiled alone, a broken sub-model says what its author would read: names without the
            # prefix
            compile_spec(file.spec, used=file.used, numbers=numbers)
        except SpecError as error:
            place, label = spec.use[name].file.span, f"used here as `{name}`"
            broken[path] = tuple(d.seen_from(place, label) for d in error.diagnostics)
    read = [file for file in used.values() if file.source.path in broken]
    files = {source.path for file in read for source in file.sources}
    # what a broken file's own names say above is not said again under full names
    others = (d for d in diagnostics if d.span is None or d.span.file not in files)
    return (*(d for found in broken.values() for d in found), *others)
