"""Evaluates the constants of a spec, each once."""

from __future__ import annotations

from compiler.lowering.constants import NamedArray, evaluate, refuse_infinite, shaped
from compiler.lowering.context import Context
from compiler.lowering.failure import LoweringFailed
from compiler.lowering.shape_repair import dims_repair
from spec_schema.errors import names
from spec_schema.sections.values import Constant


class Constants:
    """The entries of `constants:`."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._constants: dict[str, NamedArray | None] = {}
        self._active: list[str] = []
        """Constants being evaluated; meeting one of them again is a circular definition."""

    def value(self, name: str, entry: Constant) -> NamedArray:
        """The value of a `constants:` entry. Raises LoweringFailed if it has a mistake."""
        if name in self._active:
            circle = (*self._active[self._active.index(name) :], name)
            self._context.findings.report(names.circular_constant(circle, entry.value.span))
            raise LoweringFailed
        if name not in self._constants:
            self._constants[name] = None  # remains if it fails: its mistake is reported once
            self._active.append(name)
            try:
                self._constants[name] = self._evaluated(name, entry)
            finally:
                self._active.pop()
        found = self._constants[name]
        if found is None:
            raise LoweringFailed
        return found

    def _evaluated(self, name: str, entry: Constant) -> NamedArray:
        found = evaluate(self._context, entry.value)
        unit = entry.unit.value if entry.unit else found.unit
        if not entry.dims:
            # a value may have one unnamed axis (R3); two could not be distinguished
            if len([axis for axis in found.axes if not axis.name]) > 1:
                repair = dims_repair(self._context, found.values.shape)
                problem = "is a matrix and needs `dims:`"
                self._context.findings.report(
                    names.unfit_constant(f"`{name}`", problem, entry.value.span, repair)
                )
                raise LoweringFailed
            refuse_infinite(self._context, f"`{name}`", found.values, entry.value.span)
            return NamedArray(found.values, found.axes, unit)
        axes = tuple(self._context.dimension(dim.value, dim.span) for dim in entry.dims)
        return NamedArray(
            shaped(self._context, name, found.values, axes, entry.value.span), axes, unit
        )
