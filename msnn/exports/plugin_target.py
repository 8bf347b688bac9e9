"""Reports mistakes of a plug-in's export target as the plug-in's."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

from msnn.errors.failures import MissingExtraError
from msnn.exports.target import (
    AnyPlan,
    AnyTarget,
    ExportPlan,
    Loaded,
    Request,
    Target,
    Weights,
)
from spec_schema.plugins import PluginPart, is_a, no_fault
from spec_schema.registry import TargetLine


def plugin_target(line: TargetLine) -> AnyTarget:
    """The target of a plug-in. Its functions raise SpecError (E0230) for its own mistakes."""
    part = PluginPart("target", line.key, line.target.module, (MissingExtraError,))
    found: object = line.target.value
    if not isinstance(found, Target):
        raise part.fault(f"is a {type(found).__name__}, not a Target")
    target = cast("AnyTarget", found)

    def guarded(
        function: Callable[..., Any] | None, fault: Callable[..., str | None] = no_fault
    ) -> Any:
        return None if function is None else part.guarded(function, fault)

    @contextmanager
    def loaded(*arguments: Any) -> Generator[Loaded]:
        assert target.load is not None
        with ExitStack() as stack:
            # what fails while it runs is reported by the comparison
            manager = guarded(target.load)(*arguments)
            yield guarded(stack.enter_context)(manager)

    own_prepare = guarded(target.prepare, _fault_of_plan)

    def prepare(request: Request, entry: Any) -> AnyPlan | None:
        if request.weights is not None:
            request = replace(request, weights=read_only(request.weights))
        plan = own_prepare(request, entry)
        # the plan names the record without guards
        return None if plan is None else replace(plan, target=record)

    own_write = guarded(target.write, _fault_of_files)
    own_judge, own_compare = guarded(target.judge), guarded(target.compare)

    def write(plan: AnyPlan, weights: Weights, folder: Path) -> tuple[Path, ...]:
        return own_write(plan, read_only(weights), folder)

    def judge(plan: AnyPlan, weights: Weights, *arguments: Any) -> Any:
        return own_judge(plan, read_only(weights), *arguments)

    def compare(plan: AnyPlan, weights: Weights, written: Any) -> Any:
        return own_compare(plan, read_only(weights), written)

    record = replace(
        target,
        promise=guarded(target.promise),
        prepare=prepare,
        write=write,
        load=None if target.load is None else loaded,
        judge=judge,
        faults=guarded(target.faults, is_a(tuple)),
        without_section=guarded(target.without_section),
        compare=None if target.compare is None else compare,
        tell=guarded(target.tell, is_a(str)),
    )
    return record


def read_only(weights: Weights) -> Weights:
    """Copies that a plug-in cannot change, so that later targets get the same weights."""
    copies = {name: array.copy() for name, array in weights.items()}
    for array in copies.values():
        array.setflags(write=False)
    return MappingProxyType(copies)


def _fault_of_plan(plan: object, request: Request, entry: object) -> str | None:
    del entry
    if plan is None:
        return None if request.findings.failed else "planned nothing, and reported no error"
    return is_a(ExportPlan)(plan)


def _fault_of_files(files: object, plan: AnyPlan, weights: object, folder: Path) -> str | None:
    del plan, weights
    if not isinstance(files, tuple):
        return f"returned a {type(files).__name__}, not a tuple of paths"
    for file in cast("tuple[object, ...]", files):
        if not isinstance(file, Path):
            return f"returned a {type(file).__name__}, not a path"
        if not file.resolve().is_relative_to(folder.resolve()):
            return f"wrote {file.name} outside of its folder"
        if not file.is_file():
            return f"names {file.name}, and did not write it"
    return None
